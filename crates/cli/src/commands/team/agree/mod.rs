//! `cairn team agree`: one robot of a team that agrees on a pose graph over the network.

mod agreeing;

use super::member::{Reach, identity, team_key};
use crate::commands::solve::text_of;
use crate::failure::Failure;
use crate::interrupt;
use crate::number::number;
use crate::output::{Output, note, warn};
use crate::outputs::Outputs;
use agreeing::Agreeing;
use cairn::geometry::Se3;
use cairn::team::RobotId;
use cairn::team::peer::{MAX_PART_BYTES, Peer, PeerKind};
use cairn::{AgreeingMap, Config, own_part};
use cairn_atlas::KeyFrameName;
use cairn_atlas::store::MAGIC;
use cairn_eval::to_tum;
use cairn_geometry::Trajectory;
use cairn_solve::Loss;
use cairn_solve::g2o::{self, G2o, Graph, Named};
use cairn_solve::graph::{PoseGraph, Rigid};
use cairn_team::files::{OwnGraph, ReadError, read_own, vertex_id};
use cairn_team::{GraphPeer, JudgeConfig, PoseId, Robot, RobotError, RobotGraph};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Agrees with other robots on one pose graph, over the network and without a coordinator.
///
/// GRAPH is what this robot alone knows: a g2o file with its own poses, the measurements between them, and loops to poses of others (the
/// upper byte of a vertex id is the robot, as in the symbols of GTSAM: 97 is a), or its saved map (.map, with --robot), of which the graph is
/// made and loops are found: the words of its key frames go to all, features of a few to those who saw what looks the same, the map
/// itself stays. Then what goes over the network is the graph condensed to the poses that others see. Loops are tested for
/// consistency, and false ones are left out.
///
/// Ends when nothing has changed for five seconds and those that are reached know it, or with Ctrl-C, and writes its own poses in the
/// frame of the team.
#[derive(clap::Args)]
pub struct Arguments {
    /// The g2o file or the saved map of this robot.
    graph: PathBuf,
    /// The number of this robot, as in cairn run --robot; for a saved map.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8))]
    robot: Option<u8>,
    /// The name of the team; robots of other teams are not heard.
    #[arg(long, value_name = "NAME", default_value = "cairn")]
    team: String,
    #[command(flatten)]
    reach: Reach,
    /// Its poses as agreed, with the measurements between them.
    #[arg(long, value_name = "OUT.g2o")]
    out: PathBuf,
    /// The poses of the body at the key frames of a saved map, as agreed.
    #[arg(long, value_name = "OUT.tum")]
    trajectory: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    overwrite: bool,
    /// Believes every loop between robots.
    #[arg(long)]
    believe_all: bool,
    /// Ends after this many seconds, not before.
    #[arg(long = "for", value_name = "S", value_parser = number(0.0..=1e9, "a number of seconds"))]
    time: Option<f64>,
}

/// What a robot came to.
#[derive(Serialize)]
struct Agreed {
    robot: RobotId,
    poses: usize,
    shares_poses: usize,
    /// The robots whose graphs it knows.
    agreed_with: Vec<RobotId>,
    /// How often it computed its poses again.
    steps: usize,
    seconds: f64,
    /// Whether nothing changed at the end.
    settled: bool,
    /// Its loops to others, and those that it does not believe.
    loops: usize,
    rejected: usize,
    sent_bytes: u64,
    received_bytes: u64,
    /// What was sent, by kind.
    sent_bytes_of: BTreeMap<PeerKind, u64>,
    refused: u64,
}

/// Reads the graph or the map, agrees, writes.
///
/// # Errors
/// When the graph is invalid, the address cannot be listened on, or the file cannot be written.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let outputs = Outputs::new(a.overwrite).input("GRAPH", Some(&a.graph)).output("--out", Some(&a.out));
    let outputs = outputs.output("--trajectory", a.trajectory.as_deref()).checked()?;
    let (agreed, file, trajectory) = if is_map(&a.graph) {
        agree_on_map(a)?
    } else {
        if a.robot.is_some() || a.trajectory.is_some() {
            let what = if a.robot.is_some() { "--robot" } else { "--trajectory" };
            let why = "belongs to a saved map; the ids of a graph name the robot";
            return Err(Failure::new(what, why, "leave it out"));
        }
        let text = text_of(&a.graph, "g2o")?;
        let (agreed, file) = match &read_own(&text).map_err(|e| not_own(a, &e))? {
            OwnGraph::Plane(own) => agree_on_graph(own, a, Graph::Plane),
            OwnGraph::Space(own) => agree_on_graph(own, a, Graph::Space),
        }?;
        (agreed, file, String::new())
    };
    outputs.write("--out", || Ok(g2o::write(&file).into_bytes()))?;
    outputs.write("--trajectory", || Ok(trajectory.into_bytes()))?;
    output.result(&agreed, summary)
}

