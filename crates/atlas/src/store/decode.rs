//! Decoding: from the parts of a file to a snapshot, versions 1 to 4; see `encode.rs` for the layout.
//!
//! A file may contain anything: every number is checked before it is used, and invalid content is an error
//! that names the part.

use super::about::{About, pose};
use super::container::Parts;
use super::encode::{CHUNK, DESCRIPTORS, NO_PICK};
use super::wire::Decoder;
use super::{ATTACHED, MapFile, StoreError};
use crate::names::{Names, Stretch, Stretches};
use crate::{
    InertialState, KeyFrame, KeyFrameId, Landmark, LandmarkId, MapId, MapPrior, Observation, PlaceIndex,
    RobotId, Snapshot,
};
use cairn_geometry::{Sim3, Vec3};
use cairn_inertial::Bias;
use cairn_sensor::Stamp;
use cairn_vision::bow::{BagOfWords, Vocabulary, WordId};
use cairn_vision::{DESCRIPTOR_ID, Descriptor, Frame, Octaves, RectifiedCamera};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Largest index of a key frame: some code iterates over all indices.
const MAX_KEY_FRAMES: u32 = 1 << 24;
/// Largest index of a landmark.
const MAX_LANDMARKS: u32 = 1 << 31;
/// Features of one frame, at most.
const MAX_FEATURES: u32 = 65_535;

/// Counts from the part "about".
struct Counts {
    key_frames: usize,
    landmarks: usize,
    gone: usize,
    maps: usize,
}

/// What happens when a part is damaged.
pub(super) enum Damage<'a> {
    /// It is an error.
    Refuse,
    /// What can be done without is left out, with a note of what is lost.
    LeaveOut(&'a mut Vec<String>),
}

impl Damage<'_> {
    /// The result, or what stands for it where the part is damaged.
    fn or<T>(
        &mut self,
        result: Result<T, StoreError>,
        loss: &str,
        instead: impl FnOnce() -> T,
    ) -> Result<T, StoreError> {
        match (result, self) {
            (Err(e), Self::LeaveOut(lost)) => {
                lost.push(format!("{e}: {loss}"));
                Ok(instead())
            }
            (result, _) => result,
        }
    }

    fn count(&self) -> usize {
        match self {
            Self::Refuse => 0,
            Self::LeaveOut(lost) => lost.len(),
        }
    }
}

/// Key frames, landmarks and how the map was made cannot be done without.
pub(super) fn read(parts: &Parts, damage: &mut Damage) -> Result<MapFile, StoreError> {
    match check_descriptors(parts) {
        Err(e @ StoreError::Descriptors { .. }) => return Err(e),
        damaged => damage.or(damaged, "taken for the descriptors of this program", || ())?,
    }
    let (about, mut snapshot, counts) = read_about(parts)?;
    // Each has features, which hardly compress: fewer bytes than this cannot be valid, but would take much
    // memory.
    if counts.key_frames as u64 > 1000 + parts.bytes / 64 {
        let why = format!("{} key frames cannot be in {} bytes", counts.key_frames, parts.bytes);
        return Err(StoreError::part("about", why));
    }
    let (mut key_frames, features) = read_key_frames(parts, &snapshot, &counts)?;
    let maps = read_maps(parts, &mut snapshot, &counts, &key_frames);
    damage.or(maps, "how the maps stand to each other is forgotten", || ())?;
    if snapshot.maps.is_empty() && counts.maps > 0 {
        snapshot.maps = Arc::new(key_frames.iter().map(|k| (k.map, None)).collect());
    }
    if parts.version >= 2 {
        let motion = read_motion(parts, &mut snapshot, &mut key_frames);
        damage.or(motion, "velocities, biases and which maps are upright are forgotten", || {
            key_frames.iter_mut().for_each(|k| k.motion = None);
        })?;
    }
    if parts.version >= 4 {
        let robots = read_robots(parts, &mut snapshot);
        damage.or(robots, "which robot created what is forgotten", || ())?;
    }
    let (mut landmarks, mut picks) = read_landmarks(parts, &snapshot, &counts)?;
    let whole = damage.count();
    let shown = read_features(parts, &about.camera, snapshot.octaves, &mut key_frames, &features, damage)?;
    let some_lost = damage.count() > whole;
    observe(&shown, &mut key_frames, &mut landmarks)?;
    if some_lost {
        // The choice of an observation counts those that are lost.
        picks.fill(NO_PICK);
        landmarks.retain(|l| !l.observations.is_empty());
        key_frames.iter_mut().for_each(|k| k.bag = bag_of(k));
    } else {
        let words = read_words(parts, &mut key_frames);
        damage.or(words, "computed again", || key_frames.iter_mut().for_each(|k| k.bag = bag_of(k)))?;
    }
    snapshot.places = PlaceIndex::of(key_frames.iter().map(|k| (k.id, &*k.bag)));
    for k in key_frames {
        snapshot.key_frames.insert(k.id.index(), k);
    }
    let gone = read_gone(parts, &mut snapshot, &counts);
    damage.or(
        gone,
        "where removed key frames were is forgotten; routes that lead along them use their recorded poses",
        || (),
    )?;
    for (l, pick) in landmarks.iter_mut().zip(picks) {
        derive(&snapshot, l, pick)
            .ok_or_else(|| StoreError::part("landmarks", format!("{:?} cannot be derived", l.id)))?;
    }
    for l in landmarks {
        snapshot.landmarks.insert(l.id.index(), l);
    }
    check_priors(&mut snapshot, damage)?;
    if some_lost {
        snapshot.recount_covisible();
    }
    snapshot.check().map_err(|breach| StoreError::part("map", breach))?;
    let mut attached = BTreeMap::new();
    for name in parts.names() {
        if let Some(short) = name.strip_prefix(ATTACHED)
            && let Some(bytes) = damage.or(parts.get(name).map(Some), "left out", || None)?
        {
            attached.insert(short.to_owned(), bytes);
        }
    }
    Ok(MapFile { snapshot, about, attached })
}

