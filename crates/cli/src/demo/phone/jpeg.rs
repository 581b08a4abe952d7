//! Grey JPEGs, as a phone's browser makes them of its pictures: baseline, sequential, with the usual tables.
//!
//! ITU-T T.81 (1992): tables K.1, K.3 and K.5 of annex K, the coding of annex F.1.2. The quality scales the table of the
//! quantiser as in the Independent JPEG Group's library (50 is the table itself).

use cairn_sensor::GrayImage;
use std::f32::consts::PI;

/// Order of the coefficients, figure 5 of T.81.
const ZIGZAG: [u8; 64] = [
    0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25, 18, 11, 4, 5, 12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13, 6, 7,
    14, 21, 28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39,
    46, 53, 60, 61, 54, 47, 55, 62, 63,
];
/// Table K.1.
const LUMINANCE: [u8; 64] = [
    16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56, 14, 17,
    22, 29, 51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92, 49, 64, 78,
    87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99,
];
/// Table K.3: how many codes there are of each length, and their values.
const DC_LENGTHS: [u8; 16] = [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0];
const DC_VALUES: [u8; 12] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];
/// Table K.5.
const AC_LENGTHS: [u8; 16] = [0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7d];
const AC_VALUES: [u8; 162] = [
    0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22,
    0x71, 0x14, 0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0, 0x24, 0x33,
    0x62, 0x72, 0x82, 0x09, 0x0a, 0x16, 0x17, 0x18, 0x19, 0x1a, 0x25, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x34,
    0x35, 0x36, 0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55,
    0x56, 0x57, 0x58, 0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76,
    0x77, 0x78, 0x79, 0x7a, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96,
    0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5,
    0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4,
    0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda, 0xe1, 0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf1,
    0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa,
];

/// Encodes images of one quality.
pub struct JpegEncoder {
    quantiser: [u8; 64],
    cosines: [[f32; 8]; 8],
    dc: [(u16, u8); 256],
    ac: [(u16, u8); 256],
}

impl JpegEncoder {
    /// `quality` from 1 to 100.
    pub fn new(quality: u8) -> Self {
        let q = u32::from(quality.clamp(1, 100));
        let scale = if q < 50 { 5000 / q } else { 200 - 2 * q };
        let quantiser = LUMINANCE.map(|v| ((u32::from(v) * scale + 50) / 100).clamp(1, 255) as u8);
        let cosines = std::array::from_fn(|u| {
            let norm = if u == 0 { 0.125f32.sqrt() } else { 0.5 };
            std::array::from_fn(|x| norm * ((2 * x + 1) as f32 * u as f32 * PI / 16.0).cos())
        });
        Self { quantiser, cosines, dc: codes(&DC_LENGTHS, &DC_VALUES), ac: codes(&AC_LENGTHS, &AC_VALUES) }
    }

    /// The image as a file; of sides up to 65,535.
    pub fn encode(&self, image: &GrayImage) -> Vec<u8> {
        let (w, h) = (image.width(), image.height());
        let mut out = self.head(w as u16, h as u16);
        let mut bits = Bits { out: &mut out, kept: 0, count: 0 };
        let mut before = 0;
        for by in (0..h).step_by(8) {
            for bx in (0..w).step_by(8) {
                before = self.block(&self.coefficients(image, bx, by), before, &mut bits);
            }
        }
        bits.put(0x7f, 7);
        out.extend([0xff, 0xd9]);
        out
    }

    fn head(&self, w: u16, h: u16) -> Vec<u8> {
        let mut out = vec![0xff, 0xd8, 0xff, 0xdb, 0, 67, 0];
        out.extend(ZIGZAG.map(|k| self.quantiser[k as usize]));
        out.extend([0xff, 0xc0, 0, 11, 8]);
        out.extend(h.to_be_bytes());
        out.extend(w.to_be_bytes());
        out.extend([1, 1, 0x11, 0]);
        for (class, lengths, values) in
            [(0, &DC_LENGTHS, &DC_VALUES[..]), (0x10, &AC_LENGTHS, &AC_VALUES[..])]
        {
            out.extend([0xff, 0xc4]);
            out.extend((19 + values.len() as u16).to_be_bytes());
            out.push(class);
            out.extend(lengths);
            out.extend(values);
        }
        out.extend([0xff, 0xda, 0, 8, 1, 1, 0, 0, 63, 0]);
        out
    }

