//! What a gravity-aligned map knows of which way is up, as a factor of the window of the whole map.
//!
//! Where no readings of an IMU lead to the root, as in a map that another rig goes on with or is joined to, it counts beside links
//! elsewhere: of a few links a bias of the accelerometer cannot be told from a tilt.

use crate::factor::{Frames, WindowFactors};
use crate::imu::linked;
use cairn_atlas::Snapshot;
use cairn_geometry::{Mat3, Se3, Vec3};
use cairn_solve::{Equations, Factors, Variable};
use nalgebra::SMatrix;

/// Standard deviation of the tilt of a gravity-aligned map before it is adjusted as a whole, radians: what an initialisation or a
/// recognised place leaves.
const SIGMA_RAD: f64 = 0.01;

/// The level of a map, at its root.
#[derive(Clone, Copy, Debug, Default)]
pub struct Level {
    /// Of the root: its index, and the unit vector that points up, along the axes of its camera.
    root: Option<(usize, Vec3)>,
}

/// The whitened residual, and its Jacobian by a rotation on the right: `up` seen from the turned camera.
fn residual(up_before: &Vec3, world_from_camera: &Se3) -> (Vec3, Mat3) {
    let up = world_from_camera.rotation.inverse() * Vec3::z();
    ((up - up_before) / SIGMA_RAD, up.cross_matrix() / SIGMA_RAD)
}

impl WindowFactors for Level {
    fn bind(&mut self, snapshot: &Snapshot, frames: &Frames) -> usize {
        let root = frames.map.root();
        let unknown = frames.centre.is_none() && !linked(snapshot, frames.map).contains(&root);
        let slot = frames.slot(root).filter(|_| unknown);
        self.root = slot.map(|slot| (slot, frames.poses[slot].rotation.inverse() * Vec3::z()));
        usize::from(self.root.is_some())
    }
}

impl Factors for Level {
    fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
        self.root.iter().for_each(|(slot, _)| visit(&[Variable::Pose(*slot)]));
    }
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
        if let Some((slot, up)) = self.root {
            let (residual, by_rotation) = residual(&up, &poses[slot]);
            let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
            jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&by_rotation);
            equations.add(&residual, &jacobian, &[(Some(Variable::Pose(slot)), 0..6)]);
        }
        Some(())
    }
    fn attempt(&mut self, poses: &[Se3], _: &[f64]) -> f64 {
        self.root.map_or(0.0, |(slot, up)| 0.5 * residual(&up, &poses[slot]).0.norm_squared())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::So3;

    #[test]
    fn level_jacobian_matches_differences() {
        let pose = Se3::new(So3::exp(&Vec3::new(0.3, -1.1, 0.4)), Vec3::new(1.0, 2.0, 3.0));
        let up = pose.rotation.inverse() * Vec3::z();
        assert!(residual(&up, &pose).0.norm() < 1e-12);
        let turned = Se3::new(pose.rotation * So3::exp(&Vec3::new(0.02, 0.01, -0.03)), pose.translation);
        let (_, jacobian) = residual(&up, &turned);
        for column in 0..3 {
            let at = |h: f64| {
                let mut d = Vec3::zeros();
                d[column] = h;
                let turned = Se3::new(turned.rotation * So3::exp(&d), turned.translation);
                residual(&up, &turned).0
            };
            let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((numeric - jacobian.column(column)).amax() < 1e-5 * jacobian.amax(), "column {column}");
        }
    }
}
