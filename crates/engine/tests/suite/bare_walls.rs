//! Before bare walls the depth camera carries the pose: no frame is lost, the pose is as certain as is said, and depth that cannot
//! be used does no harm.

use cairn_engine::{Config, Engine, Host, Runner, SensorMode};
use cairn_geometry::Se3;
use cairn_sensor::{DepthImage, FramePacket, Source, Stamp};
use cairn_sim::{SimConfig, SimSource};
use cairn_tracking::State;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A walk through an apartment without anything on its walls, past a corner that fills the view with one of them.
const WALK: &str = "sim:apartment?sensor=rgbd&poor=1&pitch=-10&rate=15&start=14&duration=4";

/// The state of each frame, its pose and the true one.
struct Walked {
    frames: Vec<(State, Option<Se3>, Se3)>,
    digest: u64,
}

fn walk(address: &str, config: &Config, spoil: impl Fn(usize, &mut FramePacket)) -> Walked {
    let mut source = SimSource::new(&SimConfig::parse(address).expect("an address")).expect("a world");
    let rig = source.rig().clone();
    let truth: BTreeMap<Stamp, Se3> = source.info().truth.iter().copied().collect();
    let rate_hz = source.info().rate_hz;
    let mut engine =
        Engine::new(&rig, SensorMode::Rgbd, rate_hz, Runner::Lockstep, config, &Host::bare()).expect("a rig");
    let (mut frames, mut packets) = (Vec::new(), 0);
    while let Some(mut packet) = source.next_packet().expect("a packet") {
        spoil(packets, &mut packet);
        packets += 1;
        let Ok(out) = engine.on_packet(&packet) else { continue };
        frames.push((out.state, out.world_from_body().map(|p| p.se3), truth[&out.stamp]));
    }
    Walked { frames, digest: engine.digest() }
}

fn without_imu() -> Config {
    let mut config = Config::default();
    config.inertial.enabled = false;
    config
}

fn dense() -> Config {
    let mut config = without_imu();
    config.tracker.dense = true;
    config
}

impl Walked {
    fn lost(&self) -> usize {
        self.frames.iter().filter(|(state, ..)| matches!(state, State::Lost { .. })).count()
    }

    /// How far each carried pose is from the truth since the last pose by features, and the standard deviation that was told.
    fn carried(&self) -> Vec<(f64, f64)> {
        let mut last = None;
        let mut out = Vec::new();
        for (state, pose, truth) in &self.frames {
            match (state, pose) {
                (State::Tracking, Some(pose)) => last = Some((*pose, *truth)),
                (State::Coasting { sigma, .. }, Some(pose)) => {
                    let (before, true_before): (Se3, Se3) = last.expect("a tracked pose");
                    let off = (true_before.inverse() * *truth).inverse() * (before.inverse() * *pose);
                    out.push((off.translation.norm(), *sigma));
                }
                _ => {}
            }
        }
        out
    }
}

#[test]
fn a_bare_wall_loses_nobody() {
    let walked = walk(WALK, &without_imu(), |_, _| {});
    let carried = walked.carried();
    println!("carried: {carried:.3?}");
    assert_eq!(walked.lost(), 0);
    // Without the depth these frames are lost.
    assert!(carried.len() >= 3, "the walk has its bare wall: {carried:?}");
    for (off, sigma) in &carried {
        assert!(off < &(3.0 * sigma), "off by {off} m, said to be within {sigma} m");
        assert!(*sigma < 0.5, "a third of a second is not half a metre: {sigma}");
    }
    // Along the wall nothing is seen, and that is told: the pose is less certain than any that is fixed in all directions.
    assert!(carried.iter().any(|(_, sigma)| *sigma > 0.05), "{carried:?}");
    let again = walk(WALK, &without_imu(), |_, _| {});
    assert_eq!(walked.digest, again.digest, "bit-identical");
}

#[test]
fn the_dense_front_end_walks_as_well() {
    let walked = walk(WALK, &dense(), |_, _| {});
    assert_eq!(walked.lost(), 0);
    let (_, first, true_first) = walked.frames.iter().find(|(_, pose, _)| pose.is_some()).expect("a pose");
    let first = first.expect("a pose");
    let mut worst = 0.0f64;
    for (_, pose, truth) in &walked.frames {
        let Some(pose) = pose else { continue };
        let off = (true_first.inverse() * *truth).inverse() * (first.inverse() * *pose);
        worst = worst.max(off.translation.norm());
    }
    println!("the dense front end is off by {worst:.3} m at most");
    assert!(worst < 0.25, "{worst}");
}

/// Nothing measured, everything out of range, noise, no image at all, and images of another size.
#[test]
fn depth_that_cannot_be_used_does_no_harm() {
    let spoil = |k: usize, packet: &mut FramePacket| {
        let Some(depth) = packet.depth.as_mut().filter(|_| k > 10) else { return };
        let (w, h) = (depth.width(), depth.height());
        let filled = |of: &dyn Fn(usize) -> u16| {
            let mut image = DepthImage::new(w, h);
            image.data_mut().iter_mut().enumerate().for_each(|(i, v)| *v = of(i));
            Arc::new(image)
        };
        match k % 6 {
            0 => *depth = filled(&|_| 0),
            1 => *depth = filled(&|_| u16::MAX),
            2 => *depth = filled(&|i| (i * 7919 % 60_000) as u16),
            3 => packet.depth = None,
            4 => *depth = Arc::new(DepthImage::new(w / 2, h / 2)),
            _ => {}
        }
    };
    for config in [without_imu(), dense()] {
        let walked = walk(WALK, &config, spoil);
        for (_, pose, _) in &walked.frames {
            assert!(pose.is_none_or(|p| p.is_finite()));
        }
        let tracked = walked.frames.iter().filter(|(state, ..)| *state == State::Tracking).count();
        println!("{tracked} of {} tracked, {} lost", walked.frames.len(), walked.lost());
        assert!(tracked > 20, "{tracked}");
    }
}
