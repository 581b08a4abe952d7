//! `surface`: accuracy of the surface of a simulated walk against the world's true surface.
//!
//! An address with `seed=1-20` is walked with each of these seeds, and the figures are printed as a table.
//!
//! Where the camera is covered it is lost, a new map begins, and is merged where a place is recognised.
//! A wall that is doubled then has vertices far from every face, in the surface or in the submaps together.
//!
//! Two surfaces are compared: one fused with the pose that each key frame had when it was made (what a dense map shows
//! that does not follow loop closures), and the one of the dense mapper. Errors are distances of vertices to the world's
//! faces; completeness is the share of the surface seen (points of true depth images within 3.5 m) that has a vertex
//! within 5 cm. Map and world are aligned by the trajectory.
//!
//! Whether a surface is bent or doubled tell the poses of the key frames alone (`agree.rs`): how far they put the true surface from
//! where it is in the mean, and on how much of it two of them put it more than 5 cm apart.
//! By how much its lengths are too large is that of the similarity that aligns the trajectory.
//!
//! Walks of more than five minutes print every five minutes what their memory is.

mod agree;
mod judge;

use crate::MeasureError;
use crate::memory::resident_mb;
use agree::{Agreement, View, agreement};
use cairn_atlas::{Change, KeyFrame, KeyFrameId, MapId, Subscription};
use cairn_dense::{
    DepthConfig, DepthPreparer, Mesh, MeshConfig, Mesher, SubmapConfig, TsdfConfig, TsdfVolume,
};
use cairn_engine::{Config, DenseMapper, Engine, Runner, SensorMode};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::{DepthImage, FramePacket, GrayImage, Source, Stamp};
use cairn_sim::{SimConfig, SimSource};
use cairn_sources::std_host;
use judge::{Figures, aligned, engine_rms, report, seen, too_large};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// Seconds of a walk between two lines about its memory.
const MEMORY_EACH_S: f64 = 300.0;

