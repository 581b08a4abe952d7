//! A robot that agrees with others on one pose graph made of their saved maps, without sending the maps.
//!
//! In three steps, each with fewer bytes of more key frames than the next (Lajoie et al., "DOOR-SLAM", 2020; Tian et al., "Kimera-Multi",
//! 2022): words of all key frames go to all; features of a few key frames that look like what another robot saw go to
//! that one ([`places`]), which verifies them against its map ([`loops`]); then the pose graph of each map, condensed to what loops
//! touch, goes to those that share places ([`cairn_team::GraphPeer`]). Of two robots that of the greater number looks for loops; the
//! other one hears of them with its graph.
//!
//! There is no clock, thread or network here: a driver calls [`AgreeingMap::update`] now and then, and carries the messages of the peer.

mod graph;
mod information;
mod loops;
mod places;

pub use graph::{MapGraphError, graph_of_map};

use crate::{MapOverlaps, in_reach, own_map, words_of_map};
use cairn_atlas::RobotId;
use cairn_atlas::store::MapFile;
use cairn_atlas::store::pieces::Pieces;
use cairn_engine::Config;
use cairn_geometry::Se3;
use cairn_team::peer::{Holding, MapSubscription, Peer};
use cairn_team::{GraphPeer, JudgeConfig, Robot, RobotError, RobotGraph, Update};
use std::collections::{BTreeMap, BTreeSet};

/// What an update did.
#[derive(Debug, Default)]
pub struct AgreedUpdate {
    /// What became of the graph.
    pub graph: Update,
    /// Whether anything of other robots came that may lead to loops.
    pub searched: bool,
    /// What a user should know, a line each.
    pub lines: Vec<String>,
}

/// A robot with its saved map, of which the others get words, features of a few key frames, and its pose graph.
#[derive(Debug)]
pub struct AgreeingMap {
    config: Config,
    /// The greatest map with metres, alone.
    file: MapFile,
    own: RobotGraph<Se3, 6>,
    graph: GraphPeer<Se3, 6>,
    overlaps: MapOverlaps,
    /// The key frames whose features others get, and these features.
    given: BTreeSet<u32>,
    pieces: Pieces,
    /// The version of each robot's features that was searched last.
    searched: BTreeMap<RobotId, u32>,
}

/// Why a robot cannot agree.
#[derive(Debug, thiserror::Error)]
pub enum AgreeError {
    /// No graph can be made of its map.
    #[error(transparent)]
    Map(#[from] MapGraphError),
    /// Its graph is invalid, or it shares too much.
    #[error(transparent)]
    Graph(#[from] RobotError),
}

impl AgreeingMap {
    /// With a map that this robot made ([`crate::own_part`]); its words are published. `started` is greater each time that a robot is
    /// started. Without `judge`, every loop is believed.
    ///
    /// # Errors
    /// [`AgreeError`].
    pub fn new(
        file: MapFile,
        judge: Option<JudgeConfig>,
        started: u32,
        config: &Config,
        peer: &mut Peer,
    ) -> Result<Self, AgreeError> {
        let robot = peer.robot();
        let own = graph_of_map(robot, &file)?;
        let file = graph::greatest_metric(file)?;
        let graph = GraphPeer::new(Robot::new(&own, judge)?.starting_at(started));
        let (words, lengths) = words_of_map(robot, &file);
        peer.publish_words(&words, &lengths).map_err(|_| RobotError::TooMuch(robot))?;
        peer.subscribe(MapSubscription::Of(BTreeSet::new()));
        Ok(Self {
            config: config.clone(),
            file,
            own,
            graph,
            overlaps: MapOverlaps::default(),
            given: BTreeSet::new(),
            pieces: Pieces::default(),
            searched: BTreeMap::new(),
        })
    }

    /// Its graph among those of the others.
    pub fn graph(&self) -> &GraphPeer<Se3, 6> {
        &self.graph
    }

    /// Its own graph, as its map tells it.
    pub fn own(&self) -> &RobotGraph<Se3, 6> {
        &self.own
    }

    /// The map that its graph is of.
    pub fn file(&self) -> &MapFile {
        &self.file
    }

    /// How many of its key frames others get features of.
    pub fn places_given(&self) -> usize {
        self.given.len()
    }

    /// Takes in what has come, searches loops where there are new features, computes the own poses again, and publishes what changed.
    ///
    /// # Errors
    /// When the robot cannot continue, or shares too much.
    pub fn update(&mut self, peer: &mut Peer) -> Result<AgreedUpdate, RobotError> {
        let mut update = AgreedUpdate::default();
        if peer.has_new_words() {
            update.lines.extend(self.overlaps.update(peer));
            let pairs = self.overlaps.pairs();
            peer.subscribe(MapSubscription::Of(in_reach(peer.robot(), &pairs)));
            self.give(peer, &pairs)?;
            update.searched = true;
        }
        update.searched |= self.search(peer, &mut update.lines)?;
        update.graph = self.graph.update(peer)?;
        Ok(update)
    }

    /// Publishes the features of key frames that look like what robots of greater numbers saw. Features that others have stay.
    fn give(&mut self, peer: &mut Peer, pairs: &BTreeSet<(RobotId, RobotId)>) -> Result<(), RobotError> {
        let robot = peer.robot();
        let Some(own) = self.overlaps.words(robot) else { return Ok(()) };
        let others = pairs.iter().filter(|(a, _)| *a == robot).filter_map(|(_, b)| self.overlaps.words(*b));
        let before = self.given.len();
        for other in others {
            let wanted = places::candidates(own, other, &self.given);
            self.given.extend(wanted);
        }
        if self.given.len() == before {
            return Ok(());
        }
        let Some(snapshot) = places::only(&self.file.snapshot, robot, &self.given) else { return Ok(()) };
        let file = MapFile { snapshot, attached: BTreeMap::new(), ..self.file.clone() };
        let too_much = |_| RobotError::TooMuch(robot);
        self.pieces.add(&file).map_err(|_| RobotError::TooMuch(robot))?;
        peer.publish_places(self.pieces.bytes(), self.pieces.lengths()).map(drop).map_err(too_much)
    }

    /// Searches loops to the robots whose features are new; whether there are any.
    fn search(&mut self, peer: &Peer, lines: &mut Vec<String>) -> Result<bool, RobotError> {
        let is_new = |h: &Holding| self.searched.get(&h.robot) != Some(&h.version);
        let new: Vec<Holding> = peer.places().filter(is_new).collect();
        for Holding { robot, version, .. } in &new {
            self.searched.insert(*robot, *version);
            let bytes = peer.places_of(*robot).unwrap_or_default();
            let found = own_map(*robot, &bytes).map_err(|why| why.to_string()).and_then(|places| {
                loops::loops_between(&self.file, places, &self.config).map_err(|why| why.to_string())
            });
            match found {
                Ok(found) => {
                    lines.extend(found.apart.map(|why| format!("no loop to robot {robot}: {why}")));
                    self.graph.add_loops(found.loops)?;
                }
                Err(why) => lines.push(format!("features of robot {robot}: {why}")),
            }
        }
        Ok(!new.is_empty())
    }
}
