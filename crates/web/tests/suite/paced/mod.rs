//! `pace.js` against a simulated link: an image is on its way alone, and the program that stands for the page in other tests
//! decides as the page does.

use cairn_trial::{LEVELS, Pace};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Time from the exposure to the encoded image, and between two images of the camera, milliseconds.
const CODING: u64 = 30;
const CAMERA: u64 = 33;
/// Bytes of an image of the first level.
const WHOLE: f64 = 40_000.0;

/// A link for a while.
#[derive(Clone, Copy)]
pub struct Network {
    /// Milliseconds of it, and of a round trip.
    pub lasts: u64,
    pub trip: u64,
    /// Bytes a millisecond.
    pub rate: f64,
    pub connections: usize,
    /// Every how many images one is lost, 0 for none, and the time until it has been sent again, milliseconds: what follows on its
    /// connection waits.
    pub lost: usize,
    pub repair: f64,
}

/// What a simulated page did.
pub struct Paced {
    /// What happened to its pace, in order: `[name, ms, ...]`.
    pub told: Vec<Value>,
    /// For every image of the camera: whether it might be captured, the level, and whether the link has room.
    pub decided: Vec<(bool, usize, bool)>,
    /// Of every image sent: when, and when it was received.
    pub sent: Vec<(u64, f64)>,
    /// And on which connection.
    pub on: Vec<usize>,
}

/// Sends images over one link after another; the server does not confirm every seventeenth, which another overtook there, as
/// plain requests may (with one connection). The pace learns of another round trip two seconds late.
pub fn over(networks: &[Network]) -> Paced {
    let began = Instant::now();
    let at = |ms: u64| began + Duration::from_millis(ms);
    let mut pace = Pace::default();
    let mut out = Paced { told: Vec::new(), decided: Vec::new(), sent: Vec::new(), on: Vec::new() };
    let (mut coded, mut confirmed) = (None::<(u64, u64, usize)>, Vec::<(u64, f64)>::new());
    let (mut free, mut now) = (0.0f64, 0);
    for network in networks {
        let ends = now + network.lasts;
        let known = now + 2000;
        let mut clear = vec![0.0f64; network.connections];
        pace.reset(network.connections);
        confirmed.clear();
        out.told.push(json!(["reset", network.connections]));
        while now < ends {
            if now == known {
                pace.trip_ms = network.trip as f64;
                out.told.push(json!(["trip", network.trip]));
            }
            while let Some(&(when, stamp)) = confirmed.first().filter(|(when, _)| *when <= now) {
                confirmed.remove(0);
                pace.got(at(when), stamp);
                out.told.push(json!(["got", when, stamp]));
            }
            if let Some((_, stamp, bytes)) = coded.take_if(|(ready, ..)| *ready <= now) {
                free = free.max(now as f64) + bytes as f64 / network.rate;
                let on = pace.sent(at(now), stamp as f64, bytes);
                let lost = network.lost > 0 && out.sent.len() % network.lost == 1;
                let there = free + 0.5 * network.trip as f64 + if lost { network.repair } else { 0.0 };
                clear[on] = clear[on].max(there);
                out.told.push(json!(["sent", now, stamp, bytes]));
                out.on.push(on);
                out.sent.push((now, clear[on]));
                if network.connections > 1 || !out.sent.len().is_multiple_of(17) {
                    confirmed.push(((clear[on] + 0.5 * network.trip as f64).ceil() as u64, stamp as f64));
                    confirmed.sort_by_key(|(when, _)| *when);
                }
            }
            if now.is_multiple_of(CAMERA) && coded.is_none() {
                let may = pace.may_shoot(at(now));
                out.told.push(json!(["ask", now]));
                out.decided.push((may, pace.level, pace.has_room()));
                if may {
                    coded = Some((now + CODING, now, (WHOLE * LEVELS[pace.level].2) as usize));
                }
            }
            now += 1;
        }
    }
    out
}
