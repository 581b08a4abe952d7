//! `imu-faults`: what a fault of the IMU does to the trajectory, and whether it is told.
//!
//! Each fault is put once into the readings of a recording ([`FaultyImu`]): at a fixed moment of the motion, or with more seeds at
//! random ones. One row for each fault and one column for each of the sensors: error, coverage, and when it was told.

use crate::darkened::Darkened;
use crate::{MeasureError, Sensors, run};
use cairn_engine::{Config, Output, PoseTime, Runner};
use cairn_eval::Align;
use cairn_random::Random;
use cairn_sim::{FaultyImu, ImuFault, ImuFaultKind};
use cairn_sources::{OpenOptions, open};
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

/// A recording, its sensors, the seconds of it that are used, and the moments at which a fault may begin.
struct Place {
    folder: &'static str,
    sensors: &'static [Sensors],
    seconds: f64,
    moments_s: [f64; 2],
    /// That of the first seed.
    moment_s: f64,
}

/// All recordings. MH_01 is moved for 14 s; `atrium` and `house` begin to walk at once.
const PLACES: [Place; 3] = [
    Place {
        folder: "euroc-mh01",
        sensors: &[Sensors::StereoImu, Sensors::MonoImu],
        seconds: 20.0,
        moments_s: [1.0, 13.0],
        moment_s: 8.0,
    },
    Place {
        folder: "atrium",
        sensors: &[Sensors::MonoImu],
        seconds: 40.0,
        moments_s: [1.0, 35.0],
        moment_s: 20.0,
    },
    Place {
        folder: "house",
        sensors: &[Sensors::MonoImu],
        seconds: 38.0,
        moments_s: [1.0, 33.0],
        moment_s: 20.0,
    },
];

/// Each kind of fault and its length.
fn faults() -> Vec<(ImuFaultKind, f64)> {
    use ImuFaultKind::*;
    let on = f64::INFINITY;
    let mut all: Vec<(ImuFaultKind, f64)> = [0.5, 1.0, 2.0, 5.0].map(|s| (Stuck, s)).into();
    all.extend([0.1, 0.3, 2.0].map(|s| (Zeros, s)));
    all.extend([(AccelDead, on), (GyroDead, on)]);
    all.extend([0.005, 0.03, 0.05, 0.3, 0.5, -0.5].map(|by| (Jump(by), on)));
    all.extend([0.005, 0.03].map(|by| (Drift(by), on)));
    all.extend([AccelSpikes, GyroSpikes, GyroSpike, Degrees].map(|kind| (kind, on)));
    all.extend([(Gap, 0.3), (Gap, 2.0), (Saturated, 2.0)]);
    all
}

/// The camera is covered so long before a fault, seconds.
const DARK_BEFORE_S: f64 = 0.5;

/// What is measured.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Only recordings whose name contains this.
    pub recording: Option<String>,
    /// Only faults whose name contains one of these.
    pub faults: Vec<String>,
    /// Only these sensors; empty: all.
    pub sensors: Vec<Sensors>,
    /// Moments for each fault.
    pub seeds: u64,
    /// The first of them: 0 is the fixed one.
    pub from: u64,
    /// The camera is covered for so many seconds from half a second before each fault on; 0: it is not.
    pub dark_s: f64,
    /// The engine's configuration.
    pub config: Config,
}

/// One run.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Recording.
    pub recording: &'static str,
    /// Sensors.
    pub sensors: &'static str,
    /// The fault.
    pub fault: String,
    /// When it begins, seconds after the first image; none without a fault.
    pub from_s: Option<f64>,
    /// RMSE of the final trajectory in metres; SE3, or Sim3 where the map is not metric.
    pub ate_m: Option<f64>,
    /// The same of the live poses.
    pub live_ate_m: Option<f64>,
    /// Whether lengths are metres at the end.
    pub metric: bool,
    /// Share of the images with a pose.
    pub coverage: f64,
    /// Maps at the end.
    pub maps: usize,
    /// Seconds after the beginning at which there was no pose any more; none where there always was one.
    pub stopped_s: Option<f64>,
    /// Seconds after the beginning at which it was told (the first time, and again at its end), and what.
    pub told: Vec<(f64, String)>,
}

