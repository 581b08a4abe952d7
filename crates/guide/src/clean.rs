//! Cleans a recorded route: detours that return to walked ground are cut, then the polyline is simplified.
//!
//! A loop, a backtrack, an oscillation and a hub with spokes are the same thing: the walker returned to a place he had
//! been. The recorded points therefore form a graph, with an edge along each walked piece and a joint between two
//! points so close together that the ground between them was walked; the cleaned route is the shortest path through it
//! (Dijkstra 1959). Unwalked ground is never crossed. Then Ramer (1972) and Douglas-Peucker (1973), with the additional
//! condition that a chord must itself lie on walked ground.

use crate::ground::Ground;
use crate::route::{PlacedPoint, Stretch};
use crate::tracks::{Tracks, to_segment};
use cairn_geometry::Vec3;
use cairn_settings::Settings;
use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};

/// What counts as the same ground, and how much may be simplified. Metres.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct CleanConfig {
    /// Whether detours are removed; off for a route that is to be walked exactly as recorded.
    #[setting(default = true)]
    pub cut_detours: bool,
    /// The two ends of a cut lie within this distance of each other.
    #[setting(default = 1.0, range = 0.0..=100.0)]
    pub corridor_m: f64,
    /// Ground within this distance of a recorded point counts as walked: half the width of a person.
    #[setting(default = 0.30, range = 0.0..=100.0)]
    pub walked_m: f64,
    /// A cut must save at least this.
    #[setting(default = 1.0, range = 0.0..=100.0)]
    pub saving_m: f64,
    /// Simplification: the result deviates from the recorded route by at most this.
    #[setting(default = 0.30, range = 0.0..=100.0)]
    pub tolerance_m: f64,
    /// Segments shorter than this are merged where the tolerance allows.
    #[setting(default = 1.0, range = 0.0..=100.0)]
    pub min_segment_m: f64,
}

/// Where a detour was left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Where the route leaves the detour's beginning.
    pub from: Vec3,
    /// Where it goes on.
    pub to: Vec3,
    /// Metres saved.
    pub saved_m: f64,
}

/// One corner of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    p: Vec3,
    /// The ground between the previous node and this one is unknown.
    gap: bool,
}

/// A cleaned route, ready for guidance.
#[derive(Clone, Debug, PartialEq)]
pub struct CleanedRoute {
    /// The corners, from the start of the recording to its end, in metres.
    pub points: Vec<Vec3>,
    /// Whether the stretch before each corner is a gap in the recording.
    pub gap_before: Vec<bool>,
    /// Length as recorded, in metres.
    pub before_m: f64,
    /// Length after cleaning, in metres.
    pub after_m: f64,
    /// The detours removed.
    pub cuts: Vec<Cut>,
}

/// Cleans a resolved route; lengths are multiplied by `metres_per_unit` (see [`Route::metres_per_unit`](crate::Route)).
pub fn clean(
    points: &[PlacedPoint],
    metres_per_unit: f64,
    ground: &Ground,
    config: &CleanConfig,
) -> CleanedRoute {
    let line: Vec<(Vec3, bool)> = (points.iter())
        .map(|p| (p.frame_from_camera.translation * metres_per_unit, p.stretch == Stretch::Gap))
        .collect();
    clean_line(&line, &line, ground, config)
}

/// Cleans `line` given the `record` of where the walker really went: pairs of a point in metres and
/// whether the stretch before it is a gap. Cleaning a result again with the same record changes nothing.
pub fn clean_line(
    line: &[(Vec3, bool)],
    record: &[(Vec3, bool)],
    ground: &Ground,
    config: &CleanConfig,
) -> CleanedRoute {
    let before_m = length(record.iter().map(|p| p.0));
    let walked = record.windows(2).filter(|w| !w[1].1).map(|w| (w[0].0, w[1].0));
    let tracks = Tracks::new(walked, config.walked_m.max(config.tolerance_m));
    let mut nodes = without_doubles(line);
    let mut cuts = Vec::new();
    // Simplification can bring two stretches within reach of each other, so both steps repeat until nothing changes.
    for _ in 0..12 {
        let previous = nodes.clone();
        if config.cut_detours {
            nodes = cut(&nodes, &tracks, ground, config, &mut cuts);
        }
        nodes = simplify(&nodes, &tracks, config);
        nodes = merge_short(nodes, &tracks, config);
        if nodes == previous {
            break;
        }
    }
    CleanedRoute {
        after_m: length(nodes.iter().map(|n| n.p)),
        points: nodes.iter().map(|n| n.p).collect(),
        gap_before: nodes.iter().map(|n| n.gap).collect(),
        before_m,
        cuts,
    }
}

impl CleanedRoute {
    /// The largest distance from the cleaned to the recorded route in metres, sampled every 5 cm.
    pub fn largest_distance_to(&self, record: &[PlacedPoint], metres_per_unit: f64) -> f64 {
        let record: Vec<Vec3> =
            record.iter().map(|p| p.frame_from_camera.translation * metres_per_unit).collect();
        largest_distance(&self.points, &record)
    }
}

