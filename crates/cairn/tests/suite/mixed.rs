//! Robots with different cameras and sensors walk through one simulated house: their saved maps become one, in metres, and each
//! key frame keeps its camera; where rooms look alike nothing is joined wrongly.

use cairn::geometry::{Se3, umeyama};
use cairn::sensor::Stamp;
use cairn::team::RobotId;
use cairn::{Config, Map, MergedMaps, Slam, map_file, merge_maps, open};
use cairn_atlas::store::pieces::{self, Pieces};
use cairn_atlas::store::{MapFile, Table};
use std::collections::BTreeMap;

/// Sensors, image size, focal length and rate of each robot: no two have the same camera.
const RGBD: &str = "sensor=rgbd&resolution=320x240&rate=10";
const STEREO: &str = "sensor=stereo&resolution=400x300&focal=300&rate=10";
const STEREO_IMU: &str = "sensor=stereo-imu&resolution=400x300&focal=300&rate=10";
const MONO_IMU: &str = "sensor=mono-imu&resolution=480x360&focal=270&rate=20";
const MONO: &str = "sensor=mono&resolution=480x360&focal=270&rate=20";

struct Walk {
    robot: RobotId,
    file: MapFile,
    /// The true pose of the body at each time.
    truth: BTreeMap<Stamp, Se3>,
}

fn walk(robot: RobotId, world: &str, options: &str) -> Walk {
    let mut source = open(&format!("sim:{world}?detail=0.5&{options}")).expect("a world");
    let config = Config { robot, ..Config::default() };
    let mut slam = Slam::for_source(&*source).config(&config).build().expect("it can be built");
    while let Some(frame) = source.next_packet().expect("a simulated world can be read") {
        slam.track(&frame).expect("a frame in order");
    }
    slam.finish();
    let truth = source.info().truth.iter().copied().collect();
    let file = map_file(slam.session(), &BTreeMap::new()).expect("a map with key frames");
    Walk { robot, file, truth }
}

fn merge(walks: &[&Walk]) -> MergedMaps {
    merge_as(walks, MapFile::clone)
}

/// The map as the robots of a team send it.
fn sent(file: &MapFile) -> MapFile {
    let mut pieces = Pieces::default();
    pieces.add(file).expect("in memory");
    pieces::read(pieces.bytes()).expect("whole pieces")
}

fn merge_as(walks: &[&Walk], what: impl Fn(&MapFile) -> MapFile) -> MergedMaps {
    merge_by(walks, what, &Config::default())
}

/// Joined by images alone.
fn merge_by_images(walks: &[&Walk]) -> MergedMaps {
    let mut config = Config::default();
    config.inertial.whole_key_frames = 0;
    merge_by(walks, MapFile::clone, &config)
}

fn merge_by(walks: &[&Walk], what: impl Fn(&MapFile) -> MapFile, config: &Config) -> MergedMaps {
    let files = walks.iter().map(|w| (format!("robot {}", w.robot), what(&w.file))).collect();
    let merged = merge_maps(files, config).expect("they fit");
    merged.file.snapshot.check().expect("a sound map");
    merged
}

/// Root mean square error of the positions of the cameras of all key frames of the largest map, or of those of one robot,
/// aligned by SE3, or by Sim3, and the scale of that.
fn ate(file: &MapFile, walks: &[&Walk], only: Option<RobotId>, with_scale: bool) -> (f64, f64) {
    let (mut estimated, mut truth) = (Vec::new(), Vec::new());
    let largest = Map::of_file(file).largest().expect("a map");
    for k in file.snapshot.key_frames_of(largest) {
        let robot = file.snapshot.key_frame_name(k.id).robot;
        if only.is_none_or(|only| only == robot) {
            let walk = walks.iter().find(|w| w.robot == robot).expect("its walk");
            let body = walk.truth.get(&k.stamp).expect("a true pose at each frame");
            estimated.push(k.world_from_camera.translation);
            truth.push((*body * k.camera(&file.about.camera).body_from_camera).translation);
        }
    }
    let fit = umeyama(&truth, &estimated, with_scale).expect("a walk is not a straight line");
    let squares: f64 = estimated.iter().zip(&truth).map(|(e, t)| (fit * *e - *t).norm_squared()).sum();
    ((squares / estimated.len() as f64).sqrt(), fit.scale)
}

