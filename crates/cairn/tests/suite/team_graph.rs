//! Three robots on simulated walks agree on one pose graph made of their saved maps: words of all key frames, features of a few, and
//! condensed graphs go over a network; the maps stay where they are.

use cairn::geometry::{LieGroup, Se3, umeyama};
use cairn::sensor::Stamp;
use cairn::team::peer::{Identity, MapSubscription, Peer, PeerKind, TeamKey, To};
use cairn::team::{JudgeConfig, Measurement, Network, NetworkConfig, PoseId, RobotId};
use cairn::{AgreeingMap, Config, Slam, graph_of_map, map_file, open, shared_atlas};
use cairn_atlas::store::MapFile;
use std::collections::BTreeMap;

struct Walk {
    file: MapFile,
    /// The true pose of the camera at each key frame, by its number.
    truth: BTreeMap<u32, Se3>,
}

fn walk(robot: RobotId, world: &str, options: &str) -> Walk {
    let address = format!("sim:{world}?resolution=320x240&rate=10&detail=0.5&{options}");
    let mut source = open(&address).expect("a world");
    let config = Config { robot, ..Config::default() };
    let mut slam = Slam::for_source(&*source).config(&config).build().expect("it can be built");
    while let Some(frame) = source.next_packet().expect("a simulated world can be read") {
        slam.track(&frame).expect("a frame in order");
    }
    slam.finish();
    let bodies: BTreeMap<Stamp, Se3> = source.info().truth.iter().copied().collect();
    let file = map_file(slam.session(), &BTreeMap::new()).expect("a map with key frames");
    let snapshot = &file.snapshot;
    let truth = snapshot.key_frames().map(|k| {
        let body = bodies.get(&k.stamp).expect("a true pose at each frame");
        (snapshot.key_frame_name(k.id).seq, *body * file.about.camera.body_from_camera)
    });
    Walk { truth: truth.collect(), file }
}

const THREE: [&str; 3] = [
    "sensor=rgbd&duration=24",
    "sensor=rgbd&start=6&duration=16&speed=1.05&height=1.4",
    "sensor=rgbd&start=9&duration=16&speed=0.95&height=1.35",
];

fn walks(world: &str, options: &[String]) -> BTreeMap<RobotId, Walk> {
    (1..).zip(options).map(|(robot, options)| (robot, walk(robot, world, options))).collect()
}

/// Three walks of one house.
fn house(seed: u32) -> BTreeMap<RobotId, Walk> {
    walks("demo", &THREE.map(|walk| format!("seed={seed}&{walk}")))
}

/// A robot with its side of the network.
struct Side {
    peer: Peer,
    robot: AgreeingMap,
}

/// All update and exchange messages until nothing was new for ten rounds.
fn agreed(walks: &BTreeMap<RobotId, Walk>, network: NetworkConfig) -> BTreeMap<RobotId, Side> {
    agreed_where(walks, network, None)
}

/// The same where one robot leaves when another one has asked it for features of further key frames.
fn agreed_where(
    walks: &BTreeMap<RobotId, Walk>,
    network: NetworkConfig,
    leaves: Option<RobotId>,
) -> BTreeMap<RobotId, Side> {
    let mut network = Network::new(network);
    let mut sides: BTreeMap<RobotId, Side> = BTreeMap::new();
    for (robot, walk) in walks {
        let identity = Identity::from_seed(*robot, &[*robot as u8; 32]).expect("a seed");
        let mut peer = Peer::new(identity, TeamKey::new(b"three"));
        let judge = Some(JudgeConfig::default());
        let robot_of = AgreeingMap::new(walk.file.clone(), judge, 1, &Config::default(), &mut peer);
        sides.insert(*robot, Side { peer, robot: robot_of.expect("a map with metres") });
    }
    let mut quiet = 0;
    for round in 0..300 {
        let mut out = Vec::new();
        let mut is_new = false;
        for (robot, side) in &mut sides {
            let update = side.robot.update(&mut side.peer).expect("it can go on");
            update.lines.iter().for_each(|line| println!("round {round}, robot {robot}: {line}"));
            assert!(update.graph.refused.is_empty(), "{:?}", update.graph.refused);
            is_new |=
                update.searched || update.graph.stepped || update.graph.published || side.peer.is_fetching();
            out.extend(side.peer.tick().into_iter().map(|m| (*robot, m)));
        }
        if let Some(left) =
            leaves.filter(|left| sides.values().any(|s| s.robot.waits_for().contains_key(left)))
        {
            sides.remove(&left);
        }
        for packet in network.deliver() {
            let Some(Side { peer, .. }) = sides.get_mut(&packet.to) else { continue };
            out.extend(peer.receive(&packet.bytes).expect("honest").into_iter().map(|m| (packet.to, m)));
        }
        for (from, message) in out {
            let Some(side) = sides.get_mut(&from) else { continue };
            for to in walks.keys().filter(|to| **to != from) {
                if message.to == To::All || message.to == To::Robot(*to) {
                    side.peer.sent(&message);
                    network.send(from, *to, &message.bytes);
                }
            }
        }
        quiet = if is_new { 0 } else { quiet + 1 };
        if quiet == 10 {
            println!("nothing new after {} rounds", round - 9);
            return sides;
        }
    }
    panic!("not settled after 300 rounds");
}

