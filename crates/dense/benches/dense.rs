//! Times, quality and memory of dense maps, one thread: `cargo bench -p cairn-dense --bench dense [-- SECTION...]`.
//!
//! On data/7scenes-kitchen, every 5th of frames 0-299 with the given poses, depth to 5 m, truncation four voxels.
//! Times are processor time (not wall time, since other programs may be running), the minimum of several repetitions.
//! `tools/compare_dense.py` measures Open3D on the same frames.

use cairn_dense::{
    AnchorId, Backend, DenseMap, DepthConfig, DepthFrame, DepthPreparer, MapId, MeshConfig, Mesher,
    OccupancyConfig, OccupancyGrid, PackedDepth, SubmapConfig, TrackConfig, TsdfConfig, TsdfVolume, raycast,
    track,
};
use cairn_geometry::{Se3, So3, Vec3, umeyama};
use cairn_sensor::{DepthImage, Image};
use std::path::Path;

#[path = "../tests/common/mod.rs"]
mod common;

const VOXELS_M: [f64; 3] = [0.05, 0.02, 0.01];

/// Processor time of this thread in milliseconds.
fn now_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6
}

/// The minimum time of several repetitions in milliseconds, and the last result.
fn least<T>(repetitions: usize, mut work: impl FnMut() -> T) -> (f64, T) {
    let mut best = f64::INFINITY;
    loop_last(repetitions, || {
        let start = now_ms();
        let out = std::hint::black_box(work());
        best = best.min(now_ms() - start);
        out
    })
    .map_or_else(|| unreachable!("at least one repetition"), |out| (best, out))
}

fn loop_last<T>(n: usize, mut work: impl FnMut() -> T) -> Option<T> {
    (0..n.max(1)).map(|_| work()).last()
}

struct Kitchen {
    raw: Vec<DepthImage>,
    frames: Vec<(DepthFrame, Se3)>,
    colours: Vec<Image<[u8; 3]>>,
    held_out: Vec<(DepthImage, Se3)>,
}

fn read(folder: &Path) -> Kitchen {
    let raw: Vec<_> = (0..300).step_by(5).map(|n| common::frame(folder, n)).collect();
    let mut preparer = preparer();
    let frames = raw.iter().map(|(d, p)| (preparer.prepare(d).expect("a frame").clone(), *p)).collect();
    let colours = (0..300).step_by(5).map(|n| common::colour(folder, n)).collect();
    let held_out = (12..300).step_by(25).map(|n| common::frame(folder, n)).collect();
    Kitchen { raw: raw.into_iter().map(|r| r.0).collect(), frames, colours, held_out }
}

fn preparer() -> DepthPreparer {
    DepthPreparer::new(DepthConfig::default(), common::camera(), 0.001).expect("the data set's camera")
}

fn volume(kitchen: &Kitchen, config: TsdfConfig, backend: Backend) -> TsdfVolume {
    let mut volume = TsdfVolume::new(config).expect("a voxel in range").with_backend(backend);
    for ((frame, pose), colour) in kitchen.frames.iter().zip(&kitchen.colours) {
        volume.integrate(frame, config.colour.then_some(colour), pose).expect("a pose in range");
    }
    volume
}

fn main() {
    let Some(folder) = common::kitchen() else { return };
    let wanted: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let section = |name: &str| wanted.is_empty() || wanted.iter().any(|w| w == name);
    let kitchen = read(&folder);
    println!("7scenes-kitchen, {} frames, best instructions: {:?}", kitchen.frames.len(), Backend::best());
    // First, before memory freed by other sections is reused.
    if section("memory") {
        memory(&kitchen);
    }
    if section("tsdf") {
        tsdf(&kitchen);
    }
    if section("quality") {
        quality(&kitchen);
    }
    if section("mesh") {
        mesh(&kitchen);
    }
    if section("occupancy") {
        occupancy(&kitchen);
    }
    if section("codec") {
        codec(&kitchen);
    }
    if section("submaps") {
        submaps(&kitchen);
    }
    if section("tracking") {
        tracking(&folder);
    }
    if section("raycast") {
        cast(&kitchen);
    }
}

