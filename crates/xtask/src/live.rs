//! How long a live picture takes: published by `ffmpeg` over RTMP to the listener, through the engine, to words.
//!
//! Each picture carries its number as a row of dark and light blocks at its lower edge, so that the time from the moment
//! it was handed to the publisher to the moment its pose is known needs no clock but this process's own. The walk goes
//! out, and home with the camera looking back, again and again.

use cairn_engine::{Config, Engine, Output, Runner, SensorMode};
use cairn_eval::Percentiles;
use cairn_sensor::{Camera, FramePacket, GrayImage, Rig, Stamp};
use cairn_session::{Command as Ask, Event, Face, Inbox, Script, Session, SessionConfig, drive_live, feed};
use cairn_sim::{LiveRig, SimConfig, SimSensor, WorldKind};
use cairn_sources::{OpenOptions, open};
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
/// Seconds of the way out.
const OUT_S: f64 = 12.0;
/// Bits of a picture's number, and pixels of a block.
const BITS: usize = 20;
const BLOCK: usize = 16;

/// What was measured.
#[derive(Debug, Serialize)]
pub struct Live {
    /// Pictures handed to the publisher.
    pub published: usize,
    /// How often the stream was lost and made again.
    pub reconnects: usize,
    /// Pictures that reached the engine.
    pub taken: usize,
    /// Pictures between the first and the last taken that did not reach the engine: overtaken, or older than 150 ms.
    pub dropped: usize,
    /// Milliseconds from the publisher to the pose, minute by minute.
    pub pose_ms: Vec<Option<Percentiles>>,
    /// Milliseconds of the step alone.
    pub step_ms: Option<Percentiles>,
    /// Milliseconds from a pose to the words it brought, as text.
    pub words_ms: Option<Percentiles>,
    /// Milliseconds that espeak-ng takes to make a sentence, where it is installed.
    pub speech_ms: Option<Percentiles>,
    /// Words said.
    pub said: usize,
    /// Peak memory of this process so far, minute by minute, with the rendered walk in it.
    pub peak_rss_mb: Vec<Option<f64>>,
    /// Key frames of the map, minute by minute.
    pub key_frames: Vec<usize>,
}

