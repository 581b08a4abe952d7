//! Moving objects: detections become tracks with constant velocity (a Kalman filter with the same covariance for both
//! axes), gated by the 99 % bound of their innovation, and removed when they are not seen again.
//!
//! The process noise is white acceleration (Bar-Shalom, Li and Kirubarajan 2001, section 6.2.2). A detection is
//! assigned to the track with the smallest Mahalanobis distance (nearest neighbour), each track takes one detection of
//! a frame, and the remaining detections begin tentative tracks. A tentative track blocks the place where it was seen;
//! it is not predicted forward until it is confirmed.

use cairn_geometry::Vec2;

/// 99 % bound of chi-square with two degrees of freedom.
const GATE: f64 = 9.210;

/// An object that stays within this distance of a place stands still, in metres.
const STILL_M: f64 = 0.15;

/// Configuration of the tracks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DynamicConfig {
    /// Standard deviation of a detected position, in metres.
    pub position_sigma_m: f64,
    /// Density of the acceleration noise, in m/s^2 / sqrt(Hz).
    pub acceleration_density: f64,
    /// Standard deviation of the initial speed of a track, in m/s.
    pub speed_sigma: f64,
    /// A track not seen for this long is removed, in seconds.
    pub forget_s: f64,
    /// Detections needed to confirm a track as moving.
    pub confirm: u32,
}

impl Default for DynamicConfig {
    fn default() -> Self {
        Self { position_sigma_m: 0.1, acceleration_density: 0.7, speed_sigma: 1.0, forget_s: 1.0, confirm: 3 }
    }
}

/// A detected object that is not part of the static map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Centre in metres, world.
    pub position: Vec2,
    /// Radius in metres.
    pub radius_m: f64,
}

/// An object that moves with nearly constant velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// Identifier; never used again.
    pub id: u64,
    /// Centre in metres, world, at the time of the layer.
    pub position: Vec2,
    /// Velocity in m/s, world.
    pub velocity: Vec2,
    /// Radius in metres.
    pub radius_m: f64,
    /// Number of detections.
    pub seen: u32,
    /// Time of the last detection, in seconds.
    pub last_seen_s: f64,
    /// Where the object has stood since [`Track::still_since_s`], in metres, world.
    still_at: Vec2,
    /// Since when the object has not left that place, in seconds.
    still_since_s: f64,
    /// Covariance of position and speed along one axis: position-position, position-speed, speed-speed.
    covariance: [f64; 3],
}

impl Track {
    /// The predicted position and its standard deviation in metres.
    pub fn predict(&self, ahead_s: f64) -> (Vec2, f64) {
        let [pp, pv, vv] = self.covariance;
        let variance = pp + 2.0 * ahead_s * pv + ahead_s * ahead_s * vv;
        (self.position + self.velocity * ahead_s, variance.max(0.0).sqrt())
    }

    /// For how long the object has stood in one place, in seconds, by its last detection.
    pub fn still_for_s(&self) -> f64 {
        self.last_seen_s - self.still_since_s
    }
}

/// What became of the detections of one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Observed {
    /// Detections that continued a track.
    pub matched: usize,
    /// Detections that started a new track.
    pub started: usize,
    /// Tracks that were removed.
    pub forgotten: usize,
    /// Detections with NaN, infinity or a radius below zero.
    pub rejected: usize,
    /// The time stamp was not after the one before, or not finite; nothing was used. Two in a row that are earlier by more
    /// than tracks last are another time of the clock, and the second begins anew with it.
    pub out_of_order: bool,
}

/// All tracks at one time.
#[derive(Clone, Debug)]
pub struct DynamicLayer {
    config: DynamicConfig,
    tracks: Vec<Track>,
    time_s: f64,
    /// The last time stamp, where it was refused for being earlier than all tracks last.
    earlier_s: Option<f64>,
    next_id: u64,
}

impl DynamicLayer {
    /// A layer without tracks.
    pub fn new(config: DynamicConfig) -> Self {
        Self { config, tracks: Vec::new(), time_s: f64::NEG_INFINITY, earlier_s: None, next_id: 0 }
    }