/// The poses that each robot has come to, by their names.
fn poses(sides: &BTreeMap<RobotId, Side>) -> BTreeMap<PoseId, Se3> {
    sides
        .values()
        .flat_map(|side| side.robot.graph().robot().own_poses())
        .map(|(id, pose)| (id, *pose))
        .collect()
}

/// Root mean square error of the positions of the key frames of some robots, aligned by SE3 together; and of each robot under this
/// alignment.
fn errors(
    poses: &BTreeMap<PoseId, Se3>,
    walks: &BTreeMap<RobotId, Walk>,
    robots: &[RobotId],
) -> (f64, Vec<f64>) {
    let of = |id: &PoseId| robots.contains(&id.robot).then(|| walks[&id.robot].truth[&id.seq].translation);
    let both: Vec<_> =
        poses.iter().filter_map(|(id, pose)| Some((id.robot, pose.translation, of(id)?))).collect();
    let (estimated, truth): (Vec<_>, Vec<_>) = both.iter().map(|(_, e, t)| (*e, *t)).unzip();
    let fit = umeyama(&truth, &estimated, false).expect("a walk is not a straight line");
    let rms = |of: Option<RobotId>| {
        let some = || both.iter().filter(|(robot, ..)| of.is_none_or(|of| of == *robot));
        (some().map(|(_, e, t)| (fit * *e - *t).norm_squared()).sum::<f64>() / some().count() as f64).sqrt()
    };
    (rms(None), robots.iter().map(|robot| rms(Some(*robot))).collect())
}

/// The poses of the key frames of a map that robots made together.
fn poses_of(file: &MapFile) -> BTreeMap<PoseId, Se3> {
    let snapshot = &file.snapshot;
    let pose = |k: &cairn_atlas::KeyFrame| {
        let name = snapshot.key_frame_name(k.id);
        (PoseId { robot: name.robot, seq: name.seq }, k.world_from_camera)
    };
    snapshot.key_frames().map(pose).collect()
}

/// Squared error of measurements by their stated information, in the mean and the median of all; 6 for a right one.
fn chi2<'a>(
    walks: &BTreeMap<RobotId, Walk>,
    measured: impl Iterator<Item = &'a Measurement<Se3, 6>>,
) -> (usize, f64, f64) {
    let truth = |id: PoseId| walks[&id.robot].truth[&id.seq];
    let mut all: Vec<f64> = measured
        .map(|m| {
            let off = (m.a_from_b.inverse() * truth(m.a).inverse() * truth(m.b)).coordinates();
            off.dot(&(m.information * off))
        })
        .collect();
    all.sort_by(f64::total_cmp);
    (all.len(), all.iter().sum::<f64>() / all.len() as f64, all[all.len() / 2])
}

/// Bytes that a robot sent, by kind.
fn sent(side: &Side) -> String {
    let of = |kind: PeerKind| side.peer.traffic().sent.get(&kind).map_or(0, |amount| amount.bytes);
    let all: u64 = side.peer.traffic().sent.values().map(|amount| amount.bytes).sum();
    let [words, places, graph] = [PeerKind::Words, PeerKind::Places, PeerKind::Block].map(of);
    let requests = of(PeerKind::Requests);
    let other = all - words - places - graph - requests;
    format!("{all} B: words {words}, places {places}, requests {requests}, graph {graph}, other {other}")
}

