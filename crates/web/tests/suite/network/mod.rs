//! Guidance over bad networks: a phone on a simulated walk, a proxy that is slow, late, lossy and stalls, and a judge
//! beside the server that knows the phone's clock. No direction may be given from a pose older than half a second.
//!
//! `cargo test --release -p cairn-web --test suite network::` walks a few legs.
//! `cargo test --release -p cairn-web --test suite network:: -- --ignored --nocapture` walks two hundred and writes
//! `docs/figures/network.md`;
//! `CAIRN_LEGS` sets another number, and `CAIRN_NETS="1:100:0.01:0.03 ..."` names the networks (Mbit/s, round trip in ms, losses up and
//! down); then nothing is written. `CAIRN_CONNECTIONS` sets how many connections the phone has.

use crate::client;
use crate::paced;
mod phone;
mod proxy;
mod table;
use crate::walked;

use cairn_random::Random;
use cairn_sensor::{GrayImage, Rig};
use cairn_session::SessionConfig;
use cairn_trial::PageClock;
use cairn_web::{CameraSource, ServeConfig, Server};
use client::tls;
use futures_util::{SinkExt, StreamExt};
use phone::{Album, Leg, Phone, Walk};
use proxy::{Net, Proxy};
use serde_json::{Value, json};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio_rustls::TlsConnector;
use tokio_tungstenite::tungstenite::Message;
use walked::camera;

/// Where the walk begins in the world, and its duration, seconds; there is a corner in it.
const START_S: f64 = 9.5;
const OUT_S: f64 = 9.0;
/// Time limit of a leg.
const LEG: Duration = Duration::from_secs(13);
/// No direction is given from an older pose, milliseconds.
const STALE_MS: f64 = 500.0;
/// Time that a message to the judge may take on loopback, milliseconds, which is not the server's fault.
const HEARING_MS: f64 = 15.0;

/// The images of the way out.
fn pictures() -> Vec<GrayImage> {
    let out = walked::route_out(START_S, OUT_S);
    out.iter().map(|packet| GrayImage::clone(&packet.images[0])).collect()
}

/// The network and its disturbances on a leg.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    /// Megabits per second, each way.
    pub mbit_s: f64,
    /// Round trip of a small message.
    pub round_trip_ms: u64,
    /// Share of segments that are lost, up and down.
    pub loss: [f64; 2],
    /// Start of a stall in seconds after the leg's begin, and its length.
    pub stall: Option<(f64, f64)>,
}

/// The results of a leg.
#[derive(Clone, Copy, Debug)]
pub struct Result {
    /// The network.
    pub trial: Trial,
    /// What the phone observed.
    pub leg: Leg,
    /// Directions that the server gave.
    pub said: usize,
    /// The age of the oldest pose that a direction was based on, milliseconds, when the judge beside the server
    /// received it.
    pub oldest_said_ms: f64,
}

/// What the judge received: each direction's age, and texts that direct without naming their pose.
#[derive(Default)]
struct Heard {
    ages_ms: Vec<f64>,
    without_pose: Vec<String>,
}

/// Listens beside the server, on a connection of its own.
async fn judge(
    server: std::net::SocketAddr,
    tls: Arc<rustls::ClientConfig>,
    token: String,
    clock: PageClock,
    heard: Arc<Mutex<Heard>>,
) {
    let stream = tokio::net::TcpStream::connect(server).await.unwrap();
    let stream = TlsConnector::from(tls).connect("localhost".try_into().unwrap(), stream).await.unwrap();
    let (mut socket, _) = tokio_tungstenite::client_async("wss://localhost/ws", stream).await.unwrap();
    let hello = json!({ "hello": { "token": token, "walk": false, "secret": "the judge", "origin": 2 } });
    socket.send(Message::text(hello.to_string())).await.unwrap();
    while let Some(Ok(message)) = socket.next().await {
        let now_ms = clock.ms();
        let Message::Text(text) = message else { continue };
        let value: Value = serde_json::from_str(&text).unwrap();
        if let Some(ping) = value.get("ping") {
            let pong = json!({ "pong": { "n": ping["n"], "ms": now_ms } });
            let _ = socket.send(Message::text(pong.to_string())).await;
        }
        let Some(said) = value.get("said") else { continue };
        let text = said["text"].as_str().unwrap_or_default();
        let mut heard = heard.lock().unwrap();
        match said["pose_ms"].as_f64() {
            Some(pose_ms) => heard.ages_ms.push(now_ms - pose_ms),
            None if ["Turn", "Continue", "Bear", "Move", "I found my place. "]
                .iter()
                .any(|w| text.starts_with(w)) =>
            {
                heard.without_pose.push(text.to_owned());
            }
            None => {}
        }
    }
}

