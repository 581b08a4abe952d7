//! `cairn team join`: shares a saved map, as it grows, with other robots, and keeps the atlas of all of them.

use super::member::{Reach, identity, team_key};
use super::paths::beside;
use super::status::{Shown, TeamStatus};
use crate::commands::map::failed;
use crate::failure::Failure;
use crate::interrupt;
use crate::map_lock::MapLock;
use crate::number::number;
use crate::output::{Output, note, warn};
use crate::outputs::Outputs;
use cairn::team::RobotId;
use cairn::team::peer::{MapSubscription, Peer};
use cairn::{Config, MapOverlaps, SharedAtlas, TeamAtlas, in_reach, own_part, words_of_map};
use cairn_atlas::store::pieces::Pieces;
use cairn_wire::Member;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

/// Shares a saved map with other robots, and keeps one atlas of all their maps.
///
/// For a walk of another program than cairn run --team: each time the map is saved, the others get it. They need not be
/// reached all at once: whoever has a robot's map passes it on. The atlas of all is written to --out whenever something
/// new has come, and is the same file on every robot that has the same maps. Robots learn from the words of each other's
/// key frames who shares places with whom, and fetch only those maps. Ends with Ctrl-C.
#[derive(clap::Args)]
pub struct Arguments {
    /// The map of this robot; it need not exist yet.
    map: PathBuf,
    /// The number of this robot, as in cairn run --robot.
    #[arg(long, value_name = "N")]
    robot: RobotId,
    /// The name of the team; robots of other teams are not heard.
    #[arg(long, value_name = "NAME", default_value = "cairn")]
    team: String,
    #[command(flatten)]
    reach: Reach,
    /// The atlas of all robots; beside it OUT.team.json, which cairn team status shows.
    #[arg(long, value_name = "OUT.map")]
    out: PathBuf,
    /// Replace the atlas of an earlier time.
    #[arg(long)]
    overwrite: bool,
    /// Fetch the maps of all robots, also of those that share no place with this one; for a base station.
    #[arg(long)]
    all: bool,
    /// Ends after this many seconds.
    #[arg(long = "for", value_name = "S", value_parser = number(0.0..=1e9, "a number of seconds"))]
    time: Option<f64>,
}

/// How long messages are exchanged before files are looked at again.
const STEP: Duration = Duration::from_millis(500);

/// At the end, how long is waited for the others to get the last map.
const LAST: Duration = Duration::from_secs(20);

/// A map is not fetched again for so many seconds: what local mapping moves at each save is then sent more rarely.
pub(super) const REFRESH_S: usize = 8;

/// Shares until interrupted or the time is over.
///
/// # Errors
/// When a file cannot be read or written, or the address cannot be listened on.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    // The map need not exist yet, and is not written here; its place is checked like that of an output.
    let outputs = Outputs::new(a.overwrite).output_kept("MAP", Some(&a.map));
    let outputs = outputs.output_map("--out", Some(&a.out)).checked()?;
    let out = outputs.file("--out").unwrap_or(&a.out).to_owned();
    let _lock = MapLock::take(&out)?;
    let mut robot = Robot::open(a.robot, &a.team, &a.reach, (&a.map, out), a.all)?;
    interrupt::in_order();
    let began = Instant::now();
    let ends = |began: Instant| a.time.is_some_and(|s| began.elapsed().as_secs_f64() >= s);
    while !interrupt::requested() && !ends(began) {
        robot.step()?;
    }
    robot.finish()?;
    output.result(&robot.status(), TeamStatus::text)
}

/// The map of a run, shared on a thread of its own while it grows.
pub struct Sharing {
    ends: Arc<AtomicBool>,
    thread: JoinHandle<Result<(), Failure>>,
}

impl Sharing {
    /// Begins to share the map of this robot; `out` becomes the atlas of all.
    ///
    /// # Errors
    /// When a file cannot be read, or the address cannot be listened on.
    pub fn begin(robot: RobotId, team: &str, reach: &Reach, map: &Path, out: &Path) -> Result<Self, Failure> {
        let lock = MapLock::take(out)?;
        let mut robot = Robot::open(robot, team, reach, (map, out.to_owned()), false)?;
        let ends = Arc::new(AtomicBool::new(false));
        let ended = ends.clone();
        let share = move || {
            let _lock = lock;
            while !ended.load(Ordering::SeqCst) {
                robot.step()?;
            }
            robot.until_heard()?;
            robot.finish()
        };
        let thread = std::thread::Builder::new().name("team-share".into()).spawn(share);
        let thread = thread
            .map_err(|e| Failure::new("--team", e.to_string(), "close other programs and try again"))?;
        Ok(Self { ends, thread })
    }