    /// All tracks, tentative ones too, oldest first.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Takes the detections at a time in seconds; an empty list means that nothing was detected.
    pub fn observe(&mut self, time_s: f64, detections: &[Detection]) -> Observed {
        let mut observed = Observed::default();
        let earlier_s = self.earlier_s.take();
        if time_s.is_finite() && self.time_s - time_s > self.config.forget_s {
            if earlier_s.is_none_or(|before| time_s <= before) {
                self.earlier_s = Some(time_s);
                return Observed { out_of_order: true, ..observed };
            }
            observed.forgotten = self.tracks.len();
            self.tracks.clear();
        } else if !time_s.is_finite() || time_s <= self.time_s {
            return Observed { out_of_order: true, ..observed };
        }
        let ahead_s = if self.time_s.is_finite() { time_s - self.time_s } else { 0.0 };
        self.time_s = time_s;
        let before = self.tracks.len();
        let forget_s = self.config.forget_s;
        self.tracks.retain(|t| time_s - t.last_seen_s <= forget_s);
        observed.forgotten += before - self.tracks.len();
        self.tracks.iter_mut().for_each(|t| carry_on(t, ahead_s, &self.config));
        let is_sound = |d: &&Detection| {
            d.position.iter().all(|v| v.is_finite()) && d.radius_m >= 0.0 && d.radius_m.is_finite()
        };
        let sound: Vec<Detection> = detections.iter().filter(is_sound).copied().collect();
        observed.rejected = detections.len() - sound.len();
        let free = self.matched(&sound, &mut observed);
        for detection in free {
            self.start(&detection);
            observed.started += 1;
        }
        observed
    }

    /// Distance in metres from a point to the rim of the nearest moving object `ahead_s` after the last observation,
    /// less two standard deviations of its position (half a metre at most); infinite if nothing moves.
    pub fn clearance_m(&self, point: Vec2, ahead_s: f64) -> f64 {
        let to = |track: &Track| {
            let ahead_s = if track.seen >= self.config.confirm { ahead_s } else { 0.0 };
            let (at, sigma) = track.predict(ahead_s);
            (point - at).norm() - track.radius_m - (2.0 * sigma).min(0.5)
        };
        self.tracks.iter().map(to).fold(f64::INFINITY, f64::min)
    }

    /// Assigns detections to tracks, the likeliest pair first; returns the detections left over.
    fn matched(&mut self, detections: &[Detection], observed: &mut Observed) -> Vec<Detection> {
        let noise = self.config.position_sigma_m.powi(2);
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (t, track) in self.tracks.iter().enumerate() {
            for (d, detection) in detections.iter().enumerate() {
                let squared = (detection.position - track.position).norm_squared();
                pairs.push((squared / (track.covariance[0] + noise), t, d));
            }
        }
        pairs.retain(|p| p.0 <= GATE);
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
        let (mut tracks, mut taken) = (vec![false; self.tracks.len()], vec![false; detections.len()]);
        for (_, t, d) in pairs {
            if !tracks[t] && !taken[d] {
                (tracks[t], taken[d]) = (true, true);
                update(&mut self.tracks[t], &detections[d], noise, self.time_s);
                observed.matched += 1;
            }
        }
        detections.iter().zip(taken).filter(|(_, taken)| !taken).map(|(d, _)| *d).collect()
    }

    fn start(&mut self, detection: &Detection) {
        self.tracks.push(Track {
            id: self.next_id,
            position: detection.position,
            velocity: Vec2::zeros(),
            radius_m: detection.radius_m,
            seen: 1,
            last_seen_s: self.time_s,
            still_at: detection.position,
            still_since_s: self.time_s,
            covariance: [self.config.position_sigma_m.powi(2), 0.0, self.config.speed_sigma.powi(2)],
        });
        self.next_id += 1;
    }
}

/// Prediction step.
fn carry_on(track: &mut Track, dt: f64, config: &DynamicConfig) {
    let [pp, pv, vv] = track.covariance;
    let q = config.acceleration_density.powi(2);
    track.position += track.velocity * dt;
    track.covariance = [
        pp + 2.0 * dt * pv + dt * dt * vv + q * dt.powi(3) / 3.0,
        pv + dt * vv + q * dt * dt / 2.0,
        vv + q * dt,
    ];
}

/// Correction step, the same for both axes.
fn update(track: &mut Track, detection: &Detection, noise: f64, time_s: f64) {
    let [pp, pv, vv] = track.covariance;
    let (gain_p, gain_v) = (pp / (pp + noise), pv / (pp + noise));
    let innovation = detection.position - track.position;
    track.position += innovation * gain_p;
    track.velocity += innovation * gain_v;
    track.covariance = [(1.0 - gain_p) * pp, (1.0 - gain_p) * pv, vv - gain_v * pv];
    track.radius_m += 0.3 * (detection.radius_m - track.radius_m);
    track.seen += 1;
    track.last_seen_s = time_s;
    if (track.position - track.still_at).norm() > STILL_M {
        (track.still_at, track.still_since_s) = (track.position, time_s);
    }
}