/// Measures for some minutes.
///
/// # Errors
/// When ffmpeg is missing, or nothing arrives.
pub fn run(minutes: f64) -> Result<Live, String> {
    let pictures = Arc::new(render()?);
    let port = TcpListener::bind("127.0.0.1:0")
        .and_then(|l| l.local_addr())
        .map_err(|e| format!("no free port: {e}"))?
        .port();
    let place = format!("127.0.0.1:{port}/cairn");
    let handed = Arc::new(Mutex::new(Vec::new()));
    let over = Arc::new(AtomicBool::new(false));
    let publisher = {
        let (pictures, handed, over, url) =
            (pictures.clone(), handed.clone(), over.clone(), format!("rtmp://{place}"));
        std::thread::spawn(move || publish(&pictures, &url, &handed, &over))
    };
    let rig = Rig::mono(camera());
    let options = OpenOptions { rig: Some(rig.clone()), ..OpenOptions::default() };
    let source = open(&format!("rtmp-listen://{place}"), options).map_err(|e| e.to_string())?;
    let engine = Engine::new(&rig, SensorMode::Mono, RATE_HZ, Runner::Threaded, &Config::default())
        .map_err(|e| e.to_string())?;
    let folder = std::env::temp_dir().join(format!("cairn-live-{}", std::process::id()));
    let mut session =
        Session::new(engine, SessionConfig { folder: folder.clone(), ..SessionConfig::default() });
    let inbox = Inbox::new();
    feed(source, inbox.clone()).map_err(|e| e.to_string())?;
    let mut stopwatch = Stopwatch::new(handed.clone(), minutes);
    let driven = drive_live(&mut session, &inbox, &mut Script::default(), &mut stopwatch);
    inbox.close();
    over.store(true, Ordering::Relaxed);
    let published = publisher.join().map_err(|_| "the publisher failed".to_owned())?;
    let _ = std::fs::remove_dir_all(folder);
    driven.map_err(|e| e.to_string())?;
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

/// Out, and the same backwards.
fn render() -> Result<Vec<GrayImage>, String> {
    let config = SimConfig {
        sensor: SimSensor::Mono,
        imu: None,
        camera: camera(),
        rate_hz: RATE_HZ,
        ..SimConfig::new(WorldKind::Demo, 3)
    };
    let mut rig = LiveRig::new(&config).map_err(|e| e.to_string())?;
    let route = rig.world().routes().first().map(|w| w.points.clone()).unwrap_or_default();
    let motion = config.walker.motion(&route);
    let mut pictures = Vec::new();
    for k in 0..(OUT_S * RATE_HZ) as usize {
        let t = k as f64 / RATE_HZ;
        let packet = rig.packet(Stamp::from_seconds(t), &motion.pose(t)).map_err(|e| e.to_string())?;
        let image = packet.images.first().ok_or("the world gave no picture")?;
        pictures.push(image.as_ref().clone());
    }
    let home: Vec<GrayImage> = pictures.iter().rev().cloned().collect();
    pictures.extend(home);
    Ok(pictures)
}

/// Writes a number into the lower edge.
fn mark(image: &mut GrayImage, number: usize) {
    for y in HEIGHT - BLOCK..HEIGHT {
        let row = image.row_mut(y);
        for bit in 0..BITS {
            let value = if number >> bit & 1 == 1 { 255 } else { 0 };
            row[bit * BLOCK..(bit + 1) * BLOCK].fill(value);
        }
    }
}

/// Reads it.
fn number_of(image: &GrayImage) -> Option<usize> {
    if (image.width(), image.height()) != (WIDTH, HEIGHT) {
        return None;
    }
    let row = image.row(HEIGHT - BLOCK / 2);
    Some((0..BITS).filter(|bit| row[bit * BLOCK + BLOCK / 2] > 127).map(|bit| 1 << bit).sum())
}

/// Hands pictures to ffmpeg, 30 a second, and writes down when; gives how often it had to be started again.
fn publish(
    pictures: &[GrayImage],
    url: &str,
    handed: &Mutex<Vec<Instant>>,
    over: &AtomicBool,
) -> Result<usize, String> {
    let mut again = 0;
    // The listener needs a moment.
    std::thread::sleep(Duration::from_millis(800));
    let mut child = publisher(url)?;
    let began = Instant::now();
    for number in 0.. {
        let due = began + Duration::from_secs_f64(number as f64 / RATE_HZ);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        if over.load(Ordering::Relaxed) {
            break;
        }
        let mut image = pictures[number % pictures.len()].clone();
        mark(&mut image, number);
        handed.lock().unwrap_or_else(PoisonError::into_inner).push(Instant::now());
        let wrote = child.stdin.as_mut().map(|pipe| pipe.write_all(image.data()));
        if !matches!(wrote, Some(Ok(()))) {
            // The listener has hung up, as after a silence: like a phone, publish again.
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

fn publisher(url: &str) -> Result<Child, String> {
    let size = format!("{WIDTH}x{HEIGHT}");
    Command::new("ffmpeg")
        .args(["-loglevel", "error", "-fflags", "nobuffer", "-f", "rawvideo", "-pix_fmt", "gray"])
        .args(["-video_size", &size, "-framerate", "30", "-i", "pipe:0", "-pix_fmt", "yuv420p"])
        .args(["-c:v", "libx264", "-preset", "ultrafast", "-tune", "zerolatency", "-g", "30"])
        .args(["-f", "flv", "-flush_packets", "1", url])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .map_err(|e| format!("ffmpeg: {e}; install it (Debian, Ubuntu: apt install ffmpeg)"))
}

/// Holds the clock, and asks for the walk's commands.
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
    /// The number of the picture that was seen last.
    number: usize,
    /// And first.
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

impl Face for Stopwatch {
    fn saw(&mut self, session: &Session, packet: &FramePacket, output: &Result<Output, String>) {
        let now = Instant::now();
        let began = *self.began.get_or_insert(now);
        let Ok(output) = output else { return };
        self.step_ms.push(output.extract_ms + output.track_ms);
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

    fn heard(&mut self, _: &Session, event: &Event) {
        if let (Event::Said(_), Some(posed)) = (event, self.posed) {
            self.words_ms.push(posed.elapsed().as_secs_f64() * 1e3);
        }
    }

    /// Records the first way out; at each far end asks for guidance; ends when the time is over.
    fn asked(&mut self) -> Vec<Ask> {
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
                Ask::parse("guide back").into_iter().collect()
            }
            _ => Vec::new(),
        }
    }
}

/// How long espeak-ng takes for a sentence.
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

/// For people.
pub fn table(live: &Live) -> String {
    let mut out = String::new();
    let line = |p: &Option<Percentiles>| match p {
        Some(p) => format!("p50 {:.1}, p95 {:.1}, p99 {:.1}, max {:.1} ms", p.p50, p.p95, p.p99, p.max),
        None => "nothing".into(),
    };
    let _ = writeln!(
        out,
        "pictures  {} published, {} taken, {} dropped as overtaken or older than 150 ms; {} reconnections",
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
    let _ = writeln!(out, "words     {} said; pose to text: {}", live.said, line(&live.words_ms));
    let _ = writeln!(out, "speech    a sentence by espeak-ng: {}", line(&live.speech_ms));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_back() {
        let mut image = GrayImage::new(WIDTH, HEIGHT);
        for number in [0, 1, 12_345, (1 << BITS) - 1] {
            mark(&mut image, number);
            assert_eq!(number_of(&image), Some(number));
        }
        assert_eq!(number_of(&GrayImage::new(8, 8)), None);
    }
}
