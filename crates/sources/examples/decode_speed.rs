//! Plays recordings and prints the cost of reading and decoding a packet.
//!
//! `cargo run --release -p cairn-sources --example decode_speed -- FOLDER...`

use cairn_sources::{OpenOptions, open};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for folder in std::env::args().skip(1) {
        let start = Instant::now();
        let mut source = open(&folder, OpenOptions::default())?;
        let opened_ms = start.elapsed().as_secs_f64() * 1e3;
        let (mut ms, mut samples, mut with_depth) = (Vec::new(), 0, 0);
        while let Some(packet) = source.next_packet()? {
            ms.push(packet.decode_ms);
            samples += packet.imu.len();
            with_depth += usize::from(packet.depth.is_some());
        }
        let wall_s = start.elapsed().as_secs_f64();
        ms.sort_by(f64::total_cmp);
        let at = |q: f64| ms.get(((ms.len() as f64 - 1.0) * q) as usize).copied().unwrap_or(f64::NAN);
        let info = source.info();
        println!("{} at {:.2} Hz, {} ground-truth poses", info.name, info.rate_hz, info.truth.len());
        println!(
            "  {} packets ({} with depth, {} IMU samples, {} skipped), {} camera(s)",
            ms.len(),
            with_depth,
            samples,
            source.skipped().len(),
            source.rig().cameras.len()
        );
        println!(
            "  opened in {opened_ms:.1} ms, decode ms per packet: min {:.2} p50 {:.2} p99 {:.2}, all in {wall_s:.2} s",
            at(0.0),
            at(0.5),
            at(0.99)
        );
        for line in source.skipped().iter().take(5) {
            println!("  skipped {line}");
        }
    }
    Ok(())
}
