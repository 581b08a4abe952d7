//! Stitching: the changes that make two maps one along seams that agree: one similarity, the pose graph relaxed,
//! landmarks fused, the result adjusted.

use super::seams::Found;
use super::{Adjust, FusedScales, Junction, Seam, Support};
use crate::closing::draft::Draft;
use crate::closing::relax::{Loop, relax};
use crate::closing::visits::metre_in_map_units;
use crate::closing::{Closer, Freedom, correct};
use cairn_adjust::{Window, WindowConfig};
use cairn_atlas::{Change, KeyFrameId, MapId, Snapshot};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_solve::to_end;
use std::collections::{BTreeMap, BTreeSet};

impl Closer {
    /// Joins two maps by the chosen seams, of which there is at least one.
    pub(super) fn stitch(
        &self,
        snapshot: &Snapshot,
        [from, into]: [MapId; 2],
        found: &[Found],
        chosen: &[usize],
        scales: FusedScales,
        adjust: Adjust,
    ) -> (Junction, Draft) {
        let chosen: Vec<&Found> = chosen.iter().map(|k| &found[*k]).collect();
        let middle = middle(snapshot, &chosen);
        let mut draft = Draft::new(snapshot);
        let mut into_from = middle.seam.into_from;
        let older: BTreeSet<KeyFrameId> = snapshot.key_frames_of(into).map(|k| k.id).collect();
        let younger: Vec<KeyFrameId> = snapshot.key_frames_of(from).map(|k| k.id).collect();
        // Metres and the direction of gravity are kept, whichever of the maps has them.
        let (mut aligned_from_into, mut unit) = (Sim3::identity(), scales.there);
        let metric = |map| snapshot.is_metric_in(map, &self.camera);
        let held = match (metric(into), metric(from)) {
            (true, false) => older.clone(),
            (false, true) => younger.iter().copied().collect(),
            _ => BTreeSet::new(),
        };
        if snapshot.is_gravity_aligned(from) && !snapshot.is_gravity_aligned(into) {
            aligned_from_into = into_from.inverse();
            into_from = Sim3::identity();
            unit = scales.here;
            draft.push(vec![Change::AlignGravity(into, aligned_from_into)]);
        } else if metric(from) && !metric(into) {
            let factor = 1.0 / into_from.scale;
            aligned_from_into = scaling_about_root(snapshot, into, factor);
            into_from = aligned_from_into * into_from;
            draft.push(vec![Change::Rescale(into, factor)]);
        }
        if let Some(here) = snapshot.key_frame(middle.seam.key_frame) {
            correct::merge(&mut draft, here, middle.seam.place, &into_from);
        }
        let scaled = scaling_about_root(draft.snapshot(), into, unit);
        (aligned_from_into, into_from) = (scaled * aligned_from_into, scaled * into_from);
        draft.push(scales.after_merge(snapshot, [into, from], into, unit));
        let merged = draft.snapshot().clone();
        let landmarks = merged.landmark_count();
        let placed: Vec<Loop> = (chosen.iter())
            .map(|f| Loop {
                here: f.seam.key_frame,
                old: f.seam.place,
                world_from_here: in_merged(f, middle, &aligned_from_into),
            })
            .collect();
        self.relax_along(&mut draft, middle, &placed, from, &held);
        let seen: Vec<_> = chosen.iter().map(|f| (f.seam.key_frame, &f.place)).collect();
        correct::fuse(&mut draft, &self.camera, &seen);
        let fused = landmarks.saturating_sub(draft.snapshot().landmark_count());
        self.adjust_along(&mut draft, into, &chosen, adjust);
        let after = draft.snapshot();
        let junction = Junction {
            seams: chosen.iter().map(|f| f.seam).collect::<Vec<Seam>>(),
            left_out: found.len() - chosen.len(),
            support: Support::default(),
            into_from: aligned_from_into.inverse() * into_from,
            scales,
            rms: rms(&merged, &placed),
            rms_after: rms(after, &relative_to(after, &merged, &placed)),
            moved: moved(&merged, after, younger.iter().copied()),
            older_moved: moved(&merged, after, older.iter().copied()),
            fused,
        };
        (junction, draft)
    }

    /// Relaxes the pose graph of the merged map under all seams; `held` stay: the map that alone has metres.
    fn relax_along(
        &self,
        draft: &mut Draft,
        middle: &Found,
        placed: &[Loop],
        root: MapId,
        held: &BTreeSet<KeyFrameId>,
    ) {
        let snapshot = draft.snapshot();
        let Some(here) = snapshot.key_frame(middle.seam.key_frame) else { return };
        let metre = metre_in_map_units(snapshot, here, middle.freedom);
        let fixed = |id: KeyFrameId| middle.freedom == Freedom::Similar && held.contains(&id);
        let changes = relax(snapshot, here.map, placed, Some(root.root()), metre, middle.freedom, fixed);
        draft.push(changes);
        draft.push(placed.iter().map(|l| Change::Link(l.here, l.old)).collect());
    }

