//! A picture of a grid with paths on it: PNG, or SVG with the grid as an embedded PNG. North (greatest y) is up.

use crate::grid::{Cell, Grid};
use cairn_geometry::Vec2;
use std::fmt::Write;

/// Red, green and blue.
pub type Colour = [u8; 3];

/// Approximate length of the longer side of a PNG in pixels: small grids are enlarged to it.
const SIDE: usize = 900;

/// A coloured grid and lines over it, in cells from the grid's corner.
pub struct Picture {
    cells: Grid<Colour>,
    lines: Vec<(Vec<Vec2>, Colour)>,
    dots: Vec<(Vec2, Colour)>,
}

impl Picture {
    /// A picture of the grid, with a colour for each value.
    pub fn new<T: Copy>(grid: &Grid<T>, colour: impl FnMut(T) -> Colour) -> Self {
        Self { cells: grid.map(colour), lines: Vec::new(), dots: Vec::new() }
    }

    /// Adds a path through cell centres.
    pub fn path(self, cells: &[Cell], colour: Colour) -> Self {
        let middle = |c: &Cell| Vec2::new(f64::from(c.x) + 0.5, f64::from(c.y) + 0.5);
        self.line(cells.iter().map(middle).collect(), colour)
    }

    /// Adds a path through points (metres, world).
    pub fn points(self, points: &[Vec2], colour: Colour) -> Self {
        let frame = *self.cells.frame();
        self.line(points.iter().map(|&p| frame.in_cells(p)).collect(), colour)
    }

    fn line(mut self, line: Vec<Vec2>, colour: Colour) -> Self {
        if let (Some(&first), Some(&last)) = (line.first(), line.last()) {
            self.dots.push((first, [40, 160, 70]));
            self.dots.push((last, [200, 40, 40]));
        }
        self.lines.push((line, colour));
        self
    }

    /// The picture as PNG.
    ///
    /// # Errors
    /// When the PNG encoder fails, which does not happen with enough memory.
    pub fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let (width, height) = (self.cells.frame().width(), self.cells.frame().height());
        let times = (SIDE / width.max(height)).max(1);
        let (w, h) = (width * times, height * times);
        let mut pixels: Vec<u8> = Vec::with_capacity(w * h * 3);
        for y in (0..h).rev() {
            let row = self.cells.row(y / times);
            pixels.extend(row.iter().flat_map(|&c| std::iter::repeat_n(c, times)).flatten());
        }
        let mut dab = |at: Vec2, radius: f64, colour: Colour| {
            let (cx, cy) = (at.x * times as f64, h as f64 - at.y * times as f64);
            for y in (cy - radius).max(0.0) as usize..((cy + radius) as usize + 1).min(h) {
                for x in (cx - radius).max(0.0) as usize..((cx + radius) as usize + 1).min(w) {
                    if (x as f64 + 0.5 - cx).hypot(y as f64 + 0.5 - cy) <= radius {
                        pixels[(y * w + x) * 3..][..3].copy_from_slice(&colour);
                    }
                }
            }
        };
        let thick = (w.max(h) as f64 / 500.0).max(1.0);
        for (line, colour) in &self.lines {
            for pair in line.windows(2) {
                let steps = ((pair[1] - pair[0]).norm() * times as f64 * 2.0).ceil().clamp(1.0, 1e6);
                (0..=steps as usize)
                    .for_each(|k| dab(pair[0] + (pair[1] - pair[0]) * (k as f64 / steps), thick, *colour));
            }
        }
        self.dots.iter().for_each(|&(at, colour)| dab(at, 3.0 * thick, colour));
        encode(w, h, &pixels)
    }

    /// The picture as SVG; its unit is one cell.
    ///
    /// # Errors
    /// When the encoder of the embedded PNG fails.
    pub fn svg(&self) -> Result<String, png::EncodingError> {
        let (w, h) = (self.cells.frame().width(), self.cells.frame().height());
        let pixels: Vec<u8> =
            (0..h).rev().flat_map(|y| self.cells.row(y).iter().copied().flatten()).collect();
        let data = base64(&encode(w, h, &pixels)?);
        let thick = (w.max(h) as f64 / 400.0).max(0.2);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" role=\"img\">\n\
             <title>Map with a planned path</title>\n\
             <image width=\"{w}\" height=\"{h}\" style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{data}\"/>\n"
        );
        let hex = |c: &Colour| format!("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]);
        // Writing to a string cannot fail.
        for (line, colour) in &self.lines {
            let points: Vec<String> =
                line.iter().map(|p| format!("{:.2},{:.2}", p.x, h as f64 - p.y)).collect();
            let _ = writeln!(
                svg,
                "<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"{thick:.2}\" stroke-linejoin=\"round\" points=\"{}\"/>",
                hex(colour),
                points.join(" ")
            );
        }
        for (at, colour) in &self.dots {
            let (x, y, r) = (at.x, h as f64 - at.y, 2.5 * thick);
            let _ =
                writeln!(svg, "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{r:.2}\" fill=\"{}\"/>", hex(colour));
        }
        svg.push_str("</svg>\n");
        Ok(svg)
    }
}

fn encode(width: usize, height: usize, rgb: &[u8]) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header()?.write_image_data(rgb)?;
    Ok(bytes)
}

/// Base64 (RFC 4648, section 4).
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let word = three.iter().enumerate().fold(0u32, |w, (k, &b)| w | u32::from(b) << (16 - 8 * k));
        for k in 0..4 {
            let letter = LETTERS[(word >> (18 - 6 * k) & 63) as usize];
            text.push(if k <= three.len() { char::from(letter) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_as_in_the_rfc() {
        let told = ["", "f", "fo", "foo", "foob", "fooba", "foobar"].map(|t| base64(t.as_bytes()));
        assert_eq!(told, ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy"]);
    }
}
