//! The robot that agrees, with its link to the others, until nothing changes any more.

use super::shown;
use crate::interrupt;
use crate::output::{note, warn};
use cairn::AgreeingMap;
use cairn::geometry::Se3;
use cairn::team::peer::{Peer, RefusalLog};
use cairn_solve::graph::Rigid;
use cairn_team::{GraphPeer, RobotError, RobotId, Update};
use cairn_wire::Member;
use std::time::{Duration, Instant};

/// How long messages are exchanged before they are looked at.
const STEP: Duration = Duration::from_millis(200);
/// Poses that moved less than this (m, rad) do not move any more, after so long.
const STILL: f64 = 1e-4;
const STILL_FOR: Duration = Duration::from_secs(5);
/// Features that were asked for are waited for so long, while their robot is reached.
const ANSWER_WITHIN: Duration = Duration::from_secs(60);

/// A robot's graph, from a file or made of its map.
pub trait OwnGraph<G: Rigid<D>, const D: usize> {
    /// Takes in what has come and publishes what changed; also whether it may lead to more, and what a user should know.
    ///
    /// # Errors
    /// When the robot cannot continue.
    fn update(&mut self, peer: &mut Peer) -> Result<(Update, bool, Vec<String>), RobotError>;
    /// The graph among those of the others.
    fn graph(&self) -> &GraphPeer<G, D>;
    /// Whether the graphs of others are there, as far as is known who they are.
    fn is_complete(&self, peer: &Peer) -> bool;
    /// The robots of which features were asked for that have not come.
    fn waits_for(&self) -> Vec<RobotId> {
        Vec::new()
    }
}

impl<G: Rigid<D>, const D: usize> OwnGraph<G, D> for GraphPeer<G, D> {
    fn update(&mut self, peer: &mut Peer) -> Result<(Update, bool, Vec<String>), RobotError> {
        Ok((Self::update(self, peer)?, false, Vec::new()))
    }

    fn graph(&self) -> &GraphPeer<G, D> {
        self
    }

    fn is_complete(&self, _: &Peer) -> bool {
        self.robot().known().count() > 1
    }
}

impl OwnGraph<Se3, 6> for AgreeingMap {
    fn update(&mut self, peer: &mut Peer) -> Result<(Update, bool, Vec<String>), RobotError> {
        let update = Self::update(self, peer)?;
        Ok((update.graph, update.searched, update.lines))
    }

    fn graph(&self) -> &GraphPeer<Se3, 6> {
        Self::graph(self)
    }

    /// Words of others tell whether it shares places with them; who shares none needs nothing of them.
    fn is_complete(&self, peer: &Peer) -> bool {
        let words: Vec<_> = peer.words().map(|(holding, _)| holding.robot).collect();
        let needed = |robot: &_| peer.subscription().includes(*robot);
        let known = |robot: &_| self.graph().robot().known().any(|known| known == *robot);
        words.len() > 1 && words.iter().filter(|robot| needed(robot)).all(known)
    }

    fn waits_for(&self) -> Vec<RobotId> {
        Self::waits_for(self).keys().copied().collect()
    }
}

/// A robot with its link to the others.
pub struct Agreeing<R> {
    pub member: Member,
    pub robot: R,
    pub refusals: RefusalLog,
}

impl<R> Agreeing<R> {
    pub fn new(member: Member, robot: R) -> Self {
        Self { member, robot, refusals: RefusalLog::default() }
    }

    /// Goes on until nothing changes any more, a time is over, or a signal comes; whether nothing changed at the end.
    ///
    /// # Errors
    /// When the robot cannot continue.
    pub fn until_settled<G: Rigid<D>, const D: usize>(
        &mut self,
        time: Option<Duration>,
    ) -> Result<bool, RobotError>
    where
        R: OwnGraph<G, D>,
    {
        let began = Instant::now();
        let mut moved_at = began;
        let mut known = 0;
        loop {
            self.member.step(STEP).iter().for_each(|line| warn(line));
            let (update, is_new, lines) = self.robot.update(self.member.peer_mut())?;
            lines.iter().for_each(|line| note(line));
            for (robot, why) in &update.refused {
                if let Some(line) = self.refusals.line(why) {
                    warn(&format!("robot {}: {line}", shown(*robot)));
                }
            }
            let now = Instant::now();
            let robots = self.robot.graph().robot().known().count();
            if robots != known || is_new || update.moved > STILL {
                (known, moved_at) = (robots, now);
            }
            let is_complete = self.robot.is_complete(self.member.peer());
            let still_for = if self.is_answered::<G, D>() { STILL_FOR } else { ANSWER_WITHIN };
            let settled = is_complete && now - moved_at > still_for && self.is_heard();
            let is_over = time.is_some_and(|time| now - began >= time);
            if is_over || (settled && time.is_none()) || interrupt::requested() {
                return Ok(settled);
            }
        }
    }

    /// Whether nothing is on its way, and all that are reached have what this robot published last.
    fn is_heard(&self) -> bool {
        let peer = self.member.peer();
        let is_equal = |other| peer.is_up_to_date(other) && !peer.is_behind(other);
        !peer.is_fetching() && self.member.reached().all(is_equal)
    }

    /// Whether no robot that is reached was asked for what has not come.
    fn is_answered<G: Rigid<D>, const D: usize>(&self) -> bool
    where
        R: OwnGraph<G, D>,
    {
        let asked = self.robot.waits_for();
        !self.member.reached().any(|other| asked.contains(&other))
    }
}
