//! Giving way: two who stand before each other in a door or a corridor both wait for ever. The robot drives to a place beside the
//! line on which it met the other, where nobody was seen to walk, and waits there until the other has passed.
//!
//! In: where the robot may drive, where it is, where the other stands, and where others walked. Out: the place, if there is one; and
//! whether someone is still on the robot's way, or went out of sight on it: into a dead end, from which he comes back.

use crate::costmap::{DynamicLayer, Track};
use crate::frontier::drive_lengths;
use crate::grid::Cell;
use crate::passable::Passable;
use crate::search::STRAIGHT;
use cairn_geometry::Vec2;
use std::collections::{BTreeMap, BTreeSet};

/// How far the robot goes out of the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GiveWayConfig {
    /// Distance beside the line from the other through the robot, and beside trails, in metres.
    pub beside_m: f64,
    /// Distance from the other, in metres.
    pub away_m: f64,
    /// The robot's centre keeps this far from the other on its way, in metres, or comes no nearer than it is.
    pub keep_m: f64,
    /// Longest drive, in metres.
    pub drive_m: f64,
}

impl Default for GiveWayConfig {
    fn default() -> Self {
        Self { beside_m: 1.0, away_m: 1.3, keep_m: 0.8, drive_m: 6.0 }
    }
}

/// Where people, or whatever moves, have been seen to walk.
#[derive(Clone, Debug, Default)]
pub struct Trails {
    cells: BTreeSet<[i32; 2]>,
}

/// Side of a cell of the trails, in metres.
const TRAIL_M: f64 = 0.25;
/// What is slower than this may be a mistake of the tracking, in m/s.
const WALKS: f64 = 0.3;
/// Detections until a track is trusted.
const TRUSTED: u32 = 5;

impl Trails {
    /// Takes what moves now.
    pub fn learn(&mut self, moving: &DynamicLayer) {
        let walking = |t: &&Track| t.seen >= TRUSTED && t.velocity.norm() > WALKS;
        self.cells.extend(moving.tracks().iter().filter(walking).map(|t| trail_cell(t.position)));
    }

    /// Whether a trail passes within a distance of a place.
    fn is_near(&self, at: Vec2, within_m: f64) -> bool {
        let reach = (within_m / TRAIL_M).ceil() as i32;
        let [x, y] = trail_cell(at);
        let centre = |c: &[i32; 2]| Vec2::new(f64::from(c[0]) + 0.5, f64::from(c[1]) + 0.5) * TRAIL_M;
        let mut columns = self.cells.range([x - reach, i32::MIN]..=[x + reach, i32::MAX]);
        columns.any(|c| (c[1] - y).abs() <= reach && (centre(c) - at).norm() < within_m)
    }
}

fn trail_cell(at: Vec2) -> [i32; 2] {
    [at.x, at.y].map(|v| (v / TRAIL_M).floor() as i32)
}

/// Who went out of sight is remembered for this time, in seconds.
const REMEMBERED_S: f64 = 20.0;
/// Whoever is seen anew so soon, in seconds, and no farther than so many metres a second from there, is one who went out of sight.
const SEEN_AGAIN_S: f64 = 3.0;
const COMES: f64 = 1.0;

/// Where those who walk about were last seen.
#[derive(Clone, Debug, Default)]
pub struct LastSeen {
    /// Place and time (metres, seconds) by track.
    walkers: BTreeMap<u64, (Vec2, f64)>,
}

impl LastSeen {
    /// Takes what moves now, at a time in seconds.
    pub fn learn(&mut self, time_s: f64, moving: &DynamicLayer) {
        for track in moving.tracks().iter().filter(|t| t.seen >= TRUSTED) {
            let is_new = self.walkers.insert(track.id, (track.position, track.last_seen_s)).is_none();
            if is_new {
                let is_he = |(at, gone_s): &(Vec2, f64)| {
                    let away_s = track.last_seen_s - gone_s;
                    away_s < SEEN_AGAIN_S && (at - track.position).norm() <= COMES * away_s
                };
                self.walkers.retain(|id, last| *id >= track.id || !is_he(last));
            }
        }
        self.walkers.retain(|_, (_, seen_s)| time_s - *seen_s <= REMEMBERED_S);
    }

