//! Recovery: when many sightings are rejected, the pose must be wrong, so its covariance is widened until they fit.

use super::active::Linear;
use super::state::EkfSlam;
use nalgebra::Matrix3;

impl EkfSlam {
    /// Accepts a rejected sighting when so many were rejected that the pose must be wrong: the motion since the last
    /// accepted one had more noise than its model says (wheels slip). Adds as much, doubled until the NIS of the sighting
    /// is at most its mean, the degrees of freedom, or the gate where that is narrower. Returns false when recovery is
    /// not due, or nothing moved since.
    pub(super) fn recover(&mut self, robot: usize, linear: &Linear, gate: f64) -> bool {
        let known = &self.robots[robot];
        if known.recent.fraction() < self.config.recovery_fraction {
            return false;
        }
        let (place, recent) = (known.place, &known.recent);
        let motion = Matrix3::from_diagonal(&[recent.position, recent.position, recent.angle].into());
        let Some((_, _, by_pose)) = linear.h.blocks.iter().find(|b| b.0 == place.at) else { return false };
        let seen = by_pose * motion * by_pose.transpose();
        let (mut scale, limit) = (0.25, gate.min(linear.h.rows as f64));
        let fits = loop {
            let wider = Linear { s: linear.s + seen * scale, ..linear.clone() };
            match wider.nis() {
                Some(nis) if nis <= limit => break true,
                Some(_) if scale < 1e6 => scale *= 2.0,
                _ => break false,
            }
        };
        if !fits {
            return false;
        }
        self.active.inflate(place, &(motion * scale));
        let again = self.active.linear_rows(linear.h.clone(), linear.innovation, linear.noise);
        self.recoveries += 1;
        self.robots[robot].recent.rejected.clear();
        self.active.update(&again)
    }
}
