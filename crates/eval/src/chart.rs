//! Line charts and histograms.

use crate::svg::{Anchor, Canvas, Figure, Sample, Tone};

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 320.0;
/// Space for the labels of horizontal marks.
const MARK_MARGIN: f64 = 108.0;

/// A line of a chart. A value that is not finite interrupts the line, so that gaps are visible.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// Name in the legend.
    pub label: String,
    /// Points, sorted by x.
    pub points: Vec<(f64, f64)>,
    /// Colour.
    pub tone: Tone,
    /// Dashed instead of solid.
    pub dashed: bool,
}

/// A value marked by a line across the chart.
#[derive(Clone, Debug)]
pub struct Mark {
    /// Label at the line.
    pub label: String,
    /// Marked value.
    pub value: f64,
}

/// Title, description and axis labels.
#[derive(Clone, Debug, Default)]
pub struct Labels {
    /// Short name of the figure.
    pub title: String,
    /// Text alternative: what the figure shows.
    pub description: String,
    /// Name and unit of the horizontal axis.
    pub x: String,
    /// Name and unit of the vertical axis.
    pub y: String,
}

/// A line chart with horizontal marks. Many points are decimated such that every peak is preserved.
pub fn line_chart(labels: &Labels, series: &[Series], marks: &[Mark]) -> Figure {
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    let sample = |dashed| if dashed { Sample::Dashed } else { Sample::Line };
    let legend: Vec<(&str, Tone, Sample)> =
        series.iter().map(|s| (s.label.as_str(), s.tone, sample(s.dashed))).collect();
    let top = 8.0 + canvas.legend(64.0, 8.0, WIDTH - 16.0, if legend.len() > 1 { &legend } else { &[] });
    let points = || {
        series.iter().flat_map(|s| s.points.iter().copied()).filter(|p| p.0.is_finite() && p.1.is_finite())
    };
    let x = range(points().map(|p| p.0), false);
    let y = range(points().map(|p| p.1).chain(marks.iter().map(|m| m.value)), true);
    let right = WIDTH - if marks.is_empty() { 16.0 } else { MARK_MARGIN };
    let axes = Axes::draw(&mut canvas, labels, (top, right), x, y);
    for line in series {
        for run in line.points.split(|p| !(p.0.is_finite() && p.1.is_finite())) {
            let pixels: Vec<(f64, f64)> = run.iter().map(|p| axes.pixel(*p)).collect();
            match decimate(&pixels).as_slice() {
                [single] => canvas.disc(*single, 1.5, line.tone, false),
                many => canvas.polyline(many, line.tone, 1.6, line.dashed),
            }
        }
    }
    draw_marks(&mut canvas, &axes, marks);
    canvas.finish(&labels.title, &labels.description)
}

/// Dashed horizontal lines with labels in the right margin, moved apart where they would overlap.
fn draw_marks(canvas: &mut Canvas, axes: &Axes, marks: &[Mark]) {
    let mut marks: Vec<&Mark> = marks.iter().filter(|m| m.value.is_finite()).collect();
    marks.sort_by(|a, b| a.value.total_cmp(&b.value));
    let mut lowest_free = f64::INFINITY;
    for mark in marks {
        let (_, level) = axes.pixel((axes.x.0, mark.value));
        canvas.polyline(&[(axes.left, level), (axes.right, level)], Tone::Ink, 1.0, true);
        let at = (level + 4.0).min(lowest_free);
        lowest_free = at - 14.0;
        canvas.text((axes.right + 6.0, at), Anchor::Start, Tone::Ink, "small", &mark.label);
    }
}

/// A histogram with vertical marks. The vertical axis is the count; values that are not finite are left out.
pub fn histogram(labels: &Labels, values: &[f64], marks: &[Mark]) -> Figure {
    const BINS: usize = 48;
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let x = range(finite.iter().copied().chain(marks.iter().map(|m| m.value)), true);
    let mut counts = [0usize; BINS];
    for value in &finite {
        let bin = (value - x.0) / (x.1 - x.0) * BINS as f64;
        counts[(bin as usize).min(BINS - 1)] += 1;
    }
    let highest = counts.iter().copied().max().unwrap_or(0);
    let top = 12.0 + 15.0 * marks.len() as f64;
    let axes =
        Axes::draw(&mut canvas, labels, (top, WIDTH - 16.0), x, (0.0, (highest as f64 * 1.05).max(1.0)));
    let step = (x.1 - x.0) / BINS as f64;
    for (bin, count) in counts.iter().enumerate().filter(|(_, c)| **c > 0) {
        let (left, top) = axes.pixel((x.0 + bin as f64 * step, *count as f64));
        let (right, bottom) = axes.pixel((x.0 + (bin + 1) as f64 * step, 0.0));
        canvas.rect(left + 0.5, top, right - left - 1.0, bottom - top, Tone::First);
    }
    for (row, mark) in marks.iter().enumerate().filter(|(_, m)| m.value.is_finite()) {
        let (at, _) = axes.pixel((mark.value, 0.0));
        let level = 14.0 + 15.0 * row as f64;
        canvas.polyline(&[(at, axes.bottom), (at, level - 8.0)], Tone::Ink, 1.0, true);
        let (anchor, side) = if at > axes.right - 110.0 { (Anchor::End, -5.0) } else { (Anchor::Start, 5.0) };
        canvas.text((at + side, level), anchor, Tone::Ink, "halo small", &mark.label);
    }
    canvas.finish(&labels.title, &labels.description)
}

