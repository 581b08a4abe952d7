//! Lens models: the mapping between rays and normalised image coordinates.
//!
//! A lens maps a point in the camera frame to *normalised* image coordinates (those that the focal lengths and the
//! principal point convert to pixels) and back. Beyond the radius where a model folds over, two rays share one pixel;
//! there a lens returns `None` in both directions.

mod brown_conrady;
mod fisheye;
mod positive;

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
        }
    }

    /// The coefficients in the model's order; for the double sphere `[xi, alpha]`.
    pub fn coefficients(&self) -> Vec<f64> {
        match self {
            Self::None => Vec::new(),
            Self::RadialTangential(c) | Self::InverseRadialTangential(c) => c.to_vec(),
            Self::Rational(c) => c.to_vec(),
            Self::Equidistant(c) => c.to_vec(),
            Self::Fov(w) => vec![*w],
            Self::DoubleSphere { xi, alpha } => vec![*xi, *alpha],
        }
    }

    /// Normalised image coordinates of a point in the camera frame; `None` where the lens has no image of it.
    pub(crate) fn distort(&self, p: &Vec3) -> Option<[f64; 2]> {
        match self {
            Self::Equidistant(k) => return fisheye::equidistant_distort(k, p),
            Self::DoubleSphere { xi, alpha } => return fisheye::double_sphere_distort(*xi, *alpha, p),
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
            _ => Ok(()),
        }
    }
}
