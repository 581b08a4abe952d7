//! A window of key frames that were seen and felt, adjusted together in a level world, and handed back as changes.

use crate::pinhole;
use crate::subproblem::Subproblem;
use crate::window::{WindowConfig, WindowResult};
use cairn_atlas::{Change, ChangeSet, KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_geometry::Se3;
use cairn_inertial::{
    Bias, BiasPrior, FixedMask, Gravity, Preintegrated, VioConfig, VioFrame, VioLink, VioWindow,
};
use cairn_sensor::ImuNoise;
use cairn_solve::{CHI2_2, CHI2_3};
use cairn_vision::RectifiedCamera;

/// Standard deviation of the biases before a window, as the windows before it have left them: rad/s, m/s^2.
const BIAS_BEFORE: [f64; 2] = [0.002, 0.05];
/// Of any sensor's biases around zero.
const BIAS_AT_ALL: [f64; 2] = [0.1, 0.3];

/// The sensor that felt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuModel {
    /// Where the eye sits on it, metres.
    pub imu_from_camera: Se3,
    /// Its noise as it is in this motion, often some times its data sheet's.
    pub noise: ImuNoise,
}

/// A copied window.
#[derive(Clone, Debug)]
pub struct InertialWindow {
    subproblem: Subproblem,
    window: VioWindow,
}

impl InertialWindow {
    /// The window around a key frame: the last `chain` key frames up to it, one felt after the other, and those that share
    /// most landmarks with it move; what came before the chain holds it, and other key frames hold the landmarks.
    pub fn around(
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        imu: &ImuModel,
        centre: KeyFrameId,
        chain: usize,
        config: &WindowConfig,
    ) -> Option<Self> {
        let mut moving = Vec::new();
        let mut next = Some(centre);
        while let Some(id) = next.filter(|_| moving.len() < chain) {
            moving.push(id);
            next = before(snapshot.key_frame(id)?);
        }
        let shared =
            snapshot.key_frame(centre)?.covisible.iter().map(|(id, _)| *id).filter(|id| Some(*id) != next);
        for id in shared.take(config.key_frames) {
            if moving.len() < config.key_frames && !moving.contains(&id) {
                moving.push(id);
            }
        }
        let map = snapshot.key_frame(centre)?.map;
        let mut subproblem = Subproblem::of(snapshot, &moving, config.anchors);
        // The one that was left before the chain holds its velocity and biases, whether it sees the same or not.
        if let Some(id) = next.filter(|id| !subproblem.key_frames.contains(id)) {
            subproblem.poses.push(snapshot.key_frame(id)?.world_from_camera);
            subproblem.key_frames.push(id);
        }
        let begins = next;
        Some(Self::new(snapshot, camera, imu, subproblem, |slot, k| match k.motion {
            // What came before the chain holds its place and speed; its biases may turn out otherwise.
            Some(_) if Some(k.id) == begins => FixedMask::Bias,
            _ if slot >= moving.len() => FixedMask::All,
            _ if k.id == map.root() => FixedMask::Pose,
            Some(_) => FixedMask::Free,
            None => FixedMask::Motion,
        }))
    }

    /// The window in which every key frame of a world moves; its root keeps its place and heading.
    pub fn whole(snapshot: &Snapshot, camera: &RectifiedCamera, imu: &ImuModel, map: MapId) -> Self {
        let all: Vec<KeyFrameId> = snapshot.key_frames_of(map).map(|k| k.id).collect();
        let subproblem = Subproblem::of(snapshot, &all, 0);
        let linked = |k: &KeyFrame| {
            let follows = |id: KeyFrameId| snapshot.key_frames_of(map).any(|next| before(next) == Some(id));
            k.motion.is_some() && (before(k).is_some() || follows(k.id))
        };
        Self::new(snapshot, camera, imu, subproblem, |_, k| match linked(k) {
            true if k.id == map.root() => FixedMask::Place,
            true => FixedMask::Free,
            false if k.id == map.root() => FixedMask::All,
            false => FixedMask::Motion,
        })
    }

