//! Pose graph optimisation of a map when a loop is closed: the drift since the earlier visit is distributed
//! over the connected key frames (the essential graph of Mur-Artal et al. 2015, section VII-D, with
//! similarities after Strasdat, Montiel & Davison, "Scale drift-aware large scale monocular SLAM", RSS 2010).

use cairn_atlas::{Change, KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_geometry::{LieGroup, Se3, Sim3, So3, YawPose};
use cairn_solve::Loss;
use cairn_solve::graph::{GraphConfig, PoseGraph};
use nalgebra::{Const, DimMin, SMatrix, ToTypenum};
use std::collections::BTreeMap;

/// The degrees of freedom that drift and may therefore be corrected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Freedom {
    /// Position and heading: gravity and scale are known.
    AlignGravity,
    /// Position and orientation.
    Metric,
    /// Position, orientation and scale.
    Similar,
}

/// Key frames that share this many landmarks are connected by an edge.
const MIN_SHARED: u32 = 80;
/// Standard deviation in radians, or as a share of scale, that weighs as much as one metre: the typical error of one
/// step of a walk.
const RADIANS_PER_METRE: f64 = 0.25;

/// An edge between two key frames: by index, with their relative pose in the map, or as corrected by a loop.
struct Edge {
    a: usize,
    b: usize,
    a_from_b: Sim3,
}

/// A key frame and its pose as seen from an earlier visit of the same place; the scale is length there for each here.
#[derive(Clone, Copy, Debug)]
pub(super) struct Loop {
    pub here: KeyFrameId,
    pub old: KeyFrameId,
    pub world_from_here: Sim3,
}

/// The changes that distribute over a map what these loops contradict. The root stays, and the key frames that are
/// `fixed`. The key frame `unmeasured` does not know how it lies to its parent: it was the root of a map that has been
/// merged along these loops.
pub(super) fn relax(
    snapshot: &Snapshot,
    map: MapId,
    loops: &[Loop],
    unmeasured: Option<KeyFrameId>,
    metre_in_map_units: f64,
    freedom: Freedom,
    fixed: impl Fn(KeyFrameId) -> bool,
) -> Vec<Change> {
    let chain: Vec<&KeyFrame> = snapshot.key_frames_of(map).collect();
    let slots: BTreeMap<KeyFrameId, usize> = chain.iter().enumerate().map(|(i, k)| (k.id, i)).collect();
    let poses: Vec<Se3> = chain.iter().map(|k| k.world_from_camera).collect();
    let mut edges = Vec::new();
    for (b, k) in chain.iter().enumerate() {
        let strong = k.covisible.iter().take_while(|(_, n)| *n >= MIN_SHARED).map(|(id, _)| *id);
        let mut to: Vec<KeyFrameId> = k
            .parent
            .filter(|_| unmeasured != Some(k.id))
            .into_iter()
            .chain(k.links.iter().copied())
            .chain(strong)
            .filter(|id| *id < k.id)
            .collect();
        to.sort_unstable();
        to.dedup();
        for a in to.iter().filter_map(|id| slots.get(id).copied()) {
            edges.push(Edge { a, b, a_from_b: (poses[a].inverse() * poses[b]).into() });
        }
    }
    for l in loops {
        let (Some(a), Some(b)) = (slots.get(&l.old).copied(), slots.get(&l.here).copied()) else {
            return Vec::new();
        };
        edges.push(Edge { a, b, a_from_b: Sim3::from(poses[a]).inverse() * l.world_from_here });
    }
    let fixed: Vec<bool> = chain.iter().enumerate().map(|(i, k)| i == 0 || fixed(k.id)).collect();
    let optimised: Vec<Sim3> = match freedom {
        Freedom::AlignGravity => optimise_four_dof(&poses, &fixed, &edges, metre_in_map_units),
        Freedom::Metric => {
            let rigid = |s: &Sim3| Se3::new(s.rotation, s.translation);
            let solved = solve::<Se3, 6>(&poses, &fixed, &edges, metre_in_map_units, rigid);
            solved.into_iter().map(Sim3::from).collect()
        }
        Freedom::Similar => solve::<Sim3, 7>(&poses, &fixed, &edges, metre_in_map_units, |s| *s),
    };
    let mut shifts: BTreeMap<KeyFrameId, Sim3> = BTreeMap::new();
    let mut changes = Vec::new();
    for ((k, old_pose), after) in chain.iter().zip(&poses).zip(&optimised) {
        shifts.insert(k.id, *after * Sim3::from(*old_pose).inverse());
        changes.push(Change::MoveKeyFrame(k.id, Se3::new(after.rotation, after.translation)));
        if freedom == Freedom::Similar {
            changes.push(Change::Scale(k.id, after.scale));
        }
    }
    for l in snapshot.landmarks() {
        if let Some(shift) = l.observations.first().and_then(|o| shifts.get(&o.key_frame)) {
            changes.push(Change::MoveLandmark(l.id, *shift * l.position));
        }
    }
    changes
}

