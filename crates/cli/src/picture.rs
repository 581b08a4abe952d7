//! A way as an SVG picture, seen from above: the record thin and grey, the cleaned way thick, its ends named, a scale bar.

use cairn_guide::{WayDrawing, WayInfo};
use std::fmt::Write;

/// The longer side of the drawing, in pixels.
const SIZE: f64 = 900.0;
/// Room around it.
const MARGIN: f64 = 50.0;

/// Where metres go on the sheet; y points up on the ground and down on the sheet.
struct Sheet {
    low: [f64; 2],
    high: [f64; 2],
    scale: f64,
}

impl Sheet {
    fn around(points: &[[f64; 2]]) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in points {
            for axis in 0..2 {
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
        }
        if points.is_empty() {
            (low, high) = ([0.0; 2], [0.0; 2]);
        }
        // A way that stands still is drawn in a square metre.
        let span = (high[0] - low[0]).max(high[1] - low[1]).max(1.0);
        Self { low, high, scale: SIZE / span }
    }

    fn at(&self, p: &[f64; 2]) -> [f64; 2] {
        [MARGIN + (p[0] - self.low[0]) * self.scale, MARGIN + (self.high[1] - p[1]) * self.scale]
    }

    /// Width and height in pixels, with room for the scale bar below.
    fn size(&self) -> [f64; 2] {
        let [w, h] = [0, 1].map(|axis| (self.high[axis] - self.low[axis]) * self.scale + 2.0 * MARGIN);
        [w.max(320.0), h + 40.0]
    }

    fn line(&self, points: &[[f64; 2]]) -> String {
        let pixels = points.iter().map(|p| self.at(p)).map(|[x, y]| format!("{x:.1},{y:.1}"));
        pixels.collect::<Vec<_>>().join(" ")
    }
}

/// The picture, with a title and a description that a screen reader can read.
pub fn way(drawing: &WayDrawing, info: &WayInfo) -> String {
    let sheet = Sheet::around(&[&drawing.recorded[..], &drawing.cleaned[..]].concat());
    let [w, h] = sheet.size();
    let mut svg = String::new();
    // Writing to a string does not fail.
    let _ = write!(
        svg,
        r##"<svg xmlns="http://www.w3.org/2000/svg" width="{w:.0}" height="{h:.0}" viewBox="0 0 {w:.0} {h:.0}" role="img" font-family="sans-serif" font-size="15">
<title>A way of {:.1} m, cleaned to {:.1} m</title>
<desc>{} turns, {} detours cut out, {} stairs; recorded from {}</desc>
<rect width="100%" height="100%" fill="#ffffff"/>
<polyline points="{}" fill="none" stroke="#8a8a8a" stroke-width="1.5"/>
<polyline points="{}" fill="none" stroke="#0b5394" stroke-width="4" stroke-linejoin="round"/>
"##,
        info.length_m,
        info.cleaned_m,
        info.turns,
        info.cuts,
        info.stairs,
        escape(&info.source),
        sheet.line(&drawing.recorded),
        sheet.line(&drawing.cleaned),
    );
    for [x, y] in drawing.cuts.iter().map(|p| sheet.at(p)) {
        let _ = writeln!(
            svg,
            r##"<circle cx="{x:.1}" cy="{y:.1}" r="6" fill="none" stroke="#b45f06" stroke-width="2"/>"##
        );
    }
    for (name, point) in [("start", drawing.cleaned.first()), ("end", drawing.cleaned.last())] {
        let Some([x, y]) = point.map(|p| sheet.at(p)) else { continue };
        let (label_x, label_y) = (x + 10.0, if name == "start" { y - 8.0 } else { y + 20.0 });
        let _ = writeln!(svg, r##"<circle cx="{x:.1}" cy="{y:.1}" r="6" fill="#0b5394"/>"##);
        let _ = writeln!(svg, r#"<text x="{label_x:.1}" y="{label_y:.1}">{name}</text>"#);
    }
    let (metres, below) = (bar(SIZE / sheet.scale), h - 22.0);
    let _ = writeln!(
        svg,
        r##"<path d="M {MARGIN} {below:.1} h {:.1}" stroke="#000000" stroke-width="3"/>
<text x="{MARGIN}" y="{:.1}">{metres} m</text>
</svg>"##,
        metres * sheet.scale,
        below - 7.0
    );
    svg
}

/// A round length for the scale bar: about a fifth of the span.
fn bar(span_m: f64) -> f64 {
    let decade = 10f64.powf((span_m / 5.0).log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|n| n * decade).find(|m| *m <= span_m / 5.0).unwrap_or(decade)
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info() -> WayInfo {
        WayInfo {
            source: "a <b> & c".into(),
            metric: true,
            points: 3,
            duration_s: 1.0,
            length_m: 20.0,
            bridged_m: 0.0,
            gap_m: 0.0,
            cleaned_m: 20.0,
            cuts: 0,
            turns: 1,
            stairs: 0,
            largest_distance_m: 0.0,
            torn: false,
        }
    }

    #[test]
    fn north_is_up_and_all_lies_on_the_sheet() {
        let recorded = vec![[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]];
        let sheet = Sheet::around(&recorded);
        let ([w, h], [a, c]) = (sheet.size(), [sheet.at(&recorded[0]), sheet.at(&recorded[2])]);
        assert!(c[1] < a[1] && c[0] > a[0]);
        assert!([a, c].iter().all(|p| p[0] > 0.0 && p[0] < w && p[1] > 0.0 && p[1] < h));
        let drawing = WayDrawing { cleaned: recorded.clone(), recorded, cuts: vec![[5.0, 0.0]] };
        let svg = way(&drawing, &info());
        assert!(
            svg.contains("a &lt;b&gt; &amp; c") && svg.contains(">2 m<") && svg.ends_with("</svg>\n"),
            "{svg}"
        );
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn a_way_without_points_or_motion_is_drawn_too() {
        for recorded in [vec![], vec![[3.0, 4.0]], vec![[3.0, 4.0]; 2]] {
            let drawing = WayDrawing { cleaned: recorded.clone(), recorded, cuts: vec![] };
            let svg = way(&drawing, &info());
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }

    #[test]
    fn scale_bars_are_round() {
        assert_eq!([bar(10.0), bar(12.0), bar(40.0), bar(500.0)], [2.0, 2.0, 5.0, 100.0]);
    }
}
