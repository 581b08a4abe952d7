//! A small copy of a depth image, and how much of what one shows another shows too.

use cairn_dense::PackedDepth;
use cairn_geometry::{Se3, Vec2, Vec3};
use cairn_sensor::{Camera, DepthImage};

/// Images are not wider than this, pixels.
const MOST_WIDTH: usize = 160;
/// Columns and rows of the points by which overlap is told.
const GRID: [usize; 2] = [20, 15];
/// Depths are of one surface when they differ by no more than this, metres and as a share: points are of cells of the grid.
const SAME: [f32; 2] = [0.1, 0.1];
/// Farther depth counts for nothing, metres: the alignment does not use it either.
const FARTHEST_M: f64 = 5.0;

/// Leaves out columns and rows of depth images.
#[derive(Debug)]
pub(super) struct Shrink {
    stride: usize,
    /// The camera of the small images.
    pub camera: Camera,
    /// Of each cell of the grid, row by row, its pixel and the ray through it, with a depth of 1.
    cells: Vec<([usize; 2], Vec3)>,
}

/// The depth of a key frame.
#[derive(Debug)]
pub(super) struct View {
    pub image: PackedDepth,
    /// Of each cell of the grid, row by row, the depth at its pixel, metres; NaN where there is none.
    depths: Box<[f32]>,
}

impl Shrink {
    pub fn of(camera: &Camera) -> Self {
        let stride = camera.width.div_ceil(MOST_WIDTH).max(1);
        let (first, s) = ((stride / 2) as f64, stride as f64);
        let small = Camera {
            width: camera.width / stride,
            height: camera.height / stride,
            fx: camera.fx / s,
            fy: camera.fy / s,
            cx: (camera.cx - first) / s,
            cy: (camera.cy - first) / s,
            ..*camera
        };
        let cell = |at: usize| {
            let (column, row) = (at % GRID[0], at / GRID[0]);
            let [x, y] = [
                (2 * column + 1) * small.width / (2 * GRID[0]),
                (2 * row + 1) * small.height / (2 * GRID[1]),
            ];
            let ray = small.unproject(&Vec2::new(x as f64, y as f64)).filter(|ray| ray.z > 0.0);
            ([x, y], ray.map_or(Vec3::repeat(f64::NAN), |ray| ray / ray.z))
        };
        let cells = (0..GRID[0] * GRID[1]).map(cell).collect();
        Self { stride, camera: small, cells }
    }

    /// The small copy of an image, with the units of its pixels; `None` where it is not of the sensor's size.
    pub fn small(&self, image: &DepthImage) -> Option<DepthImage> {
        let (width, height) = (self.camera.width, self.camera.height);
        let fits = [image.width() / self.stride, image.height() / self.stride] == [width, height];
        if !fits {
            return None;
        }
        let at = |i: usize| i * self.stride + self.stride / 2;
        let rows = (0..height).map(|y| image.row(at(y)));
        let data = rows.flat_map(|row| (0..width).map(|x| row[at(x)])).collect();
        DepthImage::from_vec(width, height, data)
    }

    /// The view of an image whose units are `metres_per_unit` long.
    pub fn view(&self, image: &DepthImage, metres_per_unit: f64) -> Option<View> {
        let small = self.small(image)?;
        let depth = |([x, y], ray): &([usize; 2], Vec3)| {
            let units = small.get(*x, *y).filter(|u| *u != 0 && *u != u16::MAX)?;
            let z = f64::from(units) * metres_per_unit;
            (z <= FARTHEST_M && ray.z.is_finite()).then_some(z as f32)
        };
        let depths = self.cells.iter().map(|cell| depth(cell).unwrap_or(f32::NAN)).collect();
        Some(View { image: PackedDepth::pack(&small), depths })
    }

    /// The share of what each of two views shows that the other shows too, the smaller of both.
    pub fn overlap(&self, a: &View, b: &View, a_from_b: &Se3) -> f64 {
        self.seen_in(a, b, a_from_b).min(self.seen_in(b, a, &a_from_b.inverse()))
    }

    /// The share of `b`'s points that `a` shows.
    fn seen_in(&self, a: &View, b: &View, a_from_b: &Se3) -> f64 {
        let (mut all, mut seen) = (0, 0);
        for ((_, ray), z) in self.cells.iter().zip(&b.depths).filter(|(_, z)| z.is_finite()) {
            all += 1;
            let p = *a_from_b * (ray * f64::from(*z));
            let Some(there) = self.camera.project(&p).and_then(|px| a.at(&self.camera, px.x, px.y)) else {
                continue;
            };
            seen += usize::from((there - p.z as f32).abs() <= SAME[0] + SAME[1] * there);
        }
        f64::from(seen as u32) / f64::from(u32::max(all, 1))
    }
}

impl View {
    /// Depth at a pixel of the small image, metres.
    fn at(&self, camera: &Camera, x: f64, y: f64) -> Option<f32> {
        let (column, row) =
            (x * GRID[0] as f64 / camera.width as f64, y * GRID[1] as f64 / camera.height as f64);
        let inside = column >= 0.0 && row >= 0.0 && column < GRID[0] as f64 && row < GRID[1] as f64;
        let z = inside.then(|| self.depths[row as usize * GRID[0] + column as usize])?;
        z.is_finite().then_some(z)
    }
}
