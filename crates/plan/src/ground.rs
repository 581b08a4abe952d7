//! What a driving robot knows of the ground: the occupancy grid from its scans, anchored to key frames; the costmap of all
//! of it, updated by difference; a local costmap that rolls with the robot; and what moves.
//!
//! Scans that end on ground known to be free, well away from everything known, see something that moves or has newly come.
//! Such clusters become detections of a [`DynamicLayer`] and stay out of the grid, so that people leave no trail in it.
//! What has stood in one place for a while goes into the grid: a door that was closed, a chair that was moved. It may have gone
//! again unseen: where no path is left, [`GroundMap::forget_new`] opens the ground to be looked at once more.

use crate::anchored::{AnchoredGrid, InsertError, PoseUpdate};
use crate::costmap::{CostConfig, CostError, Costmap, Detection, DynamicConfig, DynamicLayer, Track};
use crate::grid::{Cell, Grid};
use crate::occupancy::OccupancyConfig;
use cairn_geometry::{Se2, Vec2};
use std::collections::BTreeSet;

/// Sizes, radii and times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundConfig {
    /// Side of a cell in metres.
    pub resolution_m: f64,
    /// The occupancy grid.
    pub occupancy: OccupancyConfig,
    /// Costs, with the radius of the robot.
    pub costs: CostConfig,
    /// Tracks of what moves.
    pub dynamic: DynamicConfig,
    /// Side of the local costmap, in metres.
    pub local_side_m: f64,
    /// A scan point farther than this from all that is known to be occupied or unknown belongs to something new, in metres.
    pub new_beyond_m: f64,
    /// Points of one new thing are this near to each other, in metres.
    pub gap_m: f64,
    /// Fewer points than this are not tracked; they stay out of the grid all the same.
    pub min_points: usize,
    /// What has stood in one place for this long goes into the grid, in seconds.
    pub settle_s: f64,
}

impl Default for GroundConfig {
    fn default() -> Self {
        Self {
            resolution_m: 0.05,
            occupancy: OccupancyConfig { max_range_m: 6.0, ..OccupancyConfig::default() },
            costs: CostConfig::default(),
            dynamic: DynamicConfig::default(),
            local_side_m: 6.0,
            new_beyond_m: 0.2,
            gap_m: 0.25,
            min_points: 3,
            settle_s: 2.5,
        }
    }
}

