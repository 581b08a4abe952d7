//! The costs of one robot, measured on this machine: two short simulated walks of one house, what they send and weigh, and how
//! long what robots do with their maps takes. Half a minute at most.

use super::costs::{Costs, Power, Straight};
use crate::merge::WHOLE_KEY_FRAMES;
use crate::reach::{MapWords, words_of_map};
use crate::{Config, Error, Slam, map_file, open, shared_atlas};
use cairn_atlas::store::pieces::{self, Pieces};
use cairn_atlas::store::{MapFile, StoreError};
use cairn_atlas::{KeyFrame, KeyFrameId, PlaceIndex, RobotId};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_mapping::Closer;
use cairn_random::Random;
use cairn_sensor::Stamp;
use cairn_solve::Loss;
use cairn_solve::graph::{GraphConfig, PoseGraph};
use cairn_team::peer::{Identity, Peer, PeerKind, TeamKey, To};
use cairn_vision::bow::{BagOfWords, WordId};
use std::collections::BTreeMap;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

/// Both walks, as those of `cairn demo --team`.
const WALKS: [&str; 2] = ["duration=24", "start=6&duration=16&speed=1.05&height=1.4"];
const WORLD: &str = "sim:demo?seed=5&sensor=rgbd&resolution=320x240&rate=10&detail=0.5";
/// Seconds of a walk between two saves.
const SAVE_S: f64 = 4.0;
/// Copies of a map whose memory is not counted, and is: the first ones fill gaps that are free.
const COPIES: [usize; 2] = [10, 20];
/// Key frames of the indices that are queried, and queries.
const INDEX: [usize; 2] = [2_000, 8_000];
const QUERIES: usize = 40;
/// How often each time is taken.
const REPEATS: usize = 3;
/// Key frames of two robots whose words are compared.
const COMPARED: usize = 500;
/// Robots that say what they have.
const TEAMS: [RobotId; 2] = [4, 16];
/// Key frames of the pose graphs; of a lap, and every how many there is a loop to the lap before.
const GRAPHS: [usize; 2] = [1_000, 4_000];
const LAP: usize = 200;
const LOOP_EVERY: usize = 5;
/// Landmarks that two key frames share where the pose graph of closing has an edge between them.
const STRONG: u32 = 80;

/// Why costs could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// The walks failed.
    #[error(transparent)]
    Walk(#[from] Error),
    /// Their map could not be cut, packed or read.
    #[error("the map of a simulated walk: {0}")]
    Map(String),
    /// The maps of both walks did not become one.
    #[error("the maps of two simulated walks of one house did not become one")]
    Apart,
}

/// A walk with what it said.
struct Walk {
    file: MapFile,
    /// The last save as others get it, in pieces and in one.
    pieces: Pieces,
    whole: Pieces,
    seconds: f64,
    /// Bytes of all pieces, as they were new at each save.
    sent: usize,
}

fn wrong(e: StoreError) -> MeasureError {
    MeasureError::Map(e.to_string())
}

/// Measures all costs; `said` is told what is measured next.
///
/// # Errors
/// [`MeasureError`] when a walk fails.
pub fn measure_costs(config: &Config, mut said: impl FnMut(&str)) -> Result<Costs, MeasureError> {
    said("two walks through a simulated house");
    let walks = [walk(1, config)?, walk(2, config)?];
    let key_frames: usize = walks.iter().map(|w| w.file.snapshot.key_frame_count()).sum();
    let sum = |of: fn(&Walk) -> usize| walks.iter().map(of).sum::<usize>() as f64;
    let bags: Vec<BagOfWords> =
        walks.iter().flat_map(|w| w.file.snapshot.key_frames()).map(|k| (*k.bag).clone()).collect();
    let words_bytes: usize = (1..).zip(&walks).map(|(r, w)| words_of_map(r, &w.file).0.len()).sum();
    said("memory of their maps");
    let memory = memory_of(&walks[0])?.map(|bytes| bytes / walks[0].file.snapshot.key_frame_count() as f64);
    said("what robots say they have");
    let have = TEAMS.map(|n| (f64::from(n), have_bytes(n)));
    said("queries and comparisons of words");
    let query = INDEX.map(|n| (n as f64, query_s(&bags, n)));
    let compare_s = compare_s(&bags);
    said("joining, adjusting, relaxing");
    let Joins { join_s, around_s, adjust_s } = joins(&walks, config)?;
    let edges = edges(walks.iter().flat_map(|w| w.file.snapshot.key_frames()));
    let relax = GRAPHS.map(|n| (n as f64, relax_s(n, edges.round() as usize)));
    Ok(Costs {
        key_frames,
        walked_s: walks.iter().map(|w| w.seconds).sum(),
        words: bags.iter().map(|b| b.words().len()).sum::<usize>() as f64 / key_frames as f64,
        words_bytes: words_bytes as f64 / key_frames as f64,
        map_bytes: sum(|w| w.whole.bytes().len()) / key_frames as f64,
        sent_again: sum(|w| w.sent) / sum(|w| w.whole.bytes().len()),
        memory_bytes: memory,
        have_bytes: Straight::through(have[0], have[1]),
        query_s: Straight::through(query[0], query[1]),
        compare_s,
        join_s,
        around_s,
        adjust_s,
        adjusted_as_a_whole: WHOLE_KEY_FRAMES,
        edges,
        relax_s: Power::through(relax[0], relax[1]),
    })
}

