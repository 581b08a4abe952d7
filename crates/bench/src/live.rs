//! `live`: latency of a live image, published by `ffmpeg` over RTMP to the listener, through the engine, to
//! announcements.
//!
//! Each image carries its number as a row of dark and light blocks at its lower edge, so that the time from handing it
//! to the publisher to its pose is measured with the clock of this process alone. The walk goes out, and back with the
//! camera looking backwards, again and again.

use crate::MeasureError;
use crate::error::of;
use cairn_engine::{Config, Engine, Output, Runner, SensorMode};
use cairn_eval::Percentiles;
use cairn_sensor::{Camera, FramePacket, GrayImage, Rig, Stamp};
use cairn_session::{
    Clock, Command as Ask, Event, Inbox, NotTracked, Observer, Script, Session, SessionConfig, drive, feed,
};
use cairn_sim::{LiveRig, SimConfig, SimSensor, WorldKind};
use cairn_sources::{OpenOptions, open, std_host};
use cairn_voice::{Espeak, SpeechConfig};
use serde::Serialize;
use std::fmt::Write as _;
use std::io::Write;
use std::net::TcpListener;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const RATE_HZ: f64 = 30.0;
/// Seconds of the outbound walk.
const OUT_S: f64 = 12.0;
/// Bits of an image's number, and the size of a block in pixels.
const BITS: usize = 20;
const BLOCK: usize = 16;

/// The measured figures.
#[derive(Debug, Serialize)]
pub struct Live {
    /// Images handed to the publisher.
    pub published: usize,
    /// How often the stream was lost and restarted.
    pub reconnects: usize,
    /// Images that reached the engine.
    pub taken: usize,
    /// Images between the first and the last processed that were dropped: a newer one was there, or older than 150 ms.
    pub dropped: usize,
    /// Milliseconds from the publisher to the pose, minute by minute.
    pub pose_ms: Vec<Option<Percentiles>>,
    /// Milliseconds of the step alone.
    pub step_ms: Option<Percentiles>,
    /// Milliseconds from a pose to the announcement it triggers, as text.
    pub words_ms: Option<Percentiles>,
    /// Milliseconds espeak-ng needs to synthesise a sentence, if it is installed.
    pub speech_ms: Option<Percentiles>,
    /// Number of announcements.
    pub said: usize,
    /// Peak memory of this process so far, minute by minute, including the rendered walk.
    pub peak_rss_mb: Vec<Option<f64>>,
    /// Key frames of the map, minute by minute.
    pub key_frames: Vec<usize>,
}

/// Measures for `minutes`.
///
/// # Errors
/// When ffmpeg is missing, or nothing arrives.
pub fn run(minutes: f64) -> Result<Live, MeasureError> {
    let images = Arc::new(render()?);
    let port = TcpListener::bind("127.0.0.1:0")
        .and_then(|l| l.local_addr())
        .map_err(|e| of("no free port", e))?
        .port();
    let place = format!("127.0.0.1:{port}/cairn");
    let handed = Arc::new(Mutex::new(Vec::new()));
    let over = Arc::new(AtomicBool::new(false));
    let publisher = {
        let (images, handed, over, url) =
            (images.clone(), handed.clone(), over.clone(), format!("rtmp://{place}"));
        std::thread::spawn(move || publish(&images, &url, &handed, &over))
    };
    let rig = Rig::mono(camera());
    let options = OpenOptions { rig: Some(rig.clone()), ..OpenOptions::default() };
    let source = open(&format!("rtmp-listen://{place}"), options)?;
    let engine =
        Engine::new(&rig, SensorMode::Mono, RATE_HZ, Runner::Threaded, &Config::default(), &std_host())?;
    let folder = std::env::temp_dir().join(format!("cairn-live-{}", std::process::id()));
    let mut session =
        Session::new(engine, SessionConfig { folder: folder.clone(), ..SessionConfig::default() });
    let inbox = Inbox::new();
    feed(source, inbox.clone())?;
    let mut stopwatch = Stopwatch::new(handed.clone(), minutes);
    let driven = drive(&mut session, Clock::Wall(&inbox), &mut Script::default(), &mut stopwatch);
    inbox.close();
    over.store(true, Ordering::Relaxed);
    let published = publisher.join().map_err(|_| "the publisher failed")?;
    let _ = std::fs::remove_dir_all(folder);
    driven?;
    let reconnects = published?;
    let published = handed.lock().unwrap_or_else(PoisonError::into_inner).len();
    Ok(Live {
        published,
        reconnects,
        taken: stopwatch.step_ms.len(),
        dropped: (stopwatch.number + 1)
            .saturating_sub(stopwatch.first.unwrap_or(0) + stopwatch.step_ms.len()),
        pose_ms: stopwatch.pose_ms.iter().map(|ms| Percentiles::of(ms)).collect(),
        step_ms: Percentiles::of(&stopwatch.step_ms),
        words_ms: Percentiles::of(&stopwatch.words_ms),
        speech_ms: speech(),
        said: stopwatch.words_ms.len(),
        peak_rss_mb: stopwatch.peak_rss_mb,
        key_frames: stopwatch.key_frames,
    })
}