/// Checks that the priors of maps refer to key frames.
fn check_priors(snapshot: &mut Snapshot, damage: &mut Damage) -> Result<(), StoreError> {
    let mut maps = (*snapshot.maps).clone();
    let mut changed = false;
    for (map, prior) in &mut maps {
        if prior.as_ref().is_some_and(|prior| snapshot.surviving_ancestor(prior.to).is_none()) {
            let why = format!("the prior of {map:?} refers to no key frame");
            damage.or(Err(StoreError::part("worlds", why)), "the prior is left out", || ())?;
            (*prior, changed) = (None, true);
        }
    }
    if changed {
        snapshot.maps = Arc::new(maps);
    }
    Ok(())
}

/// Refuses features whose descriptors cannot be compared with those computed here.
fn check_descriptors(parts: &Parts) -> Result<(), StoreError> {
    if !parts.names().any(|name| name == DESCRIPTORS) {
        return Ok(());
    }
    let bytes = parts.get(DESCRIPTORS)?;
    let found = Decoder::new(DESCRIPTORS, &bytes).u32()?;
    if found == DESCRIPTOR_ID { Ok(()) } else { Err(StoreError::Descriptors { found, known: DESCRIPTOR_ID }) }
}

fn read_about(parts: &Parts) -> Result<(About, Snapshot, Counts), StoreError> {
    let bytes = parts.get("about")?;
    let mut d = Decoder::new("about", &bytes);
    let about = About::decode(&mut d)?;
    let octaves = Octaves { levels: d.u32()? as usize, factor: d.f64()? };
    let valid = (1..=64).contains(&octaves.levels) && octaves.factor > 1.0 && octaves.factor <= 4.0;
    if !valid {
        return Err(d.wrong(format!("the pyramid is invalid: {octaves:?}")));
    }
    let mut snapshot = Snapshot::with_octaves(octaves);
    snapshot.right_offset = d.f64()?;
    snapshot.version = d.u64()?;
    if !snapshot.right_offset.is_finite() {
        return Err(d.wrong("the disparity offset is not finite"));
    }
    let (next_key_frame, next_landmark) = (d.u32()?, d.u32()?);
    if next_key_frame > MAX_KEY_FRAMES || next_landmark > MAX_LANDMARKS {
        return Err(
            d.wrong(format!("{next_key_frame} key frames and {next_landmark} landmarks are too many"))
        );
    }
    (snapshot.next_key_frame, snapshot.next_landmark) = (next_key_frame as usize, next_landmark as usize);
    let mut count = || d.u32().map(|n| n as usize);
    let counts = Counts { key_frames: count()?, landmarks: count()?, gone: count()?, maps: count()? };
    d.end()?;
    Ok((about, snapshot, counts))
}

