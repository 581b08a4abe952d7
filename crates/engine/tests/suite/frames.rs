//! Poses of every frame of the rig (body, camera, IMU, second camera), with every sensor and in metric and not metric
//! maps, compared with the truth. Body, camera and IMU are mounted apart from one another and turned, and the motion
//! turns the rig to and fro: a lever arm that is left out where lengths are metres, or added where they are not, is
//! an error of more than a decimetre that no alignment takes away.

use cairn_engine::{Config, Engine, Host, PoseTime, Runner, SensorMode};
use cairn_eval::{Align, EvalOptions, Evaluation, evaluate};
use cairn_geometry::{Se3, So3, Trajectory, Vec3};
use cairn_sensor::{Camera, Rig, Source, Stamp};
use cairn_sim::{CameraPath, Effects, ImuConfig, SimConfig, SimSensor, SimSource, WorldKind};

/// Frames a second, and seconds of the walk.
const RATE_HZ: f64 = 15.0;
const WALK_S: f64 = 12.0;
/// Greatest root mean square of the errors, metres and degrees. The lever arms below are half a metre long, the
/// rotations more than a radian.
const WITHIN_M: f64 = 0.05;
const WITHIN_DEG: f64 = 2.0;
/// The same poses against the truth of another place are at least this far off, metres: the comparison can tell.
const ELSEWHERE_M: f64 = 0.1;

/// The IMU's pose in the body frame, and the first camera's in the IMU's (the simulated IMU is at the origin of the
/// simulated body).
fn body_from_imu() -> Se3 {
    Se3::new(So3::exp(&Vec3::new(0.4, -0.8, 1.1)), Vec3::new(-0.3, 0.25, 0.35))
}

fn imu_from_camera() -> Se3 {
    // The IMU's x axis points ahead, its z axis up; the camera's z axis points ahead, its y axis down.
    let ahead = So3::exp(&Vec3::new(-1.0, 1.0, -1.0).normalize().scale(2.0 * std::f64::consts::FRAC_PI_3));
    Se3::new(ahead * So3::exp(&Vec3::new(0.05, -0.1, 0.1)), Vec3::new(0.3, -0.2, 0.25))
}

/// The IMU's pose: along an arc, facing outwards, while it turns to and fro, nods and sways.
fn world_from_imu(t: f64) -> Se3 {
    let along = 0.4 * t;
    let radius = 1.2 + 0.3 * (1.7 * t).sin();
    let place =
        Vec3::new(5.0 + radius * along.cos(), 4.0 + radius * along.sin(), 1.5 + 0.1 * (2.9 * t).sin());
    let yaw = So3::exp(&(Vec3::z() * (along + 0.5 * (1.3 * t).sin())));
    Se3::new(yaw * So3::exp(&Vec3::new(0.1 * (1.9 * t).sin(), 0.2 * (1.1 * t).sin(), 0.0)), place)
}

/// A run, with the rig and the true poses of its body.
struct Run {
    engine: Engine,
    rig: Rig,
    world_from_body: Vec<(Stamp, Se3)>,
}

fn run(sensor: SimSensor, imu: bool) -> Run {
    let poses = (0..=(WALK_S * 60.0) as usize).map(|k| k as f64 / 60.0);
    let config = SimConfig {
        sensor,
        imu: imu.then(ImuConfig::default),
        camera: Camera::pinhole(400, 300, 260.0, 260.0, 199.5, 149.5),
        rate_hz: RATE_HZ,
        body_from_camera: imu_from_camera(),
        route: CameraPath::Poses(poses.map(|t| (Stamp::from_seconds(t), world_from_imu(t))).collect()),
        effects: Effects::none(),
        ..SimConfig::new(WorldKind::Arena, 5)
    };
    let mut source = SimSource::new(&config).unwrap();
    let mut rig = source.rig().clone();
    let body_from_imu = body_from_imu();
    rig.cameras.iter_mut().for_each(|c| c.body_from_camera = body_from_imu * c.body_from_camera);
    rig.depth.iter_mut().for_each(|d| d.body_from_depth = body_from_imu * d.body_from_depth);
    rig.imu.iter_mut().for_each(|i| i.body_from_imu = body_from_imu * i.body_from_imu);
    let mode = match sensor {
        SimSensor::Mono => SensorMode::Mono,
        SimSensor::Stereo => SensorMode::Stereo,
        SimSensor::Rgbd => SensorMode::Rgbd,
    };
    let mut settings = Config::default();
    settings.inertial.enabled = imu;
    let mut engine = Engine::new(&rig, mode, RATE_HZ, Runner::Lockstep, &settings, &Host::bare()).unwrap();
    while let Some(packet) = source.next_packet().unwrap() {
        engine.on_packet(&packet).unwrap();
    }
    engine.finish();
    let imu_from_body = body_from_imu.inverse();
    let world_from_body = source.info().truth.iter().map(|(t, imu)| (*t, *imu * imu_from_body)).collect();
    Run { engine, rig, world_from_body }
}

