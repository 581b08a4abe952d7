//! A walk step by step as text: what the guide did and said, and where the walker truly was.

use super::trial::Moment;
use cairn_guide::{Confidence, GuideState, Match};
use cairn_sensor::Stamp;
use std::fmt::Write as _;

/// Where nothing happens, a line after so many seconds.
const QUIET_S: f64 = 1.0;

/// Collects the lines.
#[derive(Default)]
pub(crate) struct TimeLine {
    lines: String,
    last: Option<(Stamp, GuideState)>,
}

impl TimeLine {
    /// Takes a step; most have no line of their own.
    pub fn add(&mut self, m: &Moment) {
        let cue = m.cue.filter(|cue| !cue.is_sound());
        let quiet = self.last.is_some_and(|(at, state)| state == m.state && m.now - at < QUIET_S);
        if quiet && cue.is_none() && m.said.is_none() && m.broken.is_empty() {
            return;
        }
        self.last = Some((m.now, m.state));
        let (x, y, heading) = m.walker;
        let _ = write!(
            self.lines,
            "{:7.2} s  at {x:6.2} {y:6.2} {:4.0} deg  truly {}  guide {}  {:?}",
            m.now.seconds(),
            heading.to_degrees(),
            on_route(m.truth),
            on_route(m.place),
            m.state
        );
        if m.confidence != Confidence::Good || m.pose_age_s > 0.0 {
            let _ = write!(self.lines, "  pose {:?}, {:.2} s old", m.confidence, m.pose_age_s);
        }
        self.lines.push('\n');
        if let Some(cue) = cue {
            let _ = writeln!(self.lines, "           cue {cue:?}");
        }
        if let Some(said) = &m.said {
            let flag = if said.wrong_side { "  [wrong side]" } else { "" };
            let _ = writeln!(self.lines, "           said \"{}\"{flag}", said.text);
        }
        for rule in &m.broken {
            let _ = writeln!(self.lines, "           BROKEN {}", rule.name());
        }
    }

    /// All lines.
    pub fn text(self) -> String {
        self.lines
    }
}

/// Metres along the route, to its left, and its heading there.
fn on_route(place: Option<Match>) -> String {
    place.map_or("-".into(), |m| {
        format!("{:6.2} m {:5.2} left {:4.0} deg", m.along_m, m.cross_m, m.heading.to_degrees())
    })
}
