//! What a page calls to watch a walker with a phone: the images and readings of the phone out, the words that the walker hears in.
//! Times are seconds of the page's clock from the walk's begin on.
#![expect(unsafe_code, reason = "names that a page can find; no pointer is followed here")]

use crate::walker::Walker;
use crate::way::CarriedPhone;
use cairn_phrases::Language;
use cairn_sensor::Camera;
use cairn_sim::{PhoneTraits, RollingCamera, SimConfig, WorldKind};
use std::cell::RefCell;

/// Images as the page takes them from a camera.
const SIZE: [usize; 2] = [480, 360];
/// Motion is there before the first image, as where a page has asked for both.
const IMU_START_S: f64 = 0.1;
/// Radians a second: a blind walker turns corners slowly.
const TURN_RATE: f64 = 0.8;

thread_local! {
    static STATE: RefCell<State> = RefCell::default();
}

#[derive(Default)]
struct State {
    walk: Option<(CarriedPhone, RollingCamera)>,
    seed: u64,
    text: Vec<u8>,
    numbers: Vec<f64>,
    image: Vec<u8>,
}

impl State {
    fn phone(&mut self) -> Option<&mut CarriedPhone> {
        self.walk.as_mut().map(|(phone, _)| phone)
    }

    fn text(&self) -> String {
        String::from_utf8_lossy(&self.text).into_owned()
    }
}

/// Room for so many bytes of text.
#[unsafe(no_mangle)]
pub extern "C" fn walk_text(bytes: usize) -> *mut u8 {
    STATE.with_borrow_mut(|state| {
        state.text.resize(bytes, 0);
        state.text.as_mut_ptr()
    })
}

/// Begins at the start of the way, of which so many metres are walked. Returns six numbers (`walk_numbers`): the width and the height
/// of the images, their focal length and centre, and the seconds of the way out; 0 where there is no such walk.
#[unsafe(no_mangle)]
pub extern "C" fn walk_begin(seed: u32, metres: f64) -> usize {
    STATE.with_borrow_mut(|state| {
        let mut sim = SimConfig::new(WorldKind::Demo, seed.into());
        sim.walker.turn_rate = TURN_RATE;
        let [width, height] = SIZE;
        // The lens is known, as it is to a page after the first walk with a phone.
        let drawn = PhoneTraits::new(seed.into(), width, height);
        let Camera { fx, fy, cx, cy, .. } = drawn.camera;
        let camera = Camera::pinhole(width, height, fx, fy, cx, cy);
        let traits = PhoneTraits { camera, imu_start_s: IMU_START_S, ..drawn };
        state.seed = seed.into();
        state.walk = CarriedPhone::new(&sim, &traits, seed.into(), Some(metres)).ok();
        state.numbers = Vec::new();
        if let Some((phone, _)) = &state.walk {
            state.numbers = vec![width as f64, height as f64, fx, cx, cy, phone.out_s()];
        }
        state.numbers.len()
    })
}

/// The walker sets out.
#[unsafe(no_mangle)]
pub extern "C" fn walk_set_out(now_s: f64) {
    STATE.with_borrow_mut(|state| state.phone().into_iter().for_each(|phone| phone.set_out(now_s)));
}

/// At the end of the way out: goes by words from now on, in the language of the text.
#[unsafe(no_mangle)]
pub extern "C" fn walk_follow_words() {
    STATE.with_borrow_mut(|state| {
        let (seed, language) = (state.seed, state.text().parse().unwrap_or(Language::English));
        let Some(phone) = state.phone() else { return };
        phone.follow_words(|at| Walker::new(seed, at).with_language(language));
    });
}

/// The walker hears the text.
#[unsafe(no_mangle)]
pub extern "C" fn walk_hear() {
    STATE.with_borrow_mut(|state| {
        let text = state.text();
        state.phone().into_iter().for_each(|phone| phone.hear(&text));
    });
}

/// Time goes on. Returns how many numbers of readings there are (`walk_numbers`): each is a time, three rad/s and three m/s^2.
#[unsafe(no_mangle)]
pub extern "C" fn walk_readings(now_s: f64) -> usize {
    STATE.with_borrow_mut(|state| {
        let mut numbers = Vec::new();
        if let Some(phone) = state.phone() {
            phone.move_until(now_s);
            for r in phone.readings(now_s) {
                numbers.extend([
                    r.stamp.seconds(),
                    r.gyro.x,
                    r.gyro.y,
                    r.gyro.z,
                    r.accel.x,
                    r.accel.y,
                    r.accel.z,
                ]);
            }
        }
        state.numbers = numbers;
        state.numbers.len()
    })
}

/// The numbers that the last call spoke of.
#[unsafe(no_mangle)]
pub extern "C" fn walk_numbers() -> *const f64 {
    STATE.with_borrow(|state| state.numbers.as_ptr())
}

/// Draws the image that is due (`walk_image`), and returns when the phone says that it was taken; a negative number where none is due.
#[unsafe(no_mangle)]
pub extern "C" fn walk_draw(now_s: f64) -> f64 {
    STATE.with_borrow_mut(|state| {
        let Some((phone, camera)) = &mut state.walk else { return -1.0 };
        let Some(at) = phone.exposure(now_s) else { return -1.0 };
        let image = camera.picture(at, &phone.poses(at));
        state.image.clear();
        state.image.extend_from_slice(image.data());
        at + phone.traits.stamp_delay_s
    })
}

/// The gray bytes of the image, row by row.
#[unsafe(no_mangle)]
pub extern "C" fn walk_image() -> *const u8 {
    STATE.with_borrow(|state| state.image.as_ptr())
}

/// Metres from the start of the way, in a straight line; negative before the walker goes by words.
#[unsafe(no_mangle)]
pub extern "C" fn walk_from_start_m() -> f64 {
    STATE.with_borrow(|state| {
        let distance = |(phone, _): &(CarriedPhone, RollingCamera)| {
            let (start, (x, y, _)) = (phone.corners.first()?, phone.walker()?.pose());
            Some((start.x - x).hypot(start.y - y))
        };
        state.walk.as_ref().and_then(distance).unwrap_or(-1.0)
    })
}

/// The standard library names this, older C libraries lack it; a page has no threads.
#[unsafe(no_mangle)]
extern "C" fn pthread_join(_thread: usize, _result: usize) -> i32 {
    NOT_SUPPORTED
}

/// As `pthread_join`.
#[unsafe(no_mangle)]
extern "C" fn pthread_detach(_thread: usize) -> i32 {
    NOT_SUPPORTED
}

/// `ENOTSUP` of WASI.
const NOT_SUPPORTED: i32 = 58;
