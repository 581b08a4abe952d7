//! Three robots on simulated walks agree on one pose graph made of their saved maps: words of all key frames, features of a few, and
//! condensed graphs go over a network; the maps stay where they are.

use cairn::geometry::{LieGroup, Se3, umeyama};
use cairn::sensor::Stamp;
use cairn::team::peer::{Identity, Peer, PeerKind, TeamKey, To};
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

fn walks(world: &str, options: impl Fn(usize) -> String) -> BTreeMap<RobotId, Walk> {
    (1..).zip(0..3).map(|(robot, n)| (robot, walk(robot, world, &options(n)))).collect()
}

/// A robot with its side of the network.
struct Side {
    peer: Peer,
    robot: AgreeingMap,
}

/// All update and exchange messages until nothing was new for ten rounds.
fn agreed(walks: &BTreeMap<RobotId, Walk>, network: NetworkConfig) -> BTreeMap<RobotId, Side> {
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
        for packet in network.deliver() {
            let peer = &mut sides.get_mut(&packet.to).expect("a robot").peer;
            out.extend(peer.receive(&packet.bytes).expect("honest").into_iter().map(|m| (packet.to, m)));
        }
        for (from, message) in out {
            for to in walks.keys().filter(|to| **to != from) {
                if message.to == To::All || message.to == To::Robot(*to) {
                    sides.get_mut(&from).expect("a robot").peer.sent(&message);
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
    format!("{all} B: words {words}, places {places}, graph {graph}, other {}", all - words - places - graph)
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
    let walks = walks("demo", |n| format!("seed=5&{}", THREE[n]));
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

/// Rooms that look the same, each robot in another one: no loop between two is believed.
fn look_alike(seed: u32) {
    let walks = walks("office", |n| {
        format!("sensor=rgbd&seed={seed}&look_alike=1&duration=26&start={}", [0, 26, 52][n])
    });
    let sides = agreed(&walks, NetworkConfig::PERFECT);
    print(&walks, &sides);
    for side in sides.values() {
        assert_eq!(side.robot.graph().robot().loops().count(), 0, "seed {seed}");
    }
}

#[test]
fn robots_in_rooms_that_look_alike_have_no_loops() {
    look_alike(1);
}

#[test]
#[ignore = "two minutes"]
fn robots_in_more_rooms_that_look_alike_have_no_loops() {
    (2..=6).for_each(look_alike);
}

#[test]
#[ignore = "a table for docs/team.md: three minutes"]
fn table() {
    println!(
        "| seed | alone, m | agreed, each, m | all | joint map, all, m | kB sent by each | kB of the maps as sent |"
    );
    for seed in 1..=6 {
        let walks = walks("demo", |n| format!("seed={seed}&{}", THREE[n]));
        let sides = agreed(&walks, NetworkConfig::PERFECT);
        print(&walks, &sides);
        let alone: Vec<f64> =
            walks.iter().map(|(r, w)| errors(&poses_of(&w.file), &walks, &[*r]).0).collect();
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