    /// The place on a way (points in metres) near which somebody is, or went out of sight.
    pub fn on_the_way(&self, way: &[Vec2], within_m: f64) -> Option<Vec2> {
        way.iter().copied().find(|p| self.walkers.values().any(|(at, _)| (at - p).norm() < within_m))
    }
}

/// The place with the shortest drive that is far enough beside the line on which robot and other met, and beside all trails; where
/// there is none within the longest drive, beside the line alone; `None` where there is not even that.
pub fn place_beside(
    passable: &Passable,
    from: Cell,
    other: Vec2,
    trails: &Trails,
    config: &GiveWayConfig,
) -> Option<Vec2> {
    let frame = *passable.frame();
    let to_robot = frame.centre(from) - other;
    let line = to_robot.try_normalize(1e-9)?;
    let keep_m = config.keep_m.min(to_robot.norm() - frame.resolution_m());
    let drives = drive_lengths(&kept_off(passable, other, keep_m), from);
    let longest = config.drive_m / frame.resolution_m() * STRAIGHT as f64;
    let near = drives.iter().enumerate().filter(|(_, length)| (**length as f64) <= longest);
    let is_beside = |at: Vec2| {
        let off = at - other;
        // Never past the other.
        line.dot(&off) >= 0.0 && off.norm() >= config.away_m && line.perp(&off).abs() >= config.beside_m
    };
    let mut places: Vec<(u64, Vec2)> = near
        .map(|(i, length)| (*length, frame.centre(frame.cell(i))))
        .filter(|(_, at)| is_beside(*at))
        .collect();
    places.sort_by_key(|(length, _)| *length);
    let quiet = places.iter().find(|(_, at)| !trails.is_near(*at, config.beside_m));
    quiet.or(places.first()).map(|(_, at)| *at)
}