/// Walks, and saves every few seconds.
fn walk(robot: RobotId, config: &Config) -> Result<Walk, MeasureError> {
    let mut source = open(&format!("{WORLD}&{}", WALKS[usize::from(robot) - 1]))?;
    let config = Config { robot, ..config.clone() };
    let mut slam = Slam::for_source(&*source).config(&config).build()?;
    let (mut pieces, mut sent) = (Pieces::default(), 0);
    let mut save = |slam: &Slam| -> Result<Option<MapFile>, MeasureError> {
        let Some(file) = map_file(slam.session(), &BTreeMap::new()) else { return Ok(None) };
        let before = (pieces.lengths().len(), pieces.bytes().len());
        pieces.add(&file).map_err(wrong)?;
        let goes_on = pieces.lengths().len() > before.0;
        sent += pieces.bytes().len() - if goes_on { before.1 } else { 0 };
        Ok(Some(file))
    };
    let (mut first, mut now, mut saved): (Option<Stamp>, Stamp, f64) = (None, Stamp(0), 0.0);
    while let Some(frame) = source.next_packet().map_err(Error::from)? {
        now = frame.stamp;
        let since = now - *first.get_or_insert(now);
        slam.track(&frame)?;
        if since - saved >= SAVE_S {
            saved = since;
            save(&slam)?;
        }
    }
    slam.finish();
    let file = save(&slam)?.ok_or(Error::EmptyMap)?;
    let mut whole = Pieces::default();
    whole.add(&file).map_err(wrong)?;
    let seconds = first.map_or(0.0, |first| now - first);
    Ok(Walk { file, pieces, whole, seconds, sent })
}

/// Bytes that a map takes in memory, by how much the process grows with copies of it.
fn memory_of(walk: &Walk) -> Result<Option<f64>, MeasureError> {
    let mut copies = Vec::new();
    let mut read = |n: usize| -> Result<(), MeasureError> {
        for _ in 0..n {
            copies.push(pieces::read(walk.pieces.bytes()).map_err(wrong)?);
        }
        Ok(())
    };
    read(COPIES[0])?;
    let before = resident();
    read(COPIES[1])?;
    let after = resident();
    Ok(before.zip(after).map(|(before, after)| after.saturating_sub(before) as f64 / COPIES[1] as f64))
}

/// Bytes of this process in memory, where the system tells (Linux).
fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// Bytes of the message in which a robot of a team of `count` says what it has, when it has words and maps of all.
fn have_bytes(count: RobotId) -> f64 {
    let mut peers: BTreeMap<RobotId, Peer> = BTreeMap::new();
    for robot in 1..=count {
        let Ok(identity) = Identity::from_seed(robot, &[robot as u8; 32]) else { continue };
        let mut peer = Peer::new(identity, TeamKey::new(b"scale"));
        // Short enough by far.
        let _ = peer.publish_words(&[robot as u8; 64], &[64]);
        let _ = peer.publish_pieces(&[robot as u8; 64], &[64]);
        peers.insert(robot, peer);
    }
    let robots: Vec<RobotId> = peers.keys().copied().collect();
    for _ in 0..20 {
        let mut mail: Vec<_> = Vec::new();
        for (robot, peer) in &mut peers {
            mail.extend(peer.tick().into_iter().map(|message| (*robot, message)));
        }
        while let Some((from, message)) = mail.pop() {
            for to in robots
                .iter()
                .filter(|r| **r != from && (message.to == To::All || message.to == To::Robot(**r)))
            {
                let answers = peers.get_mut(to).and_then(|peer| peer.receive(&message.bytes).ok());
                mail.extend(answers.into_iter().flatten().map(|answer| (*to, answer)));
            }
        }
    }
    let said = peers.values_mut().next().map(Peer::tick).unwrap_or_default();
    said.iter().filter(|m| m.kind == PeerKind::Have).map(|m| m.bytes.len()).sum::<usize>() as f64
}

/// A key frame that looks like two of those: words of either by chance.
fn mixed(bags: &[BagOfWords], random: &mut Random) -> BagOfWords {
    let mut words: BTreeMap<WordId, f32> = BTreeMap::new();
    for _ in 0..2 {
        let Some(bag) = bags.get(random.below(bags.len())) else { break };
        words.extend(bag.words().iter().filter(|_| random.chance(0.5)).copied());
    }
    // Words of a map rise, and so do these.
    BagOfWords::from_parts(words.into_iter().collect(), Vec::new()).unwrap_or_default()
}

