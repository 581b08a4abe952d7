//! The guide process: poses and the journal of the map in, words out.
//!
//! It is the part that must speak when another has died. Word that what makes the poses is late or dead makes it say "stop" at once; once
//! poses come again it goes on. It keeps nothing: a guide that is started again finds the walker on the route by the next
//! pose.

use crate::journal::Tail;
use crate::message::{Failure, Order, Report, Said, Tracked, read, write};
use cairn_guide::{Earcon, StopReason};
use cairn_sensor::Stamp;
use cairn_session::{Event, RouteGuide};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Runs until the supervisor is gone. `open` reads the route. In real time poses grow old while none comes, and the guide
/// says stop by itself.
pub fn run<F>(mut from: impl Read, mut to: impl Write, is_realtime: bool, open: F)
where
    F: FnOnce() -> Result<RouteGuide, Failure>,
{
    let Ok(Some(Order::Guide { folder, began })) = read(&mut from) else { return };
    let said = open().and_then(|guide| {
        let guide = guide.began_at(began.map(Stamp));
        let guiding = Guiding { guide, folder, tail: None, last: None, poses_come: true, is_realtime };
        guiding.work(&mut from, &mut to)
    });
    if let Err(why) = said {
        // Without a supervisor there is nobody to tell.
        let _ = write(&mut to, &Report::Failed(why));
    }
}

struct Guiding {
    guide: RouteGuide,
    folder: PathBuf,
    tail: Option<Tail>,
    /// The last frame, and when its result came.
    last: Option<(Stamp, Instant)>,
    poses_come: bool,
    is_realtime: bool,
}

impl Guiding {
    fn work(mut self, from: &mut impl Read, to: &mut impl Write) -> Result<(), Failure> {
        let mut reports = vec![Report::Ready { key_frames: 0, version: 0 }];
        loop {
            for report in reports.drain(..) {
                if write(to, &report).is_err() {
                    return Ok(());
                }
            }
            match read(from) {
                Ok(Some(Order::Tracked(frame))) => self.tracked(&frame)?,
                Ok(Some(Order::PosesCome(lives))) => {
                    self.poses_come = lives;
                    self.tick()?;
                }
                Ok(Some(Order::Ping)) => {
                    self.tick()?;
                    reports.push(Report::Pong);
                }
                Ok(Some(_)) => {}
                Ok(None) | Err(_) => return Ok(()),
            }
            reports.extend(self.guide.events().into_iter().map(said));
        }
    }

    fn tracked(&mut self, frame: &Tracked) -> Result<(), Failure> {
        let stamp = Stamp(frame.stamp);
        self.last = Some((stamp, Instant::now()));
        follow(&mut self.tail, &self.folder)?;
        let Some(tail) = &self.tail else { return Ok(()) };
        let place = frame.place.as_ref().and_then(|p| p.to_tracked(stamp, frame.metric));
        self.guide.tracked(tail.map(), stamp, place.as_ref()).map_err(cannot_guide)
    }

    /// Time passes without a frame: while no poses come, each such moment is a reason to stop.
    fn tick(&mut self) -> Result<(), Failure> {
        let (Some((stamp, came)), Some(tail)) = (self.last, &self.tail) else { return Ok(()) };
        let hazard = (!self.poses_come).then_some(StopReason::StageDied);
        if hazard.is_none() && !self.is_realtime {
            return Ok(());
        }
        let now = stamp.plus_seconds(came.elapsed().as_secs_f64());
        self.guide.tick(tail.map(), now, hazard).map_err(cannot_guide)
    }
}

/// Reads what SLAM has written since.
fn follow(tail: &mut Option<Tail>, folder: &Path) -> Result<(), Failure> {
    let failed = |e| Failure::new("the journal of the map", e, "start the run again");
    match tail {
        Some(tail) => tail.follow().map_err(failed),
        None => {
            *tail = Tail::open(folder).map_err(failed)?;
            Ok(())
        }
    }
}

fn cannot_guide(why: String) -> Failure {
    Failure::new("the route", why, "give another route with --guide")
}

const EARCONS: [Earcon; 6] =
    [Earcon::OnCourse, Earcon::OffCourse, Earcon::Turn, Earcon::Waypoint, Earcon::Arrival, Earcon::Stop];

fn said(event: Event) -> Report {
    Report::Said(match event {
        Event::Said(s) => Said::Words { text: s.text, t_s: s.t_s, interrupts: s.interrupts },
        Event::Sound(s) => {
            let earcon = EARCONS.iter().position(|e| *e == s.earcon).unwrap_or(0) as u8;
            Said::Sound { earcon, bearing_rad: s.bearing_rad, t_s: s.t_s }
        }
    })
}

/// The earcon of a number in [`Said::Sound`].
pub fn earcon_of(number: u8) -> Option<Earcon> {
    EARCONS.get(usize::from(number)).copied()
}