/// Whether a file begins as a saved map does.
fn is_map(path: &Path) -> bool {
    let mut start = [0; MAGIC.len()];
    let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut start));
    read.is_ok() && start == MAGIC
}

fn not_own(a: &Arguments, error: &ReadError) -> Failure {
    let name = a.graph.display();
    let hint = "give one robot's vertices, its edges, and edges to vertices of others, with the robot in the upper byte of each id";
    match error {
        ReadError::Text { line, reason, .. } => Failure::new(format!("{name}, line {line}"), reason, hint),
        other => Failure::new(name.to_string(), other.to_string(), hint),
    }
}

fn failed(a: &Arguments, error: &RobotError) -> Failure {
    let hint = "check that its measurements determine its poses";
    Failure::new(a.graph.display().to_string(), error.to_string(), hint)
}

fn judge(a: &Arguments) -> Option<JudgeConfig> {
    (!a.believe_all).then(JudgeConfig::default)
}

/// A peer of this robot in a team with a name like this.
fn peer(a: &Arguments, robot: RobotId, team: &str) -> Result<Peer, Failure> {
    Ok(Peer::new(identity(robot, &a.graph)?, team_key(team, a.reach.secret.as_deref())?))
}

/// Agrees until nothing changes any more.
fn settle<G: Rigid<D>, const D: usize, R: agreeing::OwnGraph<G, D>>(
    a: &Arguments,
    agreeing: &mut Agreeing<R>,
) -> Result<Agreed, Failure> {
    let robot = agreeing.robot.graph().robot().id();
    note(&format!("robot {} of team {} listens on {}", shown(robot), a.team, agreeing.member.address()));
    interrupt::in_order();
    let began = Instant::now();
    let settled = agreeing.until_settled(a.time.map(Duration::from_secs_f64)).map_err(|e| failed(a, &e))?;
    Ok(report(agreeing, settled, began.elapsed()))
}

fn agree_on_graph<G: Rigid<D>, const D: usize>(
    own: &RobotGraph<G, D>,
    a: &Arguments,
    wrap: fn(Named<G, D>) -> Graph,
) -> Result<(Agreed, G2o), Failure> {
    let robot = Robot::new(own, judge(a)).map_err(|e| failed(a, &e))?.starting_at(seconds_since_1970());
    // Graphs and maps are teams of their own, whatever their names.
    let member = a.reach.member(peer(a, own.robot, &format!("{} graph", a.team))?)?;
    let mut agreeing = Agreeing::new(member, GraphPeer::new(robot));
    let agreed = settle(a, &mut agreeing)?;
    Ok((agreed, file_of(&agreeing.robot, own, wrap)?))
}

fn agree_on_map(a: &Arguments) -> Result<(Agreed, G2o, String), Failure> {
    let name = a.graph.display().to_string();
    let robot = a.robot.ok_or_else(|| {
        Failure::new("--robot", "a map needs the number of its robot", "give that of cairn run --robot")
    })?;
    let fail = |why: String| {
        let hint =
            format!("give a map that robot {robot} made, with depth or an IMU: cairn run --robot {robot}");
        Failure::new(&name, why, hint)
    };
    let bytes = cairn_files::read(&a.graph, MAX_PART_BYTES as u64).map_err(|e| fail(e.to_string()))?;
    let file = own_part(robot.into(), &bytes).map_err(|e| fail(e.to_string()))?;
    let mut peer = peer(a, robot.into(), &format!("{} map graph", a.team))?;
    let own = AgreeingMap::new(file, judge(a), seconds_since_1970(), &Config::default(), &mut peer);
    let own = own.map_err(|e| fail(e.to_string()))?;
    let mut agreeing = Agreeing::new(a.reach.member(peer)?, own);
    let agreed = settle(a, &mut agreeing)?;
    let own = &agreeing.robot;
    for (other, missing) in own.waits_for() {
        let what = format!("{missing} key frames that would tell whether it was where this robot was");
        warn(&format!("no loop to robot {other}: features of {what} have not come"));
    }
    Ok((agreed, file_of(own.graph(), own.own(), Graph::Space)?, trajectory_of(own)?))
}

