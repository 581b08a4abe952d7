//! Key frames without features, and what is told about them: maps, motion, robots, and those that were removed.

use super::features::empty_frame;
use crate::names::{Names, Stretch, Stretches};
use crate::store::about::{decode_camera, pose};
use crate::store::container::Parts;
use crate::store::error::StoreError;
use crate::store::layout::CAMERAS;
use crate::store::wire::Decoder;
use crate::{InertialState, KeyFrame, KeyFrameId, MapId, MapPrior, OtherCamera, RobotId, Snapshot};
use cairn_geometry::{Sim3, Vec3};
use cairn_inertial::Bias;
use cairn_sensor::Stamp;
use cairn_vision::RectifiedCamera;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Features of one frame, at most.
const MAX_FEATURES: u32 = 65_535;

/// Key frames without features, and the number of features of each.
pub(super) fn read_key_frames(
    parts: &Parts,
    snapshot: &Snapshot,
    count: usize,
) -> Result<(Vec<KeyFrame>, Vec<u32>), StoreError> {
    let bytes = parts.get("key frames")?;
    let mut d = Decoder::new("key frames", &bytes);
    let n = count;
    let (ids, parents, maps) = (d.column_u32(n)?, d.column_u32(n)?, d.column_u32(n)?);
    let (features, links, covisible) = (d.column_u32(n)?, d.column_u32(n)?, d.column_u32(n)?);
    let stamps = d.column_i64(n)?;
    let mut poses: [Vec<f64>; 7] = Default::default();
    for column in &mut poses {
        *column = d.column_f64(n)?;
    }
    let units = d.column_f64(n)?;
    let sum = |v: &[u32]| v.iter().map(|n| *n as usize).sum::<usize>();
    let all_links = d.column_u32(sum(&links))?;
    let (neighbours, shared) = (d.column_u32(sum(&covisible))?, d.column_u32(sum(&covisible))?);
    let wrong = |i: usize, why: &str| d.wrong(format!("row {i} {why}"));
    let id = |row: u32| ids.get(row as usize).and_then(|raw| KeyFrameId::from_raw(*raw));
    let (mut link_at, mut neighbour_at) = (0, 0);
    let mut key_frames: Vec<KeyFrame> = Vec::with_capacity(n);
    for i in 0..n {
        let own = KeyFrameId::from_raw(ids[i]).filter(|own| own.index() < snapshot.next_key_frame);
        let rises = key_frames.last().is_none_or(|before| own > Some(before.id));
        let own = own.filter(|_| rises).ok_or_else(|| wrong(i, "has an invalid id"))?;
        if features[i] > MAX_FEATURES {
            return Err(wrong(i, &format!("has {} features", features[i])));
        }
        let at = pose(std::array::from_fn(|k| poses[k][i])).ok_or_else(|| wrong(i, "has an invalid pose"))?;
        let parent = match parents[i].checked_sub(1) {
            Some(row) => Some(id(row).ok_or_else(|| wrong(i, "has an unknown parent"))?),
            None => None,
        };
        let frame = empty_frame(Stamp(stamps[i]));
        let mut k = KeyFrame::new(own, Arc::new(frame), at, parent);
        k.map = MapId(id(maps[i]).ok_or_else(|| wrong(i, "is in an unknown map"))?);
        k.unit = units[i];
        let own_rows = &all_links[link_at..link_at + links[i] as usize];
        k.links = own_rows
            .iter()
            .map(|row| id(*row))
            .collect::<Option<_>>()
            .ok_or_else(|| wrong(i, "has a loop with an unknown key frame"))?;
        if !k.links.is_sorted_by(|a, b| a < b) {
            return Err(wrong(i, "has loops out of order"));
        }
        link_at += links[i] as usize;
        let span = neighbour_at..neighbour_at + covisible[i] as usize;
        let own_rows = neighbours[span.clone()].iter().zip(&shared[span.clone()]);
        k.covisible = own_rows
            .map(|(row, count)| {
                id(*row).filter(|other| *other != own && *count > 0).map(|other| (other, *count))
            })
            .collect::<Option<_>>()
            .ok_or_else(|| wrong(i, "has an invalid neighbour"))?;
        if !k.covisible.is_sorted_by_key(|(id, n)| (std::cmp::Reverse(*n), *id)) {
            return Err(wrong(i, "has neighbours out of order"));
        }
        neighbour_at = span.end;
        key_frames.push(k);
    }
    d.end()?;
    Ok((key_frames, features))
}

pub(super) fn read_maps(
    parts: &Parts,
    snapshot: &mut Snapshot,
    count: usize,
    key_frames: &[KeyFrame],
) -> Result<(), StoreError> {
    let bytes = parts.get("worlds")?;
    let mut d = Decoder::new("worlds", &bytes);
    let mut maps = BTreeMap::new();
    for _ in 0..count {
        let root = d.u32()?;
        let root =
            key_frames.get(root as usize).ok_or_else(|| d.wrong(format!("there is no root {root}")))?.id;
        let map_prior = match d.u8()? {
            0 => None,
            _ => {
                let to = KeyFrameId::from_raw(d.u32()?).ok_or_else(|| d.wrong("a prior has no key frame"))?;
                let to_from_root = pose(d.f64s()?).ok_or_else(|| d.wrong("a prior has an invalid pose"))?;
                let [sigma, sigma_rad] = d.f64s()?;
                // Version 2 does not say how well scale is known: the unit of a map begun on the way was a rough guess.
                let [sigma_log_scale] = if parts.version >= 3 { d.f64s()? } else { [2.0] };
                if !(sigma.is_finite() && sigma_rad.is_finite() && sigma_log_scale.is_finite()) {
                    return Err(d.wrong("a prior is not finite"));
                }
                Some(MapPrior { to, to_from_root, sigma, sigma_rad, sigma_log_scale })
            }
        };
        if maps.insert(MapId(root), map_prior).is_some() {
            return Err(d.wrong("a map is listed twice"));
        }
    }
    d.end()?;
    snapshot.maps = Arc::new(maps);
    Ok(())
}

