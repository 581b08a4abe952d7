//! Tracks a recording in EuRoC layout with all its sensors, and prints the error against its ground truth.
//!
//! `cargo run --release -p cairn --example track_euroc -- [FOLDER] [FRAMES]`; without a folder, `euroc-mh01` in
//! `$CAIRN_DATA`, else in `../shared/data` beside the checkout.

use cairn::sources::{OpenOptions, open};
use cairn::{Slam, State};
use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().map_or_else(recording, PathBuf::from);
    let frames = arguments.next().map(|text| text.parse()).transpose()?;
    if !folder.is_dir() {
        println!("skipped: there is no recording in {}", folder.display());
        return Ok(());
    }

    // The kind of the recording and its calibration files are found by looking into the folder.
    let options = OpenOptions { frames, ..OpenOptions::default() };
    let mut source = open(&folder.display().to_string(), options)?;
    println!("source    {}", source.info().name);

    // Two cameras and an IMU in this recording: stereo, with gravity known once the IMU is initialised.
    let mut slam = Slam::for_source(&*source).build()?;
    let (mut seen, mut tracked) = (0, 0);
    while let Some(frame) = source.next_packet()? {
        let output = slam.track(&frame)?;
        seen += 1;
        match output.state {
            State::Tracking | State::Coasting { .. } | State::RotationOnly { .. } => tracked += 1,
            // Not an error: the numbers say how far it is from a pose.
            State::Starting { have, need } => println!("{} starting: {have} of {need} points", output.stamp),
            State::Lost { inliers, need } => println!("{} lost: {inliers} of {need} inliers", output.stamp),
        }
    }
    // Mapping ends its work, and the whole map is adjusted once more.
    slam.finish();

    let map = slam.map();
    let (key_frames, landmarks) = (map.snapshot().key_frame_count(), map.snapshot().landmark_count());
    println!("frames    {seen}, {tracked} tracked");
    println!("map       {key_frames} key frames, {landmarks} landmarks");
    println!("length    {:.3} m, metric: {}", slam.trajectory()?.length_m(), slam.is_metric());
    if source.info().truth.is_empty() {
        println!("truth     none in this recording");
    } else {
        let e = slam.accuracy(&source.info().truth)?;
        println!("ATE       {:.4} m RMSE over {:.2} m, {} pairs", e.ate_m.rmse, e.path_m, e.pairs);
    }
    Ok(())
}

/// Where the recordings lie.
fn recording() -> PathBuf {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from).join("euroc-mh01")
}
