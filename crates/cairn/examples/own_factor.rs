//! A factor of one's own: positions as GPS gives them, which make a map of one camera metric.
//!
//! One camera does not see how large the world is, so its map has a unit of its own. [`Gps`] is a kind of factor: where the antenna was at
//! some key frames. Added to a window of the whole map it finds the scale, and leaves out a fix that is wrong.
//!
//! `cargo run --release -p cairn --example own_factor`

use cairn::adjust::{Frames, Window, WindowConfig, WindowFactors};
use cairn::atlas::{KeyFrameId, MapId, Snapshot};
use cairn::geometry::{Manifold, Mat3, Se3, So3, Trajectory, Vec3, hat, umeyama};
use cairn::solve::{CHI2_3, Equations, Factors, Loss, Variable};
use cairn::{Map, Slam, Source, open};
use cairn_random::Random;
use nalgebra::{SMatrix, Vector6};
use std::error::Error;

/// A walk of 12 s through a simulated world with one camera.
const WALK: &str = "sim:demo?seed=5&sensor=mono&resolution=320x240&rate=10&detail=0.5&duration=12";
/// The antenna, 25 cm above the camera (whose y axis points down).
const ANTENNA: Vec3 = Vec3::new(0.0, -0.25, 0.05);
/// Standard deviation of a fix along each axis, metres.
const SIGMA_M: f64 = 0.05;

/// Measured positions of an antenna on the camera.
struct Gps {
    /// By key frame, in the frame of the map, metres.
    fixes: Vec<(KeyFrameId, Vec3)>,
    /// Those of key frames of the window: index of its pose, and position.
    bound: Vec<(usize, Vec3)>,
}

impl Gps {
    fn new(fixes: Vec<(KeyFrameId, Vec3)>) -> Self {
        Self { fixes, bound: Vec::new() }
    }

    /// The whitened residual of a fix, and its Jacobian by a perturbation of the pose on the right: translation, then rotation.
    fn linear(world_from_camera: &Se3, fix: &Vec3) -> (Vec3, SMatrix<f64, 3, 6>) {
        let rotation: Mat3 = world_from_camera.rotation.matrix();
        let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
        jacobian.fixed_columns_mut::<3>(0).copy_from(&(rotation / SIGMA_M));
        jacobian.fixed_columns_mut::<3>(3).copy_from(&(-rotation * hat(&ANTENNA) / SIGMA_M));
        ((*world_from_camera * ANTENNA - fix) / SIGMA_M, jacobian)
    }

    fn chi2(poses: &[Se3], (slot, fix): &(usize, Vec3)) -> f64 {
        Self::linear(&poses[*slot], fix).0.norm_squared()
    }

    /// Beyond the 95 % bound a fix pulls with constant force.
    fn loss() -> Loss {
        Loss::Huber(CHI2_3.sqrt())
    }
}

/// What it is to the solver: which variables each fix touches, and its residual.
impl Factors for Gps {
    fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
        self.bound.iter().for_each(|(slot, _)| visit(&[Variable::Pose(*slot)]));
    }
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
        for (slot, fix) in &self.bound {
            let (residual, jacobian) = Self::linear(&poses[*slot], fix);
            let parts = [(Some(Variable::Pose(*slot)), 0..6)];
            equations.add_robust(&residual, &jacobian, &parts, &Self::loss());
        }
        Some(())
    }
    fn attempt(&mut self, poses: &[Se3], _: &[f64]) -> f64 {
        self.bound.iter().map(|fix| 0.5 * Self::loss().of(Self::chi2(poses, fix)).0).sum()
    }
}

/// What it is to a map: which of its fixes a window has, and what it does with those that are contradicted.
impl WindowFactors for Gps {
    fn bind(&mut self, _: &Snapshot, frames: &Frames) -> usize {
        let bound = |(id, fix): &(KeyFrameId, Vec3)| {
            Some((frames.slot(*id).filter(|slot| frames.any_moves(&[*slot]))?, *fix))
        };
        self.bound = self.fixes.iter().filter_map(bound).collect();
        self.bound.len()
    }
    fn leave_out_outliers(&mut self, poses: &[Se3]) {
        self.bound.retain(|fix| Self::chi2(poses, fix) < CHI2_3);
    }
}

