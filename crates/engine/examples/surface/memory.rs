//! What the memory of a long walk is: a line each five minutes of the walk.

use cairn_engine::{DenseMapper, Engine};

/// Seconds of a walk between two lines.
const EVERY_S: f64 = 300.0;

/// Prints the lines.
#[derive(Default)]
pub struct MemoryLines {
    printed: usize,
}

impl MemoryLines {
    /// Prints a line if it is time, `at_s` after the walk began.
    pub fn at(&mut self, at_s: f64, engine: &Engine, mapper: &DenseMapper) {
        if at_s < EVERY_S * (self.printed + 1) as f64 {
            return;
        }
        self.printed += 1;
        let ([volumes, depth], counts, snapshot) = (mapper.map().bytes(), mapper.counts(), engine.snapshot());
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
}

/// Resident memory of this process, megabytes; `None` where `/proc` is not Linux's.
fn resident_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok()? * 1024.0 / 1e6)
}
