//! The graph of a world's key frames, relaxed when a loop is closed: the drift since the earlier visit is spread over
//! all that hangs together (the essential graph of Mur-Artal et al. 2015, section VII-D, with similarities after Strasdat,
//! Montiel & Davison, "Scale drift-aware large scale monocular SLAM", RSS 2010).

use super::Freedom;
use cairn_atlas::{Change, KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::{LieGroup, Se3, Sim3, So3, YawPose};
use cairn_solve::Loss;
use cairn_solve::graph::{GraphConfig, PoseGraph};
use nalgebra::{Const, DimMin, SMatrix, ToTypenum};
use std::collections::BTreeMap;

/// Key frames that share this many landmarks hold each other.
const STRONG: u32 = 80;
/// A metre weighs as much as this many radians, or as this part of scale: what a step of a walk is wrong by.
const RADIANS_PER_METRE: f64 = 0.25;

/// A tie between two key frames: by index, with what the map says of it or a loop corrects it to.
pub(super) struct MapPrior {
    pub a: usize,
    pub b: usize,
    pub a_from_b: Sim3,
}

/// What moves when key frame `here` belongs at `world_from_here` in sight of `old`.
pub(super) fn relax(
    snapshot: &Snapshot,
    here: &KeyFrame,
    old: KeyFrameId,
    world_from_here: &Sim3,
    metre: f64,
    freedom: Freedom,
) -> Vec<Change> {
    let chain: Vec<&KeyFrame> = snapshot.key_frames_of(here.map).collect();
    let slots: BTreeMap<KeyFrameId, usize> = chain.iter().enumerate().map(|(i, k)| (k.id, i)).collect();
    let poses: Vec<Se3> = chain.iter().map(|k| k.world_from_camera).collect();
    let mut ties = Vec::new();
    for (b, k) in chain.iter().enumerate() {
        let strong = k.covisible.iter().take_while(|(_, n)| *n >= STRONG).map(|(id, _)| *id);
        let mut to: Vec<KeyFrameId> = k
            .parent
            .into_iter()
            .chain(k.links.iter().copied())
            .chain(strong)
            .filter(|id| *id < k.id)
            .collect();
        to.sort_unstable();
        to.dedup();
        for a in to.iter().filter_map(|id| slots.get(id).copied()) {
            ties.push(MapPrior { a, b, a_from_b: (poses[a].inverse() * poses[b]).into() });
        }
    }
    let (Some(a), Some(b)) = (slots.get(&old).copied(), slots.get(&here.id).copied()) else {
        return Vec::new();
    };
    ties.push(MapPrior { a, b, a_from_b: Sim3::from(poses[a]).inverse() * *world_from_here });
    let relaxed: Vec<Sim3> = match freedom {
        Freedom::AlignGravity => upright(&poses, &ties, metre),
        Freedom::Metric => solve::<Se3, 6>(&poses, &ties, metre, |s| Se3::new(s.rotation, s.translation))
            .into_iter()
            .map(Sim3::from)
            .collect(),
        Freedom::Similar => solve::<Sim3, 7>(&poses, &ties, metre, |s| *s),
    };
    let mut shifts: BTreeMap<KeyFrameId, Sim3> = BTreeMap::new();
    let mut changes = Vec::new();
    for ((k, before), after) in chain.iter().zip(&poses).zip(&relaxed) {
        shifts.insert(k.id, *after * Sim3::from(*before).inverse());
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

/// Relaxes a chain of poses whose roll and pitch are known: four degrees of freedom each (Qin, Li, Shen, "VINS-Mono", TRO
/// 2018, section VIII-C).
fn upright(poses: &[Se3], ties: &[MapPrior], metre: f64) -> Vec<Sim3> {
    let split: Vec<(YawPose, So3)> = poses.iter().map(YawPose::split).collect();
    let levels: Vec<Se3> = split.iter().map(|(level, _)| level.tilted(&So3::identity())).collect();
    let between = |t: &MapPrior| {
        let a_from_b = Se3::new(t.a_from_b.rotation, t.a_from_b.translation);
        let level = YawPose::between(&split[t.a].1, &a_from_b, &split[t.b].1);
        MapPrior { a_from_b: level.tilted(&So3::identity()).into(), ..*t }
    };
    let ties: Vec<MapPrior> = ties.iter().map(between).collect();
    let lift = |s: &Sim3| YawPose::split(&Se3::new(s.rotation, s.translation)).0;
    let relaxed = solve::<YawPose, 4>(&levels, &ties, metre, lift);
    relaxed.iter().zip(&split).map(|(level, (_, tilt))| level.tilted(tilt).into()).collect()
}

/// Relaxes a chain of poses, the first of which stays, under ties.
pub(super) fn solve<G: LieGroup<D> + Copy, const D: usize>(
    poses: &[Se3],
    ties: &[MapPrior],
    metre: f64,
    lift: impl Fn(&Sim3) -> G,
) -> Vec<G>
where
    Const<D>: ToTypenum + DimMin<Const<D>, Output = Const<D>>,
{
    let mut graph = PoseGraph::<G, D>::new();
    for (i, pose) in poses.iter().enumerate() {
        graph.add_vertex(lift(&Sim3::from(*pose)), i == 0);
    }
    let mut information = SMatrix::<f64, D, D>::zeros();
    for i in 0..D {
        let sigma = if i < 3 { metre } else { RADIANS_PER_METRE };
        information[(i, i)] = 1.0 / (sigma * sigma);
    }
    for tie in ties {
        // What makes no sense as an edge is left out: the rest still holds together.
        let _ = graph.add_edge(tie.a, tie.b, lift(&tie.a_from_b), &information, Loss::Squared);
    }
    let config = GraphConfig { iterations: 20, tolerance: 1e-6, ..GraphConfig::default() };
    graph.solve(&config, || false);
    graph.values().to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So2, Vec3};

    /// A square walked with a small error in each step, told of where it ended.
    #[test]
    fn a_walk_that_drifted_comes_home_and_its_start_stays() {
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
        let mut ties: Vec<MapPrior> = (0..40)
            .map(|a| MapPrior { a, b: a + 1, a_from_b: (drifted[a].inverse() * drifted[a + 1]).into() })
            .collect();
        ties.push(MapPrior { a: 0, b: 40, a_from_b: truth[40].into() });
        let error = |poses: &[Se3]| -> f64 {
            poses.iter().zip(&truth).map(|(a, b)| (a.translation - b.translation).norm()).sum::<f64>() / 41.0
        };
        let rigid = solve::<Se3, 6>(&drifted, &ties, 1.0, |s| Se3::new(s.rotation, s.translation));
        let similar: Vec<Se3> = solve::<Sim3, 7>(&drifted, &ties, 1.0, |s| *s)
            .iter()
            .map(|s| Se3::new(s.rotation, s.translation))
            .collect();
        for relaxed in [rigid, similar] {
            assert_eq!(relaxed[0], truth[0]);
            assert!(error(&relaxed) < 0.3 * error(&drifted), "{} of {}", error(&relaxed), error(&drifted));
        }
    }

    /// A square walked upright, with an eye that looks along the way and is tilted: only headings drift, and come back.
    #[test]
    fn what_knows_down_keeps_it() {
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
        let mut ties: Vec<MapPrior> = (0..40)
            .map(|a| MapPrior { a, b: a + 1, a_from_b: (drifted[a].inverse() * drifted[a + 1]).into() })
            .collect();
        // The loop is measured with an error of direction that gravity contradicts.
        let off = Se3::new(So3::exp(&Vec3::new(0.02, 0.02, 0.0)), Vec3::zeros());
        ties.push(MapPrior { a: 0, b: 40, a_from_b: (truth[0].inverse() * truth[40] * off).into() });
        let relaxed = upright(&drifted, &ties, 1.0);
        let error = |at: &dyn Fn(usize) -> Vec3| -> f64 {
            (0..41).map(|i| (at(i) - truth[i].translation).norm()).sum::<f64>() / 41.0
        };
        let (before, after) = (error(&|i| drifted[i].translation), error(&|i| relaxed[i].translation));
        assert!(after < 0.3 * before, "{after} of {before}");
        let up = |r: &So3| r.inverse() * Vec3::z();
        for (r, d) in relaxed.iter().zip(&drifted) {
            assert!((up(&r.rotation) - up(&d.rotation)).norm() < 1e-9);
        }
    }

    /// Each step of a circle is seen a little smaller than the one before; told that, the last comes back to the first.
    #[test]
    fn scale_that_drifted_comes_back() {
        let step = Se3::new(So3::exp(&Vec3::new(0.0, 0.157, 0.0)), Vec3::new(0.0, 0.0, 0.5));
        let mut drifted = vec![Se3::identity()];
        let mut truth = drifted.clone();
        for i in 0..40 {
            let smaller = Se3::new(step.rotation, step.translation * 0.99_f64.powi(i));
            drifted.push(drifted[i as usize] * smaller);
            truth.push(truth[i as usize] * step);
        }
        let mut ties: Vec<MapPrior> = (0..40)
            .map(|a| MapPrior { a, b: a + 1, a_from_b: (drifted[a].inverse() * drifted[a + 1]).into() })
            .collect();
        let end = Sim3::new(truth[40].rotation, truth[40].translation, 1.0 / 0.99_f64.powi(40));
        ties.push(MapPrior { a: 0, b: 40, a_from_b: end });
        let relaxed = solve::<Sim3, 7>(&drifted, &ties, 1.0, |s| *s);
        let error = |at: &dyn Fn(usize) -> Vec3| -> f64 {
            (0..41).map(|i| (at(i) - truth[i].translation).norm()).sum::<f64>() / 41.0
        };
        let (before, after) = (error(&|i| drifted[i].translation), error(&|i| relaxed[i].translation));
        assert!(after < 0.1 * before, "{after} of {before}");
    }
}
