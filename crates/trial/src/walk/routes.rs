//! Random routes, and their simulated recording by a sighted person.

use super::config::STEP_S;
use super::noise::Noise;
use cairn_geometry::{Pose, Se3, So3, Vec2, Vec3};
use cairn_guide::{
    Anchor, Confidence, Ground, RecordInput, Recorder, RecorderConfig, Route, camera_pose, cross, direction,
    heading_of, wrap,
};
use cairn_random::Random;
use cairn_sensor::Stamp;

/// A route of 20 to 150 m with 3 to 12 turns (no more than one each 5 m), each segment at least 2.5 m; with
/// `crossing` it crosses itself, else it keeps 3 m from itself.
pub fn random_route(seed: u64, crossing: bool) -> Vec<Vec2> {
    let mut random = Random::new(seed.wrapping_mul(0x9E37_79B9) ^ 0x5ACED);
    let mut best = Vec::new();
    for _ in 0..2000 {
        let line = draw(&mut random);
        let fits = if crossing { crosses_itself(&line) } else { keeps_away(&line) };
        best = line;
        if fits {
            break;
        }
    }
    best
}

fn draw(random: &mut Random) -> Vec<Vec2> {
    let length = random.uniform(20.0, 150.0);
    let most = ((length / 5.0) as usize - 1).min(12);
    let turns = 3 + random.below(most - 2);
    // Segment lengths: 2.5 m each, and the rest broken at random.
    let rest = length - 2.5 * (turns + 1) as f64;
    let mut breaks: Vec<f64> = (0..turns).map(|_| random.uniform(0.0, rest)).collect();
    breaks.extend([0.0, rest]);
    breaks.sort_by(f64::total_cmp);
    let mut heading = random.uniform(-3.0, 3.0);
    let mut line = vec![Vec2::zeros()];
    for k in 0..=turns {
        if k > 0 {
            let degrees = match random.below(20) {
                0..=11 => random.uniform(75.0, 105.0),
                12..=16 => random.uniform(25.0, 60.0),
                _ => random.uniform(105.0, 140.0),
            };
            heading += degrees.to_radians() * if random.chance(0.5) { 1.0 } else { -1.0 };
        }
        let from = line[line.len() - 1];
        line.push(from + direction(heading) * (2.5 + breaks[k + 1] - breaks[k]));
    }
    line
}

/// True when two segments that do not touch cross.
pub fn crosses_itself(line: &[Vec2]) -> bool {
    let side = |a: &Vec2, b: &Vec2, c: &Vec2| cross(&(b - a), &(c - a));
    let n = line.len().saturating_sub(1);
    (0..n).any(|i| {
        (i + 2..n).any(|j| {
            let (a, b, c, d) = (&line[i], &line[i + 1], &line[j], &line[j + 1]);
            side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
        })
    })
}

fn keeps_away(line: &[Vec2]) -> bool {
    let mut points: Vec<(Vec2, f64)> = Vec::new();
    let mut along = 0.0;
    for w in line.windows(2) {
        let span = (w[1] - w[0]).norm();
        let steps = (span / 0.5).ceil() as usize;
        points.extend((0..steps).map(|k| {
            let t = k as f64 / steps as f64;
            (w[0] + (w[1] - w[0]) * t, along + span * t)
        }));
        along += span;
    }
    points
        .iter()
        .enumerate()
        .all(|(i, (p, a))| points[i..].iter().all(|(q, b)| b - a < 8.0 || (p - q).norm() > 3.0))
}

/// The poses of a camera on the chest of a person who walks the line at 1 m/s, one each [`STEP_S`], swaying up to 15 cm and rounding
/// corners; `phase` is that of the sway, radians. With the metres walked.
pub fn walked_poses(line: &[Vec2], phase: f64) -> Vec<(Se3, f64)> {
    let (mut k, mut p) = (0, line[0]);
    let mut heading = heading_of(&(line[1] - line[0]));
    let (mut poses, mut walked) = (Vec::new(), 0.0);
    let total: f64 = line.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
    while walked < 2.0 * total + 10.0 {
        // Aim 0.6 m ahead on the present segment; change to the next when near its end.
        let (a, b) = (line[k], line[k + 1]);
        let span = (b - a).norm();
        let along = (p - a).dot(&(b - a)) / span;
        let last = k + 2 == line.len();
        if along > span - if last { 0.05 } else { 0.35 } {
            if last {
                break;
            }
            k += 1;
            continue;
        }
        let sway = 0.15 * (0.35 * walked + phase).sin() * (0.5 * (span - along)).min(1.0);
        let u = (b - a) / span;
        let aim = a + u * (along + 0.6).min(span) + Vec2::new(-u.y, u.x) * sway;
        let turn = wrap(heading_of(&(aim - p)) - heading);
        // People turn on the spot where the route bends sharply.
        heading += turn.clamp(-1.6 * STEP_S, 1.6 * STEP_S);
        if turn.abs() < 0.6 {
            p += direction(heading) * STEP_S;
            walked += STEP_S;
        }
        poses.push((camera_pose(p.x, p.y, heading, 0.25), walked));
    }
    poses
}

/// Simulates a person who walks the line with the recorder running.
pub fn walk_out(line: &[Vec2], noise: Noise, seed: u64) -> Route {
    let mut random = Random::new(seed ^ 0x0DD);
    let mut recorder = Recorder::new(RecorderConfig::default(), true, &Ground::z_up(), "simulated walk");
    let phase = random.uniform(0.0, 6.0);
    let s = if noise == Noise::None { 0.0 } else { 1.0 };
    for (tick, (pose, walked)) in walked_poses(line, phase).into_iter().enumerate() {
        let shake =
            Vec3::new(random.normal(0.0, 0.02), random.normal(0.0, 0.02), random.normal(0.0, 0.02)) * s;
        let twist = So3::exp(&(Vec3::z() * random.normal(0.0, 0.01) * s));
        let pose = Se3::new(twist * pose.rotation, pose.translation + shake);
        let anchor = Anchor { robot: 0, seq: (walked / 2.0) as u32 };
        let input = RecordInput {
            stamp: Stamp::from_seconds((tick + 1) as f64 * STEP_S),
            odom_from_camera: Pose::new(pose),
            segment: 0,
            anchor,
            anchor_from_camera: pose,
            confidence: Confidence::Good,
            quality: 1.0,
        };
        // Recorded into memory: there is no disk to fail.
        let _ = recorder.observe(&input);
    }
    recorder.finish().0
}