    fn new(
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        model: &ImuModel,
        subproblem: Subproblem,
        hold: impl Fn(usize, &KeyFrame) -> FixedMask,
    ) -> Self {
        let mut frames = Vec::with_capacity(subproblem.key_frames.len());
        let mut links = Vec::new();
        for (slot, id) in subproblem.key_frames.iter().enumerate() {
            let Some(k) = snapshot.key_frame(*id) else { continue };
            let motion = k.motion.as_ref();
            frames.push(VioFrame {
                world_from_camera: k.world_from_camera,
                velocity: motion.map_or_else(Default::default, |m| k.world_from_camera.rotation * m.velocity),
                bias: motion.map_or(Bias::default(), |m| m.bias),
                hold: hold(slot, k),
            });
            let imu = motion.and_then(|m| m.imu_factor.as_ref());
            let from = imu.and_then(|f| subproblem.key_frames.iter().position(|id| *id == f.since));
            if let (Some(imu), Some(from)) = (imu, from) {
                let bias = frames[slot].bias;
                let sum = Preintegrated::of(model.noise, bias, imu.sum.samples().to_vec());
                links.push(VioLink { from, to: slot, sum });
            }
        }
        // Between two that hold nothing is to be found, and one whose motion holds is not to be pulled by it.
        let open = |slot: usize| frames[slot].hold != FixedMask::Motion;
        links.retain(|l| open(l.from) && open(l.to) && l.from.min(l.to) < subproblem.moving);
        let mut observations = subproblem.observations.clone();
        for o in &mut observations {
            o.pixel[2] += snapshot.right_offset();
        }
        // Where links begin, biases are known so well.
        let begins = |slot: usize| links.iter().all(|l| l.to != slot) && links.iter().any(|l| l.from == slot);
        let known = |slot: usize| match frames[slot].hold {
            FixedMask::Bias => BiasPrior { frame: slot, bias: frames[slot].bias, sigmas: BIAS_BEFORE },
            _ => BiasPrior { frame: slot, bias: Bias::default(), sigmas: BIAS_AT_ALL },
        };
        let bias_priors = (0..frames.len()).filter(|slot| begins(*slot)).map(known).collect();
        let window = VioWindow {
            camera: pinhole(camera),
            imu_from_camera: model.imu_from_camera,
            gravity: Gravity::level(),
            frames,
            points: subproblem.points.clone(),
            observations,
            links,
            bias_priors,
        };
        Self { subproblem, window }
    }

    /// How many links it has.
    pub fn links(&self) -> usize {
        self.window.links.len()
    }

    /// Solves the window: robustly, then without the observations that do not fit. `stop` is asked before each step.
    pub fn solve(mut self, config: &WindowConfig, mut stop: impl FnMut() -> bool) -> WindowResult {
        let window = &mut self.window;
        let [before, after] = config.iterations;
        let solve = |iterations| VioConfig { iterations, robust: true, tolerance: config.tolerance };
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
        for (id, frame) in self.subproblem.key_frames.iter().zip(&window.frames).take(self.subproblem.moving)
        {
            if matches!(frame.hold, FixedMask::Free | FixedMask::Place | FixedMask::Motion) {
                changes.push(Change::MoveKeyFrame(*id, frame.world_from_camera));
            }
            if matches!(frame.hold, FixedMask::Free | FixedMask::Place | FixedMask::Pose) {
                let velocity = frame.world_from_camera.rotation.inverse() * frame.velocity;
                changes.push(Change::InertialState(*id, velocity, frame.bias));
            }
        }
        for (id, point) in self.subproblem.landmarks.iter().zip(&window.points) {
            changes.push(Change::MoveLandmark(*id, *point));
        }
        changes.extend(self.subproblem.forgotten(&window.observations));
        let changes = ChangeSet { base: self.subproblem.base, changes };
        WindowResult {
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
    Some(k.motion.as_ref()?.imu_factor.as_ref()?.since)
}
