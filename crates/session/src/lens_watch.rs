//! The lens of a phone whose calibration nobody gave: estimated while a session runs with a guess, and kept in the data
//! folder for the next session of the same phone. There it is checked in the same way, and replaced where it does not fit.
//!
//! It is found in steps. Within seconds the gyroscope tells whether the guess is wrong, and a better one to some percent
//! ([`TurnFactor`]); after a turn it is estimated with everything that it is coupled to ([`LensProblem`]). A map that was made with a
//! wrong lens keeps a part of what that was off, so an estimate far from the lens in use is a better guess, which SLAM begins again with;
//! two estimates near it that agree are certain.

use crate::slam::Slam;
use cairn_atlas::{KeyFrameId, MapId, Snapshot};
use cairn_engine::FlowClocks;
use cairn_geometry::{Se3, So3};
use cairn_lens::{Lens, LensEstimate, LensProblem, TurnFactor};
use cairn_sensor::{Camera, Distortion, Stamp};
use cairn_solve::{pause, to_end};

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The file in the data folder.
const FILE: &str = "lenses.json";
/// Largest such file that is read, bytes.
const MOST_BYTES: u64 = 1 << 20;
/// The estimate is tried from so many key frames on, and again after this time. The first ones of `bench run newcomers`, seeds 1 to 12,
/// are of 15 to 21 key frames, and within 1.5 %.
const LEAST_KEY_FRAMES: usize = 12;
const AGAIN: Duration = Duration::from_millis(1500);
/// Interval at which turns are compared, where that is done between images.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// An estimate is kept when it is certain to this: focal length (relative) and distortion.
const CERTAIN: [f64; 2] = [0.01, 0.03];
/// Only across a turn of so many radians is a focal length told from the distances.
const LEAST_TURN_RAD: f64 = 1.0;
/// Two estimates in a row, of more and more key frames, agree to this: focal length (relative) and distortion. What a model
/// lacks (a rolling shutter, stamps behind the exposure) is not in their standard deviations.
const AGREE: [f64; 2] = [0.015, 0.03];
/// An estimate farther than this from the lens in use, relative focal length, is a better guess; ...
const FAR: f64 = 0.05;
/// ... and this share of what it was off may be left of it: 8 to 11 % were with newcomers whose guess was 3 to 24 % off (seeds 1 to 12).
const KEPT_OF_WRONG: f64 = 0.12;
/// A lens in use that is this near to an estimate, relative focal length and distortion, is known: SLAM goes on with it. Of
/// sixteen newcomers the focal length was then within 2 % of the true one.
const NEAR: [f64; 2] = [0.01, 0.02];
/// Offset of the clocks and readout are not known better than this from an estimate of the lens, seconds: of newcomers the offset is 3 to 5
/// ms off where it is said to be known to less.
const LEAST_CLOCK_SIGMA_S: [f64; 2] = [0.003, 0.006];
/// An estimate says something new once the camera has gone so far since the one before, as a share of the extent of the walk until
/// then, or has turned by so many radians: the pictures of one who stands say the same again, with the same errors.
const GONE_ON: (f64, f64) = (0.15, 0.4);
/// A kept lens is contradicted beyond that, and beyond so many standard deviations of both.
const CONTRADICTED: f64 = 3.0;
/// A guess may be off by so many of its standard deviations.
const CREDIBLE: f64 = 3.0;
/// Standard deviation of a distortion of which nothing is known.
const ANY_RADIAL: f64 = 0.1;

/// A kept lens: focal length as a share of the longer side, distortion of the ray's offset (as in [`Lens`]), and their
/// standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct KeptLens {
    /// The focal length.
    pub focal: f64,
    /// The distortion.
    pub radial: f64,
    /// Their standard deviations.
    pub sigma: [f64; 2],
}

impl KeptLens {
    /// The camera with this lens, for images of the size of `guess`.
    pub fn camera(&self, guess: &Camera) -> Option<Camera> {
        let f = self.focal * guess.width.max(guess.height) as f64;
        let camera = Lens { focal: f / guess.fx, radial: self.radial }.camera(guess);
        camera.validate().is_ok().then_some(camera)
    }

    /// Whether it is known as well as it is going to be; otherwise it is a better guess.
    fn is_certain(&self) -> bool {
        (0..2).all(|k| self.sigma[k] < CERTAIN[k])
    }

