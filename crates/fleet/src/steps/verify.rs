//! Verifying a pair of map files by geometry: as `cairn map merge` decides, without joining them, and only where they overlap over more than a
//! room. What is the copy of a room looks like that room, so that a walk in one and a walk in the other agree in all that they show.

use super::map_file;
use crate::shelf::Shelf;
use crate::task::{Joined, Result as Found, Verified};
use crate::{Digest, FleetError};
use cairn::{Config, compare_files};

/// Compares two map files.
pub(crate) fn verify(
    shelf: &Shelf,
    a: Digest,
    b: Digest,
    overlap_m: f64,
    config: &Config,
) -> Result<Found, FleetError> {
    let named = |digest: Digest| Ok((digest.to_string(), map_file(shelf, digest)?));
    let mut found = Verified { joined: Vec::new(), apart: Vec::new() };
    let compared = match compare_files(named(a)?, named(b)?, config) {
        Ok(compared) => compared,
        Err(e) => {
            // Features of other octaves cannot be compared: these two are apart, and that is no failure.
            found.apart.push(e.to_string());
            return Ok(Found::Verified(found));
        }
    };
    let of_a = a.to_string();
    for c in compared {
        let agreed = match c.comparison.result {
            Ok(agreed) => agreed,
            Err(why) => {
                found.apart.push(why.to_string());
                continue;
            }
        };
        match c.overlap_m {
            Some(overlap) if overlap < overlap_m => {
                found.apart.push(format!(
                    "they agree over {overlap:.1} m only, which may be two rooms that look alike"
                ));
                continue;
            }
            None if overlap_m > 0.0 => {
                found.apart.push("they agree, but how far is not known: their lengths are not metres".into());
                continue;
            }
            _ => {}
        }
        let roots = if c.from.name == of_a { [c.from.root, c.into.root] } else { [c.into.root, c.from.root] };
        found.joined.push(Joined {
            roots,
            seams: [agreed.seams, agreed.left_out],
            support: [agreed.support.shown, agreed.support.expected],
            overlap_m: c.overlap_m,
        });
    }
    found.joined.sort_by_key(|j| j.roots);
    Ok(Found::Verified(found))
}
