//! Surfaces follow the map: after any history of changes they are those fused afresh from the final poses.

use cairn_atlas::store::{About, MapFile};
use cairn_atlas::{Atlas, Change, KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_dense::{
    DepthConfig, DepthPreparer, Mesh, MeshConfig, Mesher, OccupancyConfig, SubmapConfig, TsdfConfig,
    TsdfVolume,
};
use cairn_engine::{DenseMapper, Host, saved_dense_map};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_sensor::{Camera, DepthImage, Stamp};
use cairn_vision::{Frame, RectifiedCamera};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

#[path = "../../../dense/tests/suite/wall/mod.rs"]
mod wall;
use wall::{BACK_M, FRONT_M, STEP_X_M, VOXEL_M, camera, config, pose};

/// What the depth sensor beside a camera at `x` sees.
fn seen(x: f64) -> DepthImage {
    wall::wall(x + mounted().translation.x)
}

/// The camera of the depth sensor beside that of the key frames.
fn mounted() -> Se3 {
    Se3::new(So3::identity(), Vec3::new(0.05, 0.0, 0.0))
}

#[derive(Clone, Debug)]
enum Event {
    Add { parent: Option<usize>, x: f64, depth: bool },
    Move(Vec<[f64; 3]>),
    Merge([f64; 3]),
    Align([f64; 3]),
    Remove(usize),
    Step(usize),
}

fn event() -> impl Strategy<Value = Event> {
    let small = || [-0.04f64..0.04, -0.04f64..0.04, -0.05f64..0.05];
    let parent = prop::option::weighted(0.85, 0usize..40);
    prop_oneof![
        5 => (parent, -1.0f64..3.0, prop::bool::weighted(0.9)).prop_map(|(parent, x, depth)| Event::Add { parent, x, depth }),
        2 => proptest::collection::vec(small(), 1..6).prop_map(Event::Move),
        1 => small().prop_map(Event::Merge),
        1 => small().prop_map(Event::Align),
        1 => (0usize..20).prop_map(Event::Remove),
        2 => (1usize..6).prop_map(Event::Step),
    ]
}

fn ids(snapshot: &Snapshot) -> Vec<KeyFrameId> {
    snapshot.key_frames().map(|k| k.id).collect()
}

/// The changes of an event on a snapshot; some commits hold several kinds, as those of mapping do.
fn changes(event: &Event, snapshot: &Snapshot) -> Vec<Change> {
    let ids = ids(snapshot);
    let maps: Vec<MapId> = snapshot.maps().map(|(m, _)| m).collect();
    match event {
        Event::Add { parent, x, .. } => {
            let id = snapshot.next_key_frame_id();
            let parent = parent.filter(|_| !ids.is_empty()).map(|p| ids[p % ids.len()]);
            let mut frame = Frame::default();
            frame.stamp = Stamp(id.index() as i64 + 1);
            let key_frame = KeyFrame::new(id, Arc::new(frame), pose(*x, [0.0; 3]), parent);
            vec![Change::AddKeyFrame(Box::new(key_frame))]
        }
        Event::Move(by) => (ids.iter().zip(by.iter().cycle()))
            .filter_map(|(id, w)| {
                let at = snapshot.key_frame(*id)?.world_from_camera;
                Some(Change::MoveKeyFrame(*id, at * pose(w[2], *w)))
            })
            .collect(),
        Event::Merge(w) if maps.len() > 1 => {
            let (from, into) = (maps[1], maps[0]);
            let moved = snapshot
                .key_frame(from.root())
                .map(|k| Change::MoveKeyFrame(k.id, k.world_from_camera * pose(0.02, *w)));
            let p = pose(0.3, *w);
            let into_from = Sim3::new(p.rotation, p.translation, 1.0);
            let merge = Change::Merge { from, into, into_from, parent: into.root() };
            moved.into_iter().chain([merge]).collect()
        }
        Event::Align(w) if !maps.is_empty() => {
            let p = pose(0.0, *w);
            vec![Change::AlignGravity(maps[0], Sim3::new(p.rotation, p.translation, 1.0))]
        }
        Event::Remove(n) if !ids.is_empty() => {
            let id = ids[n % ids.len()];
            let at = snapshot.key_frame(id).map_or_else(Se3::identity, |k| k.world_from_camera);
            vec![Change::MoveKeyFrame(id, at * pose(0.03, [0.0, 0.02, 0.0])), Change::RemoveKeyFrame(id)]
        }
        _ => Vec::new(),
    }
}

/// The distance that a share of the vertices has at most to the nearest of others, in metres, looked for within three
/// voxels.
fn distance_of(share: f64, from: &[Vec3], to: &[Vec3]) -> f64 {
    let cell = |p: &Vec3| [p.x, p.y, p.z].map(|v| (v / (3.0 * VOXEL_M)).floor() as i32);
    let mut cells: BTreeMap<[i32; 3], Vec<Vec3>> = BTreeMap::new();
    to.iter().for_each(|p| cells.entry(cell(p)).or_default().push(*p));
    let near = |p: &Vec3| {
        let c = cell(p);
        let around = (0..27).map(|i| [c[0] + i % 3 - 1, c[1] + i / 3 % 3 - 1, c[2] + i / 9 - 1]);
        let all = around.filter_map(|k| cells.get(&k)).flatten();
        all.map(|q| (q - p).norm()).fold(3.0 * VOXEL_M, f64::min)
    };
    let mut all: Vec<f64> = from.iter().map(near).collect();
    all.sort_by(f64::total_cmp);
    let last = all.len().saturating_sub(1);
    all.get((last as f64 * share) as usize).copied().unwrap_or(0.0)
}

fn vertices(volume: &TsdfVolume) -> Vec<Vec3> {
    places(&Mesher::new(MeshConfig::of_key_frames()).whole(volume))
}

fn places(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().map(|p| Vec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]))).collect()
}

