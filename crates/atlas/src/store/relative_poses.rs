//! Poses of key frames relative to earlier ones in a saved map, as depth measured them, in parts of 64 key frames each. Written where there are
//! any; programs that do not know them leave them out.
//!
//! ```text
//! relative poses 0, 1, .. n u32 | columns of n: row of the key frame u32, row of the earlier one u32 | 7 columns of n: pose f64
//! | 21 columns of n: upper triangle of the information f32, row by row
//! ```
//!
//! Information is rounded to single precision: a millionth of what it is.

use super::about::{numbers, pose};
use super::chunks;
use super::container::Parts;
use super::error::StoreError;
use super::layout::RELATIVE_POSES;
use super::wire::{Decoder, Encoder};
use crate::{KeyFrame, KeyFrameId, RelativePose};
use nalgebra::Matrix6;

/// Numbers of the upper triangle of an information.
pub(super) const UPPER: usize = 21;

/// The upper triangle of a symmetric matrix, row by row.
pub(super) fn upper(of: &Matrix6<f64>) -> [f64; UPPER] {
    let mut all = (0..6).flat_map(|i| (i..6).map(move |j| of[(i, j)]));
    std::array::from_fn(|_| all.next().unwrap_or_default())
}

/// The matrix of which this is the upper triangle.
pub(super) fn symmetric(upper: &[f64; UPPER]) -> Matrix6<f64> {
    let mut of = Matrix6::zeros();
    for ((i, j), v) in (0..6).flat_map(|i| (i..6).map(move |j| (i, j))).zip(upper) {
        (of[(i, j)], of[(j, i)]) = (*v, *v);
    }
    of
}

/// The part of a chunk of key frames; `None` where none of them has any.
pub(super) fn encode(chunk: &[&KeyFrame], row: impl Fn(KeyFrameId) -> u32) -> Option<Vec<u8>> {
    let all: Vec<(KeyFrameId, &RelativePose)> =
        chunk.iter().flat_map(|k| k.relative_poses.iter().map(|z| (k.id, z))).collect();
    if all.is_empty() {
        return None;
    }
    let mut e = Encoder::default();
    e.u32(all.len() as u32);
    e.column_u32(&all.iter().map(|(id, _)| row(*id)).collect::<Vec<_>>());
    e.column_u32(&all.iter().map(|(_, z)| row(z.from)).collect::<Vec<_>>());
    for i in 0..7 {
        e.column_f64(&all.iter().map(|(_, z)| numbers(&z.from_from_here)[i]).collect::<Vec<_>>());
    }
    for i in 0..UPPER {
        e.column_f32(&all.iter().map(|(_, z)| upper(&z.information)[i] as f32).collect::<Vec<_>>());
    }
    Some(e.0)
}

/// Gives key frames theirs.
pub(super) fn read(parts: &Parts, key_frames: &mut [KeyFrame]) -> Result<(), StoreError> {
    chunks::read(RELATIVE_POSES, parts, key_frames, read_chunk)
}

fn read_chunk(name: &str, bytes: &[u8], key_frames: &mut [KeyFrame]) -> Result<(), StoreError> {
    let mut d = Decoder::new(name, bytes);
    let n = d.u32()? as usize;
    let (rows, earlier) = (d.column_u32(n)?, d.column_u32(n)?);
    let mut poses: [Vec<f64>; 7] = Default::default();
    for column in &mut poses {
        *column = d.column_f64(n)?;
    }
    let mut information = Vec::new();
    for _ in 0..UPPER {
        information.push(d.column_f32(n)?);
    }
    d.end()?;
    for i in 0..n {
        let wrong =
            || StoreError::part(name, format!("the pose of row {} relative to another is invalid", rows[i]));
        let from = key_frames.get(earlier[i] as usize).map(|k| (k.id, k.map));
        let ((from, map), k) = from.zip(key_frames.get_mut(rows[i] as usize)).ok_or_else(wrong)?;
        let from_from_here = pose(std::array::from_fn(|k| poses[k][i])).ok_or_else(wrong)?;
        let information = symmetric(&std::array::from_fn(|k| f64::from(information[k][i])));
        let z = RelativePose { from, from_from_here, information };
        let rises = k.relative_poses.last().is_none_or(|before| before.from < from);
        let valid = from < k.id && map == k.map && rises && z.is_sound();
        valid.then(|| k.relative_poses.push(z)).ok_or_else(wrong)?;
    }
    Ok(())
}
