//! `cairn team agree`: one robot of a team that agrees on a pose graph over the network.

use super::member::{Reach, identity, team_key};
use crate::commands::solve::text_of;
use crate::failure::Failure;
use crate::interrupt;
use crate::number::number;
use crate::output::{Output, note, warn};
use crate::outputs::Outputs;
use cairn::team::RobotId;
use cairn::team::peer::{Peer, RefusalLog};
use cairn_solve::Loss;
use cairn_solve::g2o::{self, G2o, Graph, Named};
use cairn_solve::graph::{PoseGraph, Rigid};
use cairn_team::files::{OwnGraph, ReadError, read_own, vertex_id};
use cairn_team::{GraphPeer, JudgeConfig, Robot, RobotError, RobotGraph};
use cairn_wire::Member;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Agrees with other robots on one pose graph, over the network and without a coordinator.
///
/// GRAPH is what this robot alone knows: its own poses, the measurements between them, and loops to poses of others. The upper byte of a
/// vertex id is the robot, as in the symbols of GTSAM (97 is a). What goes over the network is the graph condensed to the poses that
/// others see. Loops are tested for consistency, and false ones are left out.
///
/// Ends when nothing has changed for five seconds and those that are reached know it, or with Ctrl-C, and writes its own poses in the
/// frame of the team.
#[derive(clap::Args)]
pub struct Arguments {
    /// The g2o file of this robot.
    graph: PathBuf,
    /// The name of the team; robots of other teams are not heard.
    #[arg(long, value_name = "NAME", default_value = "cairn")]
    team: String,
    #[command(flatten)]
    reach: Reach,
    /// Its poses as agreed, with the measurements between them.
    #[arg(long, value_name = "OUT.g2o")]
    out: PathBuf,
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

/// How long messages are exchanged before they are looked at.
const STEP: Duration = Duration::from_millis(200);
/// Poses that moved less than this (m, rad) do not move any more, after so long.
const STILL: f64 = 1e-4;
const STILL_FOR: Duration = Duration::from_secs(5);

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
    refused: u64,
}

/// Reads the graph, agrees, writes.
///
/// # Errors
/// When the graph is invalid, the address cannot be listened on, or the file cannot be written.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let outputs = Outputs::new(a.overwrite).input("GRAPH", Some(&a.graph)).output("--out", Some(&a.out));
    let outputs = outputs.checked()?;
    let text = text_of(&a.graph, "g2o")?;
    let own = read_own(&text).map_err(|e| not_own(a, &e))?;
    let (agreed, file) = match &own {
        OwnGraph::Plane(own) => agree(own, a, Graph::Plane),
        OwnGraph::Space(own) => agree(own, a, Graph::Space),
    }?;
    outputs.write("--out", || Ok(g2o::write(&file).into_bytes()))?;
    output.result(&agreed, summary)
}

fn not_own(a: &Arguments, error: &ReadError) -> Failure {
    let name = a.graph.display();
    let hint = "give one robot's vertices, its edges, and edges to vertices of others, with the robot in the upper byte of each id";
    match error {
        ReadError::Text { line, reason, .. } => Failure::new(format!("{name}, line {line}"), reason, hint),
        other => Failure::new(name.to_string(), other.to_string(), hint),
    }
}

fn agree<G: Rigid<D>, const D: usize>(
    own: &RobotGraph<G, D>,
    a: &Arguments,
    wrap: fn(Named<G, D>) -> Graph,
) -> Result<(Agreed, G2o), Failure> {
    let fail = |e: RobotError| {
        let hint = "check that its measurements determine its poses";
        Failure::new(a.graph.display().to_string(), e.to_string(), hint)
    };
    let judge = (!a.believe_all).then(JudgeConfig::default);
    let robot = Robot::new(own, judge).map_err(fail)?.starting_at(seconds_since_1970());
    // Graphs and maps are teams of their own, whatever their names.
    let key = team_key(&format!("{} graph", a.team), a.reach.secret.as_deref())?;
    let member = a.reach.member(Peer::new(identity(own.robot, &a.graph)?, key))?;
    note(&format!("robot {} of team {} listens on {}", shown(own.robot), a.team, member.address()));
    let mut agreeing = Agreeing { member, graph: GraphPeer::new(robot), refusals: RefusalLog::default() };
    interrupt::in_order();
    let began = Instant::now();
    let settled = agreeing.until_settled(a.time.map(Duration::from_secs_f64)).map_err(fail)?;
    Ok((agreeing.report(own, settled, began.elapsed()), agreeing.file(own, wrap)?))
}

