//! How a run is supervised, what is told meanwhile, and what it gives.

use crate::Role;
use crate::message::{Anchored, Failure, Finished, LeftOut, Opened, SurfaceInput, Tracked};
use cairn_atlas::store::MapFile;
use cairn_engine::{CameraPoses, PoseTime};
use cairn_sensor::Stamp;
use cairn_session::Event;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

/// How a run is supervised.
pub struct Supervision {
    /// The command that starts a worker; its standard input and output are taken.
    pub command: Box<dyn Fn(Role) -> Command>,
    /// A worker that has not answered for so long is killed and started again.
    pub hang_limit: Duration,
    /// SLAM that has frames in hand and says nothing for so long is late: the guide says stop.
    pub late_limit: Duration,
    /// Whether there is a guide.
    pub guide: bool,
    /// Whether it records.
    pub records: bool,
    /// What surfaces are made of, if any are wanted.
    pub surfaces: Option<SurfaceInput>,
}

/// Hears what becomes of processes.
pub type EventSink = Arc<dyn Fn(RunEvent) + Send + Sync>;

/// What the supervisor tells while the run goes on.
#[derive(Debug)]
pub enum RunEvent<'a> {
    /// A process was started.
    Started {
        /// What it does.
        role: Role,
        /// Its process id.
        id: u32,
    },
    /// The source is open.
    Opened(&'a Opened),
    /// A frame is done.
    Tracked(&'a Tracked),
    /// A process died.
    Died(&'a Death),
    /// It is started again after this time, because it died again and again before it had done anything.
    Waits {
        /// What it does.
        role: Role,
        /// Seconds.
        delay_s: f64,
        /// How often it died in a row.
        times: usize,
    },
    /// SLAM goes on after a death.
    Resumed {
        /// Key frames of the map that it goes on with.
        key_frames: usize,
        /// Seconds since the death.
        after_s: f64,
    },
    /// Dense goes on after a death.
    DenseResumed {
        /// Key frames whose depth it has.
        key_frames: usize,
        /// Seconds since the death.
        after_s: f64,
    },
    /// Why there are no surfaces any more; the run goes on without.
    NoSurfaces(&'a Failure),
    /// SLAM has a pose again after a death.
    Relocalised {
        /// Frames without a pose since.
        frames: usize,
        /// Seconds since the death.
        after_s: f64,
        /// Seconds since it resumed.
        resumed_s: f64,
    },
    /// The guide has something to be heard.
    Said(&'a Event),
    /// A process died so often that it is not started again; the run goes on without it.
    GivenUp {
        /// What it did.
        role: Role,
    },
    /// A frame is left out, because SLAM died at it twice.
    LeftOut {
        /// Its number.
        number: u64,
    },
}

/// The end of a process that should not have ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Death {
    /// What it did.
    pub role: Role,
    /// How it ended.
    pub how: String,
    /// The frame that was first in line.
    pub at_frame: u64,
    /// Seconds since the run began.
    pub t_s: f64,
}

/// What a supervised run gave.
#[derive(Debug)]
pub struct Supervised {
    /// The source.
    pub opened: Opened,
    /// All frames in order.
    pub frames: Vec<Tracked>,
    /// The map at the end.
    pub map: MapFile,
    /// Loops closed and maps merged.
    pub finished: Finished,
    /// What could not be read, and what was overtaken in real time.
    pub left_out: LeftOut,
    /// The points of the recorded route, or why its file does not hold all of it; `None` where none is recorded, or who records
    /// it was given up.
    pub recorded: Option<Result<usize, cairn_session::NotSaved>>,
    /// Why there is no surface, and no depth in the map, although they were asked for.
    pub surfaces: Result<(), Failure>,
    /// Processes that died.
    pub deaths: Vec<Death>,
    /// Frames without a pose after each death of SLAM, and seconds from its death to the next pose.
    pub relocalised: Vec<(usize, f64)>,
}

impl Supervised {
    /// The poses of the first camera in all tracked frames: in the latest map, or as they were told.
    pub fn camera_poses(&self, time: PoseTime) -> CameraPoses {
        let (snapshot, camera) = (&self.map.snapshot, &self.map.about.camera);
        let pose_of = |f: &Tracked| {
            let pose = f.pose.as_ref().and_then(Anchored::pose)?;
            let (world_from_camera, metric) = match time {
                PoseTime::Live => (pose.world_from_camera, f.metric),
                PoseTime::Corrected => {
                    let (id, _) = snapshot.surviving_ancestor(pose.reference)?;
                    let metric = snapshot.is_metric_in(snapshot.key_frame(id)?.map, camera);
                    (snapshot.resolve(pose.reference, &pose.reference_from_camera)?, metric)
                }
            };
            Some((Stamp(f.stamp), world_from_camera, metric))
        };
        let poses = self.frames.iter().filter_map(pose_of).collect();
        CameraPoses { body_from_camera: camera.body_from_camera, poses }
    }
}
