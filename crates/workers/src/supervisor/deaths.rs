//! The life of the processes: who hangs is killed, who died is started again, and what SLAM dies at twice is left out.

use super::{Recovering, Run};
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
        if role == Role::Slam && self.sent > 0 && silent > self.how.late_limit {
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
        let (at_frame, t_s) = (self.pending.front().map_or(self.next, |f| f.number), self.began.elapsed());
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
            self.fresh_from = self.next;
            self.left_out_before = self.left_out_before.and(&std::mem::take(&mut self.left_out));
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
                self.guide_given_up = true;
            }
            self.deaths.push(death);
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
        self.deaths.push(death);
        if role == Role::Slam {
            self.slam_died(had_begun);
        }
        Ok(())
    }

    fn slam_died(&mut self, had_begun: bool) {
        let before = self.recovering.take();
        let (died, frames) = before.map_or((Instant::now(), 0), |r| (r.died, r.frames));
        self.recovering = Some(Recovering { died, resumed: None, frames });
        if had_begun && self.sent > 0 {
            let number = self.pending[0].number;
            let times = if self.died_at.0 == number { self.died_at.1 + 1 } else { 1 };
            self.died_at = (number, times);
            if times >= DEATHS_AT_A_FRAME
                && let Some(frame) = self.pending.pop_front()
            {
                (self.tell)(RunEvent::LeftOut { number });
                let outcome = Outcome::State("left out: SLAM died at it twice".into());
                let (stamp, ms) = (frame.stamp, 0.0);
                self.log.insert(
                    number,
                    Tracked {
                        number,
                        stamp,
                        outcome,
                        pose: None,
                        metric: false,
                        ms,
                        place: None,
                        seen: None,
                    },
                );
            }
        }
        self.sent = 0;
    }
}
