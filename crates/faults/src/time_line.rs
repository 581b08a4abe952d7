//! What happened on a walk, line by line: as text, and as a page with the places of the walker.

use crate::estimator::{PoseView, Reading, View};
use crate::rules::Violation;
use crate::scenario::Scenario;
use cairn_guide::{GuideState, Match};
use cairn_random::mix;
use cairn_sensor::Stamp;
use std::fmt::Write as _;

/// What a line is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum What {
    /// The engine finds this in the pictures from now on.
    Sees,
    /// The guide is in this state from now on.
    Guide,
    /// The server says this.
    Sent,
    /// The walker begins to hear this.
    Heard,
    /// The walker hears a sound.
    Sound,
    /// The walker asked for this.
    Asked,
    /// A rule was broken.
    Broken,
}

/// A line.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Seconds since the walk began.
    pub t_s: f64,
    /// Where the walker truly is: metres, and radians.
    pub walker: (f64, f64, f64),
    /// And on the route: metres along it, and to its left.
    pub place: (f64, f64),
    /// What it is about.
    pub what: What,
    /// What there is to say.
    pub text: String,
}

/// Collects lines, or only what tells one walk from another.
pub(crate) struct Lines {
    kept: Option<Vec<Line>>,
    digest: u64,
    walker: (f64, f64, f64),
    place: (f64, f64),
    /// What was seen, and what the guide did.
    before: [String; 2],
}

impl Lines {
    pub fn counting() -> Self {
        Self { kept: None, digest: 0, walker: (0.0, 0.0, 0.0), place: (0.0, 0.0), before: Default::default() }
    }

    pub fn kept() -> Self {
        Self { kept: Some(Vec::new()), ..Self::counting() }
    }

    fn add(&mut self, now: Stamp, what: What, text: &str) {
        let (walker, place) = (self.walker, self.place);
        if let Some(kept) = &mut self.kept {
            kept.push(Line { t_s: now.seconds(), walker, place, what, text: text.to_owned() });
        }
    }

    fn count(&mut self, value: u64) {
        self.digest = mix(self.digest ^ value).wrapping_add(1);
    }

    /// The walker is here now.
    pub fn walker(&mut self, now: Stamp, walker: (f64, f64, f64), place: Option<Match>) {
        self.walker = walker;
        self.place = place.map_or((0.0, 0.0), |m| (m.along_m, m.cross_m));
        [now.0 as u64, walker.0.to_bits(), walker.1.to_bits(), walker.2.to_bits()]
            .into_iter()
            .for_each(|value| self.count(value));
    }

    /// Words.
    pub fn said(&mut self, now: Stamp, what: What, text: &str) {
        self.count(now.0 as u64);
        text.bytes().for_each(|byte| self.count(u64::from(byte)));
        self.add(now, what, text);
    }

    /// The pictures show this from now on.
    pub fn state(&mut self, now: Stamp, text: &str) {
        if self.kept.is_some() && self.before[0] != text {
            text.clone_into(&mut self.before[0]);
            self.add(now, What::Sees, text);
        }
    }

    pub fn view(&mut self, reading: &Reading) {
        if self.kept.is_none() {
            return;
        }
        let lie = match () {
            () if reading.runaway_s > 0.0 => ", which runs away",
            () if reading.is_false => ", which is wrong",
            () => "",
        };
        let text = match &reading.view {
            View::Dies => "the engine has failed".to_owned(),
            View::Away => "the engine is away".to_owned(),
            View::Lost => "tracking is lost".to_owned(),
            View::Pose(PoseView { coasts_s: Some(_), .. }) => format!("the motion sensors' pose{lie}"),
            View::Pose(PoseView { own_map: Some(_), .. }) => format!("a pose in a map of its own{lie}"),
            View::Pose(PoseView { segment, .. }) => format!("a pose in segment {segment}{lie}"),
        };
        self.state(reading.stamp, &text);
    }

    /// The guide does this from now on.
    pub fn guide(&mut self, now: Stamp, state: Option<GuideState>) {
        if self.kept.is_none() {
            return;
        }
        let text = state.map_or_else(|| "nobody is guided".to_owned(), |state| format!("{state:?}"));
        if self.before[1] != text {
            text.clone_into(&mut self.before[1]);
            self.add(now, What::Guide, &text);
        }
    }

