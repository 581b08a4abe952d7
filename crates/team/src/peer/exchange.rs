//! What a peer answers to messages: manifests of what another has not, requests for blocks, the blocks, and what is complete.

use super::message::{Body, Layer, Manifest, MapSubscription, Stamp, Topic};
use super::part::Part;
use super::{MAX_HELD_BYTES, OFFER_TICKS, Outgoing, Peer, To, holders};
use crate::{MAX_ROBOTS, Refused, RobotId};
use std::collections::BTreeMap;

impl Peer {
    /// Sends the manifests of what another peer has not or has older: of words, and of the maps that it wants.
    pub(super) fn compare(
        &mut self,
        from: RobotId,
        has: Vec<(Topic, Stamp)>,
        wants: MapSubscription,
    ) -> Vec<Outgoing> {
        let has: BTreeMap<Topic, Stamp> = has.into_iter().collect();
        let goes = |(robot, layer): &Topic| layer.goes_to(from, *robot, &wants);
        let is_newer = |topic: &Topic, part: &Part| has.get(topic).is_none_or(|s| *s < part.stamp);
        let newer = self.parts.iter().filter(|(topic, part)| goes(topic) && is_newer(topic, part));
        let (now, offered) = (self.ticks, &mut self.offered);
        let due = |(topic, part): &(&Topic, &Part)| {
            let last = offered.insert((from, **topic), (part.stamp, now));
            // A peer may still be fetching what it was offered.
            let waits = last.filter(|(stamp, tick)| *stamp == part.stamp && now - tick < OFFER_TICKS);
            waits.is_none_or(|last| {
                offered.insert((from, **topic), last);
                false
            })
        };
        let manifests: Vec<Manifest> = newer.filter(due).map(|(_, part)| part.manifest.clone()).collect();
        let heard = self.heard.entry(from).or_default();
        (heard.has, heard.wants) = (has, wants);
        manifests.into_iter().map(|m| self.message(To::Robot(from), Body::Manifest(m))).collect()
    }

    pub(super) fn learn(&mut self, from: RobotId, manifest: Manifest) -> Result<Vec<Outgoing>, Refused> {
        let (robot, topic, stamp) = (manifest.robot, manifest.topic(), manifest.stamp());
        if self.parts.get(&topic).is_some_and(|part| part.stamp >= stamp) {
            return Ok(Vec::new());
        }
        manifest.check()?;
        match self.keys.get(&robot) {
            Some(key) if *key != manifest.key => return Err(Refused::OtherKey(robot)),
            None if self.keys.len() >= MAX_ROBOTS => return Err(Refused::TooManyRobots),
            _ => {}
        }
        self.heard.entry(from).or_default().has.insert(topic, stamp);
        let is_own = robot == self.robot();
        if !is_own && !topic.1.goes_to(self.robot(), robot, &self.subscription) {
            return Ok(Vec::new());
        }
        // One that is newer still is waited for, unless everyone who had it has left.
        let better = |part: &Part| {
            part.stamp == stamp
                || part.stamp > stamp && !holders(&self.heard, self.ticks, topic, part.stamp).is_empty()
        };
        if self.coming.get(&topic).is_some_and(better) {
            return Ok(Vec::new());
        }
        let replaced = self.coming.get(&topic).map_or(0, |part| part.manifest.length());
        if self.held_bytes() - replaced + manifest.length() > MAX_HELD_BYTES {
            return Err(Refused::TooMuch(MAX_HELD_BYTES));
        }
        self.keys.insert(robot, manifest.key);
        if is_own && let Some(own) = self.parts.get(&topic) {
            // Published before this robot was started again: what it has now is newer.
            let own = own.clone();
            self.publish_as(topic.1, stamp.0.saturating_add(1), &own.blocks());
            return Ok(Vec::new());
        }
        let before = [self.parts.get(&topic), self.coming.get(&topic)];
        let before: Vec<&Part> = before.into_iter().flatten().collect();
        let part = Part::new(manifest, &before);
        self.coming.insert(topic, part);
        Ok(self.go_on(from, topic))
    }

    pub(super) fn serve(&self, to: RobotId, topic: Topic, stamp: Stamp, blocks: &[u16]) -> Vec<Outgoing> {
        let Some(part) = self.parts.get(&topic).filter(|part| part.stamp == stamp) else { return Vec::new() };
        let block = |index: &u16| {
            let bytes = part.block(*index)?.to_vec();
            Some(self.message(To::Robot(to), Body::Block { topic, stamp, index: *index, bytes }))
        };
        blocks.iter().filter_map(block).collect()
    }

    pub(super) fn put(
        &mut self,
        from: RobotId,
        topic: Topic,
        stamp: Stamp,
        index: u16,
        bytes: Vec<u8>,
    ) -> Result<Vec<Outgoing>, Refused> {
        // A block of an older version, or one that came before, is late and no fault.
        let Some(part) = self.coming.get_mut(&topic).filter(|part| part.stamp == stamp) else {
            return Ok(Vec::new());
        };
        if !part.put(index, bytes, self.ticks) {
            return Err(Refused::Inconsistent("a block is not the one that its robot signed"));
        }
        Ok(self.go_on(from, topic))
    }

    /// Takes a part over when it is complete; otherwise asks for the next blocks when those asked for have come.
    fn go_on(&mut self, from: RobotId, topic: Topic) -> Vec<Outgoing> {
        let Some(part) = self.coming.get_mut(&topic) else { return Vec::new() };
        if part.is_complete() {
            if let Some(part) = self.coming.remove(&topic) {
                self.parts.insert(topic, part);
                if topic.1 == Layer::Map {
                    self.fetched.insert(topic.0, self.ticks);
                }
            }
            return Vec::new();
        }
        let blocks = if part.has_room() { part.next(self.ticks) } else { Vec::new() };
        if blocks.is_empty() {
            return Vec::new();
        }
        let want = Body::Want { topic, stamp: part.stamp, blocks };
        vec![self.message(To::Robot(from), want)]
    }
}