fn camera() -> Camera {
    Camera::pinhole(WIDTH, HEIGHT, 420.0, 420.0, 319.5, 239.5)
}

/// Renders the walk: out, and the same images in reverse order.
fn render() -> Result<Vec<GrayImage>, MeasureError> {
    let config = SimConfig {
        sensor: SimSensor::Mono,
        imu: None,
        camera: camera(),
        rate_hz: RATE_HZ,
        ..SimConfig::new(WorldKind::Demo, 3)
    };
    let mut rig = LiveRig::new(&config)?;
    let route = rig.world().routes().first().map(|w| w.points.clone()).unwrap_or_default();
    let motion = config.walker.motion(&route);
    let mut images = Vec::new();
    for k in 0..(OUT_S * RATE_HZ) as usize {
        let t = k as f64 / RATE_HZ;
        let packet = rig.packet(Stamp::from_seconds(t), &motion.pose(t))?;
        let image = packet.images.first().ok_or("the world rendered no image")?;
        images.push(image.as_ref().clone());
    }
    let back: Vec<GrayImage> = images.iter().rev().cloned().collect();
    images.extend(back);
    Ok(images)
}

/// Writes a number into the lower edge of an image.
fn mark(image: &mut GrayImage, number: usize) {
    for y in HEIGHT - BLOCK..HEIGHT {
        let row = image.row_mut(y);
        for bit in 0..BITS {
            let value = if number >> bit & 1 == 1 { 255 } else { 0 };
            row[bit * BLOCK..(bit + 1) * BLOCK].fill(value);
        }
    }
}

/// Reads the number written by [`mark`].
fn number_of(image: &GrayImage) -> Option<usize> {
    if (image.width(), image.height()) != (WIDTH, HEIGHT) {
        return None;
    }
    let row = image.row(HEIGHT - BLOCK / 2);
    Some((0..BITS).filter(|bit| row[bit * BLOCK + BLOCK / 2] > 127).map(|bit| 1 << bit).sum())
}

/// Hands images to ffmpeg, 30 per second, and stores the times; returns how often ffmpeg had to be restarted.
fn publish(
    images: &[GrayImage],
    url: &str,
    handed: &Mutex<Vec<Instant>>,
    over: &AtomicBool,
) -> Result<usize, MeasureError> {
    let mut again = 0;
    // The listener needs some time to start.
    std::thread::sleep(Duration::from_millis(800));
    let mut child = publisher(url)?;
    let began = Instant::now();
    for number in 0.. {
        let due = began + Duration::from_secs_f64(number as f64 / RATE_HZ);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        if over.load(Ordering::Relaxed) {
            break;
        }
        let mut image = images[number % images.len()].clone();
        mark(&mut image, number);
        handed.lock().unwrap_or_else(PoisonError::into_inner).push(Instant::now());
        let wrote = child.stdin.as_mut().map(|pipe| pipe.write_all(image.data()));
        if !matches!(wrote, Some(Ok(()))) {
            // The listener has closed the connection, as after a pause: publish again, as a phone does.
            let _ = child.wait();
            again += 1;
            std::thread::sleep(Duration::from_millis(300));
            child = publisher(url)?;
        }
    }
    let _ = child.kill();
    let _ = child.wait();
    Ok(again)
}

fn publisher(url: &str) -> Result<Child, MeasureError> {
    let size = format!("{WIDTH}x{HEIGHT}");
    Command::new("ffmpeg")
        .args(["-loglevel", "error", "-fflags", "nobuffer", "-f", "rawvideo", "-pix_fmt", "gray"])
        .args(["-video_size", &size, "-framerate", "30", "-i", "pipe:0", "-pix_fmt", "yuv420p"])
        .args(["-c:v", "libx264", "-preset", "ultrafast", "-tune", "zerolatency", "-g", "30"])
        .args(["-f", "flv", "-flush_packets", "1", url])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .map_err(|e| of("ffmpeg (Debian, Ubuntu: apt install ffmpeg)", e))
}

/// Measures the times and gives the commands of the walk.
struct Stopwatch {
    handed: Arc<Mutex<Vec<Instant>>>,
    began: Option<Instant>,
    minutes: f64,
    pose_ms: Vec<Vec<f64>>,
    step_ms: Vec<f64>,
    words_ms: Vec<f64>,
    peak_rss_mb: Vec<Option<f64>>,
    key_frames: Vec<usize>,
    posed: Option<Instant>,
    /// The number of the last processed image.
    number: usize,
    /// The number of the first processed image.
    first: Option<usize>,
    asked: usize,
}

