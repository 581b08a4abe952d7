//! What the guide has to say, before it is put into words.

use crate::facing::Facing;
use crate::maneuvers::Stairs;
use cairn_sensor::Stamp;

/// Within this distance of the start of a route the walker is at its start, metres.
pub(crate) const AT_START_M: f64 = 3.0;

/// Urgency of a cue; lower values come first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Priority {
    /// Interrupts everything: stop.
    Urgent,
    /// Interrupts: turn now.
    High,
    /// Waits until the voice is free.
    Normal,
    /// Said only if there is room.
    Low,
}

/// A step that a walker is told to make; the side is the walker's own, positive for left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// Half a metre back and to a side, halfway between the two: off the line, or before something in the way.
    BackAside(f64),
    /// A small one to a side, before something in the way.
    Aside(f64),
}

impl Step {
    /// To which side: positive for left.
    pub fn side(&self) -> f64 {
        let (Self::BackAside(left) | Self::Aside(left)) = self;
        *left
    }
}

/// Why the walker must stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// Tracking is lost: there is no current pose.
    TrackingLost,
    /// The last pose is too old.
    PoseStale,
    /// Pictures come, but too long after they were taken.
    PicturesLate,
    /// Nobody knows when the pictures were taken.
    AgeUnknown,
    /// An obstacle is ahead.
    Obstacle(Obstacle),
    /// The ground ends ahead: a step down, a kerb, stairs.
    Drop,
    /// The ground ahead was not seen.
    UnknownGround,
    /// Something is in the way, and no way past it is found.
    NoWayPast,
    /// The pose is in a unit of length that is not comparable with the route's: distances along it would be guesses.
    ScaleUncertain,
    /// Tracking is lost again and again at one place, or stays lost: looking round does not help.
    CannotRelocalise,
    /// With good tracking the walker is led to and fro, and comes no farther along the route.
    ToAndFro,
    /// A part of the system has stopped working.
    StageDied,
}

impl StopReason {
    /// Whether both are reasons of one kind, wherever the obstacle is by now.
    pub fn is_like(&self, other: &Self) -> bool {
        std::mem::discriminant(self) == std::mem::discriminant(other)
    }

    /// Whether it is the way that is in doubt, not the pose: the walker may be led past it.
    pub fn is_in_the_way(&self) -> bool {
        matches!(self, Self::Obstacle(_) | Self::Drop | Self::UnknownGround | Self::NoWayPast)
    }
}

/// Where an obstacle is, as the walker meets it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Obstacle {
    /// Centimetres ahead of the walker.
    pub ahead_cm: u16,
    /// Centimetres to his left (negative: to his right).
    pub left_cm: i16,
    /// It begins at chest or head height: a cane passes under it.
    pub overhead: bool,
}

impl Obstacle {
    /// From metres ahead and to the left.
    pub fn at(ahead_m: f64, left_m: f64, overhead: bool) -> Self {
        // Casts of floats saturate.
        Self { ahead_cm: (100.0 * ahead_m) as u16, left_cm: (100.0 * left_m) as i16, overhead }
    }
}

/// What comes next on the route.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Next {
    /// A turn, and the stairs that begin there.
    Turn {
        /// Radians, positive to the left.
        turn_rad: f64,
        /// Stairs directly after the turn.
        stairs: Option<Stairs>,
    },
    /// Stairs straight ahead.
    Stairs(Stairs),
    /// The end of the route.
    End,
}

/// How far it is to what comes next, and what follows soon after.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpcomingManeuver {
    /// Metres to `next`.
    pub distance_m: f64,
    /// What it is.
    pub next: Next,
    /// A second turn that is announced together with it: metres between the two, and the turn.
    pub then: Option<(f64, Next)>,
}

/// The first thing to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum First {
    /// Turn on the spot, radians, positive left.
    Turn(f64),
    /// Go on.
    Go(UpcomingManeuver),
}

