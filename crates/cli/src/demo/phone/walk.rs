//! One walk with a phone in real time: out while the route is recorded, and home by what the page says.
//!
//! The phone's pictures and readings are drawn from the walker's true body on a thread of its own; everything that the
//! engine learns of the world comes over the socket, and everything that the walker hears too. Truth is only used to judge.

use super::super::config::DemoConfig;
use super::error::PhoneError;
use super::page::Page;
use super::walked::{Live, Spoken, Walked};
use cairn_geometry::{Vec2, Vec3};
use cairn_guide::Facing;
use cairn_random::Random;
use cairn_sensor::{ImuSensor, Rig};
use cairn_session::SessionConfig;
use cairn_sim::{PhoneTraits, RollingCamera};
use cairn_trial::way::{CarriedPhone, TURN_CAMERA_S};
use cairn_trial::{LEVELS, PageClock, encoded, smaller};
use cairn_web::{CameraSource, ServeConfig, Server};
use serde_json::json;
use std::path::Path;
use std::time::Duration;
use tokio::task::JoinHandle;

/// How often the phone looks at its sensors.
const TICK: Duration = Duration::from_millis(4);
/// Motion is sent in batches of this many readings, as by the page.
const PARCEL: usize = 2;
/// Time from the exposure to the encoded picture at least, seconds.
const ENCODING_S: f64 = 0.015;
/// Longest wait for the server's first status and for answers, seconds.
const PATIENCE_S: f64 = 20.0;
/// The walker waits so long for the phone to be known, seconds.
const MEET_S: f64 = 90.0;
/// The walk ends when the walker has stood this long after arrival, ...
const STANDING_S: f64 = 2.0;
/// ... or because the guide gives no directions any more.
const STOPPED_S: f64 = 30.0;

/// Walks out and home. Where the server does not know the lens, the walker first goes along the way and back until he hears that
/// it is ready, puts the phone away, and begins the walk at its start.
///
/// # Errors
/// When the server does not start or answer, or the connection breaks.
pub fn walk(
    config: &DemoConfig,
    traits: &PhoneTraits,
    known_lens: bool,
    folder: &Path,
) -> Result<Walked, PhoneError> {
    let rig =
        known_lens.then(|| Box::new(Rig { imu: Some(ImuSensor::of_phone()), ..Rig::mono(traits.camera) }));
    let server = server(config, rig, folder)?;
    runtime()?.block_on(async {
        let mut lens = None;
        if !known_lens {
            let mut phone = Phone::new(config, traits, page(config, &server, 0).await?)?;
            phone.begin().await?;
            phone.carried.set_out_and_return(phone.began_s);
            let begin = phone.page.clock.seconds();
            let ready = config.speaking.phrases().language.text("walk-ready");
            while !phone.page.heard.contains(&ready) && phone.page.clock.seconds() - begin < MEET_S {
                phone.turn().await?;
                let after_s = phone.page.clock.seconds() - begin;
                lens = lens.or(phone.page.lens.map(|lens| (lens, after_s)));
            }
        }
        let mut phone = Phone::new(config, traits, page(config, &server, 1).await?)?;
        phone.out().await?;
        phone.home().await?;
        phone.result.path = std::mem::take(&mut phone.carried.path);
        phone.result.lens = lens;
        phone.result.withheld = phone.page.withheld;
        phone.result.broken = phone.page.broken;
        phone.result.troubles = std::mem::take(&mut phone.page.troubles);
        let now = |key: &str| phone.page.status[key].as_u64().unwrap_or(0);
        phone.result.dropped = now("dropped").saturating_sub(phone.before[0]);
        phone.result.tracked = now("tracked").saturating_sub(phone.before[1]);
        Ok(phone.result)
    })
}

/// A server as `cairn serve` starts it, with its data in the folder.
fn server(config: &DemoConfig, rig: Option<Box<Rig>>, folder: &Path) -> Result<Server, PhoneError> {
    let routes = folder.join("walked");
    std::fs::create_dir_all(&routes)
        .map_err(|source| PhoneError::Folder { path: routes.display().to_string(), source })?;
    let session = SessionConfig {
        folder: routes.clone(),
        phrases: config.speaking.phrases(),
        announcer: config.speaking.announcer(),
        ..SessionConfig::default()
    };
    Ok(Server::start(ServeConfig {
        keep: Some(folder.to_owned()),
        routes: Some(routes),
        session,
        ..ServeConfig::new(CameraSource::Page { rig })
    })?)
}

fn runtime() -> Result<tokio::runtime::Runtime, PhoneError> {
    tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(PhoneError::Runtime)
}

/// The phone's page, opened for the nth time: the clock of a page begins when it is opened.
async fn page(config: &DemoConfig, server: &Server, nth: u64) -> Result<Page, PhoneError> {
    let mut random = Random::stream(config.seed, 0xC10C + nth);
    let clock = PageClock::new(1e12 * random.unit(), random.uniform(-1e-4, 1e-4));
    Page::open(server, config.speaking.language, clock, nth).await
}

