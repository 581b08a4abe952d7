//! The strips that are looked at: along the route and straight ahead, and the level frame in which they lie.

use cairn_dense::walk::Blocked;
use cairn_geometry::{So3, Vec2};
use cairn_guide::{Ground, Guide, GuideState, Heading, StopReason};

/// Straight ahead it is a little narrower, and where he already stands nearer to something, such as a wall, as narrow as there is
/// room, down to his body's half.
pub(super) const STRAIGHT_HALF_M: [f64; 2] = [0.20, 0.28];

/// Half of a strip that begins at a place, at most this, where something already is beside it.
pub(super) fn half_within(obstacles: &[Blocked], at: &Vec2, most_m: f64) -> f64 {
    let nearest = obstacles.iter().map(|b| (b.at - at).norm()).fold(f64::INFINITY, f64::min);
    (nearest - 0.03).clamp(STRAIGHT_HALF_M[0], most_m)
}

/// What in the way the guide has stopped for, if for that.
pub(super) fn stopped_for(guide: &Guide) -> Option<StopReason> {
    match guide.state() {
        GuideState::Stopped(reason) if reason.is_in_the_way() => Some(reason),
        _ => None,
    }
}

/// The line that the walker will follow: to where he is led, then along the route.
pub(super) fn strip(guide: &Guide, walker: &Heading) -> Option<Vec<Vec2>> {
    let (aim_m, aim) = guide.aim_point()?;
    let plan = guide.plan();
    let mut line = vec![walker.position];
    if (aim - walker.position).norm() > 0.1 {
        line.push(aim);
    }
    let mut along = aim_m + 0.25;
    while along < plan.length() && along < aim_m + 4.0 {
        line.push(plan.point_at(along));
        along += 0.25;
    }
    (line.len() > 1).then_some(line)
}

/// The rotation from the odometry frame to the level frame whose x and y are those of the ground plane.
pub(super) fn level(ground: &Ground) -> So3 {
    let axes = [Vec2::x(), Vec2::y()].map(|axis| ground.point(&axis, 0.0));
    let here_from_level = nalgebra::Matrix3::from_columns(&[axes[0], axes[1], ground.up()]);
    So3::from_matrix(&here_from_level).inverse()
}

/// The unit vector of a heading.
pub(super) fn direction(heading: f64) -> Vec2 {
    Vec2::new(heading.cos(), heading.sin())
}
