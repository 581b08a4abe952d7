//! A window of key frames that were seen and felt, adjusted together in a level world, and handed back as changes.

use crate::excerpt::Excerpt;
use crate::pinhole;
use crate::window::{Settled, WindowSetting};
use cairn_atlas::{Change, ChangeSet, KeyFrame, KeyFrameId, Map, WorldId};
use cairn_geometry::Se3;
use cairn_inertial::{
    Bias, BiasPrior, Gravity, Hold, Preintegrated, VioFrame, VioLink, VioSetting, VioWindow,
};
use cairn_sensor::ImuNoise;
use cairn_solve::{CHI2_2, CHI2_3};
use cairn_vision::EyeModel;

/// Standard deviation of the biases before a window, as the windows before it have left them: rad/s, m/s^2.
const BIAS_BEFORE: [f64; 2] = [0.002, 0.05];
/// Of any sensor's biases around zero.
const BIAS_AT_ALL: [f64; 2] = [0.1, 0.3];

/// The sensor that felt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feeling {
    /// Where the eye sits on it, metres.
    pub imu_from_eye: Se3,
    /// Its noise as it is in this motion, often some times its data sheet's.
    pub noise: ImuNoise,
}

/// A copied window.
#[derive(Clone, Debug)]
pub struct InertialWindow {
    excerpt: Excerpt,
    window: VioWindow,
}

impl InertialWindow {
    /// The window around a key frame: the last `chain` key frames up to it, one felt after the other, and those that share
    /// most landmarks with it move; what came before the chain holds it, and other key frames hold the landmarks.
    pub fn around(
        map: &Map,
        eye: &EyeModel,
        felt: &Feeling,
        centre: KeyFrameId,
        chain: usize,
        setting: &WindowSetting,
    ) -> Option<Self> {
        let mut moving = Vec::new();
        let mut next = Some(centre);
        while let Some(id) = next.filter(|_| moving.len() < chain) {
            moving.push(id);
            next = before(map.key_frame(id)?);
        }
        let shared =
            map.key_frame(centre)?.covisible.iter().map(|(id, _)| *id).filter(|id| Some(*id) != next);
        for id in shared.take(setting.key_frames) {
            if moving.len() < setting.key_frames && !moving.contains(&id) {
                moving.push(id);
            }
        }
        let world = map.key_frame(centre)?.world;
        let mut excerpt = Excerpt::of(map, &moving, setting.anchors);
        // The one that was left before the chain holds its velocity and biases, whether it sees the same or not.
        if let Some(id) = next.filter(|id| !excerpt.key_frames.contains(id)) {
            excerpt.poses.push(map.key_frame(id)?.world_from_eye);
            excerpt.key_frames.push(id);
        }
        let begins = next;
        Some(Self::new(map, eye, felt, excerpt, |slot, k| match k.motion {
            // What came before the chain holds its place and speed; its biases may turn out otherwise.
            Some(_) if Some(k.id) == begins => Hold::Bias,
            _ if slot >= moving.len() => Hold::All,
            _ if k.id == world.root() => Hold::Pose,
            Some(_) => Hold::Free,
            None => Hold::Motion,
        }))
    }

    /// The window in which every key frame of a world moves; its root keeps its place and heading.
    pub fn whole(map: &Map, eye: &EyeModel, felt: &Feeling, world: WorldId) -> Self {
        let all: Vec<KeyFrameId> = map.key_frames_of(world).map(|k| k.id).collect();
        let excerpt = Excerpt::of(map, &all, 0);
        let linked = |k: &KeyFrame| {
            let follows = |id: KeyFrameId| map.key_frames_of(world).any(|next| before(next) == Some(id));
            k.motion.is_some() && (before(k).is_some() || follows(k.id))
        };
        Self::new(map, eye, felt, excerpt, |_, k| match linked(k) {
            true if k.id == world.root() => Hold::Place,
            true => Hold::Free,
            false if k.id == world.root() => Hold::All,
            false => Hold::Motion,
        })
    }

