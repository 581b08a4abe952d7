//! Opens what a scenario runs: any address of `cairn`, simulated walks with what only measurements ask of them, and conditions put
//! upon a source: a covered camera, a faulty IMU, the noise that a phone states, dropped frames.

use crate::MeasureError;
use crate::altered::Altered;
use crate::drawn::DrawnPhone;
use cairn_geometry::{Vec2, Vec3};
use cairn_sensor::{ImuSensor, Source};
use cairn_sim::{CameraPath, FaultyImu, ImuFault, ImuFaultKind, PhoneTraits, SimConfig, SimSource};
use cairn_sources::{OpenOptions, open};
use std::collections::BTreeMap;

/// Keys of `sim:` addresses that only measurements understand.
///
/// - `turn_rate`: of the walker, rad/s; `stands`: seconds of standing at the start and at the end.
/// - `out`: metres of the route that are walked; `home=1`: and back to its beginning.
/// - `slices`: of mapping that the phone of a newcomer does in 20 ms at most.
/// - `phone`: `rolling` or `global`, a phone drawn by the seed ([`PhoneTraits`]) with that shutter.
const OWN_KEYS: [&str; 6] = ["turn_rate", "stands", "out", "slices", "home", "phone"];

/// What is put upon a source.
#[derive(Clone, Debug, Default)]
pub struct Conditions {
    /// Seconds of its beginning that are left out.
    pub start_s: f64,
    /// When the camera is covered.
    pub cover: Cover,
    /// A fault of the IMU.
    pub fault: Option<ImuFault>,
    /// The rig states the noise that a phone's is assumed to have.
    pub states_phone: bool,
    /// Seed of the frames that are dropped, one in eight.
    pub drops: Option<u64>,
}

/// When a camera is covered.
#[derive(Clone, Copy, Debug, Default)]
pub enum Cover {
    /// Never.
    #[default]
    Never,
    /// From one second after the first frame to another.
    Between(f64, f64),
    /// For the last seconds.
    Last(f64),
    /// For so many seconds around the sharpest corner between one fifth and two fifths of the walk.
    Corner(f64),
}

impl Cover {
    /// From `A:B`, `last:S` or `corner:S`, seconds; empty: never.
    pub fn parse(text: &str) -> Option<Self> {
        if text.is_empty() {
            return Some(Self::Never);
        }
        let (from, to) = text.split_once(':')?;
        let to = to.parse().ok()?;
        Some(match from {
            "last" => Self::Last(to),
            "corner" => Self::Corner(to),
            from => Self::Between(from.parse().ok()?, to),
        })
    }

    fn between(self, source: &dyn Source) -> Option<[f64; 2]> {
        let truth = &source.info().truth;
        match self {
            Self::Never => None,
            Self::Between(from, to) => Some([from, to]),
            Self::Last(seconds) => Some([truth.last()?.0 - truth.first()?.0 - seconds, f64::INFINITY]),
            Self::Corner(seconds) => {
                let step = source.info().rate_hz as usize;
                let yaw = |i: usize| {
                    let ahead = truth[i].1.rotation * Vec3::z();
                    ahead.y.atan2(ahead.x)
                };
                let turned = |i: &usize| {
                    let by = yaw(i + step) - yaw(*i);
                    by.sin().atan2(by.cos()).abs()
                };
                let near = truth.len() / 5..2 * truth.len() / 5;
                let i =
                    near.filter(|i| i + step < truth.len()).max_by(|i, j| turned(i).total_cmp(&turned(j)))?;
                let middle = truth[i + step / 2].0 - truth[0].0;
                Some([middle - 0.5 * seconds, middle + 0.5 * seconds])
            }
        }
    }
}

/// A fault by its name, as [`ImuFaultKind`] is displayed, and perhaps its length: `stuck 0.5 s`.
pub fn fault(text: &str, from_s: f64) -> Option<ImuFault> {
    use ImuFaultKind::*;
    let length = text.strip_suffix(" s").and_then(|t| t.rsplit_once(' '));
    let (name, seconds) = match length.and_then(|(name, s)| Some((name, s.parse().ok()?))) {
        Some((name, seconds)) => (name, seconds),
        None => (text, f64::INFINITY),
    };
    let number = |before: &str, after: &str| -> Option<f64> {
        Some(name.strip_prefix(before)?.strip_suffix(after)?.parse::<f64>().ok()? / 1e3)
    };
    let plain =
        [Stuck, Zeros, AccelDead, GyroDead, Gap, AccelSpikes, GyroSpikes, GyroSpike, Degrees, Saturated];
    let plain = || plain.into_iter().find(|kind| kind.to_string() == name);
    let kind = number("clock drifts ", " ms/s").map(Drift);
    let kind = kind.or_else(|| number("clock ", " ms").map(Jump)).or_else(plain)?;
    Some(ImuFault { kind, from_s, seconds })
}

