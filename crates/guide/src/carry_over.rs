//! Points of a route that were recorded in a map whose place and unit of length are not known, placed beside the points that are.

use crate::anchor::Anchor;
use crate::route::{Route, RoutePoint, Stretch};
use cairn_geometry::Se3;

impl Route {
    /// Places every point whose key frame is not known relative to the known point after its run (at the end of the route: before
    /// it), as the walker moved within the run, but no faster than he walks where points are known: the unit of the run may be any.
    /// Across a gap he counts as standing. Returns how many; none where no point is known. Notes among them move to the nearest known
    /// point in time. `unit` is the length of a known key frame's unit in that of the recorded poses.
    ///
    /// [`Route::reanchor`] is for points whose key frame is gone, but whose recorded pose holds.
    pub fn carry_over(&mut self, unit: impl Fn(Anchor) -> Option<f64>) -> usize {
        let recorded = self.points.clone();
        let mut units: Vec<Option<f64>> = recorded.iter().map(|p| unit(p.anchor)).collect();
        let is_known: Vec<bool> = units.iter().map(Option::is_some).collect();
        if !is_known.contains(&true) {
            return 0;
        }
        self.move_notes(&recorded, &is_known);
        let most = usual_speed(&recorded, &is_known);
        let mut end = 0;
        while let Some(begin) = (end..recorded.len()).find(|k| !is_known[*k]) {
            end = (begin..recorded.len()).find(|k| is_known[*k]).unwrap_or(recorded.len());
            let speed = mean_speed(&recorded[begin..end]);
            let share = if speed > most { most / speed } else { 1.0 };
            // One by one, away from the known point.
            let from_end = end < recorded.len();
            for step in 0..end - begin {
                let (near, k) =
                    if from_end { (end - step, end - step - 1) } else { (begin + step - 1, begin + step) };
                units[k] = units[near];
                self.carry(near, k, &motion(&recorded, near, k, share), units[near].unwrap_or(1.0));
            }
        }
        is_known.iter().filter(|known| !**known).count()
    }

    /// Places a point relative to its neighbour, which is placed.
    fn carry(&mut self, near: usize, k: usize, near_from_here: &Se3, unit: f64) {
        let placed = self.points[near];
        let p = &mut self.points[k];
        p.anchor = placed.anchor;
        p.anchor_from_camera = placed.beside(near_from_here, unit);
        p.odom_from_camera = placed.odom_from_camera * *near_from_here;
    }

    fn move_notes(&mut self, recorded: &[RoutePoint], is_known: &[bool]) {
        let known = || recorded.iter().zip(is_known).filter(|(_, known)| **known).map(|(p, _)| p);
        let strays = |anchor: Anchor| {
            let mut of_it = recorded.iter().zip(is_known).filter(|(p, _)| p.anchor == anchor);
            of_it.next().is_some_and(|(_, known)| !known)
        };
        for note in self.notes.iter_mut().filter(|note| strays(note.anchor)) {
            if let Some(near) = known().min_by_key(|p| p.stamp.0.abs_diff(note.stamp.0)) {
                (note.anchor, note.anchor_from_camera) = (near.anchor, near.anchor_from_camera);
                note.odom_from_camera = near.odom_from_camera;
            }
        }
    }
}

/// The motion from one point to its neighbour in the first one's camera, with a share of its length; none across a gap.
fn motion(recorded: &[RoutePoint], near: usize, k: usize, share: f64) -> Se3 {
    if recorded[near.max(k)].stretch == Stretch::Gap {
        return Se3::identity();
    }
    let moved = recorded[near].odom_from_camera.inverse() * recorded[k].odom_from_camera;
    Se3::new(moved.rotation, moved.translation * share)
}

/// Metres a second over the tracked stretches of these points; 0 without any.
fn mean_speed(points: &[RoutePoint]) -> f64 {
    let [metres, seconds] =
        tracked(points).fold([0.0; 2], |[m, s], [metres, seconds]| [m + metres, s + seconds]);
    if seconds > 0.0 { metres / seconds } else { 0.0 }
}

/// The median speed where points are known, m/s; 0 where none follow each other.
fn usual_speed(recorded: &[RoutePoint], is_known: &[bool]) -> f64 {
    let pairs = recorded.windows(2).zip(is_known.windows(2)).filter(|(_, known)| known[0] && known[1]);
    let mut speeds: Vec<f64> =
        pairs.flat_map(|(pair, _)| tracked(pair)).map(|[metres, seconds]| metres / seconds).collect();
    speeds.sort_by(f64::total_cmp);
    speeds.get(speeds.len() / 2).copied().unwrap_or(0.0)
}

