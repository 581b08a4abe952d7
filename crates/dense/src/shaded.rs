//! A view with its shades: the gray image of a depth frame's pixels, halved several times, and the depth beside it.
//!
//! What changes slowly over the image is taken out: a lens darkens its corners and a lamp at the camera lights the middle, and both stay
//! where they are in the image while the camera moves. Before a blank wall they would say that it stands still.

use crate::DenseError;
use crate::frame::DepthFrame;
use cairn_sensor::{Camera, GrayImage, Image};
use nalgebra::{SMatrix, SVector};

/// The finest level is at most this wide: half a pixel more would tell little, and takes four times as long.
const WIDEST: usize = 320;
/// The coarsest level is at least this wide.
const NARROWEST: usize = 40;

/// What a camera saw, for [`crate::track_photometric`].
#[derive(Clone, Debug)]
pub struct ShadedView {
    /// Finest first; never empty.
    pub(crate) levels: Vec<Shades>,
    /// Depth in metres of the finest level's pixels; 0 where there is none.
    depth_m: Image<f32>,
}

/// One level of the gray image.
#[derive(Clone, Debug)]
pub(crate) struct Shades {
    pub camera: Camera,
    pub image: Image<f32>,
}

impl ShadedView {
    /// The view of a frame; `gray` shows the frame's pixels ([`crate::DepthPreparer::shades`]).
    ///
    /// # Errors
    /// A gray image of another size.
    pub fn new(frame: &DepthFrame, gray: &GrayImage) -> Result<Self, DenseError> {
        if (gray.width(), gray.height()) != (frame.width(), frame.height()) {
            return Err(DenseError::Size {
                what: "gray",
                width: gray.width(),
                height: gray.height(),
                expected_width: frame.width(),
                expected_height: frame.height(),
            });
        }
        let mut finest = Shades { camera: *frame.camera(), image: Image::new(gray.width(), gray.height()) };
        finest.image.data_mut().iter_mut().zip(gray.data()).for_each(|(out, v)| *out = f32::from(*v));
        let mut times = 1;
        while finest.camera.width > WIDEST {
            (finest, times) = (finest.halved(), 2 * times);
        }
        flatten(&mut finest.image);
        let mut depth_m = Image::new(finest.camera.width, finest.camera.height);
        for y in 0..finest.camera.height {
            for (x, z) in depth_m.row_mut(y).iter_mut().enumerate() {
                *z = frame.depth_m(x * times + times / 2, y * times + times / 2).unwrap_or(0.0);
            }
        }
        let mut levels = vec![finest];
        while let Some(last) = levels.last().filter(|l| l.camera.width >= 2 * NARROWEST) {
            let next = last.halved();
            levels.push(next);
        }
        Ok(Self { levels, depth_m })
    }

    /// Depth in metres at the pixel of a level nearest to `(x, y)`.
    #[inline]
    pub(crate) fn depth_m(&self, level: usize, x: f64, y: f64) -> Option<f64> {
        let times = (1usize << level) as f64;
        let at = |v: f64| ((v + 0.5) * times) as usize;
        self.depth_m.get(at(x.max(0.0)), at(y.max(0.0))).filter(|z| *z > 0.0).map(f64::from)
    }
}

impl Shades {
    /// Half as wide and high, each pixel the mean of four.
    fn halved(&self) -> Self {
        let c = &self.camera;
        let camera = Camera {
            width: c.width / 2,
            height: c.height / 2,
            fx: c.fx / 2.0,
            fy: c.fy / 2.0,
            cx: (c.cx + 0.5) / 2.0 - 0.5,
            cy: (c.cy + 0.5) / 2.0 - 0.5,
            ..*c
        };
        let mut image = Image::new(camera.width, camera.height);
        for y in 0..camera.height {
            let (above, below) = (self.image.row(2 * y), self.image.row(2 * y + 1));
            let pairs = above.chunks_exact(2).zip(below.chunks_exact(2));
            for (out, (a, b)) in image.row_mut(y).iter_mut().zip(pairs) {
                *out = 0.25 * (a[0] + a[1] + b[0] + b[1]);
            }
        }
        Self { camera, image }
    }

