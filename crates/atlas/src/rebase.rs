//! Rebasing: changes made on an older snapshot are transferred to the latest one.
//!
//! In: the snapshot they were made on, the changes, the latest snapshot. Out: changes for the latest.
//! Structural changes (joins and removals) are kept as they are. Moves become similarities since the older
//! snapshot: whatever has been moved or created meanwhile moves along with the key frame it is anchored to.

use crate::{Change, ChangeSet, KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::{Se3, Sim3};
use std::collections::BTreeMap;

/// The changes to apply to `latest` when `changes` were made on `base`.
pub(crate) fn rebase(base: &Snapshot, changes: Vec<Change>, latest: &Snapshot) -> Vec<Change> {
    let set = ChangeSet { base: base.version, changes };
    let after = base.apply(&set).0;
    let shifts = shifts(base, &after);
    let mut rebased: Vec<Change> = set.changes.into_iter().filter(|change| !moves(change)).collect();
    // Structure first: merges move whole maps, and the positions below are those after them.
    let joined = latest.apply(&ChangeSet { base: latest.version, changes: rebased.clone() }).0;
    for k in latest.key_frames() {
        let Some(shift) = shift_of(&shifts, latest, k.id) else { continue };
        let Some(now) = joined.key_frame(k.id) else { continue };
        let wanted = shift * k.world_from_here();
        let pose = match (base.key_frame(k.id), after.key_frame(k.id)) {
            // Not moved meanwhile: exactly where the changes put it.
            (Some(b), Some(a)) if same_pose(b, k) => a.world_from_camera,
            _ => Se3::new(wanted.rotation, wanted.translation),
        };
        if now.world_from_camera != pose {
            rebased.push(Change::MoveKeyFrame(k.id, pose));
        }
        if (wanted.scale / now.unit - 1.0).abs() > 1e-12 {
            rebased.push(Change::Scale(k.id, wanted.scale / now.unit));
        }
    }
    for l in latest.landmarks() {
        let Some(now) = joined.landmark(l.id) else { continue };
        let position = match (base.landmark(l.id), after.landmark(l.id)) {
            (Some(b), Some(a)) if b.position == l.position => a.position,
            (Some(b), Some(a)) if a.position == b.position => continue,
            _ => match l.observations.first().and_then(|o| shift_of(&shifts, latest, o.key_frame)) {
                Some(shift) => shift * l.position,
                None => continue,
            },
        };
        if now.position != position {
            rebased.push(Change::MoveLandmark(l.id, position));
        }
    }
    rebased
}

fn moves(change: &Change) -> bool {
    matches!(change, Change::MoveKeyFrame(..) | Change::MoveLandmark(..) | Change::Scale(..))
}

fn same_pose(a: &KeyFrame, b: &KeyFrame) -> bool {
    a.world_from_camera == b.world_from_camera && a.unit == b.unit
}

/// The similarity by which each key frame of the older snapshot has moved; `None` for one that has not.
fn shifts(base: &Snapshot, after: &Snapshot) -> BTreeMap<KeyFrameId, Option<Sim3>> {
    let moved = |k: &KeyFrame| {
        let there = after.world_from_here(k.id)?;
        (there != k.world_from_here()).then(|| there * k.world_from_here().inverse())
    };
    base.key_frames().map(|k| (k.id, moved(k))).collect()
}

/// The shift of a key frame, or of its nearest ancestor that the older snapshot had.
fn shift_of(shifts: &BTreeMap<KeyFrameId, Option<Sim3>>, latest: &Snapshot, id: KeyFrameId) -> Option<Sim3> {
    let mut at = id;
    loop {
        if let Some(shift) = shifts.get(&at) {
            return *shift;
        }
        at = latest.key_frame(at)?.parent?;
    }
}
