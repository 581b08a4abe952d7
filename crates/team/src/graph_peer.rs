//! A robot that agrees on the pose graph of its team through a [`Peer`], as robots do that share maps.
//!
//! What a robot publishes is its message ([`crate::Message`]) with all that it shares, in pieces, of which those that stay the same are
//! not sent again. So it is signed, passed on by those who know both sides, kept when its robot has left, and asked for by who comes
//! late; of each robot only the newest message counts. There is no clock here: the driver calls [`GraphPeer::update`] now and then.

use crate::peer::{Holding, Peer};
use crate::robot::{Robot, RobotError};
use crate::{Measurement, Refused, RobotId};
use cairn_solve::graph::Rigid;
use std::collections::BTreeMap;

/// Poses that moved less than this since they were published, m and rad, are not published again: about what the rounding of messages
/// moves them by, a hundred metres from the first pose of a robot.
const NEWS: f64 = 1e-5;

/// What an update did.
#[derive(Clone, Debug, Default)]
pub struct Update {
    /// Whether anything new had come, so that the poses were computed again.
    pub stepped: bool,
    /// How far the own pose that moved most did, m and rad together.
    pub moved: f64,
    /// Whether a message was published.
    pub published: bool,
    /// Messages that were not believed, and why.
    pub refused: Vec<(RobotId, Refused)>,
}

/// What was published last.
#[derive(Clone, Debug)]
struct Published<G> {
    epoch: u32,
    rejected: Option<Vec<u32>>,
    poses: Vec<G>,
}

/// A robot of a team whose messages are carried by a [`Peer`] of the same number.
#[derive(Clone, Debug)]
pub struct GraphPeer<G, const D: usize> {
    robot: Robot<G, D>,
    /// The version of each robot's message that was received last.
    seen: BTreeMap<RobotId, u32>,
    published: Option<Published<G>>,
    steps: usize,
    has_new_loops: bool,
}

impl<G: Rigid<D>, const D: usize> GraphPeer<G, D> {
    /// A robot that has heard nothing yet.
    pub fn new(robot: Robot<G, D>) -> Self {
        Self { robot, seen: BTreeMap::new(), published: None, steps: 0, has_new_loops: false }
    }

    /// The robot.
    pub fn robot(&self) -> &Robot<G, D> {
        &self.robot
    }

    /// Adds loops that were found after it began ([`Robot::add_loops`]); what follows from them is computed in the next update.
    ///
    /// # Errors
    /// As [`Robot::add_loops`].
    pub fn add_loops(&mut self, loops: Vec<Measurement<G, D>>) -> Result<(), RobotError> {
        self.has_new_loops |= !loops.is_empty();
        self.robot.add_loops(loops).map(drop)
    }

    /// How often the poses were computed again because something new had come.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Takes in the messages that have come, computes the own poses again if there are any, and publishes what changed.
    ///
    /// # Errors
    /// When the robot cannot continue, or shares too much.
    pub fn update(&mut self, peer: &mut Peer) -> Result<Update, RobotError> {
        let mut update = Update { stepped: std::mem::take(&mut self.has_new_loops), ..Update::default() };
        let own = self.robot.id();
        let is_news = |h: &Holding| h.robot != own && self.seen.get(&h.robot) != Some(&h.version);
        let news: Vec<Holding> = peer.holdings().filter(is_news).collect();
        for Holding { robot, version, .. } in news {
            self.seen.insert(robot, version);
            match peer.part_of(robot).map(|bytes| self.robot.receive(robot, &bytes)) {
                Some(Ok(())) => update.stepped = true,
                Some(Err(why)) => update.refused.push((robot, why)),
                None => {}
            }
        }
        if update.stepped {
            let before = self.poses();
            self.robot.step()?;
            self.steps += 1;
            update.moved = most_moved(&before, &self.poses());
        }
        if self.has_news() {
            self.publish(peer)?;
            update.published = true;
        }
        Ok(update)
    }

    fn poses(&self) -> Vec<G> {
        self.robot.own_poses().map(|(_, pose)| *pose).collect()
    }

    fn has_news(&self) -> bool {
        self.published.as_ref().is_none_or(|said| {
            said.epoch != self.robot.epoch()
                || said.rejected != self.robot.rejected()
                || most_moved(&said.poses, &self.poses()) > NEWS
        })
    }

    fn publish(&mut self, peer: &mut Peer) -> Result<(), RobotError> {
        let (bytes, lengths) = self.robot.whole_message()?;
        peer.publish_pieces(&bytes, &lengths).map_err(|_| RobotError::TooMuch(self.robot.id()))?;
        let (epoch, rejected) = (self.robot.epoch(), self.robot.rejected());
        self.published = Some(Published { epoch, rejected, poses: self.poses() });
        Ok(())
    }
}

/// The greatest distance between two states of the same poses, m and rad together.
fn most_moved<G: Rigid<D>, const D: usize>(before: &[G], after: &[G]) -> f64 {
    let by = before.iter().zip(after).map(|(a, b)| a.inverse().compose(b).coordinates().norm());
    by.fold(0.0, f64::max)
}
