//! Rolling shutter: the rows of an image are exposed one after the other, so a feature is seen from where the camera was at
//! the time of its row. Features are moved to where they would have been seen at the exposure of the middle row; everything
//! behind that works with one pose for the whole image.
//!
//! With angular velocity `w` and velocity `v` of the camera in its own frame, a point on the ray `r = (x, y, 1)` with inverse
//! depth `q`, seen at the time `t` from the middle row, is at `r + t (w x r + q v)` at the middle row, to first order
//! (Hedborg et al., Rolling shutter bundle adjustment, CVPR 2012, section 3, with a linear motion within the image). The
//! angular velocity is the gyroscope's, or that of the last frames; depths are those of landmarks seen nearby.
//!
//! The readout time may be estimated: bundle adjustment does, with poses and points ([`cairn_atlas::Readout`]). For that each
//! frame keeps by how much its features move for each second of readout ([`Rolling`]). Sensors have long rows and read one
//! after the other along the shorter side: of an upright image those rows are columns.

use cairn_atlas::{Readout, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_vision::{Frame, RectifiedCamera, Rolling};

/// Columns and rows of the grid in which depths are averaged.
const CELLS: [usize; 2] = [8, 6];

/// The camera's motion while an image is exposed, in the camera frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Moving {
    /// Radians a second.
    pub turning: Vec3,
    /// Map units a second; zero where depths are not known.
    pub velocity: Vec3,
}

/// Readout of the rows.
#[derive(Clone, Debug)]
pub(crate) struct Shutter {
    /// Seconds from the first row to the last, negative where the last row is first; `None` where it is estimated.
    given_s: Option<f64>,
    /// The axis of the raw image along which the rows follow each other, and their number.
    along: usize,
    rows: f64,
}

impl Shutter {
    /// For images of so many columns and rows.
    pub fn new(given_s: Option<f64>, size: [usize; 2]) -> Self {
        let along = usize::from(given_s.is_some() || size[1] <= size[0]);
        Self { given_s, along, rows: size[along].max(1) as f64 }
    }

    /// Whether nothing is to be done: all rows at once, as far as is known.
    pub fn is_global(&self) -> bool {
        self.given_s == Some(0.0)
    }

    /// Whether the readout time is to be estimated.
    pub fn is_estimated(&self) -> bool {
        self.given_s.is_none()
    }

    /// The row of a feature, from -0.5 at the first that is exposed to 0.5 at the last.
    pub fn row(&self, frame: &Frame, i: usize) -> f64 {
        (f64::from(frame.raw[i][self.along]) + 0.5) / self.rows - 0.5
    }

    /// Puts the features of a frame back to where they were seen.
    pub fn undo(frame: &mut Frame, camera: &RectifiedCamera) {
        let Some(rolling) = frame.rolling.take() else { return };
        for (i, slope) in rolling.slopes.iter().enumerate() {
            let [dx, dy] = slope.map(|s| (f64::from(s) * rolling.readout_s) as f32);
            frame.px[i][0] -= dx;
            frame.px[i][1] -= dy;
            frame.right_x[i] -= dx;
        }
        frame.index(camera);
    }

    /// The readout time, as given or else as a map has it.
    pub fn readout(&self, snapshot: &Snapshot) -> Readout {
        self.given_s.map_or(snapshot.readout(), |seconds| Readout { seconds, sigma_s: 0.0 })
    }

    /// Moves the features of a frame to the exposure of the middle row. `points` are landmarks nearby, in the camera frame
    /// as predicted.
    pub fn correct(
        &self,
        frame: &mut Frame,
        camera: &RectifiedCamera,
        readout_s: f64,
        moving: &Moving,
        points: impl Iterator<Item = Vec3>,
    ) {
        let depths = Depths::of(camera, points);
        let mut slopes = Vec::with_capacity(frame.len());
        for i in 0..frame.len() {
            let ray = camera.unproject(frame.px[i], 1.0);
            let share = self.row(frame, i);
            let a = moving.turning.cross(&ray) + depths.inverse(camera, frame.px[i]) * moving.velocity;
            let slope = [camera.fx * (a.x - ray.x * a.z) * share, camera.fy * (a.y - ray.y * a.z) * share];
            let slope = if slope.iter().all(|s| s.is_finite()) { slope } else { [0.0; 2] };
            slopes.push(slope.map(|s| s as f32));
            let [dx, dy] = slope.map(|s| (s * readout_s) as f32);
            frame.px[i][0] += dx;
            frame.px[i][1] += dy;
            frame.right_x[i] += dx;
        }
        if self.given_s.is_none() {
            frame.rolling = Some(Rolling { readout_s, slopes });
        }
        frame.index(camera);
    }
}

/// Inverse depths of landmarks, averaged in the cells of a grid over the image.
struct Depths {
    cells: Vec<f64>,
}

impl Depths {
    fn of(camera: &RectifiedCamera, points: impl Iterator<Item = Vec3>) -> Self {
        let mut sums = vec![[0.0; 2]; CELLS[0] * CELLS[1]];
        let mut all = [0.0; 2];
        for p in points {
            let Some([u, v, _]) = camera.project(&p).filter(|[u, v, _]| camera.contains(*u, *v)) else {
                continue;
            };
            for sum in [&mut sums[cell(camera, u, v)], &mut all] {
                sum[0] += 1.0 / p.z;
                sum[1] += 1.0;
            }
        }
        let mean = if all[1] > 0.0 { all[0] / all[1] } else { 0.0 };
        Self { cells: sums.iter().map(|[sum, n]| if *n > 0.0 { sum / n } else { mean }).collect() }
    }

    /// At a pixel; zero where nothing is known of any depth.
    fn inverse(&self, camera: &RectifiedCamera, px: [f32; 2]) -> f64 {
        self.cells[cell(camera, f64::from(px[0]), f64::from(px[1]))]
    }
}

fn cell(camera: &RectifiedCamera, u: f64, v: f64) -> usize {
    let [x0, y0, x1, y1] = camera.bounds;
    let at = |share: f64, n: usize| ((share * n as f64).max(0.0) as usize).min(n - 1);
    at((v - y0) / (y1 - y0), CELLS[1]) * CELLS[0] + at((u - x0) / (x1 - x0), CELLS[0])
}

/// Landmarks in the camera frame of a pose.
pub(crate) fn in_camera<'a>(
    world_from_camera: &Se3,
    points: impl Iterator<Item = Vec3> + 'a,
) -> impl Iterator<Item = Vec3> + 'a {
    let camera_from_world = world_from_camera.inverse();
    points.map(move |p| camera_from_world * p)
}
