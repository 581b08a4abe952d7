//! The outbound walk: a walker follows a route of the simulated world and the session records it.

use super::camera::DemoCamera;
use super::config::DemoConfig;
use crate::failure::Failure;
use crate::progress::Progress;
use cairn_geometry::{Se3, Vec2};
use cairn_guide::{Ground, Route, RouteHeader};
use cairn_sensor::Stamp;
use cairn_session::Command;
use cairn_trial::way::corners;

/// Result of the outbound walk.
pub struct WalkedOut {
    /// The recorded route; its header holds the up direction estimated from the walk.
    pub route: Route,
    /// Time of the last frame.
    pub end: Stamp,
    /// The walker's true position (metres) and heading (radians) at the end.
    pub turning_point: (Vec2, f64),
    /// The corners of the path, metres, without the sway of the gait.
    pub corners: Vec<Vec2>,
    /// True length walked in metres, without the sway of the gait.
    pub walked_m: f64,
}

/// Walks out and records the route.
///
/// # Errors
/// When the session or the renderer fails, or tracking never started.
pub fn walk_out(
    camera: &mut DemoCamera,
    config: &DemoConfig,
    progress: &Progress,
) -> Result<WalkedOut, Failure> {
    let points = camera.world().routes().first().map_or(&[][..], |w| &w.points);
    let corners = corners(points, config.metres);
    let motion = config.sim.walker.motion(&corners);
    let frames = (motion.end() * config.sim.rate_hz).ceil() as usize + 1;
    camera.ask(&Command::Record)?;
    let mut stamp = Stamp::from_seconds(0.0);
    for k in 0..frames {
        let t = (k as f64 / config.sim.rate_hz).min(motion.end() + 1.0);
        stamp = Stamp::from_seconds(t);
        camera.see(stamp, &motion.pose(t))?;
        progress.step((50.0 * t / motion.end()) as usize);
    }
    let nothing =
        || Failure::new("the walk", "tracking never started, so nothing was recorded", "try another --seed");
    camera.ask(&Command::Stop).map_err(|_| nothing())?;
    let mut route = camera.session().route().cloned().ok_or_else(nothing)?;
    if route.header.metric && config.sim.imu.is_none() {
        // The map starts at the first camera and is not gravity-aligned: the up direction is estimated from the walk.
        let poses: Vec<Se3> = route.points.iter().map(|p| p.odom_from_camera).collect();
        let ground = Ground::of_walk(&poses).ok_or_else(nothing)?;
        route.header = RouteHeader::new(true, &ground, config.source());
    }
    let heading = match corners.as_slice() {
        [.., a, b] => (b - a).y.atan2((b - a).x),
        _ => 0.0,
    };
    let turning_point = (corners.last().copied().unwrap_or_default(), heading);
    let walked_m = corners.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
    Ok(WalkedOut { route, end: stamp, turning_point, corners, walked_m })
}