    /// Adjusts a map that was joined as a whole, with observations weighed by size. No changes where it has more than
    /// [`crate::CloserConfig::whole_key_frames`].
    pub fn adjust_joined(&self, snapshot: &Snapshot, map: MapId) -> Vec<Change> {
        to_end(self.adjust_whole_with(snapshot, map, |window| window.joined(), || false))
    }

    /// Adjusts the map, if that is wanted now: as a whole where it is small enough, else around each seam.
    fn adjust_along(&self, draft: &mut Draft, map: MapId, chosen: &[&Found], adjust: Adjust) {
        if adjust == Adjust::Later {
            return;
        }
        let count = draft.snapshot().key_frames_of(map).count();
        if count <= self.config.whole_key_frames {
            let changes = self.adjust_joined(draft.snapshot(), map);
            return draft.push(changes);
        }
        let config =
            WindowConfig { key_frames: 2 * self.window.key_frames, right_offset_sigma: 0.0, ..self.window };
        let mut done: BTreeSet<KeyFrameId> = BTreeSet::new();
        for f in chosen {
            if done.contains(&f.seam.key_frame) {
                continue;
            }
            let near = draft.snapshot().key_frame(f.seam.key_frame).map(|k| k.covisible.clone());
            done.insert(f.seam.key_frame);
            done.extend(near.into_iter().flatten().take(self.window.key_frames / 2).map(|(id, _)| id));
            let snapshot = draft.snapshot();
            let window = Window::of(snapshot, &self.camera).joined();
            if let Some(window) = window.around(f.seam.key_frame, &config) {
                draft.push(window.solve(&config, || false).changes.changes);
            }
        }
    }
}

/// What [`Change::Rescale`] does to a map.
fn scaling_about_root(snapshot: &Snapshot, map: MapId, factor: f64) -> Sim3 {
    let root = snapshot.world_from_camera(map.root()).unwrap_or(Se3::identity()).translation;
    Sim3::new(So3::identity(), root * (1.0 - factor), factor)
}

/// The seam that differs least from all others at the places of these.
pub(super) fn middle<'a>(snapshot: &Snapshot, chosen: &[&'a Found]) -> &'a Found {
    let positions: Vec<Vec3> = (chosen.iter())
        .filter_map(|f| Some(snapshot.key_frame(f.seam.key_frame)?.world_from_camera.translation))
        .collect();
    let off = |f: &Found| -> f64 {
        let there = positions
            .iter()
            .zip(chosen)
            .map(|(p, other)| (f.seam.into_from * *p - other.world_from_here.translation).norm());
        there.sum()
    };
    let mut best = (f64::INFINITY, chosen[0]);
    for f in chosen {
        let off = off(f);
        if off < best.0 {
            best = (off, f);
        }
    }
    best.1
}

/// Where a seam puts its key frame in the merged map. Lengths around it are already in the units of that map, as far as
/// the seam in the middle says; the scale is what this one says differently.
fn in_merged(f: &Found, middle: &Found, aligned_from_into: &Sim3) -> Sim3 {
    let there = *aligned_from_into * f.world_from_here;
    let scale = f.world_from_here.scale / middle.world_from_here.scale;
    Sim3::new(there.rotation, there.translation, scale)
}

fn rms(snapshot: &Snapshot, placed: &[Loop]) -> f64 {
    let squares: Vec<f64> = (placed.iter())
        .filter_map(|l| {
            let k = snapshot.key_frame(l.here)?;
            Some((k.world_from_camera.translation - l.world_from_here.translation).norm_squared())
        })
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

/// The seams, moved with the key frames of the older map that they are measured from.
fn relative_to(after: &Snapshot, before: &Snapshot, placed: &[Loop]) -> Vec<Loop> {
    let moves = |l: &Loop| {
        let (was, is) = (before.world_from_here(l.old)?, after.world_from_here(l.old)?);
        Some(Loop { world_from_here: is * was.inverse() * l.world_from_here, ..*l })
    };
    placed.iter().filter_map(moves).collect()
}

/// Mean and greatest distance by which key frames moved.
fn moved(before: &Snapshot, after: &Snapshot, ids: impl Iterator<Item = KeyFrameId>) -> [f64; 2] {
    let position = |s: &Snapshot, id| s.key_frame(id).map(|k| k.world_from_camera.translation);
    let far: BTreeMap<KeyFrameId, f64> =
        ids.filter_map(|id| Some((id, (position(before, id)? - position(after, id)?).norm()))).collect();
    let sum: f64 = far.values().sum();
    [sum / far.len().max(1) as f64, far.values().copied().fold(0.0, f64::max)]
}
