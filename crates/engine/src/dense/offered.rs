//! Images of frames that may become key frames: kept until mapping has decided.

use cairn_sensor::{DepthImage, GrayImage, Stamp};
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
pub struct OfferedDepth(VecDeque<Offered>);

impl OfferedDepth {
    /// Keeps the images of a frame, later than those before.
    pub fn offer(&mut self, offered: Offered) {
        if self.0.len() >= MOST {
            self.0.pop_front();
        }
        self.0.push_back(offered);
    }

    /// The images of the frame of this stamp, which is a key frame now; those before it will be none.
    pub fn take(&mut self, stamp: Stamp) -> Option<Offered> {
        let at = self.0.iter().position(|o| o.stamp == stamp)?;
        self.0.drain(..=at).next_back()
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
        assert!(all.take(Stamp(1)).is_none() && all.0.len() == MOST);
        assert_eq!(all.take(Stamp(9)).map(|o| o.stamp), Some(Stamp(9)));
        assert!(all.take(Stamp(8)).is_none() && all.take(Stamp(9)).is_none());
        assert_eq!(all.take(Stamp(10)).map(|o| o.stamp), Some(Stamp(10)));
    }
}
