//! A walk on generated frames through the real stages: tracking, mapping and closing, in lockstep, each timed.

use super::build::{Built, SPEED_MPS};
use super::world::Street;
use crate::store::camera;
use cairn_adjust::WindowConfig;
use cairn_atlas::{Atlas, KeyFrameId};
use cairn_mapping::{Accepted, Closed, Closer, CloserConfig, KeyFrameInput, Mapper, MapperConfig};
use cairn_tracking::{KeyFrameRequest, Tracker, TrackerConfig};
use std::time::Instant;

/// Frames a second.
pub const RATE_HZ: f64 = 10.0;

/// Times of a walk, seconds.
#[derive(Clone, Debug, Default)]
pub struct Times {
    /// Tracking of each frame.
    pub track_s: Vec<f64>,
    /// Mapping of each key frame.
    pub map_s: Vec<f64>,
    /// Closing of each key frame.
    pub close_s: Vec<f64>,
    /// Frames with a pose.
    pub tracked: usize,
}

/// The loop that was closed.
#[derive(Debug)]
pub struct Found {
    /// What closing made of it.
    pub closed: Closed,
    /// The key frame.
    pub key_frame: KeyFrameId,
    /// Its numbers.
    pub accepted: Accepted,
    /// Seconds to find, close and relax it.
    pub seconds: f64,
}

/// The stages and where the walker is.
pub struct Walk {
    /// The map.
    pub atlas: Atlas,
    /// Distance along the way, metres.
    pub along_m: f64,
    /// Tracking.
    pub tracker: Tracker,
    mapper: Mapper,
    closer: Closer,
}

impl Walk {
    /// A walk on from the end of a map.
    pub fn new(built: Built, features: usize) -> Self {
        let mut tracker = Tracker::new(camera(), features, RATE_HZ, TrackerConfig::default());
        if let Some(newest) = built.newest {
            tracker.map_created(built.atlas.latest(), newest);
        }
        let closer = Closer::new(camera(), CloserConfig::default(), WindowConfig::default());
        Self {
            atlas: built.atlas,
            along_m: built.along_m,
            tracker,
            mapper: Mapper::new(camera(), MapperConfig::default()),
            closer,
        }
    }

    /// Walks on for some metres, or until a loop is closed. The changes of a loop are not committed.
    pub fn go(&mut self, street: &mut Street, metres: f64, times: &mut Times) -> Option<Found> {
        let end = self.along_m + metres;
        while self.along_m < end {
            self.along_m += SPEED_MPS / RATE_HZ;
            let view = street.see(self.along_m, self.along_m / SPEED_MPS, 2);
            let snapshot = self.atlas.latest().clone();
            let start = Instant::now();
            let tracked = self.tracker.step(view.frame, &[], &snapshot, true, true);
            times.track_s.push(start.elapsed().as_secs_f64());
            times.tracked += usize::from(tracked.pose.is_some());
            drop(snapshot);
            self.mapper.note(&tracked.seen);
            let Some(key_frame) = self.map(tracked.request, times) else { continue };
            let start = Instant::now();
            let closed = self.closer.step(self.atlas.latest(), key_frame);
            let seconds = start.elapsed().as_secs_f64();
            match closed.verdicts.iter().find_map(|v| v.result.ok()) {
                Some(accepted) => return Some(Found { closed, key_frame, accepted, seconds }),
                None => times.close_s.push(seconds),
            }
        }
        None
    }

    fn map(&mut self, request: Option<KeyFrameRequest>, times: &mut Times) -> Option<KeyFrameId> {
        let KeyFrameRequest::Next { frame, landmarks, anchored, orientation_only, rescale, motion, .. } =
            request?
        else {
            return None;
        };
        let input = KeyFrameInput {
            frame: &frame,
            landmarks: &landmarks,
            reference: anchored.reference,
            reference_from_camera: anchored.reference_from_camera,
            imu: None,
            orientation_only,
            rescale,
            motion: motion.as_ref(),
            by_depth: false,
        };
        let start = Instant::now();
        let mapped = self.mapper.step(&mut self.atlas, &input, || false)?;
        times.map_s.push(start.elapsed().as_secs_f64());
        Some(mapped.key_frame)
    }

    /// Another closing stage, for a thread beside this one.
    pub fn closer(&self) -> Closer {
        Closer::new(camera(), CloserConfig::default(), WindowConfig::default())
    }
}
