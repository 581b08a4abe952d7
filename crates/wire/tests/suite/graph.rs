//! Robots that agree on one pose graph over real links: each knows its own graph only.

use cairn_geometry::Se3;
use cairn_solve::graph::Metric;
use cairn_team::files::{OwnGraph, read_own, vertex_id};
use cairn_team::peer::{Identity, Peer, TeamKey};
use cairn_team::{CentralGraph, GraphPeer, JudgeConfig, PoseId, Robot, RobotId};
use cairn_wire::Member;
use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

#[path = "../../../team/tests/suite/common/recorded.rs"]
mod recorded;

/// A robot with its link to the others.
struct Walker {
    member: Member,
    graph: GraphPeer<Se3, 6>,
}

impl Walker {
    fn new(text: &str, started: u32, dial: &[String]) -> Self {
        let OwnGraph::Space(own) = read_own(text).unwrap() else { panic!("the graph is in space") };
        let identity = Identity::from_seed(own.robot, &[own.robot as u8; 32]).unwrap();
        let member = Member::open(Peer::new(identity, TeamKey::new(b"key")), "127.0.0.1:0", dial).unwrap();
        let robot = Robot::new(&own, Some(JudgeConfig::default())).unwrap().starting_at(started);
        Self { member, graph: GraphPeer::new(robot) }
    }

    fn step(&mut self) {
        let lines = self.member.step(Duration::from_millis(10));
        assert!(lines.iter().all(|line| line.contains("was closed")), "{lines:?}");
        let update = self.graph.update(self.member.peer_mut()).unwrap();
        assert!(update.refused.is_empty(), "{:?}", update.refused);
    }

    fn poses(&self) -> impl Iterator<Item = (PoseId, Se3)> {
        self.graph.robot().own_poses().map(|(id, pose)| (id, *pose))
    }
}

/// Excess of the chi-square of the team's poses over that of the optimum, as a part of it.
fn above(central: &CentralGraph<Se3, 6>, optimum: f64, walkers: &BTreeMap<RobotId, Walker>) -> f64 {
    // One solver numbers the robots from zero, and their poses from the first.
    let number: BTreeMap<RobotId, RobotId> = walkers.keys().zip(0..).map(|(robot, n)| (*robot, n)).collect();
    let poses: BTreeMap<PoseId, Se3> = walkers
        .values()
        .flat_map(Walker::poses)
        .map(|(id, pose)| (PoseId { robot: number[&id.robot], seq: id.seq }, pose))
        .collect();
    let poses: Vec<Se3> = central.ids.iter().map(|id| poses[id]).collect();
    central.chi2(&poses, &BTreeSet::new()) / optimum - 1.0
}

/// Steps all until they are within a part of the optimum.
fn settle(
    central: &CentralGraph<Se3, 6>,
    optimum: f64,
    walkers: &mut BTreeMap<RobotId, Walker>,
    within: f64,
) -> f64 {
    let until = Instant::now() + Duration::from_secs(60);
    loop {
        walkers.values_mut().for_each(Walker::step);
        let above = above(central, optimum, walkers);
        if above < within {
            return above;
        }
        assert!(Instant::now() < until, "{above} above the optimum after a minute");
    }
}

/// Four robots of which three know the address of one only. One ends when all agree, and comes back knowing nothing but its own graph,
/// while another is away.
#[test]
fn four_agree_over_one_that_all_know_and_one_is_started_again() {
    let Some(texts) = recorded::texts("argos-4") else { return };
    let central = CentralGraph::new(&recorded::graphs(&texts)).unwrap();
    let optimum = 2.0 * central.optimum(&BTreeSet::new()).cost(Metric::Geodesic);
    assert!((optimum / 7185.57 - 1.0).abs() < 2e-6, "{optimum}");
    let first = Walker::new(&texts[0], 1, &[]);
    let hub = vec![first.member.address().to_string()];
    let others = texts[1..].iter().map(|text| Walker::new(text, 1, &hub));
    let mut walkers: BTreeMap<RobotId, Walker> =
        std::iter::once(first).chain(others).map(|w| (w.graph.robot().id(), w)).collect();
    assert_eq!(walkers.keys().copied().collect::<Vec<_>>(), [b'a', b'b', b'c', b'd'].map(u16::from));
    let reached = settle(&central, optimum, &mut walkers, 1e-6);
    println!("{reached:.1e} above the optimum");
    for (robot, walker) in &walkers {
        let sent: u64 = walker.member.peer().traffic().sent.values().map(|amount| amount.bytes).sum();
        println!("robot {robot} sent {sent} B in {} steps", walker.graph.steps());
        assert!(sent < 150_000);
    }
    // Robot b is started again: its poses are those of its file, in a frame of its own, until it has heard the others.
    walkers.remove(&u16::from(b'b'));
    let again = Walker::new(&texts[1], 1000, &hub);
    walkers.insert(u16::from(b'b'), again);
    assert!(above(&central, optimum, &walkers) > 1.0);
    settle(&central, optimum, &mut walkers, 1e-6);
}

#[test]
fn ids_of_vertices_name_robot_and_pose() {
    let edge = |a: u64, b: u64| format!("EDGE_SE2 {a} {b} 1 0 0 100 0 0 100 0 400");
    let id = |robot: u8, seq: u32| vertex_id(PoseId { robot: robot.into(), seq });
    let vertex = |id: u64| format!("VERTEX_SE2 {id} 0 0 0");
    let (a, b) = ([id(b'a', 0), id(b'a', 1)], id(b'b', 7));
    let text = [vertex(a[0]), vertex(a[1]), edge(a[0], a[1]), edge(a[1], b)].join("\n");
    let OwnGraph::Plane(own) = read_own(&text).unwrap() else { panic!("the graph is in the plane") };
    assert_eq!((own.robot, own.poses.len(), own.measurements.len()), (97, 2, 2));
    assert_eq!(own.measurements[1].b, PoseId { robot: 98, seq: 7 });
    let why = |text: &[String]| read_own(&text.join("\n")).unwrap_err().to_string();
    assert!(why(&[edge(a[0], a[1])]).contains("no vertex"));
    assert!(why(&[vertex(3), edge(3, b)]).contains("vertex 3 does not name its robot"));
    assert!(why(&[vertex(a[0]), edge(a[0], 12)]).contains("vertex 12 does not name its robot"));
    assert!(why(&[vertex(a[0]), vertex(b), edge(a[0], b)]).contains("of another robot than the first"));
    assert!(why(&[vertex(a[0]), "EDGE_SE2 1 oops".into()]).contains("line 2"));
    assert!(why(&[vertex(a[0]), vertex(a[0] + (1 << 40)), edge(a[0], a[1])]).contains("does not name"));
}