impl Run {
    /// What is mounted on the body, by name; a rig without an IMU has something else at its place.
    fn mounted(&self) -> Vec<(&'static str, Se3)> {
        let mut all = vec![("body", Se3::identity()), ("imu", body_from_imu())];
        all.extend(["cam0", "cam1"].into_iter().zip(self.rig.cameras.iter().map(|c| c.body_from_camera)));
        all
    }

    /// Compares poses with the truth of a place on the body, in its frame, and of a rotation.
    fn compare(&self, poses: &[(Stamp, Se3)], body_from: &Se3, align: Align) -> Evaluation {
        let truth = self.world_from_body.iter().map(|(t, body)| (*t, *body * *body_from)).collect();
        let options = EvalOptions { align, max_difference_s: 1e-6, ..EvalOptions::default() };
        evaluate(&trajectory(truth), &trajectory(poses.to_vec()), &options).unwrap()
    }

    /// Compares poses of something mounted on the body: in metres at its own place; in a unit of the map's own at the
    /// first camera's place; with its own orientation.
    fn check_poses(&self, name: &str, poses: &[(Stamp, Se3)], body_from_mounted: &Se3, metric: bool) {
        let at = |place: &Se3| Se3::new(body_from_mounted.rotation, place.translation);
        let camera = &self.rig.cameras[0].body_from_camera;
        let others = [&Se3::identity(), camera];
        let (here, align) = if metric { (body_from_mounted, Align::Se3) } else { (camera, Align::Sim3) };
        let found = self.compare(poses, &at(here), align);
        let (m, deg) = (found.ate_m.rmse, found.ate_deg.map_or(f64::NAN, |d| d.rmse));
        println!("{name}: {m:.4} m, {deg:.2} deg, {} poses", poses.len());
        assert!(m < WITHIN_M && deg < WITHIN_DEG, "{name}: {m} m, {deg} deg");
        for other in others.iter().filter(|p| (p.translation - here.translation).norm() > 0.2) {
            let m = self.compare(poses, &at(other), align).ate_m.rmse;
            assert!(m > ELSEWHERE_M, "{name}: {m} m, although compared with another place");
        }
    }

    /// Compares all frames; `metric` is what the final map has to be.
    fn check(&self, name: &str, metric: bool) {
        assert_eq!(self.engine.is_metric(), metric, "{name}");
        assert_eq!(self.engine.snapshot().maps().count(), 1, "{name}: lost on the way");
        let posed = self.engine.log().frames().iter().filter(|f| f.anchored.is_some());
        let told: Vec<bool> = posed.map(|f| f.metric).collect();
        assert!(told.len() as f64 > 0.8 * RATE_HZ * WALK_S, "{name}: {} poses", told.len());
        for (mounted, body_from_mounted) in self.mounted() {
            let corrected = self.engine.camera_poses(PoseTime::Corrected).of_mounted(&body_from_mounted);
            self.check_poses(&format!("{name} {mounted} corrected"), &corrected, &body_from_mounted, metric);
            let live = self.engine.camera_poses(PoseTime::Live).of_mounted(&body_from_mounted);
            for metric in [false, true] {
                let poses =
                    live.iter().zip(&told).filter(|(_, told)| **told == metric).map(|(pose, _)| *pose);
                let poses: Vec<_> = poses.collect();
                let name = format!("{name} {mounted} live, metric: {metric}");
                // Too short a stretch turns too little to tell.
                if poses.len() as f64 > 3.0 * RATE_HZ {
                    self.check_poses(&name, &poses, &body_from_mounted, metric);
                }
            }
        }
    }
}

fn trajectory(poses: Vec<(Stamp, Se3)>) -> Trajectory {
    Trajectory::from_unsorted(poses.into_iter().map(|(t, p)| (t.0, p)).collect()).unwrap()
}

#[test]
fn one_camera_gives_every_frame_at_the_camera_in_the_unit_of_its_map() {
    run(SimSensor::Mono, false).check("mono", false);
}

#[test]
fn one_camera_with_an_imu_gives_every_frame_its_place_once_lengths_are_metres() {
    let run = run(SimSensor::Mono, true);
    let metric = run.engine.log().frames().iter().filter(|f| f.metric).count();
    assert!(metric as f64 > 2.0 * RATE_HZ, "only {metric} frames in metres");
    run.check("mono-imu", true);
}

#[test]
fn cameras_with_depth_give_every_frame_its_place() {
    run(SimSensor::Stereo, false).check("stereo", true);
    run(SimSensor::Rgbd, false).check("rgbd", true);
}
