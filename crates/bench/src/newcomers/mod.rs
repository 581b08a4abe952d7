//! A newcomer who has a phone that nobody knows: does what the guide says to let it be learned, presses what the main button offers,
//! records a route, and is guided home. Judged by the truth.

mod page;

use crate::MeasureError;
use crate::source::{cut, sim_config};
use cairn_atlas::{KeyFrame, KeyFrameId};
use cairn_geometry::{Vec2, Vec3};
use cairn_phrases::Language;
use cairn_sensor::{Camera, Distortion, Stamp};
use cairn_session::SessionStatus;
use cairn_session::lens_watch::kept;
use cairn_sim::SimConfig;
use page::{MOMENT_S, PHONE, Page, drawn};
use serde::Serialize;

/// Seconds after which the newcomer sets out, and presses the button again that was refused.
const SETS_OUT_S: f64 = 2.0;
const PRESSES_AGAIN_S: f64 = 15.0;
/// Seconds of walking after which one gives up whose phone is not known.
const GIVES_UP_S: f64 = 60.0;
/// Seconds that one stands before pressing the button at the end of the route, and listens to the answer.
const STANDS_S: f64 = 1.0;
const LISTENS_S: f64 = 3.0;
/// Seconds of guidance at most, and of standing after which one has arrived, or has been given up.
const HOME_S: f64 = 90.0;
const ARRIVED_S: f64 = 2.0;
const GIVEN_UP_S: f64 = 20.0;
/// Metres to a corner that count as having passed it.
const PASSED_M: f64 = 0.4;
/// Metres after which one turns to the side and back, and how far one goes there: "turn left once and right once".
const TURNS_AT_M: f64 = 2.5;
const ASIDE_M: f64 = 0.5;
/// Metres from the start that count as home, and from the way out that count as misled.
const HOME_M: f64 = 1.0;
const MISLED_M: f64 = 2.0;
/// A length is wrong that is off by more than this.
const MOST_OFF_PERCENT: f64 = 3.0;
/// A length has jumped that changes by more than this share of it.
const JUMP: f64 = 0.1;
/// The metre of the map is compared over its last seconds.
const SCALE_S: f64 = 10.0;

/// What came of a newcomer.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Newcomer {
    /// The phone: its focal length over that assumed, distortion, readout and lateness of its pictures.
    pub focal: f64,
    /// See `focal`.
    pub k1: f64,
    /// See `focal`.
    pub readout_ms: f64,
    /// See `focal`.
    pub late_ms: f64,
    /// Seconds of walking until the lens is known, and until "I am ready".
    pub lens_s: Option<f64>,
    /// See `lens_s`.
    pub known_s: Option<f64>,
    /// A recording began before.
    pub early: bool,
    /// What is wrong with the phone as it is known when the recording begins: focal length, percent, and lateness, ms.
    pub focal_off_percent: Option<f64>,
    /// See `focal_off_percent`.
    pub late_off_ms: Option<f64>,
    /// Metres walked while it was recorded, and metres recorded.
    pub walked_m: f64,
    /// See `walked_m`.
    pub recorded_m: Option<f64>,
    /// By how much these differ, percent; and whether that is more than 3 %.
    pub length_off_percent: Option<f64>,
    /// See `length_off_percent`.
    pub wrong: bool,
    /// By how much the length changed during guidance, percent; and whether it did so by more than a tenth and guidance went on.
    pub changed_percent: f64,
    /// See `changed_percent`.
    pub jumped: bool,
    /// How it ended.
    pub end: String,
    /// Metres from the start at the end, and farthest from the way out on the way home.
    pub from_start_m: Option<f64>,
    /// See `from_start_m`.
    pub farthest_m: Option<f64>,
    /// Processor seconds.
    pub cpu_s: f64,
}

/// Lets the newcomer of a `sim:` address walk; a route is the `out` metres of it, and the phone does at most `slices` of mapping in a
/// moment, or all at once. `verbose`: what happens is reported on stderr.
///
/// # Errors
/// When there is no such simulation, or the page refuses a picture.
pub fn of(address: &str, verbose: bool) -> Result<Newcomer, MeasureError> {
    let (sim, own) = sim_config(address)?;
    let metres = own.get("out").ok_or("a newcomer's address says out=METRES")?;
    let metres = metres.parse().map_err(|_| format!("out={metres}: not a number"))?;
    let slices = own.get("slices").map_or(Ok(usize::MAX), |n| n.parse());
    walk(&sim, metres, slices.map_err(|e| format!("slices: {e}"))?, verbose)
}