    /// This lens with another focal length, by the turns of the camera.
    fn turned(&self, found: &TurnFactor) -> Self {
        let sigma = [found.sigma_after().max(CERTAIN[0]), ANY_RADIAL];
        Self { focal: self.focal * found.factor, radial: self.radial, sigma }
    }

    /// This lens followed by what was found to be left of it, to first order in the distortions.
    fn followed_by(&self, left: &LensEstimate) -> Self {
        let radial = self.radial * left.lens.focal.powi(2) + left.lens.radial;
        Self { focal: self.focal * left.lens.focal, radial, sigma: left.sigma }
    }

    /// Whether an estimate of what is left of the lens differs from nothing.
    fn is_contradicted(&self, left: &LensEstimate) -> bool {
        let off = [left.lens.focal.ln().abs(), left.lens.radial.abs()];
        let sigma = |k: usize| self.sigma[k].hypot(left.sigma[k]);
        (0..2).any(|k| off[k] > AGREE[k].max(CONTRADICTED * sigma(k)))
    }
}

/// A phone's motion comes in the axes of its images.
fn imu_from_camera() -> So3 {
    So3::identity()
}

/// The lens kept for a phone and the shape of its images.
pub fn kept(folder: &Path, phone: &str, camera: &Camera) -> Option<KeptLens> {
    all(folder).get(&key(phone, camera)).copied()
}

