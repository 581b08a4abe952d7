//! Three robots on simulated walks share their maps over a network that loses, delays and repeats: each of them ends
//! with the same atlas, joined where walks share a way, and apart where they do not.

use cairn::geometry::{Se3, umeyama};
use cairn::sensor::Stamp;
use cairn::team::peer::{Identity, Peer, TeamKey, To};
use cairn::team::{Network, NetworkConfig, RobotId};
use cairn::{
    Config, MapWords, SharedAtlas, Slam, in_reach, map_file, open, own_map, own_part, shared_atlas,
    words_of_map,
};
use cairn_atlas::KeyFrameName;
use cairn_atlas::store::MapFile;
use cairn_atlas::store::pieces::{PartBytes, Pieces};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

struct Walk {
    map: Vec<u8>,
    /// The true pose of the body at each time.
    truth: BTreeMap<Stamp, Se3>,
}

fn walk(robot: RobotId, world: &str, options: &str) -> Walk {
    walk_in(None, robot, world, options)
}

/// A walk in a map that is there already.
fn walk_in(map: Option<MapFile>, robot: RobotId, world: &str, options: &str) -> Walk {
    let mut source =
        open(&format!("sim:{world}?resolution=320x240&rate=10&detail=0.5&sensor=rgbd&{options}"))
            .expect("a world");
    let config = Config { robot, ..Config::default() };
    let mut slam = Slam::for_source(&*source).config(&config);
    if let Some(map) = map {
        slam = slam.map(map);
    }
    let mut slam = slam.build().expect("it can be built");
    while let Some(frame) = source.next_packet().expect("a simulated world can be read") {
        slam.track(&frame).expect("a frame in order");
    }
    slam.finish();
    let truth = source.info().truth.iter().copied().collect();
    let file = map_file(slam.session(), &BTreeMap::new()).expect("a map with key frames");
    Walk { map: file.write().expect("it can be written"), truth }
}

/// What a robot gives of its map.
fn in_pieces(walk: &Walk) -> Pieces {
    let mut pieces = Pieces::default();
    pieces.add(&MapFile::read(&walk.map).expect("a whole map")).expect("in memory");
    pieces
}

/// All robots say what they have until they have the same; returns what each of them holds.
fn exchanged(walks: &BTreeMap<RobotId, Walk>) -> Vec<BTreeMap<RobotId, Vec<u8>>> {
    let network = NetworkConfig { loss: 0.3, delayed: 0.3, delay_rounds: 3, duplicated: 0.2, seed: 4 };
    let mut network = Network::new(network);
    let mut peers: BTreeMap<RobotId, Peer> = BTreeMap::new();
    for (robot, walk) in walks {
        let identity = Identity::from_seed(*robot, &[*robot as u8; 32]).expect("a seed");
        let mut peer = Peer::new(identity, TeamKey::new(b"three"));
        let pieces = in_pieces(walk);
        peer.publish_pieces(pieces.bytes(), pieces.lengths()).expect("it is short enough");
        peers.insert(*robot, peer);
    }
    let robots: Vec<RobotId> = walks.keys().copied().collect();
    for round in 0..200 {
        let digests: BTreeSet<_> = peers.values().map(Peer::digest).collect();
        if digests.len() == 1 {
            let sent = |p: &Peer| p.traffic().sent.values().map(|a| a.bytes).sum::<u64>() / 1000;
            let sent: Vec<u64> = peers.values().map(sent).collect();
            println!("the same after {round} rounds; kB sent {sent:?}");
            return peers.values().map(|p| p.parts().map(|(h, bytes)| (h.robot, bytes)).collect()).collect();
        }
        let mut out: Vec<_> = Vec::new();
        for (robot, peer) in &mut peers {
            out.extend(peer.tick().into_iter().map(|m| (*robot, m)));
        }
        for packet in network.deliver() {
            let peer = peers.get_mut(&packet.to).expect("a robot");
            out.extend(peer.receive(&packet.bytes).expect("honest").into_iter().map(|m| (packet.to, m)));
        }
        for (from, message) in out {
            let to = robots
                .iter()
                .filter(|r| **r != from && (message.to == To::All || message.to == To::Robot(**r)));
            for robot in to {
                peers.get_mut(&from).expect("a robot").sent(&message);
                network.send(from, *robot, &message.bytes);
            }
        }
    }
    panic!("not the same after 200 rounds");
}