/// Why the ground could not be brought up to date.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum GroundError {
    /// A scan or a pose was refused.
    #[error(transparent)]
    InsertError(#[from] InsertError),
    /// Radii or costs are unusable.
    #[error(transparent)]
    Costs(#[from] CostError),
}

/// Thickness assumed behind the seen side of a new thing, in metres: half of a person's.
const BEHIND_M: f64 = 0.12;
/// Least and greatest radius of a new thing, in metres.
const RADIUS_M: (f64, f64) = (0.2, 0.6);
/// Scan points this near to the rim of a track may be of the tracked thing, in metres.
const NEAR_M: f64 = 0.25;
/// A track this near to a cluster is the cluster's, in metres.
const SAME_M: f64 = 0.5;

/// The ground around a robot; `K` identifies key frames.
#[derive(Clone, Debug)]
pub struct GroundMap<K> {
    config: GroundConfig,
    grid: AnchoredGrid<K>,
    costs: Option<Costmap>,
    local: Option<Costmap>,
    moving: DynamicLayer,
    /// Where something that had newly come went into the grid, in cells.
    settled: BTreeSet<[i32; 2]>,
}

impl<K: Copy + Ord> GroundMap<K> {
    /// Nothing is known.
    pub fn new(config: GroundConfig) -> Self {
        let grid = AnchoredGrid::new(config.resolution_m, config.occupancy);
        let moving = DynamicLayer::new(config.dynamic);
        Self { config, grid, costs: None, local: None, moving, settled: BTreeSet::new() }
    }

    /// Records that the robot stands at `key_from_body`: the ground within `radius_m` is free.
    ///
    /// # Errors
    /// When a pose is not finite, or the grid would become too large.
    pub fn stand(
        &mut self,
        key: K,
        world_from_key: &Se2,
        key_from_body: Se2,
        radius_m: f64,
    ) -> Result<(), GroundError> {
        self.grid.insert_step(key, world_from_key, key_from_body, radius_m)?;
        Ok(())
    }

    /// Takes a scan (bearings in radians, ranges in metres; times in seconds) seen at `key_from_sensor`.
    ///
    /// # Errors
    /// When a pose is not finite, the grid would become too large, or the costs are unusable.
    pub fn observe(
        &mut self,
        time_s: f64,
        key: K,
        world_from_key: &Se2,
        key_from_sensor: Se2,
        rays: &[(f64, f64)],
    ) -> Result<(), GroundError> {
        let world_from_sensor = *world_from_key * key_from_sensor;
        let clusters = self.new_things(&world_from_sensor, rays);
        let things = || clusters.iter().filter(|c| c.rays.len() >= self.config.min_points);
        let detections: Vec<Detection> = things().map(|c| c.detection).collect();
        self.moving.observe(time_s, &detections);
        let mut known = self.beside_tracks(&world_from_sensor, rays);
        let mut settled_rays = self.take_settled(&world_from_sensor, rays, &mut known);
        for cluster in &clusters {
            let at = cluster.detection.position;
            let away = |t: &&Track| (t.position - at).norm();
            let track = self.moving.tracks().iter().min_by(|a, b| away(a).total_cmp(&away(b)));
            let settled = track.is_some_and(|t| away(&t) < SAME_M && t.still_for_s() >= self.config.settle_s);
            cluster.rays.iter().for_each(|&ray| known[ray] = false);
            if settled {
                // Only these: what was seen beside something that had settled would spread along a wall.
                let begin = settled_rays.len();
                settled_rays.extend(cluster.rays.iter().map(|&ray| rays[ray]));
                let ends =
                    hits(&world_from_sensor, &settled_rays[begin..], self.config.occupancy.max_range_m);
                self.settled.extend(ends.map(|(_, p)| cell_of(&p, self.config.resolution_m)));
            }
        }
        let mut of_known: Vec<(f64, f64)> =
            rays.iter().zip(&known).filter(|(_, known)| **known).map(|(ray, _)| *ray).collect();
        self.grid.insert_scan(key, world_from_key, key_from_sensor, &of_known)?;
        if !settled_rays.is_empty() {
            self.grid.insert_new(key, world_from_key, key_from_sensor, &settled_rays)?;
            of_known.append(&mut settled_rays);
        }
        self.refresh()?;
        self.look_around(&world_from_sensor, &of_known)
    }

    /// Takes the current poses of all key frames, `None` for removed ones, and rebuilds the grid if that changes it.
    ///
    /// # Errors
    /// When a pose is not finite, or the grid would become too large: everything stays as it was.
    pub fn set_poses(
        &mut self,
        world_from_key: impl Fn(K) -> Option<Se2>,
    ) -> Result<PoseUpdate, GroundError> {
        let laid = self.grid.set_poses(world_from_key)?;
        if laid.moved + laid.gone > 0 {
            self.refresh()?;
        }
        Ok(laid)
    }

    /// Forgets what has come to stand on ground that was free before, and returns whether there was anything: it may have
    /// gone again since it was seen. What is still there is seen again before it is reached.
    ///
    /// # Errors
    /// When the grid cannot be rebuilt: everything stays as it was.
    pub fn forget_new(&mut self) -> Result<bool, GroundError> {
        let forgotten = self.grid.forget_new()? > 0;
        self.settled.clear();
        if forgotten {
            self.refresh()?;
        }
        Ok(forgotten)
    }

    /// Costs of all the ground seen so far.
    pub fn costs(&self) -> Option<&Costmap> {
        self.costs.as_ref()
    }

    /// Costs around the robot, with what the last scan saw.
    pub fn local(&self) -> Option<&Costmap> {
        self.local.as_ref()
    }

    /// What moves.
    pub fn moving(&self) -> &DynamicLayer {
        &self.moving
    }

    /// The nearest place to a point where something moves, or stands that has newly come.
    pub fn nearest_new(&self, at: Vec2) -> Option<Vec2> {
        let occupied = |p: &Vec2| {
            self.map().is_some_and(|map| map.frame().cell_at(*p).and_then(|c| map.get(c)) == Some(100))
        };
        let centre = |[x, y]: &[i32; 2]| {
            Vec2::new(f64::from(*x) + 0.5, f64::from(*y) + 0.5) * self.config.resolution_m
        };
        let standing = self.settled.iter().map(centre).filter(occupied);
        let moving = self.moving.tracks().iter().map(|t| t.position);
        let away = |p: &Vec2| (p - at).norm_squared();
        standing.chain(moving).min_by(|a, b| away(a).total_cmp(&away(b)))
    }

    /// Brings the global costmap up to date: by the cells that changed, anew when the grid has grown, and away with it when no key frame
    /// is left.
    fn refresh(&mut self) -> Result<(), GroundError> {
        let Some(map) = self.grid.grid().map(|grid| grid.to_map()) else {
            (self.costs, self.local) = (None, None);
            return Ok(());
        };
        match &mut self.costs {
            Some(costs) if costs.frame() == map.frame() => {
                let pairs = map.values().iter().zip(costs.map().values()).enumerate();
                let changed = pairs.filter(|(_, (new, old))| new != old);
                let changes: Vec<(Cell, i8)> =
                    changed.map(|(i, (new, _))| (map.frame().cell(i), *new)).collect();
                costs.update(&changes);
            }
            _ => self.costs = Some(Costmap::new(map, self.config.costs)?),
        }
        Ok(())
    }

    /// Lays the local costmap around the sensor: a window of the map, with the points of the last scan.
    fn look_around(&mut self, world_from_sensor: &Se2, rays: &[(f64, f64)]) -> Result<(), GroundError> {
        let Some(costs) = &self.costs else { return Ok(()) };
        let frame = costs.frame();
        let half = (0.5 * self.config.local_side_m / frame.resolution_m()).ceil().max(1.0);
        let middle = frame.in_cells(world_from_sensor.translation);
        let [x, y] = [middle.x, middle.y].map(|v| (v - half).floor() as i64);
        let side = 2 * half as usize;
        let mut window = costs.map().window(x, y, side, side, -1).map_err(InsertError::from)?;
        for point in hits(world_from_sensor, rays, self.config.occupancy.max_range_m).map(|(_, p)| p) {
            if let Some(cell) = window.frame().cell_at(point) {
                window.set(cell, 100);
            }
        }
        self.local = Some(Costmap::new(window, self.config.costs)?);
        Ok(())
    }

    /// Clusters of scan points that lie on ground known to be free.
    fn new_things(&self, world_from_sensor: &Se2, rays: &[(f64, f64)]) -> Vec<Cluster> {
        let Some(costs) = &self.costs else { return Vec::new() };
        let is_new = |p: &Vec2| {
            let distance = costs.frame().cell_at(*p).and_then(|c| costs.field().distance_m(c));
            distance.is_some_and(|d| d > self.config.new_beyond_m)
        };
        let points = hits(world_from_sensor, rays, self.config.occupancy.max_range_m);
        let mut clusters: Vec<Vec<(usize, Vec2)>> = Vec::new();
        for (ray, point) in points.filter(|(_, p)| is_new(p)) {
            let near = |c: &&mut Vec<(usize, Vec2)>| {
                c.iter().rev().take(8).any(|(_, p)| (p - point).norm() <= self.config.gap_m)
            };
            match clusters.iter_mut().rev().take(3).find(near) {
                Some(cluster) => cluster.push((ray, point)),
                None => clusters.push(vec![(ray, point)]),
            }
        }
        clusters.iter().map(|c| Cluster::of(c, world_from_sensor.translation)).collect()
    }

    /// Takes the rays out of those known that end on something that had settled before.
    fn take_settled(
        &self,
        world_from_sensor: &Se2,
        rays: &[(f64, f64)],
        known: &mut [bool],
    ) -> Vec<(f64, f64)> {
        let mut taken = Vec::new();
        if self.settled.is_empty() {
            return taken;
        }
        let reach = (self.config.new_beyond_m / self.config.resolution_m).ceil() as i32;
        for (ray, point) in hits(world_from_sensor, rays, self.config.occupancy.max_range_m) {
            let [x, y] = cell_of(&point, self.config.resolution_m);
            let mut columns = self.settled.range([x - reach, i32::MIN]..=[x + reach, i32::MAX]);
            if known[ray] && columns.any(|c| (c[1] - y).abs() <= reach) {
                known[ray] = false;
                taken.push(rays[ray]);
            }
        }
        taken
    }

    /// For each ray, whether it ends away from everything that is tracked and has not settled: the arm of a person who
    /// passes a wall is not told from the wall by its place alone.
    fn beside_tracks(&self, world_from_sensor: &Se2, rays: &[(f64, f64)]) -> Vec<bool> {
        let mut beside = vec![true; rays.len()];
        let settle_s = self.config.settle_s;
        for track in self.moving.tracks().iter().filter(|t| t.still_for_s() < settle_s) {
            let reach_m = track.radius_m + NEAR_M;
            for (ray, point) in hits(world_from_sensor, rays, self.config.occupancy.max_range_m) {
                beside[ray] &= (point - track.position).norm() > reach_m;
            }
        }
        beside
    }

    /// The map of values of a ROS `OccupancyGrid`; `None` before the first scan.
    pub fn map(&self) -> Option<&Grid<i8>> {
        self.costs.as_ref().map(Costmap::map)
    }
}

/// The cell of the world's own raster that holds a point.
fn cell_of(point: &Vec2, resolution_m: f64) -> [i32; 2] {
    [point.x, point.y].map(|v| (v / resolution_m).floor() as i32)
}

/// The ends of rays within range, with their index.
fn hits<'a>(
    world_from_sensor: &'a Se2,
    rays: &'a [(f64, f64)],
    max_range_m: f64,
) -> impl Iterator<Item = (usize, Vec2)> + 'a {
    let ends = rays.iter().enumerate().filter(move |(_, (_, range))| *range <= max_range_m);
    ends.map(|(i, (bearing, range))| {
        (i, *world_from_sensor * Vec2::new(range * bearing.cos(), range * bearing.sin()))
    })
}

