//! The `ffmpeg` child process: gray images from its standard output, their times from the log of its
//! `showinfo` filter.
//!
//! The pipe carries YUV4MPEG2 (<https://wiki.multimedia.cx/index.php/YUV4MPEG2>): a line with the size, then
//! `FRAME` and the rows. That format has no times; `showinfo` prints each on standard error, in the same
//! order.

use super::address::Address;
use cairn_sensor::{GrayImage, SourceError};
use std::collections::VecDeque;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Longest supported image side, pixels.
const MAX_SIDE: usize = 16_384;
/// How long an image waits for its time, which was sent before it.
const TIME_TIMEOUT: Duration = Duration::from_millis(100);
/// Error lines of the child that are kept.
const MAX_ERROR_LINES: usize = 8;

/// Message when a sender published another stream name than ours.
pub(super) const WRONG_NAME: &str = "a sender with another stream name was refused";

/// The command to start.
#[derive(Clone, Debug)]
pub(super) struct ChildCommand {
    program: OsString,
    arguments: Vec<OsString>,
    /// The stream name that senders must publish, where we listen.
    name: Option<String>,
}

impl ChildCommand {
    /// `ffmpeg` for an address; `more` are arguments before the output.
    pub fn ffmpeg(address: &Address, more: &[OsString]) -> Self {
        let mut arguments: Vec<OsString> =
            ["-nostdin", "-hide_banner", "-nostats", "-loglevel", "info"].map(OsString::from).into();
        if address.live {
            let low = ["-fflags", "nobuffer", "-flags", "low_delay", "-analyzeduration", "0"];
            arguments.extend(low.map(OsString::from));
            // The first picture comes when this much was read and no rate was measured: by default 5 MB, some seconds.
            arguments.extend(["-probesize", "16384", "-fpsprobesize", "0"].map(OsString::from));
            // One thread: with several, each would delay by one image.
            arguments.extend(["-threads", "1"].map(OsString::from));
        }
        arguments.extend(address.before.iter().cloned());
        arguments.extend([OsString::from("-i"), address.input.clone()]);
        arguments.extend(more.iter().cloned());
        let out = ["-map", "0:v:0", "-an", "-vf", "format=gray,showinfo=checksum=0"];
        arguments.extend(out.map(OsString::from));
        let form = ["-fps_mode", "passthrough", "-strict", "-1", "-f", "yuv4mpegpipe", "pipe:1"];
        arguments.extend(form.map(OsString::from));
        Self { program: "ffmpeg".into(), arguments, name: address.name.clone() }
    }

    /// Any shell script with the same output, for tests.
    #[cfg(test)]
    pub fn shell(script: &str) -> Self {
        Self { program: "sh".into(), arguments: vec!["-c".into(), script.into()], name: None }
    }

    /// The same, listening for a stream name.
    #[cfg(test)]
    pub fn named(self, name: &str) -> Self {
        Self { name: Some(name.into()), ..self }
    }
}

/// A running child that can be stopped from another thread.
#[derive(Clone, Default)]
pub(super) struct Handle(Arc<Mutex<Option<Child>>>);

