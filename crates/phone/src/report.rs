//! What came of an image, for the page.

use cairn_engine::{Output, State};
use cairn_sensor::Stamp;
use cairn_session::{Event, NotTracked, Said, earcon_name};
use serde::Serialize;

/// An image's pose and what is said at it; without an image, what is said meanwhile.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The time of the image, seconds in the page's clock.
    pub t_s: f64,
    /// The state of tracking; none where the image was refused or there was none.
    pub state: Option<State>,
    /// Position and orientation (x, y, z, w) of the camera in its map, where they are known.
    pub pose: Option<[f64; 7]>,
    /// Whether lengths are metres.
    pub metric: bool,
    /// Why the image was refused.
    pub refused: Option<String>,
    /// What is said now.
    pub said: Vec<Spoken>,
    /// Sounds that begin now, and the directions they come from, radians, positive to the left.
    pub sounds: Vec<(&'static str, f64)>,
}

/// Words that are said now.
#[derive(Clone, Debug, Serialize)]
pub struct Spoken {
    /// The words.
    #[serde(flatten)]
    pub said: Said,
    /// The time of the image that a direction is based on, seconds in the page's clock: the page gives no old directions.
    pub pose_s: Option<f64>,
}

impl Report {
    pub(crate) fn of(stamp: Stamp, output: &Result<Output, NotTracked>, events: Vec<Event>) -> Self {
        let mut report = Self::empty(stamp);
        report.take(events);
        match output {
            Ok(output) => {
                report.state = Some(output.state);
                report.metric = output.is_metric();
                report.pose = output.world_from_body().map(|pose| {
                    let (p, q) = (pose.se3.translation, pose.se3.rotation.quaternion().coords);
                    [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
                });
            }
            Err(why) => report.refused = Some(why.to_string()),
        }
        report
    }

    /// What is said without an image, where something is.
    pub(crate) fn of_events(now: Stamp, events: Vec<Event>) -> Option<Self> {
        let mut report = Self::empty(now);
        report.take(events);
        (!report.said.is_empty() || !report.sounds.is_empty()).then_some(report)
    }

    fn empty(stamp: Stamp) -> Self {
        let t_s = stamp.seconds();
        Self {
            t_s,
            state: None,
            pose: None,
            metric: false,
            refused: None,
            said: Vec::new(),
            sounds: Vec::new(),
        }
    }

    fn take(&mut self, events: Vec<Event>) {
        for event in events {
            match event {
                Event::Said(said) => {
                    let pose_s = said.pose.map(Stamp::seconds);
                    self.said.push(Spoken { said, pose_s });
                }
                Event::Sound(sound) => self.sounds.push((earcon_name(sound.earcon), sound.bearing_rad)),
            }
        }
    }
}
