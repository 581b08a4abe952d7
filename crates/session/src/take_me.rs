//! "Take me to ...": a route over ways walked before, planned through all recorded routes of a map.
//!
//! In: a snapshot and recorded routes. The routes are resolved in the map; where they meet within reach they are joined
//! ([`cairn_plan::walked`]), and the shortest way over them from here to a destination becomes a [`Route`] of its own,
//! which the guide speaks like any other, from its start to its end ([`Travel::Again`](cairn_guide::Travel::Again)).
//! Nothing leads over ground that nobody walked, through a gap of a recording, or from one map of the atlas into another
//! that is not merged with it.

use crate::reference_path::{anchor_in_map, ground_of};
use cairn_atlas::{KeyFrameId, MapId, Snapshot};
use cairn_geometry::{Se3, Vec2, Vec3};
use cairn_guide::{Ground, PlacedPoint, Route, RouteHeader, RoutePoint, Stretch};
use cairn_plan::walked::{NotWalked, Passed, WalkedConfig, WalkedGraph, WalkedPath};
use cairn_sensor::Stamp;
use std::f64::consts::PI;

/// Walking speed over a joint of two routes, m/s: it only spaces the stamps there.
const SPEED: f64 = 0.8;

/// A place that one can be taken to.
#[derive(Clone, Debug, PartialEq)]
pub struct Destination {
    /// What it is called: the name of a route with "start" or "end".
    pub name: String,
    /// Where it is, in the frame and unit of its map.
    pub at: Vec3,
    /// Its map.
    pub map: MapId,
}

/// Why there is no way.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoWay {
    /// No destination has this name.
    #[error("no place is called \"{0}\"")]
    Unknown(String),
    /// More than one destination has this name.
    #[error("more than one place is called \"{0}\"")]
    Ambiguous(String),
    /// Start and goal are in two maps of the atlas that are not merged.
    #[error("the way there is not known: it is in another map, which no walk has joined to this one yet")]
    OtherMap,
    /// The recorded routes do not lead there.
    #[error(transparent)]
    NotWalked(#[from] NotWalked),
}

/// A planned way.
#[derive(Clone, Debug)]
pub struct Planned {
    /// To be followed from its start to its end.
    pub route: Route,
    /// The way through the graph: its stretches, and points in metres with z up.
    pub path: WalkedPath,
    /// The destination.
    pub to: Destination,
}

/// A recorded route, resolved in the map.
struct Resolved<'a> {
    name: String,
    route: &'a Route,
    points: Vec<PlacedPoint>,
    /// The map of each point; `None` where its key frame is gone.
    maps: Vec<Option<MapId>>,
}

/// All recorded routes of a snapshot.
pub struct WalkedRoutes<'a> {
    routes: Vec<Resolved<'a>>,
    /// Metres per unit of the map.
    metres_per_unit: f64,
    ground: Ground,
}