    /// The quantised coefficients of a block in zigzag order; rows and columns past the edge repeat it.
    fn coefficients(&self, image: &GrayImage, bx: usize, by: usize) -> [i32; 64] {
        let mut rows = [[0f32; 8]; 8];
        for (y, out) in rows.iter_mut().enumerate() {
            let row = image.row((by + y).min(image.height() - 1));
            let p: [f32; 8] = std::array::from_fn(|x| f32::from(row[(bx + x).min(row.len() - 1)]) - 128.0);
            for (o, c) in out.iter_mut().zip(&self.cosines) {
                *o = c.iter().zip(&p).map(|(c, p)| c * p).sum();
            }
        }
        let mut found = [0; 64];
        for (v, c) in self.cosines.iter().enumerate() {
            for u in 0..8 {
                let sum: f32 = (0..8).map(|y| c[y] * rows[y][u]).sum();
                found[8 * v + u] = (sum / f32::from(self.quantiser[8 * v + u])).round() as i32;
            }
        }
        ZIGZAG.map(|k| found[k as usize])
    }

    /// Writes a block; returns its first coefficient, from which the next block's differs little.
    fn block(&self, zigzag: &[i32; 64], before: i32, bits: &mut Bits) -> i32 {
        let put = |bits: &mut Bits, codes: &[(u16, u8); 256], run: u8, value: i32| {
            let size = (32 - value.unsigned_abs().leading_zeros()) as u8;
            let (code, length) = codes[usize::from(run << 4 | size)];
            bits.put(u32::from(code), length);
            let low = if value < 0 { value - 1 } else { value };
            bits.put(low as u32 & ((1 << size) - 1), size);
        };
        put(bits, &self.dc, 0, zigzag[0] - before);
        let mut run = 0;
        for value in &zigzag[1..] {
            if *value == 0 {
                run += 1;
                continue;
            }
            while run > 15 {
                bits.put(u32::from(self.ac[0xf0].0), self.ac[0xf0].1);
                run -= 16;
            }
            put(bits, &self.ac, run, *value);
            run = 0;
        }
        if run > 0 {
            bits.put(u32::from(self.ac[0].0), self.ac[0].1);
        }
        zigzag[0]
    }
}

/// Codes and their lengths by value, as annex C of T.81 builds them.
fn codes(lengths: &[u8; 16], values: &[u8]) -> [(u16, u8); 256] {
    let mut out = [(0, 0); 256];
    let (mut code, mut values) = (0u16, values.iter());
    for (length, count) in (1u8..).zip(lengths) {
        for value in values.by_ref().take(usize::from(*count)) {
            out[usize::from(*value)] = (code, length);
            code = code.wrapping_add(1);
        }
        code <<= 1;
    }
    out
}

/// Bits behind one another, the highest first; after a byte of ones a zero byte follows.
struct Bits<'a> {
    out: &'a mut Vec<u8>,
    kept: u32,
    count: u8,
}

impl Bits<'_> {
    fn put(&mut self, value: u32, length: u8) {
        for k in (0..length).rev() {
            self.kept = self.kept << 1 | (value >> k & 1);
            self.count += 1;
            if self.count == 8 {
                self.out.push(self.kept as u8);
                if self.kept as u8 == 0xff {
                    self.out.push(0);
                }
                (self.kept, self.count) = (0, 0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_sources::read_gray;

    /// What another program's decoder makes of it is the image, the better the higher the quality.
    #[test]
    fn decodes_to_nearly_the_same_image() {
        let (w, h) = (83, 45);
        let mut image = GrayImage::new(w, h);
        for y in 0..h {
            for x in 0..w {
                let wave = (0.21 * x as f64).sin() * (0.13 * y as f64 + 1.0).cos();
                image.row_mut(y)[x] = (128.0 + 90.0 * wave + if x > 40 { 30.0 } else { -30.0 }) as u8;
            }
        }
        let mut errors = Vec::new();
        let file = std::env::temp_dir().join(format!("cairn-jpeg-{}.jpg", std::process::id()));
        for quality in [20, 50, 80, 98] {
            let bytes = JpegEncoder::new(quality).encode(&image);
            std::fs::write(&file, bytes).unwrap();
            let decoded = read_gray(&file).unwrap();
            assert_eq!((decoded.width(), decoded.height()), (w, h));
            let square = |(a, b): (&u8, &u8)| (f64::from(*a) - f64::from(*b)).powi(2);
            let sum: f64 = image.data().iter().zip(decoded.data()).map(square).sum();
            errors.push((sum / (w * h) as f64).sqrt());
        }
        let _ = std::fs::remove_file(file);
        assert!(errors[0] < 8.0 && errors[3] < 1.0 && errors.is_sorted_by(|a, b| a > b), "{errors:?}");
    }
}