/// What kind of cue it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CueKind {
    /// Guidance begins: the length of the route, and what to do first.
    Start {
        /// Metres of the whole route.
        total_m: f64,
        /// Metres that are left of it: fewer where the walker joins it on its way.
        left_m: f64,
        /// What to do first.
        first: First,
    },
    /// Guidance cannot begin: the walker is not on the route, and nobody walked the ground between.
    Away {
        /// Metres to its nearest point.
        distance_m: f64,
        /// Where that lies, radians, positive to the walker's left.
        bearing_rad: f64,
    },
    /// Tracking has recovered after a stop; what to do now.
    Resume(First),
    /// What was in the way is gone, or the walker stands where he can go on; what to do now.
    Clear(First),
    /// There is room beside what is in the way; the first thing to do to pass it.
    Around(First),
    /// A correction of the map contradicts what was said; what to do now.
    Correction(First),
    /// A turn or stairs are near.
    Approach(UpcomingManeuver),
    /// Turn now: at a corner of the route.
    TurnNow {
        /// Radians, positive left.
        turn_rad: f64,
        /// Stairs after it.
        stairs: Option<Stairs>,
    },
    /// Stairs begin here, straight ahead.
    StairsNow(Stairs),
    /// Turn on the spot because the heading is wrong. Radians, positive left.
    Rotate(f64),
    /// The turn is done; what comes next.
    StopTurning(UpcomingManeuver),
    /// Stop turning and stand: where the turn ends decides whether the way ahead is free.
    StandStill,
    /// Go on; what comes next. `check` asks a walker going backwards to look behind first.
    Go {
        /// What comes next.
        ahead: UpcomingManeuver,
        /// Look behind before moving.
        check: bool,
    },
    /// A small correction. Radians, positive left.
    Adjust(f64),
    /// Progress along a straight.
    Progress(UpcomingManeuver),
    /// Off the path: how far, where it lies, and the turn that leads back.
    OffPath {
        /// Distance to the path in metres.
        distance_m: f64,
        /// Where it lies from the walker's course, radians, positive left.
        bearing_rad: f64,
        /// The turn that leads back to it, radians, positive left; 0 when the walker already goes there.
        turn_rad: f64,
        /// Whether to stop and turn on the spot, or to bear that route while moving.
        on_spot: bool,
    },
    /// Going the wrong way; the turn that corrects it. Radians, positive left.
    WrongWay(f64),
    /// The walker has been standing for a while.
    Stopped {
        /// What comes next.
        ahead: UpcomingManeuver,
        /// The walker stands on the path.
        on_path: bool,
    },
    /// Walking backwards: the leg is over, stop and look behind.
    CheckBehind,
    /// One step.
    Step(Step),
    /// Walking backwards: too fast.
    SlowDown,
    /// Tracking is bridged (low confidence): go slowly.
    Weak,
    /// A waypoint was passed (sound only).
    Waypoint,
    /// On course (sound only).
    OnCourse,
    /// The walker turns as he was told (sound only). What is left of the turn, radians, positive left.
    Turning(f64),
    /// Back on the path (sound only).
    BackOnPath,
    /// He is stopped or waited for, and nothing was said for a while: the guide is still there (sound only).
    StillHere,
    /// The end was passed: stop, and turn to it.
    EndMissed {
        /// Metres to the end.
        distance_m: f64,
        /// The turn that faces it, radians, positive left.
        turn_rad: f64,
    },
    /// The end is reached; guidance ends.
    Arrived,
    /// Tracking stays lost: turn a little on the spot, so that the camera sees mapped views again. Radians,
    /// positive left.
    LookRound(f64),
    /// Stop at once.
    Stop(StopReason),
}

impl CueKind {
    /// Whether it is heard as a sound alone.
    pub fn is_sound(&self) -> bool {
        matches!(
            self,
            Self::Waypoint | Self::OnCourse | Self::Turning(_) | Self::BackOnPath | Self::StillHere
        )
    }
}

/// A short synthesised sound that goes with the words or replaces them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Earcon {
    /// Heading along the route.
    OnCourse,
    /// Off the path.
    OffCourse,
    /// A turn.
    Turn,
    /// A turn under way: the less is left of it, the higher.
    Turning,
    /// A waypoint was passed.
    Waypoint,
    /// The end.
    Arrival,
    /// Danger: stop.
    Stop,
}

/// One message for the walker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cue {
    /// When it became due.
    pub stamp: Stamp,
    /// How the camera is mounted relative to the walker.
    pub facing: Facing,
    /// What it is.
    pub kind: CueKind,
}

impl Cue {
    /// Its urgency.
    pub fn priority(&self) -> Priority {
        use CueKind::*;
        match self.kind {
            Stop(_) | LookRound(_) => Priority::Urgent,
            TurnNow { .. }
            | StairsNow(_)
            | Rotate(_)
            | Correction(_)
            | Clear(_)
            | Around(_)
            | StopTurning(_)
            | StandStill
            | Adjust(_)
            | OffPath { .. }
            | WrongWay(_)
            | CheckBehind
            | Step(_)
            | EndMissed { .. }
            | Arrived => Priority::High,
            Start { .. }
            | Away { .. }
            | Resume(_)
            | Approach(_)
            | Go { .. }
            | Stopped { .. }
            | SlowDown
            | Weak => Priority::Normal,
            Progress(_) | Waypoint | OnCourse | Turning(_) | BackOnPath | StillHere => Priority::Low,
        }
    }

    /// Whether it tells the walker where to go, from a pose. Stops, warnings and the search for a lost place do not.
    pub fn is_direction(&self) -> bool {
        use CueKind::*;
        !self.kind.is_sound()
            && !matches!(self.kind, Stop(_) | LookRound(_) | Arrived | CheckBehind | SlowDown | Weak)
    }

    /// The earcon that goes with it, if any.
    pub fn earcon(&self) -> Option<Earcon> {
        use CueKind::*;
        match self.kind {
            OnCourse | BackOnPath => Some(Earcon::OnCourse),
            Turning(_) => Some(Earcon::Turning),
            OffPath { .. } | WrongWay(_) | Step(_) => Some(Earcon::OffCourse),
            TurnNow { .. } | Rotate(_) | Correction(First::Turn(_)) | Around(_) | EndMissed { .. } => {
                Some(Earcon::Turn)
            }
            Waypoint => Some(Earcon::Waypoint),
            Arrived => Some(Earcon::Arrival),
            Stop(_) | LookRound(_) | StillHere => Some(Earcon::Stop),
            _ => None,
        }
    }
}
