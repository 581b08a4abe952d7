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
/// A camera stands whose features move by less than this from frame to frame, pixels: there is nothing to compare, and none of these
/// seconds counts. Newcomers stand for two seconds before they set out (`bench run newcomers`).
const STANDS_PX: f64 = 1.0;
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
        let samples: Vec<ImuSample> = samples.copied().collect();
        if let Some(last) = self.last.replace(frame.clone()) {
            self.pairs.push(pair(camera, shutter, &last, frame));
        }
        if self.pairs.iter().all(|pair| stands(pair, camera.fx)) {
            (self.pairs, self.tried_s) = (Vec::new(), 0.0);
        }
        // Readings may begin later than the pictures.
        let since = self
            .pairs
            .first()
            .map(|first| first.stamps[0].max(samples.first().map_or(first.stamps[0], |s| s.stamp)));
        let span_s = since.map_or(0.0, |since| frame.stamp - since);
        if span_s < FIRST_S || span_s - self.tried_s < AGAIN_S {
            return Known::NotYet;
        }
        self.tried_s = span_s;
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

/// Whether half of what two frames show, or more, has not moved between them.
fn stands(pair: &FlowPair, focal_px: f64) -> bool {
    let moved = |point: &FlowPoint| {
        let [a, b] = point.rays;
        focal_px * (b[0] - a[0]).hypot(b[1] - a[1])
    };
    let still = pair.points.iter().filter(|point| moved(point) < STANDS_PX).count();
    !pair.points.is_empty() && 2 * still >= pair.points.len()
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

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_sensor::Stamp;

    #[test]
    fn a_camera_stands_whose_features_do_not_move() {
        let of = |moved_px: &[f64]| FlowPair {
            stamps: [Stamp::from_seconds(1.0), Stamp::from_seconds(1.1)],
            points: moved_px
                .iter()
                .map(|px| FlowPoint { rays: [[0.1, 0.2], [0.1, 0.2 + px / 450.0]], rows: [0.0; 2] })
                .collect(),
        };
        assert!(stands(&of(&[0.0, 0.4, 0.7]), 450.0));
        assert!(stands(&of(&[0.3, 0.2, 9.0]), 450.0), "somebody passes by");
        assert!(!stands(&of(&[2.0, 3.0, 0.2]), 450.0));
        assert!(!stands(&of(&[]), 450.0), "a plain wall is no stand");
    }
}
