//! `halves`: maps and saves the first half of a recording, then localizes the second half in the loaded map.

use crate::MeasureError;
use crate::Sensors;
use crate::scenario::{Bindings, Scenario};
use cairn_atlas::store::MapFile;
use cairn_engine::{Config, Engine, Runner};
use cairn_geometry::{Se3, Sim3, Vec3, umeyama};
use cairn_sensor::{FramePacket, Stamp};
use cairn_sources::{OpenOptions, open, std_host};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Result for one recording.
#[derive(Clone, Debug, Serialize)]
pub struct Halves {
    /// Name of the row.
    pub name: String,
    /// Frames of the first half with a pose, and all.
    pub mapped: [usize; 2],
    /// Bytes of the saved map.
    pub bytes: usize,
    /// Frames of the second half that were localized, and all.
    pub found: [usize; 2],
    /// The first frame of the second half with a pose.
    pub first: Option<usize>,
    /// RMSE of the second half's positions in the map of the first, with the alignment of the first half, metres.
    pub off_m: f64,
    /// The largest error, metres.
    pub most_m: f64,
}

/// All recordings of the scenario `accuracy` that are there.
///
/// # Errors
/// As [`run`].
pub fn all(data: &Path) -> Result<Vec<Halves>, MeasureError> {
    let mut rows = Vec::new();
    for recording in Scenario::read("accuracy")?.runs(&Bindings::new())? {
        let folder = data.join(&recording["folder"]);
        if folder.exists() {
            let sensors = recording["sensors"].parse().map_err(|e| format!("{e}"))?;
            rows.push(run(&recording["recording"], &folder, sensors)?);
        } else {
            eprintln!("skipped: {} is not there", folder.display());
        }
    }
    Ok(rows)
}

/// Maps the first half, saves and loads the map, and localizes the second half in it.
///
/// # Errors
/// When the recording cannot be read, or the map cannot be saved or loaded.
pub fn run(name: &str, folder: &Path, sensors: Sensors) -> Result<Halves, MeasureError> {
    let mut source = open(&folder.to_string_lossy(), OpenOptions::default())?;
    let (rig, rate_hz, mode) = (source.rig().clone(), source.info().rate_hz, sensors.mode());
    let config = Config::default();
    let mut packets = Vec::new();
    while let Some(packet) = source.next_packet()? {
        packets.push(packet);
    }
    let (one, two) = packets.split_at(packets.len() / 2);
    let mut engine = Engine::new(&rig, mode, rate_hz, Runner::Lockstep, &config, &std_host())?;
    feed(&mut engine, one)?;
    engine.finish();
    let truth: BTreeMap<Stamp, Se3> = engine.comparable(&source.info().truth).into_iter().collect();
    let at = |t: &Stamp| nearest(&truth, *t);
    let pairs = engine.trajectory().into_iter().filter_map(|(t, p)| Some((at(&t)?, p.translation)));
    let (target, from): (Vec<Vec3>, Vec<Vec3>) = pairs.unzip();
    let with_scale = !engine.is_metric();
    let true_from_map: Sim3 = umeyama(&target, &from, with_scale)?;
    let bytes = engine.to_save("bench", BTreeMap::new()).write()?;
    let file = MapFile::read(&bytes)?;
    let (second, _) = Engine::in_map(&rig, mode, rate_hz, Runner::Lockstep, &config, &std_host(), &file)?;
    let mut second = second.localize_only();
    feed(&mut second, two)?;
    let poses = second.trajectory();
    let off: Vec<f64> =
        poses.iter().filter_map(|(t, p)| Some((true_from_map * p.translation - at(t)?).norm())).collect();
    let square: f64 = off.iter().map(|v| v * v).sum();
    Ok(Halves {
        name: name.into(),
        mapped: [engine.log().tracked(), one.len()],
        bytes: bytes.len(),
        found: [poses.len(), two.len()],
        first: poses.first().and_then(|(t, _)| two.iter().position(|p| p.stamp == *t)),
        off_m: (square / off.len().max(1) as f64).sqrt(),
        most_m: off.iter().copied().fold(0.0, f64::max),
    })
}

fn feed(engine: &mut Engine, packets: &[FramePacket]) -> Result<(), MeasureError> {
    for packet in packets {
        engine.on_packet(packet)?;
    }
    Ok(())
}

/// The true position nearest in time, within 20 ms.
fn nearest(truth: &BTreeMap<Stamp, Se3>, t: Stamp) -> Option<Vec3> {
    let (before, after) = (truth.range(..=t).next_back(), truth.range(t..).next());
    let gap = |other: &Stamp| (t - *other).abs();
    let (stamp, pose) = before.into_iter().chain(after).min_by(|a, b| gap(a.0).total_cmp(&gap(b.0)))?;
    (gap(stamp) < 0.02).then_some(pose.translation)
}

/// All results in a table.
pub fn table(rows: &[Halves]) -> String {
    let mut t = String::from(
        "| recording | first half: tracked | saved map MB | second half: localized | first at frame | error m RMSE / max |\n|---|---|---|---|---|---|\n",
    );
    for r in rows {
        let first = r.first.map_or("never".into(), |f| f.to_string());
        // Writing to a string cannot fail.
        let _ = writeln!(
            t,
            "| {} | {} of {} | {:.2} | {} of {} | {first} | {:.3} / {:.3} |",
            r.name,
            r.mapped[0],
            r.mapped[1],
            r.bytes as f64 / 1e6,
            r.found[0],
            r.found[1],
            r.off_m,
            r.most_m
        );
    }
    t
}
