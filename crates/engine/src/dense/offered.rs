//! Images of frames that may become key frames: kept until mapping has decided.

use crate::Output;
use cairn_dense::TemporalFilter;
use cairn_geometry::Se3;
use cairn_sensor::{DepthImage, DepthSensor, FramePacket, GrayImage, Stamp};
use std::collections::VecDeque;
use std::sync::Arc;

/// Images that wait at most; the oldest are dropped. At 640x480 one takes 0.6 MB.
const MOST: usize = 48;

/// The depth of a frame, and what its pixels look like where that is wanted.
pub struct Offered {
    /// When the frame was taken.
    pub stamp: Stamp,
    /// Its depth.
    pub depth: Arc<DepthImage>,
    /// The gray image of the same pixels.
    pub gray: Option<Arc<GrayImage>>,
}

/// The depth of frames that may become key frames.
#[derive(Default)]
pub struct OfferedDepth {
    waiting: VecDeque<Offered>,
    /// Averages it with that of the frames before, where the depth sensor is known.
    filter: Option<(TemporalFilter, Se3)>,
    /// Of the odometry in which these frames have their poses.
    segment: u32,
}

impl OfferedDepth {
    /// For the frames of a depth sensor.
    pub fn of(sensor: &DepthSensor) -> Self {
        let filter = TemporalFilter::new(sensor.camera, sensor.metres_per_unit);
        Self { filter: filter.map(|filter| (filter, sensor.body_from_depth)), ..Self::default() }
    }

    /// Takes the depth of a packet that the engine has processed, and keeps it where its frame may become a key frame, with the gray image
    /// of the same pixels.
    pub fn on_packet(&mut self, packet: &FramePacket, output: &Output, gray: Option<Arc<GrayImage>>) {
        let Some(depth) = &packet.depth else { return };
        let mut filtered = None;
        if let Some((filter, body_from_depth)) = &mut self.filter
            && let Some(odometry) = output.pose.as_ref().map(|pose| &pose.odometry)
        {
            if odometry.segment != self.segment {
                self.segment = odometry.segment;
                filter.clear();
            }
            let pose = odometry.odom_from_body.se3 * *body_from_depth;
            // Images of another size are refused where they are fused.
            filtered = output.key_frame_requested.then(|| filter.filter(&pose, depth).ok()).flatten();
            filter.add(pose, depth);
        }
        if output.key_frame_requested {
            let depth = filtered.map_or_else(|| depth.clone(), Arc::new);
            self.offer(Offered { stamp: packet.stamp, depth, gray });
        }
    }

    /// Keeps the images of a frame, later than those before.
    pub fn offer(&mut self, offered: Offered) {
        if self.waiting.len() >= MOST {
            self.waiting.pop_front();
        }
        self.waiting.push_back(offered);
    }

    /// The images of the frame of this stamp, which is a key frame now; those before it will be none.
    pub fn take(&mut self, stamp: Stamp) -> Option<Offered> {
        let at = self.waiting.iter().position(|o| o.stamp == stamp)?;
        self.waiting.drain(..=at).next_back()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oldest_are_dropped_and_those_before_a_key_frame_are_gone() {
        let mut all = OfferedDepth::default();
        let image = Arc::new(DepthImage::new(2, 2));
        for t in 0..MOST as i64 + 2 {
            all.offer(Offered { stamp: Stamp(t), depth: image.clone(), gray: None });
        }
        assert!(all.take(Stamp(1)).is_none() && all.waiting.len() == MOST);
        assert_eq!(all.take(Stamp(9)).map(|o| o.stamp), Some(Stamp(9)));
        assert!(all.take(Stamp(8)).is_none() && all.take(Stamp(9)).is_none());
        assert_eq!(all.take(Stamp(10)).map(|o| o.stamp), Some(Stamp(10)));
    }
}
