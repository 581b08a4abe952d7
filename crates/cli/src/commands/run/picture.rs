//! The pictures of a report: the map from above, the timeline, the growth of the map.

use super::history::{History, Tracking};
use cairn_atlas::Snapshot;
use cairn_eval::{
    Event, Figure, Labels, Marker, Moment, Plan, PlanLine, RunReport, Series, Span, Timeline, TimelineRow,
    Tone, line_chart, widest_axes,
};
use cairn_geometry::{Se3, Sim3, Vec2, Vec3};
use cairn_sensor::Stamp;

/// Landmarks are drawn when at least this many key frames observe them.
const MIN_OBSERVATIONS: usize = 3;
/// Poses further apart than this are not joined by a line, seconds.
const GAP_S: f64 = 1.0;

/// From which side the map is drawn, and in whose frame.
pub struct View {
    axes: (usize, usize),
    /// From the frame of the run to that of the picture: the ground truth's, where there is one.
    shown_from_map: Sim3,
    aligned: bool,
    unit: &'static str,
}

impl View {
    /// Along the axis in which the run is least extended.
    pub fn of(r: &RunReport, world_from_body: &[(Stamp, Se3)]) -> Self {
        let (shown_from_map, aligned) = match &r.accuracy {
            Some(e) => (e.reference_from_estimate, true),
            None => (Sim3::identity(), false),
        };
        let points = world_from_body.iter().map(|(_, pose)| shown_from_map * pose.translation);
        let metric = aligned || r.scale.iter().all(|s| s.metric);
        Self { axes: widest_axes(points), shown_from_map, aligned, unit: if metric { "m" } else { "units" } }
    }

    fn point(&self, p: &Vec3) -> Vec2 {
        let p = self.shown_from_map * *p;
        Vec2::new(p[self.axes.0], p[self.axes.1])
    }

    /// Explains the picture.
    pub fn caption(&self) -> String {
        let frame = match self.aligned {
            true => "The whole run is aligned to the ground truth.",
            false => "In the frame of the map.",
        };
        format!(
            "Seen from its flattest side. {frame} Landmarks that at least {MIN_OBSERVATIONS} key frames show; poses as corrected at the end."
        )
    }
}

/// When the run began: its first frame.
pub fn start(history: &History) -> Stamp {
    history.stretches.first().map_or(Stamp::default(), |s| s.from)
}

/// The map from above.
pub fn plan(
    r: &RunReport,
    history: &History,
    world_from_body: &[(Stamp, Se3)],
    map: &Snapshot,
    view: &View,
) -> Plan {
    let name = |axis: usize| ["x", "y", "z"][axis].to_owned();
    let centre = |id| map.world_from_here(id).map(|here| view.point(&here.translation));
    let line =
        |label: &str, points, tone| PlanLine { label: label.into(), points, tone, ..PlanLine::default() };
    let truth = r.accuracy.as_ref().map_or(Vec::new(), |e| {
        let at = |p: &Vec3| Vec2::new(p[view.axes.0], p[view.axes.1]);
        with_gaps(e.errors.iter().map(|p| (Stamp(p.stamp_ns), at(&p.reference))))
    });
    let loops: Vec<Vec2> = history
        .joins
        .iter()
        .filter_map(|j| Some([centre(j.key_frames[0])?, centre(j.key_frames[1])?, Vec2::repeat(f64::NAN)]))
        .flatten()
        .collect();
    let mut lines = vec![
        PlanLine { broad: true, ..line("ground truth", truth, Tone::Truth) },
        line("tracked", poses_of(history, world_from_body, view, &[Tracking::Tracked]), Tone::First),
        line("coasted", poses_of(history, world_from_body, view, &[Tracking::Coasting]), Tone::Second),
        line("rotation only", poses_of(history, world_from_body, view, &[Tracking::Rotation]), Tone::Fourth),
        PlanLine { dashed: true, ..line("without a pose", gaps(world_from_body, view), Tone::Alarm) },
        PlanLine { dashed: true, ..line("place recognised", loops, Tone::Fourth) },
    ];
    lines.retain(|l| l.points.iter().filter(|p| p.x.is_finite()).count() > 1);
    let marker = |label: &str, pose: Option<&(Stamp, Se3)>| {
        Some(Marker { label: label.into(), at: view.point(&pose?.1.translation), tone: Tone::Third })
    };
    let ends = [marker("start", world_from_body.first()), marker("end", world_from_body.last())];
    let (first, last) = (start(history), history.stretches.last().map_or(Stamp::default(), |s| s.to));
    let of_run = map.key_frames().filter(|k| (first..=last).contains(&k.stamp));
    let events = history.joins.iter().enumerate();
    let events = events
        .filter_map(|(i, j)| Some(Event { number: i + 1, at: centre(j.key_frames[0])?, tone: Tone::Fourth }));
    let (loops, merges) = (r.loops, r.merges);
    Plan {
        title: "The map".into(),
        description: format!(
            "The way of the run with {} key frames and {} landmarks, {loops} loops and {merges} merges; it was lost {} times.",
            r.keyframes,
            r.landmarks,
            r.lost.len()
        ),
        axes: (name(view.axes.0), name(view.axes.1)),
        dots: (map.landmarks().filter(|l| l.observations.len() >= MIN_OBSERVATIONS))
            .map(|l| view.point(&l.position))
            .collect(),
        dots_label: "landmarks".into(),
        circles: of_run.map(|k| view.point(&k.world_from_camera.translation)).collect(),
        circles_label: "key frames".into(),
        unit: view.unit.into(),
        lines,
        markers: ends.into_iter().flatten().collect(),
        events: events.collect(),
        ..Plan::default()
    }
}

