//! Motion in metres from the readings and from tracks of features, without a visual map: the readings tell how the camera moved but for
//! its first velocity, gravity and the biases, and those are what makes the tracks meet in points.
//!
//! Nothing is taken from the places of key frames or landmarks: their unit of length may have changed meanwhile. What two views do not
//! tell, whether things have shifted because the camera turned or because it moved, the gyroscope does. First guess by linear equations
//! (Dong-Si & Mourikis, "Estimator initialization in vision-aided inertial navigation with unknown camera-IMU calibration", IROS 2012),
//! then least squares over the bearings with the points by their inverse depths (Civera, Davison, Montiel, "Inverse depth
//! parametrization for monocular SLAM", TRO 2008), eliminated. What a phone does not state is solved for too, from priors: the rest of
//! the clocks' offset, the focal length, the readout time of the rows.

mod found;
mod input;
mod linear;
mod problem;
#[cfg(test)]
mod tests;

use cairn_solve::pause;
pub use found::TrackMotion;
pub use input::{TrackPoint, TrackPriors, Tracks};
use problem::Problem;

/// Finds the motion, in slices; `None` where there is too little, or no minimum.
pub async fn motion_of_tracks(of: &Tracks<'_>) -> Option<TrackMotion> {
    let problem = Problem::new(of)?;
    let start = linear::guess(&problem)?;
    pause().await;
    problem.solve(start).await
}
