//! A small SVG writer: shapes with CSS classes, as a standalone file or inside a page.
//!
//! Colours are classes, so that one figure works in light and dark mode; every figure has a title and a description as
//! text alternative.

use std::fmt::Write as _;

/// A colour by its role; colours also differ in lightness, and lines may be dashed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tone {
    /// Text and marks.
    Ink,
    /// Axes and secondary text.
    Muted,
    /// Grid lines.
    Grid,
    /// Ground truth: drawn broad below the other lines.
    Truth,
    /// First series: blue.
    #[default]
    First,
    /// Second series: orange.
    Second,
    /// Third series: green.
    Third,
    /// Fourth series: purple.
    Fourth,
    /// Failures: red.
    Alarm,
}

/// Class letter, colour on light background, colour on dark background. Text and series have a contrast of at least
/// 4.5:1 to the background, ground truth 3:1.
const TONES: [(Tone, &str, &str, &str); 9] = [
    (Tone::Ink, "k", "#1b1f24", "#e6edf3"),
    (Tone::Muted, "m", "#57606a", "#a3adb8"),
    (Tone::Grid, "g", "#d8dee4", "#39414b"),
    (Tone::Truth, "t", "#8b949e", "#6e7781"),
    (Tone::First, "a", "#0a5cad", "#6cb6ff"),
    (Tone::Second, "b", "#b04a00", "#ffa657"),
    (Tone::Third, "c", "#0a6b4f", "#57d9a3"),
    (Tone::Fourth, "d", "#8a3ea8", "#d2a8ff"),
    (Tone::Alarm, "e", "#b3261e", "#ff8f87"),
];
const PAPER: (&str, &str) = ("#ffffff", "#14181d");

impl Tone {
    fn class(self) -> &'static str {
        TONES.iter().find(|t| t.0 == self).map_or("k", |t| t.1)
    }
}

/// The CSS of all figures: strokes are `.sX`, fills `.fX`, for light and dark mode.
pub(crate) fn style() -> String {
    let rules = |dark: bool| {
        let paper = if dark { PAPER.1 } else { PAPER.0 };
        let mut css = format!(".paper{{fill:{paper}}}.halo{{stroke:{paper}}}");
        for (_, class, light, dark_colour) in TONES {
            let colour = if dark { dark_colour } else { light };
            let _ = write!(css, ".s{class}{{stroke:{colour}}}.f{class}{{fill:{colour}}}");
        }
        css
    };
    format!(
        "svg text{{font:13px system-ui,sans-serif}}svg .line{{fill:none;stroke-linejoin:round;stroke-linecap:round}}\
         svg .halo{{stroke-width:4px;stroke-linejoin:round;paint-order:stroke}}\
         svg .small{{font-size:11px}}svg .strong{{font-weight:600}}{}@media (prefers-color-scheme:dark){{{}}}",
        rules(false),
        rules(true)
    )
}

/// A finished drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Short name, read first by screen readers.
    pub title: String,
    /// Text alternative: what the figure shows, in one or two sentences.
    pub description: String,
    width: f64,
    height: f64,
    body: String,
}

impl Figure {
    /// SVG element for a page that includes the style; `id` must be unique within the page.
    pub fn inline(&self, id: &str) -> String {
        self.element(id, "")
    }

    /// Standalone SVG file.
    pub fn standalone(&self) -> String {
        let style =
            format!("<style>{}</style><rect class=\"paper\" width=\"100%\" height=\"100%\"/>", style());
        format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}\n", self.element("figure", &style))
    }

    fn element(&self, id: &str, head: &str) -> String {
        let (w, h) = (number(self.width), number(self.height));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" role=\"img\" \
             aria-labelledby=\"{id}-title {id}-desc\"><title id=\"{id}-title\">{}</title>\
             <desc id=\"{id}-desc\">{}</desc>{head}{}</svg>",
            escape(&self.title),
            escape(&self.description),
            self.body
        )
    }
}

