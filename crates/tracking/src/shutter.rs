//! Rolling shutter: the rows of an image are exposed one after the other, so a feature is seen from where the camera was at
//! the time of its row. Features are moved to where they would have been seen at the exposure of the middle row; everything
//! behind that works with one pose for the whole image.
//!
//! With angular velocity `w` and velocity `v` of the camera in its own frame, a point on the ray `r = (x, y, 1)` with inverse
//! depth `q`, seen at the time `t` from the middle row, is at `r + t (w x r + q v)` at the middle row, to first order
//! (Hedborg et al., Rolling shutter bundle adjustment, CVPR 2012, section 3, with a linear motion within the image). The
//! angular velocity is the gyroscope's, or that of the last frames; depths are those of landmarks seen nearby.
//!
//! The readout time may be estimated: the residuals of each pose tell how much of that shift is missing or too much. The
//! pose is marginalised out (Schur complement), so that what a change of pose could explain counts for nothing; and so is the
//! error of the velocity. Between two pictures a walker's body goes up and down: with a few pictures a second, the velocity of
//! the last frames says nothing of that at the next one, or its opposite, and a readout time that is learnt from it is of the wrong sign.

use cairn_geometry::{Se3, Vec3};
use cairn_vision::{Frame, RectifiedCamera};
use nalgebra::{Matrix2x3, Matrix3, SMatrix, SVector, Vector2};

/// Columns and rows of the grid in which depths are averaged.
const CELLS: [usize; 2] = [8, 6];
/// Standard deviation of the readout time before anything was seen, seconds: cameras take up to 30 ms, from either end.
const PRIOR_S: f64 = 0.02;
/// How much of what earlier frames told is kept from frame to frame. The map that a frame is compared with was built with the
/// readout time as it was thought to be then, so a frame tells only a part of what is missing: with a long memory the
/// estimate would stay there.
const KEPT: f64 = 0.97;
/// Residuals beyond this many standard deviations count less (Huber).
const HUBER: f64 = 2.0;
/// Least standard deviation of a velocity times the readout time, metres: it is taken as exact.
const LEAST_SIGMA_M: f64 = 1e-9;
/// What is added where nothing is known, so that it can be marginalised, 1/m^2: nothing beside what matches tell.
const NO_INFORMATION: f64 = 1e-3;
/// Matches needed for a frame to count.
const LEAST_MATCHES: usize = 30;
/// Largest readout time, seconds: that of an image at 20 a second.
const MOST_S: f64 = 0.05;

/// The camera's motion while an image is exposed, in the camera frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Moving {
    /// Radians a second.
    pub turning: Vec3,
    /// Map units a second; zero where depths are not known.
    pub velocity: Vec3,
    /// Standard deviation of the velocity; infinite where nothing is known of it.
    pub velocity_sigma: f64,
}

/// Unknowns of what a frame tells: pose (6), missing velocity times readout time (3), readout time.
const N: usize = 10;
/// Unknowns that are marginalised.
const OTHERS: usize = N - 1;

/// Readout of the rows.
#[derive(Clone, Debug)]
pub(crate) struct Shutter {
    /// Seconds from the first row to the last; negative where the last row is first.
    readout_s: f64,
    /// Rows of the raw image.
    rows: f64,
    /// Whether the readout time is estimated.
    estimated: bool,
    /// Sums of information, and of information times readout time.
    sums: [f64; 2],
    /// For each feature of the last frame: by how many pixels it moves for each second of readout.
    slopes: Vec<[f32; 2]>,
    /// The standard deviation of the velocity that these were computed with.
    velocity_sigma: f64,
}

impl Shutter {
    /// For images of so many rows.
    pub fn new(readout_s: f64, estimated: bool, rows: usize) -> Self {
        let (rows, sums, slopes) = (rows.max(1) as f64, [0.0; 2], Vec::new());
        Self { readout_s, rows, estimated, sums, slopes, velocity_sigma: 0.0 }
    }

    /// Whether nothing is to be done: all rows at once, as far as is known.
    pub fn is_global(&self) -> bool {
        self.readout_s == 0.0 && !self.estimated
    }

    /// The readout time in seconds, and its standard deviation (zero where it is given).
    pub fn readout_s(&self) -> [f64; 2] {
        let sigma = (self.sums[0] + PRIOR_S.powi(-2)).sqrt().recip();
        [self.readout_s, if self.estimated { sigma } else { 0.0 }]
    }