/// Optimises the poses of a gravity-aligned map, roll and pitch of which are known: four degrees of freedom
/// each (Qin, Li, Shen, "VINS-Mono", TRO 2018, section VIII-C).
fn optimise_four_dof(poses: &[Se3], fixed: &[bool], edges: &[Edge], metre_in_map_units: f64) -> Vec<Sim3> {
    let split: Vec<(YawPose, So3)> = poses.iter().map(YawPose::split).collect();
    let levels: Vec<Se3> = split.iter().map(|(level, _)| level.tilted(&So3::identity())).collect();
    let between = |t: &Edge| {
        let a_from_b = Se3::new(t.a_from_b.rotation, t.a_from_b.translation);
        let level = YawPose::between(&split[t.a].1, &a_from_b, &split[t.b].1);
        Edge { a_from_b: level.tilted(&So3::identity()).into(), ..*t }
    };
    let edges: Vec<Edge> = edges.iter().map(between).collect();
    let lift = |s: &Sim3| YawPose::split(&Se3::new(s.rotation, s.translation)).0;
    let optimised = solve::<YawPose, 4>(&levels, fixed, &edges, metre_in_map_units, lift);
    optimised.iter().zip(&split).map(|(level, (_, tilt))| level.tilted(tilt).into()).collect()
}