/// The atlas that all robots come to, each for itself; it must be the same to the last byte.
fn atlas_of_all(walks: &BTreeMap<RobotId, Walk>) -> SharedAtlas {
    let held = exchanged(walks);
    let atlases: Vec<SharedAtlas> =
        held[..2].iter().map(|parts| shared_atlas(parts, &Config::default()).expect("maps")).collect();
    let bytes: Vec<Vec<u8>> = atlases.iter().map(|a| a.merged.file.write().expect("written")).collect();
    assert!(held.iter().all(|parts| *parts == held[0]));
    assert!(bytes[0] == bytes[1], "two robots made different atlases of the same maps");
    atlases.into_iter().next().expect("two")
}

/// The words of each robot, as the others read them.
fn words(walks: &BTreeMap<RobotId, Walk>) -> BTreeMap<RobotId, MapWords> {
    let of = |(robot, walk): (&RobotId, &Walk)| {
        let file = MapFile::read(&walk.map).expect("a whole map");
        let (bytes, lengths) = words_of_map(*robot, &file);
        assert_eq!(lengths.iter().sum::<usize>(), bytes.len());
        let words = MapWords::read(*robot, &bytes).expect("words");
        assert!(bytes.len() <= 1026 * words.len(), "{} bytes of {} key frames", bytes.len(), words.len());
        println!(
            "robot {robot}: {} B words of {} key frames, {} B map",
            bytes.len(),
            words.len(),
            walk.map.len()
        );
        assert!(MapWords::read(*robot + 1, &bytes).unwrap_err().to_string().contains("as robot"));
        assert!(
            MapWords::read(*robot, &bytes[..bytes.len() - 1]).unwrap_err().to_string().contains("end early")
        );
        (*robot, words)
    };
    walks.iter().map(of).collect()
}

/// Every two robots that may share a place, by their words; the same whichever of them is asked.
fn overlaps(walks: &BTreeMap<RobotId, Walk>) -> BTreeSet<(RobotId, RobotId)> {
    let words = words(walks);
    let mut pairs = BTreeSet::new();
    for (a, of_a) in &words {
        for (b, of_b) in words.range(a + 1..) {
            let alike = of_a.similar(of_b);
            println!("robots {a} and {b}: {} and {} key frames look alike", alike.0, alike.1);
            assert_eq!(of_b.similar(of_a), (alike.1, alike.0));
            assert_eq!(
                (of_a.overlaps(of_b), of_b.overlaps(of_a)),
                (alike.0.min(alike.1) >= 3, alike.0.min(alike.1) >= 3)
            );
            pairs.extend(of_a.overlaps(of_b).then_some((*a, *b)));
        }
    }
    pairs
}

#[test]
fn a_robot_reaches_those_that_it_meets_and_those_that_they_meet() {
    let pairs = [(1, 4), (2, 3), (4, 6)].into();
    assert_eq!(in_reach(6, &pairs), [1, 4, 6].into());
    assert_eq!(in_reach(3, &pairs), [2, 3].into());
    assert_eq!(in_reach(9, &pairs), [9].into());
}

/// Root mean square error of the positions of the key frames of some robots, aligned by SE3.
fn ate(file: &MapFile, walks: &BTreeMap<RobotId, Walk>, robots: &[RobotId]) -> f64 {
    ate_and_scale(file, walks, robots, false).0
}

/// The same where the scale may be left free as well, and the scale.
fn ate_and_scale(
    file: &MapFile,
    walks: &BTreeMap<RobotId, Walk>,
    robots: &[RobotId],
    free: bool,
) -> (f64, f64) {
    let truth = |name: KeyFrameName, at: Stamp| {
        let walk = robots.contains(&name.robot).then(|| &walks[&name.robot])?;
        Some(*walk.truth.get(&at).expect("a true pose at each frame"))
    };
    ate_of(file, truth, free)
}

