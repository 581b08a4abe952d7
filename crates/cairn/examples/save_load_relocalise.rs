//! Maps a place, saves the map, and finds the way into it again: another walk, begun elsewhere, is localised in the
//! loaded map without changing it.
//!
//! `cargo run --release -p cairn --example save_load_relocalise`

use cairn::{Slam, open};
use std::error::Error;

/// The first walk: 10 s through a simulated world with a depth camera.
const MAPPED: &str = "sim:demo?seed=5&sensor=rgbd&resolution=320x240&rate=10&detail=0.5&duration=10";
/// Another one there: it begins 4 s along the way, faster, and with the camera held 10 cm higher.
const AGAIN: &str = "sim:demo?seed=5&sensor=rgbd&resolution=320x240&rate=10&detail=0.5&start=4&duration=3&speed=1.2&height=1.4";

fn main() -> Result<(), Box<dyn Error>> {
    // Map and save. The file is replaced only once the new one is complete on disk.
    let mut source = open(MAPPED)?;
    let mut slam = Slam::for_source(&*source).build()?;
    while let Some(frame) = source.next_packet()? {
        slam.track(&frame)?;
    }
    slam.finish();
    let file = std::env::temp_dir().join(format!("cairn-example-{}.map", std::process::id()));
    let bytes = slam.save(&file)?;
    let version = slam.map().snapshot().version();
    println!("saved     {} key frames, {bytes} bytes", slam.map().snapshot().key_frame_count());
    drop(slam);

    // Load. A map of another camera that this one cannot use is refused here; differences are notes.
    let map = Slam::load_map(&file)?;
    std::fs::remove_file(&file)?;
    let mut source = open(AGAIN)?;
    let mut slam = Slam::for_source(&*source).localize_in(map).build()?;
    slam.notes().iter().for_each(|note| println!("note      {note}"));
    let (before, mut first, mut frames) = (slam.map().snapshot().version(), None, 0);
    while let Some(frame) = source.next_packet()? {
        let output = slam.track(&frame)?;
        frames += 1;
        if output.pose.is_some() && first.is_none() {
            first = Some(frames);
            println!("found     in frame {frames}, {} matches agree", output.evidence.inliers);
        }
    }
    first.ok_or("the place was not recognised")?;

    // The poses are in the frame of the first walk's map; the truth of both walks is in that of the world.
    let e = slam.accuracy(&source.info().truth)?;
    println!("localised {} of {frames} frames, ATE {:.3} m RMSE", e.pairs, e.ate_m.rmse);
    let unchanged = slam.map().snapshot().version() == before;
    println!("unchanged {unchanged} (saved at version {version})");
    if unchanged { Ok(()) } else { Err("localising has changed the map".into()) }
}