/// Walks that share 10 m and more in the same direction, at other speeds and heights.
fn house(seed: u64, sensors: [&str; 3]) -> Vec<Walk> {
    let ways =
        ["duration=24", "start=6&duration=16&speed=1.05&height=1.4", "start=3&duration=18&height=1.45"];
    let one = |(robot, (sensor, way))| walk(robot, "demo", &format!("seed={seed}&{sensor}&{way}"));
    (1..).zip(sensors.into_iter().zip(ways)).map(one).collect()
}

/// What came of the walks of a house.
struct Joint {
    merged: MergedMaps,
    /// Errors of each alone, and of its own key frames in the joint map, metres.
    alone: Vec<f64>,
    parts: Vec<f64>,
    /// The error of all in one map, metres, and its scale.
    all: f64,
    scale: f64,
    /// The error of all, joined from what robots send of their maps, metres.
    all_of_sent: f64,
}

impl Joint {
    fn best(&self) -> f64 {
        self.alone.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The error of the key frames of each robot, times that which it had alone.
    fn times_alone(&self) -> impl Iterator<Item = f64> {
        self.parts.iter().zip(&self.alone).map(|(part, alone)| part / alone)
    }
}

/// Prints what a robot sends of its map, and how much of that is what an IMU measured.
fn bytes_of(walk: &Walk) {
    let (mut with, mut without) = (Pieces::default(), Pieces::default());
    with.add(&walk.file).expect("in memory");
    let snapshot = walk.file.snapshot.without_imu_factors();
    without.add(&MapFile { snapshot, ..walk.file.clone() }).expect("in memory");
    let n = walk.file.snapshot.key_frame_count();
    println!(
        "  robot {}: {n} key frames, {} B each sent, {} without readings; before packing {} B of the IMU",
        walk.robot,
        with.bytes().len() / n,
        without.bytes().len() / n,
        with.parts().expect("whole").imu / n
    );
}

/// Merges the walks of a house and prints what came of it.
fn merged(seed: u64, walks: &[Walk]) -> Joint {
    let all: Vec<&Walk> = walks.iter().collect();
    let merged = merge(&all);
    let file = &merged.file;
    let alone = walks.iter().map(|w| {
        let metric = Map::of_file(&w.file).maps().all(|map| Map::of_file(&w.file).is_metric(map));
        ate(&w.file, &[w], None, !metric).0
    });
    let alone: Vec<f64> = alone.collect();
    let parts: Vec<f64> = walks.iter().map(|w| ate(file, &all, Some(w.robot), false).0).collect();
    let (both, (free, scale)) = (ate(file, &all, None, false).0, ate(file, &all, None, true));
    let best = alone.iter().copied().fold(f64::INFINITY, f64::min);
    println!(
        "seed {seed}: {} maps, {} cameras; ATE alone {alone:.3?} m, in the atlas {parts:.3?} m, all {both:.3} m, {:.3} times \
         the best; scale free {free:.3} m, scale {scale:.4}",
        file.snapshot.maps().count(),
        1 + file.snapshot.other_cameras().count(),
        both / best
    );
    walks.iter().for_each(bytes_of);
    let of_sent = merge_as(&all, sent).file;
    let sent_both = ate(&of_sent, &all, None, false).0;
    println!(
        "  as they are sent: {} maps, all {sent_both:.3} m, {:.3} times the best",
        of_sent.snapshot.maps().count(),
        sent_both / best
    );
    assert_eq!(of_sent.snapshot.maps().count(), file.snapshot.maps().count());
    for a in &merged.attempts {
        match &a.join.result {
            Ok(j) => println!(
                "  {} into {}: {} seams, {} left out, {:?}, scale {:.4}, rms {:.3}, {:.3} after",
                a.from.name,
                a.into.name,
                j.seams.len(),
                j.left_out,
                j.support,
                j.into_from.scale,
                j.rms,
                j.rms_after
            ),
            Err(apart) => println!("  {} and {}: {apart}", a.from.name, a.into.name),
        }
    }
    Joint { merged, alone, parts, all: both, scale, all_of_sent: sent_both }
}

/// The camera that each key frame has is that of the robot that made it.
fn check_cameras(file: &MapFile, walks: &[&Walk]) {
    for k in file.snapshot.key_frames() {
        let robot = file.snapshot.key_frame_name(k.id).robot;
        let own = walks.iter().find(|w| w.robot == robot).expect("its walk").file.about.camera;
        let camera = k.camera(&file.about.camera);
        assert_eq!((camera.fx, camera.bounds), (own.fx, own.bounds), "key frame of robot {robot}");
        assert_eq!(camera.has_depth(), own.has_depth());
    }
}

#[test]
fn three_sensors_share_one_map_in_metres_that_is_as_good_as_the_best() {
    for (seed, sensors) in [(5, [RGBD, STEREO, MONO_IMU]), (3, [MONO, STEREO_IMU, RGBD])] {
        let walks = house(seed, sensors);
        let all: Vec<&Walk> = walks.iter().collect();
        let joint = merged(seed, &walks);
        let (file, both, scale) = (&joint.merged.file, joint.all, joint.scale);
        assert_eq!(file.snapshot.maps().count(), 1, "seed {seed}: {:?}", joint.merged.attempts);
        assert_eq!(file.snapshot.other_cameras().count(), 2);
        assert!(file.snapshot.is_metric(&file.about.camera));
        assert!((scale - 1.0).abs() < 0.005, "seed {seed}: scale {scale}");
        assert!(both <= 1.2 * joint.best(), "seed {seed}: {both} of {:?}", joint.alone);
        assert!(
            joint.times_alone().all(|times| times <= 1.2),
            "seed {seed}: a robot is worse off, {:?}",
            joint.parts
        );
        check_cameras(file, &all);
        // A landmark that is seen by two cameras holds them together.
        let cameras = |l: &cairn_atlas::Landmark| {
            let of = |o: &cairn_atlas::Observation| file.snapshot.key_frame_name(o.key_frame).robot;
            l.observations.iter().map(of).collect::<std::collections::BTreeSet<_>>().len()
        };
        assert!(file.snapshot.landmarks().filter(|l| cameras(l) == 3).count() > 300);
        // The file keeps all of it; of one camera it stays in the format that older programs read.
        let bytes = file.write().expect("it can be written");
        assert_eq!(Table::read(&bytes).unwrap().version, 5);
        let again = MapFile::read(&bytes).expect("it can be read");
        check_cameras(&again, &all);
        assert_eq!(ate(&again, &all, None, false), (both, 1.0));
        assert!(again.write().unwrap() == bytes, "written again it is another file");
        assert_eq!(Table::read(&walks[0].file.write().unwrap()).unwrap().version, 4);
    }
}

/// A walk that only localises in an atlas of other cameras, or why it cannot: coverage and error.
fn localised(atlas: &MapFile, options: &str) -> Result<(f64, f64), String> {
    let mut source = open(&format!("sim:demo?detail=0.5&{options}")).expect("a world");
    let built = Slam::for_source(&*source).localize_in(atlas.clone()).build();
    let mut slam = built.map_err(|e| e.to_string())?;
    while let Some(frame) = source.next_packet().expect("a simulated world can be read") {
        slam.track(&frame).expect("a frame in order");
    }
    slam.finish();
    assert_eq!(slam.map().snapshot().key_frame_count(), atlas.snapshot.key_frame_count());
    let found = slam.accuracy(&source.info().truth).expect("poses");
    Ok((found.reference_covered, found.ate_m.rmse))
}

/// A camera that made none of an atlas's key frames finds its way in it; without depth only where gravity is known.
#[test]
fn a_fourth_camera_is_localised_in_the_atlas_of_three() {
    let walks = house(5, [RGBD, STEREO, MONO_IMU]);
    let atlas = merge(&walks.iter().collect::<Vec<_>>()).file;
    let rgbd = "sensor=rgbd&resolution=360x270&focal=250&rate=10";
    for sensor in [rgbd, STEREO, MONO_IMU] {
        let (coverage, ate_m) =
            localised(&atlas, &format!("seed=5&{sensor}&start=8&duration=8&height=1.35")).unwrap();
        println!("{sensor}: coverage {coverage:.3}, ATE {ate_m:.3} m");
        assert!(coverage > 0.9 && ate_m < 0.03, "{sensor}: coverage {coverage}, ATE {ate_m} m");
    }
    let level_unknown = merge(&walks[..2].iter().collect::<Vec<_>>()).file;
    let why = localised(&level_unknown, &format!("seed=5&{MONO}&start=8&duration=2")).unwrap_err();
    assert!(why.contains("without depth needs a map that is aligned with gravity"), "{why}");
}

/// A walk in a saved map, which it continues: the map then, and coverage and error of its own poses.
fn continued(robot: RobotId, before: &MapFile, options: &str) -> (Walk, f64, f64) {
    let mut source = open(&format!("sim:demo?detail=0.5&{options}")).expect("a world");
    let config = Config { robot, ..Config::default() };
    let mut slam =
        Slam::for_source(&*source).config(&config).map(before.clone()).build().expect("it can be continued");
    while let Some(frame) = source.next_packet().expect("a simulated world can be read") {
        slam.track(&frame).expect("a frame in order");
    }
    slam.finish();
    let accuracy = slam.accuracy(&source.info().truth).expect("poses");
    let truth = source.info().truth.iter().copied().collect();
    let file = map_file(slam.session(), &BTreeMap::new()).expect("a map with key frames");
    file.snapshot.check().expect("a sound map");
    (Walk { robot, file, truth }, accuracy.reference_covered, accuracy.ate_m.rmse)
}

/// Yesterday's map goes on with another camera: new ground is added to it, in its unit and at its place; and the first camera
/// goes on in that.
fn goes_on_with(first: &str, second: &str, error_m: f64) {
    let yesterday = walk(1, "demo", &format!("seed=5&{first}&duration=12"));
    let (today, coverage, ate_m) =
        continued(2, &yesterday.file, &format!("seed=5&{second}&start=6&duration=16&height=1.4"));
    let (both, (free, scale)) = (
        ate(&today.file, &[&yesterday, &today], None, false).0,
        ate(&today.file, &[&yesterday, &today], None, true),
    );
    let maps = today.file.snapshot.maps().count();
    let added =
        today.file.snapshot.key_frame_count() as i64 - yesterday.file.snapshot.key_frame_count() as i64;
    println!(
        "{first}, then {second}: coverage {coverage:.3}, ATE {ate_m:.3} m, {added} key frames more, {maps} maps, all \
         {both:.3} m, scale free {free:.3} m, {scale:.4}"
    );
    assert!(coverage > 0.95 && ate_m < error_m, "coverage {coverage}, ATE {ate_m} m");
    assert!(maps == 1 && added > 10 && both < error_m, "{maps} maps, {added} key frames more, all {both} m");
    assert!((scale - 1.0).abs() < 0.01, "scale {scale}");
    check_cameras(&today.file, &[&yesterday, &today]);
    // What the second camera mapped is as well connected to what the first one had mapped as its own.
    let snapshot = &today.file.snapshot;
    let robot = |o: &cairn_atlas::Observation| snapshot.key_frame_name(o.key_frame).robot;
    let shared = |l: &&cairn_atlas::Landmark| {
        [1, 2].iter().all(|r| l.observations.iter().filter(|o| robot(o) == *r).count() > 1)
    };
    assert!(snapshot.landmarks().filter(shared).count() > 300);

    let saved = MapFile::read(&today.file.write().expect("it can be written")).expect("it can be read");
    let (tomorrow, coverage, ate_m) =
        continued(3, &saved, &format!("seed=5&{first}&start=16&duration=12&height=1.35"));
    let all = ate(&tomorrow.file, &[&yesterday, &today, &tomorrow], None, false).0;
    println!("  then {first}: coverage {coverage:.3}, ATE {ate_m:.3} m, all {all:.3} m");
    assert!(coverage > 0.95 && ate_m < error_m && all < error_m, "{coverage}, {ate_m} m, all {all} m");
    check_cameras(&tomorrow.file, &[&yesterday, &today, &tomorrow]);
    // The first camera is that of the atlas again, and only the second is another one.
    assert_eq!(tomorrow.file.snapshot.other_cameras().count(), 1);
}

#[test]
fn a_map_of_a_depth_camera_is_continued_by_a_stereo_pair() {
    goes_on_with(RGBD, STEREO, 0.016);
}

#[test]
fn a_map_of_a_stereo_pair_with_imu_is_continued_by_one_camera_with_imu() {
    goes_on_with(STEREO_IMU, MONO_IMU, 0.032);
}

/// A camera without depth and IMU, or a map without metres: it says why.
#[test]
fn what_cannot_be_continued_by_another_camera_is_told() {
    let first = walk(1, "demo", &format!("seed=5&{STEREO_IMU}&duration=6"));
    let source = open(&format!("sim:demo?detail=0.5&seed=5&{MONO}&duration=1")).expect("a world");
    let slam = Slam::for_source(&*source).map(first.file).build().expect("it is of use");
    assert!(slam.notes().iter().any(|note| note.contains("only localises")), "{:?}", slam.notes());
    let refused = |map: MapFile, options: &str| {
        let source = open(&format!("sim:demo?detail=0.5&seed=5&{options}&duration=1")).expect("a world");
        Slam::for_source(&*source).map(map).build().err().expect("it is of no use").to_string()
    };
    let mono = walk(1, "demo", &format!("seed=5&{MONO}&duration=6"));
    let why = refused(mono.file, STEREO);
    assert!(why.contains("made with mono") && why.contains("lengths are metres"), "{why}");
    let stereo = walk(1, "demo", &format!("seed=5&{STEREO}&duration=6"));
    let why = refused(stereo.file, MONO_IMU);
    assert!(why.contains("made with stereo") && why.contains("aligned with gravity"), "{why}");
}

/// A map with metres, and beside it one without that a moment of lost tracking left behind: another camera with depth goes on in the
/// first, and takes nothing from the other one, even where that shows the place.
#[test]
fn a_stray_map_without_metres_keeps_no_other_camera_out() {
    let metric = walk(1, "demo", &format!("seed=5&{MONO_IMU}&duration=12"));
    let stray = walk(2, "demo", &format!("seed=15&{MONO}&duration=3"));
    let both = merge(&[&metric, &stray]).file;
    let camera = &both.about.camera;
    let maps: Vec<_> = both.snapshot.maps().map(|(map, _)| map).collect();
    let of = |of: &MapFile, map| of.snapshot.key_frames_of(map).count();
    assert_eq!(
        maps.iter().map(|map| both.snapshot.is_metric_in(*map, camera)).collect::<Vec<_>>(),
        [true, false]
    );
    for (seed, home) in [(5, true), (15, false)] {
        let source = open(&format!("sim:demo?detail=0.5&seed={seed}&{STEREO}&duration=1")).expect("a world");
        let slam = Slam::for_source(&*source).map(both.clone()).build().expect("the metric map is of use");
        let told = format!(
            "1 of its 2 maps, with {} of {} key frames, has no metres: it is kept",
            of(&both, maps[1]),
            both.snapshot.key_frame_count()
        );
        assert!(slam.notes().iter().any(|note| note.contains(&told)), "{:?}", slam.notes());
        let way = format!("seed={seed}&{STEREO}&start=1&duration=8&height=1.4");
        let (today, coverage, _) = continued(3, &both, &way);
        let snapshot = &today.file.snapshot;
        println!("seed {seed}: coverage {coverage:.3}, {} maps", snapshot.maps().count());
        // Where only the map without metres shows the place, a map of its own begins.
        assert_eq!(snapshot.maps().count(), if home { 2 } else { 3 });
        assert!(coverage > 0.8, "coverage {coverage}");
        let mine = snapshot.key_frames().filter(|k| snapshot.key_frame_name(k.id).robot == 3);
        let into: std::collections::BTreeSet<_> = mine.map(|k| k.map).collect();
        assert_eq!((into.len(), into.contains(&maps[0])), (1, home), "{into:?}");
        assert!(into.iter().all(|map| snapshot.is_metric_in(*map, &today.file.about.camera)));
        assert_eq!(of(&today.file, maps[1]), of(&both, maps[1]), "the stray map is not as it was");
        if home {
            let (error, scale) = ate(&today.file, &[&metric, &today], None, true);
            println!("  ATE {error:.3} m, scale {scale:.4}");
            assert!(error < 0.032 && (scale - 1.0).abs() < 0.01, "{error} m, scale {scale}");
        }
    }
}

/// A map without metres that was put into the atlas first takes them from a map that comes later.
#[test]
fn a_map_without_metres_gets_those_of_a_later_one() {
    let mono = walk(1, "demo", &format!("seed=5&{MONO}&duration=14"));
    let elsewhere = walk(2, "demo", &format!("seed=15&{RGBD}&duration=8"));
    let first = merge(&[&mono, &elsewhere]);
    assert_eq!(first.file.snapshot.maps().count(), 2, "{:?}", first.attempts);
    assert!(!first.file.snapshot.is_metric(&first.file.about.camera));
    let stereo = walk(3, "demo", &format!("seed=5&{STEREO}&start=3&duration=14&height=1.4"));
    let files = vec![("both".to_owned(), first.file), ("stereo".to_owned(), stereo.file.clone())];
    let merged = merge_maps(files, &Config::default()).expect("they fit");
    merged.file.snapshot.check().expect("a sound map");
    assert_eq!(merged.file.snapshot.maps().count(), 2, "{:?}", merged.attempts);
    assert!(merged.file.snapshot.is_metric(&merged.file.about.camera));
    let (error, scale) = ate(&merged.file, &[&mono, &elsewhere, &stereo], None, true);
    println!("ATE {error:.3} m, scale {scale:.4}");
    assert!(error < 0.05 && (scale - 1.0).abs() < 0.01, "{error} m, scale {scale}");
}

/// An office in which all rooms on one side are the same, walked by three robots with different sensors, each in another room
/// and a piece of the corridor: what is joined is joined where it is.
#[test]
fn rooms_that_look_alike_are_never_joined_wrongly() {
    for seed in 1..=2 {
        let part = |(robot, (sensor, start)): (RobotId, (&str, u32))| {
            walk(robot, "office", &format!("seed={seed}&{sensor}&look_alike=1&duration=26&start={start}"))
        };
        let walks: Vec<Walk> = (1..).zip([(RGBD, 0), (STEREO_IMU, 26), (MONO_IMU, 52)]).map(part).collect();
        for pair in [[0, 1], [0, 2], [1, 2]].map(|pair| pair.map(|n| &walks[n])) {
            let merged = merge(&pair);
            for attempt in &merged.attempts {
                match &attempt.join.result {
                    Err(apart) => {
                        println!("seed {seed}, {} and {}: {apart}", attempt.from.name, attempt.into.name)
                    }
                    Ok(_) => {
                        let (both, _) = ate(&merged.file, &pair, None, true);
                        assert!(both < 0.1, "seed {seed}: {attempt:?} joined wrongly, ATE {both} m");
                    }
                }
            }
        }
    }
}

#[test]
#[ignore = "a table for docs/figures/team.md: ten minutes"]
fn table() {
    for (name, sensors) in [
        ("RGB-D, stereo-imu, mono", [RGBD, STEREO_IMU, MONO]),
        ("RGB-D, stereo, mono-imu", [RGBD, STEREO, MONO_IMU]),
        ("mono-imu, RGB-D, stereo", [MONO_IMU, RGBD, STEREO]),
    ] {
        let rows = (1..=9).map(|seed| {
            let walks = house(seed, sensors);
            let joint = merged(seed, &walks);
            let images = merge_by_images(&walks.iter().collect::<Vec<_>>()).file;
            let images = ate(&images, &walks.iter().collect::<Vec<_>>(), None, false).0;
            let alone: Vec<String> = joint.alone.iter().map(|m| format!("{m:.3}")).collect();
            let all = [images, joint.all, joint.all_of_sent];
            let all = all.map(|m| format!("{m:.3} | {:.2}", m / joint.best()));
            let own: Vec<String> = joint.times_alone().map(|times| format!("{times:.2}")).collect();
            let row = format!("| {seed} | {} | {} | {} |", alone.join(", "), all.join(" | "), own.join(", "));
            println!("{row}");
            row
        });
        let rows: Vec<String> = rows.collect();
        println!(
            "\n| seed | {name} alone, m | by images, m | times | with readings, m | times | as sent, m | times | each, times itself alone |\n\
             |---|---|---|---|---|---|---|---|---|\n{}\n",
            rows.join("\n")
        );
    }
}
