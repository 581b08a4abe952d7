//! What came of a walk with a phone.

use super::super::once::distance_to;
use cairn_geometry::{Vec2, Vec3};

/// One announcement that the walker heard.
#[derive(Clone, Debug)]
pub struct Spoken {
    /// Seconds since the phone was switched on.
    pub t_s: f64,
    /// Its text.
    pub words: String,
    /// The walker's true position, metres.
    pub at: Vec2,
}

/// What the page showed at a moment, and the truth.
#[derive(Clone, Debug)]
pub struct Live {
    /// Seconds since the phone was switched on, when the picture was taken.
    pub t_s: f64,
    /// The camera's position in the map's frame and unit.
    pub said: Vec3,
    /// Where it was, metres.
    pub truth: Vec3,
    /// The engine's phase, the features of the picture and how many agree with the pose, and the milliseconds of the step.
    pub state: String,
}

/// What came of a walk.
#[derive(Default)]
pub struct Walked {
    /// Announcements of the return.
    pub said: Vec<Spoken>,
    /// The walker's true path on the return, metres.
    pub path: Vec<Vec2>,
    /// The path walked out, and where it began.
    pub corners: Vec<Vec2>,
    /// Whether the guide announced arrival.
    pub told_arrival: bool,
    /// Why the guide gave up directions, when the walker stood for long because of that.
    pub stopped: Option<String>,
    /// Where the camera is said to be, and where it was, about once a second.
    pub live: Vec<Live>,
    /// Seconds from the first step until the map was metric.
    pub metric_after_s: Option<f64>,
    /// Seconds of the way out, and of the return.
    pub took_s: [f64; 2],
    /// Pictures sent; those that the server did not use in time; frames with a pose.
    pub pictures: usize,
    /// See `pictures`.
    pub dropped: u64,
    /// See `pictures`.
    pub tracked: u64,
    /// Directions that came too late and were held back by the page.
    pub withheld: usize,
    /// Connections that ended on the way.
    pub broken: usize,
    /// The lens that the server has found, as the page is told it, and after how many seconds.
    pub lens: Option<([f64; 2], f64)>,
    /// What the page showed besides.
    pub troubles: Vec<String>,
}

impl Walked {
    /// True distance from the start at the end, metres.
    pub fn error_m(&self) -> f64 {
        let start = self.corners.first().copied().unwrap_or_default();
        self.path.last().or(self.corners.last()).map_or(f64::NAN, |last| (last - start).norm())
    }

    /// Farthest from the path walked out, metres.
    pub fn farthest_off_m(&self) -> f64 {
        self.path.iter().map(|p| distance_to(&self.corners, *p)).fold(0.0, f64::max)
    }
}
