//! Saved maps of two walks through one simulated place become one map; those of different places stay apart.

use cairn::geometry::{Se3, Vec3, umeyama};
use cairn::sensor::Stamp;
use cairn::{Config, MergedMaps, Slam, map_file, merge_maps, open};
use cairn_atlas::store::MapFile;
use cairn_atlas::store::pieces::{self, Pieces};
use cairn_atlas::{Change, ChangeSet, KeyFrame};
use std::collections::BTreeMap;

/// Small images, so that a walk takes a second or two.
const SMALL: &str = "resolution=320x240&rate=10&detail=0.5";

/// A walk: its map, and the true pose of the body at each time.
struct Walk {
    file: MapFile,
    truth: BTreeMap<Stamp, Se3>,
}

fn walk(world: &str, options: &str) -> Walk {
    let mut source = open(&format!("sim:{world}?{SMALL}&{options}")).expect("a world");
    let mut slam = Slam::for_source(&*source).build().expect("it can be built");
    while let Some(frame) = source.next_packet().expect("a simulated world can be read") {
        slam.track(&frame).expect("a frame in order");
    }
    slam.finish();
    let truth = source.info().truth.iter().copied().collect();
    let file = map_file(slam.session(), &BTreeMap::new()).expect("a map with key frames");
    Walk { file, truth }
}

fn merge(walks: &[&Walk]) -> MergedMaps {
    let files = walks.iter().enumerate().map(|(n, w)| (format!("{n}.map"), w.file.clone())).collect();
    let merged = merge_maps(files, &Config::default()).expect("the same camera");
    merged.file.snapshot.check().expect("a sound map");
    merged
}

/// Root mean square error of the positions of all key frames, or only those of one walk, aligned by SE3.
fn ate(file: &MapFile, walks: &[&Walk], only: Option<usize>) -> f64 {
    compared(file, walks, only, false).0
}

/// Metres in a metre of the map, by the truth of all key frames.
fn scale(file: &MapFile, walks: &[&Walk]) -> f64 {
    compared(file, walks, None, true).1
}

/// The standard deviation of that which the first map states.
fn sigma(file: &MapFile) -> Option<f64> {
    let (map, _) = file.snapshot.maps().next()?;
    file.snapshot.scale_of(map, &file.about.camera).metric_sigma()
}

/// Root mean square error and scale of the alignment, with scale or without.
fn compared(file: &MapFile, walks: &[&Walk], only: Option<usize>, with_scale: bool) -> (f64, f64) {
    let (mut estimated, mut true_ones) = (Vec::new(), Vec::new());
    let mut first = 0;
    for (n, w) in walks.iter().enumerate() {
        let next = first + w.file.snapshot.next_key_frame_id().index();
        let of = |index: usize| (first..next).contains(&index) && only.is_none_or(|only| only == n);
        for k in file.snapshot.key_frames().filter(|k| of(k.id.index())) {
            let truth = w.truth.get(&k.stamp).expect("a true pose at each frame");
            estimated.push(k.world_from_camera.translation);
            true_ones.push((*truth * file.about.camera.body_from_camera).translation);
        }
        first = next;
    }
    let fit = umeyama(&true_ones, &estimated, with_scale).expect("a walk is not a straight line");
    let squares: f64 =
        estimated.iter().zip(&true_ones).map(|(e, t): (&Vec3, &Vec3)| (fit * *e - *t).norm_squared()).sum();
    ((squares / estimated.len() as f64).sqrt(), fit.scale)
}

#[test]
fn two_walks_of_one_house_become_one_map_and_get_no_worse() {
    // The ceiling of the error of both together is a tenth above what was measured.
    for (seed, sensor, ceiling_m) in [(5, "rgbd", 0.0165), (6, "stereo", 0.0195), (9, "rgbd", 0.028)] {
        let common = format!("seed={seed}&sensor={sensor}");
        let a = walk("demo", &format!("{common}&duration=24"));
        let b = walk("demo", &format!("{common}&start=9&duration=16&speed=1.05&height=1.4"));
        let merged = merge(&[&a, &b]);
        let [attempt] = &merged.attempts[..] else { panic!("{:?}", merged.attempts) };
        let junction = attempt.join.result.as_ref().unwrap_or_else(|apart| panic!("seed {seed}: {apart}"));
        let own = [&a, &b].map(|w| ate(&w.file, &[w], None));
        let both = ate(&merged.file, &[&a, &b], None);
        let parts = [0, 1].map(|n| ate(&merged.file, &[&a, &b], Some(n)));
        println!(
            "seed {seed} {sensor}: {} seams, {} left out, {:?}, rms {:.3} m, after {:.3} m; ATE alone {own:.3?} m, merged {parts:.3?} m, both {both:.3} m",
            junction.seams.len(),
            junction.left_out,
            junction.support,
            junction.rms,
            junction.rms_after
        );
        assert_eq!(merged.file.snapshot.maps().count(), 1);
        assert!(both <= ceiling_m, "seed {seed}: {both} of {own:?}");
        assert!((0..2).all(|n| parts[n] <= 1.2 * own[n]), "seed {seed}: {parts:?} of {own:?}");
    }
}

fn without_readings(walk: &Walk) -> Walk {
    let snapshot = walk.file.snapshot.without_imu_factors();
    Walk { file: MapFile { snapshot, ..walk.file.clone() }, truth: walk.truth.clone() }
}

/// The map as the robots of a team send it.
fn sent(walk: &Walk) -> Walk {
    let mut pieces = Pieces::default();
    pieces.add(&walk.file).expect("in memory");
    let n = walk.file.snapshot.key_frame_count();
    let [all, imu] = [pieces.bytes().len(), pieces.parts().expect("whole").imu].map(|bytes| bytes / n);
    println!("{all} B a key frame sent; before packing {imu} B of the IMU");
    assert!(imu < 1_000, "{imu} B a key frame");
    Walk { file: pieces::read(pieces.bytes()).expect("whole pieces"), truth: walk.truth.clone() }
}

