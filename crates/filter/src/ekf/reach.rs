//! What the sensor sees, learned from its sightings.

use crate::log::Sighting;
use crate::measure::Kind;

/// Share of the sightings that are of no landmark in the map: new ones, and what is none.
const UNKNOWN: f64 = 0.05;

/// Range and field of view of the sensor, learned from its sightings, and how often it sees what is within them.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Reach {
    pub range_m: f64,
    pub bearing_rad: f64,
    pub seen: f64,
    pub missed: f64,
}

impl Reach {
    pub fn learn(&mut self, sighting: &Sighting) {
        if let (Kind::RangeBearing, v) = (sighting.measurement.kind(), sighting.measurement.value()) {
            self.range_m = self.range_m.max(v.x);
            self.bearing_rad = self.bearing_rad.max(v.y.abs());
        }
    }

    /// Minus twice the logarithm of the density of a sighting that is of no landmark in the map: it may be anywhere in what the
    /// sensor sees.
    pub fn unknown(&self, kind: Kind) -> f64 {
        let (range_m, bearing_rad) = (self.range_m.max(1.0), 2.0 * self.bearing_rad.max(0.1));
        let space = match kind {
            Kind::Range => range_m,
            Kind::Bearing => bearing_rad,
            Kind::RangeBearing => range_m * bearing_rad,
            _ => 0.5 * range_m * range_m * bearing_rad,
        };
        -2.0 * (UNKNOWN / space).ln()
    }

    /// The weight of one miss, in log odds.
    pub fn miss(&self) -> f64 {
        let detection = (1.0 + self.seen) / (2.0 + self.seen + self.missed);
        -(1.0 - detection).max(1e-3).ln()
    }
}