fn tsdf(kitchen: &Kitchen) {
    let n = kitchen.frames.len() as f64;
    let mut prepare_ms = [0.0; 3];
    for (backend, out) in Backend::ALL.into_iter().zip(&mut prepare_ms).filter(|(b, _)| b.available()) {
        let mut preparer = preparer().with_backend(backend);
        let (ms, ()) = least(9, || {
            for image in &kitchen.raw {
                std::hint::black_box(preparer.prepare(image).expect("a frame"));
            }
        });
        *out = ms / n;
        println!("prepare depth, {backend:?}: {:.3} ms a frame", ms / n);
    }
    for colour in [false, true] {
        for (backend, prepare) in Backend::ALL.into_iter().zip(prepare_ms).filter(|(b, _)| b.available()) {
            for voxel_m in VOXELS_M {
                let config = TsdfConfig { voxel_m, colour, ..TsdfConfig::default() };
                let (ms, volume) = least(5, || volume(kitchen, config, backend));
                println!(
                    "TSDF {:>2.0} cm{}, {backend:?}: {:.3} ms a frame with preparing ({:.3} without), {} blocks, {:.1} MB",
                    voxel_m * 100.0,
                    if colour { " with colour" } else { "" },
                    ms / n + prepare,
                    ms / n,
                    volume.blocks(),
                    volume.bytes() as f64 / 1e6
                );
            }
        }
    }
}

/// Depth of the surface against measured depth in frames that were not fused.
fn quality(kitchen: &Kitchen) {
    for voxel_m in VOXELS_M {
        let volume = volume(kitchen, TsdfConfig { voxel_m, ..TsdfConfig::default() }, Backend::best());
        for drawn in [false, true] {
            let (mut errors, mut measured) = (Vec::new(), 0);
            for (image, pose) in &kitchen.held_out {
                let cast = if drawn {
                    Mesher::new(MeshConfig::default()).view(&volume, &common::camera(), pose, 6.0)
                } else {
                    raycast(&volume, &common::camera(), pose, 6.0)
                };
                let cast = cast.expect("a pose");
                for (&raw, &z) in image.data().iter().zip(cast.depth_m.data()) {
                    let truth = f32::from(raw) * 1e-3;
                    if raw == 0 || truth > 5.0 {
                        continue;
                    }
                    measured += 1;
                    if z > 0.0 {
                        errors.push((z - truth).abs());
                    }
                }
            }
            errors.sort_by(f32::total_cmp);
            let within = errors.partition_point(|&e| e < 0.05) as f64;
            println!(
                "held-out depth, {:>2.0} cm, {}: median {:.2} mm, {:.1} % within 5 cm, of {:.1} % of the measured pixels",
                voxel_m * 100.0,
                if drawn { "drawn" } else { "ray cast" },
                errors[errors.len() / 2] * 1e3,
                100.0 * within / errors.len() as f64,
                100.0 * errors.len() as f64 / f64::from(measured)
            );
        }
    }
}

fn mesh(kitchen: &Kitchen) {
    for voxel_m in VOXELS_M {
        let volume = volume(kitchen, TsdfConfig { voxel_m, ..TsdfConfig::default() }, Backend::best());
        let mut mesher = Mesher::new(MeshConfig::default());
        let (ms, mesh) = least(5, || mesher.whole(&volume));
        println!(
            "mesh {:>2.0} cm: whole {ms:.1} ms, {} vertices, {} triangles",
            voxel_m * 100.0,
            mesh.positions.len(),
            mesh.triangles.len()
        );
    }
    for voxel_m in VOXELS_M {
        let mut volume =
            TsdfVolume::new(TsdfConfig { voxel_m, ..TsdfConfig::default() }).expect("a voxel in range");
        let mut mesher = Mesher::new(MeshConfig::default());
        let mut times = Vec::new();
        for (frame, pose) in &kitchen.frames {
            let revision = volume.revision();
            volume.integrate(frame, None, pose).expect("a pose in range");
            let start = now_ms();
            for key in Mesher::affected(volume.changed_since(revision)) {
                std::hint::black_box(mesher.block(&volume, key));
            }
            times.push(now_ms() - start);
        }
        times.sort_by(f64::total_cmp);
        println!(
            "mesh {:>2.0} cm: changed blocks {:.2} ms a frame (median)",
            voxel_m * 100.0,
            times[times.len() / 2]
        );
    }
}

fn occupancy(kitchen: &Kitchen) {
    let n = kitchen.frames.len() as f64;
    for backend in Backend::ALL.into_iter().filter(|b| b.available()) {
        for voxel_m in [0.05, 0.02] {
            let (ms, grid) = least(5, || {
                let config = OccupancyConfig { voxel_m, ..OccupancyConfig::default() };
                let mut grid = OccupancyGrid::new(config).expect("a voxel in range").with_backend(backend);
                for (frame, pose) in &kitchen.frames {
                    grid.integrate(frame, pose).expect("a pose in range");
                }
                grid
            });
            let mb = grid.bytes() as f64 / 1e6;
            println!(
                "occupancy {:>2.0} cm, {backend:?}: {:.3} ms a frame, {mb:.1} MB",
                voxel_m * 100.0,
                ms / n
            );
        }
    }
}

