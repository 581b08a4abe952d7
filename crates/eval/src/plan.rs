//! Plans in top view: walls, lines, markers and numbered events, with equal axes and a scale bar.

use crate::chart::round_step;
use crate::svg::{Anchor, Canvas, Figure, Sample, Tone, text_width};
use cairn_geometry::Vec2;

const WIDTH: f64 = 760.0;
const MARGIN: f64 = 36.0;
/// Colour of circles.
const CIRCLES: Tone = Tone::Third;

/// A walked, estimated or planned path.
#[derive(Clone, Debug, Default)]
pub struct PlanLine {
    /// Name in the legend.
    pub label: String,
    /// Points in metres; a point that is not finite interrupts the line.
    pub points: Vec<Vec2>,
    /// Colour.
    pub tone: Tone,
    /// Dashed instead of solid.
    pub dashed: bool,
    /// Broad, as a background for other lines (used for ground truth).
    pub broad: bool,
    /// True to draw small arrows in the direction of the line.
    pub arrows: bool,
}

/// A labelled position.
#[derive(Clone, Debug)]
pub struct Marker {
    /// Label beside the marker.
    pub label: String,
    /// Where, in metres.
    pub at: Vec2,
    /// Colour.
    pub tone: Tone,
}

/// An event at a position, shown by its number; the text is in the transcript of the page.
#[derive(Clone, Debug)]
pub struct Event {
    /// Number.
    pub number: usize,
    /// Where, in metres.
    pub at: Vec2,
    /// Colour.
    pub tone: Tone,
}

/// A floor plan or a top view of trajectories; x to the right, y up, metres.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    /// Short name of the figure.
    pub title: String,
    /// Text alternative: what the figure shows.
    pub description: String,
    /// Names of the horizontal and the vertical axis, such as `x` and `z`.
    pub axes: (String, String),
    /// Walls as segments.
    pub walls: Vec<[Vec2; 2]>,
    /// Small dots, such as landmarks; drawn on a grid of two pixels, without duplicates.
    pub dots: Vec<Vec2>,
    /// Name of the dots in the legend; may be empty.
    pub dots_label: String,
    /// Small circles, such as key frames.
    pub circles: Vec<Vec2>,
    /// Name of the circles in the legend; may be empty.
    pub circles_label: String,
    /// Unit of length at the scale bar; metres where it is empty.
    pub unit: String,
    /// Lines, drawn in this order.
    pub lines: Vec<PlanLine>,
    /// Labelled positions.
    pub markers: Vec<Marker>,
    /// Numbered events.
    pub events: Vec<Event>,
}

impl Plan {
    /// Draws the plan.
    pub fn figure(&self) -> Figure {
        let sample = |dashed| if dashed { Sample::Dashed } else { Sample::Line };
        let lines = self.lines.iter().map(|w| (w.label.as_str(), w.tone, sample(w.dashed)));
        let symbols = [
            (self.dots_label.as_str(), Tone::Muted, Sample::Dots),
            (self.circles_label.as_str(), CIRCLES, Sample::Circle),
        ];
        let entries: Vec<(&str, Tone, Sample)> = lines.chain(symbols).filter(|e| !e.0.is_empty()).collect();
        let mut measure = Canvas::new(WIDTH, 0.0);
        let legend_height = measure.legend(16.0, 8.0, WIDTH - 16.0, &entries);
        let view = View::around(self.all_points(), 8.0 + legend_height);
        let mut canvas = Canvas::new(WIDTH, view.height);
        canvas.legend(16.0, 8.0, WIDTH - 16.0, &entries);
        let mut dots: Vec<(i64, i64)> = (self.dots.iter().filter(|p| is_finite(p)))
            .map(|p| view.pixel(p))
            .filter(|p| (0.0..WIDTH).contains(&p.0) && (view.top..view.height).contains(&p.1))
            .map(|p| (2 * (0.5 * p.0).round() as i64, 2 * (0.5 * p.1).round() as i64))
            .collect();
        dots.sort_unstable();
        dots.dedup();
        canvas.dots(&dots, Tone::Muted);
        for [a, b] in self.walls.iter().filter(|w| is_finite(&w[0]) && is_finite(&w[1])) {
            canvas.line(view.pixel(a), view.pixel(b), Tone::Muted, 3.0);
        }
        for line in &self.lines {
            draw_line(&mut canvas, &view, line);
        }
        self.draw_circles(&mut canvas, &view);
        self.draw_markers(&mut canvas, &view);
        self.draw_events(&mut canvas, &view);
        self.draw_scale(&mut canvas, &view);
        canvas.finish(&self.title, &self.description)
    }

    fn all_points(&self) -> impl Iterator<Item = &Vec2> {
        let lines = self.lines.iter().flat_map(|w| &w.points);
        let positions =
            self.markers.iter().map(|m| &m.at).chain(self.events.iter().map(|e| &e.at)).chain(&self.circles);
        self.walls.iter().flatten().chain(lines).chain(positions).filter(|p| is_finite(p))
    }

