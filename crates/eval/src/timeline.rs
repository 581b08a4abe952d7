//! What happened when: rows of stretches and of moments over a common time axis.

use crate::chart::ticks;
use crate::svg::{Anchor, Canvas, Figure, Sample, Tone};

const WIDTH: f64 = 760.0;
/// Left edge of the time axis; the names of the rows are before it.
const LEFT: f64 = 104.0;
const RIGHT: f64 = WIDTH - 20.0;
const ROW: f64 = 30.0;

/// A stretch of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Its first moment, seconds.
    pub from_s: f64,
    /// Its last moment, seconds.
    pub to_s: f64,
    /// Colour.
    pub tone: Tone,
}

/// A moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// When, seconds.
    pub at_s: f64,
    /// The number under which a table explains it; without one it is a thin mark.
    pub number: Option<usize>,
    /// Colour.
    pub tone: Tone,
}

/// A row: stretches as bars, moments as marks on it.
#[derive(Clone, Debug, Default)]
pub struct TimelineRow {
    /// Name.
    pub label: String,
    /// Stretches, drawn in this order.
    pub spans: Vec<Span>,
    /// Moments, drawn above the stretches.
    pub moments: Vec<Moment>,
}

/// Rows over a common time axis.
#[derive(Clone, Debug, Default)]
pub struct Timeline {
    /// Short name of the figure.
    pub title: String,
    /// Text alternative: what the figure shows.
    pub description: String,
    /// First and last time of the axis, seconds.
    pub range_s: (f64, f64),
    /// Names of colours of stretches.
    pub legend: Vec<(String, Tone)>,
    /// From top to bottom.
    pub rows: Vec<TimelineRow>,
}

impl Timeline {
    /// Draws it.
    pub fn figure(&self) -> Figure {
        let entries: Vec<(&str, Tone, Sample)> =
            self.legend.iter().map(|(name, tone)| (name.as_str(), *tone, Sample::Bar)).collect();
        let top = 8.0 + Canvas::new(WIDTH, 0.0).legend(16.0, 8.0, WIDTH - 16.0, &entries);
        let bottom = top + ROW * self.rows.len() as f64 + 6.0;
        let mut canvas = Canvas::new(WIDTH, bottom + 46.0);
        canvas.legend(16.0, 8.0, WIDTH - 16.0, &entries);
        let (from, to) = self.range_s;
        let range = if to > from { (from, to) } else { (from, from + 1.0) };
        let x = |t: f64| LEFT + (t - range.0) / (range.1 - range.0) * (RIGHT - LEFT);
        for (value, text) in ticks(range, 8) {
            canvas.line((x(value), top), (x(value), bottom), Tone::Grid, 1.0);
            canvas.text((x(value), bottom + 18.0), Anchor::Middle, Tone::Muted, "small", &text);
        }
        canvas.line((LEFT, bottom), (RIGHT, bottom), Tone::Muted, 1.0);
        canvas.text((0.5 * (LEFT + RIGHT), bottom + 38.0), Anchor::Middle, Tone::Ink, "", "time [s]");
        for (i, row) in self.rows.iter().enumerate() {
            let middle = top + ROW * (i as f64 + 0.5);
            canvas.text((LEFT - 10.0, middle + 4.0), Anchor::End, Tone::Ink, "", &row.label);
            draw_row(&mut canvas, row, middle, &x);
        }
        canvas.finish(&self.title, &self.description)
    }
}

fn draw_row(canvas: &mut Canvas, row: &TimelineRow, middle: f64, x: &impl Fn(f64) -> f64) {
    let inside = |v: f64| v.clamp(LEFT, RIGHT);
    for span in row.spans.iter().filter(|s| s.from_s.is_finite() && s.to_s.is_finite()) {
        let (a, b) = (inside(x(span.from_s)), inside(x(span.to_s)));
        // A short loss stays visible.
        canvas.rect(a, middle - 8.0, (b - a).max(1.5), 16.0, span.tone);
    }
    let mut last_mark = f64::NEG_INFINITY;
    let mut numbers: Vec<f64> = Vec::new();
    for moment in row.moments.iter().filter(|m| m.at_s.is_finite()) {
        let at = inside(x(moment.at_s));
        match moment.number {
            // Marks that would lie on each other are drawn once.
            None if at - last_mark < 0.5 => {}
            None => {
                last_mark = at;
                canvas.line((at, middle - 7.0), (at, middle + 7.0), moment.tone, 1.0);
            }
            Some(number) => {
                canvas.line((at, middle - 9.0), (at, middle + 9.0), moment.tone, 2.0);
                // A number that would cover another one is left to the table.
                if numbers.iter().all(|n| (n - at).abs() > 20.0) {
                    numbers.push(at);
                    canvas.disc((at, middle), 9.5, moment.tone, true);
                    let text = number.to_string();
                    canvas.text((at, middle + 4.0), Anchor::Middle, moment.tone, "small strong", &text);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timeline() -> Timeline {
        let span = |from_s, to_s, tone| Span { from_s, to_s, tone };
        let moment = |at_s, number| Moment { at_s, number, tone: Tone::Fourth };
        let row = |label: &str| TimelineRow { label: label.into(), ..TimelineRow::default() };
        Timeline {
            title: "t".into(),
            range_s: (0.0, 10.0),
            legend: vec![("lost".into(), Tone::Alarm)],
            rows: vec![
                TimelineRow {
                    spans: vec![span(0.0, 4.0, Tone::Third), span(4.0, 4.001, Tone::Alarm)],
                    ..row("state")
                },
                TimelineRow {
                    moments: vec![moment(2.0, Some(41)), moment(2.1, Some(42)), moment(9.0, Some(43))],
                    ..row("loops")
                },
                TimelineRow {
                    moments: (0..5000).map(|i| moment(0.002 * f64::from(i), None)).collect(),
                    ..row("key frames")
                },
            ],
            ..Timeline::default()
        }
    }

    #[test]
    fn stretches_are_in_place_and_short_ones_visible() {
        let svg = timeline().figure().standalone();
        assert!(svg.contains("class=\"fc\" x=\"104\""), "{svg}");
        assert!(svg.contains("width=\"1.5\""), "the loss of a millisecond is visible");
        assert!(svg.contains(">state<") && svg.contains(">time [s]<"));
    }

    #[test]
    fn crowded_moments_stay_readable() {
        let svg = timeline().figure().standalone();
        // Of the two numbers beside each other one is drawn, and both have their mark.
        assert!(svg.contains(">41<") && !svg.contains(">42<") && svg.contains(">43<"));
        assert!(svg.matches("<path").count() < 1500, "marks that lie on each other are drawn once");
    }

    #[test]
    fn empty_and_broken_times_are_drawn() {
        assert!(Timeline::default().figure().standalone().contains("</svg>"));
        let mut broken = timeline();
        broken.rows[0].spans[0].to_s = f64::NAN;
        broken.range_s = (5.0, 5.0);
        assert!(!broken.figure().standalone().contains("NaN"));
    }
}
