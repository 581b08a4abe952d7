//! How a cube of space projects into a depth image: the pixels it covers, and their depths.

use crate::block::BlockKey;
use crate::frame::DepthFrame;
use cairn_geometry::Se3;
use cairn_sensor::Camera;

/// Nothing nearer to the camera's plane than this is projected, in metres.
pub(crate) const NEAREST_M: f32 = 0.05;

/// Result of comparing a cube with the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Visibility {
    /// Behind the camera, or outside the image.
    Outside,
    /// So near that it reaches behind the camera: it cannot be judged as a whole.
    Near,
    /// In the image.
    Inside(Cover),
}

/// The cube's depths and those of the pixels its image covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cover {
    /// Least and greatest depth of the cube.
    pub cube: [f32; 2],
    /// Least depth of the pixels that have one, greatest depth, and the least depth that can be trusted (see
    /// [`crate::pyramid::Level`]; 0 on fine levels).
    pub least: f32,
    pub greatest: f32,
    pub sure: f32,
    /// Whether the cube's projection lies entirely inside the image.
    pub whole: bool,
}

/// Projects cubes of one size to boxes of pixels.
pub(crate) struct Box2 {
    camera: [f32; 4],
    size: [usize; 2],
    /// Rotation from the volume's axes to the camera's, by row (both in metres).
    rows: [[f32; 3]; 3],
    translation: [f32; 3],
    /// Half extents of the cube along the camera's axes.
    half: [f32; 3],
    side_m: f32,
}

/// First and last column, first and last row, nearest and farthest depth.
pub(crate) type Bounds = ([usize; 2], [usize; 2], [f32; 2]);

/// A cube's projection before it is clipped at the image borders.
enum Image2 {
    Outside,
    Near(f32),
    Spans([f32; 2], [f32; 2], [f32; 2]),
}

impl Box2 {
    pub fn new(camera: &Camera, volume_from_camera: &Se3, side_m: f64) -> Self {
        let camera_from_volume = volume_from_camera.inverse();
        let r = camera_from_volume.rotation.matrix();
        Self {
            camera: [camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5].map(|v| v as f32),
            size: [camera.width, camera.height],
            rows: std::array::from_fn(|i| std::array::from_fn(|k| r[(i, k)] as f32)),
            translation: camera_from_volume.translation.map(|v| v as f32).into(),
            half: std::array::from_fn(|i| (r.row(i).abs().sum() * 0.5 * side_m) as f32),
            side_m: side_m as f32,
        }
    }

    #[inline(always)]
    fn project(&self, key: BlockKey) -> Image2 {
        let p: [f32; 3] = std::array::from_fn(|i| (key.0[i] as f32 + 0.5) * self.side_m);
        let c: [f32; 3] = std::array::from_fn(|i| {
            let r = &self.rows[i];
            r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + self.translation[i]
        });
        let [near, far] = [c[2] - self.half[2], c[2] + self.half[2]];
        if far < NEAREST_M {
            return Image2::Outside;
        }
        if near < NEAREST_M {
            // The view frustum is widest at the greatest depth.
            let beside = (0..2).any(|i| {
                let (f, centre, size) = (self.camera[i], self.camera[i + 2], self.size[i] as f32);
                f * (c[i] + self.half[i]) + centre * far < 0.0
                    || f * (c[i] - self.half[i]) + centre * far > size * far
            });
            return if beside { Image2::Outside } else { Image2::Near(far) };
        }
        let (by_near, by_far) = (1.0 / near, 1.0 / far);
        let low = |v: f32| v * if v < 0.0 { by_near } else { by_far };
        let high = |v: f32| v * if v < 0.0 { by_far } else { by_near };
        let span = |i: usize| {
            let (f, centre) = (self.camera[i], self.camera[i + 2]);
            [f * low(c[i] - self.half[i]) + centre, f * high(c[i] + self.half[i]) + centre]
        };
        let (u, v) = (span(0), span(1));
        if u[1] < 0.0 || v[1] < 0.0 || u[0] >= self.size[0] as f32 || v[0] >= self.size[1] as f32 {
            return Image2::Outside;
        }
        Image2::Spans(u, v, [near, far])
    }

    /// Pixels of a span that are inside the image.
    #[inline(always)]
    fn cut(&self, span: [f32; 2], side: usize) -> [usize; 2] {
        [span[0].max(0.0) as usize, (span[1] as usize).min(self.size[side] - 1)]
    }

    /// The pixels that may show a cube, and its depths; the whole image for a cube around the camera.
    #[inline]
    pub fn of(&self, key: BlockKey) -> Option<Bounds> {
        match self.project(key) {
            Image2::Outside => None,
            Image2::Near(far) => Some(([0, self.size[0] - 1], [0, self.size[1] - 1], [NEAREST_M, far])),
            Image2::Spans(u, v, depth) => Some((self.cut(u, 0), self.cut(v, 1), depth)),
        }
    }
}

/// Compares cubes of one size with the image.
pub(crate) struct BlockView<'a> {
    frame: &'a DepthFrame,
    boxes: Box2,
    finest: usize,
}

impl<'a> BlockView<'a> {
    /// For cubes of `side_m`; uses squares of pixels no finer than the pyramid's level `finest`.
    pub fn new(frame: &'a DepthFrame, volume_from_camera: &Se3, side_m: f64, finest: usize) -> Self {
        Self { frame, boxes: Box2::new(frame.camera(), volume_from_camera, side_m), finest }
    }

    /// Compares the cube with this key, in units of this size.
    #[inline]
    pub fn visibility(&self, key: BlockKey) -> Visibility {
        match self.boxes.project(key) {
            Image2::Outside => Visibility::Outside,
            Image2::Near(_) => Visibility::Near,
            Image2::Spans(u, v, depth) => {
                let (width, height) = (self.boxes.size[0] as f32, self.boxes.size[1] as f32);
                let whole = u[0] >= 0.0 && v[0] >= 0.0 && u[1] < width && v[1] < height;
                Visibility::Inside(self.cover(self.boxes.cut(u, 0), self.boxes.cut(v, 1), depth, whole))
            }
        }
    }

    #[inline]
    fn cover(&self, x: [usize; 2], y: [usize; 2], cube: [f32; 2], whole: bool) -> Cover {
        let size = (x[1] - x[0]).max(y[1] - y[0]) / 3;
        let level =
            ((usize::BITS - size.leading_zeros()) as usize).clamp(self.finest, self.frame.pyramid.top());
        let squares = self.frame.pyramid.level(level);
        let (mut least, mut greatest, mut sure) = (f32::INFINITY, 0.0f32, f32::INFINITY);
        for row in y[0] >> level..=y[1] >> level {
            let at = row * squares.width;
            let range = at + (x[0] >> level)..=at + (x[1] >> level);
            for i in range {
                least = least.min(squares.least[i]);
                greatest = greatest.max(squares.greatest[i]);
            }
            if let Some(row) = squares.sure.get(at + (x[0] >> level)..=at + (x[1] >> level)) {
                sure = row.iter().copied().fold(sure, f32::min);
            } else {
                sure = 0.0;
            }
        }
        Cover { cube, least, greatest, sure, whole }
    }
}