fn walk(sim: &SimConfig, metres: f64, slices: usize, verbose: bool) -> Result<Newcomer, MeasureError> {
    let traits = drawn(sim.seed);
    let page = Page::open(sim, &traits, slices)?;
    let start = page.carried.corners.first().copied().ok_or("the world has no route")?;
    let mut person = Person::new(page, start, verbose);
    let cpu = cairn_eval::process::cpu_s();
    let guess = Camera::guessed(traits.camera.width, traits.camera.height);
    let k1 = match traits.camera.distortion {
        Distortion::RadialTangential([k1, ..]) => k1,
        _ => 0.0,
    };
    person.came = Newcomer {
        focal: traits.camera.fx / guess.fx,
        k1,
        readout_ms: 1e3 * traits.readout_s,
        late_ms: 1e3 * traits.stamp_delay_s,
        ..Newcomer::default()
    };
    person.came.end = match person.learns()? {
        false => "no recording".into(),
        true => {
            person.records(metres)?;
            person.goes_home(sim.seed)?
        }
    };
    person.came.cpu_s = cairn_eval::process::cpu_s().zip(cpu).map_or(0.0, |(now, before)| now - before);
    Ok(person.came)
}

/// The newcomer.
struct Person {
    page: Page,
    came: Newcomer,
    /// The corners ahead on the way that was planned.
    ahead: Vec<Vec2>,
    status: SessionStatus,
    heard: Vec<String>,
    verbose: bool,
    /// The second that was reported last.
    reported_s: f64,
}

impl Person {
    fn new(page: Page, start: Vec2, verbose: bool) -> Self {
        let route = &page.carried.corners;
        // A step to the left and on, which the corridors have room for.
        let along = route.get(1).map_or_else(Vec2::zeros, |next| (next - start).normalize());
        let turn = start + along * TURNS_AT_M;
        let aside = Vec2::new(-along.y, along.x) * ASIDE_M;
        let out = [start, turn, turn + aside].into_iter().chain(route.iter().skip(1).copied());
        let ahead: Vec<Vec2> = out.chain(route.iter().rev().skip(1).copied()).collect();
        Self {
            page,
            came: Newcomer::default(),
            ahead,
            status: SessionStatus::default(),
            heard: Vec::new(),
            verbose,
            reported_s: 0.0,
        }
    }

    fn place(&self) -> Vec2 {
        self.page.carried.pose(self.page.carried.settled_s()).translation.xy()
    }

    /// From here to the corners ahead.
    fn way(&self) -> Vec<Vec2> {
        std::iter::once(self.place()).chain(self.ahead.iter().copied()).collect()
    }

    /// A moment: what is said is heard, and corners are passed.
    fn moment(&mut self) -> Result<(), MeasureError> {
        let reports = self.page.moment()?;
        for spoken in reports.into_iter().flat_map(|report| report.said) {
            self.hear(&spoken.said.text);
        }
        self.status = self.page.phone.session().status();
        let place = self.place();
        if self.ahead.first().is_some_and(|corner| (corner - place).norm() < PASSED_M) {
            self.ahead.remove(0);
        }
        if self.verbose && self.page.now_s >= self.reported_s + 1.0 {
            self.report();
        }
        Ok(())
    }

    fn report(&mut self) {
        self.reported_s = self.page.now_s;
        let session = self.page.phone.session();
        let (engine, s) = (session.engine(), &self.status);
        eprintln!(
            "{:5.1} s: {:?}, motion sensors {:?}, metric {}, focal {:.3} of {:.3}, late {:.0} of {:.0} ms, readout {:.0} of {:.0} ms, {} key frames, metres {:.3?}, recorded {:.2} m, guided {:?}",
            self.page.now_s,
            s.phase,
            engine.status().imu.and_then(|imu| imu.fault),
            s.metric,
            self.focal(),
            self.came.focal,
            1e3 * engine.snapshot().imu_offset(),
            self.came.late_ms,
            1e3 * engine.readout().seconds,
            self.came.readout_ms,
            s.key_frames,
            self.scale(),
            s.recording.as_ref().map_or(0.0, |r| r.length),
            s.guiding.as_ref().map(|g| (g.state, g.along_m, g.length_m)),
        );
    }

    /// The focal length of the lens that was found, and otherwise of the one assumed, over the latter.
    fn focal(&self) -> f64 {
        let guess = self.guess();
        let kept = kept(self.page.folder(), PHONE, &guess).and_then(|lens| lens.camera(&guess));
        kept.unwrap_or(guess).fx / guess.fx
    }