/// Points of a scan that belong to one new thing.
struct Cluster {
    rays: Vec<usize>,
    detection: Detection,
}

impl Cluster {
    fn of(points: &[(usize, Vec2)], seen_from: Vec2) -> Self {
        let mean = points.iter().map(|(_, p)| p).sum::<Vec2>() / points.len().max(1) as f64;
        let away = (mean - seen_from).try_normalize(1e-9).unwrap_or_default();
        let extent = points.iter().map(|(_, p)| (p - mean).norm()).fold(0.0, f64::max);
        let detection =
            Detection { position: mean + away * BEHIND_M, radius_m: extent.clamp(RADIUS_M.0, RADIUS_M.1) };
        Self { rays: points.iter().map(|(ray, _)| *ray).collect(), detection }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scan of a square room of 6 m from a pose inside, with a disc of radius 0.2 m somewhere.
    fn scan(pose: &Se2, disc: Option<Vec2>) -> Vec<(f64, f64)> {
        let ray = |k: i32| {
            let bearing = f64::from(k) * 0.5f64.to_radians();
            let direction = pose.rotation * Vec2::new(bearing.cos(), bearing.sin());
            let wall = |p: f64, d: f64| if d > 0.0 { (3.0 - p) / d } else { (-3.0 - p) / d };
            let t = pose.translation;
            let mut range = wall(t.x, direction.x).min(wall(t.y, direction.y));
            if let Some(disc) = disc {
                let along = (disc - t).dot(&direction);
                let off = (disc - t - direction * along).norm();
                if along > 0.0 && off < 0.2 {
                    range = range.min(along - (0.04 - off * off).sqrt());
                }
            }
            (bearing, range)
        };
        (0..720).map(ray).collect()
    }

    fn value(ground: &GroundMap<u32>, at: Vec2) -> i8 {
        let map = ground.map().unwrap();
        map.get(map.frame().cell_at(at).unwrap()).unwrap()
    }

    #[test]
    fn a_walker_is_tracked_and_leaves_no_trail() {
        let mut ground = GroundMap::new(GroundConfig::default());
        let here = Se2::from_xy_angle(0.02, 0.03, 0.0);
        for k in 0..10 {
            ground.observe(0.1 * f64::from(k), 0, &Se2::identity(), here, &scan(&here, None)).unwrap();
        }
        assert!(ground.moving().tracks().is_empty());
        let path = |k: i32| Vec2::new(-1.5 + 0.08 * f64::from(k), 1.5);
        for k in 0..30 {
            let time_s = 1.0 + 0.1 * f64::from(k);
            ground.observe(time_s, 0, &Se2::identity(), here, &scan(&here, Some(path(k)))).unwrap();
        }
        let tracks = ground.moving().tracks();
        assert_eq!(tracks.len(), 1, "{tracks:?}");
        assert!((tracks[0].position - path(29)).norm() < 0.15, "{:?}", tracks[0].position);
        assert!((tracks[0].velocity - Vec2::new(0.8, 0.0)).norm() < 0.2, "{:?}", tracks[0].velocity);
        assert!((0..29).all(|k| value(&ground, path(k)) == 0), "the walked line is free");
    }

    #[test]
    fn what_stays_becomes_part_of_the_map_and_may_leave_again() {
        let mut ground = GroundMap::new(GroundConfig::default());
        let here = Se2::from_xy_angle(0.02, 0.03, 0.0);
        let mut time_s = 0.0;
        let mut look = |ground: &mut GroundMap<u32>, disc: Option<Vec2>, steps: usize| {
            for _ in 0..steps {
                time_s += 0.1;
                ground.observe(time_s, 0, &Se2::identity(), here, &scan(&here, disc)).unwrap();
            }
        };
        let box_at = Vec2::new(1.5, 0.0);
        let seen_side = Vec2::new(1.31, 0.0);
        look(&mut ground, None, 10);
        look(&mut ground, Some(box_at), 20);
        assert_eq!(value(&ground, seen_side), 0, "not yet");
        assert!(ground.moving().clearance_m(box_at, 0.0) < 0.0, "but it is tracked");
        look(&mut ground, Some(box_at), 15);
        assert_eq!(value(&ground, seen_side), 100);
        assert!(ground.local().unwrap().field().clearance_m(seen_side) < 0.05);
        look(&mut ground, None, 10);
        assert_eq!(value(&ground, seen_side), 0, "free again within a second");
    }

    #[test]
    fn removed_key_frames_take_their_ground_with_them() {
        let mut ground = GroundMap::new(GroundConfig::default());
        let here = Se2::from_xy_angle(0.02, 0.03, 0.0);
        ground.stand(1, &Se2::identity(), here, 0.3).unwrap();
        ground.observe(0.0, 0, &Se2::identity(), here, &scan(&here, None)).unwrap();
        assert_eq!(value(&ground, here.translation), 0);
        // The scan goes; the step, which lies elsewhere now, stays.
        let to = Se2::from_xy_angle(1.0, 0.0, 0.0);
        ground.set_poses(|key| (key == 1).then_some(to)).unwrap();
        let map = ground.map().unwrap();
        let free = map.values().iter().filter(|v| **v == 0).count();
        assert!((90..200).contains(&free), "{free} cells of the disc on which the body stood");
        assert_eq!(value(&ground, to * here.translation), 0);
        ground.set_poses(|_| None).unwrap();
        assert!(ground.map().is_none() && ground.costs().is_none() && ground.local().is_none());
    }

    #[test]
    fn what_came_to_stand_can_be_forgotten_and_is_found_again() {
        let mut ground = GroundMap::new(GroundConfig::default());
        let here = Se2::from_xy_angle(0.02, 0.03, 0.0);
        let mut time_s = 0.0;
        let mut look = |ground: &mut GroundMap<u32>, disc: Option<Vec2>, steps: usize| {
            for _ in 0..steps {
                time_s += 0.1;
                ground.observe(time_s, 0, &Se2::identity(), here, &scan(&here, disc)).unwrap();
            }
        };
        let (box_at, seen_side, wall) = (Vec2::new(1.5, 0.0), Vec2::new(1.31, 0.0), Vec2::new(-2.99, 0.5));
        look(&mut ground, None, 10);
        assert!(!ground.forget_new().unwrap(), "nothing came");
        assert_eq!(ground.nearest_new(here.translation), None);
        look(&mut ground, Some(box_at), 5);
        assert!((ground.nearest_new(here.translation).unwrap() - box_at).norm() < 0.2, "not settled yet");
        look(&mut ground, Some(box_at), 30);
        assert_eq!(value(&ground, seen_side), 100);
        assert!((ground.nearest_new(here.translation).unwrap() - box_at).norm() < 0.3);
        assert!(ground.forget_new().unwrap());
        assert_eq!((value(&ground, seen_side), value(&ground, wall)), (0, 100), "the wall was always there");
        assert!(!ground.forget_new().unwrap(), "once");
        look(&mut ground, Some(box_at), 35);
        assert_eq!(value(&ground, seen_side), 100, "it is still there");
    }
}