/// The same of those key frames of which the true pose of the body is told.
fn ate_of(file: &MapFile, truth_of: impl Fn(KeyFrameName, Stamp) -> Option<Se3>, free: bool) -> (f64, f64) {
    let (mut estimated, mut truth) = (Vec::new(), Vec::new());
    for k in file.snapshot.key_frames() {
        if let Some(body) = truth_of(file.snapshot.key_frame_name(k.id), k.stamp) {
            estimated.push(k.world_from_camera.translation);
            truth.push((body * file.about.camera.body_from_camera).translation);
        }
    }
    let fit = umeyama(&truth, &estimated, free).expect("a walk is not a straight line");
    let squares: f64 = estimated.iter().zip(&truth).map(|(e, t)| (fit * *e - *t).norm_squared()).sum();
    ((squares / estimated.len() as f64).sqrt(), 1.0 / fit.scale)
}

#[test]
fn three_robots_that_share_a_way_have_one_map_and_none_gets_worse() {
    let options = [
        "duration=24",
        "start=6&duration=16&speed=1.05&height=1.4",
        "start=9&duration=16&speed=0.95&height=1.35",
    ];
    let walks: BTreeMap<RobotId, Walk> =
        (1..).zip(options).map(|(r, o)| (r, walk(r, "demo", &format!("seed=5&{o}")))).collect();
    assert_eq!(overlaps(&walks), [(1, 2), (1, 3), (2, 3)].into());
    let shared = atlas_of_all(&walks);
    let file = &shared.merged.file;
    file.snapshot.check().expect("a sound map");
    let alone: Vec<f64> =
        walks.iter().map(|(r, w)| ate(&MapFile::read(&w.map).unwrap(), &walks, &[*r])).collect();
    let merged: Vec<f64> = walks.keys().map(|r| ate(file, &walks, &[*r])).collect();
    let all = ate(file, &walks, &[1, 2, 3]);
    let best = alone.iter().copied().fold(f64::INFINITY, f64::min);
    let times = all / best;
    println!(
        "ATE alone {alone:.3?} m, each in the atlas {merged:.3?} m, all {all:.3} m: {times:.2} times the best alone"
    );
    assert_eq!(file.snapshot.maps().count(), 1, "{:?}", shared.merged.attempts);
    assert!(shared.left_out.is_empty());
    assert!(
        alone.iter().zip(&merged).all(|(alone, merged)| *merged <= 1.2 * alone),
        "{merged:?} of {alone:?}"
    );
    assert!(all <= alone.iter().copied().fold(0.0, f64::max), "{all} m of {alone:?}");
}

/// Yesterday's shared atlas, in which robot 2 walks on alone to where nobody was: what it made of that map, then and now, is what it
/// gives, and the team's atlas has all of it.
#[test]
fn a_robot_that_continued_the_shared_atlas_joins_its_team_again() {
    let options = ["duration=12", "start=4&duration=10&speed=1.05&height=1.4"];
    let mut walks: BTreeMap<RobotId, Walk> =
        (1..).zip(options).map(|(r, o)| (r, walk(r, "demo", &format!("seed=5&{o}")))).collect();
    let yesterday = atlas_of_all(&walks).merged.file;
    assert_eq!(yesterday.snapshot.maps().count(), 1);
    let before = yesterday.snapshot.robots();
    let named = yesterday.snapshot.key_frames().map(|k| yesterday.snapshot.key_frame_name(k.id));
    let next = named.filter(|name| name.robot == 2).map(|name| name.seq + 1).max().expect("some of robot 2");

    let today = walk_in(Some(yesterday), 2, "demo", "seed=5&start=8&duration=12&height=1.4");
    let continued = MapFile::read(&today.map).expect("a whole map");
    assert!(own_map(2, &today.map).unwrap_err().to_string().contains("key frames of robot 1"));
    let part = own_part(2, &today.map).expect("it made key frames of it");
    let own = part.snapshot.robots();
    println!("yesterday {before:?}, continued {:?}, given {own:?}", continued.snapshot.robots());
    assert_eq!(own.keys().copied().collect::<Vec<_>>(), [2]);
    assert_eq!(own[&2], continued.snapshot.robots()[&2]);
    assert!(own[&2] > before[&2] + 5, "{own:?}");

    walks.get_mut(&2).expect("robot 2").map = part.write().expect("written");
    let shared = atlas_of_all(&walks);
    assert!(shared.left_out.is_empty(), "{:?}", shared.left_out);
    let snapshot = &shared.merged.file.snapshot;
    snapshot.check().expect("a sound map");
    assert_eq!(snapshot.maps().count(), 1, "{:?}", shared.merged.attempts);
    let first = MapFile::read(&walks[&1].map).expect("a map").snapshot.robots()[&1];
    assert_eq!(snapshot.robots(), [(1, first), (2, own[&2])].into());
    // Both walks of robot 2 begin at the same time of the clock.
    let truth = |name: KeyFrameName, at: Stamp| match name {
        KeyFrameName { robot: 2, seq } if seq >= next => today.truth.get(&at).copied(),
        KeyFrameName { robot, .. } => walks[&robot].truth.get(&at).copied(),
    };
    let (error, _) = ate_of(&shared.merged.file, truth, false);
    println!("ATE of all {error:.3} m");
    assert!(error < 0.03, "{error} m");
    // Who has no part in a map gives nothing of it.
    let why = own_part(3, &today.map).unwrap_err().to_string();
    assert_eq!(why, "it has no key frame of robot 3");
}