    fn guess(&self) -> Camera {
        let Camera { width, height, .. } = self.page.carried.traits.camera;
        Camera::guessed(width, height)
    }

    /// Whether the images are read with another lens than the one assumed.
    fn is_learned(&self) -> bool {
        self.page.phone.session().engine().front_end().model().fx != self.guess().fx
    }

    /// Metres in a metre of the map over its last seconds by the truth, and the standard deviation of its logarithm that is stated.
    fn scale(&self) -> Option<(f64, f64)> {
        let snapshot = self.page.phone.session().engine().snapshot();
        let ids = (0..snapshot.next_key_frame_id().index()).rev().filter_map(KeyFrameId::from_index);
        let last = ids.clone().find_map(|id| snapshot.key_frame(id))?;
        let sigma = snapshot.stated_scale_sigma(last.map)?;
        let recent = ids.filter_map(|id| snapshot.key_frame(id));
        let recent = recent.take_while(|k| k.map == last.map && last.stamp - k.stamp <= SCALE_S);
        let true_place = |k: &KeyFrame| {
            let after = self.page.truth.partition_point(|(stamp, _)| *stamp < k.stamp);
            self.page.truth.get(after).map(|(_, place)| *place)
        };
        let (own, real): (Vec<Vec3>, Vec<Vec3>) =
            recent.filter_map(|k| Some((k.world_from_camera.translation, true_place(k)?))).unzip();
        Some((spread(&real) / spread(&own), sigma))
    }

    fn hear(&mut self, words: &str) {
        if self.verbose {
            eprintln!("{:5.1} s: \"{words}\"", self.page.now_s);
        }
        self.page.carried.hear(words);
        self.heard.push(words.to_owned());
    }

    fn has_heard(&self, id: &str) -> bool {
        self.heard.contains(&Language::English.text(id))
    }

    fn stand(&mut self, seconds: f64) -> Result<(), MeasureError> {
        let until_s = self.page.now_s + seconds;
        while self.page.now_s < until_s {
            self.moment()?;
        }
        Ok(())
    }

    /// Presses the main button; whether it did what it offers.
    fn press(&mut self) -> Result<bool, MeasureError> {
        let Some(command) = offered(&self.status) else { return Ok(false) };
        let answer = self.page.phone.command(command);
        if self.verbose {
            eprintln!("{:5.1} s: presses {command}: {answer:?}", self.page.now_s);
        }
        match answer {
            Ok(words) => self.heard.push(words),
            Err(_) => return Ok(false),
        }
        self.status = self.page.phone.session().status();
        Ok(true)
    }

    /// Presses at once, is told what helps, and walks about until the phone is known; whether a recording has begun.
    fn learns(&mut self) -> Result<bool, MeasureError> {
        self.stand(SETS_OUT_S)?;
        let began_s = self.page.now_s;
        let way = self.way();
        self.page.carried.set_out_along(&way, began_s);
        let mut pressed_s = f64::NEG_INFINITY;
        while self.page.now_s - began_s < GIVES_UP_S {
            let walked_s = self.page.now_s - began_s;
            if self.page.now_s - pressed_s > PRESSES_AGAIN_S {
                pressed_s = self.page.now_s;
                self.came.early = self.press()?;
            }
            self.moment()?;
            self.came.lens_s = self.came.lens_s.or(self.is_learned().then_some(walked_s));
            if self.has_heard("walk-ready") || self.came.early {
                self.came.known_s = Some(walked_s).filter(|_| !self.came.early);
                self.page.carried.halt();
                while !self.page.carried.stands() {
                    self.moment()?;
                }
                return Ok(self.came.early || self.press()?);
            }
        }
        Ok(false)
    }

    /// Walks on along the way while it is recorded.
    fn records(&mut self, metres: f64) -> Result<(), MeasureError> {
        let traits = self.page.carried.traits;
        self.came.focal_off_percent = Some(100.0 * (self.focal() / self.came.focal - 1.0));
        let late_s = self.page.phone.session().engine().snapshot().imu_offset();
        self.came.late_off_ms = Some(1e3 * (late_s - traits.stamp_delay_s));
        let begin = self.page.truth.len().saturating_sub(1);
        self.page.carried.corners = cut(&self.way(), metres);
        let way = self.page.carried.corners.clone();
        self.page.carried.set_out_along(&way, self.page.now_s);
        while !self.page.carried.stands() {
            self.moment()?;
        }
        self.stand(STANDS_S)?;
        let recorded_m = self.status.recording.as_ref().map(|r| r.length);
        self.came.walked_m = length(&self.page.truth[begin..]);
        self.came.recorded_m = recorded_m;
        self.came.length_off_percent = recorded_m.map(|m| 100.0 * (m / self.came.walked_m - 1.0));
        self.came.wrong = self.came.length_off_percent.is_some_and(|off| off.abs() > MOST_OFF_PERCENT);
        self.press()?;
        self.stand(LISTENS_S)
    }