/// Resident memory of the process in megabytes, where the system reports it.
fn resident_mb() -> Option<f64> {
    let told = std::fs::read_to_string("/proc/self/statm").ok()?;
    Some(told.split(' ').nth(1)?.parse::<f64>().ok()? * rustix::param::page_size() as f64 / 1e6)
}

/// How much memory the process gains for field and occupancy of the whole recording at 2 cm, preparer and scratch
/// included.
fn memory(kitchen: &Kitchen) {
    let Some(before) = resident_mb() else { return println!("skipped: resident memory is not told here") };
    let mut preparer = preparer();
    let mut volume = TsdfVolume::new(TsdfConfig::default()).expect("in range");
    let config = OccupancyConfig { voxel_m: 0.02, ..OccupancyConfig::default() };
    let mut grid = OccupancyGrid::new(config).expect("in range");
    for (image, (_, pose)) in kitchen.raw.iter().zip(&kitchen.frames) {
        let frame = preparer.prepare(image).expect("a frame");
        volume.integrate(frame, None, pose).expect("a pose in range");
        grid.integrate(frame, pose).expect("a pose in range");
    }
    let grown = resident_mb().unwrap_or(f64::NAN) - before;
    let [field, occupancy] = [volume.bytes(), grid.bytes()].map(|b| b as f64 / 1e6);
    println!("memory 2 cm: the process grows by {grown:.1} MB (field {field:.1}, occupancy {occupancy:.1})");
}

/// A loop closure over 1,000 key frames: correcting the poses, and re-fusing the frames that moved.
/// Lossless compression of the images of key frames.
fn codec(kitchen: &Kitchen) {
    let images = kitchen.raw.len() as f64;
    let (pack_ms, packed) = least(9, || kitchen.raw.iter().map(PackedDepth::pack).collect::<Vec<_>>());
    let (unpack_ms, ()) = least(9, || {
        for one in &packed {
            std::hint::black_box(one.unpack().expect("whole"));
        }
    });
    let mut preparer = preparer();
    let (prepare_ms, ()) = least(9, || {
        for image in &kitchen.raw {
            std::hint::black_box(preparer.prepare(image).expect("a frame"));
        }
    });
    let same = packed.iter().zip(&kitchen.raw).all(|(p, raw)| p.unpack().expect("whole") == *raw);
    let bytes = packed.iter().map(PackedDepth::bytes).sum::<usize>() as f64;
    println!(
        "codec: {:.1} kB an image, packed in {:.3} ms, unpacked in {:.3} ms ({}); prepared in {:.3} ms",
        bytes / images / 1e3,
        pack_ms / images,
        unpack_ms / images,
        if same { "bit by bit the same" } else { "NOT THE SAME" },
        prepare_ms / images
    );
}

