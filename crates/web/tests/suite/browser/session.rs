//! What the tests share: a walk before the camera of a browser, a server, and what the page is asked.

use crate::browser::cdp::{Browser, Tab};
use crate::walked::{self, RATE_HZ, camera};
use cairn_engine::SensorMode;
use cairn_sensor::{FramePacket, Source};
use cairn_sim::{SimConfig, SimSource};
use cairn_sources::Paced;
use cairn_web::{CameraSource, ServeConfig, Server};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Seconds of the walk before the camera starts, and of the way out, with a corner in its middle.
const START_S: f64 = 8.5;
pub const OUT_S: f64 = 16.0;

/// The images of the way out.
pub fn route_out() -> Vec<FramePacket> {
    walked::route_out(START_S, OUT_S)
}

/// The way out, then the same in reverse: the view of a camera facing back on the way home. The file is played in a
/// loop, and its end matches its beginning.
fn write_video(path: &Path, out: &[FramePacket]) {
    let (w, h) = (camera().width, camera().height);
    let mut file = BufWriter::new(std::fs::File::create(path).unwrap());
    writeln!(file, "YUV4MPEG2 W{w} H{h} F{RATE_HZ}:1 Ip A1:1 C420jpeg").unwrap();
    let colourless = vec![128; w * h / 2];
    for packet in out.iter().chain(out.iter().rev()) {
        file.write_all(b"FRAME\n").unwrap();
        file.write_all(packet.images[0].data()).unwrap();
        file.write_all(&colourless).unwrap();
    }
    file.flush().unwrap();
}

/// An empty folder of this name for what a test writes.
pub fn emptied(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// A folder of this name, and a browser whose camera shows these frames; `None`, and "skipped" is said, without Chromium.
pub fn started(name: &str, frames: &[FramePacket]) -> Option<(PathBuf, Browser)> {
    let folder = emptied(name);
    let video = folder.join("walk.y4m");
    write_video(&video, frames);
    let browser = Browser::start(&folder, &video);
    if browser.is_none() {
        println!("skipped: Chromium is not installed (Debian: apt install chromium)");
    }
    Some((folder, browser?))
}

/// Pictures of a page in both schemes: `NAME-light.png` and `NAME-dark.png`.
pub fn pictures(browser: &mut Browser, tab: &Tab, name: &Path) {
    for scheme in ["dark", "light"] {
        browser.scheme(tab, scheme);
        browser.picture(tab, Path::new(&format!("{}-{scheme}.png", name.display())));
    }
}

/// A walk through the building, played in real time: its lengths are metres.
pub fn building() -> CameraSource {
    let open = || {
        let config = SimConfig::parse("sim:demo?sensor=rgbd&rate=10&resolution=480x360")?;
        let source: Box<dyn Source> = Box::new(Paced::new(Box::new(SimSource::new(&config)?)));
        Ok((source, SensorMode::Rgbd, false))
    };
    CameraSource::Source { name: "sim:demo".into(), open: Box::new(open) }
}

pub fn keeping(folder: &Path) -> Server {
    Server::start(ServeConfig { routes: Some(folder.to_owned()), ..ServeConfig::new(building()) }).unwrap()
}

/// The main button ignores a press within half a second after its meaning changed.
pub fn settle() {
    std::thread::sleep(Duration::from_millis(600));
}

/// Waits until an element's text contains some words.
pub fn wait(browser: &mut Browser, tab: &Tab, words: &str, element: &str, seconds: f64) {
    let begin = Instant::now();
    loop {
        let text = browser.text(tab, element);
        if text.contains(words) {
            return;
        }
        let waited = begin.elapsed().as_secs_f64();
        assert!(
            waited < seconds,
            "{element} does not say \"{words}\" after {waited:.0} s but \"{text}\"; log:\n{}\n{}",
            browser.text(tab, "#log"),
            browser.text(tab, "#state")
        );
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Asserts that axe-core reports nothing.
pub fn accessible(browser: &mut Browser, tab: &Tab, when: &str) {
    let Some(axe) = std::env::var_os("AXE_JS").and_then(|p| std::fs::read_to_string(p).ok()) else {
        println!("skipped: axe-core is not there (AXE_JS), accessibility {when} is not checked");
        return;
    };
    let found = browser.axe(tab, &axe);
    assert_eq!(found, "[]", "axe-core {when}");
    println!("axe-core finds nothing {when}");
}