/// Optimises poses under edges; some stay fixed.
fn solve<G: LieGroup<D> + Copy, const D: usize>(
    poses: &[Se3],
    fixed: &[bool],
    edges: &[Edge],
    metre_in_map_units: f64,
    lift: impl Fn(&Sim3) -> G,
) -> Vec<G>
where
    Const<D>: ToTypenum + DimMin<Const<D>, Output = Const<D>>,
{
    let mut graph = PoseGraph::<G, D>::new();
    for (pose, fixed) in poses.iter().zip(fixed) {
        graph.add_vertex(lift(&Sim3::from(*pose)), *fixed);
    }
    let mut information = SMatrix::<f64, D, D>::zeros();
    for i in 0..D {
        let sigma = if i < 3 { metre_in_map_units } else { RADIANS_PER_METRE };
        information[(i, i)] = 1.0 / (sigma * sigma);
    }
    for edge in edges {
        // An edge with invalid values is left out: the others still connect the graph.
        let _ = graph.add_edge(edge.a, edge.b, lift(&edge.a_from_b), &information, Loss::Squared);
    }
    let config = GraphConfig { iterations: 20, tolerance: 1e-6, ..GraphConfig::default() };
    graph.solve(&config, || false);
    graph.values().to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So2, Vec3};

    fn first(n: usize) -> Vec<bool> {
        (0..n).map(|i| i == 0).collect()
    }

    /// A circle walked with a small error in each step, and a loop edge to its true end.
    #[test]
    fn loop_edge_corrects_drift_and_keeps_first_pose() {
        let step =
            |error: f64| Se3::new(So3::exp(&Vec3::new(0.0, 0.157 + error, 0.0)), Vec3::new(error, 0.0, 0.5));
        let walk = |error: f64| {
            let mut poses = vec![Se3::identity()];
            for i in 0..40 {
                poses.push(poses[i] * step(error));
            }
            poses
        };
        let (truth, drifted) = (walk(0.0), walk(0.002));
        let mut edges: Vec<Edge> = (0..40)
            .map(|a| Edge { a, b: a + 1, a_from_b: (drifted[a].inverse() * drifted[a + 1]).into() })
            .collect();
        edges.push(Edge { a: 0, b: 40, a_from_b: truth[40].into() });
        let error = |poses: &[Se3]| -> f64 {
            poses.iter().zip(&truth).map(|(a, b)| (a.translation - b.translation).norm()).sum::<f64>() / 41.0
        };
        let rigid =
            solve::<Se3, 6>(&drifted, &first(41), &edges, 1.0, |s| Se3::new(s.rotation, s.translation));
        let similar: Vec<Se3> = solve::<Sim3, 7>(&drifted, &first(41), &edges, 1.0, |s| *s)
            .iter()
            .map(|s| Se3::new(s.rotation, s.translation))
            .collect();
        for optimised in [rigid, similar] {
            assert_eq!(optimised[0], truth[0]);
            assert!(
                error(&optimised) < 0.3 * error(&drifted),
                "{} of {}",
                error(&optimised),
                error(&drifted)
            );
        }
    }

    /// A circle walked upright with a tilted camera: only the headings drift, and are corrected.
    #[test]
    fn four_dof_keeps_gravity_direction() {
        let tilt = So3::exp(&Vec3::new(-1.4, 0.1, 0.05));
        let step = |error: f64| YawPose::new(So2::exp(0.157 + error), Vec3::new(0.5, 0.0, 0.001));
        let walk = |error: f64| -> Vec<Se3> {
            let mut level = vec![YawPose::identity()];
            for i in 0..40 {
                level.push(level[i] * step(error));
            }
            level.iter().map(|l| l.tilted(&tilt)).collect()
        };
        let (truth, drifted) = (walk(0.0), walk(0.002));
        let mut edges: Vec<Edge> = (0..40)
            .map(|a| Edge { a, b: a + 1, a_from_b: (drifted[a].inverse() * drifted[a + 1]).into() })
            .collect();
        // The loop edge has an error of tilt that contradicts gravity.
        let off = Se3::new(So3::exp(&Vec3::new(0.02, 0.02, 0.0)), Vec3::zeros());
        edges.push(Edge { a: 0, b: 40, a_from_b: (truth[0].inverse() * truth[40] * off).into() });
        let optimised = optimise_four_dof(&drifted, &first(41), &edges, 1.0);
        let error = |at: &dyn Fn(usize) -> Vec3| -> f64 {
            (0..41).map(|i| (at(i) - truth[i].translation).norm()).sum::<f64>() / 41.0
        };
        let (before, after) = (error(&|i| drifted[i].translation), error(&|i| optimised[i].translation));
        assert!(after < 0.3 * before, "{after} of {before}");
        let up = |r: &So3| r.inverse() * Vec3::z();
        for (r, d) in optimised.iter().zip(&drifted) {
            assert!((up(&r.rotation) - up(&d.rotation)).norm() < 1e-9);
        }
    }

    /// Each step of a circle is estimated a little smaller than the one before; with a loop edge of the true
    /// scale, the last pose returns to the truth.
    #[test]
    fn loop_edge_corrects_scale_drift() {
        let step = Se3::new(So3::exp(&Vec3::new(0.0, 0.157, 0.0)), Vec3::new(0.0, 0.0, 0.5));
        let mut drifted = vec![Se3::identity()];
        let mut truth = drifted.clone();
        for i in 0..40 {
            let smaller = Se3::new(step.rotation, step.translation * 0.99_f64.powi(i));
            drifted.push(drifted[i as usize] * smaller);
            truth.push(truth[i as usize] * step);
        }
        let mut edges: Vec<Edge> = (0..40)
            .map(|a| Edge { a, b: a + 1, a_from_b: (drifted[a].inverse() * drifted[a + 1]).into() })
            .collect();
        let end = Sim3::new(truth[40].rotation, truth[40].translation, 1.0 / 0.99_f64.powi(40));
        edges.push(Edge { a: 0, b: 40, a_from_b: end });
        let optimised = solve::<Sim3, 7>(&drifted, &first(41), &edges, 1.0, |s| *s);
        let error = |at: &dyn Fn(usize) -> Vec3| -> f64 {
            (0..41).map(|i| (at(i) - truth[i].translation).norm()).sum::<f64>() / 41.0
        };
        let (before, after) = (error(&|i| drifted[i].translation), error(&|i| optimised[i].translation));
        assert!(after < 0.1 * before, "{after} of {before}");
    }
}
