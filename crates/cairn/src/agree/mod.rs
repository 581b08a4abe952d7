//! A robot that agrees with others on one pose graph made of their saved maps, without sending the maps.
//!
//! In steps, each with fewer bytes of more key frames than the next (Lajoie et al., "DOOR-SLAM", 2020; Tian et al., "Kimera-Multi",
//! 2022): words of all key frames go to all; features of a few key frames that look like what another robot saw go to
//! that one ([`places`]), which verifies them against its map ([`loops`]) and asks for a few more that would contradict first if it was
//! elsewhere ([`checks`], [`search`]); then the pose graph of each map, condensed to what loops
//! touch, goes to those that share places ([`cairn_team::GraphPeer`]). Of two robots that of the greater number looks for loops; the
//! other one hears of them with its graph.
//!
//! There is no clock, thread or network here: a driver calls [`AgreeingMap::update`] now and then, and carries the messages of the peer.

mod checks;
mod graph;
mod information;
mod loops;
mod places;
mod search;

pub use graph::{MapGraphError, graph_of_map};

use crate::{MapOverlaps, in_reach, words_of_map};
use cairn_atlas::RobotId;
use cairn_atlas::store::MapFile;
use cairn_engine::Config;
use cairn_geometry::Se3;
use cairn_team::peer::{Holding, MapSubscription, Peer};
use cairn_team::{
    GraphPeer, JudgeConfig, PlaceRequests, Robot, RobotError, RobotGraph, Update, Viewpoint, Viewpoints,
};
use places::Given;
use search::{Asked, Outcome, Own};
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
    viewpoints: Viewpoints,
    /// The key frames whose features others get.
    given: Given,
    /// The version of what each robot asked for that was answered last.
    answered: BTreeMap<RobotId, u32>,
    /// The version of each robot's features that was searched last.
    searched: BTreeMap<RobotId, u32>,
    /// What this robot asked others for, and how many key frames have not come.
    asked: Asked,
    waiting: BTreeMap<RobotId, usize>,
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
        let at = |(seq, pose): (&u32, &Se3)| (*seq, Viewpoint::of(pose));
        let viewpoints = Viewpoints(own.poses.iter().map(at).collect());
        Ok(Self {
            config: config.clone(),
            file,
            own,
            graph,
            overlaps: MapOverlaps::default(),
            viewpoints,
            given: Given::default(),
            answered: BTreeMap::new(),
            searched: BTreeMap::new(),
            asked: Asked::default(),
            waiting: BTreeMap::new(),
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
        self.given.seqs.len()
    }

    /// The robots whose maps may share places with the own one, as far as features of so many further key frames that were asked for tell,
    /// which have not come.
    pub fn waits_for(&self) -> &BTreeMap<RobotId, usize> {
        &self.waiting
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
            update.searched = true;
        }
        self.give(peer, update.searched, &mut update.lines)?;
        update.searched |= self.search(peer, &mut update.lines)?;
        update.graph = self.graph.update(peer)?;
        Ok(update)
    }

    /// Adds to what it gives: key frames that look like what robots of greater numbers saw, by new words, and those that they ask
    /// for. What others have already stays.
    fn give(
        &mut self,
        peer: &mut Peer,
        words_are_new: bool,
        lines: &mut Vec<String>,
    ) -> Result<(), RobotError> {
        let (robot, before) = (peer.robot(), self.given.seqs.len());
        let Some(own) = self.overlaps.words(robot) else { return Ok(()) };
        if words_are_new {
            let pairs = self.overlaps.pairs();
            let others = pairs.iter().filter(|(a, _)| *a == robot);
            others.filter_map(|(_, b)| self.overlaps.words(*b)).for_each(|b| self.given.add_similar(own, b));
        }
        for (Holding { robot: by, version, .. }, requests) in peer.requests() {
            if self.answered.insert(by, version) == Some(version) {
                continue;
            }
            match requests {
                Ok(PlaceRequests(of)) => {
                    let seqs = of.get(&robot).cloned().unwrap_or_default();
                    lines.extend(self.given.add_requested(&self.viewpoints, by, &seqs));
                }
                Err(why) => lines.push(format!("what robot {by} asks for: {why}")),
            }
        }
        match self.given.seqs.len() == before {
            true => Ok(()),
            false => self.given.publish(&self.viewpoints, &self.file, peer),
        }
    }

    /// Searches loops to the robots whose features are new; whether there are any.
    fn search(&mut self, peer: &mut Peer, lines: &mut Vec<String>) -> Result<bool, RobotError> {
        let is_new = |h: &Holding| self.searched.get(&h.robot) != Some(&h.version);
        let new: Vec<Holding> = peer.places().filter(is_new).collect();
        for holding in &new {
            let robot = holding.robot;
            let words = [peer.robot(), robot].map(|robot| self.overlaps.words(robot));
            let [Some(own), Some(words)] = words else { continue };
            self.searched.insert(robot, holding.version);
            self.waiting.remove(&robot);
            let own =
                Own { file: &self.file, viewpoints: &self.viewpoints, words: own, config: &self.config };
            let bytes = peer.places_of(robot).unwrap_or_default();
            match self.asked.search(own, robot, words, &bytes) {
                Ok(Outcome::Loops(loops)) => self.graph.add_loops(loops)?,
                Ok(Outcome::Waits(missing)) => {
                    self.waiting.insert(robot, missing);
                }
                Ok(Outcome::Apart(why)) => lines.push(format!("no loop to robot {robot}: {why}")),
                Err(why) => lines.push(format!("features of robot {robot}: {why}")),
            }
            if !self.asked.0.0.is_empty() {
                peer.publish_requests(&self.asked.0).map_err(|_| RobotError::TooMuch(peer.robot()))?;
            }
            peer.compared_places(holding);
        }
        Ok(!new.is_empty())
    }
}