/// The largest distance from line `a` to line `b` in metres, sampled every 5 cm of `a`.
pub fn largest_distance(a: &[Vec3], b: &[Vec3]) -> f64 {
    let to_b = |p: Vec3| b.windows(2).map(|w| to_segment(&p, &w[0], &w[1])).fold(f64::INFINITY, f64::min);
    let mut worst: f64 = 0.0;
    for w in a.windows(2) {
        let steps = ((w[1] - w[0]).norm() / 0.05).ceil().max(1.0) as usize;
        for k in 0..=steps {
            worst = worst.max(to_b(w[0] + (w[1] - w[0]) * (k as f64 / steps as f64)));
        }
    }
    worst
}

/// The length of a line in metres.
pub fn length(points: impl Iterator<Item = Vec3>) -> f64 {
    let mut last: Option<Vec3> = None;
    points.map(|p| last.replace(p).map_or(0.0, |l| (p - l).norm())).sum()
}

/// Drops points that stay within 2 cm (turning on the spot), but never the first or the last.
fn without_doubles(line: &[(Vec3, bool)]) -> Vec<Node> {
    let mut nodes: Vec<Node> = Vec::with_capacity(line.len());
    for (k, &(p, gap)) in line.iter().enumerate() {
        match nodes.last() {
            Some(last) if !gap && (p - last.p).norm() < 0.02 && k + 1 < line.len() => {}
            _ => nodes.push(Node { p, gap: gap && k > 0 }),
        }
    }
    nodes
}

/// Samples along a line, at which joints can start and end.
struct Samples {
    p: Vec<Vec3>,
    /// Metres from the start.
    along: Vec<f64>,
    /// The stretch before is a gap.
    gap: Vec<bool>,
    /// The sample is a node of the line.
    corner: Vec<bool>,
}

fn sample(nodes: &[Node]) -> Samples {
    const STEP: f64 = 0.10;
    let mut s = Samples { p: Vec::new(), along: Vec::new(), gap: Vec::new(), corner: Vec::new() };
    let mut push = |p: Vec3, gap: bool, corner: bool| {
        let along = match (s.p.last(), s.along.last()) {
            (Some(q), Some(a)) => a + (p - q).norm(),
            _ => 0.0,
        };
        s.p.push(p);
        s.along.push(along);
        s.gap.push(gap);
        s.corner.push(corner);
    };
    for (k, node) in nodes.iter().enumerate() {
        if k > 0 && !node.gap {
            let from = nodes[k - 1].p;
            let steps = ((node.p - from).norm() / STEP).ceil() as usize;
            for i in 1..steps {
                push(from + (node.p - from) * (i as f64 / steps as f64), false, false);
            }
        }
        push(node.p, node.gap, true);
    }
    s
}

/// Pairs of samples with walked ground between them although the route made a detour; each pair from both ends.
fn joints(s: &Samples, tracks: &Tracks, ground: &Ground, config: &CleanConfig) -> Vec<Vec<usize>> {
    let reach = config.corridor_m.min(2.0 * config.walked_m);
    let key = |p: &Vec3| {
        let k = |v: f64| (v / reach).floor() as i64;
        (k(p.x), k(p.y), k(p.z))
    };
    let mut cells: HashMap<(i64, i64, i64), Vec<usize>> = HashMap::new();
    let mut out = vec![Vec::new(); s.p.len()];
    for (j, p) in s.p.iter().enumerate() {
        let (x, y, z) = key(p);
        for (dx, dy, dz) in (0..27).map(|n| (n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1)) {
            for &i in cells.get(&(x + dx, y + dy, z + dz)).into_iter().flatten() {
                let d = (s.p[i] - p).norm();
                let level = (ground.height(&s.p[i]) - ground.height(p)).abs() <= config.walked_m;
                let saves = s.along[j] - s.along[i] - d > config.saving_m;
                if d <= reach && level && saves && tracks.covers(&s.p[i], p, config.walked_m) {
                    out[i].push(j);
                    out[j].push(i);
                }
            }
        }
        cells.entry(key(p)).or_default().push(j);
    }
    out
}

#[derive(PartialEq)]
struct Open {
    cost: f64,
    node: usize,
}

impl Eq for Open {}
impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Open {
    /// The cheapest node first out of a max-heap; ties by index, so that the order is deterministic.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.node.cmp(&self.node))
    }
}

/// The shortest path from the first to the last sample; a joint costs its length plus the minimum saving.
fn shortest(s: &Samples, joints: &[Vec<usize>], config: &CleanConfig) -> Vec<usize> {
    let n = s.p.len();
    let mut cost = vec![f64::INFINITY; n];
    let mut from = vec![usize::MAX; n];
    let mut open = BinaryHeap::from([Open { cost: 0.0, node: 0 }]);
    cost[0] = 0.0;
    while let Some(Open { cost: c, node: i }) = open.pop() {
        if c > cost[i] {
            continue;
        }
        if i + 1 == n {
            break;
        }
        let along = [i.checked_sub(1), Some(i + 1)].into_iter().flatten().filter(|&j| j < n);
        let steps = along.map(|j| (j, (s.along[j] - s.along[i]).abs()));
        let jumps = joints[i].iter().map(|&j| (j, (s.p[j] - s.p[i]).norm() + config.saving_m));
        for (j, w) in steps.chain(jumps) {
            if c + w < cost[j] {
                cost[j] = c + w;
                from[j] = i;
                open.push(Open { cost: c + w, node: j });
            }
        }
    }
    let mut path = vec![n - 1];
    while let Some(&last) = path.last() {
        if last == 0 || from[last] == usize::MAX {
            break;
        }
        path.push(from[last]);
    }
    path.reverse();
    path
}