impl Stopwatch {
    fn new(handed: Arc<Mutex<Vec<Instant>>>, minutes: f64) -> Self {
        Self {
            handed,
            began: None,
            minutes,
            pose_ms: Vec::new(),
            step_ms: Vec::new(),
            words_ms: Vec::new(),
            peak_rss_mb: Vec::new(),
            key_frames: Vec::new(),
            posed: None,
            number: 0,
            first: None,
            asked: 0,
        }
    }
}

impl Observer for Stopwatch {
    fn on_output(&mut self, session: &Session, packet: &FramePacket, output: &Result<Output, NotTracked>) {
        let now = Instant::now();
        let began = *self.began.get_or_insert(now);
        let Ok(output) = output else { return };
        self.step_ms.push(output.timings.step_ms());
        self.posed = Some(now);
        let Some(number) = packet.images.first().and_then(|i| number_of(i)) else { return };
        let handed = self.handed.lock().unwrap_or_else(PoisonError::into_inner).get(number).copied();
        let Some(handed) = handed else { return };
        self.number = number;
        self.first.get_or_insert(number);
        let minute = (began.elapsed().as_secs_f64() / 60.0) as usize;
        if minute >= self.pose_ms.len() {
            self.pose_ms.resize_with(minute + 1, Vec::new);
            self.peak_rss_mb.resize(minute + 1, None);
            self.key_frames.resize(minute + 1, 0);
        }
        if number.is_multiple_of(RATE_HZ as usize) {
            self.peak_rss_mb[minute] = cairn_eval::process::peak_rss_mb();
            self.key_frames[minute] = session.engine().snapshot().key_frame_count();
        }
        self.pose_ms[minute].push((now - handed).as_secs_f64() * 1e3);
    }

    fn on_event(&mut self, _: &Session, event: &Event) {
        if let (Event::Said(_), Some(posed)) = (event, self.posed) {
            self.words_ms.push(posed.elapsed().as_secs_f64() * 1e3);
        }
    }

    /// Records the first outbound walk; asks for guidance at each far end; quits when the time is over.
    fn take_commands(&mut self) -> Vec<Ask> {
        if self.began.is_some_and(|t| t.elapsed().as_secs_f64() > 60.0 * self.minutes) {
            return vec![Ask::Quit];
        }
        let half = (OUT_S * RATE_HZ) as usize;
        let (round, at) = (self.number / (2 * half), self.number % (2 * half));
        match self.asked {
            0 if at > 5 => {
                self.asked = 1;
                vec![Ask::Record]
            }
            n if n == round + 1 && at >= half => {
                self.asked += 1;
                ["stop", "guide back"].into_iter().filter_map(|line| Ask::parse(line).ok()).collect()
            }
            _ => Vec::new(),
        }
    }
}

/// Time espeak-ng needs for a sentence.
fn speech() -> Option<Percentiles> {
    let espeak = Espeak::find(SpeechConfig::default()).ok()?;
    let mut ms = Vec::new();
    for _ in 0..20 {
        let begin = Instant::now();
        espeak.samples("Turn left now.").ok()?;
        ms.push(begin.elapsed().as_secs_f64() * 1e3);
    }
    Percentiles::of(&ms)
}

/// The figures as text.
pub fn table(live: &Live) -> String {
    let mut out = String::new();
    let line = |p: &Option<Percentiles>| match p {
        Some(p) => format!("p50 {:.1}, p95 {:.1}, p99 {:.1}, max {:.1} ms", p.p50, p.p95, p.p99, p.max),
        None => "no data".into(),
    };
    let _ = writeln!(
        out,
        "images    {} published, {} processed, {} dropped as outdated or older than 150 ms; {} reconnections",
        live.published, live.taken, live.dropped, live.reconnects
    );
    for (minute, ms) in live.pose_ms.iter().enumerate() {
        let memory = live.peak_rss_mb.get(minute).copied().flatten();
        let memory = memory.map_or_else(|| "unknown".into(), |mb| format!("{mb:.0} MB"));
        let key_frames = live.key_frames.get(minute).copied().unwrap_or_default();
        let _ = writeln!(
            out,
            "minute {:>2}  publisher to pose: {}; peak memory so far {memory}, {key_frames} key frames",
            minute + 1,
            line(ms)
        );
    }
    let _ = writeln!(out, "step      {}", line(&live.step_ms));
    let _ = writeln!(out, "speech    {} announcements; pose to text: {}", live.said, line(&live.words_ms));
    let _ = writeln!(out, "synthesis one sentence by espeak-ng: {}", line(&live.speech_ms));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn image_numbers_round_trip() {
        let mut image = GrayImage::new(WIDTH, HEIGHT);
        for number in [0, 1, 12_345, (1 << BITS) - 1] {
            mark(&mut image, number);
            assert_eq!(number_of(&image), Some(number));
        }
        assert_eq!(number_of(&GrayImage::new(8, 8)), None);
    }
}
