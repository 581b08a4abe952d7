//! Accuracy of the surface of a simulated walk against the world's true surface:
//! `cargo run --release -p cairn-engine --example surface -- sim:corridor?sensor=rgbd&seed=1 [VOXEL_M [FROM_S TO_S]]`.
//!
//! An address with `seed=1-20` is walked with each of these seeds, and the figures are printed as a table.
//!
//! From FROM_S to TO_S the camera is covered: it is lost, a new map begins, and is merged where a place is recognised.
//! A wall that is doubled then has vertices far from every face, in the surface or in the submaps together.
//!
//! Two surfaces are compared: one fused with the pose that each key frame had when it was made (what a dense map shows
//! that does not follow loop closures), and the one of the dense mapper. Errors are distances of vertices to the world's
//! faces; completeness is the share of the surface seen (points of true depth images within 3.5 m) that has a vertex
//! within 5 cm. Map and world are aligned by the trajectory.

use cairn_dense::{
    DepthConfig, DepthPreparer, Mesh, MeshConfig, Mesher, SubmapConfig, TsdfConfig, TsdfVolume,
};
use cairn_engine::{Config, DenseMapper, Engine, Runner, SensorMode};
use cairn_geometry::{Se3, Sim3, Vec3, umeyama};
use cairn_sensor::{DepthImage, GrayImage, Source, Stamp};
use cairn_sim::{Renderer, SimConfig, SimSource};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let address = arguments.first().map_or("sim:corridor?sensor=rgbd&seed=1", String::as_str);
    let number = |i: usize, otherwise: f64| arguments.get(i).map_or(Ok(otherwise), |v| v.parse::<f64>());
    let (voxel_m, covered_s) = (number(1, 0.02)?, [number(2, 0.0)?, number(3, 0.0)?]);
    let Some((before, seeds)) = address.split_once("seed=").filter(|(_, after)| after.contains('-')) else {
        return walk(address, voxel_m, covered_s).map(drop);
    };
    let (seeds, after) = seeds.split_at(seeds.find('&').unwrap_or(seeds.len()));
    let (first, last) = seeds.split_once('-').ok_or("seed=FIRST-LAST")?;
    let mut rows = String::new();
    for seed in first.parse::<u64>()?..=last.parse()? {
        let walked = walk(&format!("{before}seed={seed}{after}"), voxel_m, covered_s)?;
        rows += &walked.row(seed);
        println!("\n{HEAD}{rows}");
    }
    Ok(())
}

/// The head of the table.
const HEAD: &str = "| seed | loops and merges | maps | with the pose when made | following the map | its submaps together | farther \
    than 5 cm | complete | trajectory |\n|---|---|---|---|---|---|---|---|---|\n";

/// What a walk gave: the surface with the poses at the time, the one that follows the map, and the submaps together.
struct Walked {
    joined: usize,
    maps: usize,
    surfaces: [Figures; 3],
}

/// Figures of a surface.
#[derive(Clone, Copy, Default)]
struct Figures {
    mean_mm: f64,
    most_mm: f64,
    far: f64,
    complete: f64,
    trajectory_mm: f64,
}

impl Walked {
    fn row(&self, seed: u64) -> String {
        let [made, whole, together] = &self.surfaces;
        let mm = |f: &Figures| format!("{:.1} / {:.1} mm", f.mean_mm, f.most_mm);
        format!(
            "| {seed} | {} | {} | {} | {} | {} | {:.2} -> {:.2} -> {:.2} % | {:.1} % | {:.1} -> {:.1} mm |\n",
            self.joined,
            self.maps,
            mm(made),
            mm(whole),
            mm(together),
            made.far,
            whole.far,
            together.far,
            whole.complete,
            made.trajectory_mm,
            whole.trajectory_mm
        )
    }
}