/// Runs what is chosen; a line for each run on stderr.
///
/// # Errors
/// When a recording cannot be read or the engine fails.
pub fn run(data: &Path, chosen: &Chosen) -> Result<Vec<Row>, MeasureError> {
    let mut rows = Vec::new();
    let wanted = |place: &&Place| chosen.recording.as_ref().is_none_or(|name| place.folder.contains(name));
    for place in PLACES.iter().filter(wanted) {
        for sensors in place.sensors {
            if !chosen.sensors.is_empty() && !chosen.sensors.contains(sensors) {
                continue;
            }
            for fault in all_of(place, chosen) {
                let row = one(data, place, *sensors, fault, chosen)?;
                eprintln!("{}", line(&row));
                rows.push(row);
            }
        }
    }
    Ok(rows)
}

/// The faults of a recording, none first.
fn all_of(place: &Place, chosen: &Chosen) -> Vec<Option<ImuFault>> {
    let is_wanted = |name: &str| chosen.faults.is_empty() || chosen.faults.iter().any(|f| name.contains(f));
    let mut all = vec![None; usize::from(is_wanted("none"))];
    for (index, (kind, seconds)) in faults().into_iter().enumerate() {
        for seed in chosen.from..chosen.from + chosen.seeds {
            let [low, high] = place.moments_s;
            let drawn = Random::stream(seed, index as u64).uniform(low, high);
            let from_s = if seed == 0 { place.moment_s } else { drawn };
            let fault = ImuFault { kind, from_s, seconds };
            all.extend(is_wanted(&name(&fault)).then_some(Some(fault)));
        }
    }
    all
}

fn name(fault: &ImuFault) -> String {
    if fault.seconds.is_finite() {
        format!("{} {} s", fault.kind, fault.seconds)
    } else {
        fault.kind.to_string()
    }
}

fn one(
    data: &Path,
    place: &Place,
    sensors: Sensors,
    fault: Option<ImuFault>,
    chosen: &Chosen,
) -> Result<Row, MeasureError> {
    let address = data.join(place.folder);
    let mut source = open(&address.to_string_lossy(), OpenOptions::default())?;
    if let Some(fault) = fault {
        source = Box::new(FaultyImu::new(source, fault));
    }
    let begins_s = fault.map_or(place.moment_s, |f| f.from_s);
    if chosen.dark_s > 0.0 {
        let from_s = begins_s - DARK_BEFORE_S;
        source = Box::new(Darkened::new(source, Some([from_s, from_s + chosen.dark_s])));
    }
    let rate_hz = source.info().rate_hz;
    let mut engine = run::engine(source.rig(), sensors, rate_hz, Runner::Lockstep, &chosen.config)?;
    let (mut first, mut frames, mut told) = (None, 0, Vec::<(f64, String)>::new());
    let mut stopped_s = None;
    while let Some((packet, out)) = run::step(source.as_mut(), &mut engine, frames)? {
        let since_s = packet.stamp - *first.get_or_insert(packet.stamp);
        if since_s > place.seconds {
            break;
        }
        frames += 1;
        if !out.status.valid && since_s >= begins_s {
            stopped_s.get_or_insert(since_s - begins_s);
        }
        let now = what_is_told(&out);
        if told.last().map_or("", |(_, text)| text.as_str()) != now {
            told.push((since_s - begins_s, now));
        }
    }
    engine.finish();
    let truth = source.info().truth.clone();
    let align = if engine.is_metric() { Align::Se3 } else { Align::Sim3 };
    let ate = |time: PoseTime| -> Result<Option<f64>, MeasureError> {
        let poses = engine.camera_poses(time);
        Ok(run::aligned(&poses.comparable(&truth), &poses.trajectory(), align)?.map(|e| e.ate_m.rmse))
    };
    let poses = engine.trajectory();
    Ok(Row {
        recording: place.folder,
        sensors: sensors.name(),
        fault: fault.as_ref().map_or_else(|| "none".into(), name),
        from_s: fault.map(|f| f.from_s),
        ate_m: ate(PoseTime::Corrected)?,
        live_ate_m: ate(PoseTime::Live)?,
        metric: engine.is_metric(),
        coverage: poses.len() as f64 / frames.max(1) as f64,
        maps: engine.snapshot().maps().count(),
        stopped_s,
        told,
    })
}