fn submaps(kitchen: &Kitchen) {
    let mut map =
        DenseMap::new(SubmapConfig::default(), common::camera(), 0.001).expect("the data set's camera");
    let (mut insert, mut poses) = (Vec::new(), Vec::new());
    let raw = kitchen.raw.iter().zip(&kitchen.frames);
    for (i, (image, (_, pose))) in raw.cycle().take(1000).enumerate() {
        // Each repetition of the recording is placed in a kitchen of its own.
        let aside = Vec3::new((i / kitchen.raw.len()) as f64 * 20.0, 0.0, 0.0);
        let pose = Se3::new(pose.rotation, pose.translation + aside);
        let start = now_ms();
        map.insert(AnchorId(i as u64), MapId(0), pose, Se3::identity(), image).expect("a key frame");
        insert.push(now_ms() - start);
        poses.push((AnchorId(i as u64), pose));
    }
    insert.sort_by(f64::total_cmp);
    let [volumes, depth] = map.bytes().map(|b| b as f64 / 1e6);
    println!(
        "submaps: {} of 1000 key frames, {volumes:.0} MB and {depth:.0} MB of depth ({:.0} kB a frame), {:.2} ms a key frame (median)",
        map.submaps().count(),
        depth,
        insert[500]
    );
    // Each key frame is rotated and moved by its share of the loop's error.
    let bent: Vec<_> = poses
        .iter()
        .map(|(id, p)| {
            let share = id.0 as f64 / 1000.0;
            let turn =
                Se3::new(So3::exp(&Vec3::new(0.0, 0.2 * share, 0.0)), Vec3::new(share, 0.0, -0.5 * share));
            (*id, turn * *p)
        })
        .collect();
    let (ms, ()) = least(5, || map.align(&bent).expect("finite poses"));
    println!("submaps: poses of 1000 key frames swapped in {ms:.2} ms");
    let start = now_ms();
    let mut images = 0;
    loop {
        let done = map.step(&Vec3::zeros(), 16);
        images += done.images;
        if done.waiting == 0 {
            break;
        }
    }
    println!("submaps: {images} images fused anew, {:.0} ms in slices of 16", now_ms() - start);
    let packed: Vec<_> = kitchen.raw.iter().map(PackedDepth::pack).collect();
    for unpacking in [true, false] {
        let (mut preparer, mut grid) =
            (preparer(), OccupancyGrid::new(OccupancyConfig::default()).expect("in range"));
        let start = now_ms();
        for ((_, pose), (image, packed)) in bent.iter().zip(kitchen.raw.iter().zip(&packed).cycle()) {
            let unpacked = unpacking.then(|| packed.unpack().expect("whole"));
            let frame = preparer.prepare(unpacked.as_ref().unwrap_or(image)).expect("a frame");
            grid.integrate(frame, pose).expect("a pose in range");
        }
        println!(
            "submaps: occupancy at 5 cm of 1000 key frames afresh, {} unpacking: {:.0} ms",
            if unpacking { "with" } else { "without" },
            now_ms() - start
        );
    }
}

/// Tracking by depth alone against the field it builds: starts at the first true pose, with every frame and every
/// fifth.
fn tracking(folder: &Path) {
    for every in [1, 5] {
        let mut preparer = preparer();
        let mut volume = TsdfVolume::new(TsdfConfig::default()).expect("in range");
        let (mut pose, mut motion) = (Se3::identity(), Se3::identity());
        let (mut found, mut truth, mut ms, mut lost) = (Vec::new(), Vec::new(), Vec::new(), 0);
        for n in (0..300).step_by(every) {
            let (image, true_pose) = common::frame(folder, n);
            let start = now_ms();
            let frame = preparer.prepare(&image).expect("a frame");
            if n == 0 {
                pose = true_pose;
            } else {
                let tracked =
                    track(&volume, frame, &(pose * motion), &TrackConfig::default()).expect("finite");
                lost += usize::from(!tracked.converged);
                motion = pose.inverse() * tracked.volume_from_camera;
                pose = tracked.volume_from_camera;
            }
            volume.integrate(frame, None, &pose).expect("a pose in range");
            ms.push(now_ms() - start);
            found.push(pose.translation);
            truth.push(true_pose.translation);
        }
        let truth_from_found = umeyama(&truth, &found, false).expect("a motion");
        let square =
            found.iter().zip(&truth).map(|(f, t)| (truth_from_found * *f - t).norm_squared()).sum::<f64>();
        ms.sort_by(f64::total_cmp);
        println!(
            "tracking, every {every}: ATE {:.2} cm, {:.2} ms a frame with integration at 2 cm (median), {lost} of {} not converged",
            100.0 * (square / found.len() as f64).sqrt(),
            ms[ms.len() / 2],
            found.len()
        );
    }
}

fn cast(kitchen: &Kitchen) {
    for voxel_m in VOXELS_M {
        let volume = volume(kitchen, TsdfConfig { voxel_m, ..TsdfConfig::default() }, Backend::best());
        let (ms, _) = least(5, || {
            for (_, pose) in kitchen.held_out.iter().take(4) {
                std::hint::black_box(raycast(&volume, &common::camera(), pose, 6.0).expect("a pose"));
            }
        });
        println!("ray cast 640x480, {:>2.0} cm: {:.1} ms, depth and normals", voxel_m * 100.0, ms / 4.0);
        let mut mesher = Mesher::new(MeshConfig::default());
        let (ms, _) = least(5, || {
            for (_, pose) in kitchen.held_out.iter().take(4) {
                std::hint::black_box(mesher.view(&volume, &common::camera(), pose, 6.0).expect("a pose"));
            }
        });
        let cm = voxel_m * 100.0;
        println!(
            "drawn 640x480, {cm:>2.0} cm: {:.1} ms, depth and normals, triangles extracted each time",
            ms / 4.0
        );
    }
}
