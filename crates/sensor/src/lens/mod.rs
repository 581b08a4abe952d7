//! Lens models: the mapping between rays and normalised image coordinates.
//!
//! A lens maps a point in the camera frame to *normalised* image coordinates (those that the focal lengths and the
//! principal point convert to pixels) and back. Beyond the radius where a model folds over, two rays share one pixel;
//! there a lens returns `None` in both directions.

mod brown_conrady;
mod division;
mod fisheye;
mod positive;
mod unified;

use crate::error::RigError;
use cairn_geometry::Vec3;

/// Lens distortion, with the coefficients in the usual order of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// An ideal pinhole.
    None,
    /// Brown-Conrady, `[k1, k2, p1, p2, k3]`: distorts the undistorted point (Brown 1971; OpenCV's default).
    RadialTangential([f64; 5]),
    /// Brown-Conrady with a rational radial part, `[k1, k2, p1, p2, k3, k4, k5, k6]` (OpenCV's
    /// `CALIB_RATIONAL_MODEL`: numerator `k1..k3`, denominator `k4..k6`).
    Rational([f64; 8]),
    /// The same polynomial as [`Distortion::RadialTangential`] but mapping the *distorted*
    /// point to the undistorted one: the "inverse Brown-Conrady" model of RealSense cameras.
    InverseRadialTangential([f64; 5]),
    /// Equidistant fisheye, `[k1, k2, k3, k4]` (Kannala and Brandt 2006, as OpenCV and Kalibr use it).
    Equidistant([f64; 4]),
    /// Field-of-view model, `w` in radians (Devernay and Faugeras 2001).
    Fov(f64),
    /// Double sphere (Usenko, Demmel and Cremers 2018).
    DoubleSphere {
        /// Distance between the centres of the two spheres.
        xi: f64,
        /// Position of the projection plane between the spheres, 0 to 1.
        alpha: f64,
    },
    /// Unified projection on a sphere with radial-tangential distortion after it, `[xi, k1, k2, p1, p2]` (Mei and Rives
    /// 2007; `omni-radtan` of Kalibr, `MEI` of camodocal).
    Unified([f64; 5]),
    /// Extended unified model (Khomutenko, Garcia and Martinet 2016).
    ExtendedUnified {
        /// Weight of the distance, 0 to 1.
        alpha: f64,
        /// Shape of the surface; 1 is a sphere.
        beta: f64,
    },
    /// One-parameter division model, `k`: the distorted point over `1 + k r^2` is the undistorted one (Fitzgibbon 2001).
    Division(f64),
}

