//! Sensor models: measurements of a landmark or of another robot, their Jacobians, and their inverse.
//!
//! Poses are `world_from_body` as (x m, y m, angle rad), landmarks are points in the same world. Source: Thrun,
//! Burgard, Fox, "Probabilistic robotics" (2005), 6.6 and 10.2.

use crate::angle::wrap;
use cairn_geometry::Se2;
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// Below this distance a direction is undefined, in metres.
const NEAR_M: f64 = 1e-6;

/// Kind of measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Distance (m) and direction (rad) in the body's frame.
    RangeBearing,
    /// Distance only, in metres.
    Range,
    /// Direction only, in radians.
    Bearing,
    /// Position in the body's frame: x forward and y left, in metres.
    Position,
    /// Pose of another robot in the body's frame: x, y in metres, angle in radians.
    RelativePose,
}

impl Kind {
    /// Number of measured values: the degrees of freedom of its gate.
    pub fn rows(self) -> usize {
        match self {
            Self::Range | Self::Bearing => 1,
            Self::RangeBearing | Self::Position => 2,
            Self::RelativePose => 3,
        }
    }

    /// Whether one measurement determines the position of the target.
    pub fn determines(self) -> bool {
        matches!(self, Self::RangeBearing | Self::Position | Self::RelativePose)
    }

    /// Which row is an angle.
    fn angle_row(self) -> Option<usize> {
        match self {
            Self::RangeBearing => Some(1),
            Self::Bearing => Some(0),
            Self::RelativePose => Some(2),
            Self::Range | Self::Position => None,
        }
    }
}

/// A measurement with its covariance; only the first [`Kind::rows`] entries are used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    kind: Kind,
    value: Vector3<f64>,
    covariance: Matrix3<f64>,
}

/// Why a measurement is invalid.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MeasurementError {
    /// A number is NaN or infinite.
    #[error("a measured value is not finite")]
    NotFinite,
    /// A distance is below zero.
    #[error("the range of {0} m is negative")]
    NegativeRange(f64),
    /// A standard deviation is not positive.
    #[error("the standard deviation {0} of a measurement is not positive and finite")]
    Deviation(f64),
    /// The covariance is not positive definite.
    #[error("the covariance of a measurement is not symmetric and positive definite")]
    Covariance,
}

impl Measurement {
    /// Distance and direction with their standard deviations.
    ///
    /// # Errors
    /// When a value is not finite, the range is negative, or a deviation is not positive.
    pub fn range_bearing(
        range_m: f64,
        bearing_rad: f64,
        range_deviation: f64,
        bearing_deviation: f64,
    ) -> Result<Self, MeasurementError> {
        not_negative(range_m)?;
        Self::new(Kind::RangeBearing, [range_m, bearing_rad, 0.0], [range_deviation, bearing_deviation, 1.0])
    }

    /// Distance only, with its standard deviation.
    ///
    /// # Errors
    /// As [`Measurement::range_bearing`].
    pub fn range(range_m: f64, deviation_m: f64) -> Result<Self, MeasurementError> {
        not_negative(range_m)?;
        Self::new(Kind::Range, [range_m, 0.0, 0.0], [deviation_m, 1.0, 1.0])
    }

    /// Direction only, with its standard deviation.
    ///
    /// # Errors
    /// As [`Measurement::range_bearing`].
    pub fn bearing(bearing_rad: f64, deviation_rad: f64) -> Result<Self, MeasurementError> {
        Self::new(Kind::Bearing, [bearing_rad, 0.0, 0.0], [deviation_rad, 1.0, 1.0])
    }

    /// Position in the body's frame, in metres, with its covariance.
    ///
    /// # Errors
    /// When a value is not finite, or the covariance is not symmetric and positive definite.
    pub fn position(x_m: f64, y_m: f64, covariance: &Matrix2<f64>) -> Result<Self, MeasurementError> {
        let mut whole = Matrix3::identity();
        whole.fixed_view_mut::<2, 2>(0, 0).copy_from(covariance);
        Self::with_covariance(Kind::Position, Vector3::new(x_m, y_m, 0.0), whole)
    }

    /// Pose of another robot in the body's frame, with the covariance of (x, y, angle).
    ///
    /// # Errors
    /// As [`Measurement::position`].
    pub fn relative_pose(
        observer_from_target: &Se2,
        covariance: &Matrix3<f64>,
    ) -> Result<Self, MeasurementError> {
        let t = observer_from_target;
        let value = Vector3::new(t.translation.x, t.translation.y, t.rotation.log());
        Self::with_covariance(Kind::RelativePose, value, *covariance)
    }

