//! The life of the processes: who hangs is killed, who died is started again, and what SLAM dies at twice is left out.

use super::Run;
use crate::message::{Failure, Outcome, Tracked};
use crate::supervision::{Death, RunEvent};
use crate::{Role, SuperviseError};
use std::time::{Duration, Instant};

/// A process that has not begun its work after this time hangs: a large map takes seconds to read.
const BEGIN_LIMIT: Duration = Duration::from_secs(60);
/// The final adjustment of a map may take this long.
const FINISH_LIMIT: Duration = Duration::from_secs(900);
/// A frame at which SLAM has died so often is left out.
const DEATHS_AT_A_FRAME: usize = 2;

/// The deaths of a run, and how SLAM recovers from its own.
#[derive(Default)]
pub(super) struct Deaths {
    pub(super) all: Vec<Death>,
    /// The frame at which SLAM died last, and how often.
    at_frame: Option<(u64, usize)>,
    recovering: Option<Recovering>,
    /// Frames without a pose after each death of SLAM, and seconds until the next pose.
    pub(super) relocalised: Vec<(usize, f64)>,
}

/// SLAM since its last death, until it has a pose.
struct Recovering {
    died: Instant,
    resumed: Option<Instant>,
    frames: usize,
}

impl Deaths {
    /// A process of SLAM has begun; seconds since the one before died, if it did.
    pub(super) fn resumed(&mut self) -> Option<f64> {
        let r = self.recovering.as_mut()?;
        r.resumed = Some(Instant::now());
        Some(r.died.elapsed().as_secs_f64())
    }

    /// SLAM has done a frame; what is to be told, if it has recovered.
    pub(super) fn frame(&mut self, has_pose: bool) -> Option<RunEvent<'static>> {
        let r = self.recovering.as_mut()?;
        if !has_pose {
            r.frames += 1;
            return None;
        }
        let (after_s, since) = (r.died.elapsed().as_secs_f64(), r.resumed.unwrap_or(r.died));
        let (frames, resumed_s) = (r.frames, since.elapsed().as_secs_f64());
        self.relocalised.push((frames, after_s));
        self.recovering = None;
        Some(RunEvent::Relocalised { frames, after_s, resumed_s })
    }

    /// SLAM has died; how often at this frame in a row, if it had one in hand.
    fn slam_died(&mut self, at: Option<u64>) -> usize {
        let before = self.recovering.take();
        let (died, frames) = before.map_or((Instant::now(), 0), |r| (r.died, r.frames));
        self.recovering = Some(Recovering { died, resumed: None, frames });
        let Some(number) = at else { return 0 };
        let times = self.at_frame.filter(|(last, _)| *last == number).map_or(1, |(_, times)| times + 1);
        self.at_frame = Some((number, times));
        times
    }
}

impl Run<'_, '_> {
    /// Pings a process, kills it when it hangs, starts it again when that is due.
    pub(super) fn look_after(&mut self, role: Role) -> Result<(), SuperviseError> {
        let hang_limit = self.how.hang_limit;
        let worker = self.worker(role);
        if worker.take_due() {
            return self.start(role);
        }
        if worker.process.is_none() {
            return Ok(());
        }
        worker.ping();
        let limit = match (worker.ready, worker.ending) {
            (false, _) => BEGIN_LIMIT,
            (true, true) => FINISH_LIMIT,
            (true, false) => hang_limit,
        };
        let silent = worker.heard.elapsed();
        if role == Role::Slam && self.frames.in_hand() && silent > self.how.late_limit {
            self.poses_come(false);
        }
        if silent > limit {
            let why = format!("it did not answer for {:.1} s and was killed", limit.as_secs_f64());
            return self.died(role, Some(why));
        }
        Ok(())
    }

    /// A process has ended, or is ended here for the reason `why`.
    pub(super) fn died(&mut self, role: Role, why: Option<String>) -> Result<(), SuperviseError> {
        let (at_frame, t_s) = (self.frames.oldest(), self.began.elapsed());
        let worker = self.worker(role);
        let Some(process) = worker.process.take() else { return Ok(()) };
        let (had_begun, progress) = (worker.ready, worker.has_done_work());
        let status = process.end();
        let how = why.unwrap_or(status);
        worker.ready = false;
        let delay = worker.backoff.after_death(progress);
        let times = worker.backoff.times();
        let death = Death { role, how, at_frame, t_s: t_s.as_secs_f64() };
        (self.tell)(RunEvent::Died(&death));
        if role == Role::Capture {
            self.listener.fresh_from = self.frames.next;
            self.frames.capture_died();
        }
        if matches!(role, Role::Capture | Role::Slam) {
            self.poses_come(false);
        }
        if matches!(role, Role::Guide | Role::Dense) && delay.is_none() {
            (self.tell)(RunEvent::GivenUp { role });
            if role == Role::Dense {
                let why = format!("the process that makes them died {times} times in a row: {}", death.how);
                let cure = "run without --isolated to see where it fails";
                self.surfaces.end(Err(Failure::new("surfaces", why, cure)));
            } else {
                self.listener.given_up = true;
            }
            self.deaths.all.push(death);
            return Ok(());
        }
        if role == Role::Dense {
            self.surfaces.process_died();
        }
        let Some(delay) = delay else {
            return Err(SuperviseError::CrashLoop { role, how: death.how, times });
        };
        if !delay.is_zero() {
            (self.tell)(RunEvent::Waits { role, delay_s: delay.as_secs_f64(), times });
        }
        self.worker(role).due = Some(Instant::now() + delay);
        self.deaths.all.push(death);
        if role == Role::Slam {
            self.slam_died(had_begun);
        }
        Ok(())
    }

    fn slam_died(&mut self, had_begun: bool) {
        let at = Some(self.frames.oldest()).filter(|_| had_begun && self.frames.in_hand());
        if self.deaths.slam_died(at) >= DEATHS_AT_A_FRAME
            && let Some(frame) = self.frames.leave_out_oldest()
        {
            let (number, stamp) = (frame.number, frame.stamp);
            (self.tell)(RunEvent::LeftOut { number });
            let outcome = Outcome::State("left out: SLAM died at it twice".into());
            let (pose, place, seen) = (None, None, None);
            let left_out = Tracked { number, stamp, outcome, pose, metric: false, ms: 0.0, place, seen };
            self.log.insert(number, left_out);
        }
        self.frames.slam_died();
    }
}
