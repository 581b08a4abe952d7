//! Decoding: from the parts of a file to a snapshot, versions 1 to 5; see `encode.rs` for the layout.
//!
//! A file may contain anything: every number is checked before it is used, and invalid content is an error
//! that names the part.

mod damage;
mod features;
mod key_frames;
mod landmarks;
mod shown;
#[cfg(test)]
mod tests;
mod words;

pub(super) use damage::Damage;
pub(super) use features::decode_features;
pub(super) use landmarks::{derive_all, observe};

use super::about::About;
use super::beside::both;
use super::container::Parts;
use super::error::StoreError;
use super::later::LaterFeatures;
use super::layout::{ATTACHED, CAMERAS, DESCRIPTORS, MapFile, NO_PICK, SHOWN};
use super::wire::Decoder;
use crate::{Paged, PlaceIndex, Snapshot};
use cairn_vision::{DESCRIPTOR_ID, Octaves};
use features::{bag_of, read_features};
use key_frames::{read_cameras, read_gone, read_key_frames, read_maps, read_motion, read_robots};
use landmarks::read_landmarks;
use shown::{Shown, read_shown};
use std::collections::BTreeMap;
use std::sync::Arc;
use words::{Owners, read_words};

/// Largest index of a key frame: some code iterates over all indices.
const MAX_KEY_FRAMES: u32 = 1 << 24;
/// Largest index of a landmark.
const MAX_LANDMARKS: u32 = 1 << 31;

/// Counts from the part "about".
struct Counts {
    key_frames: usize,
    landmarks: usize,
    gone: usize,
    maps: usize,
}

/// Key frames, landmarks and how the map was made cannot be done without. With `later`, features stay in the file.
pub(super) fn read(
    parts: &Parts,
    damage: &mut Damage,
    later: Option<&Arc<LaterFeatures>>,
) -> Result<MapFile, StoreError> {
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
    let (mut key_frames, features) = read_key_frames(parts, &snapshot, counts.key_frames)?;
    let maps = read_maps(parts, &mut snapshot, counts.maps, &key_frames);
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
    let readings = super::readings::read(parts, &mut key_frames);
    damage.or(readings, "what the IMU measured between key frames is forgotten", || {
        key_frames.iter_mut().filter_map(|k| k.motion.as_mut()).for_each(|m| m.imu_factor = None);
    })?;
    let related = super::relative_poses::read(parts, &mut key_frames);
    damage.or(related, "how key frames lie to each other by their depth is forgotten", || {
        key_frames.iter_mut().for_each(|k| k.relative_poses.clear());
    })?;
    let scales = super::scales::read(parts, &mut snapshot, &mut key_frames);
    damage.or(scales, "how well lengths are known and how the IMU is mounted is forgotten", || ())?;
    if parts.version >= 4 {
        let robots = read_robots(parts, &mut snapshot);
        damage.or(robots, "which robot created what is forgotten", || ())?;
    }
    if parts.names().any(|name| name == CAMERAS) {
        read_cameras(parts, &about.camera, &mut snapshot, &mut key_frames)?;
    }
    let (camera, octaves) = (&about.camera, snapshot.octaves);
    let total = features.iter().map(|n| *n as usize).sum();
    let has_shown = parts.names().any(|name| name == SHOWN);
    let ahead = match has_shown {
        true => {
            let ahead = read_shown(parts, octaves, total, counts.landmarks).map(Some);
            damage.or(ahead, "it is in the features, too", || None)?
        }
        false => None,
    };
    let whole = damage.count();
    let (shown, appearances) = match (later, ahead) {
        (Some(later), Some(Shown { rows, appearances })) => {
            later.give(&mut key_frames, camera, octaves, &features)?;
            snapshot.faults = later.faults();
            (rows, Some(appearances))
        }
        _ => (read_features(parts, camera, octaves, &mut key_frames, &features, damage)?, None),
    };
    let some_lost = damage.count() > whole;
    let frames = key_frames.iter().map(|k| k.frame.clone()).collect();
    let owners = Owners { ids: key_frames.iter().map(|k| k.id).collect(), frames, features };
    let read_landmarks = || {
        let mut landmarks = read_landmarks(parts, &snapshot, counts.landmarks)?;
        observe(&shown, &mut key_frames, &mut landmarks.0)?;
        Ok::<_, StoreError>(landmarks)
    };
    let read_words = || (!some_lost).then(|| read_words(parts, &owners, later));
    let (landmarks, words) = both(read_landmarks, read_words);
    let words = words.unwrap_or_else(|| Some(Err(StoreError::part("words", "they cannot be read"))));
    let (mut landmarks, mut picks) = landmarks?;
    let words = match words {
        Some(words) => damage.or(words.map(Some), "computed again", || None)?,
        None => {
            // The choice of an observation counts those that are lost.
            picks.fill(NO_PICK);
            landmarks.retain(|l| !l.observations.is_empty());
            None
        }
    };
    let (bags, places) = words.unwrap_or_else(|| {
        let bags: Vec<_> = key_frames.iter().map(bag_of).collect();
        let places = PlaceIndex::of(owners.ids.iter().copied().zip(bags.iter().map(Paged::shared)));
        (bags, places)
    });
    snapshot.places = places;
    key_frames.iter_mut().zip(bags).for_each(|(k, bag)| k.bag = bag);
    for k in key_frames {
        snapshot.made_by.add(&k);
        snapshot.key_frames.insert(k.id.index(), k);
    }
    let gone = read_gone(parts, &mut snapshot, counts.gone);
    damage.or(
        gone,
        "where removed key frames were is forgotten; routes that lead along them use their recorded poses",
        || (),
    )?;
    derive_all(&snapshot, &mut landmarks, &picks, appearances.as_deref())?;
    for l in landmarks {
        snapshot.landmarks.insert(l.id.index(), l);
    }
    check_priors(&mut snapshot, damage)?;
    if some_lost {
        snapshot.recount_covisible();
    }
    // What landmarks and key frames say of each other is made from one list: it need not be compared.
    snapshot.check_key_frames().map_err(|breach| StoreError::part("map", breach.to_string()))?;
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
pub(super) fn check_priors(snapshot: &mut Snapshot, damage: &mut Damage) -> Result<(), StoreError> {
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