/// Seconds of a query in an index of `n` key frames, in the mean.
fn query_s(bags: &[BagOfWords], n: usize) -> f64 {
    let mut random = Random::new(n as u64);
    let mut index = PlaceIndex::default();
    for id in (0..n).filter_map(KeyFrameId::from_index) {
        index.insert(id, &Arc::new(mixed(bags, &mut random)));
    }
    let queries: Vec<BagOfWords> = (0..QUERIES).map(|_| mixed(bags, &mut random)).collect();
    least(|| queries.iter().for_each(|bag| drop(index.query(bag, 24, |_| true)))) / QUERIES as f64
}

/// The least of several times in seconds: other work on the machine only adds.
fn least(mut work: impl FnMut()) -> f64 {
    let times = (0..REPEATS).map(|_| {
        let began = Instant::now();
        work();
        began.elapsed().as_secs_f64()
    });
    times.fold(f64::INFINITY, f64::min)
}

/// Seconds to compare the words of two key frames of two robots.
fn compare_s(bags: &[BagOfWords]) -> f64 {
    let mut random = Random::new(1);
    let [a, b] =
        [0, 1].map(|_| MapWords::new((0..COMPARED).map(|k| (k as u32, mixed(bags, &mut random))).collect()));
    let seconds = least(|| {
        black_box(a.similar(&b));
    });
    seconds / (COMPARED * COMPARED) as f64
}

/// What joining maps costs: as in [`Costs`].
struct Joins {
    join_s: f64,
    around_s: f64,
    adjust_s: f64,
}

/// Joins the maps of both, adjusted as a whole and around the places where they meet; and adjusts the whole once more.
fn joins(walks: &[Walk; 2], config: &Config) -> Result<Joins, MeasureError> {
    let mut around = config.clone();
    around.closer.whole_key_frames = 0;
    let parts: BTreeMap<RobotId, Vec<u8>> =
        (1..).zip(walks).map(|(robot, w)| (robot, w.pieces.bytes().to_vec())).collect();
    let atlas = shared_atlas(&parts, config).ok_or(MeasureError::Apart)?;
    let whole_s = least(|| drop(black_box(shared_atlas(&parts, config))));
    let around_s = least(|| drop(black_box(shared_atlas(&parts, &around))));
    let snapshot = &atlas.merged.file.snapshot;
    let mut maps = snapshot.maps();
    let (Some((map, _)), None) = (maps.next(), maps.next()) else { return Err(MeasureError::Apart) };
    let closer = Closer::new(atlas.merged.file.about.camera, config.closer, config.mapper.window);
    // Before it was adjusted: afterwards there is less to do.
    let apart = shared_atlas(&parts, &around).ok_or(MeasureError::Apart)?.merged.file.snapshot;
    let adjust_s = least(|| drop(black_box(closer.adjust_whole(&apart, map, || false))));
    let joined = walks[1].file.snapshot.key_frame_count() as f64;
    let join_s = (whole_s - adjust_s).max(0.0);
    Ok(Joins {
        join_s: join_s / joined,
        around_s: (around_s - join_s).max(0.0) / joined,
        adjust_s: adjust_s / snapshot.key_frame_count() as f64,
    })
}

/// Earlier key frames that share many landmarks with one, in the mean.
fn edges<'a>(key_frames: impl Iterator<Item = &'a KeyFrame>) -> f64 {
    let of = |k: &KeyFrame| k.covisible.iter().filter(|(id, shared)| *id < k.id && *shared >= STRONG).count();
    let counts: Vec<usize> = key_frames.map(of).collect();
    counts.iter().sum::<usize>() as f64 / counts.len().max(1) as f64
}

/// Seconds to relax a pose graph of `n` key frames: laps of a ring, each key frame connected with the `edges` before it and some
/// with the lap before, and drift.
fn relax_s(n: usize, edges: usize) -> f64 {
    let mut random = Random::new(7);
    let step = Se3::new(
        So3::exp(&Vec3::new(0.0, std::f64::consts::TAU / LAP as f64, 0.0)),
        Vec3::new(0.0, 0.0, 0.4),
    );
    let mut truth = vec![Se3::identity()];
    let mut walked = truth.clone();
    for k in 1..n {
        let mut off = || 1e-3 * random.standard_normal();
        let error = Se3::new(So3::exp(&Vec3::new(off(), off(), off())), Vec3::new(off(), off(), off()));
        truth.push(truth[k - 1] * step);
        walked.push(walked[k - 1] * step * error);
    }
    let mut graph = PoseGraph::<Se3, 6>::new();
    for (k, pose) in walked.iter().enumerate() {
        graph.add_vertex(*pose, k == 0);
    }
    for b in 1..n {
        let before = (b.saturating_sub(edges.max(1))..b).map(|a| (a, walked[a].inverse() * walked[b]));
        let lap =
            b.checked_sub(LAP).filter(|_| b % LOOP_EVERY == 0).map(|a| (a, truth[a].inverse() * truth[b]));
        for (a, a_from_b) in before.chain(lap) {
            // Between two vertices that are there, with numbers that are finite.
            let _ = graph.add_edge(a, b, a_from_b, &nalgebra::SMatrix::identity(), Loss::Squared);
        }
    }
    let config = GraphConfig { iterations: 20, tolerance: 1e-6, ..GraphConfig::default() };
    least(|| {
        black_box(graph.clone().solve(&config, || false));
    })
}
