//! `long`: minutes of laps in one world. Once the map of the area is complete, step time and memory must stay constant.

use crate::MeasureError;
use crate::Sensors;
use crate::memory::resident_mb;
use cairn_engine::{Config, Engine, Runner};
use cairn_eval::Percentiles;
use cairn_sensor::Source;
use cairn_sources::std_host;
use serde::Serialize;
use std::fmt::Write;

/// Costs of one minute.
#[derive(Clone, Debug, Serialize)]
pub struct Minute {
    /// Number of packets.
    pub frames: usize,
    /// Number of tracked packets.
    pub tracked: usize,
    /// Image to pose, milliseconds.
    pub step_ms: Percentiles,
    /// The part from features to pose.
    pub track_ms: Percentiles,
    /// Mapping of a key frame, milliseconds.
    pub map_ms: Percentiles,
    /// Key frames processed by mapping.
    pub mapped: usize,
    /// Resident memory at the end of the minute, megabytes.
    pub resident_mb: f64,
    /// Key frames in the map at the end of the minute.
    pub key_frames: usize,
    /// Landmarks in the map at the end of the minute.
    pub landmarks: usize,
}

/// Runs a source in lockstep, minute by minute of its own time; each minute is printed on stderr as it ends.
///
/// # Errors
/// As [`crate::measure()`].
pub fn run(source: &mut dyn Source, sensor: Sensors) -> Result<Vec<Minute>, MeasureError> {
    let rig = source.rig().clone();
    let (config, rate_hz) = (Config::default(), source.info().rate_hz);
    let mut engine = Engine::new(&rig, sensor.mode(), rate_hz, Runner::Lockstep, &config, &std_host())?;
    let mut minutes = Vec::new();
    let mut first = None;
    let mut current = Costs::default();
    while let Some(packet) = source.next_packet()? {
        let first = *first.get_or_insert(packet.stamp);
        if packet.stamp - first >= 60.0 * (minutes.len() + 1) as f64 {
            minutes.push(std::mem::take(&mut current).close(&engine));
            eprintln!("minute {}: {}", minutes.len(), line(&minutes[minutes.len() - 1]));
        }
        let out = engine.on_packet(&packet)?;
        if let Some(cause) = out.stage_failed() {
            return Err(MeasureError::Stage(cause.to_owned()));
        }
        current.step_ms.push(out.timings.step_ms());
        current.track_ms.push(out.timings.track_ms);
        current.tracked += usize::from(out.pose.is_some());
        current.map_ms.extend(out.timings.map_ms);
    }
    engine.snapshot().check()?;
    // The rest counts as a minute if it is longer than half of one.
    if current.step_ms.len() as f64 > 30.0 * source.info().rate_hz {
        minutes.push(current.close(&engine));
    }
    Ok(minutes)
}

#[derive(Default)]
struct Costs {
    step_ms: Vec<f64>,
    track_ms: Vec<f64>,
    map_ms: Vec<f64>,
    tracked: usize,
}

impl Costs {
    fn close(self, engine: &Engine) -> Minute {
        let map = engine.snapshot();
        Minute {
            frames: self.step_ms.len(),
            tracked: self.tracked,
            step_ms: Percentiles::of(&self.step_ms).unwrap_or_default(),
            track_ms: Percentiles::of(&self.track_ms).unwrap_or_default(),
            map_ms: Percentiles::of(&self.map_ms).unwrap_or_default(),
            mapped: self.map_ms.len(),
            resident_mb: resident_mb().unwrap_or(f64::NAN),
            key_frames: map.key_frame_count(),
            landmarks: map.landmark_count(),
        }
    }
}

fn line(m: &Minute) -> String {
    format!(
        "tracked {}/{}, step p50 {:.1} ms, track p50 {:.1} ms, {} mapped at p50 {:.0} ms, {:.0} MB, {} key frames, {} landmarks",
        m.tracked,
        m.frames,
        m.step_ms.p50,
        m.track_ms.p50,
        m.mapped,
        m.map_ms.p50,
        m.resident_mb,
        m.key_frames,
        m.landmarks
    )
}

/// The minutes as a table in Markdown.
pub fn table(minutes: &[Minute]) -> String {
    let mut t = String::from(
        "| minute | tracked | step p50 ms | track p50 ms | key frames processed | mapping p50 ms | resident MB | key frames | landmarks |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    for (i, m) in minutes.iter().enumerate() {
        let _ = writeln!(
            t,
            "| {} | {}/{} | {:.1} | {:.1} | {} | {:.0} | {:.0} | {} | {} |",
            i + 1,
            m.tracked,
            m.frames,
            m.step_ms.p50,
            m.track_ms.p50,
            m.mapped,
            m.map_ms.p50,
            m.resident_mb,
            m.key_frames,
            m.landmarks
        );
    }
    t
}
