//! `busy`: how much bundle adjustment of a whole map in parallel slows down tracking.
//!
//! One walk of two laps, rendered in advance. First the map of the whole walk is made. Then the threaded runner
//! processes a part of it again in that map in real time, in pairs of runs: with a thread that adjusts the whole map
//! again and again, as loop closing does after a loop, and without. Besides the wall time of a step, the CPU time of
//! the tracking thread is measured, which other load on the machine affects less.

use crate::MeasureError;
use crate::Sensors;
use crate::processor::thread_cpu_ms;
use crate::source::{Conditions, open_under};
use cairn_atlas::store::MapFile;
use cairn_engine::{Config, Engine, Runner};
use cairn_eval::Percentiles;
use cairn_mapping::Closer;
use cairn_sensor::{FramePacket, Rig};
use cairn_sources::{background, std_host};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A pair of runs.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Seconds of each full adjustment, in the run with adjustments.
    pub adjusted_s: Vec<f64>,
    /// The run with adjustments.
    pub with: Steps,
    /// The run without adjustments.
    pub without: Steps,
}

/// Times of the steps with a pose, milliseconds.
#[derive(Clone, Debug, Default)]
pub struct Steps {
    /// Wall time from image to pose.
    pub ms: Vec<f64>,
    /// CPU time of the tracking thread, where the system reports it.
    pub processor_ms: Vec<f64>,
}

impl Steps {
    fn extend(&mut self, other: &Self) {
        self.ms.extend(&other.ms);
        self.processor_ms.extend(&other.processor_ms);
    }
}

/// The pairs, and the size of the map.
#[derive(Clone, Debug)]
pub struct Busy {
    /// Key frames in the map.
    pub key_frames: usize,
    /// Landmarks in the map.
    pub landmarks: usize,
    /// The pairs.
    pub pairs: Vec<Pair>,
}

/// Runs `pairs` pairs of runs of `frames` frames, in two laps of the hall of a seed.
///
/// # Errors
/// When the world is unsuitable or a stage of the engine stops.
pub fn run(seed: u64, sensor: Sensors, pairs: usize, frames: usize) -> Result<Busy, MeasureError> {
    let walk = format!(
        "sim:hall?route=loop&laps=2&seed={seed}&sensor={}&rate=12&speed=1.1&detail=0.6",
        sensor.name()
    );
    let mut source = open_under(&walk, &Conditions::default())?;
    let mut packets = Vec::new();
    while let Some(packet) = source.next_packet()? {
        packets.push(packet);
    }
    let (rate_hz, rig) = (source.info().rate_hz, source.rig());
    let map = build_map(&packets, rig, sensor, rate_hz)?;
    let mut busy = Busy {
        key_frames: map.snapshot.key_frame_count(),
        landmarks: map.snapshot.landmark_count(),
        pairs: Vec::new(),
    };
    eprintln!("{} frames, {} key frames, {} landmarks", packets.len(), busy.key_frames, busy.landmarks);
    let part = &packets[..frames.min(packets.len())];
    let once = |adjust: bool| run_once(part, rig, sensor, rate_hz, &map, adjust);
    for i in 0..pairs {
        // The order alternates, because the load of the machine may change.
        let first = once(i % 2 == 0)?;
        let second = once(i % 2 != 0)?;
        let ((with, adjusted_s), (without, _)) = if i % 2 == 0 { (first, second) } else { (second, first) };
        eprintln!("{}", line(&with, &without));
        busy.pairs.push(Pair { adjusted_s, with, without });
    }
    Ok(busy)
}

/// The map of the whole walk.
fn build_map(
    packets: &[FramePacket],
    rig: &Rig,
    sensor: Sensors,
    rate_hz: f64,
) -> Result<MapFile, MeasureError> {
    let config = Config::default();
    let mut engine = Engine::new(rig, sensor.mode(), rate_hz, Runner::Lockstep, &config, &std_host())?;
    for packet in packets {
        engine.on_packet(packet)?;
    }
    engine.finish();
    Ok(engine.to_save("bench", BTreeMap::new()))
}

