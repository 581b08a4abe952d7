//! Reads frames of a camera and prints their times, and the brightness of eight columns from left to right.
//!
//! `cargo run --release -p cairn-sources --example camera_frames -- v4l2:/dev/video0 [FRAMES]`

use cairn_sensor::Stamp;
use cairn_sources::{OpenOptions, open};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let address = arguments.next().ok_or("usage: camera_frames ADDRESS [FRAMES]")?;
    let frames = arguments.next().map_or(Ok(30), |n| n.parse())?;
    let mut source = open(&address, OpenOptions { frames: Some(frames), ..OpenOptions::default() })?;
    println!("{} at {:.2} Hz", source.info().name, source.info().rate_hz);
    let mut first: Option<Stamp> = None;
    let mut taken = 0;
    while let Some(packet) = source.next_packet()? {
        let first = *first.get_or_insert(packet.stamp);
        let Some(image) = packet.images.first() else { continue };
        let (w, h) = (image.width(), image.height());
        // The middle of each column, in the lower half: test patterns have writing above.
        let column = |k: usize| {
            let x = (2 * k + 1) * w / 16;
            let rows = (h / 2..h).map(|y| u32::from(image.at(x, y)));
            rows.sum::<u32>() / (h - h / 2) as u32
        };
        let columns: Vec<String> = (0..8).map(|k| column(k).to_string()).collect();
        println!("frame {taken} {w}x{h} {:.1} ms: {}", 1e3 * (packet.stamp - first), columns.join(" "));
        taken += 1;
    }
    for line in source.skipped().iter() {
        println!("skipped {line}");
    }
    println!("{taken} frames");
    Ok(())
}
