//! Small snapshots with a history: several maps, merges, loops, removals, fused landmarks.

use cairn_atlas::store::{About, MapFile};
use cairn_atlas::{
    Change, ChangeSet, ImuFactor, InertialState, KeyFrame, KeyFrameId, LandmarkId, MapId, MapPrior, Readout,
    Snapshot,
};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_inertial::{Bias, Preintegrated};
use cairn_random::Random;
use cairn_sensor::{ImuNoise, ImuSample, Stamp};
use cairn_vision::bow::Vocabulary;
use cairn_vision::{Frame, RectifiedCamera, SensorMode};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A camera of 640 x 480.
pub fn camera() -> RectifiedCamera {
    RectifiedCamera {
        fx: 450.0,
        fy: 451.0,
        cx: 320.5,
        cy: 240.25,
        baseline_fx: 45.0,
        bounds: [-3.5, 0.0, 640.0, 481.5],
        close_depth: 4.0,
        body_from_camera: Se3::new(So3::exp(&Vec3::new(0.1, 0.2, 0.3)), Vec3::new(0.4, 0.5, 0.6)),
    }
}

/// Numbers from a seed.
pub struct Dice(Random);

impl Dice {
    pub fn new(seed: u64) -> Self {
        Self(Random::new(seed))
    }

    pub fn roll(&mut self, sides: usize) -> usize {
        self.0.below(sides)
    }

    fn real(&mut self) -> f64 {
        self.roll(1 << 20) as f64 / f64::from(1 << 19) - 1.0
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.real(), self.real(), self.real())
    }

    pub fn pose(&mut self) -> Se3 {
        Se3::new(So3::exp(&self.vector()), 5.0 * self.vector())
    }
}

fn frame(dice: &mut Dice, features: usize) -> Arc<Frame> {
    let mut frame = Frame::default();
    frame.stamp = Stamp(1_403_636_579_763_555_584 + dice.roll(1 << 30) as i64);
    for _ in 0..features {
        let px = [320.0 + 330.0 * dice.real() as f32, 240.0 + 250.0 * dice.real() as f32];
        frame.px.push(px);
        frame.raw.push([px[0] + dice.real() as f32, px[1]]);
        frame.octave.push(dice.roll(8) as u8);
        frame.angle.push(3.0 * dice.real() as f32);
        frame.descriptors.push(std::array::from_fn(|_| dice.roll(256) as u8));
        let depth = if dice.roll(3) == 0 { f32::NAN } else { 4.0 + 3.0 * dice.real() as f32 };
        frame.depth.push(depth);
        frame.right_x.push(px[0] - 45.0 / depth);
    }
    frame.index(&camera());
    Arc::new(frame)
}

/// A snapshot after `steps` steps of a history.
pub fn snapshot(seed: u64, steps: usize, features: usize) -> Snapshot {
    let (mut dice, mut snapshot) = (Dice::new(seed), Snapshot::new());
    for n in 0..steps {
        if n == steps / 2 {
            snapshot = snapshot.continued_by((seed % 3) as u16);
        }
        let changes = step(&mut dice, &snapshot, features);
        snapshot = snapshot.apply(&ChangeSet { base: snapshot.version(), changes }).0;
    }
    assert_eq!(snapshot.check(), Ok(()));
    snapshot
}

/// The changes of one step.
pub fn step(dice: &mut Dice, snapshot: &Snapshot, features: usize) -> Vec<Change> {
    let key_frames: Vec<KeyFrameId> = snapshot.key_frames().map(|k| k.id).collect();
    let landmarks: Vec<LandmarkId> = snapshot.landmarks().map(|l| l.id).collect();
    let new = snapshot.next_key_frame_id();
    let parent = key_frames.len().checked_sub(1 + dice.roll(3)).map(|i| key_frames[i]);
    let parent = parent.filter(|_| dice.roll(8) > 0);
    let frame = frame(dice, features);
    let bag = Vocabulary::embedded().bag(&frame.descriptors);
    let mut key_frame = KeyFrame::new(new, frame, dice.pose(), parent).with_bag(Arc::new(bag));
    if dice.roll(2) == 0 {
        let bias = Bias { gyro: 0.01 * dice.vector(), accel: 0.1 * dice.vector() };
        key_frame.motion =
            Some(InertialState { velocity: dice.vector(), bias, still_sigma: None, imu_factor: None });
    }
    let mut changes = vec![Change::AddKeyFrame(Box::new(key_frame)), Change::Calibrate(dice.real())];
    changes.push(Change::LeverArm(0.1 * dice.vector()));
    changes.push(Change::Readout(Readout { seconds: 0.02 * dice.real(), sigma_s: 0.001 }));
    let next = snapshot.next_landmark_id().index();
    for i in 0..features / 3 {
        let id = LandmarkId::from_index(next + i).unwrap();
        changes.push(Change::AddLandmark(id, 4.0 * dice.vector()));
        changes.push(Change::Observe(id, new, i as u16));
    }
    if key_frames.is_empty() || landmarks.is_empty() {
        return changes;
    }
    for i in features / 3..features {
        changes.push(Change::Observe(landmarks[dice.roll(landmarks.len())], new, i as u16));
    }
    let (a, b) = (key_frames[dice.roll(key_frames.len())], key_frames[dice.roll(key_frames.len())]);
    let (l, m) = (landmarks[dice.roll(landmarks.len())], landmarks[dice.roll(landmarks.len())]);
    changes.push(Change::Fuse(l, m));
    changes.push(Change::MoveKeyFrame(a, dice.pose()));
    changes.push(Change::Scale(b, 1.0 + 0.1 * dice.real()));
    changes.push(Change::Link(a, b));
    if dice.roll(3) == 0 {
        changes.push(Change::RemoveKeyFrame(b));
        changes.push(Change::RemoveLandmark(l));
    }
    let maps: Vec<MapId> = snapshot.maps().map(|(id, _)| id).collect();
    if dice.roll(4) == 0 {
        let turn = Sim3::new(So3::exp(&dice.vector()), dice.vector(), 1.0 + 0.2 * dice.real());
        changes.push(Change::AlignGravity(maps[dice.roll(maps.len())], turn));
    }
    if let [into, .., from] = maps[..] {
        let prior = MapPrior {
            to: a,
            to_from_root: dice.pose(),
            sigma: 0.5,
            sigma_rad: 0.125,
            sigma_log_scale: 0.25,
        };
        changes.push(Change::MapPrior(from, prior));
        if dice.roll(4) == 0 {
            let at = dice.pose();
            let into_from = Sim3::new(at.rotation, at.translation, 1.0 + 0.2 * dice.real());
            changes.push(Change::Merge { from, into, into_from, parent: into.root() });
        }
    }
    changes
}

