//! What the guide has to say, before it becomes words.

use crate::facing::Facing;
use crate::maneuvers::Stairs;
use cairn_sensor::Stamp;

/// How urgent something is; lower comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Priority {
    /// Interrupts everything: stop.
    Urgent,
    /// Interrupts: turn now.
    High,
    /// Waits its turn.
    Normal,
    /// Said if there is room.
    Low,
}

/// Why the walker must stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// The camera does not know where it is.
    TrackingLost,
    /// The last pose is too old.
    PoseStale,
    /// Something stands in the way.
    Obstacle,
    /// The ground ahead was not seen.
    UnknownGround,
    /// A part of the system died.
    StageDied,
}

/// What comes next on the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Next {
    /// A turn by so many radians (positive left), and stairs that begin there.
    Turn {
        /// Radians, positive to the left.
        turn_rad: f64,
        /// Stairs right after it.
        stairs: Option<Stairs>,
    },
    /// Stairs straight ahead.
    Stairs(Stairs),
    /// The end of the way.
    End,
}

/// How far it is to what comes next, and what follows soon after.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ahead {
    /// Metres to `next`.
    pub distance_m: f64,
    /// What it is.
    pub next: Next,
    /// A second turn that is told together with it: metres between the two, and the turn.
    pub then: Option<(f64, Next)>,
}

/// The first thing to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum First {
    /// Turn on the spot, radians, positive left.
    Turn(f64),
    /// Go on.
    Go(Ahead),
}

/// What kind of cue it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CueKind {
    /// Guidance begins: the length of the way, and what to do first.
    Start {
        /// Metres of the whole way.
        total_m: f64,
        /// What to do first.
        first: First,
    },
    /// Confidence has returned after a stop; what to do now.
    Resume(First),
    /// A turn or stairs are near.
    Approach(Ahead),
    /// Turn now: at a corner of the way.
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
    StopTurning(Ahead),
    /// Go on; what comes next. `check` asks a walker going backwards to look behind first.
    Go {
        /// What comes next.
        ahead: Ahead,
        /// Look behind before moving.
        check: bool,
    },
    /// A small correction. Radians, positive left.
    Adjust(f64),
    /// Progress along a straight.
    Progress(Ahead),
    /// Off the path: how far, where it lies, and the turn that leads back.
    OffPath {
        /// Distance to the path in metres.
        distance_m: f64,
        /// Where it lies from the walker's course, radians, positive left.
        bearing_rad: f64,
        /// The turn that leads back to it, radians, positive left; 0 when the walker already goes there.
        turn_rad: f64,
        /// Whether to stop for it, or bear that way while moving.
        on_spot: bool,
    },
    /// Going the wrong way; the turn that rights it. Radians, positive left.
    WrongWay(f64),
    /// Standing for a while.
    Stopped {
        /// What comes next.
        ahead: Ahead,
        /// The walker stands on the path.
        on_path: bool,
    },
    /// Backwards: the leg is over, stop and look behind.
    CheckBehind,
    /// Backwards: off the line; metres to the walker's own left (negative right).
    StepAside(f64),
    /// Backwards: too fast.
    SlowDown,
    /// Tracking is bridged: go slowly.
    Weak,
    /// A waypoint was passed (sound only).
    Waypoint,
    /// On course (sound only).
    OnCourse,
    /// Back on the path (sound only).
    BackOnPath,
    /// The end was passed by: stop, and turn to it.
    EndMissed {
        /// Metres to the end.
        distance_m: f64,
        /// The turn that faces it, radians, positive left.
        turn_rad: f64,
    },
    /// The end is reached; guidance ends.
    Arrived,
    /// Tracking stays lost: turn a little on the spot, so that the camera sees what the map knows. Radians,
    /// positive left.
    LookRound(f64),
    /// Stop at once.
    Stop(StopReason),
}

/// A short sound made by code, beside words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Earcon {
    /// Heading where the way goes.
    OnCourse,
    /// Off the path.
    OffCourse,
    /// A turn.
    Turn,
    /// A waypoint was passed.
    Waypoint,
    /// The end.
    Arrival,
    /// Danger.
    Stop,
}

/// Something to tell the walker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cue {
    /// When it became due.
    pub stamp: Stamp,
    /// How the walker stands to the camera.
    pub facing: Facing,
    /// What it is.
    pub kind: CueKind,
}

impl Cue {
    /// How urgent it is.
    pub fn priority(&self) -> Priority {
        use CueKind::*;
        match self.kind {
            Stop(_) | LookRound(_) => Priority::Urgent,
            TurnNow { .. }
            | StairsNow(_)
            | Rotate(_)
            | StopTurning(_)
            | Adjust(_)
            | OffPath { .. }
            | WrongWay(_)
            | CheckBehind
            | StepAside(_)
            | EndMissed { .. }
            | Arrived => Priority::High,
            Start { .. } | Resume(_) | Approach(_) | Go { .. } | Stopped { .. } | SlowDown | Weak => {
                Priority::Normal
            }
            Progress(_) | Waypoint | OnCourse | BackOnPath => Priority::Low,
        }
    }

    /// The sound that goes with it, if any.
    pub fn earcon(&self) -> Option<Earcon> {
        use CueKind::*;
        match self.kind {
            OnCourse | BackOnPath => Some(Earcon::OnCourse),
            OffPath { .. } | WrongWay(_) | StepAside(_) => Some(Earcon::OffCourse),
            TurnNow { .. } | Rotate(_) | EndMissed { .. } => Some(Earcon::Turn),
            Waypoint => Some(Earcon::Waypoint),
            Arrived => Some(Earcon::Arrival),
            Stop(_) | LookRound(_) => Some(Earcon::Stop),
            _ => None,
        }
    }
}
