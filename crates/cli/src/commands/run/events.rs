//! `--events`: the changes of the map as lines of JSON; docs/formats/events.md describes the format.

use super::sink::{Ended, Frame, Sink};
use crate::failure::Failure;
use cairn_atlas::{Change, KeyFrameId, MapPrior, Mirror, Published, Subscription};
use cairn_engine::{Engine, Joined, Verdict};
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// The file of events, with a mirror of the map that is kept up to date by the stream alone.
pub struct Events {
    path: PathBuf,
    to: BufWriter<File>,
    from: Subscription,
    mirror: Mirror,
    failed: Option<std::io::Error>,
}

impl Events {
    /// Creates the file if one is requested.
    ///
    /// # Errors
    /// When the file cannot be created or mapping is not running.
    pub fn begin(path: Option<&Path>, engine: &mut Engine) -> Result<Option<Self>, Failure> {
        let Some(path) = path else { return Ok(None) };
        let fail = |why: String| Failure::new(path.display().to_string(), why, "name another file");
        let to = BufWriter::new(File::create(path).map_err(|e| fail(e.to_string()))?);
        let from = engine.subscribe().ok_or_else(|| fail("mapping is not running".into()))?;
        let mirror = Mirror::of(&from.start);
        Ok(Some(Self { path: path.to_owned(), to, from, mirror, failed: None }))
    }

    /// Writes everything that has happened up to a frame.
    fn write<'v>(&mut self, stamp: Stamp, verdicts: impl Iterator<Item = &'v Verdict>) {
        let mut lines: Vec<Value> = verdicts.map(verdict).collect();
        while let Ok(published) = self.from.changes.try_recv() {
            lines.extend(commit_lines(&published, &mut self.mirror));
        }
        if lines.is_empty() || self.failed.is_some() {
            return;
        }
        let text: String = lines
            .iter_mut()
            .map(|line| {
                line["stamp_ns"] = stamp.0.into();
                format!("{line}\n")
            })
            .collect();
        self.failed = self.to.write_all(text.as_bytes()).and_then(|()| self.to.flush()).err();
    }
}

impl Sink for Events {
    fn frame(&mut self, frame: &Frame) {
        if let Some((_, done)) = frame.output() {
            self.write(done.stamp, done.verdicts());
        }
    }

    fn end(mut self: Box<Self>, ended: &mut Ended) -> Result<(), Failure> {
        if let Some(here) = ended.run.here() {
            self.write(here.last, here.finished.verdicts());
        }
        let Some(e) = self.failed else { return Ok(()) };
        Err(Failure::new(self.path.display().to_string(), e.to_string(), "free some space on the disk"))
    }
}

fn id(key_frame: KeyFrameId) -> usize {
    key_frame.index()
}

fn pose(p: &Se3) -> Value {
    let q = p.rotation.quaternion().coords;
    let t = p.translation;
    json!({ "position": [t.x, t.y, t.z], "quaternion": [q.x, q.y, q.z, q.w] })
}

fn map_prior(t: &MapPrior) -> Value {
    let mut value = pose(&t.to_from_root);
    value["key_frame"] = id(t.to).into();
    value["sigma"] = t.sigma.into();
    value["sigma_rad"] = t.sigma_rad.into();
    value
}

/// The current poses of key frames.
fn current_poses(ids: &BTreeSet<KeyFrameId>, mirror: &Mirror) -> Vec<Value> {
    let of = |k: &KeyFrameId| {
        let m = mirror.key_frame(*k)?;
        let mut value = pose(&m.world_from_camera);
        value["id"] = id(*k).into();
        value["map"] = id(m.map.root()).into();
        value["unit"] = m.unit.into();
        Some(value)
    };
    ids.iter().filter_map(of).collect()
}

/// The lines of one commit; also applies the commit to the mirror.
fn commit_lines(published: &Published, mirror: &mut Mirror) -> Vec<Value> {
    let (mut born, mut moved) = (BTreeSet::new(), BTreeSet::new());
    let mut lines = Vec::new();
    let priors: Vec<_> = published
        .changes
        .iter()
        .filter_map(|c| match c {
            Change::MapPrior(map, prior) => Some((map.root(), prior)),
            _ => None,
        })
        .collect();
    for change in &published.changes {
        match change {
            Change::AddKeyFrame(k) => {
                born.insert(k.id);
                if k.parent.is_none() {
                    let prior = priors.iter().find(|(root, _)| *root == k.id).map(|(_, p)| map_prior(p));
                    lines.push(json!({ "event": "map_created", "map": id(k.id), "map_prior": prior }));
                }
            }
            Change::MapPrior(map, p) if !born.contains(&map.root()) => {
                lines.push(json!({ "event": "map_prior", "map": id(map.root()), "map_prior": map_prior(p) }));
            }
            Change::MoveKeyFrame(k, _) => {
                moved.insert(*k);
            }
            Change::Scale(k, factor) => {
                moved.insert(*k);
                lines.push(json!({ "event": "scale", "key_frame": id(*k), "factor": factor }));
            }
            Change::Link(a, b) => lines.push(json!({ "event": "loop", "key_frames": [id(*a), id(*b)] })),
            Change::Merge { from, into, into_from, parent } => {
                moved.extend(mirror.key_frames().filter(|(_, k)| k.map == *from).map(|(k, _)| k));
                let mut line = pose(&Se3::new(into_from.rotation, into_from.translation));
                line["event"] = "merge".into();
                line["from"] = id(from.root()).into();
                line["into"] = id(into.root()).into();
                line["scale"] = into_from.scale.into();
                line["parent"] = id(*parent).into();
                lines.push(line);
            }
            Change::AlignGravity(map, aligned_from_map) => {
                moved.extend(mirror.key_frames().filter(|(_, k)| k.map == *map).map(|(k, _)| k));
                let mut line = pose(&Se3::new(aligned_from_map.rotation, aligned_from_map.translation));
                line["event"] = "gravity_aligned".into();
                line["map"] = id(map.root()).into();
                line["scale"] = aligned_from_map.scale.into();
                lines.push(line);
            }
            _ => {}
        }
    }
    for r in &published.removed {
        let at = Se3::new(r.parent_from_it.rotation, r.parent_from_it.translation);
        let mut line = pose(&at);
        line["event"] = "removed".into();
        line["key_frame"] = id(r.key_frame).into();
        line["parent"] = id(r.parent).into();
        line["scale"] = r.parent_from_it.scale.into();
        lines.push(line);
    }
    mirror.take(published);
    moved.retain(|k| !born.contains(k));
    for (event, ids) in [("born", &born), ("moved", &moved)] {
        let poses = current_poses(ids, mirror);
        if !poses.is_empty() {
            lines.push(json!({ "event": event, "key_frames": poses }));
        }
    }
    lines.iter_mut().for_each(|line| line["version"] = published.version.into());
    lines
}

fn verdict(v: &Verdict) -> Value {
    let mut line = json!({ "event": "verdict", "key_frame": id(v.key_frame), "candidate": id(v.candidate) });
    match &v.result {
        Ok(a) => {
            line["accepted"] = true.into();
            line["joined"] = match a.joined {
                Joined::Loop => "loop".into(),
                Joined::Merge { .. } => "merge".into(),
            };
            line["inliers"] = a.inliers.into();
            line["expected"] = a.expected.into();
            line["off"] = a.off.into();
            line["off_rad"] = a.off_rad.into();
            line["scale"] = a.scale.into();
        }
        Err(why) => {
            line["accepted"] = false.into();
            line["why"] = why.to_string().into();
        }
    }
    line
}
