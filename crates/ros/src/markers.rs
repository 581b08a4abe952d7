//! What a viewer shows of the map beside its points: key frames as small cameras, the edges of their tree, closed loops, the
//! route, the goal.

use crate::frames::FrameTree;
use crate::messages::{Color, Header, Marker, MarkerArray, Point, Pose, Quaternion, Vector3};
use cairn::atlas::{KeyFrame, KeyFrameId, MapId};
use cairn::geometry::{Se3, Vec3};
use cairn::{Map, Stamp};

/// Depth of a drawn camera, metres.
const CAMERA_M: f64 = 0.1;
/// Width of lines, metres.
const LINE_M: f64 = 0.01;

/// `visualization_msgs/Marker` types.
const ARROW: i32 = 0;
const LINE_LIST: i32 = 5;

/// Color of key frames and their tree, of loops, of the goal.
const BLUE: Color = Color { r: 0.31, g: 0.55, b: 1.0, a: 1.0 };
const RED: Color = Color { r: 0.94, g: 0.24, b: 0.24, a: 1.0 };
const GREEN: Color = Color { r: 0.24, g: 0.78, b: 0.35, a: 1.0 };

/// The markers of a map. Each replaces the one of its name before: there are always the same four.
pub fn markers(
    stamp: Stamp,
    frame: &str,
    map: &Map,
    id: MapId,
    tree: &FrameTree,
    goal: Option<&Se3>,
) -> MarkerArray {
    let map_from_world = tree.map_from_world().unwrap_or_else(Se3::identity);
    let snapshot = map.snapshot();
    let key_frames: Vec<&KeyFrame> = snapshot.key_frames_of(id).collect();
    let at = |k: &KeyFrame| map_from_world * k.world_from_camera.translation;
    let edge = |k: &KeyFrame, other: KeyFrameId| {
        snapshot.key_frame(other).filter(|o| o.map == id).map(|o| [at(k), at(o)])
    };
    let cameras = key_frames.iter().flat_map(|k| camera(&(map_from_world * k.world_from_camera)));
    let parents = key_frames.iter().filter_map(|k| edge(k, k.parent?)).flatten();
    // Both ends name each other; each edge is drawn once.
    let links = |k: &&&KeyFrame| k.links.iter().filter(|other| **other < k.id).copied().collect::<Vec<_>>();
    let loops = key_frames
        .iter()
        .flat_map(|k| links(&k).into_iter().filter_map(|other| edge(k, other)).collect::<Vec<_>>())
        .flatten();
    let header = Header::new(stamp, frame);
    let lines = |ns: &str, color: &Color, points: &mut dyn Iterator<Item = Vec3>| {
        let points: Vec<Point> = points.map(Point::from).collect();
        let scale = Vector3 { x: LINE_M, y: 0.0, z: 0.0 };
        marker(&header, ns, LINE_LIST, color, scale, !points.is_empty()).with_points(points)
    };
    let arrow = Vector3 { x: 0.4, y: 0.05, z: 0.05 };
    let goal_marker = marker(&header, "goal", ARROW, &GREEN, arrow, goal.is_some());
    MarkerArray {
        markers: vec![
            lines("key_frames", &BLUE, &mut cameras.into_iter()),
            lines("spanning_tree", &BLUE, &mut parents.into_iter()),
            lines("loops", &RED, &mut loops.into_iter()),
            Marker { pose: goal.map_or_else(upright, Pose::from), ..goal_marker },
        ],
    }
}

/// Pairs of points: four edges from the centre of a camera to the corners of its image, and four around it.
fn camera(map_from_camera: &Se3) -> Vec<Vec3> {
    let corner = |x: f64, y: f64| *map_from_camera * (Vec3::new(0.8 * x, 0.6 * y, 1.0) * CAMERA_M);
    let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    let centre = map_from_camera.translation;
    (0..4).flat_map(|i| [centre, corners[i], corners[i], corners[(i + 1) % 4]]).collect()
}

/// A marker that is shown, or taken away: viewers complain of one without points.
fn marker(header: &Header, ns: &str, kind: i32, color: &Color, scale: Vector3, shown: bool) -> Marker {
    const ADD: i32 = 0;
    const DELETE: i32 = 2;
    let action = if shown { ADD } else { DELETE };
    let (header, ns, color) = (header.clone(), ns.to_owned(), color.clone());
    Marker { header, ns, kind, action, pose: upright(), scale, color, ..Marker::default() }
}

impl Marker {
    fn with_points(self, points: Vec<Point>) -> Self {
        Self { points, ..self }
    }
}

fn upright() -> Pose {
    Pose { orientation: Quaternion { w: 1.0, ..Quaternion::default() }, ..Pose::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn::geometry::So3;

    #[test]
    fn a_camera_is_drawn_around_its_optical_axis() {
        let pose = Se3::new(So3::exp(&Vec3::new(0.0, 0.5, 0.0)), Vec3::new(1.0, 2.0, 3.0));
        let lines = camera(&pose);
        assert_eq!(lines.len(), 16);
        let inside = |p: &Vec3| pose.inverse() * *p;
        assert!(lines.iter().all(|p| (inside(p).z - CAMERA_M).abs() < 1e-12 || inside(p).norm() < 1e-12));
        let mean = lines.iter().map(inside).sum::<Vec3>() / 16.0;
        assert!(mean.x.abs() < 1e-12 && mean.y.abs() < 1e-12 && mean.z > 0.05, "{mean}");
    }
}
