//! A map that is to begin: the first of the two views it needs, and the frames that wait for it and get their poses from it.

use super::locator::Locator;
use crate::first_clocks::FirstClocks;
use crate::flow::FlowClocks;
use crate::setup::Setup;
use crate::start::Starter;
use crate::state::{AnchoredPose, KeyFrameRequest, Last, State};
use cairn_atlas::Snapshot;
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use std::collections::VecDeque;
use std::sync::Arc;

/// Frames buffered while there is no map, so that they get their poses afterwards.
const WAITING: usize = 64;

/// What is kept of the frames from which a map may begin.
#[derive(Debug)]
pub(crate) struct MapStart {
    setup: Setup,
    pair: Starter,
    /// Frames from before there was a map, oldest first.
    waiting: VecDeque<Arc<Frame>>,
    /// Clocks and rows before there is a map, and what was found of them.
    pub clocks: FirstClocks,
    pub flow: Option<FlowClocks>,
}

impl MapStart {
    pub fn new(setup: Setup) -> Self {
        Self {
            setup,
            pair: Starter::default(),
            waiting: VecDeque::new(),
            clocks: FirstClocks::default(),
            flow: None,
        }
    }

    /// Examines a frame: a request when a map can begin with it, else the progress so far.
    pub fn step(&mut self, frame: &Arc<Frame>) -> Result<KeyFrameRequest, State> {
        self.pair.step(&self.setup.camera, frame, self.setup.features)
    }

    /// No map is to begin at present.
    pub fn abandon(&mut self) {
        self.pair = Starter::default();
    }

    /// Examines a frame with which no map is to begin: features of the first one are followed through it.
    pub fn follow(&mut self, frame: &Arc<Frame>) {
        self.pair.follow(frame, self.setup.features);
    }

    /// The newest frame that waits.
    pub fn newest(&self) -> Option<&Arc<Frame>> {
        self.waiting.back()
    }

    /// All that was seen is to be examined anew: the frames that waited, oldest first.
    pub fn restart(&mut self) -> VecDeque<Arc<Frame>> {
        self.abandon();
        std::mem::take(&mut self.waiting)
    }

    /// Takes frames that wait for a map. Features are followed through all but the newest since `from`, when the readings begin.
    pub fn resume(&mut self, waiting: VecDeque<Arc<Frame>>, from: Option<Stamp>) {
        self.waiting = waiting;
        let before = self.waiting.len().saturating_sub(1);
        for seen in self.waiting.iter().take(before).filter(|seen| Some(seen.stamp) >= from) {
            self.pair.follow(seen, self.setup.features);
        }
    }

    /// Buffers a frame that may get its pose later.
    pub fn wait(&mut self, frame: &Arc<Frame>) {
        if self.waiting.len() == WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back(frame.clone());
    }

    /// Poses of the frames that have waited for a map, newest to oldest, as far as they can be tracked back from the last frame
    /// that has one.
    pub fn track_back(
        &mut self,
        locator: &mut Locator,
        last: Option<&Last>,
        snapshot: &Snapshot,
    ) -> Vec<(Stamp, AnchoredPose)> {
        let frames = std::mem::take(&mut self.waiting);
        let mut found = Vec::new();
        let (Some(last), false) = (last, frames.is_empty()) else { return found };
        let mut before =
            Last { frame: last.frame.clone(), landmarks: last.landmarks.clone(), anchored: last.anchored };
        for frame in frames.iter().rev() {
            let known = snapshot.key_frames().find(|k| k.frame.is(frame));
            let (anchored, landmarks) = match known {
                Some(k) => (AnchoredPose::at(k.id, k.world_from_camera), k.landmarks.clone()),
                None => {
                    let Some((anchored, landmarks)) = locator.next_to(&before, frame, snapshot) else {
                        break;
                    };
                    found.push((frame.stamp, anchored));
                    (anchored, landmarks)
                }
            };
            before = Last { frame: frame.clone(), landmarks, anchored };
        }
        found
    }
}
