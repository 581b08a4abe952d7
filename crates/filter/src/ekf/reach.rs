//! What the sensor sees, learned from its sightings.

use crate::log::Sighting;
use crate::measure::Kind;

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

    /// The weight of one miss, in log odds.
    pub fn miss(&self) -> f64 {
        let detection = (1.0 + self.seen) / (2.0 + self.seen + self.missed);
        -(1.0 - detection).max(1e-3).ln()
    }
}
