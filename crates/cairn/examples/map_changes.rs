//! Follows the map change by change, as a viewer or another process would, and keeps a copy of the key frames' poses.
//!
//! `cargo run --release -p cairn --example map_changes`

use cairn::atlas::{Change, Mirror};
use cairn::{Slam, open};
use std::collections::BTreeMap;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut source = open("sim:demo?seed=4&sensor=rgbd&resolution=320x240&rate=10&detail=0.5&duration=8")?;
    let mut slam = Slam::for_source(&*source).build()?;

    // Every commit from now on. A `Mirror` is the small copy: poses of key frames, without features and landmarks.
    let mut changes = slam.changes()?;
    let mut mirror = Mirror::of(changes.start());
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    loop {
        let frame = source.next_packet()?;
        match &frame {
            Some(frame) => drop(slam.track(frame)?),
            // The last adjustment is made of changes too.
            None => drop(slam.finish()),
        }
        // What has been committed meanwhile; the iterator can be used again after it has ended.
        for published in &mut changes {
            for change in &published.changes {
                *counts.entry(kind(change)).or_default() += 1;
                if let Change::AddKeyFrame(k) = change {
                    let at = k.world_from_camera.translation;
                    println!(
                        "version {:3}  key frame {:2} at {:5.2} {:5.2} {:5.2} m",
                        published.version,
                        k.id.index(),
                        at.x,
                        at.y,
                        at.z
                    );
                }
            }
            mirror.take(&published);
        }
        if frame.is_none() {
            break;
        }
    }
    for (kind, count) in &counts {
        println!("{count:6}  {kind}");
    }

    // The copy agrees with the map to the last bit.
    let map = slam.map();
    let same = map.snapshot().key_frames().all(|k| {
        mirror.key_frame(k.id).is_some_and(|mirrored| mirrored.world_from_camera == k.world_from_camera)
    });
    let (copied, kept) = (mirror.key_frames().count(), map.snapshot().key_frame_count());
    println!("mirror    {copied} of {kept} key frames, equal: {same}");
    if same && copied == kept { Ok(()) } else { Err("the mirror differs from the map".into()) }
}

/// The name of a change, for the table.
fn kind(change: &Change) -> &'static str {
    match change {
        Change::AddKeyFrame(_) => "key frames added",
        Change::MoveKeyFrame(..) => "key frames moved",
        Change::RemoveKeyFrame(_) => "key frames removed",
        Change::AddLandmark(..) => "landmarks added",
        Change::MoveLandmark(..) => "landmarks moved",
        Change::RemoveLandmark(_) => "landmarks removed",
        Change::Fuse(..) => "landmarks fused",
        Change::Observe(..) | Change::Forget(..) => "observations added or removed",
        _ => "others",
    }
}