/// Walks an address, with voxels of this size, and the camera covered from one second to another; prints what there is to tell.
///
/// # Errors
/// When the walk cannot be simulated, or has no surface.
pub fn run(address: &str, voxel_m: f64, covered_s: [f64; 2]) -> Result<(), MeasureError> {
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
    than 5 cm | complete | trajectory | bent | doubled by more than 5 cm | lengths too large by |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n";

/// What a walk gave: the surface with the poses at the time, the one that follows the map, and the submaps together.
struct Walked {
    joined: usize,
    maps: usize,
    surfaces: [Figures; 3],
    agreement: Agreement,
    too_large: f64,
}

impl Walked {
    fn row(&self, seed: u64) -> String {
        let [made, whole, together] = &self.surfaces;
        let mm = |f: &Figures| format!("{:.1} / {:.1} mm", f.mean_mm, f.most_mm);
        format!(
            "| {seed} | {} | {} | {} | {} | {} | {:.2} -> {:.2} -> {:.2} % | {:.1} % | {:.1} -> {:.1} mm | {:.1} mm | {:.2} % | {:+.2} % |\n",
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
            whole.trajectory_mm,
            self.agreement.bent_m * 1e3,
            self.agreement.doubled * 100.0,
            self.too_large * 100.0
        )
    }
}

/// An engine on its walk, with the dense mapper that follows it.
struct Run {
    engine: Engine,
    mapper: DenseMapper,
    changes: Subscription,
    camera_from_depth: Se3,
    /// The field with the pose that each key frame had when it was made.
    as_made: TsdfVolume,
    preparer: DepthPreparer,
    fused: usize,
    /// The key frames, with the stamps of their images.
    key_frames: Vec<(KeyFrameId, Stamp)>,
    /// Accepted loops and merges.
    joined: usize,
    /// Milliseconds of each frame.
    follow_ms: Vec<f64>,
    step_ms: f64,
}

impl Run {
    fn new(source: &SimSource, tsdf: TsdfConfig) -> Result<Self, MeasureError> {
        let rig = source.rig().clone();
        let sensor = rig.depth.clone().ok_or("give a world with sensor=rgbd")?;
        let mut settings = Config::default();
        settings.inertial.enabled = rig.imu.is_some();
        let rate_hz = source.info().rate_hz;
        let mut engine =
            Engine::new(&rig, SensorMode::Rgbd, rate_hz, Runner::Lockstep, &settings, &std_host())?;
        let mapper = DenseMapper::new(&mut engine, &rig, SubmapConfig { tsdf, ..SubmapConfig::default() })?;
        Ok(Self {
            changes: engine.subscribe().ok_or("mapping is not running")?,
            camera_from_depth: engine.front_end().model().body_from_camera.inverse() * sensor.body_from_depth,
            engine,
            mapper,
            as_made: TsdfVolume::new(tsdf)?,
            preparer: DepthPreparer::new(DepthConfig::default(), sensor.camera, sensor.metres_per_unit)?,
            fused: 0,
            key_frames: Vec::new(),
            joined: 0,
            follow_ms: Vec::new(),
            step_ms: 0.0,
        })
    }

    /// Walks on by a packet, `at_s` after the walk began.
    fn take(&mut self, packet: &FramePacket, at_s: f64) -> Result<(), MeasureError> {
        let output = self.engine.on_packet(packet)?;
        for verdict in output.verdicts() {
            let Ok(accepted) = &verdict.result else { continue };
            self.joined += 1;
            let (key_frame, candidate) = (verdict.key_frame.index(), verdict.candidate.index());
            println!("{at_s:.1} s: key frame {key_frame} seen from {candidate}: {accepted:?}");
        }
        let begin = Instant::now();
        self.mapper.on_packet(packet, &output);
        self.follow_ms.push(begin.elapsed().as_secs_f64() * 1e3);
        self.key_frames.extend(key_frames_of(&self.changes));
        if self.mapper.counts().key_frames > self.fused
            && let (Some(depth), Some(pose)) = (&packet.depth, output.pose)
        {
            self.fused = self.mapper.counts().key_frames;
            let pose = pose.anchored.world_from_camera * self.camera_from_depth;
            self.as_made.integrate(self.preparer.prepare(depth)?, None, &pose)?;
        }
        let near = output.world_from_body().map_or_else(Vec3::zeros, |p| p.se3.translation);
        let begin = Instant::now();
        self.mapper.step(&near, 4);
        self.step_ms += begin.elapsed().as_secs_f64() * 1e3;
        Ok(())
    }

    fn print_memory(&self, at_s: f64) {
        let ([volumes, depth], counts) = (self.mapper.map().bytes(), self.mapper.counts());
        let snapshot = self.engine.snapshot();
        println!(
            "| {:.0} | {} | {} | {} | {} | {:.1} MB | {:.1} MB | {} |",
            at_s / 60.0,
            snapshot.key_frame_count(),
            snapshot.landmarks().count(),
            counts.removed,
            counts.key_frames - counts.spare,
            depth as f64 / 1e6,
            volumes as f64 / 1e6,
            resident_mb().map_or("unknown".into(), |mb| format!("{mb:.0} MB")),
        );
    }

    /// Ends the walk: the final adjustment, and all that moved fused again.
    fn end(&mut self) {
        self.engine.finish();
        let begin = Instant::now();
        self.mapper.follow();
        println!("final changes followed in {:.1} ms", begin.elapsed().as_secs_f64() * 1e3);
        let begin = Instant::now();
        let mut images = 0;
        loop {
            let progress = self.mapper.step(&Vec3::zeros(), 100);
            images += progress.images;
            if progress.waiting == 0 {
                break;
            }
        }
        let ms = begin.elapsed().as_secs_f64() * 1e3;
        println!("{images} fusions of key frames that had moved, in {ms:.0} ms");
        let ([volumes, depth], counts) = (self.mapper.map().bytes(), self.mapper.counts());
        println!(
            "{counts:?}, {} loops and merges; {} submaps {:.1} MB, depth {:.1} MB ({:.0} kB a key frame)",
            self.joined,
            self.mapper.map().submaps().count(),
            volumes as f64 / 1e6,
            depth as f64 / 1e6,
            depth as f64 / 1e3 / counts.key_frames.max(1) as f64
        );
        let all = &mut self.follow_ms;
        all.sort_by(f64::total_cmp);
        let at = |share: usize| all.get((all.len() * share / 100).min(all.len() - 1)).copied().unwrap_or(0.0);
        println!(
            "following: median {:.3}, p99 {:.2}, most {:.2} ms a frame; re-fusion {:.3} ms a frame",
            at(50),
            at(99),
            at(100),
            self.step_ms / all.len() as f64
        );
    }
}

/// Walks once, and prints what there is to tell.
fn walk(address: &str, voxel_m: f64, covered_s: [f64; 2]) -> Result<Walked, MeasureError> {
    let config = SimConfig::parse(address)?;
    let mut source = SimSource::new(&config)?;
    let tsdf = TsdfConfig { voxel_m, ..TsdfConfig::default() };
    let mut run = Run::new(&source, tsdf)?;
    let (mut first, mut lines) = (None, 0);
    while let Some(mut packet) = source.next_packet()? {
        let at_s = packet.stamp - *first.get_or_insert(packet.stamp);
        if (covered_s[0]..covered_s[1]).contains(&at_s) {
            packet.images.iter_mut().for_each(|i| *i = Arc::new(GrayImage::new(i.width(), i.height())));
            packet.depth = packet.depth.map(|d| Arc::new(DepthImage::new(d.width(), d.height())));
        }
        run.take(&packet, at_s)?;
        if at_s >= MEMORY_EACH_S * f64::from(lines + 1) {
            lines += 1;
            run.print_memory(at_s);
        }
    }
    if run.follow_ms.is_empty() {
        return Err("the walk has no image".into());
    }
    run.end();
    judged(&config, &source, run, tsdf)
}

/// The surfaces of a walk, and the poses of its key frames, against the truth.
fn judged(
    config: &SimConfig,
    source: &SimSource,
    mut run: Run,
    tsdf: TsdfConfig,
) -> Result<Walked, MeasureError> {
    let body_from_depth = run.engine.front_end().model().body_from_camera * run.camera_from_depth;
    let truth: BTreeMap<Stamp, Se3> = source.info().truth.iter().copied().collect();
    let seen = seen(config, source, &body_from_depth, &truth)?;
    let live: BTreeMap<Stamp, Se3> = run.engine.live_trajectory().into_iter().collect();
    let corrected: BTreeMap<Stamp, Se3> = run.engine.trajectory().into_iter().collect();
    let map = run.mapper.largest_map().ok_or("no map was made")?;
    let snapshot = run.engine.snapshot();
    let maps = snapshot.maps().count();
    println!("{maps} maps in the end, {} merged", run.mapper.counts().merges);
    let whole = |volume: &TsdfVolume| Mesher::new(MeshConfig::of_key_frames()).whole(volume);
    let followed = run.mapper.surface(map, tsdf)?;
    let mut surfaces = [Figures::default(); 3];
    let all = [
        ("as the poses were at the time", whole(&run.as_made), &live),
        ("following the map", followed, &corrected),
        ("its submaps together", together(&run.mapper, map), &corrected),
    ];
    for (figures, (name, mesh, poses)) in surfaces.iter_mut().zip(&all) {
        let world_from_map = aligned(poses, &truth)?;
        let rms = engine_rms(poses, &truth, &world_from_map);
        *figures = report(name, mesh, &world_from_map, source.world(), &seen, rms);
    }
    let world_from_map = aligned(&corrected, &truth)?;
    let view = |(id, stamp): &(KeyFrameId, Stamp)| {
        let (alive, _) = snapshot.surviving_ancestor(*id)?;
        snapshot.key_frame(alive).filter(|k| k.map == map)?;
        let in_map = snapshot.world_from_camera(*id)? * run.camera_from_depth;
        let truth = *truth.get(stamp)? * body_from_depth;
        Some(View { world_from_depth: world_from_map.transform_pose(&in_map), truth })
    };
    let views: Vec<View> = run.key_frames.iter().filter_map(view).collect();
    let agreement = agreement(config, source.world(), &views)?;
    println!(
        "{} key frames: bent {:.1} mm, apart {:.1} mm, {:.2} % doubled by more than 5 cm",
        views.len(),
        agreement.bent_m * 1e3,
        agreement.apart_m * 1e3,
        agreement.doubled * 100.0
    );
    let too_large = too_large(&corrected, &truth)?;
    let related = |(n, all), k: &KeyFrame| (n + usize::from(!k.relative_poses.is_empty()), all + 1);
    let (related, all) = snapshot.key_frames_of(map).fold((0, 0), related);
    println!(
        "lengths are {:+.3} % too large; depth relates {related} of {all} key frames to others",
        too_large * 100.0
    );
    Ok(Walked { joined: run.joined, maps, surfaces, agreement, too_large })
}

/// The key frames among the changes since the last call, with the stamps of their images.
fn key_frames_of(changes: &Subscription) -> Vec<(KeyFrameId, Stamp)> {
    let of = |change: &Change| match change {
        Change::AddKeyFrame(k) => Some((k.id, k.stamp)),
        _ => None,
    };
    let all = changes.changes.try_iter();
    all.flat_map(|published| published.changes.iter().filter_map(of).collect::<Vec<_>>()).collect()
}

/// The surfaces of all submaps of a map, where they lie.
fn together(mapper: &DenseMapper, map: MapId) -> Mesh {
    let mut all = Mesh::default();
    for submap in mapper.map().submaps().filter(|s| s.map.0 == map.root().index() as u64) {
        let Some(field) = submap.tsdf else { continue };
        let mesh = Mesher::new(MeshConfig::of_key_frames()).whole(field);
        let placed = mesh.positions.iter().map(|p| {
            let at = submap.world_from_submap * Vec3::new(p[0].into(), p[1].into(), p[2].into());
            [at.x as f32, at.y as f32, at.z as f32]
        });
        all.positions.extend(placed);
    }
    all
}