/// The greatest difference of a Jacobian from central differences of its residual, relative to its greatest entry.
fn jacobian_error() -> f64 {
    let pose = Se3::new(So3::exp(&Vec3::new(0.4, -1.1, 0.7)), Vec3::new(1.0, -2.0, 3.0));
    let fix = Vec3::new(1.2, -1.9, 2.5);
    let (_, jacobian) = Gps::linear(&pose, &fix);
    let off = |column: usize| {
        let at = |h: f64| {
            let mut step = Vector6::zeros();
            step[column] = h;
            Gps::linear(&pose.retract(&step), &fix).0
        };
        ((at(1e-5) - at(-1e-5)) / 2e-5 - jacobian.column(column)).amax()
    };
    (0..6).map(off).fold(0.0, f64::max) / jacobian.amax()
}

/// True poses of the camera at the key frames of a map, in the frame of the map: its first key frame is where it was.
fn truth(map: &Map, id: MapId, source: &dyn Source) -> Result<Vec<(KeyFrameId, Se3)>, Box<dyn Error>> {
    let truth = source.info().truth.iter().map(|(stamp, pose)| (stamp.0, *pose)).collect();
    let world_from_body = Trajectory::from_unsorted(truth)?;
    let poses = map.snapshot().key_frames_of(id).filter_map(|k| {
        Some((k.id, world_from_body.at(k.stamp.0)? * map.camera().body_from_camera, k.world_from_camera))
    });
    let poses: Vec<_> = poses.collect();
    let (_, first, estimated) = poses.first().ok_or("no key frame has a true pose")?;
    let map_from_world = *estimated * first.inverse();
    Ok(poses.iter().map(|(id, pose, _)| (*id, map_from_world * *pose)).collect())
}

/// How large a map is by its true poses, and how far its key frames are off, RMSE in metres.
fn compare(snapshot: &Snapshot, truth: &[(KeyFrameId, Se3)]) -> Result<[f64; 2], Box<dyn Error>> {
    let at = |id: &KeyFrameId| snapshot.key_frame(*id).map(|k| k.world_from_camera);
    let pairs: Vec<[Vec3; 2]> =
        truth.iter().filter_map(|(id, pose)| Some([pose.translation, at(id)?.translation])).collect();
    let [true_positions, found] = [0, 1].map(|i| pairs.iter().map(|p| p[i]).collect::<Vec<Vec3>>());
    let metres_in_unit = umeyama(&true_positions, &found, true)?.scale;
    let squares: f64 = pairs.iter().map(|[a, b]| (a - b).norm_squared()).sum();
    Ok([1.0 / metres_in_unit, (squares / pairs.len() as f64).sqrt()])
}

fn main() -> Result<(), Box<dyn Error>> {
    let error = jacobian_error();
    println!("jacobian  {error:.1e} off central differences");

    // A map of one camera, in a unit of its own.
    let mut source = open(WALK)?;
    let mut slam = Slam::for_source(&*source).build()?;
    while let Some(frame) = source.next_packet()? {
        slam.track(&frame)?;
    }
    slam.finish();
    let map = slam.map();
    let largest = map.largest().ok_or("there is no map")?;

    // A receiver's fixes at its key frames; one is 6 m off, as where a wall reflects the signal.
    let truth = truth(&map, largest, &*source)?;
    let mut noise = Random::new(1);
    let mut fix = |(id, pose): &(KeyFrameId, Se3)| {
        (*id, *pose * ANTENNA + Vec3::from_fn(|_, _| noise.normal(0.0, SIGMA_M)))
    };
    let mut fixes: Vec<(KeyFrameId, Vec3)> = truth.iter().map(&mut fix).collect();
    let wrong = fixes.len() / 2;
    fixes[wrong].1.x += 6.0;

    let config = WindowConfig { iterations: [60, 30], tolerance: 1e-6, ..WindowConfig::default() };
    let window = Window::of(map.snapshot(), map.camera()).add(Gps::new(fixes.clone())).whole(largest);
    let result = window.ok_or("the map is empty")?.solve(&config, || false);
    let (after, _) = map.snapshot().apply(&result.changes);

    let [before, after_all] = [map.snapshot(), &after].map(|s| compare(s, &truth));
    let ([scale_before, m_before], [scale, m]) = (before?, after_all?);
    let (id, fix) = fixes[wrong];
    let pose = after.key_frame(id).ok_or("the key frame is gone")?.world_from_camera;
    let left = (pose * ANTENNA - fix).norm();
    println!("map       {} key frames, {} fixes", truth.len(), fixes.len());
    println!("scale     {scale_before:.3} before, {scale:.3} after");
    println!("error     {m_before:.2} m before, {m:.3} m after");
    println!("wrong fix {left:.2} m from the map");
    let is_right = error < 1e-8 && (scale - 1.0).abs() < 0.02 && m < 0.1 && left > 5.0;
    if is_right { Ok(()) } else { Err("the positions did not make the map metric".into()) }
}