/// The cells that may be entered without coming near to the other.
fn kept_off(passable: &Passable, other: Vec2, keep_m: f64) -> Passable {
    let frame = *passable.frame();
    let mut around = passable.clone();
    let reach = (keep_m / frame.resolution_m()).ceil() as i64;
    let middle = frame.in_cells(other).map(|v| v.floor() as i64);
    for (dx, dy) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))) {
        let [x, y] = [middle.x + dx, middle.y + dy].map(u32::try_from);
        if let (Ok(x), Ok(y)) = (x, y)
            && (frame.centre(Cell::new(x, y)) - other).norm() < keep_m
        {
            around.set(Cell::new(x, y), false);
        }
    }
    around
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::costmap::{Detection, DynamicConfig};
    use crate::grid::{Grid, GridFrame};
    use cairn_geometry::Se2;

    /// A corridor of 8 x 1 m along x; a door of 1 m at `door_x` leads up into a niche of 2 x 2 m.
    fn corridor(door_x: Option<f64>) -> Passable {
        let frame = GridFrame::new(80, 40, 0.1, Se2::identity()).unwrap();
        let mut free = Grid::filled(frame, false);
        for index in 0..frame.len() {
            let at = frame.centre(frame.cell(index));
            let in_door = door_x.is_some_and(|x| (at.x - x).abs() < 0.5 && at.y > 0.9 && at.y < 1.5);
            let in_niche = door_x.is_some_and(|x| (at.x - x).abs() < 1.0 && at.y > 1.4 && at.y < 3.4);
            if (at.y < 1.0 && at.y > 0.0) || in_door || in_niche {
                free.set(frame.cell(index), true);
            }
        }
        Passable::new(&free)
    }

    #[test]
    fn the_robot_leaves_a_corridor_for_a_door_on_its_own_side_of_the_other() {
        let (config, none) = (GiveWayConfig::default(), Trails::default());
        let passable = corridor(Some(5.0));
        let from = passable.frame().cell_at(Vec2::new(3.05, 0.55)).unwrap();
        let other = Vec2::new(2.0, 0.55);
        let at = place_beside(&passable, from, other, &none, &config).unwrap();
        assert!(at.y >= 1.5 && (at.x - 5.0).abs() < 1.0, "{at}");
        // The same door behind the other is not reached: he stands in the way.
        let behind = Vec2::new(3.9, 0.5);
        assert_eq!(place_beside(&passable, from, behind, &none, &config), None);
    }

    #[test]
    fn before_a_door_the_robot_goes_aside_along_the_wall_and_a_mere_corridor_has_no_place() {
        let (config, none) = (GiveWayConfig::default(), Trails::default());
        let passable = corridor(Some(4.0));
        let from = passable.frame().cell_at(Vec2::new(4.05, 0.55)).unwrap();
        let at = place_beside(&passable, from, Vec2::new(4.0, 1.5), &none, &config).unwrap();
        assert!((at.x - 4.0).abs() >= 0.9 && at.y < 1.0, "{at}");
        assert_eq!(place_beside(&corridor(None), from, Vec2::new(5.2, 0.55), &none, &config), None);
        assert_eq!(
            place_beside(&passable, from, Vec2::new(4.05, 0.55), &none, &config),
            None,
            "at the same place"
        );
        let far = GiveWayConfig { drive_m: 0.5, ..config };
        assert_eq!(place_beside(&passable, from, Vec2::new(4.0, 1.5), &none, &far), None);
    }

    #[test]
    fn who_went_out_of_sight_on_the_way_is_waited_for_until_he_is_seen_elsewhere_or_forgotten() {
        let walk = |y: f64, back: bool| {
            let (mut moving, mut last) = (DynamicLayer::new(DynamicConfig::default()), LastSeen::default());
            let seen = |position| [Detection { position, radius_m: 0.25 }];
            for k in 0..20 {
                moving.observe(0.1 * f64::from(k), &seen(Vec2::new(0.07 * f64::from(k), y)));
                last.learn(0.1 * f64::from(k), &moving);
            }
            // Out of sight for 2 s; then he, or somebody who cannot be he, walks beside the way.
            for k in 20..60 {
                let at = Vec2::new(if back { 1.4 } else { 9.0 }, 1.4 + 0.05 * f64::from(k - 40));
                let detections: Vec<Detection> = seen(at).into_iter().filter(|_| k >= 40).collect();
                moving.observe(0.1 * f64::from(k), &detections);
                last.learn(0.1 * f64::from(k), &moving);
            }
            (moving, last)
        };
        let way: Vec<Vec2> = (0..40).map(|k| Vec2::new(0.1 * f64::from(k), 0.0)).collect();
        let (moving, mut last) = walk(0.3, false);
        let at = last.on_the_way(&way, 0.8).expect("he went out of sight on it");
        assert!(at.x > 0.4 && at.x < 1.4, "{at}");
        assert_eq!(last.on_the_way(&way[..3], 0.8), None, "on another part of it");
        last.learn(23.0, &moving);
        assert_eq!(last.on_the_way(&way, 0.8), None, "forgotten");
        assert_eq!(walk(1.5, false).1.on_the_way(&way, 0.8), None, "beside it");
        assert_eq!(walk(0.3, true).1.on_the_way(&way, 0.8), None, "seen elsewhere");
    }

    #[test]
    fn the_robot_waits_where_nobody_walks() {
        let config = GiveWayConfig::default();
        let passable = corridor(Some(4.0));
        let from = passable.frame().cell_at(Vec2::new(4.05, 0.55)).unwrap();
        let other = Vec2::new(4.0, 1.5);
        let right = place_beside(&passable, from, other, &Trails::default(), &config).unwrap().x > 4.0;
        // Somebody walks along that half of the corridor.
        let (mut moving, mut trails) = (DynamicLayer::new(DynamicConfig::default()), Trails::default());
        for k in 0..60 {
            let along = 0.06 * f64::from(k);
            let position = Vec2::new(if right { 4.2 + along } else { 3.8 - along }, 0.5);
            moving.observe(0.1 * f64::from(k), &[Detection { position, radius_m: 0.25 }]);
            trails.learn(&moving);
        }
        assert!(trails.is_near(Vec2::new(if right { 6.0 } else { 2.0 }, 0.5), 0.3));
        let at = place_beside(&passable, from, other, &trails, &config).unwrap();
        assert!((at.x - 4.0).abs() >= 0.9 && (at.x > 4.0) != right && at.y < 1.0, "{at}");
    }
}
