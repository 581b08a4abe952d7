//! Who shares places with whom, as far as the words of their key frames say.

use crate::MapWords;
use cairn_team::RobotId;
use cairn_team::peer::Peer;
use std::collections::{BTreeMap, BTreeSet};

/// What the words of the robots say about each other.
#[derive(Debug, Default)]
pub struct MapOverlaps {
    /// The words of each robot as they came, and read; `None` where they cannot be read or compared.
    words: BTreeMap<RobotId, (Vec<u8>, Option<MapWords>)>,
    /// For every two robots whether they may share a place.
    overlaps: BTreeMap<(RobotId, RobotId), bool>,
}

impl MapOverlaps {
    /// Takes over words that are new and compares them with all others; returns what a user should know.
    ///
    /// Where words cannot be compared, as those of another vocabulary, the maps decide: the robots count as meeting.
    pub fn update(&mut self, peer: &Peer) -> Vec<String> {
        let mut lines = Vec::new();
        for (holding, bytes) in peer.words() {
            let robot = holding.robot;
            if self.words.get(&robot).is_some_and(|(before, _)| *before == bytes) {
                continue;
            }
            let words = MapWords::read(robot, &bytes);
            if let Err(why) = &words {
                lines.push(format!("words of robot {robot}: {why}; its map is fetched without them"));
            }
            self.words.insert(robot, (bytes, words.ok()));
            lines.extend(self.compare(robot));
        }
        lines
    }

    fn compare(&mut self, robot: RobotId) -> Vec<String> {
        let Some((_, words)) = self.words.get(&robot) else { return Vec::new() };
        let mut lines = Vec::new();
        for (other, (_, theirs)) in self.words.iter().filter(|(other, _)| **other != robot) {
            let pair = (robot.min(*other), robot.max(*other));
            let overlap = words.as_ref().zip(theirs.as_ref()).is_none_or(|(a, b)| a.overlaps(b));
            if self.overlaps.insert(pair, overlap).unwrap_or(false) != overlap {
                let what = if overlap { "may share places" } else { "share no place any more" };
                lines.push(format!("robots {} and {} {what}, by their words", pair.0, pair.1));
            }
        }
        lines
    }

    /// The words of a robot; `None` where there are none that can be compared.
    pub fn words(&self, robot: RobotId) -> Option<&MapWords> {
        self.words.get(&robot)?.1.as_ref()
    }

    /// Every two robots that may share a place.
    pub fn pairs(&self) -> BTreeSet<(RobotId, RobotId)> {
        self.overlaps.iter().filter(|(_, overlap)| **overlap).map(|(pair, _)| *pair).collect()
    }
}