    /// Moves the features of a frame to the exposure of the middle row. `points` are landmarks nearby, in the camera frame
    /// as predicted.
    pub fn correct(
        &mut self,
        frame: &mut Frame,
        camera: &RectifiedCamera,
        moving: &Moving,
        points: impl Iterator<Item = Vec3>,
    ) {
        let depths = Depths::of(camera, points);
        self.slopes.clear();
        self.velocity_sigma = moving.velocity_sigma;
        for i in 0..frame.len() {
            let ray = camera.unproject(frame.px[i], 1.0);
            let share = self.share(frame, i);
            let a = moving.turning.cross(&ray) + depths.inverse(camera, frame.px[i]) * moving.velocity;
            let slope = [camera.fx * (a.x - ray.x * a.z) * share, camera.fy * (a.y - ray.y * a.z) * share];
            let slope = if slope.iter().all(|s| s.is_finite()) { slope } else { [0.0; 2] };
            self.slopes.push(slope.map(|s| s as f32));
            let [dx, dy] = slope.map(|s| (s * self.readout_s) as f32);
            frame.px[i][0] += dx;
            frame.px[i][1] += dy;
            frame.right_x[i] += dx;
        }
        frame.index(camera);
    }

    /// Learns from the pose of the frame that was corrected last: `matches` are features with their landmarks in the camera
    /// frame of that pose, and the standard deviations of their pixels.
    pub fn learn(
        &mut self,
        frame: &Frame,
        camera: &RectifiedCamera,
        matches: impl Iterator<Item = (usize, Vec3, f64)>,
    ) {
        if !self.estimated || self.slopes.len() != frame.len() {
            return;
        }
        let mut h = SMatrix::<f64, N, N>::zeros();
        let mut b = SVector::<f64, N>::zeros();
        let prior = (self.velocity_sigma * PRIOR_S).max(LEAST_SIGMA_M).powi(-2);
        h.fixed_view_mut::<3, 3>(6, 6).copy_from(&(Matrix3::identity() * (prior + NO_INFORMATION)));
        let mut count = 0;
        for (i, p, sigma_px) in matches {
            let Some([u, v, _]) = camera.project(&p) else { continue };
            let [x, y] = frame.px[i].map(f64::from);
            let residual = Vector2::new(x - u, y - v);
            let slope = Vector2::new(f64::from(self.slopes[i][0]), f64::from(self.slopes[i][1]));
            let jacobian = jacobian(camera, &p, self.share(frame, i), &slope);
            let size = residual.norm() / sigma_px;
            let weight = sigma_px.powi(-2) * (HUBER / size.max(HUBER));
            h += weight * jacobian.tr_mul(&jacobian);
            b += weight * jacobian.tr_mul(&residual);
            count += 1;
        }
        if count >= LEAST_MATCHES {
            self.add(&h, &b);
        }
    }

    /// The time of a feature's row from the middle one, as a share of the readout time.
    fn share(&self, frame: &Frame, i: usize) -> f64 {
        (f64::from(frame.raw[i][1]) + 0.5) / self.rows - 0.5
    }

    /// Adds what one frame tells: its normal equations with all but the readout time marginalised.
    fn add(&mut self, h: &SMatrix<f64, N, N>, b: &SVector<f64, N>) {
        let Some(others) = h.fixed_view::<OTHERS, OTHERS>(0, 0).into_owned().cholesky() else { return };
        let cross = h.fixed_view::<OTHERS, 1>(0, OTHERS).into_owned();
        let solved = others.solve(&cross);
        let information = h[(OTHERS, OTHERS)] - cross.dot(&solved);
        let gradient = b[OTHERS] - b.fixed_rows::<OTHERS>(0).dot(&solved);
        if !(information > 0.0 && information.is_finite() && gradient.is_finite()) {
            return;
        }
        let found = information * self.readout_s - gradient;
        self.sums = [self.sums[0] * KEPT + information, self.sums[1] * KEPT + found];
        self.readout_s = (self.sums[1] / (self.sums[0] + PRIOR_S.powi(-2))).clamp(-MOST_S, MOST_S);
    }
}

/// Derivative of a residual (pixel minus projection) by a change of pose, by the missing velocity times the readout time, and by
/// the readout time.
fn jacobian(camera: &RectifiedCamera, p: &Vec3, share: f64, slope: &Vector2<f64>) -> SMatrix<f64, 2, N> {
    let inv = 1.0 / p.z;
    let projection = Matrix2x3::new(
        camera.fx * inv,
        0.0,
        -camera.fx * p.x * inv * inv,
        0.0,
        camera.fy * inv,
        -camera.fy * p.y * inv * inv,
    );
    let mut out = SMatrix::<f64, 2, N>::zeros();
    out.fixed_view_mut::<2, 3>(0, 0).copy_from(&projection);
    out.fixed_view_mut::<2, 3>(0, 3).copy_from(&(-projection * p.cross_matrix()));
    out.fixed_view_mut::<2, 3>(0, 6).copy_from(&(projection * share));
    out.set_column(OTHERS, slope);
    out
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
