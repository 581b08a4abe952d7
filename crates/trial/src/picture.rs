//! Pictures as a browser makes them: smaller, and as JPEG files.

use cairn_sensor::GrayImage;

/// A grey image as a JPEG file, as a browser makes it; empty where that fails, and then refused by the server.
pub fn encoded(image: &GrayImage, quality: u8) -> Vec<u8> {
    let mut file = Vec::new();
    let [w, h] = [image.width(), image.height()].map(|side| u16::try_from(side).unwrap_or(u16::MAX));
    let encoder = jpeg_encoder::Encoder::new(&mut file, quality);
    match encoder.encode(image.data(), w, h, jpeg_encoder::ColorType::Luma) {
        Ok(()) => file,
        Err(_) => Vec::new(),
    }
}

/// An image of a share of the size, bilinear, as a browser's canvas makes it.
pub fn smaller(image: &GrayImage, scale: f64) -> GrayImage {
    let size = [image.width(), image.height()].map(|s| ((s as f64 * scale).round() as usize).max(1));
    let mut out = GrayImage::new(size[0], size[1]);
    let at = |k: usize, from: usize, to: usize| {
        let v = ((k as f64 + 0.5) * from as f64 / to as f64 - 0.5).clamp(0.0, (from - 1) as f64);
        let i = (v as usize).min(from.saturating_sub(2));
        (i, v - i as f64)
    };
    for y in 0..size[1] {
        let (j, b) = at(y, image.height(), size[1]);
        for x in 0..size[0] {
            let (i, a) = at(x, image.width(), size[0]);
            let p = |dx: usize, dy: usize| f64::from(image.row(j + dy)[i + dx]);
            let top = p(0, 0) * (1.0 - a) + p(1, 0) * a;
            let bottom = p(0, 1) * (1.0 - a) + p(1, 1) * a;
            out.row_mut(y)[x] = (top * (1.0 - b) + bottom * b + 0.5) as u8;
        }
    }
    out
}