fn print(walks: &BTreeMap<RobotId, Walk>, sides: &BTreeMap<RobotId, Side>) {
    for (robot, side) in sides {
        let own = graph_of_map(*robot, &walks[robot].file).expect("a map with metres");
        let shared = side.robot.graph().robot();
        println!(
            "robot {robot}: {} key frames, {} relations (chi2 {:.1?}), features of {} given, {} poses shared; sent {}",
            own.poses.len(),
            own.measurements.len(),
            chi2(walks, own.measurements.iter()),
            side.robot.places_given(),
            shared.shares(),
            sent(side)
        );
        let loops: Vec<_> = shared.loops().collect();
        let rejected = loops.iter().filter(|m| shared.rejects(&m.ends())).count();
        if !loops.is_empty() {
            println!(
                "  {} loops, {rejected} rejected, chi2 {:.1?}",
                loops.len(),
                chi2(walks, loops.into_iter())
            );
        }
    }
}

#[test]
fn three_robots_agree_on_poses_without_sending_maps() {
    let walks = house(5);
    let bad = NetworkConfig { loss: 0.3, delayed: 0.3, delay_rounds: 3, duplicated: 0.2, seed: 4 };
    let sides = agreed(&walks, bad);
    print(&walks, &sides);
    let alone: Vec<f64> = walks.iter().map(|(r, w)| errors(&poses_of(&w.file), &walks, &[*r]).0).collect();
    let (all, each) = errors(&poses(&sides), &walks, &[1, 2, 3]);
    println!("ATE alone {alone:.4?} m, agreed {each:.4?} m, all {all:.4} m");
    let worst = alone.iter().copied().fold(0.0, f64::max);
    assert!(all < 1.5 * worst, "{all} m of {alone:?}");
    for side in sides.values() {
        let known: Vec<RobotId> = side.robot.graph().robot().known().collect();
        assert_eq!(known, [1, 2, 3]);
    }
}

#[test]
fn of_a_robot_that_leaves_before_it_gave_what_was_asked_for_no_loop_is_believed() {
    let walks = house(5);
    let sides = agreed_where(&walks, NetworkConfig::PERFECT, Some(1));
    let found = loops(&walks, &sides);
    assert_eq!(found.keys().copied().collect::<Vec<_>>(), [[2, 3]], "{found:?}");
    assert!(sides.values().any(|side| side.robot.waits_for().get(&1).is_some_and(|missing| *missing >= 3)));
    // What both are sure of among themselves does not depend on it.
    let known: Vec<RobotId> = sides[&3].robot.graph().robot().known().collect();
    assert!(known.contains(&2) && !sides[&3].robot.waits_for().contains_key(&2), "{known:?}");
}

#[test]
fn what_cannot_be_read_leads_to_a_sentence_and_no_loop() {
    let walk = walk(2, "demo", "seed=5&sensor=rgbd&duration=6");
    let identity = |robot: RobotId| Identity::from_seed(robot, &[robot as u8; 32]).expect("a seed");
    let key = || TeamKey::new(b"two");
    let mut own = Peer::new(identity(2), key());
    let judge = Some(JudgeConfig::default());
    let mut robot =
        AgreeingMap::new(walk.file.clone(), judge, 1, &Config::default(), &mut own).expect("metres");
    // Robot 1 saw the same by its words, and gives what is no map.
    let (words, lengths) = cairn::words_of_map(1, &walk.file);
    let mut other = Peer::new(identity(1), key());
    other.subscribe(MapSubscription::Of([1, 2].into()));
    other.publish_words(&words, &lengths).expect("few");
    let mut lines = Vec::new();
    for garbage in [vec![7; 3], vec![7; 5000], [&12u32.to_le_bytes()[..], &[0; 40]].concat()] {
        other.publish_places(&garbage, &[garbage.len()]).expect("short enough");
        for _ in 0..8 {
            let update = robot.update(&mut own).expect("it goes on");
            lines.extend(update.lines);
            let mut out: Vec<_> = own.tick().into_iter().map(|m| (2, m)).collect();
            out.extend(other.tick().into_iter().map(|m| (1, m)));
            while let Some((from, message)) = out.pop() {
                let to = if from == 1 { &mut own } else { &mut other };
                out.extend(to.receive(&message.bytes).expect("sealed").into_iter().map(|m| (3 - from, m)));
            }
        }
    }
    let said: Vec<&String> = lines.iter().filter(|line| line.starts_with("features of robot 1: ")).collect();
    assert_eq!(said.len(), 3, "{lines:?}");
    assert_eq!(robot.graph().robot().loops().count(), 0);
    assert!(robot.waits_for().is_empty());
}