    /// Shares the last map, and ends when the others that are reached have it.
    ///
    /// # Errors
    /// When the atlas cannot be written.
    pub fn end(self) -> Result<(), Failure> {
        self.ends.store(true, Ordering::SeqCst);
        let stopped = || Failure::new("--team", "sharing stopped", "see the lines above");
        self.thread.join().unwrap_or_else(|_| Err(stopped()))
    }
}

/// What the others got of this robot's map, beside the map: a robot that is started again goes on from there.
const PIECES: &str = "pieces";

/// What the others got of this robot's map at an earlier time; nothing where that cannot be read.
fn earlier_pieces(map: &Path) -> Pieces {
    let most = cairn::team::peer::MAX_PART_BYTES as u64;
    let bytes = cairn_files::read(&beside(map, PIECES), most).ok();
    bytes.and_then(|bytes| Pieces::open(&bytes).ok()).unwrap_or_default()
}

/// The digest of the maps that were joined, what is kept for the next time, and what became of them; `None` where nothing could.
type Work = ([u8; 8], TeamAtlas, Option<SharedAtlas>);

/// This robot with its files.
struct Robot {
    member: Member,
    map: PathBuf,
    out: PathBuf,
    /// This robot's map as the others get it.
    pieces: Pieces,
    /// The map file as it was read last.
    seen: Option<(SystemTime, u64)>,
    /// What became of the maps, and of which (by the digest).
    atlas: Option<Shown>,
    digest: [u8; 8],
    /// What is kept from one atlas to the next; away while maps are being joined.
    team_atlas: Option<TeamAtlas>,
    /// The maps being joined, on a thread of their own: the others go on being heard.
    work: Option<JoinHandle<Work>>,
    /// The version of each robot's map, as it was said last.
    heard: BTreeMap<RobotId, u32>,
    /// Who shares places with whom; `None` where the maps of all are wanted.
    overlaps: Option<MapOverlaps>,
}

impl Robot {
    fn open(
        robot: RobotId,
        team: &str,
        reach: &Reach,
        (map, out): (&Path, PathBuf),
        all: bool,
    ) -> Result<Self, Failure> {
        let key = team_key(team, reach.secret.as_deref())?;
        let mut peer = Peer::new(identity(robot, map)?, key).with_refresh(REFRESH_S);
        if !all {
            peer.subscribe(MapSubscription::Of(BTreeSet::new()));
        }
        let member = reach.member(peer)?;
        note(&format!("robot {robot} of team {team} listens on {}", member.address()));
        Ok(Self {
            member,
            pieces: earlier_pieces(map),
            map: map.to_owned(),
            out,
            seen: None,
            atlas: None,
            digest: [0; 8],
            team_atlas: None,
            work: None,
            heard: BTreeMap::new(),
            overlaps: (!all).then(MapOverlaps::default),
        })
    }

    /// Goes on until all robots that are reached have the last map, or it takes too long.
    fn until_heard(&mut self) -> Result<(), Failure> {
        let until = Instant::now() + LAST;
        loop {
            self.step()?;
            let peer = self.member.peer();
            let mut reached = self.member.reached();
            let has_none = peer.holdings().all(|holding| holding.robot != peer.robot());
            if has_none
                || reached.all(|other| peer.is_up_to_date(other))
                || Instant::now() > until
                || interrupt::requested()
            {
                return Ok(());
            }
        }
    }

    fn step(&mut self) -> Result<(), Failure> {
        self.publish();
        self.member.step(STEP).iter().for_each(|line| warn(line));
        if let Some(overlaps) = &mut self.overlaps
            && self.member.peer().has_new_words()
        {
            let peer = self.member.peer_mut();
            overlaps.update(peer).iter().for_each(|line| note(line));
            peer.subscribe(MapSubscription::Of(in_reach(peer.robot(), &overlaps.pairs())));
        }
        for holding in self.member.peer().holdings() {
            if self.heard.insert(holding.robot, holding.version) != Some(holding.version) {
                let megabytes = holding.bytes as f64 / 1e6;
                note(&format!("robot {}: version {}, {megabytes:.3} MB", holding.robot, holding.version));
            }
        }
        if self.work.as_ref().is_some_and(JoinHandle::is_finished) {
            self.take_over()?;
        }
        if self.work.is_none() && !self.member.peer().is_fetching() {
            self.begin_join();
        }
        self.write_status()
    }