/// A picture in the making: the phone's time of it, and its bytes.
type Shot = (RollingCamera, f64, Vec<u8>);

/// The phone and its walker.
struct Phone<'a> {
    config: &'a DemoConfig,
    page: Page,
    carried: CarriedPhone,
    /// When the walk out began by the phone's clock.
    began_s: f64,
    parcel: Vec<[f64; 7]>,
    camera: Option<RollingCamera>,
    shot: Option<JoinHandle<Shot>>,
    random: Random,
    /// Pictures that were not used, and frames with a pose, before this page was opened.
    before: [u64; 2],
    result: Walked,
}

impl<'a> Phone<'a> {
    fn new(config: &'a DemoConfig, traits: &PhoneTraits, page: Page) -> Result<Self, PhoneError> {
        let (carried, camera) = CarriedPhone::new(&config.sim, traits, config.seed, config.metres)?;
        Ok(Self {
            config,
            page,
            result: Walked { corners: carried.corners.clone(), ..Walked::default() },
            carried,
            began_s: 0.0,
            parcel: Vec::new(),
            camera: Some(camera),
            shot: None,
            random: Random::stream(config.seed, 0x57A4),
            before: [0; 2],
        })
    }

    /// Waits for the server; then the walk out begins.
    async fn begin(&mut self) -> Result<(), PhoneError> {
        let none = "the server gave no status";
        let frames = |p: &Self| p.page.status["frames"].as_u64();
        self.until(PATIENCE_S, none, |p| frames(p).is_some()).await?;
        let before = frames(self);
        self.before = ["dropped", "tracked"].map(|key| self.page.status[key].as_u64().unwrap_or(0));
        self.until(PATIENCE_S, "the server took no picture", |p| frames(p) > before).await?;
        self.began_s = self.page.clock.seconds();
        Ok(())
    }

    /// Records the walk out.
    async fn out(&mut self) -> Result<(), PhoneError> {
        self.begin().await?;
        self.carried.set_out(self.began_s);
        self.command("record").await?;
        let begin = self.began_s;
        let end_s = self.carried.out_s() + 1.0;
        while self.page.clock.seconds() - begin < end_s {
            self.turn().await?;
            if self.result.metric_after_s.is_none() && self.page.status["metric"] == true {
                self.result.metric_after_s = Some(self.page.clock.seconds() - begin);
            }
        }
        self.result.took_s[0] = self.page.clock.seconds() - begin;
        self.page.heard.clear();
        self.command("stop").await
    }

    /// Is guided home.
    async fn home(&mut self) -> Result<(), PhoneError> {
        self.carried.follow_words(|at| self.config.walker(at));
        if self.carried.walker().is_none() {
            return Err(PhoneError::NoRoute);
        }
        let facing = self.config.facing;
        if facing == Facing::Back {
            self.carried.turn_camera();
            let until = self.page.clock.seconds() + TURN_CAMERA_S + 0.5;
            while self.page.clock.seconds() < until {
                self.turn().await?;
            }
        }
        let name = super::super::config::facing_name(facing);
        self.command(&format!("guide {name}")).await?;
        let begin = self.page.clock.seconds();
        let slowest = if facing == Facing::Backwards { 0.08 } else { 0.2 };
        let length_m: f64 = self.result.corners.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
        let limit_s = 90.0 + length_m / slowest;
        let (mut standing_since, mut stopped_since) = (None, None);
        while self.page.clock.seconds() - begin < limit_s {
            self.turn().await?;
            let now = self.page.clock.seconds();
            let stands = self.carried.walker().is_some_and(cairn_trial::Walker::is_standing);
            let state = self.page.status["guiding"]["state"].as_str().unwrap_or_default();
            self.result.told_arrival |= self.page.arrived;
            let since = |held: bool, since: &mut Option<f64>| match held {
                true => now - *since.get_or_insert(now),
                false => {
                    *since = None;
                    0.0
                }
            };
            let done = since(stands && self.result.told_arrival, &mut standing_since) >= STANDING_S;
            let gave_up = since(stands && state == "stopped", &mut stopped_since) >= STOPPED_S;
            if gave_up {
                let text = |key: &str| self.page.status[key].as_str().unwrap_or_default().to_owned();
                self.result.stopped = Some(format!("{} {}", text("headline"), text("words")));
            }
            if done || gave_up {
                break;
            }
        }
        self.result.took_s[1] = self.page.clock.seconds() - begin;
        Ok(())
    }

    /// Gives a command and waits for its answer.
    async fn command(&mut self, line: &str) -> Result<(), PhoneError> {
        self.page.answers.clear();
        self.page.send(json!({ "command": line })).await?;
        self.until(PATIENCE_S, "the server did not answer", |p| !p.page.answers.is_empty()).await?;
        match self.page.answers.pop() {
            Some((false, why)) => Err(PhoneError::Refused { command: line.to_owned(), why }),
            _ => Ok(()),
        }
    }

