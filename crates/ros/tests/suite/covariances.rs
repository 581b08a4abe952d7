//! What the node states of its motions, on recordings with truth: the errors must fit it.
#![cfg(feature = "dds")]

use cairn::geometry::{Manifold, Se3, Trajectory};
use cairn::sources::{OpenOptions, open};
use cairn::{SensorMode, Slam};
use cairn_ros::frames::{FrameTree, Tracked};
use cairn_ros::results::tracked;
use nalgebra::{Matrix6, Vector3};
use std::path::PathBuf;

/// Errors over what is stated, root mean square along an axis: of translation and rotation.
#[derive(Default)]
struct Ratios([f64; 2], usize);

impl Ratios {
    fn add(&mut self, truth: &Se3, found: &Se3, covariance: &Matrix6<f64>) {
        let off = truth.local(found);
        for (sum, at) in self.0.iter_mut().zip([0, 3]) {
            let (off, block): (Vector3<f64>, _) =
                (off.fixed_rows::<3>(at).into(), covariance.fixed_view::<3, 3>(at, at));
            *sum += off.dot(&block.cholesky().expect("a covariance").solve(&off)) / 3.0;
        }
        self.1 += 1;
    }

    fn rms(&self) -> [f64; 2] {
        self.0.map(|sum| (sum / self.1 as f64).sqrt())
    }
}

/// Ratios of the motions between images, and of odometries that begin every fifth image and go on for a second.
fn ratios(address: &str, sensor: SensorMode, imu: bool) -> [[f64; 2]; 2] {
    let mut source = open(address, OpenOptions::default()).unwrap();
    let body_from_camera = source.rig().cameras[0].body_from_camera;
    let builder = Slam::for_source(&*source).sensor(sensor);
    let mut slam = if imu { builder } else { builder.without_imu() }.build().unwrap();
    let truth = source.info().truth.iter().map(|(stamp, pose)| (stamp.0, *pose)).collect();
    let truth = Trajectory::from_unsorted(truth).unwrap();
    let mut seen: Vec<(Tracked, Se3)> = Vec::new();
    while let Some(packet) = source.next_packet().unwrap() {
        let output = slam.track(&packet).unwrap();
        let there = truth.at(packet.stamp.0).map(|t| t * body_from_camera);
        seen.extend(tracked(&output, false).filter(|t| t.metric).zip(there));
    }
    assert!(seen.len() > 40, "{address}: {} poses", seen.len());
    let (mut motions, mut seconds) = (Ratios::default(), Ratios::default());
    let mut all = FrameTree::new(Se3::identity(), None);
    let mut before: Option<Se3> = None;
    for (tracked, there) in &seen {
        let now = all.step(tracked);
        if let (Some(motion), Some(before)) = (now.motion, before) {
            motions.add(&(before.inverse() * *there), &motion, &now.motion_covariance);
        }
        before = Some(*there);
    }
    for begin in (0..seen.len()).step_by(5) {
        let mut tree = FrameTree::new(Se3::identity(), None);
        let began = &seen[begin];
        for (tracked, there) in &seen[begin..] {
            let now = tree.step(tracked);
            if tracked.segment != began.0.segment {
                break;
            }
            if tracked.stamp - began.0.stamp > 0.99 {
                // About the axes of the odometry frame, as the message has it: about those of the camera.
                let turn = Se3::new(now.odom_from_base.rotation.inverse(), Vector3::zeros()).adjoint();
                let covariance = turn * now.odom_covariance * turn.transpose();
                seconds.add(&(began.1.inverse() * *there), &now.odom_from_base, &covariance);
                break;
            }
        }
    }
    assert!(seconds.1 > 5, "{address}");
    let found = [motions.rms(), seconds.rms()];
    println!(
        "{address} {sensor:?}, IMU {imu}: errors over stated deviations, translation and rotation: motions {:.2?} of {}, over 1 s {:.2?} of {}",
        found[0], motions.1, found[1], seconds.1
    );
    found
}

/// None may be stated much too small, nor so large that it says nothing.
fn check(address: &str, sensor: SensorMode, imu: bool, [least, most]: [f64; 2]) {
    for ratio in ratios(address, sensor, imu).into_iter().flatten() {
        assert!((least..most).contains(&ratio), "{address}: {ratio}");
    }
}

fn recording(name: &str) -> Option<String> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let root = std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    let folder = root.join(name);
    if !folder.is_dir() {
        println!("skipped: there is no recording in {}", folder.display());
        return None;
    }
    Some(folder.display().to_string())
}

#[test]
fn errors_on_recordings_fit_what_is_stated() {
    if let Some(euroc) = recording("euroc-mh01") {
        check(&euroc, SensorMode::Stereo, false, [0.4, 1.8]);
        check(&euroc, SensorMode::Mono, true, [0.4, 1.8]);
    }
    if let Some(kitti) = recording("kitti-a") {
        check(&kitti, SensorMode::Stereo, false, [0.4, 1.8]);
    }
    // A lens without error: its motions are stated three to four times too large.
    check("sim:demo?sensor=rgbd&resolution=320x240&duration=8&rate=20", SensorMode::Rgbd, false, [0.2, 1.8]);
}