    fn new(
        map: &Map,
        eye: &EyeModel,
        feeling: &Feeling,
        excerpt: Excerpt,
        hold: impl Fn(usize, &KeyFrame) -> Hold,
    ) -> Self {
        let mut frames = Vec::with_capacity(excerpt.key_frames.len());
        let mut links = Vec::new();
        for (slot, id) in excerpt.key_frames.iter().enumerate() {
            let Some(k) = map.key_frame(*id) else { continue };
            let motion = k.motion.as_ref();
            frames.push(VioFrame {
                world_from_eye: k.world_from_eye,
                velocity: motion.map_or_else(Default::default, |m| k.world_from_eye.rotation * m.velocity),
                bias: motion.map_or(Bias::default(), |m| m.bias),
                hold: hold(slot, k),
            });
            let felt = motion.and_then(|m| m.felt.as_ref());
            let from = felt.and_then(|f| excerpt.key_frames.iter().position(|id| *id == f.since));
            if let (Some(felt), Some(from)) = (felt, from) {
                let bias = frames[slot].bias;
                let sum = Preintegrated::of(feeling.noise, bias, felt.sum.samples().to_vec());
                links.push(VioLink { from, to: slot, sum });
            }
        }
        // Between two that hold nothing is to be found, and one whose motion holds is not to be pulled by it.
        let open = |slot: usize| frames[slot].hold != Hold::Motion;
        links.retain(|l| open(l.from) && open(l.to) && l.from.min(l.to) < excerpt.moving);
        let mut observations = excerpt.observations.clone();
        for o in &mut observations {
            o.pixel[2] += map.right_offset();
        }
        // Where links begin, biases are known so well.
        let begins = |slot: usize| links.iter().all(|l| l.to != slot) && links.iter().any(|l| l.from == slot);
        let known = |slot: usize| match frames[slot].hold {
            Hold::Bias => BiasPrior { frame: slot, bias: frames[slot].bias, sigmas: BIAS_BEFORE },
            _ => BiasPrior { frame: slot, bias: Bias::default(), sigmas: BIAS_AT_ALL },
        };
        let bias_priors = (0..frames.len()).filter(|slot| begins(*slot)).map(known).collect();
        let window = VioWindow {
            camera: pinhole(eye),
            imu_from_eye: feeling.imu_from_eye,
            gravity: Gravity::level(),
            frames,
            points: excerpt.points.clone(),
            observations,
            links,
            bias_priors,
        };
        Self { excerpt, window }
    }

    /// How many links it has.
    pub fn links(&self) -> usize {
        self.window.links.len()
    }

    /// Solves the window: robustly, then without the observations that do not fit. `stop` is asked before each step.
    pub fn solve(mut self, setting: &WindowSetting, mut stop: impl FnMut() -> bool) -> Settled {
        let window = &mut self.window;
        let [before, after] = setting.iterations;
        let solve = |iterations| VioSetting { iterations, robust: true, tolerance: setting.tolerance };
        let mut report = window.solve(&solve(before), &mut stop);
        let judge = |window: &mut VioWindow| {
            for i in 0..window.observations.len() {
                let o = window.observations[i];
                let bound = if o.pixel[2].is_nan() { CHI2_2 } else { CHI2_3 };
                if window.chi2(&o) > bound {
                    window.observations[i].weight = 0.0;
                }
            }
        };
        if after > 0 && !stop() {
            judge(window);
            let first = report.cost_before;
            report = window.solve(&solve(after), &mut stop);
            report.cost_before = first;
        }
        judge(window);
        let mut changes = Vec::new();
        for (id, frame) in self.excerpt.key_frames.iter().zip(&window.frames).take(self.excerpt.moving) {
            if matches!(frame.hold, Hold::Free | Hold::Place | Hold::Motion) {
                changes.push(Change::MoveKeyFrame(*id, frame.world_from_eye));
            }
            if matches!(frame.hold, Hold::Free | Hold::Place | Hold::Pose) {
                let velocity = frame.world_from_eye.rotation.inverse() * frame.velocity;
                changes.push(Change::Motion(*id, velocity, frame.bias));
            }
        }
        for (id, point) in self.excerpt.landmarks.iter().zip(&window.points) {
            changes.push(Change::MoveLandmark(*id, *point));
        }
        changes.extend(self.excerpt.forgotten(&window.observations));
        let changes = ChangeSet { base: self.excerpt.base, changes };
        Settled {
            changes,
            report,
            residual_variance: 1.0,
            right_offset_pull: 0.0,
            right_offset_information: 0.0,
        }
    }
}

/// The key frame since which another was felt.
fn before(k: &KeyFrame) -> Option<KeyFrameId> {
    Some(k.motion.as_ref()?.felt.as_ref()?.since)
}