/// What is said of the IMU at a frame; empty while it is trusted.
fn what_is_told(out: &Output) -> String {
    let Some(imu) = &out.status.imu else { return String::new() };
    match imu.fault {
        Some(fault) => format!("{fault:?}").split_whitespace().next().unwrap_or_default().to_owned(),
        None if imu.refused > 0 => "single readings refused".into(),
        None => String::new(),
    }
}

fn line(row: &Row) -> String {
    let at = row.from_s.map_or_else(String::new, |s| format!(" at {s:.2} s"));
    let metres = |m: Option<f64>| m.map_or_else(|| "-".into(), |m| format!("{m:.4}"));
    let told: Vec<String> = row
        .told
        .iter()
        .map(|(s, text)| format!("{s:+.2} s {}", if text.is_empty() { "sound" } else { text }))
        .collect();
    format!(
        "{} {} {}{at}: {} m live {} m{}, {:.1} %, {} maps{}; told {}",
        row.recording,
        row.sensors,
        row.fault,
        metres(row.ate_m),
        metres(row.live_ate_m),
        if row.metric { "" } else { " (no metres)" },
        100.0 * row.coverage,
        row.maps,
        row.stopped_s.map_or_else(String::new, |s| format!(", no pose from {s:+.2} s on")),
        if told.is_empty() { "nothing".into() } else { told.join(", ") },
    )
}

/// The table: for each recording and fault the errors by sensors, with the worst moment where there are several.
pub fn table(rows: &[Row]) -> String {
    let mut out = String::from(
        "| recording | sensors | fault | moments | ATE median, worst, m | least coverage | most maps | told, slowest | \
         stopped, latest |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    let mut at = 0;
    while let Some(first) = rows.get(at) {
        let same =
            |r: &&Row| (r.recording, r.sensors, &r.fault) == (first.recording, first.sensors, &first.fault);
        let group: Vec<&Row> = rows[at..].iter().take_while(same).collect();
        at += group.len();
        let mut errors: Vec<f64> = group.iter().map(|r| r.ate_m.unwrap_or(f64::INFINITY)).collect();
        errors.sort_by(f64::total_cmp);
        let told = last_of(group.iter().map(|r| Some(r.told.first()?.0)));
        let stopped = last_of(group.iter().map(|r| r.stopped_s));
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {:.4}, {:.4} | {:.1} % | {} | {told} | {stopped} |",
            first.recording,
            first.sensors,
            first.fault,
            group.len(),
            errors[errors.len() / 2],
            errors[errors.len() - 1],
            100.0 * group.iter().map(|r| r.coverage).fold(1.0, f64::min),
            group.iter().map(|r| r.maps).max().unwrap_or(0),
        );
    }
    out
}

/// How many there are of all, and the last of them.
fn last_of(times_s: impl ExactSizeIterator<Item = Option<f64>>) -> String {
    let all = times_s.len();
    let known: Vec<f64> = times_s.flatten().collect();
    let last =
        known.iter().copied().max_by(f64::total_cmp).map_or_else(String::new, |s| format!(", {s:+.2} s"));
    format!("{} of {all}{last}", known.len())
}
