//! Angles on the circle.

use std::f64::consts::{PI, TAU};

/// The same direction wrapped to (-pi, pi], in radians. NaN and infinities give NaN.
pub fn wrap(angle_rad: f64) -> f64 {
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    // Reduced to [0, 2 pi), then the upper half is moved down.
    let turned = angle_rad.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stays_the_same_direction_within_half_a_turn() {
        for k in -4000..4000 {
            let angle = f64::from(k) * 0.0137;
            let wrapped = wrap(angle);
            assert!(wrapped > -PI && wrapped <= PI, "{angle}");
            assert!(
                (wrapped.sin() - angle.sin()).abs() < 1e-12 && (wrapped.cos() - angle.cos()).abs() < 1e-12
            );
        }
        assert_eq!(wrap(-PI), PI);
        assert_eq!(wrap(PI), PI);
        assert!(wrap(f64::NAN).is_nan() && wrap(f64::INFINITY).is_nan());
    }
}