fn report<G: Rigid<D>, const D: usize, R: agreeing::OwnGraph<G, D>>(
    agreeing: &Agreeing<R>,
    settled: bool,
    took: Duration,
) -> Agreed {
    let (graph, peer) = (agreeing.robot.graph(), agreeing.member.peer());
    let (robot, traffic) = (graph.robot(), peer.traffic());
    Agreed {
        robot: robot.id(),
        poses: robot.own_poses().count(),
        shares_poses: robot.shares(),
        agreed_with: robot.known().filter(|other| *other != robot.id()).collect(),
        steps: graph.steps(),
        seconds: took.as_secs_f64(),
        settled,
        loops: robot.loops().count(),
        rejected: robot.loops().filter(|m| robot.rejects(&m.ends())).count(),
        sent_bytes: traffic.sent.values().map(|amount| amount.bytes).sum(),
        received_bytes: traffic.received.values().map(|amount| amount.bytes).sum(),
        sent_bytes_of: traffic.sent.iter().map(|(kind, amount)| (*kind, amount.bytes)).collect(),
        refused: agreeing.member.refused() + agreeing.refusals.count(),
    }
}

/// Its poses as agreed, with the measurements between them.
fn file_of<G: Rigid<D>, const D: usize>(
    graph: &GraphPeer<G, D>,
    own: &RobotGraph<G, D>,
    wrap: fn(Named<G, D>) -> Graph,
) -> Result<G2o, Failure> {
    let mut poses = PoseGraph::new();
    let (mut ids, mut places) = (Vec::new(), BTreeMap::new());
    for (id, pose) in graph.robot().own_poses() {
        places.insert(id, poses.add_vertex(*pose, false));
        ids.push(vertex_id(id));
    }
    for m in &own.measurements {
        if let (Some(a), Some(b)) = (places.get(&m.a), places.get(&m.b)) {
            poses
                .add_edge(*a, *b, m.a_from_b, &m.information, Loss::Squared)
                .map_err(|e| Failure::new("a measurement", e.to_string(), "check the graph"))?;
        }
    }
    let graph = wrap(Named::of_poses(poses, ids));
    let (unknown, kept) = (BTreeMap::new(), Vec::new());
    Ok(G2o { graph, has_values: true, unknown, replaced: None, kept, form: g2o::Form::G2o })
}

/// The poses of the body at the key frames of its map, as agreed: `t x y z qx qy qz qw`, in the frame of the team.
fn trajectory_of(robot: &AgreeingMap) -> Result<String, Failure> {
    let (snapshot, atlas) = (&robot.file().snapshot, &robot.file().about.camera);
    let pose = |(id, pose): (PoseId, &Se3)| {
        let id = snapshot.key_frame_named(KeyFrameName { robot: id.robot, seq: id.seq })?;
        let k = snapshot.key_frame(id)?;
        Some((k.stamp.0, *pose * k.camera(atlas).body_from_camera.inverse()))
    };
    let poses = robot.graph().robot().own_poses().filter_map(pose).collect();
    let poses = Trajectory::from_unsorted(poses)
        .map_err(|e| Failure::new("--trajectory", e.to_string(), "report this with the map"))?;
    Ok(to_tum(&poses))
}

/// A number that is greater each time a robot is started.
fn seconds_since_1970() -> u32 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| u32::try_from(since.as_secs()).unwrap_or(u32::MAX / 2))
}

/// A robot as its letter where it has one.
fn shown(robot: RobotId) -> String {
    let letter = u8::try_from(robot).ok().filter(u8::is_ascii_alphanumeric);
    letter.map_or_else(|| robot.to_string(), |letter| char::from(letter).to_string())
}

fn summary(a: &Agreed) -> String {
    let others: Vec<String> = a.agreed_with.iter().map(|other| shown(*other)).collect();
    let with =
        if others.is_empty() { "nobody was heard".into() } else { format!("with {}", others.join(", ")) };
    let end =
        if a.settled { "nothing changes any more" } else { "still changing, or nobody is left who hears it" };
    [
        format!("robot     {}, {} poses, of which it shares {}", shown(a.robot), a.poses, a.shares_poses),
        format!("agreed    {with}, after {} steps in {:.1} s; {end}", a.steps, a.seconds),
        format!("loops     {} to others, {} rejected", a.loops, a.rejected),
        format!("sent      {}", kinds(&a.sent_bytes_of)),
        format!(
            "bytes     {:.1} kB sent, {:.1} kB received, {} messages refused",
            a.sent_bytes as f64 / 1e3,
            a.received_bytes as f64 / 1e3,
            a.refused
        ),
    ]
    .join("\n")
}

fn kinds(sent: &BTreeMap<PeerKind, u64>) -> String {
    let kinds: Vec<String> = sent.iter().map(|(kind, bytes)| format!("{kind} {bytes} B")).collect();
    kinds.join(", ")
}
