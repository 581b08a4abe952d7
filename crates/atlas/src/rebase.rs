//! Rebasing: changes that were made on an older version of a map are made good on the latest.
//!
//! In: the version they were made on, the changes, the latest version. Out: changes for the latest. What the changes
//! join or remove is kept as it is. What they move has moved by some similarity since the older version: whatever has
//! been moved or born meanwhile goes along with the key frame it hangs on.

use crate::{Change, ChangeSet, KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::{Se3, Sim3};
use std::collections::BTreeMap;

/// The changes as they have to be made on `latest` when they were made on `base`.
pub(crate) fn rebase(base: &Snapshot, changes: Vec<Change>, latest: &Snapshot) -> Vec<Change> {
    let set = ChangeSet { base: base.version, changes };
    let after = base.apply(&set).0;
    let shifts = shifts(base, &after);
    let mut rebased: Vec<Change> = set.changes.into_iter().filter(|change| !moves(change)).collect();
    // Structure first: merges carry whole worlds along, and the places below are where things stand after them.
    let joined = latest.apply(&ChangeSet { base: latest.version, changes: rebased.clone() }).0;
    for k in latest.key_frames() {
        let Some(shift) = shift_of(&shifts, latest, k.id) else { continue };
        let Some(now) = joined.key_frame(k.id) else { continue };
        let wanted = shift * k.world_from_here();
        let pose = match (base.key_frame(k.id), after.key_frame(k.id)) {
            // Untouched meanwhile: exactly where the changes put it.
            (Some(b), Some(a)) if same_place(b, k) => a.world_from_camera,
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
        let place = match (base.landmark(l.id), after.landmark(l.id)) {
            (Some(b), Some(a)) if b.position == l.position => a.position,
            (Some(b), Some(a)) if a.position == b.position => continue,
            _ => match l.observations.first().and_then(|o| shift_of(&shifts, latest, o.key_frame)) {
                Some(shift) => shift * l.position,
                None => continue,
            },
        };
        if now.position != place {
            rebased.push(Change::MoveLandmark(l.id, place));
        }
    }
    rebased
}

fn moves(change: &Change) -> bool {
    matches!(change, Change::MoveKeyFrame(..) | Change::MoveLandmark(..) | Change::Scale(..))
}

fn same_place(a: &KeyFrame, b: &KeyFrame) -> bool {
    a.world_from_camera == b.world_from_camera && a.unit == b.unit
}

/// By what each key frame of the older version has moved; `None` for one that has not.
fn shifts(base: &Snapshot, after: &Snapshot) -> BTreeMap<KeyFrameId, Option<Sim3>> {
    let moved = |k: &KeyFrame| {
        let there = after.world_from_here(k.id)?;
        (there != k.world_from_here()).then(|| there * k.world_from_here().inverse())
    };
    base.key_frames().map(|k| (k.id, moved(k))).collect()
}

/// The shift of a key frame, or of the one it hangs on that the older version knew.
fn shift_of(shifts: &BTreeMap<KeyFrameId, Option<Sim3>>, latest: &Snapshot, id: KeyFrameId) -> Option<Sim3> {
    let mut at = id;
    loop {
        if let Some(shift) = shifts.get(&at) {
            return *shift;
        }
        at = latest.key_frame(at)?.parent?;
    }
}