/// Opens an address under conditions.
///
/// # Errors
/// When there is no such source, or it cannot be simulated.
pub fn open_under(address: &str, conditions: &Conditions) -> Result<Box<dyn Source>, MeasureError> {
    let mut source = match address.starts_with("sim:") {
        true => simulated(address)?,
        false => open(address, OpenOptions { start_s: conditions.start_s, ..OpenOptions::default() })?,
    };
    if let Some(fault) = conditions.fault {
        source = Box::new(FaultyImu::new(source, fault));
    }
    let covered_s = conditions.cover.between(source.as_ref());
    let mut rig = source.rig().clone();
    if let Some(imu) = rig.imu.as_mut().filter(|_| conditions.states_phone) {
        imu.noise = ImuSensor::of_phone().noise;
    }
    Ok(Box::new(Altered::new(source, rig, covered_s, conditions.drops)))
}

/// The phone that the seed of an address draws.
pub fn phone(seed: u64) -> PhoneTraits {
    PhoneTraits::new(seed, 640, 480)
}

/// The simulation of an address, and its keys of `OWN_KEYS`. Keys without a value are left out.
///
/// # Errors
/// When it cannot be simulated.
pub fn sim_config(address: &str) -> Result<(SimConfig, BTreeMap<String, String>), MeasureError> {
    let (world, query) = address.split_once('?').unwrap_or((address, ""));
    let (mut own, mut known) = (BTreeMap::new(), Vec::new());
    for (key, value) in query.split('&').filter_map(|pair| pair.split_once('=')) {
        match OWN_KEYS.contains(&key) {
            _ if value.is_empty() => {}
            true => drop(own.insert(key.to_owned(), value.to_owned())),
            false => known.push(format!("{key}={value}")),
        }
    }
    let mut config = SimConfig::parse(&format!("{world}?{}", known.join("&")))?;
    config.walker.turn_rate = number(&own, "turn_rate")?.unwrap_or(config.walker.turn_rate);
    config.walker.rest_s = number(&own, "stands")?.unwrap_or(config.walker.rest_s);
    Ok((config, own))
}

fn number(own: &BTreeMap<String, String>, key: &str) -> Result<Option<f64>, MeasureError> {
    let Some(text) = own.get(key) else { return Ok(None) };
    Ok(Some(text.parse().map_err(|_| format!("{key}={text}: not a number"))?))
}

fn simulated(address: &str) -> Result<Box<dyn Source>, MeasureError> {
    let (mut config, own) = sim_config(address)?;
    let plain = SimSource::new(&config)?;
    let Some(metres) = number(&own, "out")? else { return Ok(Box::new(plain)) };
    let routes = plain.world().routes();
    let route = match &config.route {
        CameraPath::Route(Some(name)) => routes.iter().find(|route| route.name == *name),
        _ => routes.first(),
    };
    let mut corners = cut(&route.ok_or("the world has no such route")?.points, metres);
    if own.contains_key("home") {
        let home: Vec<Vec2> = corners.iter().rev().skip(1).copied().collect();
        corners.extend(home);
    }
    let Some(shutter) = own.get("phone").map(String::as_str) else {
        config.route = CameraPath::Points(corners);
        return Ok(Box::new(SimSource::in_world(&config, plain.world().clone())?));
    };
    let mut traits = phone(config.seed);
    if shutter == "global" {
        traits.readout_s = 0.0;
    }
    let motion = config.walker.motion(&corners);
    Ok(Box::new(DrawnPhone::new(&config, plain.world(), motion, &traits, 1)?))
}

/// The first `most` metres of a route.
pub fn cut(route: &[Vec2], most: f64) -> Vec<Vec2> {
    let (mut out, mut left) = (route.first().copied().into_iter().collect::<Vec<_>>(), most);
    for w in route.windows(2) {
        let length = (w[1] - w[0]).norm();
        let part = (left / length.max(1e-9)).min(1.0);
        if left <= 0.0 {
            break;
        }
        out.push(w[0] + (w[1] - w[0]) * part);
        left -= length;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_known_by_their_names() {
        for name in ["stuck", "gyroscope dead", "clock +30 ms", "clock -500 ms", "clock drifts 30 ms/s"] {
            let found = fault(name, 8.0).unwrap();
            assert_eq!((found.kind.to_string().as_str(), found.seconds), (name, f64::INFINITY));
        }
        assert_eq!(fault("zeros 0.3 s", 8.0).unwrap().seconds, 0.3);
        assert_eq!(fault("nothing", 8.0), None);
    }
}