/// What stands before a name in a legend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sample {
    Line,
    Dashed,
    Dots,
    Circle,
    Bar,
}

/// Horizontal anchor of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

/// A drawing under construction; coordinates in pixels, y down.
pub(crate) struct Canvas {
    pub(crate) width: f64,
    pub(crate) height: f64,
    body: String,
}

impl Canvas {
    pub(crate) fn new(width: f64, height: f64) -> Self {
        Self { width, height, body: String::new() }
    }

    pub(crate) fn finish(self, title: &str, description: &str) -> Figure {
        let (title, description) = (title.to_owned(), description.to_owned());
        Figure { title, description, width: self.width, height: self.height, body: self.body }
    }

    pub(crate) fn line(&mut self, from: (f64, f64), to: (f64, f64), tone: Tone, width: f64) {
        self.polyline(&[from, to], tone, width, false);
    }

    pub(crate) fn polyline(&mut self, points: &[(f64, f64)], tone: Tone, width: f64, dashed: bool) {
        if points.len() < 2 {
            return;
        }
        let mut path = String::new();
        for (i, (x, y)) in points.iter().enumerate() {
            let _ = write!(path, "{}{} {}", if i == 0 { 'M' } else { 'L' }, number(*x), number(*y));
        }
        let dash = if dashed { " stroke-dasharray=\"7 5\"" } else { "" };
        let _ = write!(
            self.body,
            "<path class=\"line s{}\" stroke-width=\"{}\"{dash} d=\"{path}\"/>",
            tone.class(),
            number(width)
        );
    }

    pub(crate) fn rect(&mut self, x: f64, y: f64, width: f64, height: f64, tone: Tone) {
        let _ = write!(
            self.body,
            "<rect class=\"f{}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>",
            tone.class(),
            number(x),
            number(y),
            number(width.max(0.0)),
            number(height.max(0.0))
        );
    }

    /// A disc in the tone; `hollow` fills it with the background colour.
    pub(crate) fn disc(&mut self, at: (f64, f64), radius: f64, tone: Tone, hollow: bool) {
        let fill = if hollow { "paper".to_owned() } else { format!("f{}", tone.class()) };
        let _ = write!(
            self.body,
            "<circle class=\"{fill} s{}\" stroke-width=\"1.5\" cx=\"{}\" cy=\"{}\" r=\"{}\"/>",
            tone.class(),
            number(at.0),
            number(at.1),
            number(radius)
        );
    }

    /// Dots of 1.5 pixels, all in one element.
    pub(crate) fn dots(&mut self, at: &[(i64, i64)], tone: Tone) {
        if at.is_empty() {
            return;
        }
        let _ = write!(self.body, "<path class=\"line s{}\" stroke-width=\"1.5\" d=\"", tone.class());
        for (x, y) in at {
            let _ = write!(self.body, "M{x} {y}h0");
        }
        self.body.push_str("\"/>");
    }

    /// A filled polygon.
    pub(crate) fn polygon(&mut self, points: &[(f64, f64)], tone: Tone) {
        let list: Vec<String> =
            points.iter().map(|(x, y)| format!("{},{}", number(*x), number(*y))).collect();
        let _ = write!(self.body, "<polygon class=\"f{}\" points=\"{}\"/>", tone.class(), list.join(" "));
    }

    pub(crate) fn text(&mut self, at: (f64, f64), anchor: Anchor, tone: Tone, class: &str, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let _ = write!(
            self.body,
            "<text class=\"f{} {class}\" text-anchor=\"{anchor}\" x=\"{}\" y=\"{}\">{}</text>",
            tone.class(),
            number(at.0),
            number(at.1),
            escape(text)
        );
    }

    /// Vertical text, for the label of the vertical axis.
    pub(crate) fn text_upwards(&mut self, at: (f64, f64), tone: Tone, text: &str) {
        let (x, y) = (number(at.0), number(at.1));
        let _ = write!(
            self.body,
            "<text class=\"f{}\" text-anchor=\"middle\" transform=\"translate({x} {y}) rotate(-90)\">{}</text>",
            tone.class(),
            escape(text)
        );
    }