/// One row of a dot chart.
#[derive(Clone, Debug, Default)]
pub struct Dots {
    /// Name at the left.
    pub label: String,
    /// Values; those that are not positive numbers are left out.
    pub values: Vec<f64>,
}

/// Rows of dots over one logarithmic axis, so that values of any size can be compared.
pub fn dot_chart(labels: &Labels, rows: &[Dots]) -> Figure {
    const ROW: f64 = 22.0;
    let longest = rows.iter().map(|r| r.label.chars().count()).max().unwrap_or(0);
    let left = (20.0 + 7.2 * longest as f64).min(0.5 * WIDTH);
    let bottom = 12.0 + ROW * rows.len() as f64;
    let mut canvas = Canvas::new(WIDTH, bottom + 48.0);
    let positive = |v: &&f64| v.is_finite() && **v > 0.0;
    let all = rows.iter().flat_map(|r| r.values.iter().filter(positive)).map(|v| v.log10());
    let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let (low, high) = if low > high { (0.0, 1.0) } else { ((low - 0.05).floor(), (high + 0.05).ceil()) };
    let at = |v: f64| left + (v.log10() - low) / (high - low) * (WIDTH - 24.0 - left);
    for power in low as i32..=high as i32 {
        let value = 10f64.powi(power);
        canvas.line((at(value), 8.0), (at(value), bottom), Tone::Muted, 1.0);
        let decimals = (-power).max(0) as usize;
        canvas.text(
            (at(value), bottom + 18.0),
            Anchor::Middle,
            Tone::Muted,
            "small",
            &format!("{value:.decimals$}"),
        );
        for between in (2..10).map(|m| f64::from(m) * value).filter(|_| power < high as i32) {
            canvas.line((at(between), 8.0), (at(between), bottom), Tone::Grid, 1.0);
        }
    }
    for (k, row) in rows.iter().enumerate() {
        let level = 12.0 + ROW * (k as f64 + 0.5);
        canvas.text((left - 10.0, level + 4.0), Anchor::End, Tone::Ink, "small", &row.label);
        for value in row.values.iter().filter(positive) {
            canvas.disc((at(*value), level), 4.0, Tone::First, false);
        }
    }
    canvas.text((0.5 * (left + WIDTH), bottom + 38.0), Anchor::Middle, Tone::Ink, "", &labels.x);
    canvas.finish(&labels.title, &labels.description)
}

/// The axes of a chart and the mapping from values to pixels.
struct Axes {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
    x: (f64, f64),
    y: (f64, f64),
}

impl Axes {
    /// Draws the axes; `edges` are the top and the right edge in pixels.
    fn draw(canvas: &mut Canvas, labels: &Labels, edges: (f64, f64), x: (f64, f64), y: (f64, f64)) -> Self {
        let (top, right) = edges;
        let axes = Self { left: 64.0, right, top, bottom: canvas.height - 48.0, x, y };
        for (value, text) in ticks(y, 5) {
            let (_, level) = axes.pixel((x.0, value));
            canvas.line((axes.left, level), (axes.right, level), Tone::Grid, 1.0);
            canvas.text((axes.left - 8.0, level + 4.0), Anchor::End, Tone::Muted, "small", &text);
        }
        for (value, text) in ticks(x, 8) {
            let (at, _) = axes.pixel((value, y.0));
            canvas.line((at, axes.bottom), (at, axes.bottom + 5.0), Tone::Muted, 1.0);
            canvas.text((at, axes.bottom + 18.0), Anchor::Middle, Tone::Muted, "small", &text);
        }
        canvas.line((axes.left, axes.bottom), (axes.right, axes.bottom), Tone::Muted, 1.0);
        canvas.text(
            (0.5 * (axes.left + axes.right), axes.bottom + 38.0),
            Anchor::Middle,
            Tone::Ink,
            "",
            &labels.x,
        );
        canvas.text_upwards((16.0, 0.5 * (axes.top + axes.bottom)), Tone::Ink, &labels.y);
        axes
    }