    fn new(kind: Kind, value: [f64; 3], deviations: [f64; 3]) -> Result<Self, MeasurementError> {
        if let Some(bad) = deviations.iter().find(|d| !(d.is_finite() && **d > 0.0)) {
            return Err(MeasurementError::Deviation(*bad));
        }
        let covariance = Matrix3::from_diagonal(&Vector3::from(deviations.map(|d| d * d)));
        Self::with_covariance(kind, value.into(), covariance)
    }

    fn with_covariance(
        kind: Kind,
        mut value: Vector3<f64>,
        covariance: Matrix3<f64>,
    ) -> Result<Self, MeasurementError> {
        if !value.iter().all(|v| v.is_finite()) {
            return Err(MeasurementError::NotFinite);
        }
        let symmetric = (covariance - covariance.transpose()).amax() <= 1e-9 * covariance.amax();
        if !symmetric || covariance.cholesky().is_none() {
            return Err(MeasurementError::Covariance);
        }
        if let Some(row) = kind.angle_row() {
            value[row] = wrap(value[row]);
        }
        Ok(Self { kind, value, covariance })
    }

    /// The kind of measurement.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The measured values; only the first [`Kind::rows`] are used.
    pub fn value(&self) -> &Vector3<f64> {
        &self.value
    }

    /// Their covariance; only the upper left square of size [`Kind::rows`] is used.
    pub fn covariance(&self) -> &Matrix3<f64> {
        &self.covariance
    }

    /// The same measurement with its covariance multiplied by a positive factor.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { covariance: self.covariance * factor, ..*self }
    }

    /// Measured minus expected values, with angles wrapped. The third entry of a landmark is not used.
    pub fn innovation(&self, observer: &Vector3<f64>, target: &Vector3<f64>) -> Vector3<f64> {
        let mut difference = self.value - expected(self.kind, observer, target);
        if let Some(row) = self.kind.angle_row() {
            difference[row] = wrap(difference[row]);
        }
        difference
    }

    /// The position of a landmark according to this measurement, for kinds that determine it.
    pub fn target(&self, observer: &Vector3<f64>) -> Option<Vector2<f64>> {
        let (s, c) = observer.z.sin_cos();
        let local = self.local()?;
        Some(Vector2::new(observer.x + c * local.x - s * local.y, observer.y + s * local.x + c * local.y))
    }

    /// The position in the body's frame.
    fn local(&self) -> Option<Vector2<f64>> {
        let v = &self.value;
        match self.kind {
            Kind::RangeBearing => Some(Vector2::new(v.x * v.y.cos(), v.x * v.y.sin())),
            Kind::Position | Kind::RelativePose => Some(v.xy()),
            Kind::Range | Kind::Bearing => None,
        }
    }

    /// Covariance, in the world, of a landmark placed by this measurement, due to the measurement noise alone.
    pub fn target_noise(&self, observer: &Vector3<f64>) -> Option<Matrix2<f64>> {
        let v = &self.value;
        let by_value = match self.kind {
            Kind::RangeBearing => {
                let (s, c) = v.y.sin_cos();
                Matrix2::new(c, -v.x * s, s, v.x * c)
            }
            Kind::Position | Kind::RelativePose => Matrix2::identity(),
            Kind::Range | Kind::Bearing => return None,
        };
        let (s, c) = observer.z.sin_cos();
        let turned = Matrix2::new(c, -s, s, c) * by_value;
        Some(turned * self.covariance.fixed_view::<2, 2>(0, 0) * turned.transpose())
    }
}

fn not_negative(range_m: f64) -> Result<(), MeasurementError> {
    if range_m < 0.0 { Err(MeasurementError::NegativeRange(range_m)) } else { Ok(()) }
}

/// The measured values without noise.
pub fn expected(kind: Kind, observer: &Vector3<f64>, target: &Vector3<f64>) -> Vector3<f64> {
    let d = target.xy() - observer.xy();
    let (s, c) = observer.z.sin_cos();
    let local = Vector2::new(c * d.x + s * d.y, c * d.y - s * d.x);
    match kind {
        Kind::RangeBearing => Vector3::new(d.norm(), local.y.atan2(local.x), 0.0),
        Kind::Range => Vector3::new(d.norm(), 0.0, 0.0),
        Kind::Bearing => Vector3::new(local.y.atan2(local.x), 0.0, 0.0),
        Kind::Position => Vector3::new(local.x, local.y, 0.0),
        Kind::RelativePose => Vector3::new(local.x, local.y, wrap(target.z - observer.z)),
    }
}

