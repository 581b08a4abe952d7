//! Which key frames of another robot would contradict first if its map did not lie as a few places say that it does.
//!
//! Places that were chosen because they look alike agree where rooms look alike. So the next ones are chosen by where they would
//! stand: key frames of the other robot within a metre of an own one that look the same way. Their words are there already, and must
//! look like what is there; of features those are asked for that look least like it.

use crate::MapWords;
use cairn_geometry::Se3;
use cairn_mapping::{INDEPENDENT_M, INDEPENDENT_RAD, SAME_PLACE_M, SAME_WAY_COS};
use cairn_team::{Viewpoint, Viewpoints};
use std::collections::BTreeSet;

/// Key frames that are asked for, at most.
const MOST_CHECKS: usize = 6;
/// Positions that both robots must have been at, looking the same way: twice as many as places must agree at. A shorter way can look like
/// another one from end to end (offices in which all rooms of a side look the same: 4; three walks of one house: 12 to 14).
const LEAST_POSITIONS: usize = 6;
/// A key frame looks like another one from this likeness on, and so many of those that coincide must (three walks in each of six houses: all, at 0.50
/// or more; rooms that look alike, where both robots leave them: 0.64 to 0.88 of them).
const ALIKE: f64 = 0.3;
const LEAST_ALIKE: f64 = 0.9;

/// A robot's key frames as others know them.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    pub viewpoints: &'a Viewpoints,
    pub words: &'a MapWords,
}

/// A key frame of another robot that would stand where this one was.
struct Coinciding<'a> {
    seq: u32,
    viewpoint: &'a Viewpoint,
    /// How much it looks like the own key frame there.
    likeness: f64,
}

/// The key frames of another robot that would stand where this one was, besides those that places were recognised in.
fn coinciding<'a>(own: Seen, other: Seen<'a>, seams: &[(u32, Se3)]) -> Vec<Coinciding<'a>> {
    let mut all = Vec::new();
    for (seq, viewpoint) in &other.viewpoints.0 {
        // By the place next to it in time: what both maps have drifted since does not count.
        let Some((at, own_from_other)) = seams.iter().min_by_key(|(at, _)| at.abs_diff(*seq)) else { break };
        if at == seq {
            continue;
        }
        let there = viewpoint.moved(own_from_other);
        let far = |v: &Viewpoint| (v.position - there.position).norm();
        let near =
            |(_, v): &(&u32, &Viewpoint)| far(v) < SAME_PLACE_M && v.axis.dot(&there.axis) > SAME_WAY_COS;
        let nearest = own.viewpoints.0.iter().filter(near).min_by(|a, b| far(a.1).total_cmp(&far(b.1)));
        let likeness = nearest.and_then(|(here, _)| other.words.likeness(*seq, own.words, *here));
        all.extend(likeness.map(|likeness| Coinciding { seq: *seq, viewpoint, likeness }));
    }
    all
}

/// At how many positions key frames are, counted from the first on.
fn positions(all: &[Coinciding]) -> usize {
    let mut counted: Vec<&Viewpoint> = Vec::new();
    for Coinciding { viewpoint: v, .. } in all {
        let is_apart = |other: &&Viewpoint| {
            (v.position - other.position).norm() > INDEPENDENT_M
                || v.axis.dot(&other.axis) < INDEPENDENT_RAD.cos()
        };
        if counted.iter().all(is_apart) {
            counted.push(v);
        }
    }
    counted.len()
}

/// The key frames to ask for: the one that looks least alike of each stretch of the way.
///
/// # Errors
/// Why the maps do not lie as the places say, or why nothing could tell.
pub fn checks(own: Seen, other: Seen, seams: &[(u32, Se3)]) -> Result<BTreeSet<u32>, String> {
    let all = coinciding(own, other, seams);
    let alike = all.iter().filter(|k| k.likeness >= ALIKE).count();
    if (alike as f64) < LEAST_ALIKE * all.len() as f64 {
        let n = all.len();
        return Err(format!(
            "of {n} further key frames that would stand in this map only {alike} look like it by their words: parts look alike"
        ));
    }
    let positions = positions(&all);
    if positions < LEAST_POSITIONS {
        let agree = seams.len();
        return Err(format!(
            "{agree} places agree, but by them both robots were at {positions} positions, where {LEAST_POSITIONS} are needed"
        ));
    }
    let stretches = all.chunks(all.len().div_ceil(MOST_CHECKS));
    let least = |stretch: &[Coinciding]| {
        stretch.iter().min_by(|a, b| a.likeness.total_cmp(&b.likeness)).map(|k| k.seq)
    };
    Ok(stretches.filter_map(least).collect())
}