/// Times of the steps, and seconds of each full adjustment in parallel.
fn run_once(
    packets: &[FramePacket],
    rig: &Rig,
    sensor: Sensors,
    rate_hz: f64,
    file: &MapFile,
    adjust: bool,
) -> Result<(Steps, Vec<f64>), MeasureError> {
    let config = Config::default();
    let opened = Engine::in_map(rig, sensor.mode(), rate_hz, Runner::Threaded, &config, &std_host(), file);
    let (mut engine, _) = opened?;
    let closer = Closer::new(*engine.front_end().model(), config.closer, config.mapper.window);
    let map = file.snapshot.maps().next().map(|(id, _)| id).ok_or("the file has no map")?;
    let over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let adjuster = scope.spawn(|| {
            background();
            let mut took = Vec::new();
            while adjust && !over.load(Ordering::Relaxed) {
                let start = Instant::now();
                let changes = closer.adjust_whole(&file.snapshot, map, || over.load(Ordering::Relaxed));
                took.extend((!changes.is_empty()).then(|| start.elapsed().as_secs_f64()));
            }
            took
        });
        let steps = run_in_real_time(&mut engine, packets);
        over.store(true, Ordering::Relaxed);
        let took = adjuster.join().map_err(|_| "the adjusting thread panicked")?;
        Ok((steps?, took))
    })
}

fn run_in_real_time(engine: &mut Engine, packets: &[FramePacket]) -> Result<Steps, MeasureError> {
    let start = Instant::now();
    let mut steps = Steps::default();
    for packet in packets {
        let due = start + Duration::from_secs_f64((packet.stamp - packets[0].stamp).max(0.0));
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let before = thread_cpu_ms();
        let out = engine.on_packet(packet)?;
        let after = thread_cpu_ms();
        if let Some(cause) = out.stage_failed() {
            return Err(MeasureError::from(cause.to_owned()));
        }
        if out.pose.is_some() {
            steps.ms.push(out.timings.step_ms());
            steps.processor_ms.extend(before.zip(after).map(|(before, after)| after - before));
        }
    }
    Ok(steps)
}

fn line(with: &Steps, without: &Steps) -> String {
    let pair = |a: &[f64], b: &[f64]| {
        let [a, b] = [a, b].map(|ms| Percentiles::of(ms).unwrap_or_default());
        let three = |p: &Percentiles| format!("{:.1} / {:.1} / {:.1}", p.p50, p.p99, p.max);
        format!("{} | {} | {:.2} | {:.2}", three(&a), three(&b), a.p50 / b.p50, a.p99 / b.p99)
    };
    format!(
        "{} | {} | {}",
        with.ms.len(),
        pair(&with.ms, &without.ms),
        pair(&with.processor_ms, &without.processor_ms)
    )
}

/// The pairs as a table in Markdown, with the total in the last row.
pub fn table(busy: &Busy) -> String {
    let mut t = format!("{} key frames, {} landmarks\n\n", busy.key_frames, busy.landmarks);
    t += "| pair | full adjustments, s each | frames | step ms with: p50 / p99 / max | without | ratio of p50 | of p99 | CPU ms with | without | ratio of p50 | of p99 |\n";
    t += "|---|---|---|---|---|---|---|---|---|---|---|\n";
    let mean = |s: &[f64]| s.iter().sum::<f64>() / s.len() as f64;
    let (mut took, mut with, mut without) = (Vec::new(), Steps::default(), Steps::default());
    // Writing to a string cannot fail.
    for (i, p) in busy.pairs.iter().enumerate() {
        let whole = format!("{}, {:.1}", p.adjusted_s.len(), mean(&p.adjusted_s));
        let _ = writeln!(t, "| {} | {whole} | {} |", i + 1, line(&p.with, &p.without));
        took.extend(&p.adjusted_s);
        with.extend(&p.with);
        without.extend(&p.without);
    }
    let _ = writeln!(t, "| all | {}, {:.1} | {} |", took.len(), mean(&took), line(&with, &without));
    t
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_compare_with_to_without_adjustments() {
        let steps = |ms: f64| Steps { ms: vec![ms; 100], processor_ms: vec![ms / 2.0; 50] };
        let pair = Pair { adjusted_s: vec![1.0, 2.0], with: steps(12.0), without: steps(10.0) };
        let text = table(&Busy { key_frames: 3, landmarks: 4, pairs: vec![pair.clone(), pair] });
        let wall = "12.0 / 12.0 / 12.0 | 10.0 / 10.0 / 10.0 | 1.20 | 1.20";
        let own = "6.0 / 6.0 / 6.0 | 5.0 / 5.0 / 5.0 | 1.20 | 1.20";
        assert!(text.contains(&format!("| 2 | 2, 1.5 | 100 | {wall} | {own} |")), "{text}");
        assert!(text.contains("| all | 4, 1.5 | 200 |"), "{text}");
    }
}
