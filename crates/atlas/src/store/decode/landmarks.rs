//! Landmarks, and what follows from which features show them.

use super::shown::Appearance;
use crate::store::beside::HAS_THREADS;
use crate::store::container::Parts;
use crate::store::error::StoreError;
use crate::store::layout::NO_PICK;
use crate::store::wire::Decoder;
use crate::{KeyFrame, Landmark, LandmarkId, Observation, Snapshot};
use cairn_geometry::Vec3;
use cairn_vision::Descriptor;

/// Landmarks without observations, and which observation gives each its descriptor.
pub(super) fn read_landmarks(
    parts: &Parts,
    snapshot: &Snapshot,
    count: usize,
) -> Result<(Vec<Landmark>, Vec<u32>), StoreError> {
    let bytes = parts.get("landmarks")?;
    let mut d = Decoder::new("landmarks", &bytes);
    let n = count;
    let steps = d.column_u32(n)?;
    let (x, y, z) = (d.column_f64(n)?, d.column_f64(n)?, d.column_f64(n)?);
    let picks = d.column_u32(n)?;
    let mut landmarks = Vec::with_capacity(n);
    let mut raw = 0u32;
    for i in 0..n {
        let next =
            raw.checked_add(steps[i]).filter(|next| *next > raw && *next as usize <= snapshot.next_landmark);
        raw = next.ok_or_else(|| d.wrong(format!("row {i} has an invalid id")))?;
        let position = Vec3::new(x[i], y[i], z[i]);
        let id = LandmarkId::from_raw(raw).filter(|_| position.iter().all(|v| v.is_finite()));
        let id = id.ok_or_else(|| d.wrong(format!("row {i} has an invalid position")))?;
        landmarks.push(Landmark::new(id, position));
    }
    d.end()?;
    Ok((landmarks, picks))
}

/// Connects key frames and landmarks by what the features show.
pub(in crate::store) fn observe(
    shown: &[u32],
    key_frames: &mut [KeyFrame],
    landmarks: &mut [Landmark],
) -> Result<(), StoreError> {
    let mut counts = vec![0usize; landmarks.len()];
    for row in shown.iter().filter_map(|row| row.checked_sub(1)) {
        let wrong = || StoreError::part("landmarks", format!("row {row} is observed, but does not exist"));
        *counts.get_mut(row as usize).ok_or_else(wrong)? += 1;
    }
    for (l, count) in landmarks.iter_mut().zip(counts) {
        l.observations.reserve_exact(count);
    }
    let mut rest = shown;
    for k in key_frames {
        let (own_rows, after) = rest.split_at(k.landmarks.len());
        rest = after;
        for (feature, (slot, row)) in k.landmarks.iter_mut().zip(own_rows).enumerate() {
            let Some(row) = row.checked_sub(1) else { continue };
            let l = &mut landmarks[row as usize];
            if l.observations.last().is_some_and(|o| o.key_frame == k.id) {
                return Err(StoreError::part(
                    "landmarks",
                    format!("{:?} is observed twice in {:?}", l.id, k.id),
                ));
            }
            *slot = Some(l.id);
            l.observations.push(Observation { key_frame: k.id, feature: feature as u16 });
        }
    }
    Ok(())
}

/// Derives what follows from the observations of landmarks, on several processors; `appearances` tells their descriptors and levels
/// where features are not read.
pub(in crate::store) fn derive_all(
    snapshot: &Snapshot,
    landmarks: &mut [Landmark],
    picks: &[u32],
    appearances: Option<&[Appearance]>,
) -> Result<(), StoreError> {
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get().min(4));
    let each = landmarks.len().div_ceil(threads).max(1);
    let derive_some = |first: usize, some: &mut [Landmark]| {
        some.iter_mut().enumerate().try_for_each(|(i, l)| {
            let row = first + i;
            let appearance = appearances.and_then(|appearances| appearances.get(row).copied());
            if derive(snapshot, l, picks[row], appearance).is_none() {
                return Err(StoreError::part("landmarks", format!("{:?} cannot be derived", l.id)));
            }
            let map = |o: &Observation| snapshot.key_frame(o.key_frame).map(|k| k.map);
            match l.observations.iter().all(|o| map(o) == map(&l.observations[0])) {
                true => Ok(()),
                false => Err(StoreError::part("map", format!("{:?} is observed from two maps", l.id))),
            }
        })
    };
    if !HAS_THREADS {
        return derive_some(0, landmarks);
    }
    std::thread::scope(|scope| {
        let jobs: Vec<_> = landmarks
            .chunks_mut(each)
            .enumerate()
            .map(|(n, some)| {
                let derive_some = &derive_some;
                scope.spawn(move || derive_some(n * each, some))
            })
            .collect();
        jobs.into_iter().try_for_each(|job| {
            job.join().unwrap_or_else(|_| Err(StoreError::part("landmarks", "they cannot be derived")))
        })
    })
}

/// Derives what follows from the observations of a landmark.
fn derive(snapshot: &Snapshot, l: &mut Landmark, pick: u32, appearance: Option<Appearance>) -> Option<()> {
    if let Some(appearance) = appearance {
        (l.descriptor, l.octave, l.angle) = appearance;
        l.pick = u16::try_from(pick).unwrap_or(u16::MAX);
        (l.normal, l.min_distance, l.max_distance) = snapshot.visibility(l)?;
        return Some(());
    }
    (l.descriptor, l.pick) = match pick {
        NO_PICK => snapshot.typical_descriptor(l)?,
        pick => {
            let o = l.observations.get(pick as usize)?;
            let descriptors: &[Descriptor] = &snapshot.key_frame(o.key_frame)?.frame.descriptors;
            (*descriptors.get(usize::from(o.feature))?, u16::try_from(pick).unwrap_or(u16::MAX))
        }
    };
    (l.octave, l.angle) = snapshot.octave_and_angle(l)?;
    (l.normal, l.min_distance, l.max_distance) = snapshot.visibility(l)?;
    Some(())
}