/// The same as the content of a file.
pub fn file(seed: u64, steps: usize, features: usize) -> MapFile {
    let about = About { program: "cairn test".into(), sensor: SensorMode::Stereo, camera: camera() };
    let attached = BTreeMap::from([("way/home".to_owned(), b"{\"format\":1}\n".repeat(3))]);
    MapFile { snapshot: snapshot(seed, steps, features), about, attached }
}

/// Everything visible of a snapshot as text, including the features with their lookup grid.
pub fn described(snapshot: &Snapshot) -> String {
    let key_frames: Vec<String> = snapshot.key_frames().map(|k| format!("{k:?}")).collect();
    let landmarks: Vec<String> = snapshot.landmarks().map(|l| format!("{l:?}")).collect();
    let maps: Vec<_> =
        snapshot.maps().map(|(id, prior)| (id, prior, snapshot.is_gravity_aligned(id))).collect();
    let ancestors: Vec<_> = (0..snapshot.next_key_frame_id().index())
        .map(|i| snapshot.surviving_ancestor(KeyFrameId::from_index(i).unwrap()))
        .collect();
    let next = (snapshot.next_key_frame_id(), snapshot.next_landmark_id());
    let names: Vec<_> =
        (0..next.0.index()).map(|i| snapshot.key_frame_name(KeyFrameId::from_index(i).unwrap())).collect();
    let landmark_names: Vec<_> = snapshot.landmarks().map(|l| snapshot.landmark_name(l.id)).collect();
    let names = (names, landmark_names);
    let places: Vec<_> =
        snapshot.key_frames().map(|k| snapshot.places().query(&k.bag, 9, |_| true)).collect();
    let all = (
        places,
        names,
        snapshot.version(),
        snapshot.octaves(),
        snapshot.right_offset(),
        next,
        maps,
        ancestors,
    );
    format!("{all:?}\n{}\n{}", key_frames.join("\n"), landmarks.join("\n"))
}

/// A factor of some readings, since its parent, for each key frame that moves.
pub fn with_readings(snapshot: &Snapshot, noise: ImuNoise) -> Snapshot {
    let factor = |k: &KeyFrame| {
        let bias = k.motion.as_ref()?.bias;
        let reading = |i: i64| ImuSample {
            noise_scale: if i == 2 { 4.0 } else { 1.0 },
            ..ImuSample::new(
                Stamp(k.stamp.0 + i * 5_000_000),
                Vec3::new(0.25, 0.5, i as f64 / 8.0),
                Vec3::new(9.75, k.id.index() as f64 / 64.0, -0.5),
            )
        };
        let samples = (0..3 + k.id.index() as i64 % 4).map(reading).collect();
        let sum = Arc::new(Preintegrated::of(noise, bias, samples));
        Some(Change::ImuFactor(k.id, Some(ImuFactor { since: k.parent?, sum })))
    };
    let changes = snapshot.key_frames().filter_map(factor).collect();
    snapshot.apply(&ChangeSet { base: snapshot.version(), changes }).0
}

/// Asserts that two snapshots are equal in everything visible; reports only the first difference.
#[track_caller]
pub fn same(a: &Snapshot, b: &Snapshot, what: &str) {
    let (a, b) = (described(a), described(b));
    if let Some((x, y)) = a.lines().zip(b.lines()).find(|(x, y)| x != y) {
        let at = x.bytes().zip(y.bytes()).take_while(|(x, y)| x == y).count().saturating_sub(60);
        let end = |line: &str| line.chars().skip(at).take(160).collect::<String>();
        panic!("{what}: {} where {} should be", end(x), end(y));
    }
    assert_eq!(a.lines().count(), b.lines().count(), "{what}");
}
