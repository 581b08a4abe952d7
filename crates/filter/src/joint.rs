//! One map of several robots of a log: their runs, each from its own origin, are put into the frame of the first robot by the landmarks that
//! they share, and smoothed together with what they saw of each other.
//!
//! In: a log with labels, and a run of each of its robots. Out: poses and landmarks in one frame. Source: the alignment is that of Umeyama
//! (1991) without scale; smoothing is that of `batch.rs`, in which landmarks and sightings of robots are shared (C-SAM: Andersson and
//! Nygards, "C-SAM: multi-robot SLAM using square root information smoothing", ICRA 2008).

use crate::batch::{BatchConfig, BatchReport, Smoothed, smooth};
use crate::log::{Event, Log, Noise, RobotLog, Step, Target};
use crate::run::{Run, RunError, align};
use cairn_geometry::{Se2, Vec2};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// One map of several robots.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// The robots in it, by their index in the log.
    pub robots: Vec<usize>,
    /// The landmarks by label, and the poses of these robots at their steps, in the frame of the first one.
    pub smoothed: Smoothed,
    /// How smoothing went.
    pub report: BatchReport,
    /// How often one of them saw another.
    pub mutual: usize,
}

/// The joint map of these runs, one for each robot of the log; robots that share fewer than three landmarks with the others, or only some on
/// a line, are left out. `None` where that leaves fewer than two.
///
/// # Errors
/// When a sighting with the log's noise is not a valid measurement.
pub fn joint(log: &Log, runs: &[Run], config: &BatchConfig) -> Result<Option<Joint>, RunError> {
    let (placed, landmarks) = placed(runs);
    if placed.len() < 2 {
        return Ok(None);
    }
    let robots: Vec<usize> = placed.iter().map(|p| p.0).collect();
    let noise = Noise { sighting_delay_s: log.noise.sighting_delay_s, ..log.smoothing_noise };
    let mut steps: Vec<Vec<Step>> = Vec::new();
    for robot in &robots {
        let mut own = log.robots[*robot].steps(&noise, &seen_at(log, &robots, *robot, &noise))?;
        own.iter_mut().for_each(|step| renumber(step, &robots));
        steps.push(own);
    }
    let poses = placed.iter().zip(&steps).map(|((robot, to), s)| guess(&runs[*robot], to, s)).collect();
    let is_robot =
        |step: &Step| step.sightings.iter().filter(|s| matches!(s.target, Target::Robot(_))).count();
    let mutual = steps.iter().flatten().map(is_robot).sum();
    let (smoothed, report) = smooth(&steps, Smoothed { poses, landmarks }, config);
    Ok(Some(Joint { robots, smoothed, report, mutual }))
}

/// The robots whose maps fit together, with the transform of each into the frame of the first one, and the landmarks of all of them.
fn placed(runs: &[Run]) -> (Vec<(usize, Se2)>, BTreeMap<u32, Vec2>) {
    let Some(first) = runs.first() else { return (Vec::new(), BTreeMap::new()) };
    let (mut placed, mut landmarks) = (vec![(0, Se2::identity())], first.named());
    let mut left: Vec<usize> = (1..runs.len()).collect();
    // The one that shares most landmarks with the map so far comes next.
    loop {
        let fits = left.iter().filter_map(|k| {
            let (to, _, pairs) = align(&landmarks, &runs[*k].named())?;
            Some((pairs, *k, to))
        });
        let Some((_, k, to)) = fits.max_by_key(|f| (f.0, std::cmp::Reverse(f.1))) else { break };
        for (label, at) in runs[k].named() {
            landmarks.entry(label).or_insert(to * at);
        }
        placed.push((k, to));
        left.retain(|l| *l != k);
    }
    (placed, landmarks)
}

/// When the other robots saw this one: it needs a pose there.
fn seen_at(log: &Log, robots: &[usize], robot: usize, noise: &Noise) -> Vec<f64> {
    let others = robots.iter().filter(|k| **k != robot).map(|k| &log.robots[*k]);
    let sees = |other: &RobotLog| -> Vec<f64> {
        let of_it = |e: &&crate::log::Entry| matches!(e.event, Event::Seen { target: Target::Robot(k), .. } if k == robot);
        other.entries.iter().filter(of_it).map(|e| e.time_s - noise.sighting_delay_s).collect()
    };
    let mut times: Vec<f64> = others.flat_map(sees).collect();
    times.sort_by(f64::total_cmp);
    times
}

/// Numbers the robots that are seen as in this list, and drops sightings of others.
fn renumber(step: &mut Step, robots: &[usize]) {
    step.sightings.retain_mut(|s| match s.target {
        Target::Robot(other) => match robots.iter().position(|k| *k == other) {
            Some(place) => {
                s.target = Target::Robot(place);
                true
            }
            None => false,
        },
        _ => true,
    });
}

/// The first guess of the poses at these steps: those of the run at its own steps, between them by odometry.
fn guess(run: &Run, to: &Se2, steps: &[Step]) -> Vec<Vector3<f64>> {
    let (mut pose, mut next) = (Se2::identity(), 0);
    let at = |step: &Step| {
        pose = pose * step.motion.before_from_after;
        if run.times_s.get(next).is_some_and(|t| *t <= step.time_s) {
            let known = run.poses[next];
            (pose, next) = (Se2::from_xy_angle(known.x, known.y, known.z), next + 1);
        }
        let own = *to * pose;
        Vector3::new(own.translation.x, own.translation.y, own.rotation.log())
    };
    steps.iter().map(at).collect()
}