/// Walks once, and prints what there is to tell.
fn walk(address: &str, voxel_m: f64, covered_s: [f64; 2]) -> Result<Walked, Box<dyn std::error::Error>> {
    let config = SimConfig::parse(address)?;
    let mut source = SimSource::new(&config)?;
    let rig = source.rig().clone();
    let sensor = rig.depth.clone().ok_or("give a world with sensor=rgbd")?;
    let truth: BTreeMap<Stamp, Se3> = source.info().truth.iter().copied().collect();
    let mut settings = Config::default();
    settings.inertial.enabled = rig.imu.is_some();
    let mut engine = Engine::new(&rig, SensorMode::Rgbd, source.info().rate_hz, Runner::Lockstep, &settings)?;
    let tsdf = TsdfConfig { voxel_m, ..TsdfConfig::default() };
    let submaps = SubmapConfig { tsdf, ..SubmapConfig::default() };
    let mut mapper = DenseMapper::new(&mut engine, &rig, submaps)?;
    let mut preparer = DepthPreparer::new(DepthConfig::default(), sensor.camera, sensor.metres_per_unit)?;
    let mut as_made = TsdfVolume::new(tsdf)?;
    let (mut follow_ms, mut step_ms): (Vec<f64>, f64) = (Vec::new(), 0.0);
    let (mut made, mut loops) = (0, 0);
    let mut first = None;
    while let Some(mut packet) = source.next_packet()? {
        let t_s = packet.stamp - *first.get_or_insert(packet.stamp);
        if (covered_s[0]..covered_s[1]).contains(&t_s) {
            packet.images.iter_mut().for_each(|i| *i = Arc::new(GrayImage::new(i.width(), i.height())));
            packet.depth = packet.depth.map(|d| Arc::new(DepthImage::new(d.width(), d.height())));
        }
        let output = engine.on_packet(&packet)?;
        loops += output.verdicts.iter().filter(|v| v.result.is_ok()).count();
        let begin = Instant::now();
        mapper.on_packet(&packet, &output);
        follow_ms.push(begin.elapsed().as_secs_f64() * 1e3);
        if mapper.counts().key_frames > made
            && let (Some(depth), Some(anchored)) = (&packet.depth, output.anchored)
        {
            made = mapper.counts().key_frames;
            let camera_from_depth =
                engine.front_end().model().body_from_camera.inverse() * sensor.body_from_depth;
            as_made.integrate(
                preparer.prepare(depth)?,
                None,
                &(anchored.world_from_camera * camera_from_depth),
            )?;
        }
        let near = output.world_from_body.map_or_else(Vec3::zeros, |p| p.se3.translation);
        let begin = Instant::now();
        mapper.step(&near, 4);
        step_ms += begin.elapsed().as_secs_f64() * 1e3;
    }
    engine.finish();
    let begin = Instant::now();
    mapper.follow();
    println!("final changes followed in {:.1} ms", begin.elapsed().as_secs_f64() * 1e3);
    let begin = Instant::now();
    let mut images = 0;
    loop {
        let progress = mapper.step(&Vec3::zeros(), 100);
        images += progress.images;
        if progress.waiting == 0 {
            break;
        }
    }
    println!(
        "{images} fusions of key frames that had moved, in {:.0} ms",
        begin.elapsed().as_secs_f64() * 1e3
    );
    let [volumes, depth] = mapper.map().bytes();
    let counts = mapper.counts();
    println!(
        "{counts:?}, {loops} loops and merges; {} submaps {:.1} MB, depth {:.1} MB ({:.0} kB a key frame)",
        mapper.map().submaps().count(),
        volumes as f64 / 1e6,
        depth as f64 / 1e6,
        depth as f64 / 1e3 / counts.key_frames.max(1) as f64
    );
    follow_ms.sort_by(f64::total_cmp);
    println!(
        "following: median {:.3}, p99 {:.2}, most {:.2} ms a frame; re-fusion {:.3} ms a frame",
        follow_ms[follow_ms.len() / 2],
        follow_ms[follow_ms.len() * 99 / 100],
        follow_ms[follow_ms.len() - 1],
        step_ms / follow_ms.len() as f64
    );
    let seen = seen(&config, &source, &sensor.body_from_depth, &truth)?;
    let live: BTreeMap<Stamp, Se3> = engine.live_trajectory().into_iter().collect();
    let corrected: BTreeMap<Stamp, Se3> = engine.trajectory().into_iter().collect();
    let map = mapper.largest_map().ok_or("no map was made")?;
    let maps = engine.snapshot().maps().count();
    println!("{maps} maps in the end, {} merged", mapper.counts().merges);
    let whole = mapper.surface(map, tsdf)?;
    let mut surfaces = [Figures::default(); 3];
    for (i, (name, volume, poses)) in
        [("as the poses were at the time", &as_made, &live), ("following the map", &whole, &corrected)]
            .into_iter()
            .enumerate()
    {
        let mesh = Mesher::new(MeshConfig::of_key_frames()).whole(volume);
        let world_from_map = aligned(poses, &truth)?;
        surfaces[i] = report(
            name,
            &mesh,
            &world_from_map,
            source.world(),
            &seen,
            engine_rms(poses, &truth, &world_from_map),
        );
    }
    let world_from_map = aligned(&corrected, &truth)?;
    let rms = engine_rms(&corrected, &truth, &world_from_map);
    surfaces[2] =
        report("its submaps together", &together(&mapper, map)?, &world_from_map, source.world(), &seen, rms);
    Ok(Walked { joined: loops, maps, surfaces })
}