/// A map with a history, and what follows it.
struct Followed {
    atlas: Atlas,
    mapper: DenseMapper,
    /// Key frames with depth, and where they truly were.
    fused: Vec<(KeyFrameId, f64)>,
}

impl Followed {
    fn through(events: &[Event]) -> Self {
        let mut atlas = Atlas::new(Snapshot::new());
        let from = atlas.subscribe();
        let mapper = DenseMapper::following(from, camera(), 0.001, mounted(), config()).expect("a camera");
        let mut all = Self { atlas, mapper, fused: Vec::new() };
        all.go(events);
        all
    }

    fn go(&mut self, events: &[Event]) {
        for event in events {
            let snapshot = self.atlas.latest().clone();
            let id = snapshot.next_key_frame_id();
            if let Event::Add { x, depth: true, .. } = event {
                self.mapper.offer(Stamp(id.index() as i64 + 1), Arc::new(seen(*x)), None);
                self.fused.push((id, *x));
            }
            self.atlas.commit(changes(event, &snapshot));
            if let Event::Step(n) = event {
                self.mapper.follow();
                self.mapper.step(&Vec3::zeros(), *n);
            }
        }
    }

    /// Follows to the end, with the work that waits.
    fn finish(&mut self) {
        self.mapper.follow();
        for _ in 0..10_000 {
            if self.mapper.step(&Vec3::zeros(), 50).waiting == 0 {
                return;
            }
        }
        panic!("the work does not end");
    }