/// Derivatives of the measured values with respect to the observer's pose and to the target; `None` where the two are
/// at the same position and the derivative is not defined.
pub fn jacobians(
    kind: Kind,
    observer: &Vector3<f64>,
    target: &Vector3<f64>,
) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
    let d = target.xy() - observer.xy();
    let (s, c) = observer.z.sin_cos();
    let r2 = d.norm_squared();
    let needs_direction = matches!(kind, Kind::RangeBearing | Kind::Range | Kind::Bearing);
    if needs_direction && (r2.is_nan() || r2 <= NEAR_M * NEAR_M) {
        return None;
    }
    let r = r2.sqrt();
    let range = [-d.x / r, -d.y / r, 0.0];
    let bearing = [d.y / r2, -d.x / r2, -1.0];
    let place = [[-c, -s, c * d.y - s * d.x], [s, -c, -c * d.x - s * d.y]];
    let none = [0.0; 3];
    let rows = match kind {
        Kind::RangeBearing => [range, bearing, none],
        Kind::Range => [range, none, none],
        Kind::Bearing => [bearing, none, none],
        Kind::Position => [place[0], place[1], none],
        Kind::RelativePose => [place[0], place[1], [0.0, 0.0, -1.0]],
    };
    let by_observer = Matrix3::from_fn(|i, j| rows[i][j]);
    // Moving the target is the same as moving the observer the opposite way.
    let mut by_target = Matrix3::from_fn(|i, j| if j < 2 { -rows[i][j] } else { 0.0 });
    if kind == Kind::RelativePose {
        by_target[(2, 2)] = 1.0;
    }
    Some((by_observer, by_target))
}

#[cfg(test)]
mod tests {
    use super::*;

    const KINDS: [Kind; 5] =
        [Kind::RangeBearing, Kind::Range, Kind::Bearing, Kind::Position, Kind::RelativePose];

    #[test]
    fn jacobians_are_those_of_differences() {
        let h = 1e-6;
        for kind in KINDS {
            for k in 0..200 {
                let v = |n: usize| ((k * 7 + n) as f64 * 1.37).sin() * 3.0;
                let (observer, target) =
                    (Vector3::new(v(0), v(1), v(2)), Vector3::new(v(3) + 5.0, v(4), v(5)));
                let (by_observer, by_target) = jacobians(kind, &observer, &target).unwrap();
                for j in 0..3 {
                    let step = Vector3::from_fn(|r, _| if r == j { h } else { 0.0 });
                    let mut a = expected(kind, &(observer + step), &target)
                        - expected(kind, &(observer - step), &target);
                    let mut b = expected(kind, &observer, &(target + step))
                        - expected(kind, &observer, &(target - step));
                    if let Some(row) = kind.angle_row() {
                        (a[row], b[row]) = (wrap(a[row]), wrap(b[row]));
                    }
                    assert!((by_observer.column(j) - a / (2.0 * h)).norm() < 1e-6, "{kind:?}");
                    assert!((by_target.column(j) - b / (2.0 * h)).norm() < 1e-6, "{kind:?}");
                }
            }
        }
    }

    #[test]
    fn the_inverse_undoes_the_measurement() {
        let observer = Vector3::new(1.0, -2.0, 2.8);
        for target in [Vector2::new(4.0, 1.0), Vector2::new(-3.0, -2.5)] {
            let z = expected(Kind::RangeBearing, &observer, &target.push(0.0));
            let m = Measurement::range_bearing(z.x, z.y, 0.1, 0.02).unwrap();
            assert!((m.target(&observer).unwrap() - target).norm() < 1e-12);
            // Along the line of sight the noise is that of the range, across it that of the bearing times the range.
            let noise = m.target_noise(&observer).unwrap();
            let d = (target - observer.xy()).normalize();
            assert!((d.dot(&(noise * d)) - 0.01).abs() < 1e-12);
            let across = Vector2::new(-d.y, d.x);
            assert!((across.dot(&(noise * across)) - (z.x * 0.02).powi(2)).abs() < 1e-12);
        }
    }

    #[test]
    fn innovations_go_the_short_way_round() {
        let m = Measurement::bearing(3.1, 0.1).unwrap();
        let behind = Vector3::new(-1.0, -0.05, 0.0);
        assert!(m.innovation(&Vector3::zeros(), &behind).x.abs() < 0.2);
    }

    #[test]
    fn nonsense_is_refused() {
        assert_eq!(Measurement::range(-1.0, 0.1), Err(MeasurementError::NegativeRange(-1.0)));
        assert_eq!(Measurement::range(f64::NAN, 0.1), Err(MeasurementError::NotFinite));
        assert_eq!(Measurement::range(1.0, 0.0), Err(MeasurementError::Deviation(0.0)));
        assert!(Measurement::bearing(1.0, f64::NAN).is_err());
        assert_eq!(Measurement::position(1.0, 1.0, &Matrix2::zeros()), Err(MeasurementError::Covariance));
        let here = Vector3::zeros();
        assert!(jacobians(Kind::RangeBearing, &here, &here).is_none());
        assert!(jacobians(Kind::Position, &here, &here).is_some());
    }
}
