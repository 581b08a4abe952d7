//! The images of a walk through a simulated building, as a phone takes them: what browser and network tests have in common.

use cairn_geometry::Se3;
use cairn_sensor::{Camera, FramePacket, Stamp};
use cairn_sim::{LiveRig, SimConfig, SimSensor, Walker, WorldKind};

/// Images per second of the camera.
pub const RATE_HZ: f64 = 15.0;

/// The camera.
pub fn camera() -> Camera {
    Camera::pinhole(480, 360, 315.0, 315.0, 239.5, 179.5)
}

/// The images of `seconds` of the way out, which begins in a corridor `start_s` after its door; there is a corner near
/// its middle.
pub fn route_out(start_s: f64, seconds: f64) -> Vec<FramePacket> {
    let config = SimConfig {
        sensor: SimSensor::Mono,
        imu: None,
        camera: camera(),
        rate_hz: RATE_HZ,
        body_from_camera: Se3::identity(),
        walker: Walker { speed: 0.7, turn_rate: 0.5, ..Walker::default() },
        ..SimConfig::new(WorldKind::Demo, 3)
    };
    let mut rig = LiveRig::new(&config).unwrap();
    let motion = config.walker.motion(&rig.world().routes()[0].points.clone());
    let packet = |k: usize| {
        let t = start_s + k as f64 / RATE_HZ;
        rig.packet(Stamp::from_seconds(t), &motion.pose(t)).unwrap()
    };
    (0..(seconds * RATE_HZ) as usize).map(packet).collect()
}