/// Points in order of time, with a break where more than a second is between two.
fn with_gaps(points: impl Iterator<Item = (Stamp, Vec2)>) -> Vec<Vec2> {
    let mut out: Vec<Vec2> = Vec::new();
    let mut last: Option<Stamp> = None;
    for (at, p) in points {
        if last.is_some_and(|last| at - last > GAP_S) {
            out.push(Vec2::repeat(f64::NAN));
        }
        last = Some(at);
        out.push(p);
    }
    out
}

/// The poses tracked in one of these ways, with a break where another was between.
fn poses_of(
    history: &History,
    world_from_body: &[(Stamp, Se3)],
    view: &View,
    ways: &[Tracking],
) -> Vec<Vec2> {
    let mut out: Vec<Vec2> = Vec::new();
    let mut last: Option<(Stamp, Vec2)> = None;
    let mut inside = false;
    for (at, pose) in world_from_body {
        let p = view.point(&pose.translation);
        // Poses that were found afterwards, from before the first map, are tracked ones.
        let way = match history.tracking_at(*at) {
            None | Some(Tracking::Starting | Tracking::Lost) => Tracking::Tracked,
            Some(way) => way,
        };
        let is = ways.contains(&way);
        let near = last.is_some_and(|(before, _)| *at - before <= GAP_S);
        if is {
            if !(inside && near) {
                out.push(Vec2::repeat(f64::NAN));
                // It begins where the stretch before it ends.
                out.extend(last.filter(|_| near).map(|(_, p)| p));
            }
            out.push(p);
        }
        (inside, last) = (is, Some((*at, p)));
    }
    out
}

/// From the last pose before each gap to the first one after it.
fn gaps(world_from_body: &[(Stamp, Se3)], view: &View) -> Vec<Vec2> {
    let apart = world_from_body.windows(2).filter(|w| w[1].0 - w[0].0 > GAP_S);
    let ends = apart.flat_map(|w| {
        [view.point(&w[0].1.translation), view.point(&w[1].1.translation), Vec2::repeat(f64::NAN)]
    });
    ends.collect()
}

fn tone(tracking: Tracking) -> Tone {
    match tracking {
        Tracking::Starting => Tone::Grid,
        Tracking::Tracked => Tone::First,
        Tracking::Coasting => Tone::Second,
        Tracking::Rotation => Tone::Fourth,
        Tracking::Lost => Tone::Alarm,
    }
}

/// What happened when.
pub fn timeline(r: &RunReport, history: &History, map: &Snapshot) -> Timeline {
    let from = start(history);
    let to = history.stretches.last().map_or(from, |s| s.to);
    let t = |at: Stamp| at - from;
    let spans = history.stretches.iter();
    let spans = spans.map(|s| Span { from_s: t(s.from), to_s: t(s.to), tone: tone(s.tracking) }).collect();
    let moment = |at: Stamp, number, tone| Moment { at_s: t(at), number, tone };
    let key_frames = map.key_frames().map(|k| k.stamp).filter(|at| (from..=to).contains(at));
    let joins = |merge: bool| {
        let all = history.joins.iter().enumerate().filter(move |(_, j)| j.merge == merge);
        all.map(|(i, j)| moment(j.at, Some(i + 1), Tone::Fourth)).collect()
    };
    let row =
        |label: &str, moments: Vec<Moment>| TimelineRow { label: label.into(), spans: Vec::new(), moments };
    let seen =
        [Tracking::Tracked, Tracking::Coasting, Tracking::Rotation, Tracking::Lost, Tracking::Starting];
    let legend = seen.into_iter().filter(|w| history.stretches.iter().any(|s| s.tracking == *w));
    Timeline {
        title: "What happened when".into(),
        description: format!(
            "{:.1} s: tracked {:.1} s, coasted {:.1} s, lost {:.1} s; {} loops, {} merges, {} maps begun.",
            to - from,
            history.seconds(Tracking::Tracked),
            history.seconds(Tracking::Coasting),
            history.seconds(Tracking::Lost),
            r.loops,
            r.merges,
            history.starts.len()
        ),
        range_s: (0.0, to - from),
        legend: legend.map(|w| (w.name().to_owned(), tone(w))).collect(),
        rows: vec![
            TimelineRow { label: "tracking".into(), spans, moments: Vec::new() },
            row("key frames", key_frames.map(|at| moment(at, None, Tone::Third)).collect()),
            row("new maps", history.starts.iter().map(|s| moment(s.at, None, Tone::Second)).collect()),
            row("loops", joins(false)),
            row("merges", joins(true)),
        ],
    }
}

/// Landmarks over time.
pub fn growth(history: &History) -> Figure {
    let from = start(history);
    let points = history.growth.iter().map(|(at, _, landmarks)| (*at - from, *landmarks as f64)).collect();
    let last = history.growth.last().map_or((0, 0), |(_, k, l)| (*k, *l));
    let labels = Labels {
        title: "Growth of the map".into(),
        description: format!("In the end {} key frames and {} landmarks.", last.0, last.1),
        x: "time [s]".into(),
        y: "landmarks".into(),
    };
    line_chart(&labels, &[Series { points, ..Series::default() }], &[])
}