    /// Shade between pixels, and its gradient per pixel; `None` within two pixels of the border.
    #[inline]
    pub fn at(&self, x: f64, y: f64) -> Option<[f64; 3]> {
        let (w, h) = (self.image.width(), self.image.height());
        if !(x >= 1.0 && y >= 1.0 && x < w as f64 - 2.0 && y < h as f64 - 2.0) {
            return None;
        }
        let (left, top) = (x as usize, y as usize);
        let (u, v) = ((x - left as f64) as f32, (y - top as f64) as f32);
        let rows = self.image.data().get((top - 1) * w + left - 1..)?;
        let pixel = |i: usize, j: usize| rows[j * w + i];
        // Along x in each of the four rows: the shade, and half the difference of its neighbours.
        let along = |j: usize| {
            let (a, b, c, d) = (pixel(0, j), pixel(1, j), pixel(2, j), pixel(3, j));
            [b + (c - b) * u, 0.5 * ((c - a) + ((d - b) - (c - a)) * u)]
        };
        let [above, first, second, below] = [0, 1, 2, 3].map(along);
        let shade = first[0] + (second[0] - first[0]) * v;
        let dx = first[1] + (second[1] - first[1]) * v;
        let (dy_first, dy_second) = (second[0] - above[0], below[0] - first[0]);
        let dy = 0.5 * (dy_first + (dy_second - dy_first) * v);
        Some([shade, dx, dy].map(f64::from))
    }
}

/// Terms of a polynomial of fourth degree in two variables.
const TERMS: usize = 15;
/// Pixels from one to the next that it is fitted to.
const FITTED: usize = 4;

/// Takes out what a polynomial of fourth degree makes of the image.
fn flatten(image: &mut Image<f32>) {
    let (w, h) = (image.width(), image.height());
    let terms = |x: usize, y: usize| {
        let (u, v) = (2.0 * x as f32 / w as f32 - 1.0, 2.0 * y as f32 / h as f32 - 1.0);
        let (uu, vv) = (u * u, v * v);
        let all = [1.0, u, v, uu, u * v, vv, uu * u, uu * v, u * vv, vv * v];
        let fourth = [uu * uu, uu * u * v, uu * vv, u * v * vv, vv * vv];
        SVector::<f32, TERMS>::from_iterator(all.into_iter().chain(fourth))
    };
    let (mut normal, mut right) = (SMatrix::<f32, TERMS, TERMS>::identity() * 1e-3, SVector::zeros());
    for y in (0..h).step_by(FITTED) {
        for x in (0..w).step_by(FITTED) {
            let t = terms(x, y);
            normal += t * t.transpose();
            right += t * image.at(x, y);
        }
    }
    let Some(fit) = normal.cholesky().map(|c| c.solve(&right)) else { return };
    for y in 0..h {
        for (x, shade) in image.row_mut(y).iter_mut().enumerate() {
            *shade -= terms(x, y).dot(&fit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The dark corners of a lens are gone, and a line of one pixel is still there.
    #[test]
    fn what_changes_slowly_is_taken_out() {
        let mut image = Image::new(160, 120);
        for y in 0..120 {
            for x in 0..160 {
                let (u, v) = ((x as f32 - 79.5) / 100.0, (y as f32 - 59.5) / 100.0);
                image.row_mut(y)[x] = 150.0 * (1.0 - 0.15 * (u * u + v * v)) + 0.1 * x as f32;
            }
            image.row_mut(y)[50] += 20.0;
        }
        flatten(&mut image);
        let most = (0..160).filter(|x| *x != 50).map(|x| image.at(x, 40).abs()).fold(0.0, f32::max);
        assert!(most < 1.0 && image.at(50, 40) > 18.0, "{most} {}", image.at(50, 40));
    }

    /// A level shows the same rays as the image that it was halved from, and the gradient is that of a slope.
    #[test]
    fn a_slope_stays_where_it_is_when_halved() {
        let camera = Camera::pinhole(160, 120, 140.0, 140.0, 79.5, 59.5);
        let mut image = Image::new(160, 120);
        for y in 0..120 {
            (0..160).for_each(|x| image.row_mut(y)[x] = 0.5 * x as f32 + 0.25 * y as f32);
        }
        let fine = Shades { camera, image };
        let coarse = fine.halved();
        let ray = [0.1, -0.2];
        let of = |s: &Shades| {
            let c = &s.camera;
            s.at(ray[0] * c.fx + c.cx, ray[1] * c.fy + c.cy).expect("inside")
        };
        let ([a, ax, ay], [b, bx, by]) = (of(&fine), of(&coarse));
        assert!((a - b).abs() < 1e-4 && (a - (0.5 * 93.5 + 0.25 * 31.5)).abs() < 1e-4, "{a} {b}");
        assert!((ax - 0.5).abs() < 1e-4 && (ay - 0.25).abs() < 1e-4, "{ax} {ay}");
        assert!((bx - 1.0).abs() < 1e-4 && (by - 0.5).abs() < 1e-4, "{bx} {by}");
        assert!(
            fine.at(0.5, 50.0).is_none()
                && fine.at(158.1, 50.0).is_none()
                && fine.at(f64::NAN, 9.0).is_none()
        );
        assert!(fine.at(157.9, 117.9).is_some());
    }
}