    fn pixel(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let across = (x - self.x.0) / (self.x.1 - self.x.0);
        let up = (y - self.y.0) / (self.y.1 - self.y.0);
        (self.left + across * (self.right - self.left), self.bottom - up * (self.bottom - self.top))
    }
}

/// Minimum and maximum value, never an empty range; `from_zero` starts at 0 when nothing is negative and adds a margin
/// above.
fn range(values: impl Iterator<Item = f64>, from_zero: bool) -> (f64, f64) {
    let finite = values.filter(|v| v.is_finite());
    let (mut low, mut high) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    if from_zero {
        let margin = 0.06 * (high - low.min(0.0));
        low = if low >= 0.0 { 0.0 } else { low - margin };
        high += margin;
    }
    if high - low > 1e-12 * high.abs().max(low.abs()).max(1e-12) { (low, high) } else { (low, low + 1.0) }
}

/// Tick values within a range, in steps of 1, 2 or 5 times a power of ten, with their labels.
pub(crate) fn ticks(range: (f64, f64), about: usize) -> Vec<(f64, String)> {
    let step = round_step((range.1 - range.0) / about as f64);
    let decimals = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
    let first = (range.0 / step).ceil();
    let count = ((range.1 / step).floor() - first) as usize;
    (0..=count.min(50)).map(|i| (first + i as f64) * step).map(|v| (v, format!("{v:.decimals$}"))).collect()
}

/// The smallest number of the form 1, 2 or 5 times a power of ten that is at least `value`.
pub(crate) fn round_step(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    let step = [1.0, 2.0, 5.0].iter().map(|m| m * power).find(|s| *s >= value * (1.0 - 1e-9));
    step.unwrap_or(10.0 * power)
}

/// Decimates a line: the first, lowest, highest and last point of each pixel column, in order.
fn decimate(pixels: &[(f64, f64)]) -> Vec<(f64, f64)> {
    if pixels.len() < 3000 {
        return pixels.to_vec();
    }
    let mut out = Vec::new();
    for column in pixels.chunk_by(|a, b| a.0.floor() == b.0.floor()) {
        let by_y = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let picks = [column.first(), column.iter().min_by(by_y), column.iter().max_by(by_y), column.last()];
        let mut picks: Vec<(f64, f64)> = picks.into_iter().flatten().copied().collect();
        picks.sort_by(|a, b| a.0.total_cmp(&b.0));
        picks.dedup();
        out.extend(picks);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_in_range() {
        let texts = |r, n| ticks(r, n).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(texts((0.0, 1.0), 5), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(texts((3.0, 47.0), 5), ["10", "20", "30", "40"]);
        assert_eq!(texts((-0.02, 0.011), 4), ["-0.02", "-0.01", "0.00", "0.01"]);
        assert_eq!(range([f64::NAN].into_iter(), true), (0.0, 1.0));
        assert_eq!(range([5.0, 5.0].into_iter(), false), (5.0, 6.0));
        for v in [1e-7, 0.3, 1.0, 9.9, 12345.0] {
            let step = round_step(v);
            assert!(step >= v * (1.0 - 1e-9) && step <= 2.5 * v, "{v}: {step}");
        }
    }

    #[test]
    fn decimation_keeps_every_peak() {
        let mut points: Vec<(f64, f64)> = (0..100_000).map(|i| (f64::from(i) * 0.007, 100.0)).collect();
        points[54_321].1 = 7.0;
        points[777].1 = 300.0;
        let decimated = decimate(&points);
        assert!(decimated.len() < 3000, "{}", decimated.len());
        assert!(decimated.contains(&points[54_321]) && decimated.contains(&points[777]));
        assert_eq!((decimated.first(), decimated.last()), (points.first(), points.last()));
    }

    #[test]
    fn gaps_interrupt_the_line_and_empty_charts_are_drawn() {
        let labels = Labels { title: "t".into(), ..Labels::default() };
        let points = vec![(0.0, 1.0), (1.0, 2.0), (2.0, f64::NAN), (3.0, 1.0), (4.0, 2.0)];
        let count = |points: Vec<(f64, f64)>| {
            let svg = line_chart(&labels, &[Series { points, ..Series::default() }], &[]).standalone();
            svg.matches("line sa").count()
        };
        assert_eq!(count(points), 2);
        assert_eq!(count(Vec::new()), 0);
        let bars = histogram(&labels, &[1.0, 1.0, 2.0, f64::INFINITY], &[]).standalone();
        assert_eq!(bars.matches("<rect class=\"fa\"").count(), 2);
        histogram(&labels, &[], &[]);
    }
}
