//! "Take me to ...": the shortest route over ground that was walked before, through all recorded routes of a map.
//!
//! The recorded routes become one graph: each point is connected to the next one of its route, and to points of other
//! stretches that are near enough to step across. The graph never leads over ground that nobody walked. It is searched
//! by A* (Hart, Nilsson and Raphael 1968) with the straight-line distance as heuristic.

use crate::search::Place;
use cairn_geometry::Vec3;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// When two stretches are connected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WalkedConfig {
    /// Points of two stretches this near are connected, in metres, horizontally.
    pub join_m: f64,
    /// Their heights must not differ by more than this, in metres, so that floors stay separate.
    pub join_height_m: f64,
    /// Greatest spacing of points along a route, in metres.
    pub spacing_m: f64,
    /// Start and goal must be within this distance of a route, in metres.
    pub reach_m: f64,
}

impl Default for WalkedConfig {
    fn default() -> Self {
        Self { join_m: 0.7, join_height_m: 0.5, spacing_m: 0.5, reach_m: 2.0 }
    }
}

/// Why there is no route over walked ground.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NotWalked {
    /// No recorded route holds a point.
    #[error("no route was recorded")]
    NoRoute,
    /// A coordinate is NaN or infinite.
    #[error("the {0} is not a finite point")]
    NotFinite(Place),
    /// No recorded route comes near.
    #[error("the {place} is {distance_m:.1} m from the nearest route")]
    FarFromRoutes {
        /// Start or goal.
        place: Place,
        /// Distance to the nearest point of all routes, in metres.
        distance_m: f64,
    },
    /// The routes near the two ends are not connected.
    #[error("the routes near the goal do not meet those near the start ({expanded} points were reached)")]
    NotJoined {
        /// Points reached.
        expanded: usize,
    },
}

/// A part of a recorded route.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// Index of the recorded route.
    pub route: usize,
    /// Whether it is walked against the direction of recording.
    pub backwards: bool,
}

/// A recorded point that a path passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passed {
    /// Index of the recorded route.
    pub route: usize,
    /// Index of its point.
    pub point: usize,
    /// Whether the route is walked against the direction of recording here.
    pub backwards: bool,
}

/// A route over walked ground.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkedPath {
    /// Points in metres, world, from the start to the goal, both included.
    pub points: Vec<Vec3>,
    /// The recorded points that it passes, in order, none twice running.
    pub passed: Vec<Passed>,
    /// The stretches it follows, in order.
    pub stretches: Vec<Stretch>,
    /// Length in metres.
    pub length_m: f64,
    /// Points of routes expanded.
    pub expanded: usize,
}

/// All recorded routes as one graph.
#[derive(Clone, Debug)]
pub struct WalkedGraph {
    config: WalkedConfig,
    points: Vec<Vec3>,
    /// Route index of each point.
    routes: Vec<usize>,
    /// Distance along its route, for each point; after a gap it goes on far away.
    along_m: Vec<f64>,
    /// For each point, the nearest recorded one of its route.
    recorded: Vec<usize>,
    edges: Vec<Vec<u32>>,
}