    /// Circles that would cover another one are left out.
    fn draw_circles(&self, canvas: &mut Canvas, view: &View) {
        let mut drawn = std::collections::BTreeSet::new();
        for p in self.circles.iter().filter(|p| is_finite(p)) {
            let at = view.pixel(p);
            if drawn.insert(((at.0 / 3.0) as i64, (at.1 / 3.0) as i64)) {
                canvas.disc(at, 2.6, CIRCLES, true);
            }
        }
    }

    fn draw_markers(&self, canvas: &mut Canvas, view: &View) {
        for marker in self.markers.iter().filter(|m| is_finite(&m.at)) {
            let at = view.pixel(&marker.at);
            canvas.disc(at, 6.0, marker.tone, true);
            canvas.disc(at, 2.5, marker.tone, false);
            let (anchor, side) =
                if is_left(at, marker) { (Anchor::End, -11.0) } else { (Anchor::Start, 11.0) };
            canvas.text((at.0 + side, at.1 - 6.0), anchor, Tone::Ink, "halo strong", &marker.label);
        }
    }

    /// Centres of discs of 10 pixels that cover the markers and their labels, which events must not overlap.
    fn occupied(&self, view: &View) -> Vec<(f64, f64)> {
        let discs = |marker: &Marker| {
            let at = view.pixel(&marker.at);
            let side = if is_left(at, marker) { -1.0 } else { 1.0 };
            let steps = (text_width(&marker.label) / 12.0).ceil() as usize;
            let name = (0..=steps).map(move |i| (at.0 + side * (11.0 + 12.0 * i as f64), at.1 - 10.0));
            std::iter::once(at).chain(name).collect::<Vec<_>>()
        };
        self.markers.iter().filter(|m| is_finite(&m.at)).flat_map(discs).collect()
    }

    /// Numbers in discs; a disc that would overlap something is moved aside and connected by a leader line.
    fn draw_events(&self, canvas: &mut Canvas, view: &View) {
        const RADIUS: f64 = 10.0;
        let mut occupied = self.occupied(view);
        for event in self.events.iter().filter(|e| is_finite(&e.at)) {
            let origin = view.pixel(&event.at);
            let free = |at: &(f64, f64)| {
                let inside = (RADIUS..WIDTH - RADIUS).contains(&at.0)
                    && (view.top + RADIUS..view.height - 30.0).contains(&at.1);
                inside && occupied.iter().all(|p| (p.0 - at.0).hypot(p.1 - at.1) > 2.1 * RADIUS)
            };
            let rings = (1..8).flat_map(|ring| {
                (0..16).map(move |k| {
                    let angle = f64::from(k) * std::f64::consts::TAU / 16.0 + 0.6;
                    let distance = 24.0 * f64::from(ring);
                    (origin.0 + distance * angle.cos(), origin.1 + distance * angle.sin())
                })
            });
            let at = std::iter::once(origin).chain(rings).find(free).unwrap_or(origin);
            if at != origin {
                canvas.line(origin, at, event.tone, 1.0);
                canvas.disc(origin, 2.0, event.tone, false);
            }
            occupied.push(at);
            canvas.disc(at, RADIUS, event.tone, true);
            let number = event.number.to_string();
            canvas.text((at.0, at.1 + 4.0), Anchor::Middle, event.tone, "small strong", &number);
        }
    }

    fn draw_scale(&self, canvas: &mut Canvas, view: &View) {
        let metres = round_step(0.12 * WIDTH / view.pixels_per_metre);
        let (left, level) = (16.0, view.height - 14.0);
        let right = left + metres * view.pixels_per_metre;
        let unit = if self.unit.is_empty() { "m" } else { &self.unit };
        canvas.line((left, level), (right, level), Tone::Ink, 2.0);
        for x in [left, right] {
            canvas.line((x, level - 4.0), (x, level + 4.0), Tone::Ink, 2.0);
        }
        canvas.text(
            (right + 8.0, level + 4.0),
            Anchor::Start,
            Tone::Ink,
            "halo",
            &format!("{metres} {unit}"),
        );
        let (x, y) = (&self.axes.0, &self.axes.1);
        if !x.is_empty() {
            let text = format!("{x} to the right, {y} up");
            canvas.text((WIDTH - 16.0, level + 4.0), Anchor::End, Tone::Muted, "halo small", &text);
        }
    }
}

/// True when the label of a marker must be placed on its left to fit into the figure.
fn is_left(at: (f64, f64), marker: &Marker) -> bool {
    at.0 + 12.0 + text_width(&marker.label) > WIDTH
}

fn is_finite(p: &Vec2) -> bool {
    p.x.is_finite() && p.y.is_finite()
}

/// The mapping from metres to pixels, with the same scale on both axes.
struct View {
    centre: Vec2,
    middle: (f64, f64),
    pixels_per_metre: f64,
    top: f64,
    height: f64,
}

