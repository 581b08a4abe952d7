//! The page on a phone that nobody knows, in lockstep: its pictures and readings reach the page's own engine ([`Phone`]) when they
//! would in a browser, by a clock that stands still while something is computed.

use crate::MeasureError;
use cairn_geometry::Vec3;
use cairn_phone::{Library, Phone, Report, Setup};
use cairn_random::Random;
use cairn_sensor::{Camera, Distortion, GrayImage, ImuSample, Stamp};
use cairn_sim::{PhoneTraits, RollingCamera, SimConfig};
use cairn_trial::way::CarriedPhone;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};

/// The name of the phone.
pub const PHONE: &str = "newcomer's";
/// Seconds of a moment.
pub const MOMENT_S: f64 = 0.02;
/// The page's clock at the beginning, seconds: no stamp is negative.
const EPOCH_S: f64 = 1.0;
/// Seconds from an exposure to the picture at least.
const ENCODING_S: f64 = 0.015;
/// The page takes every second or third picture of the camera, 10 to 15 a second.
const TAKEN: [usize; 2] = [2, 3];
/// While there is more to do than a moment allows, the page takes its next image so much later at most.
const CATCH_UP_S: f64 = 0.15;
/// Readings come in parcels of so many.
const PARCEL: usize = 2;
/// Longer and shorter side of the pictures.
const SIZE: [usize; 2] = [640, 480];

/// A phone as harsh as `data/phone`, whose pictures are stamped 35 to 40 ms late and read out in 20 ms, and whose focal length is 0.79
/// of the longer side; or harsher. Its lens is up to a quarter longer or shorter than assumed, its stamps are 50 ms early to 120 ms
/// late, its rows are read out in 0 to 30 ms. The other traits are those of [`PhoneTraits`].
pub fn drawn(seed: u64) -> PhoneTraits {
    let mut random = Random::stream(seed, 0x4E3C);
    let [long, short] = SIZE;
    let [width, height] = if seed.is_multiple_of(2) { [short, long] } else { [long, short] };
    let own = PhoneTraits::new(seed, width, height);
    let guessed = Camera::guessed(width, height);
    let focal = guessed.fx * random.uniform(0.75f64.ln(), 1.25f64.ln()).exp();
    let k1 = random.uniform(-0.06, 0.06);
    let camera = Camera {
        fx: focal,
        fy: focal,
        distortion: Distortion::RadialTangential([k1, 0.0, 0.0, 0.0, 0.0]),
        ..own.camera
    };
    PhoneTraits {
        camera,
        readout_s: random.uniform(0.0, 0.03),
        stamp_delay_s: random.uniform(-0.05, 0.12),
        stamp_jitter_s: random.uniform(1e-3, 4e-3),
        ..own
    }
}

/// A picture on its way to the page: when it comes, and its stamp.
struct Shot {
    comes_s: f64,
    stamp_s: f64,
    image: GrayImage,
}

/// The page, and who carries its phone.
pub struct Page {
    /// The phone and its walker.
    pub carried: CarriedPhone,
    /// The page's engine.
    pub phone: Phone,
    /// Seconds since the page was opened.
    pub now_s: f64,
    /// The true places of the camera at the pictures so far, by the stamps these have.
    pub truth: Vec<(Stamp, Vec3)>,
    camera: RollingCamera,
    random: Random,
    /// Pictures of the camera that are still left out.
    skipped: usize,
    shots: VecDeque<Shot>,
    /// When the last picture was taken, and whether mapping has not caught up.
    taken_s: f64,
    is_busy: bool,
    slices: usize,
    parcel: Vec<ImuSample>,
    folder: PathBuf,
}

impl Page {
    /// Opens it for the first time, on the phone of these traits, which does so many slices of mapping in a moment at most.
    ///
    /// # Errors
    /// When the phone cannot be simulated.
    pub fn open(sim: &SimConfig, traits: &PhoneTraits, slices: usize) -> Result<Self, MeasureError> {
        let (carried, camera) = CarriedPhone::new(sim, traits, sim.seed, None)?;
        let folder = std::env::temp_dir().join(format!("newcomer-{}-{}", std::process::id(), sim.seed));
        let setup = Setup {
            width: traits.camera.width,
            height: traits.camera.height,
            rate_hz: traits.camera_hz / 2.5,
            pinhole: None,
            distortion: None,
            motion: true,
            phone: Some(PHONE.into()),
            library: Library { folder: folder.clone(), ..Library::default() },
        };
        Ok(Self {
            carried,
            phone: Phone::new(&setup)?,
            now_s: 0.0,
            truth: Vec::new(),
            camera,
            random: Random::stream(sim.seed, 0x57A4),
            skipped: 0,
            shots: VecDeque::new(),
            taken_s: 0.0,
            is_busy: false,
            slices,
            parcel: Vec::new(),
            folder,
        })
    }

    /// The folder of its routes.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The next moment; what the page reports at it.
    ///
    /// # Errors
    /// A picture that does not fit.
    pub fn moment(&mut self) -> Result<Vec<Report>, MeasureError> {
        self.now_s += MOMENT_S;
        self.carried.move_until(self.now_s);
        self.parcel.extend(self.carried.readings(self.now_s));
        if self.parcel.len() >= PARCEL {
            for r in std::mem::take(&mut self.parcel) {
                self.phone.motion(EPOCH_S + r.stamp.seconds(), r.gyro.into(), r.accel.into())?;
            }
        }
        self.expose();
        while let Some(shot) = self.shots.pop_front() {
            if shot.comes_s > self.now_s {
                self.shots.push_front(shot);
                break;
            }
            self.phone.image(EPOCH_S + shot.stamp_s, shot.image.data())?;
        }
        let mut reports = self.phone.step();
        reports.extend(self.phone.tick(EPOCH_S + self.now_s)?);
        self.is_busy = (0..self.slices).all(|_| self.phone.work());
        Ok(reports)
    }

    /// Takes the picture that is due, if the page wants it.
    fn expose(&mut self) {
        let Some(at_s) = self.carried.exposure(self.now_s) else { return };
        if self.is_busy && self.now_s - self.taken_s < CATCH_UP_S {
            return;
        }
        if let Some(left) = self.skipped.checked_sub(1) {
            self.skipped = left;
            return;
        }
        self.skipped = TAKEN[self.random.below(TAKEN.len())] - 1;
        self.taken_s = self.now_s;
        let image = self.camera.picture(at_s, &self.carried.poses(at_s));
        let traits = &self.carried.traits;
        let stamp_s = at_s + traits.stamp_delay_s + traits.stamp_jitter_s * self.random.standard_normal();
        let stamp = Stamp::from_seconds(EPOCH_S + stamp_s);
        self.truth.push((stamp, self.carried.pose(at_s).translation));
        let comes_s = stamp_s.max(self.now_s + ENCODING_S);
        self.shots.push_back(Shot { comes_s, stamp_s, image });
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        // What a newcomer leaves behind is measured; nobody comes back to it.
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