    /// The depth of a map, fused with the poses that its key frames have in the latest snapshot.
    fn fresh(&self, map: MapId) -> Vec<Vec3> {
        let snapshot = self.atlas.latest();
        let mut preparer = DepthPreparer::new(DepthConfig::default(), camera(), 0.001).expect("a camera");
        // The truncation distance is that of whole maps: no wider than a thin wall.
        let tsdf = config().tsdf;
        let band_voxels = tsdf.band_voxels.min((0.1 / tsdf.voxel_m).max(2.5));
        let mut fresh = TsdfVolume::new(TsdfConfig { band_voxels, ..tsdf }).expect("in range");
        for (id, x) in &self.fused {
            let alive = snapshot.surviving_ancestor(*id).and_then(|(id, _)| snapshot.key_frame(id));
            if alive.is_some_and(|k| k.map == map) {
                let pose = snapshot.resolve(*id, &mounted()).expect("an anchor");
                fresh.integrate(preparer.prepare(&seen(*x)).expect("depth"), None, &pose).expect("a pose");
            }
        }
        vertices(&fresh)
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn any_history_of_the_map_ends_as_if_fused_afresh(events in proptest::collection::vec(event(), 8..30)) {
        let mut all = Followed::through(&events);
        all.finish();
        prop_assert_eq!(all.mapper.counts().key_frames, all.fused.len());
        prop_assert_eq!(all.mapper.counts().refused, 0);
        for (map, _) in all.atlas.latest().clone().maps() {
            let fresh = all.fresh(map);
            let whole = places(&all.mapper.surface(map, config().tsdf).expect("poses"));
            prop_assert!(distance_of(1.0, &whole, &fresh) < 0.1 * VOXEL_M, "surface");
            prop_assert!(distance_of(1.0, &fresh, &whole) < 0.1 * VOXEL_M, "holes");
        }
    }

    /// Whatever the poses went through, once they are right the submaps show one wall, where it is, and all of it.
    #[test]
    fn submaps_recover_from_any_poses(events in proptest::collection::vec(event(), 8..30)) {
        let events: Vec<Event> = events.into_iter().filter(|e| !matches!(e, Event::Remove(_))).collect();
        let mut all = Followed::through(&events);
        let right = all.fused.iter().map(|(id, x)| Change::MoveKeyFrame(*id, pose(*x, [0.0; 3]))).collect();
        all.atlas.commit(right);
        all.finish();
        for (map, _) in all.atlas.latest().clone().maps() {
            let fresh = all.fresh(map);
            let submaps = all.mapper.map().submaps().filter(|s| s.map.0 == map.root().index() as u64);
            let live: Vec<Vec3> =
                submaps.flat_map(|s| vertices(s.tsdf.expect("room for all")).into_iter().map(move |p| s.world_from_submap * p)).collect();
            // Behind the edge of the step a field is a mean of the wall and of the free space beside it, which depends
            // on where its voxels lie: also fused afresh it strays there by 1.7 voxels.
            let missing = distance_of(1.0, &beside_step(&fresh), &live);
            prop_assert!(missing < VOXEL_M, "a hole: {missing} m from what was fused afresh to the next vertex");
            let stray = |of: &[Vec3]| of.iter().map(off_wall).fold(0.0, f64::max);
            let (off, at_step) = (stray(&beside_step(&live)), stray(&live));
            prop_assert!(off < 0.5 * VOXEL_M, "doubled or left behind: a vertex {off} m from the wall");
            prop_assert!(at_step < 3.0 * VOXEL_M, "doubled or left behind: a vertex {at_step} m from the step");
        }
    }
}

/// A file of the map with the depth of all key frames, written and read.
fn saved(all: &mut Followed) -> MapFile {
    let snapshot = (**all.atlas.latest()).clone();
    let depth = all.mapper.to_save(&snapshot);
    let camera = RectifiedCamera {
        fx: 450.0,
        fy: 450.0,
        cx: 320.0,
        cy: 240.0,
        baseline_fx: 45.0,
        bounds: [0.0, 0.0, 640.0, 480.0],
        close_depth: 4.0,
        body_from_camera: Se3::identity(),
    };
    let about = About { program: "a test".into(), sensor: cairn_engine::SensorMode::Rgbd, camera };
    let mut file = MapFile { snapshot, about, attached: BTreeMap::new() };
    file.add_depth(&depth);
    MapFile::read(&file.write().expect("it fits")).expect("as written")
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 16, ..ProptestConfig::default() })]

    /// A map that is saved after any history, loaded and continued ends as one that was never saved.
    #[test]
    fn a_saved_map_goes_on(
        before in proptest::collection::vec(event(), 4..20),
        after in proptest::collection::vec(event(), 0..10),
    ) {
        let mut all = Followed::through(&before);
        let mut file = saved(&mut all);
        let (mut whole, restored) = match saved_dense_map(&file, config()) {
            Ok(loaded) => loaded,
            Err(e) => {
                prop_assert!(all.fused.is_empty(), "{}", e);
                return Ok(());
            }
        };
        prop_assert_eq!((restored.images, restored.lost, restored.other_camera), (all.fused.len(), 0, 0));
        for (map, _) in file.snapshot.clone().maps() {
            let id = cairn_dense::MapId(map.root().index() as u64);
            let of_file = in_order(places(&whole.surface(id, config().tsdf, MeshConfig::of_key_frames()).expect("poses")));
            let live = in_order(places(&all.mapper.surface(map, config().tsdf).expect("poses")));
            prop_assert!(of_file == live, "{} vertices of {}", of_file.len(), live.len());
        }
        let parts = file.take_depth().expect("as written");
        let mut atlas = Atlas::new(file.snapshot);
        let mut mapper =
            DenseMapper::following(atlas.subscribe(), camera(), 0.001, mounted(), config()).expect("a camera");
        let (restored, others) = mapper.restore(parts.clone());
        prop_assert_eq!((restored.images, others.len()), (all.fused.len(), 0));
        let mut on = Followed { atlas, mapper, fused: all.fused.clone() };
        on.go(&after);
        on.finish();
        for (map, _) in on.atlas.latest().clone().maps() {
            let fresh = on.fresh(map);
            let surface = places(&on.mapper.surface(map, config().tsdf).expect("poses"));
            prop_assert!(distance_of(1.0, &surface, &fresh) < 0.1 * VOXEL_M, "surface");
            prop_assert!(distance_of(1.0, &fresh, &surface) < 0.1 * VOXEL_M, "holes");
        }
        // Another depth camera leaves the parts as they are.
        let other = Camera { fx: 71.0, ..camera() };
        let mut mapper =
            DenseMapper::following(on.atlas.subscribe(), other, 0.001, mounted(), config()).expect("a camera");
        let (none, others) = mapper.restore(parts.clone());
        prop_assert_eq!((none.images, none.other_camera, others), (0, all.fused.len(), parts));
    }
}