impl Distortion {
    /// The model's name in rig files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::None => "none",
            Self::RadialTangential(_) => "radial-tangential",
            Self::Rational(_) => "rational",
            Self::InverseRadialTangential(_) => "inverse-radial-tangential",
            Self::Equidistant(_) => "equidistant",
            Self::Fov(_) => "fov",
            Self::DoubleSphere { .. } => "double-sphere",
            Self::Unified(_) => "unified",
            Self::ExtendedUnified { .. } => "extended-unified",
            Self::Division(_) => "division",
        }
    }

    /// The coefficients in the model's order; for the double sphere `[xi, alpha]`, for the extended unified model `[alpha, beta]`.
    pub fn coefficients(&self) -> Vec<f64> {
        match self {
            Self::None => Vec::new(),
            Self::RadialTangential(c) | Self::InverseRadialTangential(c) | Self::Unified(c) => c.to_vec(),
            Self::Rational(c) => c.to_vec(),
            Self::Equidistant(c) => c.to_vec(),
            Self::Fov(w) => vec![*w],
            Self::DoubleSphere { xi, alpha } => vec![*xi, *alpha],
            Self::ExtendedUnified { alpha, beta } => vec![*alpha, *beta],
            Self::Division(k) => vec![*k],
        }
    }

    /// The model with this [`Distortion::name`] and these [`Distortion::coefficients`]; `None` for another name or another
    /// count of coefficients.
    pub fn from_parts(name: &str, coefficients: &[f64]) -> Option<Self> {
        Some(match (name, coefficients) {
            ("none", []) => Self::None,
            ("radial-tangential", c) => Self::RadialTangential(c.try_into().ok()?),
            ("rational", c) => Self::Rational(c.try_into().ok()?),
            ("inverse-radial-tangential", c) => Self::InverseRadialTangential(c.try_into().ok()?),
            ("equidistant", c) => Self::Equidistant(c.try_into().ok()?),
            ("fov", &[w]) => Self::Fov(w),
            ("double-sphere", &[xi, alpha]) => Self::DoubleSphere { xi, alpha },
            ("unified", c) => Self::Unified(c.try_into().ok()?),
            ("extended-unified", &[alpha, beta]) => Self::ExtendedUnified { alpha, beta },
            ("division", &[k]) => Self::Division(k),
            _ => return None,
        })
    }

    /// Normalised image coordinates of a point in the camera frame; `None` where the lens has no image of it.
    pub(crate) fn distort(&self, p: &Vec3) -> Option<[f64; 2]> {
        match self {
            Self::Equidistant(k) => return fisheye::equidistant_distort(k, p),
            Self::DoubleSphere { xi, alpha } => return fisheye::double_sphere_distort(*xi, *alpha, p),
            Self::Unified(c) => return unified::distort(c, p),
            Self::ExtendedUnified { alpha, beta } => return unified::extended_distort(*alpha, *beta, p),
            _ => {}
        }
        // The other models are defined on the image plane, onto which only points in front of the camera project.
        if p.z <= 1e-9 {
            return None;
        }
        let m = [p.x / p.z, p.y / p.z];
        match self {
            Self::RadialTangential(c) => brown_conrady::apply(&brown_conrady::extended(c), m),
            Self::Rational(c) => brown_conrady::apply(c, m),
            Self::InverseRadialTangential(c) => brown_conrady::invert(&brown_conrady::extended(c), m),
            Self::Fov(w) => Some(fisheye::fov_distort(*w, m)),
            Self::Division(k) => division::distort(*k, m),
            _ => Some(m),
        }
    }

    /// The direction (of any length) of normalised image coordinates; `None` where there is none.
    pub(crate) fn undistort(&self, m: [f64; 2]) -> Option<Vec3> {
        let plane = |m: [f64; 2]| Vec3::new(m[0], m[1], 1.0);
        match self {
            Self::None => Some(plane(m)),
            Self::RadialTangential(c) => brown_conrady::invert(&brown_conrady::extended(c), m).map(plane),
            Self::Rational(c) => brown_conrady::invert(c, m).map(plane),
            Self::InverseRadialTangential(c) => {
                brown_conrady::apply(&brown_conrady::extended(c), m).map(plane)
            }
            Self::Equidistant(k) => fisheye::equidistant_undistort(k, m),
            Self::Fov(w) => fisheye::fov_undistort(*w, m).map(plane),
            Self::DoubleSphere { xi, alpha } => fisheye::double_sphere_undistort(*xi, *alpha, m),
            Self::Unified(c) => unified::undistort(c, m),
            Self::ExtendedUnified { alpha, beta } => unified::extended_undistort(*alpha, *beta, m),
            Self::Division(k) => division::undistort(*k, m).map(plane),
        }
    }

    /// Checks that the coefficients are valid for the model.
    pub(crate) fn validate(&self) -> Result<(), RigError> {
        if let Some(v) = self.coefficients().iter().find(|v| !v.is_finite()) {
            return Err(RigError(format!("a {} distortion coefficient is {v}", self.name())));
        }
        match self {
            Self::Fov(w) if !(0.0..std::f64::consts::PI).contains(w) => {
                Err(RigError(format!("fov: w is {w}, it must be from 0 to pi radians")))
            }
            Self::DoubleSphere { xi, alpha } if !(*xi > -1.0 && (0.0..=1.0).contains(alpha)) => Err(
                RigError(format!("double sphere: xi {xi} must be above -1 and alpha {alpha} from 0 to 1")),
            ),
            Self::Unified([xi, ..]) if *xi < 0.0 => {
                Err(RigError(format!("unified: xi {xi} must be zero or more")))
            }
            Self::ExtendedUnified { alpha, beta } if !((0.0..=1.0).contains(alpha) && *beta > 0.0) => {
                Err(RigError(format!(
                    "extended unified: alpha {alpha} must be from 0 to 1 and beta {beta} above 0"
                )))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_model_comes_back_from_its_parts() {
        let all = [
            Distortion::None,
            Distortion::RadialTangential([0.1, 0.2, 0.3, 0.4, 0.5]),
            Distortion::Rational([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]),
            Distortion::InverseRadialTangential([0.5, 0.4, 0.3, 0.2, 0.1]),
            Distortion::Equidistant([0.1, 0.2, 0.3, 0.4]),
            Distortion::Fov(0.9),
            Distortion::DoubleSphere { xi: -0.2, alpha: 0.6 },
            Distortion::Unified([1.2, 0.1, 0.2, 0.3, 0.4]),
            Distortion::ExtendedUnified { alpha: 0.6, beta: 1.1 },
            Distortion::Division(-0.2),
        ];
        for model in all {
            let (name, mut coefficients) = (model.name(), model.coefficients());
            assert_eq!(Distortion::from_parts(name, &coefficients), Some(model));
            coefficients.push(0.0);
            assert_eq!(Distortion::from_parts(name, &coefficients), None, "{name}");
        }
        assert_eq!(Distortion::from_parts("other", &[]), None);
    }
}