/// The same map with the motions and readings of another file of it.
fn with_readings_of(walk: &Walk, other: &MapFile) -> Walk {
    let of = |k: &KeyFrame| {
        let motion = k.motion.as_ref()?;
        let readings = motion.imu_factor.clone().map(|f| Change::ImuFactor(k.id, Some(f)));
        let state = Change::InertialState(k.id, motion.velocity, motion.bias);
        Some([Some(state), readings].into_iter().flatten())
    };
    let changes = other.snapshot.key_frames().filter_map(of).flatten().collect();
    let base = walk.file.snapshot.version();
    let snapshot = walk.file.snapshot.apply(&ChangeSet { base, changes }).0;
    Walk { file: MapFile { snapshot, ..walk.file.clone() }, truth: walk.truth.clone() }
}

/// Two parts of a walk with one camera and an IMU that were mapped apart. Files keep what the IMU measured between key frames and how
/// the camera is mounted on it, so that the joined map is adjusted with it.
#[test]
fn maps_of_one_camera_with_imu_are_joined_with_what_it_measured() {
    let sensor = "sensor=mono-imu&resolution=480x360&focal=270&rate=20";
    let seed = 5;
    let common = format!("seed={seed}&{sensor}");
    let parts = [
        walk("demo", &format!("{common}&duration=22")),
        walk("demo", &format!("{common}&start=9&duration=20")),
    ];
    let saved = parts.each_ref().map(|w| {
        let file = MapFile::read(&w.file.write().expect("in memory")).expect("what was written");
        Walk { file, truth: w.truth.clone() }
    });
    let bare = saved.each_ref().map(without_readings);
    let sent = saved.each_ref().map(sent);
    let links = |w: &Walk| {
        let with_factor = |k: &&KeyFrame| k.motion.as_ref().is_some_and(|m| m.imu_factor.is_some());
        w.file.snapshot.key_frames().filter(with_factor).count()
    };
    assert_eq!(sent.each_ref().map(links), saved.each_ref().map(links));
    assert!(sent.iter().all(|w| links(w) > 20));
    let of_sent = [0, 1].map(|n| with_readings_of(&saved[n], &sent[n].file));
    let bare_sent = sent.each_ref().map(without_readings);
    let errors = [&bare, &saved, &of_sent, &bare_sent, &sent].map(|walks| {
        let walks = walks.each_ref();
        let merged = merge(&walks);
        let [attempt] = &merged.attempts[..] else { panic!("{:?}", merged.attempts) };
        let junction = attempt.join.result.as_ref().unwrap_or_else(|apart| panic!("seed {seed}: {apart}"));
        let (both, scale) = (ate(&merged.file, &walks, None), scale(&merged.file, &walks));
        println!("seed {seed}: ATE {both:.4} m, scale {scale:.4}, {:?}", junction.scales);
        (both, scale)
    });
    let alone = saved.each_ref().map(|w| (ate(&w.file, &[w], None), scale(&w.file, &[w]), sigma(&w.file)));
    println!("seed {seed}: alone (ATE, scale, sigma) {alone:.4?}");
    // Images alone let the scale of a map of one camera go.
    let [without, with, of_sent, without_sent, with_sent] = errors.map(|(ate, _)| ate);
    assert!(with < 0.7 * without, "seed {seed}: {with} of {without} m");
    // Readings that robots send do the same, also with what else they send.
    assert!((of_sent / with - 1.0).abs() < 0.05, "seed {seed}: {of_sent} of {with} m");
    assert!(with_sent < 0.8 * without_sent, "seed {seed}: {with_sent} of {without_sent} m");
    // Ceilings a tenth above what was measured. Each half alone, of twenty seeds of this walk, has 0.024 m in the mean since the last
    // seconds are adjusted together, and had 0.027 before; of this seed the first half was better before (0.011, now 0.022).
    assert!(with < 0.035 && with_sent < 0.036, "seed {seed}: {with} m, of what is sent {with_sent} m");
    assert!(without_sent < 0.047, "seed {seed}: {without_sent} m of what is sent, by images");
}

#[test]
fn different_houses_stay_apart() {
    for seed in 1..=3 {
        let house = |seed: usize| walk("demo", &format!("seed={seed}&sensor=rgbd&duration=14"));
        let merged = merge(&[&house(seed), &house(seed + 10)]);
        assert!(merged.attempts.iter().all(|a| a.join.result.is_err()), "seed {seed}: {:?}", merged.attempts);
        assert_eq!(merged.file.snapshot.maps().count(), 2);
    }
}

/// An office in which all rooms on one side are the same, walked by three people, each in another room and a piece of
/// the corridor: what is joined is joined where it is.
#[test]
fn rooms_that_look_alike_are_never_joined_wrongly() {
    for seed in 1..=2 {
        let office = format!("seed={seed}&sensor=rgbd&look_alike=1&duration=26");
        let walks = [0, 26, 52].map(|start| walk("office", &format!("{office}&start={start}")));
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            let pair = [&walks[a], &walks[b]];
            let merged = merge(&pair);
            match &merged.attempts[0].join.result {
                Err(apart) => println!("seed {seed}, parts {a} and {b}: {apart}"),
                Ok(_) => {
                    let both = ate(&merged.file, &pair, None);
                    assert!(both < 0.1, "seed {seed}, parts {a} and {b}: joined wrongly, ATE {both} m");
                }
            }
        }
    }
}