impl WalkedGraph {
    /// From routes in metres, world, z up. A point that is not finite cuts its route in two: callers insert one where
    /// the ground in between is not known.
    pub fn new(routes: &[Vec<Vec3>], config: WalkedConfig) -> Self {
        let mut graph = Self {
            config,
            points: Vec::new(),
            routes: Vec::new(),
            recorded: Vec::new(),
            along_m: Vec::new(),
            edges: Vec::new(),
        };
        for (route, line) in routes.iter().enumerate() {
            let mut first = 0;
            for piece in line.split(|p| !p.iter().all(|v| v.is_finite())) {
                graph.add_piece(route, first, piece);
                first += piece.len() + 1;
            }
        }
        graph.join();
        graph
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether no route holds a point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Adds a piece of a route without gaps; `first` is the index of its first point in the route.
    fn add_piece(&mut self, route: usize, first: usize, piece: &[Vec3]) {
        let mut last: Option<usize> = None;
        let mut along_m = self.along_m.last().map_or(0.0, |along| along + 1e3);
        for (k, &to) in piece.iter().enumerate() {
            let from = if k == 0 { to } else { piece[k - 1] };
            let parts = ((to - from).norm() / self.config.spacing_m.max(0.05)).ceil().clamp(1.0, 1e5);
            for part in 1..=parts as usize {
                let here = self.points.len();
                self.points.push(from + (to - from) * (part as f64 / parts));
                self.routes.push(route);
                along_m += if k == 0 { 0.0 } else { (to - from).norm() / parts };
                self.along_m.push(along_m);
                self.recorded.push(first + if 2 * part >= parts as usize { k } else { k.saturating_sub(1) });
                self.edges.push(Vec::new());
                if let Some(last) = last {
                    self.edges[last].push(here as u32);
                    self.edges[here].push(last as u32);
                }
                last = Some(here);
            }
        }
    }

    /// Connects points of stretches that come near each other.
    fn join(&mut self) {
        let join_m = self.config.join_m.max(1e-3);
        let square = |p: &Vec3| ((p.x / join_m).floor() as i64, (p.y / join_m).floor() as i64);
        let mut squares: BTreeMap<(i64, i64), Vec<u32>> = BTreeMap::new();
        for (i, p) in self.points.iter().enumerate() {
            squares.entry(square(p)).or_default().push(i as u32);
        }
        for i in 0..self.points.len() {
            let p = self.points[i];
            let (x, y) = square(&p);
            let near = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
            for &j in near.filter_map(|s| squares.get(&s)).flatten() {
                let off = self.points[j as usize] - p;
                let meets = off.xy().norm() <= join_m && off.z.abs() <= self.config.join_height_m;
                // Near by on the same stretch one walks along it.
                let same = self.routes[i] == self.routes[j as usize]
                    && (self.along_m[i] - self.along_m[j as usize]).abs() < 3.0 * join_m;
                if meets && !same && !self.edges[i].contains(&j) {
                    self.edges[i].push(j);
                }
            }
        }
    }

    fn nearest(&self, place: Place, at: Vec3) -> Result<usize, NotWalked> {
        if !at.iter().all(|v| v.is_finite()) {
            return Err(NotWalked::NotFinite(place));
        }
        let distance = |i: &usize| (self.points[*i] - at).norm();
        let best = (0..self.points.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let best = best.ok_or(NotWalked::NoRoute)?;
        let distance_m = distance(&best);
        if distance_m <= self.config.reach_m {
            Ok(best)
        } else {
            Err(NotWalked::FarFromRoutes { place, distance_m })
        }
    }

    /// The shortest route between two points that are near recorded routes.
    ///
    /// # Errors
    /// When a point is not finite or far from all routes, or the routes are not connected.
    pub fn path(&self, from: Vec3, to: Vec3) -> Result<WalkedPath, NotWalked> {
        let (start, goal) = (self.nearest(Place::Start, from)?, self.nearest(Place::Goal, to)?);
        let ahead = |i: usize| (self.points[i] - self.points[goal]).norm();
        let mut best = vec![(f64::INFINITY, u32::MAX); self.points.len()];
        let mut done = vec![false; self.points.len()];
        best[start].0 = 0.0;
        // The bits of positive floats have the order of the floats.
        let mut queue = BinaryHeap::from([Reverse((ahead(start).to_bits(), start as u32))]);
        let mut expanded = 0;
        while let Some(Reverse((_, at))) = queue.pop() {
            let at = at as usize;
            if std::mem::replace(&mut done[at], true) {
                continue;
            }
            expanded += 1;
            if at == goal {
                return Ok(self.trace(&best, goal, [from, to], expanded));
            }
            for &next in &self.edges[at] {
                let cost = best[at].0 + (self.points[next as usize] - self.points[at]).norm();
                let place = &mut best[next as usize];
                if cost < place.0 {
                    *place = (cost, at as u32);
                    queue.push(Reverse(((cost + ahead(next as usize)).to_bits(), next)));
                }
            }
        }
        Err(NotWalked::NotJoined { expanded })
    }

    /// Whether a step follows a route, and then whether against its direction.
    fn along_route(&self, from: usize, to: usize) -> Option<bool> {
        // Points of a route have successive indices; a jump to another stretch belongs to no route.
        (from.abs_diff(to) == 1 && self.routes[from] == self.routes[to]).then_some(to < from)
    }

    /// The recorded points that a path over nodes passes.
    fn passed(&self, nodes: &[usize]) -> Vec<Passed> {
        let direction = |k: usize| {
            let after = nodes.get(k + 1).and_then(|&to| self.along_route(nodes[k], to));
            let before = k.checked_sub(1).and_then(|b| self.along_route(nodes[b], nodes[k]));
            after.or(before).unwrap_or(false)
        };
        let mut passed: Vec<Passed> = Vec::with_capacity(nodes.len());
        for (k, &node) in nodes.iter().enumerate() {
            let (route, point) = (self.routes[node], self.recorded[node]);
            if passed.last().is_none_or(|last| (last.route, last.point) != (route, point)) {
                passed.push(Passed { route, point, backwards: direction(k) });
            }
        }
        passed
    }

    fn trace(&self, best: &[(f64, u32)], goal: usize, ends: [Vec3; 2], expanded: usize) -> WalkedPath {
        let mut nodes = vec![goal];
        while let Some(&parent) = nodes.last().map(|&n| &best[n].1).filter(|&&p| p != u32::MAX) {
            nodes.push(parent as usize);
        }
        nodes.reverse();
        let mut stretches: Vec<Stretch> = Vec::new();
        for pair in nodes.windows(2) {
            if let Some(backwards) = self.along_route(pair[0], pair[1]) {
                let stretch = Stretch { route: self.routes[pair[0]], backwards };
                if stretches.last() != Some(&stretch) {
                    stretches.push(stretch);
                }
            }
        }
        let points: Vec<Vec3> =
            std::iter::once(ends[0]).chain(nodes.iter().map(|&n| self.points[n])).chain([ends[1]]).collect();
        let length_m = points.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
        WalkedPath { points, passed: self.passed(&nodes), stretches, length_m, expanded }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(points: &[(f64, f64, f64)]) -> Vec<Vec3> {
        points.iter().map(|&(x, y, z)| Vec3::new(x, y, z)).collect()
    }

    #[test]
    fn routes_that_meet_lead_on_into_each_other() {
        // A corridor, a corridor that leaves it to the north, one on the floor above, one far off.
        let routes = [
            line(&[(0.0, 0.0, 0.0), (30.0, 0.0, 0.0)]),
            line(&[(12.0, 20.0, 0.0), (12.0, 0.4, 0.0)]),
            line(&[(12.0, 10.0, 3.0), (40.0, 10.0, 3.0)]),
            line(&[(100.0, 0.0, 0.0), (110.0, 0.0, 0.0)]),
        ];
        let graph = WalkedGraph::new(&routes, WalkedConfig::default());
        let path = graph.path(Vec3::new(2.0, 0.3, 0.0), Vec3::new(12.0, 19.0, 0.0)).unwrap();
        assert!((path.length_m - 29.0).abs() < 1.5, "{} m", path.length_m);
        assert_eq!(
            path.stretches,
            [Stretch { route: 0, backwards: false }, Stretch { route: 1, backwards: true }]
        );
        let ends =
            [path.passed.first(), path.passed.last()].map(|p| p.map(|p| (p.route, p.point, p.backwards)));
        assert_eq!(ends, [Some((0, 0, false)), Some((1, 0, true))]);
        let off = |p: &Vec3| p.y.abs().min((p.x - 12.0).abs());
        assert!(path.points.iter().all(|p| off(p) < 0.7), "nothing leads across what nobody walked");
        let upstairs = graph.path(Vec3::zeros(), Vec3::new(20.0, 10.0, 3.0));
        assert!(matches!(upstairs, Err(NotWalked::NotJoined { .. })), "floors stay apart: {upstairs:?}");
        assert!(matches!(
            graph.path(Vec3::zeros(), Vec3::new(105.0, 0.0, 0.0)),
            Err(NotWalked::NotJoined { .. })
        ));
    }

    #[test]
    fn gaps_and_bad_ends_have_their_reasons() {
        let gap = line(&[
            (0.0, 0.0, 0.0),
            (10.0, 0.0, 0.0),
            (f64::NAN, 0.0, 0.0),
            (12.0, 0.0, 0.0),
            (20.0, 0.0, 0.0),
        ]);
        let graph = WalkedGraph::new(&[gap], WalkedConfig::default());
        let (start, end) = (Vec3::zeros(), Vec3::new(20.0, 0.0, 0.0));
        assert!(matches!(graph.path(start, end), Err(NotWalked::NotJoined { .. })));
        let far = graph.path(start, Vec3::new(20.0, 9.0, 0.0));
        assert_eq!(far, Err(NotWalked::FarFromRoutes { place: Place::Goal, distance_m: 9.0 }));
        let nan = graph.path(Vec3::new(f64::NAN, 0.0, 0.0), end);
        assert_eq!(nan, Err(NotWalked::NotFinite(Place::Start)));
        assert_eq!(WalkedGraph::new(&[], WalkedConfig::default()).path(start, end), Err(NotWalked::NoRoute));
        let same = graph.path(start, start).unwrap();
        assert_eq!((same.length_m, same.stretches.len()), (0.0, 0));
    }

    #[test]
    fn as_short_as_looking_at_all_pairs() {
        let mut random = cairn_random::Random::new(77);
        for _ in 0..30 {
            let routes: Vec<Vec<Vec3>> = (0..5)
                .map(|_| {
                    (0..6)
                        .map(|_| Vec3::new(random.uniform(0.0, 15.0), random.uniform(0.0, 15.0), 0.0))
                        .collect()
                })
                .collect();
            let graph = WalkedGraph::new(&routes, WalkedConfig::default());
            let n = graph.len();
            // Bellman-Ford.
            let mut cost = vec![f64::INFINITY; n];
            cost[0] = 0.0;
            for _ in 0..n {
                for i in 0..n {
                    for &j in &graph.edges[i] {
                        let j = j as usize;
                        cost[j] = cost[j].min(cost[i] + (graph.points[i] - graph.points[j]).norm());
                    }
                }
            }
            for goal in [n / 3, n / 2, n - 1] {
                match graph.path(graph.points[0], graph.points[goal]) {
                    Ok(path) => assert!((path.length_m - cost[goal]).abs() < 1e-9),
                    Err(reason) => assert!(cost[goal].is_infinite(), "{reason}"),
                }
            }
        }
    }
}