    /// Publishes the map if its file has changed.
    fn publish(&mut self) {
        let Ok(about) = std::fs::metadata(&self.map) else { return };
        let Ok(at) = about.modified() else { return };
        if self.seen == Some((at, about.len())) {
            return;
        }
        self.seen = Some((at, about.len()));
        let shown = self.map.display();
        let most = cairn::team::peer::MAX_PART_BYTES as u64;
        let bytes = match cairn_files::read(&self.map, most) {
            Ok(bytes) => bytes,
            Err(e) => return warn(&format!("{shown} is not shared: {e}")),
        };
        let robot = self.member.peer().robot();
        let published = own_part(robot, &bytes).map_err(|e| e.to_string()).and_then(|file| {
            self.pieces.add(&file).map_err(|e| e.to_string())?;
            let peer = self.member.peer_mut();
            let (words, lengths) = words_of_map(robot, &file);
            if !words.is_empty() {
                peer.publish_words(&words, &lengths).map_err(|e| e.to_string())?;
            }
            peer.publish_pieces(self.pieces.bytes(), self.pieces.lengths()).map_err(|e| e.to_string())
        });
        match published {
            // Without the file all is sent again when this program is started again, no more.
            Ok(_) => _ = cairn_eval::write_bytes_whole(&beside(&self.map, PIECES), self.pieces.bytes()),
            Err(why) => {
                warn(&format!("{shown} is not shared: {why}; make it with cairn run --robot {robot}"))
            }
        }
    }

    /// Starts to join the maps if they are others than last time.
    fn begin_join(&mut self) {
        let peer = self.member.peer();
        let digest = peer.digest();
        if digest == self.digest || peer.holdings().next().is_none() {
            return;
        }
        let parts: BTreeMap<RobotId, Vec<u8>> = peer.parts().map(|(h, bytes)| (h.robot, bytes)).collect();
        let mut team_atlas = self.team_atlas.take().unwrap_or_else(|| TeamAtlas::new(&Config::default()));
        let join = move || {
            let atlas = team_atlas.update(&parts);
            (digest, team_atlas, atlas)
        };
        self.work = std::thread::Builder::new().name("team-join".into()).spawn(join).ok();
    }

    /// Writes the atlas that was made.
    fn take_over(&mut self) -> Result<(), Failure> {
        let Some(Ok((digest, team_atlas, atlas))) = self.work.take().map(JoinHandle::join) else {
            return Err(Failure::new("the atlas", "joining the maps failed", "see the lines above"));
        };
        self.digest = digest;
        self.team_atlas = Some(team_atlas);
        let Some(atlas) = atlas else { return Ok(()) };
        atlas.merged.file.save(&self.out).map_err(|e| failed(&self.out, &e))?;
        let shown = Shown::of(&atlas, digest);
        note(&shown.line());
        self.atlas = Some(shown);
        Ok(())
    }

    /// Joins what came last.
    fn finish(&mut self) -> Result<(), Failure> {
        if self.work.is_some() {
            self.take_over()?;
        }
        self.begin_join();
        if self.work.is_some() {
            self.take_over()?;
        }
        self.write_status()
    }

    fn status(&self) -> TeamStatus {
        TeamStatus::of(&self.member, self.atlas.clone())
    }

    fn write_status(&self) -> Result<(), Failure> {
        let path = beside(&self.out, "team.json");
        let fail = |e: std::io::Error| {
            Failure::new(path.display().to_string(), e.to_string(), "check that the disk has room")
        };
        let text = serde_json::to_string_pretty(&self.status()).map_err(|e| fail(e.into()))?;
        // Replaced whole, so that nobody reads half of it.
        let new = beside(&self.out, "team.json.new");
        std::fs::write(&new, text).and_then(|()| std::fs::rename(&new, &path)).map_err(fail)
    }
}
