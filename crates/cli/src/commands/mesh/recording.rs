//! The surface of a recording with depth and poses.

use super::super::rig::noted_rig_for;
use super::Arguments;
use crate::failure::Failure;
use crate::output::warn;
use cairn_dense::{DepthConfig, DepthPreparer, Mesh, MeshConfig, Mesher, TsdfConfig, TsdfVolume};
use cairn_eval::{TrajectoryHeader, load_trajectory};
use cairn_geometry::Trajectory;
use cairn_sensor::Source;
use cairn_sources::{OpenOptions, Validator, open};

/// What was made.
#[derive(Default, serde::Serialize)]
pub struct Report {
    pub frames: usize,
    pub without_pose: usize,
    pub refused: usize,
    pub vertices: usize,
    pub triangles: usize,
    pub isolated: usize,
    pub file: String,
}

/// What a source has left out or doubts is said so many times.
const SHOWN: usize = 5;

/// Greatest difference in time between an image and its pose.
const APART_NS: u64 = 20_000_000;

/// Fuses the depth images of a recording.
///
/// # Errors
/// When it cannot be read, has no depth or no poses.
pub fn fuse(arguments: &Arguments) -> Result<(Mesh, Report), Failure> {
    let dense =
        |e: cairn_dense::DenseError| Failure::new("mesh", e.to_string(), "change --voxel or --farthest");
    let rig = arguments.rig.as_deref().map(|path| noted_rig_for(path, &arguments.source)).transpose()?;
    let options = OpenOptions { rig, cancel: crate::interrupt::cancel(), ..OpenOptions::default() };
    let mut source = Validator::new(open(&arguments.source, options)?, warn);
    let Some(sensor) = source.rig().depth.clone() else {
        let why = "has no depth sensor";
        return Err(Failure::new(
            &arguments.source,
            why,
            "give a recording with depth (TUM RGB-D, 7-Scenes, sim:)",
        ));
    };
    let poses = poses(arguments, source.info().truth.iter().map(|(t, p)| (t.0, *p)).collect())?;
    let config = DepthConfig { farthest_m: arguments.farthest, ..DepthConfig::default() };
    let mut preparer = DepthPreparer::new(config, sensor.camera, sensor.metres_per_unit).map_err(dense)?;
    let colour = cairn_engine::has_colours(source.rig());
    let tsdf = TsdfConfig { voxel_m: arguments.voxel, colour, ..TsdfConfig::default() };
    let mut volume = TsdfVolume::new(tsdf).map_err(dense)?;
    let mut report = Report::default();
    let mut number = 0;
    while let Some(packet) = source.next_packet()? {
        number += 1;
        let Some(depth) = packet.depth.as_ref().filter(|_| (number - 1) % arguments.every.max(1) == 0) else {
            continue;
        };
        let Some(pose) = nearest(&poses, packet.stamp.0) else {
            report.without_pose += 1;
            continue;
        };
        let colours = packet.images.first().filter(|_| colour).and_then(|gray| preparer.colours(gray).ok());
        match preparer.prepare(depth) {
            Ok(frame) => {
                volume.integrate(frame, colours.as_ref(), &(pose * sensor.body_from_depth)).map_err(dense)?
            }
            Err(_) => {
                report.refused += 1;
                continue;
            }
        };
        report.frames += 1;
    }
    source.skipped().iter().take(SHOWN).for_each(|line| warn(line));
    if source.skipped().len() > SHOWN {
        warn(&format!("and {} more", source.skipped().len() - SHOWN));
    }
    if report.frames == 0 {
        let why = format!("no frame has both a pose and depth ({} had no pose)", report.without_pose);
        return Err(Failure::new(&arguments.source, why, "give poses with --poses"));
    }
    let mut mesh = Mesher::new(MeshConfig::default()).whole(&volume);
    report.isolated = arguments.drop_isolated.map_or(0, |m| mesh.drop_isolated(m));
    (report.vertices, report.triangles) = (mesh.positions.len(), mesh.triangles.len());
    Ok((mesh, report))
}

/// The poses to use: those of a file, else the recording's.
fn poses(arguments: &Arguments, own: Vec<(i64, cairn_geometry::Se3)>) -> Result<Trajectory, Failure> {
    match &arguments.poses {
        Some(path) => {
            let hint = "give a trajectory in TUM, KITTI or EuRoC form";
            let loaded = load_trajectory(path).map_err(|e| Failure::new(e.file, e.reason, hint))?;
            let Some(header) = loaded.header else { return Ok(loaded.trajectory) };
            if !header.metric {
                let why = "its lengths are units of a map, those of depth are metres";
                let hint = "give poses of a run with depth, stereo or an IMU";
                return Err(Failure::new(path.display().to_string(), why, hint));
            }
            Ok(TrajectoryHeader::default().poses_from(&header, &loaded.trajectory))
        }
        None if own.is_empty() => Err(Failure::new(
            &arguments.source,
            "comes without poses",
            "run `cairn run` on it, and give --poses",
        )),
        None => Trajectory::from_unsorted(own).map_err(|e| {
            Failure::new(&arguments.source, e.to_string(), "correct its poses, or give --poses")
        }),
    }
}

/// The pose nearest in time, if it is near enough.
fn nearest(poses: &Trajectory, stamp_ns: i64) -> Option<cairn_geometry::Se3> {
    let i = poses.nearest(stamp_ns)?;
    (poses.stamps_ns()[i].abs_diff(stamp_ns) <= APART_NS).then(|| poses.poses()[i])
}
