//! The robot of a trial, its camera and its world.

use cairn_geometry::{Mat3, Se3, So3, Vec3};
use cairn_plan::control::{Limits, NavigatorConfig, PursuitConfig};
use cairn_plan::depth_scan::DepthScanConfig;
use cairn_plan::frontier::FrontierConfig;
use cairn_plan::ground::GroundConfig;
use cairn_plan::{CostConfig, OccupancyConfig};
use cairn_sensor::Camera;
use cairn_sim::{SimConfig, SimSensor, WorldKind, WorldOptions};

/// Frames and commands a second.
const RATE_HZ: f64 = 10.0;
/// Height of the camera above the floor, metres.
const CAMERA_HEIGHT_M: f64 = 0.8;
/// The camera is this far ahead of the axle, metres.
const CAMERA_AHEAD_M: f64 = 0.1;
/// The camera looks down by this angle, degrees.
const CAMERA_DOWN_DEG: f64 = 20.0;

/// One trial.
#[derive(Clone, Debug)]
pub struct RobotConfig {
    /// Seed of the world, the noise and the people.
    pub seed: u64,
    /// World and camera. The body frame is on the floor below the axle: x ahead, z up.
    pub sim: SimConfig,
    /// Radius of the robot, metres.
    pub radius_m: f64,
    /// The ground within this distance of the robot is free where it is switched on, metres: its user sees to that.
    pub start_free_m: f64,
    /// Scans from depth images.
    pub scan: DepthScanConfig,
    /// The map of the ground.
    pub ground: GroundConfig,
    /// Planning and following.
    pub navigator: NavigatorConfig,
    /// Frontiers.
    pub frontier: FrontierConfig,
    /// Delay from command to motion, seconds.
    pub delay_s: f64,
    /// Relative error of each increment of the wheel odometry.
    pub wheel_noise: f64,
    /// How many people walk about.
    pub people: usize,
    /// Exploration ends after this time, seconds.
    pub explore_s: f64,
    /// A try for a goal ends after this time, seconds.
    pub goal_s: f64,
    /// A goal counts as reached when the robot truly stands within this distance, metres.
    pub arrival_m: f64,
}

impl RobotConfig {
    /// The trial with a seed.
    pub fn new(seed: u64) -> Self {
        let radius_m = 0.2;
        let limits = Limits {
            linear: 0.7,
            backwards: 0.15,
            angular: 1.2,
            acceleration: 0.7,
            deceleration: 1.0,
            angular_acceleration: 3.0,
        };
        let pursuit = PursuitConfig {
            period_s: 1.0 / RATE_HZ,
            delay_s: 0.1,
            look_ahead_s: 0.7,
            stop_distance_m: 0.15,
            ..PursuitConfig::new(limits)
        };
        Self {
            seed,
            sim: sim(seed),
            radius_m,
            start_free_m: 0.65,
            scan: DepthScanConfig::default(),
            ground: GroundConfig {
                occupancy: OccupancyConfig { max_range_m: 6.0, ..OccupancyConfig::default() },
                costs: CostConfig { radius_m, margin_m: 0.06, inflation_m: 0.6, ..CostConfig::default() },
                // People stop for some seconds before a robot: longer than the navigator waits for them.
                settle_s: 5.0,
                ..GroundConfig::default()
            },
            // After two rounds before someone it gives way to him, and where it only creeps up to him after as long.
            navigator: NavigatorConfig {
                room_m: 0.1,
                attempts: 1,
                patience_s: 15.0,
                ..NavigatorConfig::new(pursuit)
            },
            frontier: FrontierConfig::default(),
            delay_s: 0.05,
            wheel_noise: 0.02,
            people: 2,
            explore_s: 300.0,
            goal_s: 120.0,
            arrival_m: 0.3,
        }
    }

    /// Seconds from frame to frame.
    pub fn step_s(&self) -> f64 {
        1.0 / self.sim.rate_hz
    }
}

/// An apartment seen by a small RGB-D camera.
fn sim(seed: u64) -> SimConfig {
    let ahead = Mat3::from_columns(&[-Vec3::y(), -Vec3::z(), Vec3::x()]);
    let down = So3::exp(&Vec3::new(-CAMERA_DOWN_DEG.to_radians(), 0.0, 0.0));
    let mount = Se3::new(So3::from_matrix(&ahead) * down, Vec3::new(CAMERA_AHEAD_M, 0.0, CAMERA_HEIGHT_M));
    SimConfig {
        sensor: SimSensor::Rgbd,
        imu: None,
        camera: Camera::pinhole(240, 200, 140.0, 140.0, 119.5, 99.5),
        rate_hz: RATE_HZ,
        body_from_camera: mount,
        options: WorldOptions { detail: 0.3, ..WorldOptions::default() },
        ..SimConfig::new(WorldKind::Apartment, seed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{Se2, Vec2};
    use cairn_plan::ground::GroundMap;

    /// Someone stands 1.5 m before the robot in a round room of radius 3 m.
    #[test]
    fn a_person_is_furniture_after_five_seconds() {
        let mut ground = GroundMap::<u32>::new(RobotConfig::new(1).ground);
        let scan = |person: bool| -> Vec<(f64, f64)> {
            let range = |bearing: f64| if person && bearing.abs() < 0.13 { 1.3 } else { 3.0 };
            (-360..360).map(|k| 0.5f64.to_radians() * f64::from(k)).map(|b| (b, range(b))).collect()
        };
        let mut occupied_from_s = None;
        for k in 0..90 {
            let time_s = 0.1 * f64::from(k);
            // He comes after a second.
            let rays = scan(time_s >= 1.0);
            ground.observe(time_s, 0, &Se2::identity(), Se2::identity(), &rays).unwrap();
            let map = ground.map().unwrap();
            let cell = |x: f64| map.frame().cell_at(Vec2::new(x, 0.0)).and_then(|c| map.get(c));
            if [1.22, 1.27, 1.32, 1.37].into_iter().any(|x| cell(x) == Some(100)) {
                occupied_from_s = occupied_from_s.or(Some(time_s - 1.0));
            }
        }
        let after_s = occupied_from_s.expect("he stays, so he is furniture at some time");
        assert!((4.5..6.0).contains(&after_s), "furniture after {after_s} s");
    }
}
