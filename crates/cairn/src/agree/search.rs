//! The search for loops to another robot: a few key frames that look alike propose how its map lies to the own one, further ones
//! that should show what is there confirm it or not.

use super::checks::{Seen, checks};
use super::loops::{Agreed, Compared, compare};
use super::places::Places;
use crate::MapWords;
use cairn_atlas::RobotId;
use cairn_atlas::store::MapFile;
use cairn_engine::Config;
use cairn_geometry::Se3;
use cairn_team::{Measurement, PlaceRequests, Viewpoints};
use std::collections::BTreeSet;

/// Of all key frames with features that should show the own map, the share that must. Where saved maps become one, 0.85 of them all are enough;
/// these are a few.
const SUPPORT: f64 = 0.95;
/// Of those that were asked for, so many must, and none may not.
const LEAST_SHOWN: usize = 3;

/// The own side of a search.
#[derive(Clone, Copy)]
pub struct Own<'a> {
    pub file: &'a MapFile,
    pub viewpoints: &'a Viewpoints,
    pub words: &'a MapWords,
    pub config: &'a Config,
}

/// What came of a search.
#[derive(Debug)]
pub enum Outcome {
    /// Why there are no loops.
    Apart(String),
    /// How many key frames must come before there are any.
    Waits(usize),
    /// Loops that are believed.
    Loops(Vec<Measurement<Se3, 6>>),
}

/// What has been asked for so far, of all robots.
#[derive(Debug, Default)]
pub struct Asked(pub PlaceRequests);

impl Asked {
    /// Searches loops to a robot that gave features; what this robot asks of others may change.
    ///
    /// # Errors
    /// A sentence: what the robot gave cannot be read, or does not fit the own map.
    pub fn search(
        &mut self,
        own: Own,
        robot: RobotId,
        words: &MapWords,
        bytes: &[u8],
    ) -> Result<Outcome, String> {
        let places = Places::read(robot, bytes).map_err(|why| why.to_string())?;
        let given = places.seqs();
        let agreed = match compare(own.file, places.file, own.config).map_err(|why| why.to_string())? {
            Compared::Agreed(agreed) => agreed,
            Compared::Apart(why) => return Ok(Outcome::Apart(why)),
        };
        // Of a robot that was started again with another map others are asked for.
        let exist = |asked: &&BTreeSet<u32>| asked.iter().all(|seq| places.viewpoints.0.contains_key(seq));
        let asked = match self.0.0.get(&robot).filter(exist) {
            Some(asked) => asked.clone(),
            None => {
                let own = Seen { viewpoints: own.viewpoints, words: own.words };
                let other = Seen { viewpoints: &places.viewpoints, words };
                match checks(own, other, &agreed.seams) {
                    Ok(chosen) => chosen,
                    Err(why) => return Ok(Outcome::Apart(why)),
                }
            }
        };
        let missing = asked.difference(&given).count();
        self.0.0.insert(robot, asked.clone());
        Ok(if missing > 0 { Outcome::Waits(missing) } else { decide(agreed, &asked) })
    }
}

/// Whether enough of the key frames that should show the own map do: of all, and without exception of those that were asked for.
fn decide(agreed: Agreed, asked: &BTreeSet<u32>) -> Outcome {
    let count = |of: &dyn Fn(&u32) -> bool| {
        let expected: Vec<bool> =
            agreed.expected.iter().filter(|(seq, _)| of(seq)).map(|(_, s)| *s).collect();
        [expected.iter().filter(|shows| **shows).count(), expected.len()]
    };
    let ([all_shown, all], [asked_shown, asked_all]) = (count(&|_| true), count(&|seq| asked.contains(seq)));
    let is_supported = all_shown as f64 >= SUPPORT * all as f64;
    if is_supported && asked_shown == asked_all && asked_shown >= LEAST_SHOWN {
        return Outcome::Loops(agreed.loops);
    }
    Outcome::Apart(format!(
        "of {all} key frames that would stand in this map {all_shown} show it, and {asked_shown} of the {} that were asked for \
         because they could contradict: parts look alike",
        asked.len()
    ))
}
