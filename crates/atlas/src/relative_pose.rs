//! The pose of one key frame relative to another, as depth measured it.

use crate::KeyFrameId;
use cairn_geometry::{LieGroup, Se3};
use nalgebra::{Matrix6, Vector6};

/// Chi-square of six degrees of freedom, 99.9 %: what is farther off is wrong.
const GATE: f64 = 22.46;
/// No number of an information is larger: a micrometre and a microradian.
const MOST_INFORMATION: f64 = 1e12;
/// Rounding may make an information negative by this share of its trace.
const ROUNDING: f64 = 1e-6;

/// The pose of a key frame relative to an earlier one, by the depth that both have of one surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativePose {
    /// The earlier key frame, of the same map.
    pub from: KeyFrameId,
    /// The pose in the camera frame of `from`, in its unit ([`crate::KeyFrame::unit`]): metres, as depth is measured.
    pub from_from_here: Se3,
    /// Information on its right perturbation (translation, rotation), 1/m^2 and 1/rad^2; none along directions that the surface leaves free.
    pub information: Matrix6<f64>,
}

impl RelativePose {
    /// The same with lengths in the map, of which `unit` are one of those in which it was measured.
    pub fn in_map(&self, unit: f64) -> Self {
        let Se3 { rotation, translation } = self.from_from_here;
        let by = Matrix6::from_fn(|i, j| {
            let lengths = i32::from(i < 3) + i32::from(j < 3);
            self.information[(i, j)] * unit.powi(-lengths)
        });
        Self { from_from_here: Se3::new(rotation, translation * unit), information: by, ..*self }
    }

    /// How far two poses in a frame are from it, squared and weighed: a chi-square of as many degrees of freedom as there are directions with
    /// information.
    pub fn chi2(&self, world_from_from: &Se3, world_from_here: &Se3) -> f64 {
        let off: Vector6<f64> =
            (self.from_from_here.inverse() * world_from_from.inverse() * *world_from_here).coordinates();
        off.dot(&(self.information * off))
    }

    /// Whether two poses in a frame may be so (chi-square, 99.9 %).
    pub fn agrees(&self, world_from_from: &Se3, world_from_here: &Se3) -> bool {
        self.chi2(world_from_from, world_from_here) <= GATE
    }

    /// Whether it is a pose with an information: symmetric, and nowhere negative.
    pub(crate) fn is_sound(&self) -> bool {
        let all = &self.information;
        let finite = self.from_from_here.is_finite() && all.iter().all(|v| v.abs() <= MOST_INFORMATION);
        let rounding = ROUNDING * all.trace().max(1.0);
        finite
            && (all - all.transpose()).iter().all(|v| v.abs() <= rounding)
            && all.symmetric_eigenvalues().iter().all(|v| *v >= -rounding)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{Manifold, So3, Vec3};

    fn measured() -> RelativePose {
        let root = Matrix6::from_fn(|i, j| (1.3 * i as f64 + 2.1 * j as f64).sin() * 40.0);
        let from_from_here = Se3::new(So3::exp(&Vec3::new(0.3, -0.2, 0.1)), Vec3::new(0.5, 0.1, -0.4));
        let from = KeyFrameId::from_index(0).unwrap();
        RelativePose { from, from_from_here, information: root * root.transpose() }
    }

    #[test]
    fn it_says_the_same_in_a_map_of_another_unit() {
        let (z, unit) = (measured(), 1.7);
        let from = Se3::new(So3::exp(&Vec3::new(0.1, 0.7, -0.3)), Vec3::new(2.0, -1.0, 0.5));
        let off = Vector6::new(0.01, -0.02, 0.015, 0.02, 0.01, -0.03);
        let here = from * z.from_from_here.retract(&off);
        let scaled = |pose: &Se3| Se3::new(pose.rotation, pose.translation * unit);
        let (before, after) = (z.chi2(&from, &here), z.in_map(unit).chi2(&scaled(&from), &scaled(&here)));
        assert!(before > 0.1 && (after / before - 1.0).abs() < 1e-9, "{before} {after}");
    }

    #[test]
    fn what_is_no_information_is_not_sound() {
        let z = measured();
        assert!(z.is_sound());
        let with = |change: &dyn Fn(&mut Matrix6<f64>)| {
            let mut other = z;
            change(&mut other.information);
            other.is_sound()
        };
        assert!(with(&|i| *i = Matrix6::zeros()));
        assert!(!with(&|i| *i = -*i));
        assert!(!with(&|i| i[(1, 2)] += 1.0));
        assert!(!with(&|i| i[(3, 3)] = f64::NAN));
        assert!(!with(&|i| *i *= 1e12));
        let mut nowhere = z;
        nowhere.from_from_here.translation.x = f64::INFINITY;
        assert!(!nowhere.is_sound());
    }
}