    /// Is guided home; how that ended.
    fn goes_home(&mut self, seed: u64) -> Result<String, MeasureError> {
        if !self.press()? {
            return Ok("not guided".into());
        }
        self.page.carried.follow_words(|at| cairn_trial::Walker::new(seed, at));
        let way = self.page.carried.corners.clone();
        let began_s = self.page.now_s;
        let (mut first_m, mut stood_s, mut farthest_m) = (None, 0.0, 0.0f64);
        let mut end = "on the way".to_owned();
        while self.page.now_s - began_s < HOME_S {
            self.moment()?;
            let place = self.walker_place();
            farthest_m = farthest_m.max(distance_to(&way, place));
            let stands = self.page.carried.walker().is_some_and(cairn_trial::Walker::is_standing);
            stood_s = if stands { stood_s + MOMENT_S } else { 0.0 };
            if let Some(g) = &self.status.guiding {
                let first = *first_m.get_or_insert(g.length_m);
                let changed = (g.length_m / first - 1.0).abs();
                self.came.changed_percent = self.came.changed_percent.max(100.0 * changed);
                self.came.jumped |= changed > JUMP;
            }
            let has_lost_distances = self.has_heard("walk-distances-lost");
            let has_arrived = self.page.phone.session().has_arrived();
            self.came.jumped &= !has_lost_distances;
            let enough_s = if has_arrived || has_lost_distances { ARRIVED_S } else { GIVEN_UP_S };
            if stood_s >= enough_s {
                end = match (has_arrived, has_lost_distances) {
                    (true, _) => "arrived".into(),
                    (_, true) => "distances lost".into(),
                    _ => format!("stands: {}", self.status.headline),
                };
                break;
            }
        }
        let from_start_m = way.first().map(|start| (self.walker_place() - start).norm());
        self.came.from_start_m = from_start_m;
        self.came.farthest_m = Some(farthest_m);
        let is_misled =
            farthest_m > MISLED_M || (end == "arrived" && from_start_m.is_some_and(|m| m > HOME_M));
        Ok(if is_misled { format!("misled, {end}") } else { end })
    }

    fn walker_place(&self) -> Vec2 {
        let (x, y, _) = self.page.carried.walker().map_or((0.0, 0.0, 0.0), cairn_trial::Walker::pose);
        Vec2::new(x, y)
    }
}

/// The command of the page's main button (`MainButton` in `web/src/page/routes.js`).
fn offered(status: &SessionStatus) -> Option<&'static str> {
    let paused = status.guiding.as_ref().map(|g| g.state == "paused");
    let is_new = status.route.as_ref().filter(|route| route.here).map(|route| route.is_new);
    match (status.frames, &status.recording, paused, is_new) {
        (0, ..) => None,
        (_, Some(_), ..) => Some("stop"),
        (_, _, Some(true), _) => Some("resume"),
        (_, _, Some(false), _) => Some("halt"),
        (_, _, _, Some(true)) => Some("guide"),
        (_, _, _, Some(false)) => Some("guide again"),
        _ => Some("record"),
    }
}

fn length(places: &[(Stamp, Vec3)]) -> f64 {
    places.windows(2).map(|w| (w[1].1 - w[0].1).norm()).sum()
}

/// How far places lie from their mean, root of the sum of squares.
fn spread(places: &[Vec3]) -> f64 {
    let mean = places.iter().sum::<Vec3>() / places.len().max(1) as f64;
    places.iter().map(|p| (p - mean).norm_squared()).sum::<f64>().sqrt()
}

/// The distance of a place from a line through corners, metres.
fn distance_to(corners: &[Vec2], place: Vec2) -> f64 {
    let to_leg = |leg: &[Vec2]| {
        let d = leg[1] - leg[0];
        let share = ((place - leg[0]).dot(&d) / d.norm_squared().max(1e-12)).clamp(0.0, 1.0);
        (leg[0] + d * share - place).norm()
    };
    corners.windows(2).map(to_leg).fold(f64::INFINITY, f64::min)
}
