//! What key frames of pieces measured: told of a map, and given back to it.

use super::motion::{ImuHead, MAX_ALL, Motion, Readings};
use super::state::State;
use crate::scale::is_sound_sigma;
use crate::{ImuFactor, InertialState, KeyFrame, KeyFrameId, Snapshot};
use cairn_inertial::Preintegrated;
use cairn_sensor::ImuNoise;
use std::sync::Arc;

impl State {
    /// Adds motions and readings of a map, as they were known `before` where they hardly changed.
    pub(super) fn measure(&mut self, s: &Snapshot, before: &Self) {
        let Some(head) = self.head.imu.clone() else { return };
        let mut all = 0;
        for k in s.key_frames() {
            let Some(own) = self.key_frames.get_mut(&k.id.raw()) else { continue };
            let known = before.key_frames.get(&k.id.raw()).filter(|known| known.row.stamp == own.row.stamp);
            own.motion = Motion::of(k, known.and_then(|known| known.motion.as_ref()));
            let now = Readings::of(s, k, &head).filter(|now| all + now.values.len() <= MAX_ALL);
            let was = now.as_ref().and_then(|now| before.readings_since(k.id.raw(), now.since));
            let was = was.map(|(readings, _)| readings).filter(|_| before.head.imu == self.head.imu);
            own.readings = match (now, was) {
                (Some(now), Some(was)) if was.is_near(&now) => Some(was),
                (now, _) => now,
            };
            all += own.readings.as_ref().map_or(0, |r| r.values.len());
        }
    }

    /// The readings of a key frame since an earlier one, joined where key frames lie between, and these, the latest first.
    pub(super) fn readings_since(&self, id: u32, since: u32) -> Option<(Readings, Vec<u32>)> {
        let mut readings = self.key_frames.get(&id)?.readings.clone()?;
        let mut between = Vec::new();
        while readings.since > since {
            between.push(readings.since);
            readings = self.key_frames.get(&readings.since)?.readings.as_ref()?.then(&readings)?;
        }
        (readings.since == since).then_some((readings, between))
    }
}

/// Gives key frames their motions, of which `state` says what they are; `Err` names the first that cannot be.
pub(super) fn give(state: &State, key_frames: &mut [KeyFrame]) -> Result<(), KeyFrameId> {
    for i in 0..key_frames.len() {
        let (before, rest) = key_frames.split_at_mut(i);
        let k = &mut rest[0];
        let Some(of) = state.key_frames.get(&k.id.raw()) else { continue };
        let motion = match (&of.motion, &of.readings, &state.head.imu) {
            (None, None, _) => continue,
            (Some(motion), readings, Some(head)) => {
                with_factor(motion.state(), readings.as_ref(), head, before, k)
            }
            _ => None,
        };
        k.motion = Some(motion.ok_or(k.id)?);
    }
    Ok(())
}

/// A motion with its factor; `before` are the key frames before.
fn with_factor(
    mut motion: InertialState,
    readings: Option<&Readings>,
    head: &ImuHead,
    before: &[KeyFrame],
    k: &KeyFrame,
) -> Option<InertialState> {
    if k.other_camera.is_some() || motion.still_sigma.is_some_and(|sigma| !is_sound_sigma(sigma)) {
        return None;
    }
    let Some(r) = readings else { return Some(motion) };
    let since = KeyFrameId::from_raw(r.since)?;
    let from = &before[before.binary_search_by_key(&since, |k| k.id).ok()?];
    if from.map != k.map || !r.is_sound(head, from.stamp, k.stamp) {
        return None;
    }
    let [gyro, gyro_walk, accel, accel_walk] = *head.noises.get(r.noise as usize)?;
    let noise = ImuNoise { gyro, gyro_walk, accel, accel_walk };
    let sum = Arc::new(Preintegrated::of(noise, motion.bias, r.samples()));
    motion.imu_factor = Some(ImuFactor { since, sum });
    Some(motion)
}