/// A robot with its link to the others.
struct Agreeing<G, const D: usize> {
    member: Member,
    graph: GraphPeer<G, D>,
    refusals: RefusalLog,
}

impl<G: Rigid<D>, const D: usize> Agreeing<G, D> {
    /// Goes on until nothing changes any more, a time is over, or a signal comes; whether nothing changed at the end.
    fn until_settled(&mut self, time: Option<Duration>) -> Result<bool, RobotError> {
        let began = Instant::now();
        let mut moved_at = began;
        let mut known = 0;
        loop {
            self.member.step(STEP).iter().for_each(|line| warn(line));
            let update = self.graph.update(self.member.peer_mut())?;
            for (robot, why) in &update.refused {
                if let Some(line) = self.refusals.line(why) {
                    warn(&format!("robot {}: {line}", shown(*robot)));
                }
            }
            let now = Instant::now();
            let robots = self.graph.robot().known().count();
            if robots != known || update.moved > STILL {
                (known, moved_at) = (robots, now);
            }
            let settled = known > 1 && now - moved_at > STILL_FOR && self.is_heard();
            let is_over = time.is_some_and(|time| now - began >= time);
            if is_over || (settled && time.is_none()) || interrupt::requested() {
                return Ok(settled);
            }
        }
    }

    /// Whether nothing is on its way, and all that are reached have what this robot published last.
    fn is_heard(&self) -> bool {
        let peer = self.member.peer();
        !peer.is_fetching() && self.member.reached().all(|other| peer.is_up_to_date(other))
    }

    fn report(&self, own: &RobotGraph<G, D>, settled: bool, took: Duration) -> Agreed {
        let (robot, traffic) = (self.graph.robot(), self.member.peer().traffic());
        let to_others = own.measurements.iter().filter(|m| m.own_end(own.robot).is_some());
        Agreed {
            robot: own.robot,
            poses: own.poses.len(),
            shares_poses: robot.shares(),
            agreed_with: robot.known().filter(|other| *other != own.robot).collect(),
            steps: self.graph.steps(),
            seconds: took.as_secs_f64(),
            settled,
            loops: to_others.clone().count(),
            rejected: to_others.filter(|m| robot.rejects(&m.ends())).count(),
            sent_bytes: traffic.sent.values().map(|amount| amount.bytes).sum(),
            received_bytes: traffic.received.values().map(|amount| amount.bytes).sum(),
            refused: self.member.refused() + self.refusals.count(),
        }
    }

    /// Its own poses, with the measurements between them.
    fn file(&self, own: &RobotGraph<G, D>, wrap: fn(Named<G, D>) -> Graph) -> Result<G2o, Failure> {
        let mut graph = PoseGraph::new();
        let (mut ids, mut places) = (Vec::new(), BTreeMap::new());
        for (id, pose) in self.graph.robot().own_poses() {
            places.insert(id, graph.add_vertex(*pose, false));
            ids.push(vertex_id(id));
        }
        for m in &own.measurements {
            if let (Some(a), Some(b)) = (places.get(&m.a), places.get(&m.b)) {
                graph
                    .add_edge(*a, *b, m.a_from_b, &m.information, Loss::Squared)
                    .map_err(|e| Failure::new("a measurement", e.to_string(), "check the graph"))?;
            }
        }
        let graph = wrap(Named { graph, ids });
        Ok(G2o { graph, has_values: true, unknown: BTreeMap::new(), replaced: None })
    }
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
        format!(
            "bytes     {:.1} kB sent, {:.1} kB received, {} messages refused",
            a.sent_bytes as f64 / 1e3,
            a.received_bytes as f64 / 1e3,
            a.refused
        ),
    ]
    .join("\n")
}