/// The surfaces of all submaps of a map, where they lie.
fn together(mapper: &DenseMapper, map: cairn_atlas::MapId) -> Result<Mesh, Box<dyn std::error::Error>> {
    let mut all = Mesh::default();
    for submap in mapper.map().submaps().filter(|s| s.map.0 == map.root().index() as u64) {
        let mesh = Mesher::new(MeshConfig::of_key_frames()).whole(submap.tsdf);
        let placed = mesh.positions.iter().map(|p| {
            let at = submap.world_from_submap * Vec3::new(p[0].into(), p[1].into(), p[2].into());
            [at.x as f32, at.y as f32, at.z as f32]
        });
        all.positions.extend(placed);
    }
    Ok(all)
}

fn aligned(
    poses: &BTreeMap<Stamp, Se3>,
    truth: &BTreeMap<Stamp, Se3>,
) -> Result<Sim3, Box<dyn std::error::Error>> {
    let pairs: Vec<(Vec3, Vec3)> =
        (poses.iter()).filter_map(|(t, p)| Some((truth.get(t)?.translation, p.translation))).collect();
    let (target, from): (Vec<Vec3>, Vec<Vec3>) = pairs.into_iter().unzip();
    Ok(umeyama(&target, &from, false)?)
}

fn engine_rms(poses: &BTreeMap<Stamp, Se3>, truth: &BTreeMap<Stamp, Se3>, place: &Sim3) -> f64 {
    let errors = poses
        .iter()
        .filter_map(|(t, p)| Some((*place * p.translation - truth.get(t)?.translation).norm_squared()));
    let (sum, n) = errors.fold((0.0, 0.0), |(s, n), e| (s + e, n + 1.0));
    (sum / f64::max(n, 1.0)).sqrt()
}

/// Points of the true surface that the walk saw, one in each cell of 5 cm.
fn seen(
    config: &SimConfig,
    source: &SimSource,
    body_from_depth: &Se3,
    truth: &BTreeMap<Stamp, Se3>,
) -> Result<Vec<Vec3>, Box<dyn std::error::Error>> {
    let camera = config.camera;
    let mut renderer = Renderer::new(source.world(), camera)?;
    let (mut image, mut depth) =
        (GrayImage::new(camera.width, camera.height), DepthImage::new(camera.width, camera.height));
    let mut cells = BTreeSet::new();
    let mut out = Vec::new();
    for pose in truth.values().step_by(10) {
        let pose = *pose * *body_from_depth;
        renderer.render(&pose, &mut image, Some(&mut depth));
        for i in (0..depth.data().len()).step_by(37) {
            let z = f64::from(depth.data()[i]) * 1e-3;
            if !(0.4..3.5).contains(&z) {
                continue;
            }
            let (u, v) = ((i % camera.width) as f64, (i / camera.width) as f64);
            let p = pose * Vec3::new((u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z);
            if cells.insert([p.x, p.y, p.z].map(|v| (v * 20.0).floor() as i32)) {
                out.push(p);
            }
        }
    }
    Ok(out)
}

fn report(
    name: &str,
    mesh: &Mesh,
    place: &Sim3,
    world: &Arc<cairn_sim::World>,
    seen: &[Vec3],
    ate_m: f64,
) -> Figures {
    let vertices: Vec<Vec3> = mesh
        .positions
        .iter()
        .map(|p| *place * Vec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2])))
        .collect();
    let cell = |p: &Vec3| [p.x, p.y, p.z].map(|v| (v * 20.0).floor() as i32);
    let mut cells: BTreeMap<[i32; 3], Vec<Vec3>> = BTreeMap::new();
    vertices.iter().for_each(|p| cells.entry(cell(p)).or_default().push(*p));
    let covered = seen.iter().filter(|p| {
        let c = cell(p);
        let mut around = (0..27).map(|i| [c[0] + i % 3 - 1, c[1] + i / 3 % 3 - 1, c[2] + i / 9 - 1]);
        around.any(|k| cells.get(&k).is_some_and(|all| all.iter().any(|q| (q - *p).norm() < 0.05)))
    });
    let covered = covered.count() as f64 / seen.len().max(1) as f64;
    let mut errors: Vec<f64> = vertices.iter().step_by(3).map(|p| world.distance_to_surface(p)).collect();
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    let at = |share: f64| errors.get((errors.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    let doubled = errors.iter().filter(|e| **e > 0.05).count() as f64 / errors.len().max(1) as f64;
    println!(
        "{name}: mean {:.1} mm, median {:.1}, 95 % {:.1} mm, {:.2} % farther than 5 cm; complete {:.1} %; {} vertices; trajectory {:.1} mm",
        mean * 1e3,
        at(0.5) * 1e3,
        at(0.95) * 1e3,
        100.0 * doubled,
        100.0 * covered,
        vertices.len(),
        ate_m * 1e3
    );
    Figures {
        mean_mm: mean * 1e3,
        most_mm: at(0.95) * 1e3,
        far: 100.0 * doubled,
        complete: 100.0 * covered,
        trajectory_mm: ate_m * 1e3,
    }
}