fn all(folder: &Path) -> BTreeMap<String, KeptLens> {
    // A file that cannot be read is the same as none: the lens is estimated again.
    let text = cairn_files::read_text(&folder.join(FILE), MOST_BYTES).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

fn key(phone: &str, camera: &Camera) -> String {
    let divisor = gcd(camera.width, camera.height).max(1);
    format!("{phone} {}:{}", camera.width / divisor, camera.height / divisor)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

fn keep(folder: &Path, phone: &str, camera: &Camera, lens: KeptLens) -> std::io::Result<()> {
    let mut all = all(folder);
    all.insert(key(phone, camera), lens);
    std::fs::create_dir_all(folder)?;
    let beside = folder.join(format!("{FILE}.new"));
    std::fs::write(&beside, serde_json::to_string_pretty(&all)?)?;
    std::fs::rename(beside, folder.join(FILE))
}

/// An estimate in slices.
enum InSlices {
    InHand(Pin<Box<dyn Future<Output = Option<LensEstimate>> + Send>>),
    Done(Option<LensEstimate>),
}

/// Estimates the lens of the phone of a running session, or checks the one that was kept.
pub struct LensWatch {
    /// Where it is kept, if so.
    folder: Option<PathBuf>,
    phone: String,
    guess: Camera,
    /// The lens that the images are read with, where it was kept.
    kept: Option<KeptLens>,
    tried: Option<Instant>,
    /// The times of the images at which it was looked at, and tried, without a thread.
    looked: Option<Stamp>,
    tried_at: Option<Stamp>,
    /// The newest key frame that the last estimate looked at.
    looked_at: Option<KeyFrameId>,
    job: Option<JoinHandle<Option<LensEstimate>>>,
    /// An estimate without a thread: in hand, or done.
    in_slices: Option<InSlices>,
    /// The last certain estimate.
    before: Option<Lens>,
    /// The gyroscope contradicted the lens that the images are read with, and a better one was told.
    turned: bool,
    done: bool,
}

impl LensWatch {
    /// For a phone whose images are read with a guess, or with the lens that was kept for it; what is found is kept in the
    /// folder, where there is one.
    pub fn new(folder: Option<PathBuf>, phone: String, guess: Camera, kept: Option<KeptLens>) -> Self {
        Self {
            folder,
            phone,
            guess,
            kept,
            tried: None,
            looked: None,
            tried_at: None,
            looked_at: None,
            job: None,
            in_slices: None,
            before: None,
            turned: false,
            done: false,
        }
    }

    /// Whether the images are read with a lens that is known.
    pub fn is_certain(&self) -> bool {
        self.kept.is_some_and(|kept| kept.is_certain())
    }

    /// A watch over this lens, once images are read with it; `None` where it is no lens for these images.
    pub fn with(&self, lens: KeptLens) -> Option<Self> {
        lens.camera(&self.guess)?;
        let before = self.before.filter(|_| !lens.is_certain());
        let next = Self::new(self.folder.clone(), self.phone.clone(), self.guess, Some(lens));
        Some(Self { before, ..next })
    }

    /// The camera that the images are read with.
    pub fn camera(&self) -> Camera {
        self.kept.and_then(|lens| lens.camera(&self.guess)).unwrap_or(self.guess)
    }

    /// The lens that the images are read with.
    fn read_with(&self) -> KeptLens {
        let guessed = self.guess.fx / self.guess.width.max(self.guess.height) as f64;
        self.kept.unwrap_or(KeptLens { focal: guessed, radial: 0.0, sigma: [0.0; 2] })
    }

    /// Called often: compares turns, begins an estimate on a thread of its own, or takes a finished one. Returns what was found, once
    /// for each of the two.
    pub fn step(&mut self, engine: &dyn Slam) -> Option<LensFound> {
        if self.done || self.guess.distortion != Distortion::None {
            return None;
        }
        let snapshot = engine.snapshot();
        if let Some(lens) = self.by_turns(&snapshot) {
            (self.turned, self.before) = (true, None);
            return Some(self.kept_as(lens, None));
        }
        if let Some(job) = self.job.take_if(|job| job.is_finished()) {
            return self.take(&job.join().ok().flatten()?);
        }
        if self.job.is_none() && self.tried.is_none_or(|t| t.elapsed() >= AGAIN) {
            let work = self.estimate(engine, snapshot)?;
            self.job = std::thread::Builder::new().name("cairn-lens".into()).spawn(|| to_end(work)).ok();
            self.tried = self.job.as_ref().map(|_| Instant::now());
        }
        None
    }

    /// The same where there are no threads, called with each image; [`LensWatch::work`] does the estimates between images.
    pub fn step_here(&mut self, engine: &dyn Slam, now: Stamp) -> Option<LensFound> {
        if self.done || self.guess.distortion != Distortion::None {
            return None;
        }
        let is_due = |last: Stamp, every: Duration| now - last >= every.as_secs_f64();
        if self.looked.is_some_and(|last| !is_due(last, LOOK_EVERY)) {
            return None;
        }
        self.looked = Some(now);
        let snapshot = engine.snapshot();
        if let Some(lens) = self.by_turns(&snapshot) {
            (self.turned, self.before) = (true, None);
            return Some(self.kept_as(lens, None));
        }
        match self.in_slices.take() {
            Some(InSlices::Done(estimate)) => return self.take(&estimate?),
            Some(in_hand) => self.in_slices = Some(in_hand),
            None if self.tried_at.is_some_and(|last| !is_due(last, AGAIN)) => {}
            None => {
                self.in_slices = Some(InSlices::InHand(Box::pin(self.estimate(engine, snapshot)?)));
                self.tried_at = Some(now);
            }
        }
        None
    }

    /// Does the next slice of an estimate without a thread; false when there was nothing to do.
    pub fn work(&mut self) -> bool {
        let Some(InSlices::InHand(work)) = &mut self.in_slices else { return false };
        if let Poll::Ready(estimate) = work.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            self.in_slices = Some(InSlices::Done(estimate));
        }
        true
    }

    /// Takes an estimate; the lens, once it is certain and another than is read with, or is a far better guess.
    fn take(&mut self, estimate: &LensEstimate) -> Option<LensFound> {
        if let Some(lens) = self.far_better(estimate) {
            // The next one is compared with what this one says.
            self.before = Some(Lens::GUESS);
            return Some(self.kept_as(lens, clocks_of(estimate)));
        }
        if !self.is_trusted(estimate) {
            return None;
        }
        self.done = true;
        if let Some(lens) = self.confirmed(estimate) {
            return Some(LensFound { is_in_use: true, ..self.kept_as(lens, None) });
        }
        self.found(estimate).map(|lens| self.kept_as(lens, clocks_of(estimate)))
    }

    fn kept_as(&self, lens: KeptLens, clocks: Option<FlowClocks>) -> LensFound {
        let keep = |folder: &PathBuf| keep(folder, &self.phone, &self.guess, lens).err();
        let not_kept = self.folder.as_ref().and_then(keep).map(|e| e.to_string());
        LensFound { lens, clocks, is_certain: lens.is_certain(), is_in_use: false, not_kept }
    }

    /// The lens by the turns of the newest map, where these contradict a guess.
    fn by_turns(&self, snapshot: &Snapshot) -> Option<KeptLens> {
        if self.turned || self.is_certain() {
            return None;
        }
        let newest = snapshot.key_frames().max_by_key(|k| k.id)?.map;
        self.better_by(&TurnFactor::of(snapshot, newest, &imu_from_camera())?)
    }

    /// The lens by a factor on the turns, where that contradicts what is known.
    fn better_by(&self, found: &TurnFactor) -> Option<KeptLens> {
        let is_wrong = found.contradicts(self.kept.map(|kept| kept.sigma[0]));
        let lens = is_wrong.then(|| self.read_with().turned(found))?;
        lens.camera(&self.guess).map(|_| lens)
    }

    /// The lens by an estimate that is far from a guess.
    fn far_better(&self, estimate: &LensEstimate) -> Option<KeptLens> {
        let off = estimate.lens.focal.ln().abs();
        let known = self.kept.map_or(0.0, |kept| CREDIBLE * kept.sigma[0]);
        let is_far = is_settled(estimate) && !self.is_certain() && off > FAR.max(known);
        let lens = is_far.then(|| self.read_with().followed_by(estimate))?;
        let sigma = [(KEPT_OF_WRONG * off).max(CERTAIN[0]), lens.sigma[1]];
        lens.camera(&self.guess).map(|_| KeptLens { sigma, ..lens })
    }

    /// The guess that the images are read with, where a trusted estimate says the same.
    fn confirmed(&self, estimate: &LensEstimate) -> Option<KeptLens> {
        let off = [estimate.lens.focal.ln().abs(), estimate.lens.radial.abs()];
        let is_near = !self.is_certain() && (0..2).all(|k| off[k] < NEAR[k]);
        let sigma = [0, 1].map(|k| off[k].max(estimate.sigma[k]));
        is_near.then(|| KeptLens { sigma, ..self.read_with() })
    }

    /// The lens by a trusted estimate; `None` where that agrees with the one that was kept.
    fn found(&self, estimate: &LensEstimate) -> Option<KeptLens> {
        let lens = self.read_with();
        (!self.is_certain() || lens.is_contradicted(estimate)).then(|| lens.followed_by(estimate))
    }

    /// Whether an estimate is certain and agrees with the one before it.
    fn is_trusted(&mut self, estimate: &LensEstimate) -> bool {
        if !is_settled(estimate) {
            self.before = None;
            return false;
        }
        let agrees = |b: Lens| {
            (estimate.lens.focal / b.focal).ln().abs() < AGREE[0]
                && (estimate.lens.radial - b.radial).abs() < AGREE[1]
        };
        self.before.replace(estimate.lens).is_some_and(agrees)
    }

    /// The work of an estimate, where the walk says something new.
    fn estimate(
        &mut self,
        engine: &dyn Slam,
        snapshot: Arc<Snapshot>,
    ) -> Option<impl Future<Output = Option<LensEstimate>> + Send + use<>> {
        let (last, newest) = snapshot.key_frames().max_by_key(|k| k.id).map(|k| (k.id, k.map))?;
        if snapshot.key_frames_of(newest).take(LEAST_KEY_FRAMES).count() < LEAST_KEY_FRAMES {
            return None;
        }
        if self.looked_at.is_some_and(|looked_at| !has_gone_on(&snapshot, newest, looked_at)) {
            return None;
        }
        self.looked_at = Some(last);
        let camera = *engine.camera();
        Some(async move {
            let problem = LensProblem::of(&snapshot, newest, &camera, &imu_from_camera())?;
            pause().await;
            if problem.turned_rad() < LEAST_TURN_RAD {
                return None;
            }
            problem.solve_in_slices().await
        })
    }
}

/// What an estimate says of the clocks.
fn clocks_of(estimate: &LensEstimate) -> Option<FlowClocks> {
    let at_least = |[value, sigma]: [f64; 2], k: usize| [value, sigma.max(LEAST_CLOCK_SIGMA_S[k])];
    Some(FlowClocks { offset_s: at_least(estimate.offset_s, 0), readout_s: at_least(estimate.readout_s, 1) })
}

/// Whether an estimate is as certain as a lens has to be.
fn is_settled(estimate: &LensEstimate) -> bool {
    estimate.converged && (0..2).all(|k| estimate.sigma[k] < CERTAIN[k])
}

/// Whether the camera has gone on, or turned, since a key frame.
fn has_gone_on(snapshot: &Snapshot, map: MapId, since: KeyFrameId) -> bool {
    let poses = |is_later: bool| {
        let chosen = snapshot.key_frames_of(map).filter(move |k| (k.id > since) == is_later);
        chosen.map(|k| k.world_from_camera).collect::<Vec<_>>()
    };
    are_elsewhere(&poses(true), &poses(false))
}

/// Whether later poses are elsewhere than the last of those before, or turned from it.
fn are_elsewhere(later: &[Se3], before: &[Se3]) -> bool {
    let (Some(first), Some(last)) = (before.first(), before.last()) else { return true };
    let distance = |a: &Se3, b: &Se3| (a.translation - b.translation).norm();
    let extent = before.iter().map(|p| distance(p, first)).fold(0.0, f64::max);
    let turned = |p: &Se3| (last.rotation.inverse() * p.rotation).angle();
    later.iter().any(|p| distance(p, last) > GONE_ON.0 * extent || turned(p) > GONE_ON.1)
}

/// A lens that was just found.
pub struct LensFound {
    /// The lens.
    pub lens: KeptLens,
    /// The clocks of camera and IMU and the readout of the rows, where these were found with it.
    pub clocks: Option<FlowClocks>,
    /// Otherwise it is a better guess.
    pub is_certain: bool,
    /// The images are read with it: what was a guess is known now.
    pub is_in_use: bool,
    /// Why it could not be kept, if so.
    pub not_kept: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(focal: f64, radial: f64, sigma: [f64; 2]) -> LensEstimate {
        LensEstimate {
            lens: Lens { focal, radial },
            sigma,
            offset_s: [0.0, 0.003],
            readout_s: [0.0, 0.003],
            rms_px: 0.5,
            converged: true,
        }
    }

    #[test]
    fn lens_is_kept_for_its_phone_and_the_shape_of_its_images() {
        let folder = std::env::temp_dir().join(format!("cairn-lens-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        let camera = |w: usize, h: usize| Camera::pinhole(w, h, 0.7 * w as f64, 0.7 * w as f64, 1.0, 1.0);
        let lens = KeptLens { focal: 0.8, radial: 0.05, sigma: [0.003, 0.01] };
        assert_eq!(kept(&folder, "a", &camera(640, 480)), None);
        keep(&folder, "a", &camera(640, 480), lens).unwrap();
        keep(&folder, "b", &camera(640, 480), KeptLens { focal: 0.7, ..lens }).unwrap();
        // Smaller images of the same shape are the same lens; other shapes are cut otherwise.
        let found = kept(&folder, "a", &camera(320, 240)).unwrap();
        assert_eq!(found, lens);
        let camera_320 = found.camera(&camera(320, 240)).unwrap();
        assert!((camera_320.fx - 256.0).abs() < 1e-9 && camera_320.width == 320);
        assert_eq!(kept(&folder, "a", &camera(480, 640)), None);
        std::fs::write(folder.join(FILE), "rubbish").unwrap();
        assert_eq!(kept(&folder, "a", &camera(640, 480)), None);
        let _ = std::fs::remove_dir_all(&folder);
    }

    #[test]
    fn one_estimate_alone_and_one_that_differs_are_not_trusted() {
        let guess = Camera::pinhole(640, 480, 448.0, 448.0, 319.5, 239.5);
        let mut watch = LensWatch::new(None, "a".into(), guess, None);
        let of = |focal: f64, sigma: f64| estimate(focal, 0.04, [sigma, 0.002]);
        assert!(!watch.is_trusted(&of(1.26, 0.003)), "the first");
        assert!(!watch.is_trusted(&of(1.18, 0.003)), "another");
        assert!(!watch.is_trusted(&of(1.18, 0.05)), "an uncertain one");
        assert!(!watch.is_trusted(&of(1.185, 0.003)) && watch.is_trusted(&of(1.18, 0.003)));
    }

    #[test]
    fn one_estimate_far_from_a_guess_is_a_better_guess_and_no_more() {
        let guess = Camera::pinhole(640, 480, 448.0, 448.0, 319.5, 239.5);
        let of = |focal: f64, sigma: f64| estimate(focal, 0.02, [sigma, 0.002]);
        let mut watch = LensWatch::new(None, "a".into(), guess, None);
        assert!(watch.take(&of(1.04, 0.003)).is_none() && watch.take(&of(1.2, 0.02)).is_none());
        let found = watch.take(&of(1.2, 0.003)).expect("a better guess");
        assert!(!found.is_certain && (found.lens.focal - 0.84).abs() < 1e-9, "{:?}", found.lens);
        assert!((0.02..0.03).contains(&found.lens.sigma[0]), "{:?}", found.lens);
        let mut next = watch.with(found.lens).expect("a lens");
        assert!(next.take(&of(1.055, 0.003)).is_none(), "as far as it may be off");
        assert!(next.take(&of(1.05, 0.003)).is_some_and(|found| found.is_certain), "and again");
        let mut next = watch.with(found.lens).expect("a lens");
        let confirmed =
            next.take(&estimate(1.005, 0.0, [0.003, 0.002])).expect("it says the same as the one before");
        assert!(confirmed.is_certain && confirmed.is_in_use && confirmed.lens.focal == found.lens.focal);
        let certain = KeptLens { focal: 0.7, radial: 0.0, sigma: [0.004, 0.01] };
        let mut kept = LensWatch::new(None, "a".into(), guess, Some(certain));
        assert!(kept.take(&of(1.2, 0.003)).is_none(), "a certain one needs two");
        assert!(kept.take(&of(1.2, 0.003)).is_some());
    }

    #[test]
    fn one_who_stands_says_nothing_new() {
        use cairn_geometry::Vec3;
        let at = |x: f64, heading: f64| Se3::new(So3::exp(&(Vec3::y() * heading)), Vec3::x() * x);
        let before: Vec<Se3> = (0..=40).map(|i| at(0.1 * f64::from(i), 0.0)).collect();
        let sways: Vec<Se3> = (0..20).map(|i| at(4.0 + 0.05 * f64::from(i).sin(), 0.1)).collect();
        assert!(!are_elsewhere(&sways, &before) && !are_elsewhere(&[], &before));
        assert!(are_elsewhere(&[at(4.7, 0.0)], &before), "he walks on");
        assert!(are_elsewhere(&[at(4.0, 0.5)], &before), "he turns");
        assert!(are_elsewhere(&sways, &[]), "another map");
    }

    #[test]
    fn a_guess_that_the_gyroscope_contradicts_is_replaced_at_once_by_a_better_one() {
        let guess = Camera::pinhole(640, 480, 448.0, 448.0, 319.5, 239.5);
        let watch = LensWatch::new(None, "a".into(), guess, None);
        let turns = |factor: f64| TurnFactor { factor, sigma: 0.01 };
        assert!(!watch.is_certain() && watch.better_by(&turns(1.01)).is_none());
        let better = watch.better_by(&turns(1.15)).unwrap();
        assert!((better.focal - 0.805).abs() < 1e-9 && !better.is_certain(), "{better:?}");
        assert!((0.02..0.05).contains(&better.sigma[0]), "what is left is within what is stated: {better:?}");
        // It is a guess too, and is replaced by what is certain, however near that is.
        let next = watch.with(better).unwrap();
        assert!((next.camera().fx - 515.2).abs() < 1e-9 && !next.is_certain());
        assert!(next.better_by(&turns(1.05)).is_none(), "it is not known better than that");
        assert!(next.better_by(&turns(1.3)).is_some());
        let found = next.found(&estimate(1.02, 0.01, [0.003, 0.005]));
        assert!(found.is_some_and(|f| f.is_certain() && (f.focal - 0.8211).abs() < 1e-9), "{found:?}");
        let certain = next.with(found.unwrap()).unwrap();
        assert!(certain.is_certain());
    }

    #[test]
    fn kept_lens_that_does_not_fit_is_replaced_and_one_that_fits_stays() {
        let guess = Camera::pinhole(640, 480, 448.0, 448.0, 319.5, 239.5);
        let kept = KeptLens { focal: 0.88, radial: -0.075, sigma: [0.004, 0.01] };
        let watch = LensWatch::new(None, "a".into(), guess, Some(kept));
        assert_eq!(watch.found(&estimate(1.01, 0.01, [0.003, 0.005])), None);
        assert_eq!(
            watch.found(&estimate(0.985, -0.02, [0.009, 0.02])),
            None,
            "within what both are known to"
        );
        let other = watch.found(&estimate(0.94, 0.11, [0.003, 0.005])).unwrap();
        assert!((other.focal - 0.8272).abs() < 1e-9 && other.sigma == [0.003, 0.005], "{other:?}");
        // A distortion that was kept wrong alone is replaced too.
        assert!(watch.found(&estimate(1.0, 0.06, [0.003, 0.005])).is_some());
        // The ray of a pixel by the new lens is that by the kept one and then by what was left.
        let (f, d) = (640.0 * kept.focal, 200.0);
        let x = d * (1.0 + kept.radial * (d / f).powi(2));
        let ray = x * (1.0 + 0.11 * (x / (0.94 * f)).powi(2)) / (0.94 * f);
        let f = 640.0 * other.focal;
        let direct = d * (1.0 + other.radial * (d / f).powi(2)) / f;
        assert!((ray / direct - 1.0).abs() < 5e-3, "{ray} {direct}");
    }
}