impl View {
    fn around<'a>(points: impl Iterator<Item = &'a Vec2>, top: f64) -> Self {
        let bounds = points.fold(None, |b: Option<(Vec2, Vec2)>, p| match b {
            Some((low, high)) => Some((low.inf(p), high.sup(p))),
            None => Some((*p, *p)),
        });
        let (low, high) = bounds.unwrap_or((Vec2::zeros(), Vec2::repeat(1.0)));
        let size = (high - low).sup(&Vec2::repeat(1e-6));
        let across = (WIDTH - 2.0 * MARGIN) / size.x;
        let inner_height = (size.y * across).clamp(160.0, 640.0);
        let pixels_per_metre = across.min(inner_height / size.y);
        let height = top + inner_height + 2.0 * MARGIN;
        let middle = (0.5 * WIDTH, top + MARGIN + 0.5 * inner_height - 6.0);
        Self { centre: (low + high) * 0.5, middle, pixels_per_metre, top, height }
    }

    fn pixel(&self, p: &Vec2) -> (f64, f64) {
        let d = (p - self.centre) * self.pixels_per_metre;
        (self.middle.0 + d.x, self.middle.1 - d.y)
    }
}

fn draw_line(canvas: &mut Canvas, view: &View, line: &PlanLine) {
    for run in line.points.split(|p| !is_finite(p)) {
        let mut pixels: Vec<(f64, f64)> = Vec::new();
        for (i, p) in run.iter().map(|p| view.pixel(p)).enumerate() {
            let far = pixels.last().is_none_or(|l| (l.0 - p.0).hypot(l.1 - p.1) > 0.7);
            if far || i + 1 == run.len() {
                pixels.push(p);
            }
        }
        canvas.polyline(&pixels, line.tone, if line.broad { 6.0 } else { 2.2 }, line.dashed);
        if line.arrows {
            draw_arrows(canvas, &pixels, line.tone);
        }
    }
}

/// A small arrow head every 90 pixels of the line.
fn draw_arrows(canvas: &mut Canvas, pixels: &[(f64, f64)], tone: Tone) {
    let mut until_next = 45.0;
    for w in pixels.windows(2) {
        let (dx, dy) = (w[1].0 - w[0].0, w[1].1 - w[0].1);
        let length = dx.hypot(dy);
        let mut along = until_next;
        while along <= length && length > 0.0 {
            let (ux, uy) = (dx / length, dy / length);
            let tip = (w[0].0 + ux * (along + 6.0), w[0].1 + uy * (along + 6.0));
            let side = |s: f64| (tip.0 - 11.0 * ux - s * 5.0 * uy, tip.1 - 11.0 * uy + s * 5.0 * ux);
            canvas.polygon(&[tip, side(1.0), side(-1.0)], tone);
            along += 90.0;
        }
        until_next = along - length;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_equal_and_y_points_up() {
        let corners = [Vec2::new(-3.0, 2.0), Vec2::new(17.0, 7.0)];
        let view = View::around(corners.iter(), 0.0);
        let (a, b) = (view.pixel(&corners[0]), view.pixel(&corners[1]));
        assert!(((b.0 - a.0) / 20.0 - (a.1 - b.1) / 5.0).abs() < 1e-9);
        assert!(b.1 < a.1 && a.0 >= MARGIN - 1e-9 && b.0 <= WIDTH - MARGIN + 1e-9 && a.1 < view.height);
        let tall = [Vec2::zeros(), Vec2::new(0.1, 500.0)];
        let view = View::around(tall.iter(), 0.0);
        assert!(view.height < 760.0 && view.pixel(&tall[1]).1 > 0.0);
    }

    #[test]
    fn events_at_the_same_position_do_not_overlap() {
        let events =
            (1..9).map(|number| Event { number, at: Vec2::new(1.0, 1.0), tone: Tone::Second }).collect();
        let walls = vec![[Vec2::zeros(), Vec2::new(4.0, 3.0)]];
        let plan = Plan { events, walls, ..Plan::default() };
        let svg = plan.figure().standalone();
        let centres: Vec<(f64, f64)> = svg
            .split("<circle class=\"paper")
            .skip(1)
            .map(|c| {
                let value = |key: &str| {
                    c.split(key).nth(1).unwrap().split('"').next().unwrap().parse::<f64>().unwrap()
                };
                (value("cx=\""), value("cy=\""))
            })
            .collect();
        assert_eq!(centres.len(), 8);
        for (i, a) in centres.iter().enumerate() {
            assert!(centres[..i].iter().all(|b| (a.0 - b.0).hypot(a.1 - b.1) > 20.0));
        }
    }

    #[test]
    fn empty_plans_and_nan_are_drawn() {
        let broken =
            PlanLine { points: vec![Vec2::new(f64::NAN, 0.0), Vec2::zeros()], ..PlanLine::default() };
        let plan = Plan { lines: vec![broken], ..Plan::default() };
        assert!(!plan.figure().standalone().contains("NaN"));
        assert!(Plan::default().figure().standalone().contains("</svg>"));
    }
}