/// Key frames without features, and the number of features of each.
fn read_key_frames(
    parts: &Parts,
    snapshot: &Snapshot,
    counts: &Counts,
) -> Result<(Vec<KeyFrame>, Vec<u32>), StoreError> {
    let bytes = parts.get("key frames")?;
    let mut d = Decoder::new("key frames", &bytes);
    let n = counts.key_frames;
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

fn read_maps(
    parts: &Parts,
    snapshot: &mut Snapshot,
    counts: &Counts,
    key_frames: &[KeyFrame],
) -> Result<(), StoreError> {
    let bytes = parts.get("worlds")?;
    let mut d = Decoder::new("worlds", &bytes);
    let mut maps = BTreeMap::new();
    for _ in 0..counts.maps {
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

fn read_motion(
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
        let motion = InertialState { velocity: vector(0), bias, imu_factor: None };
        let valid = (0..9).all(|at| numbers[at][i].is_finite());
        let k = key_frames.get_mut(*row as usize).filter(|_| valid);
        let wrong = || StoreError::part("motion", format!("the motion of row {row} is invalid"));
        k.ok_or_else(wrong)?.motion = Some(motion);
    }
    snapshot.gravity_alignments = Arc::new(gravity_alignments);
    Ok(())
}

fn read_robots(parts: &Parts, snapshot: &mut Snapshot) -> Result<(), StoreError> {
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

fn read_gone(parts: &Parts, snapshot: &mut Snapshot, counts: &Counts) -> Result<(), StoreError> {
    let bytes = parts.get("gone")?;
    let mut d = Decoder::new("gone", &bytes);
    let mut before = 0;
    for _ in 0..counts.gone {
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

/// Landmarks without observations, and which observation gives each its descriptor.
fn read_landmarks(
    parts: &Parts,
    snapshot: &Snapshot,
    counts: &Counts,
) -> Result<(Vec<Landmark>, Vec<u32>), StoreError> {
    let bytes = parts.get("landmarks")?;
    let mut d = Decoder::new("landmarks", &bytes);
    let n = counts.landmarks;
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

/// Reads the features of the key frames; returns the landmark row (from 1) that each feature shows.
fn read_features(
    parts: &Parts,
    camera: &RectifiedCamera,
    octaves: Octaves,
    key_frames: &mut [KeyFrame],
    features: &[u32],
    damage: &mut Damage,
) -> Result<Vec<u32>, StoreError> {
    let (mut bytes, mut shown) = (Vec::new(), Vec::new());
    for (i, (chunk, features)) in key_frames.chunks_mut(CHUNK).zip(features.chunks(CHUNK)).enumerate() {
        let whole = shown.len();
        let count = chunk.len();
        let result = read_feature_part(parts, camera, octaves, i, chunk, features, (&mut bytes, &mut shown));
        let loss = format!("{count} key frames keep their poses, but show nothing");
        damage.or(result, &loss, || shown.truncate(whole))?;
    }
    Ok(shown)
}

/// Reads the features of a run of key frames, and appends the landmark rows that they show.
fn read_feature_part(
    parts: &Parts,
    camera: &RectifiedCamera,
    octaves: Octaves,
    i: usize,
    chunk: &mut [KeyFrame],
    features: &[u32],
    (bytes, shown): (&mut Vec<u8>, &mut Vec<u32>),
) -> Result<(), StoreError> {
    let name = format!("features {i}");
    parts.get_into(&name, bytes)?;
    let mut d = Decoder::new(&name, bytes);
    let n = features.iter().map(|n| *n as usize).sum();
    let raw_is_px = d.u8()? != 0;
    let px = [d.column_f32(n)?, d.column_f32(n)?];
    let raw = if raw_is_px { None } else { Some([d.column_f32(n)?, d.column_f32(n)?]) };
    let (angle, right_x, depth) = (d.column_f32(n)?, d.column_f32(n)?, d.column_f32(n)?);
    shown.append(&mut d.column_u32(n)?);
    let octave = d.bytes(n)?;
    let (descriptors, _) = d.bytes(n.saturating_mul(32))?.as_chunks::<32>();
    let seen = px.iter().chain(raw.iter().flatten()).chain([&angle]);
    if !seen.flatten().all(|v| v.is_finite()) {
        return Err(d.wrong("a pixel is not finite"));
    }
    if octave.iter().any(|o| usize::from(*o) >= octaves.levels) {
        return Err(d.wrong("the octave of a feature is outside the pyramid"));
    }
    d.end()?;
    let mut start = 0;
    for (k, features) in chunk.iter_mut().zip(features) {
        let span = start..start + *features as usize;
        let pairs = |c: &[Vec<f32>; 2]| -> Vec<[f32; 2]> {
            c[0][span.clone()].iter().zip(&c[1][span.clone()]).map(|(x, y)| [*x, *y]).collect()
        };
        let mut frame = empty_frame(k.frame.stamp);
        frame.px = pairs(&px);
        frame.raw = raw.as_ref().map_or_else(|| frame.px.clone(), pairs);
        frame.octave = octave[span.clone()].to_vec();
        frame.angle = angle[span.clone()].to_vec();
        frame.descriptors = descriptors[span.clone()].to_vec();
        frame.right_x = right_x[span.clone()].to_vec();
        frame.depth = depth[span.clone()].to_vec();
        frame.index(camera);
        k.landmarks = vec![None; frame.len()];
        k.frame = Arc::new(frame);
        start = span.end;
    }
    Ok(())
}

/// The words of a key frame, computed.
fn bag_of(k: &KeyFrame) -> Arc<BagOfWords> {
    Arc::new(Vocabulary::current().bag(&k.frame.descriptors))
}

/// Reads the words of the key frames: those of the file if this program has the vocabulary that made them,
/// else computes them.
fn read_words(parts: &Parts, key_frames: &mut [KeyFrame]) -> Result<(), StoreError> {
    let bytes = parts.get("words")?;
    let mut d = Decoder::new("words", &bytes);
    let vocabulary = Vocabulary::current();
    let same = d.u32()? == vocabulary.facts().checksum;
    let (words, nodes) = (d.column_u32(key_frames.len())?, d.column_u32(key_frames.len())?);
    let sum = |v: &[u32]| v.iter().map(|n| *n as usize).sum::<usize>();
    let word_steps = d.column_u32(sum(&words))?;
    let weights = d.column_f32(sum(&words))?;
    let node_steps = d.column_u32(sum(&nodes))?;
    let features = d.column_u16(sum(&nodes))?;
    let (mut word_at, mut node_at) = (0, 0);
    for (i, k) in key_frames.iter_mut().enumerate() {
        let word_span = word_at..word_at + words[i] as usize;
        let node_span = node_at..node_at + nodes[i] as usize;
        (word_at, node_at) = (word_span.end, node_span.end);
        let bag = if same {
            let weighted = sums(&word_steps[word_span.clone()]).zip(&weights[word_span]);
            let passed = sums(&node_steps[node_span.clone()]).zip(&features[node_span]);
            let words = weighted.map(|(word, weight)| (WordId(word), *weight)).collect();
            let nodes = passed.map(|(node, feature)| (node, *feature)).collect();
            BagOfWords::from_parts(words, nodes).map_err(|e| d.wrong(e.to_string()))?
        } else if words[i] > 0 {
            vocabulary.bag(&k.frame.descriptors)
        } else {
            BagOfWords::default()
        };
        let known = vocabulary.facts().nodes;
        let valid = bag.words().last().is_none_or(|(word, _)| word.0 < known)
            && bag
                .nodes()
                .iter()
                .all(|(node, feature)| *node < known && usize::from(*feature) < k.frame.len());
        if !valid {
            return Err(d.wrong(format!("the words of {:?} are not in the vocabulary", k.id)));
        }
        k.bag = Arc::new(bag);
    }
    d.end()
}

/// Rising numbers from their differences; an overflow of 32 bits wraps around and is then refused as not
/// rising.
fn sums(steps: &[u32]) -> impl Iterator<Item = u32> {
    steps.iter().scan(0u32, |sum, step| {
        *sum = sum.wrapping_add(*step);
        Some(*sum)
    })
}

fn empty_frame(stamp: Stamp) -> Frame {
    let mut frame = Frame::default();
    frame.stamp = stamp;
    frame
}

/// Connects key frames and landmarks by what the features show.
fn observe(shown: &[u32], key_frames: &mut [KeyFrame], landmarks: &mut [Landmark]) -> Result<(), StoreError> {
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

/// Derives what follows from the observations of a landmark.
fn derive(snapshot: &Snapshot, l: &mut Landmark, pick: u32) -> Option<()> {
    l.descriptor = match pick {
        NO_PICK => snapshot.typical_descriptor(l)?,
        pick => {
            let o = l.observations.get(pick as usize)?;
            let descriptors: &[Descriptor] = &snapshot.key_frame(o.key_frame)?.frame.descriptors;
            *descriptors.get(usize::from(o.feature))?
        }
    };
    (l.normal, l.min_distance, l.max_distance) = snapshot.visibility(l)?;
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::about::tests::about;
    use crate::store::container::PartsWriter;
    use crate::{Change, ChangeSet};
    use cairn_geometry::Se3;
    use std::io::Cursor;

    /// A map of one key frame, some features of which show landmarks.
    fn small() -> MapFile {
        let about = about();
        let mut frame = empty_frame(Stamp(7));
        for i in 0..40u8 {
            let px = [f32::from(i) * 16.0, f32::from(i) * 11.0];
            frame.px.push(px);
            frame.raw.push(px);
            frame.octave.push(i % 8);
            frame.angle.push(0.1);
            frame.descriptors.push(std::array::from_fn(|k| i.wrapping_mul(37).wrapping_add(91 * k as u8)));
            frame.depth.push(f32::NAN);
            frame.right_x.push(f32::NAN);
        }
        frame.index(&about.camera);
        let bag = Arc::new(Vocabulary::embedded().bag(&frame.descriptors));
        let key_frame =
            KeyFrame::new(KeyFrameId::FIRST, Arc::new(frame), Se3::identity(), None).with_bag(bag);
        let changes = vec![
            Change::AddKeyFrame(Box::new(key_frame)),
            Change::AddLandmark(LandmarkId::FIRST, Vec3::new(0.0, 0.0, 3.0)),
            Change::Observe(LandmarkId::FIRST, KeyFrameId::FIRST, 5),
        ];
        let snapshot = Snapshot::new().apply(&ChangeSet { base: 0, changes }).0;
        MapFile { snapshot, about, attached: BTreeMap::new() }
    }

    /// A file with one part changed, all checksums right.
    fn with_part(bytes: &[u8], name: &str, change: impl Fn(&mut Vec<u8>)) -> Vec<u8> {
        let parts = Parts::open(bytes, crate::store::VERSION).unwrap();
        let mut out = Cursor::new(Vec::new());
        let names = parts.names().map(String::from).collect();
        let mut writer = PartsWriter::begin(&mut out, 1, names).unwrap();
        for each in parts.names() {
            let mut plain = parts.get(each).unwrap();
            if each == name {
                change(&mut plain);
            }
            writer.put(&plain).unwrap();
        }
        writer.finish().unwrap();
        out.into_inner()
    }

    #[test]
    fn other_descriptors_are_refused_and_none_means_those_of_the_first_release() {
        let bytes = small().write().unwrap();
        let other = with_part(&bytes, DESCRIPTORS, |plain| plain[0] ^= 1);
        for read in [MapFile::read(&other), MapFile::salvage(&other).map(|(file, _)| file)] {
            assert!(matches!(read, Err(StoreError::Descriptors { .. })));
        }
    }

    #[test]
    fn words_of_another_vocabulary_are_recomputed() {
        let saved = small();
        let bytes = saved.write().unwrap();
        let other = with_part(&bytes, "words", |plain| {
            // Another vocabulary, and words that would be wrong in this one.
            plain[0] ^= 1;
            let end = plain.len();
            plain[end - 30..].fill(0);
        });
        let reloaded = MapFile::read(&other).unwrap();
        let (a, b) =
            (reloaded.snapshot.key_frames().next().unwrap(), saved.snapshot.key_frames().next().unwrap());
        assert!(!b.bag.is_empty() && a.bag == b.bag);
        let found = reloaded.snapshot.places().query(&b.bag, 1, |_| true);
        assert!(found.len() == 1 && found[0].1 > 0.999, "{found:?}");
        // The same damage to words of this vocabulary is refused.
        let wrong = with_part(&bytes, "words", |plain| {
            let end = plain.len();
            plain[end - 30..].fill(0xff);
        });
        assert!(MapFile::read(&wrong).unwrap_err().to_string().contains("part 'words'"));
    }

    #[test]
    fn impossible_counts_do_not_allocate() {
        let bytes = small().write().unwrap();
        // The counts of key frames, of landmarks, and of features of the first key frame, as large as
        // possible.
        let about = Parts::open(&bytes, crate::store::VERSION).unwrap().get("about").unwrap().len();
        for (part, at) in [("about", about - 16), ("about", about - 12), ("key frames", 12)] {
            let wrong = with_part(&bytes, part, |plain| plain[at..at + 4].fill(0xff));
            let message = MapFile::read(&wrong).unwrap_err().to_string();
            assert!(message.contains("part '"), "{message}");
        }
    }
}