pub(super) fn read_motion(
    parts: &Parts,
    snapshot: &mut Snapshot,
    key_frames: &mut [KeyFrame],
) -> Result<(), StoreError> {
    let bytes = parts.get("motion")?;
    let mut d = Decoder::new("motion", &bytes);
    let mut gravity_alignments = BTreeMap::new();
    for _ in 0..d.u32()? {
        let (root, times) = (d.u32()?, d.u32()?);
        let map = key_frames.get(root as usize).map(|k| MapId(k.id));
        let map = map.filter(|w| times > 0 && snapshot.maps.contains_key(w));
        let map = map.ok_or_else(|| d.wrong(format!("row {root} is not a gravity-aligned map")))?;
        gravity_alignments.insert(map, times);
    }
    let n = d.u32()? as usize;
    if n > key_frames.len() {
        return Err(d.wrong(format!("{n} motions of {} key frames", key_frames.len())));
    }
    let rows = d.column_u32(n)?;
    let mut numbers = Vec::with_capacity(9);
    for _ in 0..9 {
        numbers.push(d.column_f64(n)?);
    }
    d.end()?;
    for (i, row) in rows.iter().enumerate() {
        let vector = |at: usize| Vec3::new(numbers[at][i], numbers[at + 1][i], numbers[at + 2][i]);
        let bias = Bias { gyro: vector(3), accel: vector(6) };
        let motion = InertialState { velocity: vector(0), bias, still_sigma: None, imu_factor: None };
        let valid = (0..9).all(|at| numbers[at][i].is_finite());
        let k = key_frames.get_mut(*row as usize).filter(|_| valid);
        let wrong = || StoreError::part("motion", format!("the motion of row {row} is invalid"));
        k.ok_or_else(wrong)?.motion = Some(motion);
    }
    snapshot.gravity_alignments = Arc::new(gravity_alignments);
    Ok(())
}

pub(super) fn read_robots(parts: &Parts, snapshot: &mut Snapshot) -> Result<(), StoreError> {
    let bytes = parts.get("robots")?;
    let mut d = Decoder::new("robots", &bytes);
    let mut stretches = |next: usize| {
        let mut read = Vec::new();
        for _ in 0..d.u32()? {
            let (first, robot, seq) = (d.u32()? as usize, d.u32()?, d.u32()?);
            let robot =
                RobotId::try_from(robot).map_err(|_| d.wrong(format!("there is no robot {robot}")))?;
            read.push(Stretch { first, robot, seq });
        }
        let read = Stretches(read);
        read.is_valid(next)
            .then_some(read)
            .ok_or_else(|| d.wrong("two ids would have one name, or one has none"))
    };
    let key_frames = stretches(snapshot.next_key_frame)?;
    let landmarks = stretches(snapshot.next_landmark)?;
    d.end()?;
    snapshot.names = Arc::new(Names { key_frames, landmarks });
    Ok(())
}

/// The cameras that are not the atlas's, and which key frame has which. Without them features mean nothing.
pub(super) fn read_cameras(
    parts: &Parts,
    camera: &RectifiedCamera,
    snapshot: &mut Snapshot,
    key_frames: &mut [KeyFrame],
) -> Result<(), StoreError> {
    let bytes = parts.get(CAMERAS)?;
    let mut d = Decoder::new(CAMERAS, &bytes);
    let mut others = Vec::new();
    for _ in 0..d.u8()? {
        let (sensor, other) = decode_camera(&mut d)?;
        let focal_ratio = other.fx / camera.fx;
        if !(focal_ratio.is_finite() && focal_ratio > 0.0) {
            return Err(d.wrong("a focal length is beyond all measure"));
        }
        others.push(Arc::new(OtherCamera { sensor, camera: other, focal_ratio, imu_from_camera: None }));
    }
    for k in key_frames {
        if let Some(n) = usize::from(d.u8()?).checked_sub(1) {
            let other = others.get(n).ok_or_else(|| d.wrong(format!("{:?} has an unknown camera", k.id)))?;
            k.other_camera = Some(other.clone());
        }
    }
    d.end()?;
    snapshot.other_cameras = Arc::new(others);
    Ok(())
}

pub(super) fn read_gone(parts: &Parts, snapshot: &mut Snapshot, count: usize) -> Result<(), StoreError> {
    let bytes = parts.get("gone")?;
    let mut d = Decoder::new("gone", &bytes);
    let mut before = 0;
    for _ in 0..count {
        let (raw, parent) = (d.u32()?, d.u32()?);
        let rigid = pose(d.f64s()?);
        let scale = d.f64()?;
        let valid = raw > before && (raw as usize) <= snapshot.next_key_frame && parent < raw;
        let (Some(id), Some(parent), Some(rigid), true) =
            (KeyFrameId::from_raw(raw), KeyFrameId::from_raw(parent), rigid, valid)
        else {
            return Err(d.wrong(format!("number {raw} cannot be a removed key frame")));
        };
        let here = Sim3::new(rigid.rotation, rigid.translation, scale);
        let known = snapshot.key_frame(parent).is_some() || snapshot.removed.get(parent.index()).is_some();
        if !here.is_finite() || !known || snapshot.key_frame(id).is_some() {
            return Err(d.wrong(format!("{id:?} has no parent")));
        }
        snapshot.removed.insert(id.index(), (parent, here));
        before = raw;
    }
    d.end()
}