    async fn until(
        &mut self,
        seconds: f64,
        what: &'static str,
        done: impl Fn(&Self) -> bool,
    ) -> Result<(), PhoneError> {
        let began = self.page.clock.seconds();
        while !done(self) {
            if self.page.clock.seconds() - began > seconds {
                let troubles = self.page.troubles.join("; ");
                return Err(PhoneError::TooLate { what, seconds, troubles });
            }
            self.turn().await?;
        }
        Ok(())
    }

    /// A moment; a connection that has ended is made again.
    async fn turn(&mut self) -> Result<(), PhoneError> {
        match self.moment().await {
            Ok(()) => Ok(()),
            Err(why) => self.page.reconnect(why).await,
        }
    }

    /// A message of the server, or the next look at the sensors.
    async fn moment(&mut self) -> Result<(), PhoneError> {
        let message = tokio::select! {
            biased;
            message = self.page.next() => Some(message?),
            () = tokio::time::sleep(TICK) => None,
        };
        if let Some(message) = message {
            let before = self.page.camera.take();
            self.page.take(message).await?;
            match self.page.camera {
                Some([x, y, z]) => self.compare(Vec3::new(x, y, z)),
                None => self.page.camera = before,
            }
        }
        self.carried.move_until(self.page.clock.seconds());
        self.hear();
        self.send_motion().await?;
        self.take_picture().await
    }

    /// Where the camera is said to be, and where it was when the picture before that was taken.
    fn compare(&mut self, said: Vec3) {
        let Some(ms) = self.page.frame_ms else { return };
        let at = (self.page.clock.seconds_of(ms) - self.carried.traits.stamp_delay_s).max(0.0);
        let truth = self.carried.pose(at.min(self.carried.settled_s())).translation;
        let s = &self.page.status;
        let state = format!(
            "{} {} {} {} {} {}",
            s["phase"].as_str().unwrap_or("-"),
            if s["metric"] == true { "metric" } else { "unit" },
            s["features"],
            s["inliers"],
            s["step_ms"].as_f64().unwrap_or_default().round(),
            LEVELS[self.page.pace.level].0
        );
        self.result.live.push(Live { t_s: at, said, truth, state });
    }

    /// The walker hears what the page says.
    fn hear(&mut self) {
        let Some((x, y, _)) = self.carried.walker().map(cairn_trial::Walker::pose) else { return };
        for words in self.page.heard.drain(..) {
            self.carried.hear(&words);
            self.result.said.push(Spoken { t_s: self.carried.end_s(), words, at: Vec2::new(x, y) });
        }
    }

    async fn send_motion(&mut self) -> Result<(), PhoneError> {
        for r in self.carried.readings(self.page.clock.seconds()) {
            let ms = self.page.clock.ms_at(r.stamp.seconds());
            self.parcel.push([ms, r.gyro.x, r.gyro.y, r.gyro.z, r.accel.x, r.accel.y, r.accel.z]);
        }
        if self.parcel.len() >= PARCEL && self.page.controls {
            let parcel = std::mem::take(&mut self.parcel);
            return self.page.send(json!({ "motion": parcel })).await;
        }
        Ok(())
    }

    /// Takes the camera's next picture if it is time and the pace allows it; sends the one that is ready.
    async fn take_picture(&mut self) -> Result<(), PhoneError> {
        if self.shot.as_ref().is_some_and(JoinHandle::is_finished)
            && let Some(shot) = self.shot.take()
        {
            let (camera, ms, jpeg) = shot.await?;
            self.camera = Some(camera);
            self.result.pictures += 1;
            self.page.picture(ms, &jpeg).await?;
        }
        let now = self.page.clock.seconds();
        let Some(at) = self.carried.exposure(now) else { return Ok(()) };
        if !self.page.controls || !self.page.pace.may_shoot(std::time::Instant::now()) {
            return Ok(());
        }
        let Some(mut camera) = self.camera.take() else { return Ok(()) };
        let (poses, traits) = (self.carried.poses(at), &self.carried.traits);
        let stamp_s = at + traits.stamp_delay_s + traits.stamp_jitter_s * self.random.standard_normal();
        let ms = self.page.clock.ms_at(stamp_s.min(now));
        let (side, quality, _) = LEVELS[self.page.pace.level];
        self.shot = Some(tokio::task::spawn_blocking(move || {
            let began = std::time::Instant::now();
            let image = camera.picture(at, &poses);
            let scale = f64::from(side) / image.width().max(image.height()) as f64;
            let image = if scale < 1.0 { smaller(&image, scale) } else { image };
            let jpeg = encoded(&image, quality);
            std::thread::sleep(Duration::from_secs_f64(ENCODING_S).saturating_sub(began.elapsed()));
            (camera, ms, jpeg)
        }));
        Ok(())
    }
}