/// One phone, one server: the way out over a good network, then leg after leg over those of the trials. A phone that
/// cannot record its way out in time has no legs.
async fn walker(album: Arc<Album>, seed: u64, trials: &[Trial], limit: Duration) -> Vec<Result> {
    let folder = std::env::temp_dir().join(format!("cairn-network-{}-{seed}", std::process::id()));
    let session = SessionConfig { folder: folder.clone(), ..SessionConfig::default() };
    let rig = Some(Box::new(Rig::mono(camera())));
    let config = ServeConfig { session, ..ServeConfig::new(CameraSource::Page { rig }) };
    let server = Server::start(config).unwrap();
    let tls = tls(&server);
    let token = server.invitation().token.clone();
    let proxy = Proxy::start(server.address(), seed).await;
    let mut random = Random::stream(seed, 5);
    let clock = PageClock::new(1e12 * (random.unit() - 0.5), 2e-4 * (random.unit() - 0.5));
    let heard = Arc::new(Mutex::new(Heard::default()));
    let listening = tokio::spawn(judge(server.address(), tls.clone(), token.clone(), clock, heard.clone()));
    let mut phone = Phone::new(clock, album.clone(), tls, proxy.address, token);
    phone.connect().await;
    // A moving camera starts the map; the recording begins there.
    phone.walk(Walk::To(0), Duration::from_secs(1)).await;
    phone.command("record").await;
    let out = phone.walk(Walk::Out, Duration::from_secs(30)).await;
    assert!(out.walked >= 1.0, "{out:?}");
    phone.command("stop").await;
    let mut results = Vec::new();
    for trial in trials {
        proxy.set(Net::FAST);
        phone.command("halt").await;
        phone.walk(Walk::To(phone.at as usize), Duration::from_millis(600)).await;
        let back = 2.0 * phone.at > album.len() as f64;
        let (line, goal) = if back { ("guide back", 0) } else { ("guide again", album.len() - 1) };
        phone.command(line).await;
        *heard.lock().unwrap() = Heard::default();
        proxy.set(Net {
            mbit_s: trial.mbit_s,
            round_trip: Duration::from_millis(trial.round_trip_ms),
            loss: trial.loss,
            stalled_until: None,
        });
        let leg = {
            let stall = async {
                match trial.stall {
                    Some((at, length)) => {
                        tokio::time::sleep(Duration::from_secs_f64(at)).await;
                        proxy.stall(Duration::from_secs_f64(length));
                        std::future::pending::<Leg>().await
                    }
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                leg = phone.walk(Walk::To(goal), limit) => leg,
                leg = stall => leg,
            }
        };
        if std::env::var_os("CAIRN_TEXTS").is_some() {
            println!("{trial:?}\n  {}", std::mem::take(&mut phone.heard_texts).join("\n  "));
        }
        let heard = std::mem::take(&mut *heard.lock().unwrap());
        assert_eq!(heard.without_pose, Vec::<String>::new(), "directions without a pose");
        let oldest_said_ms = heard.ages_ms.iter().copied().fold(0.0, f64::max);
        results.push(Result { trial: *trial, leg, said: heard.ages_ms.len(), oldest_said_ms });
    }
    listening.abort();
    drop(server);
    let _ = std::fs::remove_dir_all(folder);
    results
}

/// Each rate with each delay in turn; losses and stalls of one to ten seconds on part of them.
fn trials(count: usize) -> Vec<Trial> {
    let mut random = Random::new(2026);
    (0..count)
        .map(|k| {
            let loss = [0.0, 0.0, 0.01, 0.03][random.below(4)];
            let stall = (k % 3 == 2).then(|| (1.0 + 3.0 * random.unit(), 1.0 + 9.0 * random.unit().powi(2)));
            Trial {
                mbit_s: [4.0, 2.0, 1.0, 0.5, 0.2][k % 5],
                round_trip_ms: [50, 100, 200, 350, 500][(k / 5) % 5],
                loss: [loss; 2],
                stall,
            }
        })
        .collect()
}

/// The networks that were named: rate, round trip, losses up and down.
fn named(nets: &str) -> Vec<Trial> {
    let trial = |net: &str| {
        let [mbit_s, round_trip_ms, up, down] =
            net.split(':').map(|v| v.parse().unwrap()).collect::<Vec<f64>>()[..]
        else {
            panic!("{net}: not MBIT_S:ROUND_TRIP_MS:LOSS_UP:LOSS_DOWN")
        };
        Trial { mbit_s, round_trip_ms: round_trip_ms as u64, loss: [up, down], stall: None }
    };
    nets.split_whitespace().map(trial).collect()
}

/// Walks the trials on this many servers in parallel; `limit` is the time limit of a leg.
fn walk_all(trials: &[Trial], side_by_side: usize, limit: Duration) -> Vec<Result> {
    let album = Arc::new(Album::new(pictures()));
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let each = trials.len().div_ceil(side_by_side);
    runtime.block_on(async {
        let mut walks = Vec::new();
        for (n, part) in trials.chunks(each).enumerate() {
            let (album, part) = (album.clone(), part.to_vec());
            walks.push(tokio::spawn(async move { walker(album, n as u64 + 1, &part, limit).await }));
        }
        let mut results = Vec::new();
        for walk in walks {
            results.extend(walk.await.unwrap());
        }
        results
    })
}

fn check(results: &[Result]) {
    for r in results {
        assert!(r.oldest_said_ms <= STALE_MS + HEARING_MS, "the server directed from an old pose: {r:?}");
        assert!(r.leg.oldest_ms <= STALE_MS, "the phone gave a direction from an old pose: {r:?}");
    }
}

/// On a steady link an image leaves when the one before has arrived, which is more often than when the page has heard so.
#[test]
fn one_image_is_on_its_way_and_the_next_does_not_wait_to_hear_of_it() {
    for (trip, rate, each_second) in
        [(20, 500.0, 10.0), (100, 250.0, 7.0), (200, 125.0, 5.5), (350, 125.0, 3.5)]
    {
        let link = paced::Network { lasts: 30_000, trip, rate, connections: 1, lost: 0, repair: 250.0 };
        let sent = paced::over(&[link]).sent;
        let settled: Vec<_> = sent.iter().skip_while(|(when, _)| *when < 10_000).collect();
        for pair in settled.windows(2) {
            let (arrived, left) = (pair[0].1, pair[1].0 as f64);
            assert!(
                left >= arrived - 2.0,
                "round trip {trip} ms: sent at {left}, the one before came at {arrived}"
            );
        }
        let found = settled.len() as f64 / 20.0;
        assert!(found >= each_second, "round trip {trip} ms: {found} images a second");
    }
}

/// With three connections an image leaves when the one before has left the link, so that no two wait for it; and a lost one holds up no
/// other.
#[test]
fn images_pass_a_lost_one_on_the_other_connections() {
    for (trip, rate) in [(50, 125.0), (100, 60.0), (200, 125.0), (350, 125.0)] {
        let steady = paced::Network { lasts: 30_000, trip, rate, connections: 3, lost: 0, repair: 250.0 };
        let sent = paced::over(&[steady]).sent;
        let settled: Vec<_> = sent.iter().skip_while(|(when, _)| *when < 10_000).collect();
        for pair in settled.windows(2) {
            let (left, next) = (pair[0].1 - 0.5 * f64::from(trip as u32), pair[1].0 as f64);
            assert!(
                next >= left - 2.0,
                "round trip {trip} ms: sent at {next}, the one before left at {left}"
            );
        }
        // The longest time without an image, which is one image longer than without losses.
        let gap = |connections: usize, lost: usize| {
            let sent = paced::over(&[paced::Network { connections, lost, ..steady }]).sent;
            let mut there: Vec<f64> =
                sent.iter().map(|(_, there)| *there).filter(|at| *at > 10_000.0).collect();
            there.sort_by(f64::total_cmp);
            there.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
        };
        let [one, three, none] = [gap(1, 11), gap(3, 11), gap(3, 0)];
        println!(
            "round trip {trip} ms: longest gap {one:.0} ms, {three:.0} over three connections, {none:.0} without losses"
        );
        assert!(
            three <= 2.0 * none + 20.0,
            "round trip {trip} ms: {three} ms after a loss, {none} without losses"
        );
    }
    // While one waits for long, those images wait with it that left before it was known: two, or three.
    let slow =
        paced::Network { lasts: 30_000, trip: 50, rate: 125.0, connections: 3, lost: 29, repair: 1500.0 };
    let sent = paced::over(&[slow]).sent;
    let waited = |k: usize| sent[..k].iter().any(|(_, there)| *there == sent[k].1);
    let held = (0..sent.len()).filter(|k| waited(*k)).count();
    let lost = sent.len() as f64 / 29.0;
    println!("{held} images waited with {lost:.0} lost ones");
    assert!(held as f64 <= 2.5 * lost, "{held} images waited with {lost:.1} lost ones");
}

/// A link that becomes much slower is known for what it is after two images.
#[test]
fn images_become_small_soon_on_a_link_that_has_become_slow() {
    for connections in [1, 3] {
        let fast =
            paced::Network { lasts: 8_000, trip: 20, rate: 2000.0, connections, lost: 0, repair: 250.0 };
        let slow = paced::Network { lasts: 12_000, trip: 100, rate: 25.0, ..fast };
        let sent = paced::over(&[fast, slow]).sent;
        let found = sent.iter().filter(|(when, _)| *when >= 8_000).count();
        println!("{connections} connections: {found} images in 12 s");
        assert!(found >= 20, "{found} images");
    }
}

#[test]
fn old_pictures_guide_nobody_on_a_few_networks() {
    let slow = Trial { mbit_s: 0.5, round_trip_ms: 200, loss: [0.0; 2], stall: None };
    let trials = [
        Trial { mbit_s: 20.0, round_trip_ms: 20, ..slow },
        Trial { mbit_s: 1.0, round_trip_ms: 50, stall: Some((1.5, 2.0)), ..slow },
        Trial { round_trip_ms: 800, ..slow },
    ];
    let results = walk_all(&trials, 1, Duration::from_secs(8));
    print!("{}", table::lines(&results));
    check(&results);
    let [good, stalled, far] = results[..] else { panic!("{results:?}") };
    assert!(good.leg.guided_s > 0.5 * good.leg.total_s && good.leg.given > 0, "{good:?}");
    assert!(stalled.leg.stops > 0, "{stalled:?}");
    assert_eq!(far.leg.given, 0, "a link of 0.8 s guides nobody: {far:?}");
}

#[test]
#[ignore = "takes about twenty minutes; writes docs/figures/network.md"]
fn old_pictures_guide_nobody_in_two_hundred_legs() {
    let wanted = std::env::var("CAIRN_LEGS").ok().and_then(|n| n.parse().ok());
    let began = std::time::Instant::now();
    let nets = std::env::var("CAIRN_NETS").ok();
    let chosen = nets.as_deref().map_or_else(|| trials(wanted.unwrap_or(200)), named);
    let results = walk_all(&chosen, 3, LEG);
    let text = table::page(&results, began.elapsed().as_secs_f64());
    print!("{text}{}", table::lines(&results));
    if wanted.is_none() && nets.is_none() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/figures/network.md");
        std::fs::write(path, text).unwrap();
    }
    check(&results);
}