impl Handle {
    /// Stops the child, if there is one; its pipes close.
    pub fn end(&self) {
        if let Some(mut child) = self.0.lock().unwrap_or_else(PoisonError::into_inner).take() {
            // It may have ended already.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// The images of one run of the child.
pub(super) struct Feed {
    handle: Handle,
    output: BufReader<ChildStdout>,
    times: Receiver<f64>,
    said: Arc<Mutex<Said>>,
}

/// What the child said in its log.
#[derive(Default)]
pub(super) struct Said {
    /// The last errors, and how many there were.
    errors: VecDeque<String>,
    pub count: usize,
    /// By how many degrees the file says that its pictures are to be turned; they are.
    pub turned_deg: Option<f64>,
}

impl Said {
    /// The last error.
    pub fn error(&self) -> Option<&str> {
        self.errors.back().map(String::as_str)
    }
}

impl Feed {
    /// Starts the child; from now on it can be stopped by `handle`.
    pub fn start(command: &ChildCommand, handle: &Handle) -> Result<Self, SourceError> {
        let program = command.program.to_string_lossy().into_owned();
        let mut child = Command::new(&command.program)
            .args(&command.arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| match e.kind() {
                ErrorKind::NotFound => SourceError::new(
                    program.clone(),
                    "is not installed; Cairn needs it to open video",
                    "install it (Debian, Ubuntu: apt install ffmpeg)",
                ),
                _ => SourceError::new(program.clone(), e.to_string(), "check that it can be started"),
            })?;
        let (Some(out), Some(err)) = (child.stdout.take(), child.stderr.take()) else {
            return Err(SourceError::new(program, "could not be connected by pipes", "try again"));
        };
        let (times_to, times) = channel();
        let said = Arc::new(Mutex::new(Said::default()));
        let lines = said.clone();
        *handle.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(child);
        let (name, stopper) = (command.name.clone(), handle.clone());
        std::thread::Builder::new()
            .name("cairn-video-log".into())
            .spawn(move || {
                if listen(err, &times_to, &lines, name.as_deref()) {
                    stopper.end();
                }
            })
            .map_err(|e| {
                handle.end();
                SourceError::new(program, format!("no thread for its log ({e})"), "close other programs")
            })?;
        Ok(Self { handle: handle.clone(), output: BufReader::with_capacity(1 << 16, out), times, said })
    }

    /// Reads the header of the stream: width, height, images per second. `None` when the stream ended before
    /// it.
    pub fn header(&mut self) -> Option<([usize; 2], f64)> {
        let mut line = Vec::new();
        // A header is short; longer data is not one.
        self.output.by_ref().take(4096).read_until(b'\n', &mut line).ok()?;
        parse_header(std::str::from_utf8(&line).ok()?)
    }

    /// The next image and its time in seconds where that is known; `None` at the end.
    pub fn next_image(&mut self, [width, height]: [usize; 2]) -> Option<(GrayImage, Option<f64>)> {
        let mut line = Vec::new();
        self.output.by_ref().take(4096).read_until(b'\n', &mut line).ok()?;
        if !line.starts_with(b"FRAME") {
            return None;
        }
        let mut data = vec![0; width * height];
        self.output.read_exact(&mut data).ok()?;
        let time = self.times.recv_timeout(TIME_TIMEOUT).ok();
        GrayImage::from_vec(width, height, data).map(|image| (image, time))
    }

    /// Stops the child and returns its last error message.
    pub fn end(self) -> String {
        self.said().error().unwrap_or("the stream ended").into()
    }

    /// Stops the child and returns what it has said.
    pub fn said(self) -> Said {
        // Give it time to print its last messages when it is ending by itself.
        std::thread::sleep(Duration::from_millis(50));
        self.handle.end();
        std::mem::take(&mut *self.said.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Reads the child's log: times of images, and the last errors. True when it must be stopped, because the
/// sender publishes another stream name than the one we listen for.
fn listen(log: ChildStderr, times_to: &Sender<f64>, said: &Mutex<Said>, name: Option<&str>) -> bool {
    let said = || said.lock().unwrap_or_else(PoisonError::into_inner);
    let keep = |text: &str| {
        let mut said = said();
        said.count += 1;
        said.errors.push_back(text.to_owned());
        while said.errors.len() > MAX_ERROR_LINES {
            said.errors.pop_front();
        }
    };
    let mut log = BufReader::new(log);
    let mut line = Vec::new();
    loop {
        line.clear();
        match log.by_ref().take(1 << 16).read_until(b'\n', &mut line) {
            Ok(n) if n > 0 => {}
            _ => return false,
        }
        let text = String::from_utf8_lossy(&line);
        let text = text.trim();
        if text.contains("showinfo") {
            if let Some(time) = parse_time(text) {
                let _ = times_to.send(time);
            }
        } else if name.is_some_and(|name| has_wrong_name(text, name)) {
            keep(WRONG_NAME);
            return true;
        } else if let Some(turned) = parse_turn(text) {
            // The first is that of the file, a later one that of what comes out.
            said().turned_deg.get_or_insert(turned);
        } else if is_error(text) {
            keep(text);
        }
    }
}

/// ffmpeg's listener accepts any sender and reports in its log that the name was another. Of `APP/KEY` both
/// are compared; for `APP` alone it always reports a missing key.
fn has_wrong_name(line: &str, name: &str) -> bool {
    if line.contains("App field don't match up") {
        return true;
    }
    let Some((_, report)) = line.split_once("Unexpected stream ") else { return false };
    report.split_once(", expecting").is_some_and(|(sent, _)| !sent.is_empty() || name.contains('/'))
}

fn is_error(line: &str) -> bool {
    const SIGNS: [&str; 10] = [
        "rror",
        "ailed",
        "nvalid",
        "No such",
        "refused",
        "imed out",
        "not found",
        "denied",
        "in use",
        "prematurely",
    ];
    SIGNS.iter().any(|s| line.contains(s))
}

/// `displaymatrix: rotation of -90.00 degrees`.
fn parse_turn(line: &str) -> Option<f64> {
    line.split_once("rotation of ")?.1.strip_suffix(" degrees")?.parse().ok()
}

/// `pts_time:1.25` of a line of showinfo.
fn parse_time(line: &str) -> Option<f64> {
    let rest = line.split("pts_time:").nth(1)?.trim_start();
    let time: f64 = rest.split_whitespace().next()?.parse().ok()?;
    time.is_finite().then_some(time)
}

/// `YUV4MPEG2 W640 H480 F30:1 ...`
fn parse_header(line: &str) -> Option<([usize; 2], f64)> {
    let mut parts = line.split_whitespace();
    if parts.next() != Some("YUV4MPEG2") {
        return None;
    }
    let (mut width, mut height, mut rate) = (0, 0, 0.0);
    for part in parts {
        match part.split_at_checked(1)? {
            ("W", n) => width = n.parse().ok()?,
            ("H", n) => height = n.parse().ok()?,
            ("F", ratio) => {
                let (over, under) = ratio.split_once(':')?;
                let (over, under): (f64, f64) = (over.parse().ok()?, under.parse().ok()?);
                rate = over / under;
            }
            ("C", kind) if !kind.starts_with("mono") => return None,
            _ => {}
        }
    }
    let sides = 16..=MAX_SIDE;
    // Streams of unknown rate report arbitrary numbers.
    let rate = if (1.0..=240.0).contains(&rate) { rate } else { 30.0 };
    (sides.contains(&width) && sides.contains(&height)).then_some(([width, height], rate))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_and_times_are_parsed() {
        let header = "YUV4MPEG2 W854 H480 F30000:1001 Ip A1:1 Cmono XYSCSS=MONO\n";
        let ([w, h], rate) = parse_header(header).unwrap();
        assert_eq!([w, h], [854, 480]);
        assert!((rate - 29.97).abs() < 0.01);
        assert_eq!(parse_header("YUV4MPEG2 W64 H48 F1000:1\n").unwrap().1, 30.0);
        for wrong in
            ["", "RIFF", "YUV4MPEG2 W0 H48 F30:1", "YUV4MPEG2 W64 H48 F30", "YUV4MPEG2 W64 H48 C420jpeg"]
        {
            assert!(parse_header(wrong).is_none(), "{wrong}");
        }
        let line = "[Parsed_showinfo_1 @ 0x5] n:   3 pts:   3000 pts_time:0.1     duration:  1000 fmt:gray";
        assert_eq!(parse_time(line), Some(0.1));
        assert_eq!(parse_time("pts_time:NOPTS"), None);
    }

    #[test]
    fn missing_program_says_what_to_install() {
        let command =
            ChildCommand { program: "no-such-program-of-cairn".into(), arguments: Vec::new(), name: None };
        let error = Feed::start(&command, &Handle::default()).err().unwrap().to_string();
        assert!(error.contains("is not installed") && error.contains("apt install ffmpeg"), "{error}");
    }

    #[test]
    fn images_have_times_and_errors_are_kept() {
        let script = r#"
            echo 'YUV4MPEG2 W16 H16 F25:1 Cmono'
            for t in 0.5 0.75; do
                echo "[Parsed_showinfo_1 @ 0x5] n: 0 pts: 1 pts_time:$t x" >&2
                echo FRAME; head -c 256 /dev/zero
            done
            echo 'Connection refused' >&2"#;
        let mut feed = Feed::start(&ChildCommand::shell(script), &Handle::default()).unwrap();
        let (size, rate) = feed.header().unwrap();
        assert_eq!((size, rate), ([16, 16], 25.0));
        assert_eq!(feed.next_image(size).unwrap().1, Some(0.5));
        assert_eq!(feed.next_image(size).unwrap().1, Some(0.75));
        assert!(feed.next_image(size).is_none());
        assert_eq!(feed.end(), "Connection refused");
    }

    #[test]
    fn sender_with_another_name_is_refused() {
        // As ffmpeg 5.1 prints it, for APP, for APP/KEY, and for the right name without a key.
        let app = "[rtmp @ 0x55a320b59180] App field don't match up: other <-> cairn";
        let key = "[rtmp @ 0x555b334c4180] Unexpected stream wrong, expecting secret";
        let none = "[rtmp @ 0x561e9ede1180] Unexpected stream , expecting cairn";
        assert!(
            has_wrong_name(app, "cairn")
                && has_wrong_name(key, "live/secret")
                && has_wrong_name(none, "live/secret")
        );
        assert!(
            !has_wrong_name(none, "cairn")
                && !has_wrong_name("Input #0, flv, from 'rtmp://h/cairn':", "cairn")
        );
        let command = ChildCommand::shell(&format!("echo \"{app}\" >&2; exec sleep 20")).named("cairn");
        let started = std::time::Instant::now();
        let mut feed = Feed::start(&command, &Handle::default()).unwrap();
        assert!(feed.header().is_none() && started.elapsed() < Duration::from_secs(10));
        assert_eq!(feed.end(), WRONG_NAME);
    }
}
