//! The atlas of a team, made again each time that maps have changed: the same as one made from nothing, whatever came before.

use cairn::team::RobotId;
use cairn::{Config, Slam, TeamAtlas, map_file, open};
use cairn_atlas::store::pieces::Pieces;
use cairn_atlas::{Change, ChangeSet, MapId};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_random::Random;
use std::collections::BTreeMap;

/// Seconds between two saves.
const SAVE_S: f64 = 3.0;

/// What the others have of a robot's map after each of its saves; the last is adjusted as a whole.
fn saves(robot: RobotId, options: &str) -> Vec<Vec<u8>> {
    let mut source =
        open(&format!("sim:demo?seed=5&resolution=320x240&rate=10&detail=0.5&{options}")).expect("a world");
    let mut slam = Slam::for_source(&*source);
    slam = slam.config(&Config { robot, ..Config::default() });
    let mut slam = slam.build().expect("it can be built");
    let (mut pieces, mut saved) = (Pieces::default(), Vec::new());
    let mut save = |slam: &Slam| {
        if let Some(file) = map_file(slam.session(), &BTreeMap::new()) {
            pieces.add(&file).expect("in memory");
            saved.push((pieces.bytes().to_vec(), file));
        }
    };
    let mut next = None;
    while let Some(frame) = source.next_packet().expect("a simulated world can be read") {
        slam.track(&frame).expect("a frame in order");
        let due = *next.get_or_insert(frame.stamp.plus_seconds(SAVE_S));
        if frame.stamp >= due {
            save(&slam);
            next = Some(frame.stamp.plus_seconds(SAVE_S));
        }
    }
    slam.finish();
    save(&slam);
    // A loop that turned the whole map, and a key frame that was culled.
    if let Some((_, last)) = saved.last() {
        let (mut file, mut pieces) = (last.clone(), pieces.clone());
        let turn = Sim3::new(So3::exp(&Vec3::new(0.0, 0.01, 0.0)), Vec3::new(0.02, 0.0, 0.0), 1.0);
        let s = &file.snapshot;
        let moved = |pose: &Se3| turn.transform_pose(pose);
        let key_frames = s.key_frames().map(|k| Change::MoveKeyFrame(k.id, moved(&k.world_from_camera)));
        let landmarks = s.landmarks().map(|l| Change::MoveLandmark(l.id, turn * l.position));
        let culled =
            s.key_frames().filter(|k| MapId(k.id) != k.map).nth(5).map(|k| Change::RemoveKeyFrame(k.id));
        let changes = key_frames.chain(landmarks).chain(culled).collect();
        file.snapshot = s.apply(&ChangeSet { base: s.version(), changes }).0;
        pieces.add(&file).expect("in memory");
        saved.push((pieces.bytes().to_vec(), file));
    }
    saved.into_iter().map(|(bytes, _)| bytes).collect()
}

/// The file that is made of some maps, and what became of them in words.
fn made(atlas: &mut TeamAtlas, parts: &BTreeMap<RobotId, Vec<u8>>) -> (Option<Vec<u8>>, String) {
    let made = atlas.update(parts);
    let said = made.as_ref().map(|a| format!("{:?} {:?} {:?}", a.left_out, a.merged.maps, a.merged.attempts));
    (made.map(|a| a.merged.file.write().expect("written")), said.unwrap_or_default())
}

fn team() -> BTreeMap<RobotId, Vec<Vec<u8>>> {
    let robots = [
        (1, "sensor=rgbd&duration=14"),
        (2, "sensor=rgbd&start=6&duration=10&speed=1.05&height=1.4"),
        // Of another camera, which the atlas takes over where the first two are away.
        (3, "sensor=stereo-imu&start=5&duration=9&speed=0.95&height=1.35"),
    ];
    robots.into_iter().map(|(robot, options)| (robot, saves(robot, options))).collect()
}

/// Whatever comes, in whatever order, from whoever is there: earlier saves and later ones, damaged ones, and robots that leave.
#[test]
fn the_atlas_made_again_is_the_one_made_from_nothing() {
    let saves = team();
    let mut joined = 0;
    for seed in 0..3 {
        let mut random = Random::new(seed);
        let mut atlas = TeamAtlas::new(&Config::default());
        let mut parts: BTreeMap<RobotId, Vec<u8>> = BTreeMap::new();
        for _ in 0..8 {
            let robot = 1 + random.below(3) as RobotId;
            let of = &saves[&robot];
            match random.below(8) {
                0 => drop(parts.remove(&robot)),
                1 => drop(parts.insert(robot, of[0][..of[0].len() / 2].to_vec())),
                _ => drop(parts.insert(robot, of[random.below(of.len())].clone())),
            }
            let again = made(&mut atlas, &parts);
            let anew = made(&mut TeamAtlas::new(&Config::default()), &parts);
            assert!(again.1 == anew.1, "{}\n{}", again.1, anew.1);
            assert!(again.0 == anew.0, "the files differ");
            joined += usize::from(again.1.contains("Ok("));
        }
    }
    assert!(joined > 5, "maps were joined in {joined} cases only");
}