/// How many loops there are between every two robots, and how many of them are off by more than this, metres.
fn loops(
    walks: &BTreeMap<RobotId, Walk>,
    sides: &BTreeMap<RobotId, Side>,
) -> BTreeMap<[RobotId; 2], [usize; 2]> {
    const FALSE_M: f64 = 0.5;
    let all = sides.values().flat_map(|side| side.robot.graph().robot().loops());
    let by_ends: BTreeMap<_, _> = all.map(|m| (m.ends(), m)).collect();
    let mut loops: BTreeMap<[RobotId; 2], [usize; 2]> = BTreeMap::new();
    for m in by_ends.values() {
        let [a, b] = [m.a, m.b].map(|end| walks[&end.robot].truth[&end.seq]);
        let off = (m.a_from_b.inverse() * a.inverse() * b).translation.norm();
        let of = loops.entry([m.a.robot.min(m.b.robot), m.a.robot.max(m.b.robot)]).or_default();
        *of = [of[0] + 1, of[1] + usize::from(off > FALSE_M)];
    }
    loops
}

/// Offices in which all rooms of a side look the same, each robot in another room: how many pairs of robots there are, and how many have a
/// loop that is false.
fn look_alike(seeds: std::ops::RangeInclusive<u32>, starts: &[u32], duration: u32) -> [usize; 2] {
    let mut pairs = [0, 0];
    for seed in seeds {
        let walk = |start| format!("sensor=rgbd&seed={seed}&look_alike=1&duration={duration}&start={start}");
        let walks = walks("office", &starts.iter().map(walk).collect::<Vec<_>>());
        let sides = agreed(&walks, NetworkConfig::PERFECT);
        print(&walks, &sides);
        let found = loops(&walks, &sides);
        println!("office, seed {seed}, from {starts:?} s for {duration} s: loops and false ones {found:?}");
        pairs[0] += walks.len() * (walks.len() - 1) / 2;
        pairs[1] += found.values().filter(|[_, wrong]| *wrong > 0).count();
    }
    println!("office, from {starts:?} s for {duration} s: pairs and false ones {pairs:?}");
    pairs
}

#[test]
fn robots_in_rooms_that_look_alike_have_no_false_loops() {
    assert_eq!(look_alike(1..=1, &[0, 26, 52, 78], 26), [6, 0]);
}

#[test]
#[ignore = "two minutes"]
fn three_robots_in_rooms_that_look_alike_have_no_false_loops() {
    assert_eq!(look_alike(1..=6, &[0, 26, 52], 26), [18, 0]);
}

#[test]
#[ignore = "five minutes"]
fn four_robots_in_rooms_that_look_alike_have_no_false_loops() {
    assert_eq!(look_alike(2..=12, &[0, 26, 52, 78], 26), [66, 0]);
}

/// Each stays in its room, so that hardly anything that it sees contradicts another room like it.
#[test]
#[ignore = "three minutes"]
fn robots_that_stay_in_rooms_that_look_alike_have_no_false_loops() {
    assert_eq!(look_alike(1..=6, &[5, 31, 57, 83], 18), [36, 0]);
}

#[test]
#[ignore = "a table for docs/figures/team.md: three minutes"]
fn table() {
    println!(
        "| seed | alone, m | agreed, each, m | all | joint map, all, m | kB sent by each | kB of the maps as sent |"
    );
    for seed in 1..=6 {
        let walks = house(seed);
        let sides = agreed(&walks, NetworkConfig::PERFECT);
        print(&walks, &sides);
        let alone: Vec<f64> =
            walks.iter().map(|(r, w)| errors(&poses_of(&w.file), &walks, &[*r]).0).collect();
        println!("house, seed {seed}: loops and false ones {:?}", loops(&walks, &sides));
        let (all, each) = errors(&poses(&sides), &walks, &[1, 2, 3]);
        let in_pieces = |walk: &Walk| {
            let mut pieces = cairn_atlas::store::pieces::Pieces::default();
            pieces.add(&walk.file).expect("in memory");
            pieces.bytes().to_vec()
        };
        let parts: BTreeMap<RobotId, Vec<u8>> = walks.iter().map(|(r, w)| (*r, in_pieces(w))).collect();
        let kb: Vec<usize> = parts.values().map(|bytes| bytes.len() / 1000).collect();
        let joint = shared_atlas(&parts, &Config::default()).expect("maps").merged.file;
        let joint = errors(&poses_of(&joint), &walks, &[1, 2, 3]).0;
        let sent: Vec<u64> = sides
            .values()
            .map(|s| s.peer.traffic().sent.values().map(|a| a.bytes).sum::<u64>() / 1000)
            .collect();
        println!("| {seed} | {alone:.3?} | {each:.3?} | {all:.3} | {joint:.3} | {sent:?} | {kb:?} |");
    }
}