impl<'a> WalkedRoutes<'a> {
    /// Resolves routes with their names in a snapshot.
    pub fn new(map: &Snapshot, routes: impl IntoIterator<Item = (String, &'a Route)>) -> Self {
        let resolved: Vec<Resolved> =
            routes.into_iter().map(|(name, route)| Resolved::new(map, name, route)).collect();
        let first = resolved.first();
        let metres_per_unit = first.map_or(1.0, |r| r.route.metres_per_unit(&r.points));
        let ground = first.map_or_else(Ground::z_up, |r| ground_of(map, r.route, &r.points));
        Self { routes: resolved, metres_per_unit, ground }
    }

    /// The start and the end of every route, in the order of the routes.
    pub fn destinations(&self) -> Vec<Destination> {
        (0..self.routes.len()).flat_map(|k| self.ends(k)).flatten().collect()
    }

    /// The start and the end of the route with this index; `None` where it has no place in the map.
    pub fn ends(&self, route: usize) -> [Option<Destination>; 2] {
        let Some(r) = self.routes.get(route) else { return [None, None] };
        let end = |what: &str, k: usize| {
            let (point, map) = (r.points.get(k)?, (*r.maps.get(k)?)?);
            let name = format!("{} {what}", r.name);
            Some(Destination { name, at: point.frame_from_camera.translation, map })
        };
        [end("start", 0), end("end", r.points.len().wrapping_sub(1))]
    }

    /// The destination of a name, in any case; the name of a route alone is its end.
    ///
    /// # Errors
    /// When no destination has this name, or several have.
    pub fn destination(&self, name: &str) -> Result<Destination, NoWay> {
        let wanted = name.trim().to_lowercase();
        let all = self.destinations();
        let called = |name: &str| -> Vec<&Destination> {
            all.iter().filter(|d| d.name.to_lowercase() == name).collect()
        };
        let mut found = called(&wanted);
        if found.is_empty() {
            found = called(&format!("{wanted} end"));
        }
        match found[..] {
            [one] => Ok(one.clone()),
            [] => Err(NoWay::Unknown(name.to_owned())),
            _ => Err(NoWay::Ambiguous(name.to_owned())),
        }
    }

    /// The recorded point nearest to a place seen from above, in metres: a destination without a name.
    ///
    /// # Errors
    /// When no route comes within reach of it ([`WalkedConfig::reach_m`]).
    pub fn near(&self, at: Vec2) -> Result<Destination, NoWay> {
        let points = self.routes.iter().flat_map(|r| r.points.iter().zip(&r.maps));
        let away = |p: &PlacedPoint| (self.in_metres(&p.frame_from_camera.translation).xy() - at).norm();
        let known = points.filter_map(|(p, map)| Some((away(p), p, (*map)?)));
        let nearest = known.filter(|n| n.0.is_finite()).min_by(|a, b| a.0.total_cmp(&b.0));
        let (distance_m, point, map) = nearest.ok_or(NotWalked::NoRoute)?;
        if distance_m > WalkedConfig::default().reach_m {
            return Err(
                NotWalked::FarFromRoutes { place: cairn_plan::search::Place::Goal, distance_m }.into()
            );
        }
        let name = format!("{:.1},{:.1}", at.x, at.y);
        Ok(Destination { name, at: point.frame_from_camera.translation, map })
    }

    /// The routes in a map as lines in metres, z up, with their names; a point that is not finite interrupts a line.
    pub fn lines(&self, map: MapId) -> Vec<(String, Vec<Vec3>)> {
        self.routes.iter().map(|r| (r.name.clone(), self.line(r, map))).collect()
    }

    /// The shortest way over walked ground from a place in the map (in its frame and unit) to a destination.
    ///
    /// # Errors
    /// When the two are in different maps, far from all routes, or the routes do not meet.
    pub fn take_me(&self, map: MapId, from: Vec3, to: &Destination) -> Result<Planned, NoWay> {
        if map != to.map {
            return Err(NoWay::OtherMap);
        }
        let lines: Vec<Vec<Vec3>> = self.routes.iter().map(|r| self.line(r, map)).collect();
        let graph = WalkedGraph::new(&lines, WalkedConfig::default());
        let path = graph.path(self.in_metres(&from), self.in_metres(&to.at))?;
        Ok(Planned { route: self.route(&path, &to.name), path, to: to.clone() })
    }

    /// A point of the map in metres, z up.
    fn in_metres(&self, p: &Vec3) -> Vec3 {
        let plane = self.ground.plane(p) * self.metres_per_unit;
        Vec3::new(plane.x, plane.y, self.ground.height(p) * self.metres_per_unit)
    }

    /// The points of a route in metres; not finite where it is in another map or where a gap begins.
    fn line(&self, r: &Resolved, map: MapId) -> Vec<Vec3> {
        let point = |(p, in_map): (&PlacedPoint, &Option<MapId>)| match *in_map == Some(map) {
            true => self.in_metres(&p.frame_from_camera.translation),
            false => Vec3::repeat(f64::NAN),
        };
        let mut line: Vec<Vec3> = r.points.iter().zip(&r.maps).map(point).collect();
        // A gap has no points of its own: the point before it is given up, so that nothing leads across.
        for k in 1..r.points.len() {
            if r.points[k].stretch == Stretch::Gap {
                line[k - 1] = Vec3::repeat(f64::NAN);
            }
        }
        line
    }

    /// The path as a route: the recorded points that it passes, facing the way they are walked.
    fn route(&self, path: &WalkedPath, to: &str) -> Route {
        let metric = self.routes.iter().all(|r| r.route.header.metric);
        let mut route = Route::new(RouteHeader::new(metric, &self.ground, format!("to {to}")));
        let mut before: Option<(Passed, Vec3)> = None;
        let mut stamp = Stamp(0);
        for &passed in &path.passed {
            let r = &self.routes[passed.route];
            let (Some(point), Some(placed)) = (r.route.points.get(passed.point), r.points.get(passed.point))
            else {
                continue;
            };
            let at = placed.frame_from_camera.translation;
            if let Some((last, last_at)) = before {
                let recorded = r.route.points.get(last.point).filter(|_| last.route == passed.route);
                let took_s = recorded.map_or((at - last_at).norm() * self.metres_per_unit / SPEED, |p| {
                    (point.stamp - p.stamp).abs()
                });
                stamp = stamp.plus_seconds(took_s);
            }
            let turn =
                if passed.backwards { self.turned_round(&placed.frame_from_camera) } else { Se3::identity() };
            route.points.push(RoutePoint {
                stamp,
                anchor_from_camera: point.anchor_from_camera * turn,
                odom_from_camera: placed.frame_from_camera * turn,
                stretch: if point.stretch == Stretch::Gap { Stretch::Tracked } else { point.stretch },
                ..*point
            });
            before = Some((passed, at));
        }
        route
    }

    /// The turn on the spot, in the camera's frame, of a walker who walks a stretch in the other direction.
    fn turned_round(&self, frame_from_camera: &Se3) -> Se3 {
        let up = frame_from_camera.rotation.inverse() * self.ground.up();
        Se3::new(cairn_geometry::So3::exp(&(up * PI)), Vec3::zeros())
    }
}

impl<'a> Resolved<'a> {
    fn new(map: &Snapshot, name: String, route: &'a Route) -> Self {
        let points = route.resolve(|a| anchor_in_map(map, a));
        let map_of = |p: &RoutePoint| {
            let (id, _) = map.surviving_ancestor(KeyFrameId::from_index(p.anchor.seq as usize)?)?;
            Some(map.key_frame(id)?.map)
        };
        let maps = route.points.iter().map(map_of).collect();
        Self { name, route, points, maps }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{World, stereo};
    use cairn_atlas::Atlas;
    use cairn_guide::camera_pose;
    use cairn_guide::{Anchor, CleanConfig, ManeuverPlan, ManeuverPlanConfig, RouteConfig, Travel, clean};

    /// A map of a corridor along x, and routes along lines of places, anchored to its nearest key frames.
    fn corridor() -> (Atlas, Vec<KeyFrameId>, Vec<Se3>) {
        let path: Vec<Se3> = (0..=20).map(|k| camera_pose(f64::from(k), 0.0, 0.0, 0.0)).collect();
        let (atlas, ids) = World::around(stereo(), 5).exact_map(&path);
        (atlas, ids, path)
    }

    fn route(places: &[Vec2], ids: &[KeyFrameId], keys: &[Se3]) -> Route {
        let mut route = Route::new(RouteHeader::new(true, &Ground::z_up(), "test"));
        let steps = places.windows(2).flat_map(|w| {
            let n = ((w[1] - w[0]).norm() / 0.1).round() as usize;
            let heading = (w[1] - w[0]).y.atan2((w[1] - w[0]).x);
            let (a, by) = (w[0], (w[1] - w[0]) / n as f64);
            (0..n).map(move |k| (a + by * k as f64, heading))
        });
        for (k, (at, heading)) in steps.enumerate() {
            let camera = camera_pose(at.x, at.y, heading, 0.0);
            let away = |i: &usize| (keys[*i].translation - camera.translation).norm();
            let near = (0..keys.len()).min_by(|a, b| away(a).total_cmp(&away(b))).unwrap();
            route.points.push(RoutePoint {
                stamp: Stamp::from_seconds(0.1 * k as f64),
                anchor: Anchor { robot: 0, seq: ids[near].index() as u32 },
                anchor_from_camera: keys[near].inverse() * camera,
                odom_from_camera: camera,
                stretch: Stretch::Tracked,
                quality: 1.0,
            });
        }
        route
    }

    fn v(x: f64, y: f64) -> Vec2 {
        Vec2::new(x, y)
    }

    #[test]
    fn a_way_over_two_routes_is_spoken_like_one() {
        let (atlas, ids, keys) = corridor();
        let map = atlas.latest();
        // Along the corridor; and, recorded towards it, a branch that meets it at x = 12.
        let along = route(&[v(0.0, 0.0), v(20.0, 0.0)], &ids, &keys);
        let branch = route(&[v(12.0, 9.0), v(12.0, 0.4)], &ids, &keys);
        let routes = [("corridor".to_owned(), &along), ("Kitchen".to_owned(), &branch)];
        let walked = WalkedRoutes::new(map, routes);
        let names: Vec<String> = walked.destinations().into_iter().map(|d| d.name).collect();
        assert_eq!(names, ["corridor start", "corridor end", "Kitchen start", "Kitchen end"]);
        let to = walked.destination("kitchen START").unwrap();
        let planned = walked.take_me(to.map, Vec3::new(2.0, 0.3, 1.3), &to).unwrap();
        let backwards: Vec<(usize, bool)> =
            planned.path.stretches.iter().map(|s| (s.route, s.backwards)).collect();
        assert_eq!(backwards, [(0, false), (1, true)]);
        assert!((planned.path.length_m - 19.0).abs() < 0.6, "{} m", planned.path.length_m);

        // The planned route follows the map, and is spoken: one turn to the left on the way out.
        let reference =
            crate::ReferencePath::in_map(map, &planned.route, Travel::Again, &RouteConfig::default());
        let plan = reference.plan().unwrap();
        let turns: Vec<f64> =
            plan.maneuvers().iter().map(|m| m.turn_rad.to_degrees()).filter(|d| d.abs() > 20.0).collect();
        assert!(matches!(turns[..], [left] if (left - 90.0).abs() < 15.0), "{turns:?}");
        assert!((plan.length() - 18.5).abs() < 1.0, "{} m", plan.length());
        assert!(planned.route.points.windows(2).all(|w| w[0].stamp < w[1].stamp));

        // On the branch, which was recorded the other way, the walker faces away from the corridor.
        let last = planned.route.points.last().unwrap();
        let heading = Ground::z_up().heading(&last.odom_from_camera).unwrap();
        assert!((heading - std::f64::consts::FRAC_PI_2).abs() < 0.01, "{heading}");
        let anchored = planned.route.resolve(|a| anchor_in_map(map, a));
        let off = anchored
            .iter()
            .zip(&planned.route.points)
            .map(|(a, p)| (a.frame_from_camera.translation - p.odom_from_camera.translation).norm());
        assert!(off.fold(0.0, f64::max) < 1e-9);
        let cleaned = clean(&anchored, 1.0, &Ground::z_up(), &CleanConfig::default());
        let again = ManeuverPlan::from_route(
            &cleaned,
            Travel::Again,
            &Ground::z_up(),
            &ManeuverPlanConfig::default(),
        );
        assert!(again.is_ok());
    }

    #[test]
    fn where_no_way_is_known_the_reason_is_told() {
        let (atlas, ids, keys) = corridor();
        let map = atlas.latest();
        let mut along = route(&[v(0.0, 0.0), v(20.0, 0.0)], &ids, &keys);
        let far = route(&[v(12.0, 30.0), v(12.0, 5.0)], &ids, &keys);
        let all = |along: &Route| -> Result<Planned, NoWay> {
            let routes = [("a".to_owned(), along), ("b".to_owned(), &far), ("a".to_owned(), along)];
            let walked = WalkedRoutes::new(map, routes.iter().map(|(n, r)| (n.clone(), *r)).take(2));
            let to = walked.destination("a")?;
            walked.take_me(to.map, Vec3::zeros(), &to)
        };
        assert!(all(&along).is_ok());
        let walked = WalkedRoutes::new(
            map,
            [("a".to_owned(), &along), ("b".to_owned(), &far), ("a".to_owned(), &far)],
        );
        assert_eq!(walked.destination("a start"), Err(NoWay::Ambiguous("a start".into())));
        assert_eq!(walked.destination("c"), Err(NoWay::Unknown("c".into())));
        let to = walked.destination("b").unwrap();
        let not_joined = walked.take_me(to.map, Vec3::zeros(), &to);
        assert!(matches!(not_joined, Err(NoWay::NotWalked(NotWalked::NotJoined { .. }))), "{not_joined:?}");
        let to_map = to.map;
        let elsewhere = Destination { map: MapId(KeyFrameId::from_index(7).unwrap()), ..to };
        assert!(matches!(walked.take_me(to_map, Vec3::zeros(), &elsewhere), Err(NoWay::OtherMap)));
        // Nothing leads through a gap of a recording.
        along.points.drain(100..120);
        along.points[100].stretch = Stretch::Gap;
        assert!(matches!(all(&along), Err(NoWay::NotWalked(NotWalked::NotJoined { .. }))));
    }
}
