//! Whole runs over recordings in lockstep. What two tests look at is run once.

use bench::data_folder;
use cairn_engine::{Config, Engine, Host, Output, Runner, ScaleStretch, SensorMode};
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use cairn_sources::{OpenOptions, open};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};

type Once = Arc<OnceLock<Option<Arc<Run>>>>;

/// A run: what was given for each frame, and what was known in the end.
pub struct Run {
    /// The first frame of the recording, of those left out too.
    pub began: Stamp,
    pub outputs: Vec<Output>,
    /// The truth comparable to the poses.
    pub truth: BTreeMap<Stamp, Se3>,
    pub trajectory: Vec<(Stamp, Se3)>,
    pub stretches: Vec<ScaleStretch>,
}

/// What is run.
#[derive(Clone, Copy, PartialEq)]
pub struct Chosen {
    /// A folder of recordings.
    pub recording: &'static str,
    pub mode: SensorMode,
    pub imu: bool,
    /// Whole seconds at its beginning that are left out.
    pub left_out_s: u32,
}

/// Tracks a recording; `None` where it is missing.
pub fn run(chosen: Chosen) -> Option<Arc<Run>> {
    static RUNS: Mutex<Vec<(Chosen, Once)>> = Mutex::new(Vec::new());
    let mut runs = RUNS.lock().unwrap();
    let known = runs.iter().find(|(other, _)| *other == chosen).map(|(_, run)| run.clone());
    let one = known.unwrap_or_else(|| {
        runs.push((chosen, Once::default()));
        runs[runs.len() - 1].1.clone()
    });
    drop(runs);
    one.get_or_init(|| run_now(chosen).map(Arc::new)).clone()
}

fn run_now(Chosen { recording, mode, imu, left_out_s }: Chosen) -> Option<Run> {
    let folder = data_folder().join(recording);
    if !folder.exists() {
        println!("skipped: {} is missing", folder.display());
        return None;
    }
    let mut source = open(&folder.to_string_lossy(), OpenOptions::default()).unwrap();
    let (rig, rate_hz) = (source.rig().clone(), source.info().rate_hz);
    let truth = source.info().truth.clone();
    let mut config = Config::default();
    config.inertial.enabled = imu;
    let mut engine = Engine::new(&rig, mode, rate_hz, Runner::Lockstep, &config, &Host::bare()).unwrap();
    let (mut first, mut outputs) = (None, Vec::new());
    while let Some(packet) = source.next_packet().unwrap() {
        if packet.stamp - *first.get_or_insert(packet.stamp) >= f64::from(left_out_s) {
            outputs.push(engine.on_packet(&packet).unwrap());
        }
    }
    engine.finish();
    Some(Run {
        began: first?,
        outputs,
        truth: engine.comparable(&truth).into_iter().collect(),
        trajectory: engine.trajectory(),
        stretches: engine.scale_stretches(),
    })
}
