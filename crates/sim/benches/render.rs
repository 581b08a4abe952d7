//! Time to render simulated images: `cargo bench -p cairn-sim --bench render [sim:WORLD?...]`. Prints milliseconds
//! a packet and to build the world, each the fastest of three passes, and a checksum of all pixels, by which two builds can be told to draw the same.

use cairn_sensor::Source;
use cairn_sim::SimSource;
use std::time::Instant;

/// Packets of a pass.
const PACKETS: usize = 60;
/// Walks with one, two and depth cameras, in narrow and wide worlds.
const WALKS: [&str; 4] = [
    "sim:corridor?seed=3&sensor=stereo",
    "sim:office?seed=3&sensor=mono&blur=8",
    "sim:street?seed=3&sensor=mono",
    "sim:apartment?seed=3&sensor=rgbd&resolution=640x480",
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let only = std::env::args().skip(1).find(|a| a.starts_with("sim:"));
    let walks = only.as_deref().map_or(WALKS.to_vec(), |only| vec![only]);
    for walk in walks {
        let (mut best, mut built, mut sum) = (f64::MAX, f64::MAX, 0u64);
        for _ in 0..3 {
            let began = Instant::now();
            let mut source = SimSource::open(walk)?;
            built = built.min(began.elapsed().as_secs_f64());
            source.next_packet()?;
            sum = 0xcbf2_9ce4_8422_2325;
            let began = Instant::now();
            for _ in 0..PACKETS {
                let Some(packet) = source.next_packet()? else { break };
                for image in &packet.images {
                    sum = image
                        .data()
                        .iter()
                        .fold(sum, |s, b| (s ^ u64::from(*b)).wrapping_mul(0x100_0000_01b3));
                }
            }
            best = best.min(began.elapsed().as_secs_f64());
        }
        let frame_ms = 1e3 * best / PACKETS as f64;
        println!("{walk}: {frame_ms:.2} ms a packet, world {:.0} ms, checksum {sum:016x}", 1e3 * built);
    }
    Ok(())
}