    /// A legend of samples with labels, from the left; returns the height used.
    pub(crate) fn legend(
        &mut self,
        left: f64,
        top: f64,
        right: f64,
        entries: &[(&str, Tone, Sample)],
    ) -> f64 {
        let (mut x, mut y) = (left, top + 12.0);
        for (label, tone, sample) in entries {
            let width = 40.0 + text_width(label);
            if x > left && x + width > right {
                (x, y) = (left, y + 20.0);
            }
            match sample {
                Sample::Line | Sample::Dashed => self.polyline(
                    &[(x, y - 4.0), (x + 26.0, y - 4.0)],
                    *tone,
                    if *tone == Tone::Truth { 6.0 } else { 2.5 },
                    *sample == Sample::Dashed,
                ),
                Sample::Dots => {
                    let at = [(4, -7), (12, -2), (17, -8), (23, -4)];
                    self.dots(&at.map(|(dx, dy)| (x as i64 + dx, y as i64 + dy)), *tone);
                }
                Sample::Circle => self.disc((x + 13.0, y - 4.0), 2.6, *tone, true),
                Sample::Bar => self.rect(x, y - 10.0, 26.0, 11.0, *tone),
            }
            self.text((x + 32.0, y), Anchor::Start, Tone::Ink, "", label);
            x += width + 16.0;
        }
        if entries.is_empty() { 0.0 } else { y - top + 10.0 }
    }
}

/// Approximate width of a text at 13 px.
pub(crate) fn text_width(text: &str) -> f64 {
    text.chars().count() as f64 * 7.2
}

/// A coordinate with at most one decimal.
fn number(value: f64) -> String {
    if !value.is_finite() {
        return "0".to_owned();
    }
    let text = format!("{value:.1}");
    text.strip_suffix(".0").unwrap_or(&text).to_owned()
}

/// Escapes text for XML and HTML, also within quotes; control characters are dropped.
pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\t' | '\n' => out.push(c),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => {}
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped() {
        assert_eq!(escape("<a b=\"c\">&'\u{0}x"), "&lt;a b=&quot;c&quot;&gt;&amp;&#39;x");
        let mut canvas = Canvas::new(10.0, 10.0);
        canvas.text((f64::NAN, 1.26), Anchor::Start, Tone::Ink, "", "</text><script>");
        let figure = canvas.finish("<t>", "d & d");
        let svg = figure.standalone();
        assert!(!svg.contains("<script") && svg.contains("&lt;t&gt;") && svg.contains("d &amp; d"));
        assert!(svg.contains("x=\"0\" y=\"1.3\""));
        assert!(svg.contains("role=\"img\"") && svg.contains("aria-labelledby=\"figure-title figure-desc\""));
    }

    /// Relative luminance and contrast as WCAG 2 defines them.
    fn contrast(a: &str, b: &str) -> f64 {
        let luminance = |hex: &str| {
            let channel = |i: usize| {
                let v = f64::from(u8::from_str_radix(&hex[i..i + 2], 16).unwrap()) / 255.0;
                if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
            };
            0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5)
        };
        let (x, y) = (luminance(a), luminance(b));
        (x.max(y) + 0.05) / (x.min(y) + 0.05)
    }

    #[test]
    fn tones_have_enough_contrast() {
        for (tone, _, light, dark) in TONES {
            let min_contrast = match tone {
                Tone::Grid => continue,
                Tone::Truth => 3.0,
                _ => 4.5,
            };
            assert!(
                contrast(light, PAPER.0) >= min_contrast,
                "{tone:?} on light: {}",
                contrast(light, PAPER.0)
            );
            assert!(contrast(dark, PAPER.1) >= min_contrast, "{tone:?} on dark: {}", contrast(dark, PAPER.1));
        }
    }
}
