//! The occupancy grid of a robot with a depth camera, in the published map: planar scans between two heights above the
//! robot's frame, anchored to key frames and laid anew when the map moves them (`cairn::plan::anchored`).
//!
//! A scan is taken where the robot has moved, so the grid costs as much as the ground that was covered, not as time.

use crate::messages::{Header, MapMetaData, OccupancyGrid, Point, Pose, Quaternion};
use cairn::atlas::{KeyFrameId, Snapshot};
use cairn::geometry::{Se2, Se3, Vec3};
use cairn::plan::anchored::{AnchoredGrid, InsertError};
use cairn::plan::depth_scan::{DepthCamera, DepthScanConfig, DepthScanner};
use cairn::plan::{Grid, OccupancyConfig};
use cairn::sensor::{DepthImage, DepthSensor, Distortion};

/// Side of a cell, metres.
const CELL_M: f64 = 0.05;
/// A scan is taken after this much motion, metres and radians.
const MOVED: (f64, f64) = (0.15, 0.15);

/// Why there is no grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoGrid {
    /// The lens bends what it sees.
    #[error("no occupancy grid: depth images of a distorted lens are not laid into it")]
    Distorted,
    /// Size, focal length or unit of the camera are none.
    #[error("no occupancy grid: the depth camera's numbers are not usable")]
    Unusable,
}

/// The grid.
pub struct GroundGrid {
    scanner: DepthScanner,
    grid: AnchoredGrid<KeyFrameId>,
    last: Option<Se3>,
    stood_m: f64,
}

impl GroundGrid {
    /// For a depth sensor at this place of the robot; `stood_m` around where it has been is free.
    ///
    /// # Errors
    /// Why there is no grid: the sensor's lens is distorted, or its numbers are not usable.
    pub fn new(
        depth: &DepthSensor,
        base_from_depth: Se3,
        max_range_m: f64,
        stood_m: f64,
    ) -> Result<Self, NoGrid> {
        let c = &depth.camera;
        if c.distortion != Distortion::None {
            return Err(NoGrid::Distorted);
        }
        let camera = DepthCamera {
            size: (c.width, c.height),
            focal: (c.fx, c.fy),
            centre: (c.cx, c.cy),
            metres_per_unit: depth.metres_per_unit,
            body_from_camera: base_from_depth,
        };
        let scan = DepthScanConfig { max_range_m, ..DepthScanConfig::default() };
        let scanner = DepthScanner::new(camera, scan).ok_or(NoGrid::Unusable)?;
        let grid = AnchoredGrid::new(CELL_M, OccupancyConfig { max_range_m, ..OccupancyConfig::default() });
        Ok(Self { scanner, grid, last: None, stood_m })
    }

    /// Takes a depth image seen at a pose of the robot, near a key frame: `map_from_key` is that key frame's camera.
    ///
    /// # Errors
    /// Why it was not laid.
    pub fn observe(
        &mut self,
        depth: &DepthImage,
        key: KeyFrameId,
        map_from_key: &Se3,
        map_from_base: &Se3,
    ) -> Result<(), InsertError> {
        let moved = self.last.is_none_or(|last| {
            let by = last.inverse() * *map_from_base;
            by.translation.norm() > MOVED.0 || by.rotation.angle() > MOVED.1
        });
        if !moved {
            return Ok(());
        }
        self.last = Some(*map_from_base);
        let rays = self.scanner.scan(depth.data());
        let (key_pose, base) = (flat(map_from_key), flat(map_from_base));
        let key_from_sensor = key_pose.inverse() * base * self.scanner.body_from_sensor();
        let scanned = self.grid.insert_scan(key, &key_pose, key_from_sensor, &rays);
        // The camera does not see the ground below it.
        scanned.and_then(|_| self.grid.insert_step(key, &key_pose, key_pose.inverse() * base, self.stood_m))
    }

    /// Lays the grid anew where key frames have moved.
    ///
    /// # Errors
    /// Why it was not laid anew.
    pub fn follow(&mut self, snapshot: &Snapshot, map_from_world: &Se3) -> Result<(), InsertError> {
        let pose = |key| snapshot.key_frame(key).map(|k| flat(&(*map_from_world * k.world_from_camera)));
        self.grid.set_poses(pose).map(|_| ())
    }

