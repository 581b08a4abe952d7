//! Video through the `ffmpeg` program: files in order, and a sender that disconnects and reconnects.

use cairn_sensor::Rig;
use cairn_sources::{OpenOptions, named_rig, open};
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Whether ffmpeg is installed; prints "skipped" where it is not.
fn ffmpeg() -> bool {
    let there = Command::new("ffmpeg").arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    let there = there.is_ok_and(|s| s.success());
    if !there {
        println!("skipped: ffmpeg is not installed");
    }
    there
}

fn folder() -> PathBuf {
    let folder = std::env::temp_dir().join(format!("cairn-video-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Sends images to an address until it is killed.
struct Publisher(Child);

impl Publisher {
    fn to(url: &str, size: &str) -> Self {
        let input = format!("testsrc=size={size}:rate=30");
        let coding =
            ["-c:v", "libx264", "-preset", "ultrafast", "-tune", "zerolatency", "-g", "15", "-f", "flv"];
        let child = Command::new("ffmpeg")
            .args(["-nostdin", "-loglevel", "error", "-re", "-f", "lavfi", "-i", &input])
            .args(coding)
            .arg(url)
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self(child)
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn file_delivers_every_image_at_its_time() {
    if !ffmpeg() {
        return;
    }
    let path = folder().join("walk.mp4");
    let made = Command::new("ffmpeg")
        .args(["-y", "-loglevel", "error", "-f", "lavfi", "-i", "testsrc=size=320x240:rate=25:duration=2"])
        .arg(&path)
        .status()
        .unwrap();
    assert!(made.success());
    let mut source = open(path.to_str().unwrap(), OpenOptions::default()).unwrap();
    assert_eq!(source.info().rate_hz, 25.0);
    assert_eq!(source.rig().cameras[0].camera.fx, 0.7 * 320.0);
    let mut stamps = Vec::new();
    while let Some(packet) = source.next_packet().unwrap() {
        assert_eq!((packet.images[0].width(), packet.images[0].height()), (320, 240));
        stamps.push(packet.stamp.seconds());
    }
    assert_eq!(stamps.len(), 50);
    assert!(
        stamps.iter().enumerate().all(|(k, t)| (t - stamps[0] - 0.04 * k as f64).abs() < 1e-3),
        "{stamps:?}"
    );
    // A rig of another size is refused, and so is a file that is not video.
    let options =
        OpenOptions { rig: Some(named_rig("phone-854x480").unwrap().rig), ..OpenOptions::default() };
    let error = open(path.to_str().unwrap(), options).err().unwrap().to_string();
    assert!(error.contains("320x240") && error.contains("854x480"), "{error}");
    let broken = folder().join("broken.mp4");
    std::fs::write(&broken, "no video at all").unwrap();
    let error = open(broken.to_str().unwrap(), OpenOptions::default()).err().unwrap().to_string();
    assert!(error.contains("Invalid data"), "{error}");
}

#[test]
fn a_film_that_breaks_off_is_damaged_or_turned_is_reported() {
    if !ffmpeg() {
        return;
    }
    let make = |name: &str, more: &[&str]| {
        let path = folder().join(name);
        let made =
            Command::new("ffmpeg").args(["-y", "-loglevel", "error"]).args(more).arg(&path).status().unwrap();
        assert!(made.success());
        path
    };
    let input = ["-f", "lavfi", "-i", "testsrc=size=320x240:rate=25:duration=4"];
    let whole = make("whole.mkv", &[&input[..], &["-c:v", "libx264", "-g", "10"]].concat());
    let played = |path: &std::path::Path, rig: Option<Rig>| {
        let mut source = open(path.to_str().unwrap(), OpenOptions { rig, ..OpenOptions::default() }).unwrap();
        let mut images = 0;
        while source.next_packet().unwrap().is_some() {
            images += 1;
        }
        (images, source.skipped().join("; "))
    };
    let rig = Rig::mono(cairn_sensor::Camera::guessed(320, 240));
    assert_eq!(played(&whole, Some(rig.clone())), (100, String::new()));
    let bytes = std::fs::read(&whole).unwrap();
    let cut = folder().join("cut.mkv");
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let (images, told) = played(&cut, None);
    assert!(
        (10..90).contains(&images) && told.contains("breaks off") && told.contains("prematurely"),
        "{images}: {told}"
    );
    let damaged = folder().join("damaged.mkv");
    let mut spoiled = bytes.clone();
    let middle = bytes.len() / 2;
    spoiled[middle..middle + 3000].fill(0xa5);
    std::fs::write(&damaged, spoiled).unwrap();
    let (images, told) = played(&damaged, None);
    assert!(images < 100 && told.contains("damaged"), "{images}: {told}");
    let shown = whole.to_str().unwrap();
    let turned = make("turned.mp4", &["-i", shown, "-c", "copy", "-metadata:s:v", "rotate=180"]);
    let (images, told) = played(&turned, Some(rig));
    // ffmpeg from 6 on writes no such mark by this option.
    let marked = Command::new("ffmpeg").arg("-i").arg(&turned).output().unwrap();
    if String::from_utf8_lossy(&marked.stderr).contains("rotation of") {
        assert!(images == 100 && told.contains("turned by -180 degrees"), "{images}: {told}");
        assert_eq!(played(&turned, None).1, "", "without a calibration it does not matter");
    }
}

#[test]
fn publishing_phone_may_disconnect_and_reconnect() {
    if !ffmpeg() {
        return;
    }
    let port = free_port();
    let url = format!("rtmp://127.0.0.1:{port}/cairn");
    let address = format!("rtmp-listen://127.0.0.1:{port}/cairn");
    let rig: Rig = named_rig("phone-854x480").unwrap().rig;
    let opened =
        std::thread::spawn(move || open(&address, OpenOptions { rig: Some(rig), ..OpenOptions::default() }));
    std::thread::sleep(Duration::from_millis(300));
    let publisher = Publisher::to(&url, "854x480");
    let mut source = opened.join().unwrap().unwrap();
    let mut last = source.next_packet().unwrap().unwrap().stamp;
    for _ in 0..30 {
        let packet = source.next_packet().unwrap().unwrap();
        assert!(packet.stamp > last);
        last = packet.stamp;
    }
    drop(publisher);
    std::thread::sleep(Duration::from_millis(500));
    // The phone reconnects: it tries until the listener is there again.
    let begin = Instant::now();
    let mut publisher = Publisher::to(&url, "854x480");
    let next = loop {
        if publisher.0.try_wait().unwrap().is_some() {
            publisher = Publisher::to(&url, "854x480");
        }
        let packet = source.next_packet().unwrap().unwrap();
        // A busy machine causes gaps of its own: the source reports when it is back.
        if source.skipped().iter().any(|line| line.contains("is back")) {
            break packet.stamp;
        }
        last = packet.stamp;
        assert!(begin.elapsed() < Duration::from_secs(20));
    };
    assert!(next > last);
    let lines = source.skipped().join("\n");
    assert!(lines.contains("is lost") && lines.contains("is back"), "{lines}");
}

#[test]
fn a_sender_that_tries_once_is_taken_after_strays_and_beside_silent_ones() {
    if !ffmpeg() {
        return;
    }
    use std::io::Write;
    let port = free_port();
    let url = format!("rtmp://127.0.0.1:{port}/cairn");
    let address = format!("rtmp-listen://127.0.0.1:{port}/cairn");
    let opened = std::thread::spawn(move || open(&address, OpenOptions::default()));
    let connect = || {
        let began = Instant::now();
        loop {
            match std::net::TcpStream::connect(("127.0.0.1", port)) {
                Ok(stream) => break stream,
                Err(e) => assert!(began.elapsed() < Duration::from_secs(5), "{e}"),
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    for bytes in [&b"x"[..], b"GET / HTTP/1.1\r\n\r\n", &[0x77; 4000], b"\x16\x03\x01\x02\x00\x01", b""] {
        connect().write_all(bytes).unwrap();
    }
    let silent: Vec<_> = (0..5).map(|_| connect()).collect();
    // It connects once, at once, and does not try again.
    let mut publisher = Publisher::to(&url, "320x240");
    let mut source = opened.join().unwrap().unwrap();
    for _ in 0..30 {
        assert!(source.next_packet().unwrap().is_some());
    }
    assert!(publisher.0.try_wait().unwrap().is_none(), "the sender was refused");
    let refusals = source.skipped().iter().filter(|line| line.contains("was refused")).count();
    assert_eq!(refusals, 1, "{:?}", source.skipped());
    drop(silent);
}

/// The publisher's own start, until it has coded its first image.
fn start_of_a_publisher() -> Duration {
    let began = Instant::now();
    let made = Command::new("ffmpeg")
        .args([
            "-nostdin",
            "-loglevel",
            "error",
            "-f",
            "lavfi",
            "-i",
            "testsrc=size=640x480:rate=30",
            "-c:v",
            "libx264",
        ])
        .args(["-preset", "ultrafast", "-tune", "zerolatency", "-frames:v", "1", "-f", "null", "-"])
        .stdin(Stdio::null())
        .status();
    assert!(made.unwrap().success());
    began.elapsed()
}

#[test]
fn first_image_comes_within_two_seconds_of_publishing_also_after_a_reconnect() {
    if !ffmpeg() {
        return;
    }
    let port = free_port();
    let url = format!("rtmp://127.0.0.1:{port}/cairn");
    let address = format!("rtmp-listen://127.0.0.1:{port}/cairn");
    let start = start_of_a_publisher();
    let opened = std::thread::spawn(move || open(&address, OpenOptions::default()));
    std::thread::sleep(Duration::from_millis(500));
    let began = Instant::now();
    let publisher = Publisher::to(&url, "640x480");
    let mut source = opened.join().unwrap().unwrap();
    let mut last = source.next_packet().unwrap().unwrap().stamp;
    let first = began.elapsed().saturating_sub(start);
    println!("first image {first:?} after publishing, its publisher took {start:?} to start");
    assert!(first < Duration::from_secs(2), "{first:?}");
    drop(publisher);
    std::thread::sleep(Duration::from_millis(1500));
    let live = source.live().unwrap();
    assert!(live.clock().unwrap().oldest_s(last) > 0.5, "nothing came for a second and a half");
    let began = Instant::now();
    let _publisher = Publisher::to(&url, "640x480");
    // What was under way from the first one may come before.
    while !source.skipped().iter().any(|line| line.contains("is back")) {
        last = source.next_packet().unwrap().unwrap().stamp;
    }
    let again = began.elapsed().saturating_sub(start);
    println!("after the reconnect {again:?}");
    assert!(again < Duration::from_secs(2), "{again:?}");
    assert!(live.clock().unwrap().oldest_s(last) < 1.0);
}