/// Vertices sorted: their order is that in which images were fused.
fn in_order(mut of: Vec<Vec3>) -> Vec<Vec3> {
    of.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    of
}

/// The vertices that are not at the step.
fn beside_step(of: &[Vec3]) -> Vec<Vec3> {
    of.iter().filter(|p| (p.x - STEP_X_M).abs() > 3.0 * VOXEL_M).copied().collect()
}

/// Distance from the true wall, in metres.
fn off_wall(p: &Vec3) -> f64 {
    let over = |v: f64| v.max(0.0);
    let back = (p.z - BACK_M).hypot(over(p.x - STEP_X_M));
    let front = (p.z - FRONT_M).hypot(over(STEP_X_M - p.x));
    let side = (p.x - STEP_X_M).hypot(over(FRONT_M - p.z).max(over(p.z - BACK_M)));
    back.min(front).min(side)
}

#[test]
fn a_rig_without_depth_is_refused() {
    use cairn_engine::{Config, DenseSetupError, Engine, Runner, SensorMode};
    let rig = cairn_sensor::Rig::mono(Camera::pinhole(640, 480, 500.0, 500.0, 320.0, 240.0));
    let mut engine =
        Engine::new(&rig, SensorMode::Mono, 30.0, Runner::Lockstep, &Config::default(), &Host::bare())
            .expect("a rig");
    let refused = DenseMapper::new(&mut engine, &rig, SubmapConfig::default()).err();
    assert_eq!(refused, Some(DenseSetupError::NoDepth));
}