#[test]
fn robots_in_different_houses_share_an_atlas_of_separate_maps() {
    let house = |robot: RobotId| walk(robot, "demo", &format!("seed={}&duration=12", 20 + robot));
    let walks: BTreeMap<RobotId, Walk> = (1..=3).map(|r| (r, house(r))).collect();
    assert_eq!(overlaps(&walks), BTreeSet::new());
    let shared = atlas_of_all(&walks);
    assert_eq!(shared.merged.file.snapshot.maps().count(), 3, "{:?}", shared.merged.attempts);
}

/// Rooms that look the same, each robot in another one: what is joined is joined where it is.
#[test]
fn robots_in_rooms_that_look_alike_are_never_joined_wrongly() {
    let options = |start: u32| format!("seed=1&look_alike=1&duration=26&start={start}");
    let walks: BTreeMap<RobotId, Walk> =
        (1..).zip([0, 26, 52]).map(|(r, start)| (r, walk(r, "office", &options(start)))).collect();
    let shared = atlas_of_all(&walks);
    for (root, members) in &shared.merged.maps {
        let robots: Vec<RobotId> =
            members.iter().filter_map(|m| m.name.strip_prefix("robot ")?.parse().ok()).collect();
        println!("map {root:?}: robots {robots:?}");
        if robots.len() > 1 {
            let all = ate(&shared.merged.file, &walks, &robots);
            assert!(all < 0.1, "joined wrongly: ATE {all} m of {robots:?}");
        }
    }
}

#[test]
fn damaged_and_foreign_maps_are_left_out_with_a_sentence() {
    let walks: BTreeMap<RobotId, Walk> = [(1, walk(1, "demo", "seed=5&duration=4"))].into();
    let own = &walks[&1].map;
    let mut damaged = own.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    let parts = [(1, own.clone()), (2, own.clone()), (3, damaged), (4, b"no map".to_vec())].into();
    let shared = shared_atlas(&parts, &Config::default()).expect("robot 1 has a map");
    println!("{:?}", shared.left_out);
    assert_eq!(shared.left_out.keys().copied().collect::<Vec<_>>(), [2, 3, 4]);
    assert!(shared.left_out[&2].contains("key frames of robot 1"));
    assert!(shared_atlas(&BTreeMap::new(), &Config::default()).is_none());
}

/// Prints where the bytes of a key frame go.
fn bytes_of(walks: &BTreeMap<RobotId, Walk>) {
    let files: Vec<MapFile> = walks.values().map(|w| MapFile::read(&w.map).expect("a map")).collect();
    let n: usize = files.iter().map(|f| f.snapshot.key_frame_count()).sum();
    let of =
        |bytes: &dyn Fn(&Pieces) -> usize| walks.values().map(|w| bytes(&in_pieces(w))).sum::<usize>() / n;
    let part = |part: &dyn Fn(PartBytes) -> usize| of(&|pieces| part(pieces.parts().expect("whole")));
    println!(
        "a key frame: {} B of the file, {} B sent; before packing {} B of features, {} of which landmarks they show, {} of \
         positions and {} of descriptors of landmarks, {} of key frames, {} of an IMU, {} of all else",
        walks.values().map(|w| w.map.len()).sum::<usize>() / n,
        of(&|pieces| pieces.bytes().len()),
        part(&|p| p.features),
        part(&|p| p.shown),
        part(&|p| p.landmarks),
        part(&|p| p.descriptors),
        part(&|p| p.key_frames),
        part(&|p| p.imu),
        part(&|p| p.other)
    );
}