fn cut(
    nodes: &[Node],
    tracks: &Tracks,
    ground: &Ground,
    config: &CleanConfig,
    cuts: &mut Vec<Cut>,
) -> Vec<Node> {
    if nodes.len() < 3 {
        return nodes.to_vec();
    }
    let s = sample(nodes);
    let joints = joints(&s, tracks, ground, config);
    if joints.iter().all(Vec::is_empty) {
        return nodes.to_vec();
    }
    let path = shortest(&s, &joints, config);
    let mut found = false;
    let mut out = vec![Node { p: s.p[0], gap: false }];
    for (k, w) in path.windows(2).enumerate() {
        let (i, j) = (w[0], w[1]);
        let joint = i.abs_diff(j) != 1;
        // A joint ends here, or one begins at the next step: both of its ends stay corners.
        let leaves = path.get(k + 2).is_some_and(|&next| next.abs_diff(j) != 1);
        if joint {
            found = true;
            let saved_m = (s.along[j] - s.along[i]).abs() - (s.p[j] - s.p[i]).norm();
            cuts.push(Cut { from: s.p[i], to: s.p[j], saved_m });
        }
        if joint || leaves || s.corner[j] {
            out.push(Node { p: s.p[j], gap: !joint && s.gap[i.max(j)] });
        }
    }
    if found { out } else { nodes.to_vec() }
}

fn simplify(nodes: &[Node], tracks: &Tracks, config: &CleanConfig) -> Vec<Node> {
    let mut keep = vec![false; nodes.len()];
    let mut stack = Vec::new();
    if let Some(last) = nodes.len().checked_sub(1) {
        keep[0] = true;
        keep[last] = true;
        stack.push((0, last));
    }
    while let Some((a, b)) = stack.pop() {
        if b <= a + 1 {
            continue;
        }
        let (mut far, mut split) = (-1.0, a + 1);
        for (k, node) in nodes.iter().enumerate().take(b).skip(a + 1) {
            let d = to_segment(&node.p, &nodes[a].p, &nodes[b].p);
            if d > far {
                (far, split) = (d, k);
            }
        }
        let gap = nodes[a + 1..=b].iter().any(|n| n.gap);
        let straight = far <= config.tolerance_m && !gap;
        if !(straight && tracks.covers(&nodes[a].p, &nodes[b].p, config.tolerance_m)) {
            keep[split] = true;
            stack.push((a, split));
            stack.push((split, b));
        }
    }
    nodes.iter().zip(keep).filter(|(_, k)| *k).map(|(n, _)| *n).collect()
}

/// Merges the ends of short segments where every changed part stays on walked ground.
fn merge_short(mut nodes: Vec<Node>, tracks: &Tracks, config: &CleanConfig) -> Vec<Node> {
    let mut k = 0;
    while k + 1 < nodes.len() {
        let short = (nodes[k + 1].p - nodes[k].p).norm() < config.min_segment_m;
        match short.then(|| merged(&nodes, k, tracks, config)).flatten() {
            Some(better) => {
                nodes = better;
                k = k.saturating_sub(2);
            }
            None => k += 1,
        }
    }
    nodes
}

/// The line with the short segment after node `k` gone: without its first end, without its second, or
/// with both at their middle.
fn merged(nodes: &[Node], k: usize, tracks: &Tracks, config: &CleanConfig) -> Option<Vec<Node>> {
    let last = nodes.len() - 1;
    if nodes[k + 1].gap {
        return None;
    }
    let on_ground = |a: usize, via: Option<Vec3>, b: usize| {
        let stops: Vec<Vec3> = [Some(nodes[a].p), via, Some(nodes[b].p)].into_iter().flatten().collect();
        !nodes[a + 1..=b].iter().any(|n| n.gap)
            && stops.windows(2).all(|w| tracks.covers(&w[0], &w[1], config.tolerance_m))
    };
    let without = |drop: usize| -> Vec<Node> {
        nodes.iter().enumerate().filter(|(i, _)| *i != drop).map(|(_, n)| *n).collect()
    };
    if k > 0 && on_ground(k - 1, None, k + 1) {
        return Some(without(k));
    }
    if k + 1 < last && on_ground(k, None, k + 2) {
        return Some(without(k + 1));
    }
    if k > 0 && k + 1 < last {
        let middle = (nodes[k].p + nodes[k + 1].p) * 0.5;
        if on_ground(k - 1, Some(middle), k + 2) {
            let mut out = without(k + 1);
            out[k].p = middle;
            return Some(out);
        }
    }
    None
}