/// Lengths and seconds of the tracked steps between these points.
fn tracked(points: &[RoutePoint]) -> impl Iterator<Item = [f64; 2]> {
    points.windows(2).filter(|pair| pair[1].stretch == Stretch::Tracked && pair[1].stamp > pair[0].stamp).map(
        |pair| {
            let moved = pair[0].odom_from_camera.inverse() * pair[1].odom_from_camera;
            [moved.translation.norm(), pair[1].stamp - pair[0].stamp]
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::Ground;
    use crate::notes::RouteNote;
    use crate::route::RouteHeader;
    use cairn_geometry::{Sim3, So3, Vec3};
    use cairn_sensor::Stamp;

    /// Key frames from here on are of a map that is known.
    const KNOWN: u32 = 10;

    /// Ten points a second along x at 0.8 m/s; `stray` of them in a map turned by a right angle whose unit is 1/8 m, before or after
    /// the others.
    fn route(stray: std::ops::Range<u32>) -> Route {
        let mut route = Route::new(RouteHeader::new(true, &Ground::z_up(), "test"));
        let other = Sim3::new(So3::exp(&Vec3::new(0.0, 0.0, 1.57)), Vec3::new(3.0, -40.0, 0.2), 8.0);
        let mut before = None;
        for k in 0..40u32 {
            let strays = stray.contains(&k);
            let true_pose = Se3::new(So3::identity(), Vec3::new(0.08 * f64::from(k), 0.0, 0.0));
            let pose = if strays { other.transform_pose(&true_pose) } else { true_pose };
            let changed = before.is_some_and(|before| before != strays);
            before = Some(strays);
            route.points.push(RoutePoint {
                stamp: Stamp(i64::from(k) * 100_000_000),
                anchor: Anchor { robot: 0, seq: if strays { 0 } else { KNOWN + k / 5 } },
                anchor_from_camera: Se3::new(pose.rotation, pose.translation * 2.0),
                odom_from_camera: pose,
                stretch: if changed { Stretch::Gap } else { Stretch::Tracked },
                quality: 1.0,
            });
        }
        route
    }

    /// Key frames that are known have a unit of half a metre.
    fn known(anchor: Anchor) -> Option<f64> {
        (anchor.seq >= KNOWN).then_some(0.5)
    }

    fn off(route: &Route) -> f64 {
        let at = |(k, p): (usize, &RoutePoint)| {
            let truth = Vec3::x() * 0.08 * k as f64;
            let by_anchor = 0.5 * p.anchor_from_camera.translation;
            (p.odom_from_camera.translation - truth).norm().max((by_anchor - truth).norm())
        };
        route.points.iter().enumerate().map(at).fold(0.0, f64::max)
    }

    #[test]
    fn points_of_another_map_are_where_the_walker_went_but_for_the_steps_across_gaps() {
        for (stray, gaps) in [(0..8, 1.0), (30..40, 1.0), (12..20, 1.0)] {
            let mut route = route(stray.clone());
            assert!(off(&route) > 10.0);
            let before = route.clone();
            assert_eq!(route.carry_over(known), stray.len(), "{stray:?}");
            assert!(off(&route) < 0.08 * gaps + 1e-6, "{stray:?}: {} m off", off(&route));
            for (k, (p, was)) in route.points.iter().zip(&before.points).enumerate() {
                assert!(p.anchor.seq >= KNOWN && p.stamp == was.stamp && p.stretch == was.stretch);
                assert!(stray.contains(&(k as u32)) || p == was, "{k} was known");
            }
            assert_eq!(route.carry_over(known), 0);
        }
    }

    #[test]
    fn who_stood_stays_and_nothing_moves_where_no_point_is_known() {
        let mut standing = route(0..8);
        for k in 0..8 {
            standing.points[k].odom_from_camera = standing.points[0].odom_from_camera;
        }
        standing.carry_over(known);
        let at = |k: usize| standing.points[k].odom_from_camera.translation;
        assert!((at(0) - at(8)).norm() < 1e-9);
        let mut nowhere = route(0..8);
        assert_eq!(nowhere.carry_over(|_| None), 0);
        assert_eq!(nowhere, route(0..8));
    }

    #[test]
    fn note_moves_to_the_nearest_point_that_is_known() {
        let mut route = route(0..8);
        let note = |p: &RoutePoint| RouteNote {
            text: "door".into(),
            side: None,
            stamp: p.stamp,
            anchor: p.anchor,
            anchor_from_camera: p.anchor_from_camera,
            odom_from_camera: p.odom_from_camera,
        };
        route.notes = vec![note(&route.points[3]), note(&route.points[20])];
        let kept = route.notes[1].clone();
        route.carry_over(known);
        assert_eq!(route.notes[0].anchor, route.points[8].anchor);
        assert!((route.notes[0].odom_from_camera.translation - Vec3::x() * 0.64).norm() < 1e-9);
        assert_eq!(route.notes[1], kept);
    }
}