#[test]
#[ignore = "a table for docs/figures/team.md: three minutes"]
fn table() {
    let options = [
        "duration=24",
        "start=6&duration=16&speed=1.05&height=1.4",
        "start=9&duration=16&speed=0.95&height=1.35",
    ];
    println!(
        "| seed | alone, m | all in one map, m | times the best alone | all, scale free, m | scale | of whole maps, m |"
    );
    for seed in 1..=6 {
        let walks: BTreeMap<RobotId, Walk> =
            (1..).zip(options).map(|(r, o)| (r, walk(r, "demo", &format!("seed={seed}&{o}")))).collect();
        let atlas = |part: &dyn Fn(&Walk) -> Vec<u8>| {
            let parts = walks.iter().map(|(robot, walk)| (*robot, part(walk))).collect();
            let file = shared_atlas(&parts, &Config::default()).expect("maps").merged.file;
            assert_eq!(file.snapshot.maps().count(), 1, "seed {seed}");
            file
        };
        let (file, of_whole) =
            (atlas(&|walk| in_pieces(walk).bytes().to_vec()), atlas(&|walk| walk.map.clone()));
        let alone: Vec<f64> =
            walks.iter().map(|(r, w)| ate(&MapFile::read(&w.map).expect("a map"), &walks, &[*r])).collect();
        let best = alone.iter().copied().fold(f64::INFINITY, f64::min);
        let all = ate(&file, &walks, &[1, 2, 3]);
        let (free, scale) = ate_and_scale(&file, &walks, &[1, 2, 3], true);
        let of_whole = ate(&of_whole, &walks, &[1, 2, 3]);
        let alone: Vec<String> = alone.iter().map(|m| format!("{m:.3}")).collect();
        let alone = alone.join(", ");
        bytes_of(&walks);
        println!(
            "| {seed} | {alone} | {all:.3} | {:.2} | {free:.3} | {scale:.4} | {of_whole:.3} |",
            all / best
        );
    }
}

#[test]
#[ignore = "a table for docs/figures/team.md: two minutes"]
fn eight_robots() {
    println!("| house, seed | key frames | alone, m | each in the atlas, m | all, m | seconds to join |");
    for (world, seed, metres) in [
        ("demo", 1, 24),
        ("demo", 2, 24),
        ("demo", 3, 24),
        ("demo", 4, 24),
        ("apartment", 1, 36),
        ("apartment", 2, 36),
    ] {
        let one = |robot: RobotId| {
            let n = u32::from(robot) - 1;
            let (start, duration) = (metres * n / 8, metres * 5 / 6);
            let (speed, height) = (0.95 + 0.02 * f64::from(n), 1.3 + 0.03 * f64::from(n % 5));
            let way =
                format!("seed={seed}&start={start}&duration={duration}&speed={speed:.2}&height={height:.2}");
            (robot, walk(robot, world, &way))
        };
        let walks: BTreeMap<RobotId, Walk> = (1..=8).map(one).collect();
        let parts = walks.iter().map(|(robot, walk)| (*robot, in_pieces(walk).bytes().to_vec())).collect();
        let began = Instant::now();
        let merged = shared_atlas(&parts, &Config::default()).expect("maps").merged;
        let seconds = began.elapsed().as_secs_f64();
        let file = merged.file;
        assert_eq!(file.snapshot.maps().count(), 1, "{world}, seed {seed}: {:?}", merged.maps);
        let list = |of: &dyn Fn(RobotId) -> f64| {
            walks.keys().map(|robot| format!("{:.4}", of(*robot))).collect::<Vec<_>>().join(", ")
        };
        println!(
            "| {world}, {seed} | {} | {} | {} | {:.4} | {seconds:.2} |",
            file.snapshot.key_frame_count(),
            list(&|r| ate(&MapFile::read(&walks[&r].map).expect("a map"), &walks, &[r])),
            list(&|r| ate(&file, &walks, &[r])),
            ate(&file, &walks, &[1, 2, 3, 4, 5, 6, 7, 8])
        );
    }
}
