//! Merging maps that are connected by verified pairs into one atlas, as `cairn map merge` does; only pairs that were verified are tried.

use super::{bytes_of, map_file};
use crate::shelf::Shelf;
use crate::task::{Merged, Result as Found};
use crate::{Digest, FleetError};
use cairn::{Config, MapOfFile, merge_maps_where};
use std::collections::BTreeSet;

/// Merges maps.
pub(crate) fn merge(
    shelf: &Shelf,
    maps: &[Digest],
    pairs: &[[(usize, usize); 2]],
    config: &Config,
) -> Result<Found, FleetError> {
    // Names are places in the list.
    let files = maps.iter().enumerate().map(|(n, map)| Ok((n.to_string(), map_file(shelf, *map)?)));
    let files = files.collect::<Result<Vec<_>, FleetError>>()?;
    let known: BTreeSet<[(usize, usize); 2]> = pairs.iter().flat_map(|[a, b]| [[*a, *b], [*b, *a]]).collect();
    let place = |name: &str| name.parse::<usize>().ok().filter(|n| *n < maps.len());
    let may = |a: &MapOfFile, b: &MapOfFile| {
        let named = |m: &MapOfFile| Some((place(&m.name)?, m.root));
        named(a).zip(named(b)).is_some_and(|(a, b)| known.contains(&[a, b]))
    };
    let merged = merge_maps_where(files, config, may).map_err(|e| {
        FleetError::new("merge", e, "leave out the recording, or map it with another configuration")
    })?;
    let parts: Vec<Vec<usize>> = (merged.maps.values())
        .map(|of| of.iter().filter_map(|m| place(&m.name)).collect::<BTreeSet<_>>().into_iter().collect())
        .collect();
    let apart = merged.attempts.iter().filter_map(|attempt| {
        let (a, b) = (place(&attempt.from.name)?, place(&attempt.into.name)?);
        let why = attempt.join.result.as_ref().err()?;
        let together = parts.iter().any(|part| part.contains(&a) && part.contains(&b));
        (!together).then(|| format!("{} and {}: {why}", maps[a], maps[b]))
    });
    let apart = apart.collect();
    let robots = (0..maps.len()).map(|n| {
        let of = merged.robots.get(&n.to_string());
        of.into_iter().flatten().map(|(was, is)| (*was, *is)).collect()
    });
    let robots: Vec<Vec<(u16, u16)>> = robots.collect();
    Ok(Found::Merged(Merged {
        map: shelf.keep(&bytes_of(&merged.file)?)?,
        robots,
        parts,
        key_frames: merged.file.snapshot.key_frame_count(),
        apart,
    }))
}
