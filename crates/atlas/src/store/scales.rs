//! How well the unit of length of each map is known, and how the camera is mounted on its IMU: two parts, each written only where there is
//! something to say. Programs that do not know them leave them out; a file without them says nothing of either
//! ([`crate::Snapshot::scale_of`]).
//!
//! ```text
//! scales    n u32 | of each map: row of its root u32, standard deviation of the logarithm of scale f64
//! imu       imu_from_camera, 7 f64 | n u32 | of each key frame that is known not to move: row u32, standard deviation of its velocity f64
//! ```

use super::about::{numbers, pose};
use super::container::Parts;
use super::error::StoreError;
use super::layout::{IMU, SCALES};
use super::wire::{Decoder, Encoder};
use crate::scale::is_sound_sigma;
use crate::{KeyFrame, KeyFrameId, MapId, Snapshot};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The parts that there are, with their names.
pub(super) fn encode(snapshot: &Snapshot, row: impl Fn(KeyFrameId) -> u32) -> Vec<(&'static str, Vec<u8>)> {
    let mut parts = Vec::new();
    if !snapshot.scale_sigmas.is_empty() {
        let mut e = Encoder::default();
        e.u32(snapshot.scale_sigmas.len() as u32);
        for (map, sigma_log) in snapshot.scale_sigmas.iter() {
            e.u32(row(map.root()));
            e.f64(*sigma_log);
        }
        parts.push((SCALES, e.0));
    }
    if let Some(imu_from_camera) = snapshot.imu_from_camera() {
        let mut e = Encoder::default();
        e.f64s(&numbers(imu_from_camera));
        let still =
            |k: &KeyFrame| Some((k.id, k.motion.as_ref()?.still_sigma.filter(|s| is_sound_sigma(*s))?));
        let still: Vec<_> = snapshot.key_frames().filter_map(still).collect();
        e.u32(still.len() as u32);
        for (id, sigma) in still {
            e.u32(row(id));
            e.f64(sigma);
        }
        parts.push((IMU, e.0));
    }
    parts
}

/// Takes over what the parts say.
pub(super) fn read(
    parts: &Parts,
    snapshot: &mut Snapshot,
    key_frames: &mut [KeyFrame],
) -> Result<(), StoreError> {
    let has = |name: &str| parts.names().any(|n| n == name);
    if has(SCALES) {
        let bytes = parts.get(SCALES)?;
        let mut d = Decoder::new(SCALES, &bytes);
        let mut sigmas = BTreeMap::new();
        for _ in 0..d.u32()? {
            let (row, sigma_log) = (d.u32()?, d.f64()?);
            let map = key_frames.get(row as usize).map(|k| MapId(k.id));
            let map = map.filter(|map| snapshot.maps.contains_key(map) && is_sound_sigma(sigma_log));
            let map =
                map.ok_or_else(|| d.wrong(format!("what is said of the map of row {row} is invalid")))?;
            sigmas.insert(map, sigma_log);
        }
        d.end()?;
        snapshot.scale_sigmas = Arc::new(sigmas);
    }
    if has(IMU) {
        let bytes = parts.get(IMU)?;
        let mut d = Decoder::new(IMU, &bytes);
        let mount = pose(d.f64s()?).ok_or_else(|| d.wrong("the pose of the camera is invalid"))?;
        for _ in 0..d.u32()? {
            let (row, sigma) = (d.u32()?, d.f64()?);
            let k = key_frames.get_mut(row as usize).filter(|_| is_sound_sigma(sigma));
            let motion = k.and_then(|k| k.motion.as_mut());
            let motion =
                motion.ok_or_else(|| d.wrong(format!("row {row} cannot be known to stand still")))?;
            motion.still_sigma = Some(sigma);
        }
        d.end()?;
        snapshot.imu_from_camera = Some(mount);
    }
    Ok(())
}
