//! `cairn team status`: what a robot of a team has, what it made of it, and what that cost on the network.

use super::paths::beside;
use crate::failure::Failure;
use crate::output::Output;
use cairn::SharedAtlas;
use cairn::team::RobotId;
use cairn::team::peer::{Amount, PeerKind};
use cairn_files::MIB;
use cairn_wire::Member;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;

/// Shows what a robot that shares its map (cairn team join) has, and the bytes by robot and kind.
#[derive(clap::Args)]
pub struct Arguments {
    /// The atlas, as in cairn team join --out.
    #[arg(value_name = "OUT.map")]
    out: PathBuf,
}

/// What a robot of a team has.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TeamStatus {
    /// This robot.
    pub robot: RobotId,
    /// The same on all robots that have the same maps.
    pub digest: String,
    /// Whether something newer is on its way.
    pub fetching: bool,
    /// The maps that it has.
    pub maps: Vec<MapOfRobot>,
    /// Robots of which it has only the words: they share no place with those above.
    #[serde(default)]
    pub words_only: Vec<MapOfRobot>,
    /// Robots that it hears now.
    pub reached: Vec<RobotId>,
    /// What became of the maps.
    pub atlas: Option<Shown>,
    /// What was sent.
    pub sent: Vec<Sent>,
    /// What was received and believed, by robot.
    pub received: Vec<Received>,
    /// Messages that were refused.
    pub refused: u64,
}

/// The map of a robot.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MapOfRobot {
    /// The robot.
    pub robot: RobotId,
    /// Its version.
    pub version: u32,
    /// Its length.
    pub bytes: usize,
}

/// Messages of a kind that were sent.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Sent {
    /// The kind.
    pub kind: PeerKind,
    /// How many.
    #[serde(flatten)]
    pub amount: Amount,
}

/// Messages of a kind that came from a robot.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Received {
    /// The robot.
    pub robot: RobotId,
    /// The kind.
    pub kind: PeerKind,
    /// How many.
    #[serde(flatten)]
    pub amount: Amount,
}

/// The atlas of the team.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Shown {
    /// The digest of the maps that it was made of.
    pub digest: String,
    /// Its key frames.
    pub key_frames: usize,
    /// Robots whose maps are one, for each map of the atlas.
    pub maps: Vec<Vec<String>>,
    /// Maps that stay apart, and why.
    pub apart: Vec<String>,
    /// Whose map is not in it, and why.
    pub left_out: BTreeMap<RobotId, String>,
}

impl Shown {
    pub(super) fn of(atlas: &SharedAtlas, digest: [u8; 8]) -> Self {
        let merged = &atlas.merged;
        let names = |members: &Vec<cairn::MapOfFile>| {
            let mut names: Vec<String> = members.iter().map(|m| m.name.clone()).collect();
            names.sort();
            names.dedup();
            names
        };
        let apart = merged.attempts.iter().filter_map(|a| {
            let why = a.join.result.as_ref().err()?;
            Some(format!("{} and {}: {why}", a.from.name, a.into.name))
        });
        Self {
            digest: hex(digest),
            key_frames: merged.file.snapshot.key_frame_count(),
            maps: merged.maps.values().map(names).collect(),
            apart: apart.collect(),
            left_out: atlas.left_out.clone(),
        }
    }

    pub(super) fn line(&self) -> String {
        let maps: Vec<String> = self.maps.iter().map(|robots| robots.join(" + ")).collect();
        format!("atlas: {} key frames, {} maps: {}", self.key_frames, maps.len(), maps.join("; "))
    }
}

fn hex(bytes: [u8; 8]) -> String {
    format!("{:016x}", u64::from_be_bytes(bytes))
}

impl TeamStatus {
    pub(super) fn of(member: &Member, atlas: Option<Shown>) -> Self {
        let peer = member.peer();
        let traffic = peer.traffic();
        let of =
            |h: cairn::team::peer::Holding| MapOfRobot { robot: h.robot, version: h.version, bytes: h.bytes };
        let fetched = |robot| robot == peer.robot() || peer.subscription().includes(robot);
        Self {
            robot: peer.robot(),
            digest: hex(peer.digest()),
            fetching: peer.is_fetching(),
            words_only: peer.words().map(|(h, _)| h).filter(|h| !fetched(h.robot)).map(of).collect(),
            maps: peer.holdings().map(of).collect(),
            reached: member.reached().collect(),
            atlas,
            sent: traffic.sent.iter().map(|(kind, amount)| Sent { kind: *kind, amount: *amount }).collect(),
            received: traffic
                .received
                .iter()
                .map(|((robot, kind), amount)| Received { robot: *robot, kind: *kind, amount: *amount })
                .collect(),
            refused: member.refused(),
        }
    }

    /// For people.
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let reached: Vec<String> = self.reached.iter().map(u16::to_string).collect();
        let reached = if reached.is_empty() { "nobody".into() } else { reached.join(", ") };
        let _ = writeln!(text, "robot     {}, hears {reached}; maps {}", self.robot, self.digest);
        for map in &self.maps {
            let megabytes = map.bytes as f64 / 1e6;
            let _ =
                writeln!(text, "map       robot {}, version {}, {megabytes:.3} MB", map.robot, map.version);
        }
        for map in &self.words_only {
            let _ = writeln!(
                text,
                "words     robot {}, version {}, {:.3} MB; shares no place, so its map is not here",
                map.robot,
                map.version,
                map.bytes as f64 / 1e6
            );
        }
        if self.fetching {
            let _ = writeln!(text, "fetching  a newer map");
        }
        if let Some(atlas) = &self.atlas {
            let _ = writeln!(text, "{}", atlas.line().replacen("atlas: ", "atlas     ", 1));
            for why in &atlas.apart {
                let _ = writeln!(text, "apart     {why}");
            }
            for (robot, why) in &atlas.left_out {
                let _ = writeln!(text, "left out  robot {robot}: {why}");
            }
        }
        for Sent { kind, amount } in &self.sent {
            let _ = writeln!(text, "sent      {kind}: {} messages, {} bytes", amount.messages, amount.bytes);
        }
        for Received { robot, kind, amount } in &self.received {
            let (messages, bytes) = (amount.messages, amount.bytes);
            let _ = writeln!(text, "received  {kind} from robot {robot}: {messages} messages, {bytes} bytes");
        }
        if self.refused > 0 {
            let _ = writeln!(text, "refused   {} messages", self.refused);
        }
        text
    }
}

/// Reads what cairn team join wrote.
///
/// # Errors
/// When the file is not there or not valid.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let path = beside(&a.out, "team.json");
    let fail =
        |why: String| Failure::new(path.display().to_string(), why, "give the --out of a cairn team join");
    let text = cairn_files::read_text(&path, 16 * MIB).map_err(|e| fail(e.to_string()))?;
    let status: TeamStatus = serde_json::from_str(&text).map_err(|e| fail(e.to_string()))?;
    output.result(&status, TeamStatus::text)
}
