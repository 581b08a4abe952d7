//! Pictures that repeat bit by bit: a camera or a driver that delivers its last picture again. The noise of a sensor makes no two
//! pictures equal, and one that is repeated looks to vision like a camera that rests.

use cairn_sensor::{FramePacket, GrayImage, Stamp};
use std::sync::Arc;

/// So many pictures repeat one before it is told: a source that doubles its pictures repeats each once.
const REPEATED: usize = 3;
/// For so long without an IMU that turns meanwhile, seconds.
const STILL_S: f64 = 1.0;
/// What an IMU turns meanwhile, radians and rad/s: more than the bias of a gyroscope makes of rest.
const TURNED_RAD: f64 = 0.05;
const TURNING_RAD_S: f64 = 0.05;

/// Whether the pictures of one camera change.
#[derive(Clone, Debug)]
pub(super) struct FrozenWatch {
    camera: usize,
    name: String,
    last: Option<Arc<GrayImage>>,
    /// The first of the equal pictures, how many repeat it, how far the IMU has turned since.
    since: Stamp,
    repeated: usize,
    turned_rad: f64,
    /// Whether the last picture repeats one although the IMU has turned.
    pub is_stale: bool,
    is_reported: bool,
}

impl FrozenWatch {
    pub fn new(camera: usize, name: &str) -> Self {
        let (name, since) = (name.to_owned(), Stamp(0));
        Self {
            camera,
            name,
            last: None,
            since,
            repeated: 0,
            turned_rad: 0.0,
            is_stale: false,
            is_reported: false,
        }
    }

    /// Whether the picture is repeated more often than by a source that delivers each several times.
    pub fn is_frozen(&self) -> bool {
        self.repeated >= REPEATED
    }

    /// Takes a packet; the doubt, once.
    pub fn packet(&mut self, packet: &FramePacket) -> Option<String> {
        let image = packet.images.get(self.camera)?;
        // Two pictures that differ do so within their first pixels. Plain ones are those of a covered lens: they say nothing.
        if self.last.as_ref().is_none_or(|last| **last != **image) || is_plain(image) {
            self.last = Some(image.clone());
            (self.since, self.repeated, self.turned_rad, self.is_stale) = (packet.stamp, 0, 0.0, false);
            return None;
        }
        self.repeated += 1;
        let steps = packet.imu.windows(2).map(|pair| pair[1].gyro.norm() * (pair[1].stamp - pair[0].stamp));
        self.turned_rad += steps.sum::<f64>();
        let seconds = packet.stamp - self.since;
        self.is_stale = self.turned_rad > TURNING_RAD_S * seconds;
        let turns = self.is_stale && self.turned_rad > TURNED_RAD;
        if self.is_reported || !self.is_frozen() || !(turns || seconds > STILL_S) {
            return None;
        }
        self.is_reported = true;
        let meanwhile = match turns {
            true => format!(", while the IMU turns by {:.2} rad", self.turned_rad),
            false => String::new(),
        };
        Some(format!(
            "the picture of {} is the same bit by bit for {seconds:.2} s{meanwhile}: the camera delivers its last one again",
            self.name
        ))
    }
}

/// Whether all pixels have one value.
fn is_plain(image: &GrayImage) -> bool {
    image.data().iter().all(|value| Some(value) == image.data().first())
}
