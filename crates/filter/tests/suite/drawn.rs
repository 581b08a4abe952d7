//! Logs drawn from a recorded one: other worlds for the same filter, so that no figure is of one log alone.
//!
//! In: a log of velocities, ranges and bearings, and a seed. Out: the log of one robot, over a part of its time, mirrored or not, with
//! sightings left out, with more noise of the sensor and with wheels that are a little larger or smaller. Labels stay, for judging.
//! `CAIRN_SEED` in the environment chooses other worlds than those of every day.

use cairn_filter::log::{Event, Log, Reading};
use cairn_geometry::Vec2;
use cairn_random::Random;

/// The first seed: that of `CAIRN_SEED`, else always the same.
pub fn first_seed() -> u64 {
    std::env::var("CAIRN_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1)
}

/// What is drawn for one log.
struct Draw {
    from_s: f64,
    until_s: f64,
    mirrored: bool,
    /// Part of the sightings that is left out.
    lost: f64,
    /// Deviations that are added: of a range for each metre, of a bearing in radians.
    range: f64,
    bearing_rad: f64,
    /// Factors of the velocities.
    speed: f64,
    turn: f64,
}

impl Draw {
    fn new(last_s: f64, part: f64, random: &mut Random) -> Self {
        let from_s = (1.0 - part) * last_s * random.unit();
        Self {
            from_s,
            until_s: from_s + part * last_s,
            mirrored: random.unit() < 0.5,
            lost: 0.4 * random.unit(),
            range: 0.02 * random.unit(),
            bearing_rad: 0.005 * random.unit(),
            speed: 1.0 + 0.01 * random.standard_normal(),
            turn: 1.0 + 0.02 * random.standard_normal(),
        }
    }
}

/// Part of the log of one robot, as another world.
pub fn drawn(log: &Log, robot: usize, part: f64, seed: u64) -> Log {
    let mut random = Random::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(robot as u64));
    let mut own = log.robots[robot].clone();
    let d = Draw::new(own.entries.last().unwrap().time_s, part, &mut random);
    own.entries.retain(|e| (d.from_s..d.until_s).contains(&e.time_s));
    let side = if d.mirrored { -1.0 } else { 1.0 };
    own.entries.retain_mut(|entry| match &mut entry.event {
        Event::Velocity { speed_m_s, turn_rad_s } => {
            (*speed_m_s, *turn_rad_s) = (d.speed * *speed_m_s, side * d.turn * *turn_rad_s);
            true
        }
        Event::Seen { reading: Reading::RangeBearing(range, bearing), .. } => {
            *range = (*range * (1.0 + d.range * random.standard_normal())).max(0.0);
            *bearing = side * (*bearing + d.bearing_rad * random.standard_normal());
            random.unit() >= d.lost
        }
        _ => true,
    });
    let surveyed = log.surveyed.iter().map(|(label, p)| (*label, Vec2::new(p.x, side * p.y))).collect();
    Log { name: format!("{} drawn by {seed}", own.name), robots: vec![own], surveyed, ..log.clone() }
}