    /// 0 free, 100 occupied, -1 unknown; `None` before the first scan.
    pub fn map(&self) -> Option<Grid<i8>> {
        self.grid.grid().map(|grid| grid.to_map())
    }
}

/// The pose over the ground: heading is where the x axis points, or for a camera that looks level its optical axis.
fn flat(pose: &Se3) -> Se2 {
    let ahead = pose.rotation * Vec3::x();
    // The x axis of an optical frame points right: level as well, so that it has a heading too.
    Se2::from_xy_angle(pose.translation.x, pose.translation.y, ahead.y.atan2(ahead.x))
}

/// A map as a message.
pub fn message(header: Header, map: &Grid<i8>) -> OccupancyGrid {
    let frame = map.frame();
    let corner = frame.world_from_grid();
    let half = 0.5 * corner.rotation.log();
    let origin = Pose {
        position: Point { x: corner.translation.x, y: corner.translation.y, z: 0.0 },
        orientation: Quaternion { x: 0.0, y: 0.0, z: half.sin(), w: half.cos() },
    };
    let info = MapMetaData {
        map_load_time: header.stamp.clone(),
        resolution: frame.resolution_m() as f32,
        width: frame.width() as u32,
        height: frame.height() as u32,
        origin,
    };
    OccupancyGrid { header, info, data: map.values().to_vec() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::looking_ahead;
    use cairn::geometry::So3;
    use cairn::sensor::Camera;

    /// A wall two metres ahead of a robot whose camera is 0.4 m up.
    #[test]
    fn a_wall_is_occupied_and_the_way_to_it_free() {
        let camera = Camera::pinhole(64, 48, 60.0, 60.0, 31.5, 23.5);
        let sensor = DepthSensor {
            camera,
            body_from_depth: Se3::identity(),
            metres_per_unit: 0.001,
            registered: true,
        };
        let base_from_depth = Se3::new(So3::identity(), Vec3::new(0.0, 0.0, 0.4)) * looking_ahead();
        let mut grid = GroundGrid::new(&sensor, base_from_depth, 5.0, 0.3).unwrap();
        let wall = DepthImage::from_vec(64, 48, vec![2000; 64 * 48]).unwrap();
        let key = KeyFrameId::from_index(0).unwrap();
        // The robot looks along +y.
        let turned = So3::exp(&Vec3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
        let at = |x: f64| Se3::new(turned, Vec3::new(x, 0.0, 0.0));
        let map_from_key = at(0.0) * base_from_depth;
        // It moves along the wall: one scan alone does not make a cell free.
        for x in [-0.2, 0.0, 0.2] {
            grid.observe(&wall, key, &map_from_key, &at(x)).unwrap();
        }
        let m = message(Header::default(), &grid.map().unwrap());
        let value = |x: f64, y: f64| {
            let (r, o) = (f64::from(m.info.resolution), &m.info.origin.position);
            let (i, j) = (((x - o.x) / r) as usize, ((y - o.y) / r) as usize);
            m.data[j * m.info.width as usize + i]
        };
        assert_eq!((value(0.0, 2.02), value(0.0, 1.0), value(0.0, 2.5)), (100, 0, -1));
        assert_eq!((value(0.2, 0.0), value(-0.35, -0.1), value(0.2, -0.4)), (0, 0, -1), "where it stood");
        assert_eq!(m.data.len(), (m.info.width * m.info.height) as usize);
        // Standing still adds nothing.
        grid.observe(&wall, key, &map_from_key, &at(0.2)).unwrap();
        assert_eq!(message(Header::default(), &grid.map().unwrap()), m);
        let fisheye = Camera { distortion: Distortion::Equidistant([0.1; 4]), ..camera };
        assert!(
            GroundGrid::new(&DepthSensor { camera: fisheye, ..sensor }, base_from_depth, 5.0, 0.3).is_err()
        );
    }
}