    /// The digest, and the lines with the rules that were broken.
    pub fn finish(mut self, violations: &[Violation]) -> (u64, Vec<Line>) {
        for v in violations {
            self.walker = (0.0, 0.0, 0.0);
            let text = format!("{:?}: {}", v.rule, v.how);
            self.said(Stamp::from_seconds(v.t_s), What::Broken, &text);
        }
        let mut lines = self.kept.unwrap_or_default();
        lines.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        for k in 1..lines.len() {
            if lines[k].what == What::Broken {
                (lines[k].walker, lines[k].place) = (lines[k - 1].walker, lines[k - 1].place);
            }
        }
        (self.digest, lines)
    }
}

/// The lines as text.
pub fn text(lines: &[Line]) -> String {
    let mut text = String::new();
    for line in lines {
        let (x, y, heading) = line.walker;
        let what = format!("{:?}", line.what).to_lowercase();
        let (along_m, left_m) = line.place;
        let at =
            format!("{x:6.1} {y:6.1} {:4.0} deg {along_m:6.1} m {left_m:5.1} left", heading.to_degrees());
        let _ = writeln!(text, "{:8.2} s  {at}  {what:6}  {}", line.t_s, line.text);
    }
    text
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// The lines as a page, with the route and the places of the walker.
pub fn page(scenario: &Scenario, lines: &[Line]) -> String {
    let line = scenario.shape().line;
    let route: Vec<(f64, f64)> = line.iter().map(|p| (p.x, p.y)).collect();
    let walked: Vec<(f64, f64)> = lines.iter().map(|l| (l.walker.0, l.walker.1)).collect();
    let all = || route.iter().chain(&walked);
    let least = |f: fn(&(f64, f64)) -> f64| all().map(f).fold(f64::INFINITY, f64::min) - 2.0;
    let most = |f: fn(&(f64, f64)) -> f64| all().map(f).fold(f64::NEG_INFINITY, f64::max) + 2.0;
    let [x0, x1, y0, y1] = [least(|p| p.0), most(|p| p.0), least(|p| p.1), most(|p| p.1)];
    // North is up.
    let points = |at: &[(f64, f64)]| -> String {
        at.iter().map(|(x, y)| format!("{:.2},{:.2} ", x - x0, y1 - y)).collect()
    };
    let marks: String = (lines.iter().filter(|l| l.what == What::Broken))
        .map(|l| {
            let (x, y) = (l.walker.0 - x0, y1 - l.walker.1);
            format!("<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"0.5\" fill=\"red\"/>")
        })
        .collect();
    let rows: String = (lines.iter())
        .map(|l| {
            let what = format!("{:?}", l.what).to_lowercase();
            format!(
                "<tr class=\"{what}\"><td>{:.2}</td><td>{what}</td><td>{}</td></tr>\n",
                l.t_s,
                escaped(&l.text)
            )
        })
        .collect();
    format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>Walk {}</title>\n\
         <style>body{{font:1rem sans-serif;max-width:60rem;margin:auto}}td{{padding:0 .5rem;vertical-align:top}}\
         .broken{{background:#fbb}}.heard{{font-weight:bold}}.sees,.guide{{color:#666}}</style>\n\
         <h1>Walk {}</h1><p><code>cairn-sim {}</code></p>\n\
         <svg role=\"img\" aria-label=\"The route, and where the walker was\" viewBox=\"0 0 {:.2} {:.2}\" style=\"max-height:30rem\">\
         <polyline points=\"{}\" fill=\"none\" stroke=\"#99f\" stroke-width=\"0.4\"/>\
         <polyline points=\"{}\" fill=\"none\" stroke=\"black\" stroke-width=\"0.1\"/>{marks}</svg>\n\
         <table><tr><th>Second</th><th>What</th><th></th></tr>\n{rows}</table></html>\n",
        scenario.seed,
        scenario.seed,
        escaped(&scenario.to_string()),
        x1 - x0,
        y1 - y0,
        points(&route),
        points(&walked),
    )
}
