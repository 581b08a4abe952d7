//! The clocks of camera and IMU, and the readout of the rows, in the first second of one uncalibrated camera: by the flow of its
//! features, before there is a map. Skewed rows, and a gyroscope that is asked at the wrong time, make a turn look like parallax; a map
//! begun with those has depths of noise.
//!
//! In: frames in order. Out: [`FlowClocks`], once they are known.

use crate::flow::{FlowClocks, FlowPair, FlowPoint, flow_clocks};
use crate::shutter::Shutter;
use crate::start::match_within;
use cairn_geometry::So3;
use cairn_sensor::ImuSample;
use cairn_vision::{Frame, RectifiedCamera};
use std::sync::Arc;

/// Seconds of frames from which both are first estimated, between two attempts, and after which a map begins without.
const FIRST_S: f64 = 1.0;
const AGAIN_S: f64 = 0.25;
const LAST_S: f64 = 1.9;
/// Standard deviation with which the offset is known, seconds: within it a hand that turns the phone by 1 rad/s moves features by 4 px.
const MOST_SIGMA_S: f64 = 0.008;
/// Radius around where a feature was in the frame before, pixels: 2 rad/s at 30 frames a second.
const RADIUS_PX: f32 = 40.0;
/// Pairs of fewer points tell nothing.
const LEAST_POINTS: usize = 20;

/// What is collected.
#[derive(Clone, Debug, Default)]
pub(crate) struct FirstClocks {
    pairs: Vec<FlowPair>,
    last: Option<Arc<Frame>>,
    tried_s: f64,
    ended: bool,
}

/// What is known after a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Known {
    /// Not yet: a map had better wait.
    NotYet,
    /// Just now.
    Now(FlowClocks),
    /// Nothing more will be.
    Ended,
}

impl FirstClocks {
    /// Takes a frame, with the readings up to it in the IMU's own clock.
    pub fn step<'a>(
        &mut self,
        camera: &RectifiedCamera,
        shutter: &Shutter,
        frame: &Arc<Frame>,
        samples: impl Iterator<Item = &'a ImuSample>,
        camera_from_imu: &So3,
    ) -> Known {
        if self.ended {
            return Known::Ended;
        }
        if let Some(last) = self.last.replace(frame.clone()) {
            self.pairs.push(pair(camera, shutter, &last, frame));
        }
        let span_s = self.pairs.first().map_or(0.0, |first| frame.stamp - first.stamps[0]);
        if span_s < FIRST_S || span_s - self.tried_s < AGAIN_S {
            return Known::NotYet;
        }
        self.tried_s = span_s;
        let samples: Vec<ImuSample> = samples.copied().collect();
        let found = flow_clocks(&self.pairs, &samples, camera_from_imu, camera.fx);
        if let Some(found) = found.filter(|found| found.offset_s[1] <= MOST_SIGMA_S) {
            *self = Self { ended: true, ..Self::default() };
            return Known::Now(found);
        }
        if span_s >= LAST_S {
            *self = Self { ended: true, ..Self::default() };
            return Known::Ended;
        }
        Known::NotYet
    }
}

/// What two consecutive frames show.
pub(crate) fn pair(camera: &RectifiedCamera, shutter: &Shutter, first: &Frame, second: &Frame) -> FlowPair {
    let ray = |frame: &Frame, i: usize| {
        let ray = camera.unproject(frame.px[i], 1.0);
        [ray.x, ray.y]
    };
    let point = |(i, j): (usize, usize)| FlowPoint {
        rays: [ray(first, i), ray(second, j)],
        rows: [shutter.row(first, i), shutter.row(second, j)],
    };
    let mut points: Vec<FlowPoint> = match_within(first, second, RADIUS_PX).into_iter().map(point).collect();
    if points.len() < LEAST_POINTS {
        points.clear();
    }
    FlowPair { stamps: [first.stamp, second.stamp], points }
}
