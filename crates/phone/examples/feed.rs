//! Writes a source's images and motion as a page would send them, and replays such a file natively.
//!
//! ```sh
//! cargo run --release -p cairn-phone --example feed -- record SOURCE OUT [SECONDS [COMMAND@SECONDS ...]]
//! cargo run --release -p cairn-phone --example feed -- replay IN
//! ```

use cairn_phone::{Library, Message, Phone, Setup, apply, read, write};
use cairn_sensor::{Distortion, FramePacket, Rig, Source};
use cairn_sources::{OpenOptions, open};
use std::error::Error;
use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::time::Instant;

/// Slices of mapping between two images: all that there are to do, but for closing loops (`data/phone`).
const SLICES: usize = 1000;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["record", source, out, ref rest @ ..] => record(source, out, rest),
        ["replay", from] => replay(from),
        _ => Err("record SOURCE OUT [SECONDS [COMMAND@SECONDS ...]], or replay IN".into()),
    }
}

fn record(source: &str, out: &str, rest: &[&str]) -> Result<(), Box<dyn Error>> {
    let seconds: f64 = rest.first().map_or(Ok(f64::INFINITY), |s| s.parse())?;
    let mut commands = Vec::new();
    for command in rest.iter().skip(1) {
        let (words, at) = command.rsplit_once('@').ok_or("a command is COMMAND@SECONDS")?;
        commands.push((at.parse::<f64>()?, words));
    }
    let mut source = open(source, OpenOptions::default())?;
    let mut out = BufWriter::new(File::create(out)?);
    write(&mut out, &Message::setup(&setup(&*source))?)?;
    let rig = source.rig().clone();
    let mut begin = None;
    while let Some(packet) = source.next_packet()? {
        let at = packet.stamp - *begin.get_or_insert(packet.stamp);
        if at > seconds {
            break;
        }
        while commands.first().is_some_and(|(due, _)| *due <= at) {
            write(&mut out, &Message::command(commands.remove(0).1))?;
        }
        for message in messages(&rig, &packet) {
            write(&mut out, &message)?;
        }
        for _ in 0..SLICES {
            write(&mut out, &Message::work())?;
        }
    }
    write(&mut out, &Message { kind: b'E', content: Vec::new() })?;
    Ok(out.flush()?)
}

/// The setup for a source; the lens only where the source knows it.
fn setup(source: &dyn Source) -> Setup {
    let (rig, info) = (source.rig(), source.info());
    let camera = rig.cameras[0].camera;
    let known = info.assumed.is_none();
    let distortion = match camera.distortion {
        Distortion::RadialTangential(k) if known => Some(k),
        _ => None,
    };
    Setup {
        width: camera.width,
        height: camera.height,
        rate_hz: info.rate_hz,
        pinhole: known.then_some([camera.fx, camera.fy, camera.cx, camera.cy]),
        distortion,
        motion: rig.imu.is_some(),
        phone: (!known && rig.imu.is_some()).then(|| "unknown".into()),
        library: Library { folder: "routes".into(), ..Library::default() },
    }
}

/// The image, then the motion since the one before, turned into the axes of the images.
fn messages(rig: &Rig, packet: &FramePacket) -> Vec<Message> {
    let mut all = Vec::new();
    if let Some(image) = packet.images.first() {
        all.push(Message::image(packet.stamp.seconds(), image.data()));
    }
    if let Some(imu) = &rig.imu {
        let camera_from_imu = rig.cameras[0].body_from_camera.rotation.inverse() * imu.body_from_imu.rotation;
        let readings = packet.imu.iter().map(|sample| {
            let (g, a) = (camera_from_imu * sample.gyro, camera_from_imu * sample.accel);
            [sample.stamp.seconds(), g.x, g.y, g.z, a.x, a.y, a.z]
        });
        all.push(Message::motion(&readings.collect::<Vec<_>>()));
    }
    all
}

fn replay(from: &str) -> Result<(), Box<dyn Error>> {
    let mut from = BufReader::new(File::open(from)?);
    let mut phone: Option<Phone> = None;
    let (mut images, mut slices) = (Vec::new(), Vec::new());
    while let Some(message) = read(&mut from)? {
        let began = Instant::now();
        let answer = apply(&mut phone, message.kind, &message.content);
        let ms = began.elapsed().as_secs_f64() * 1e3;
        if message.kind == Message::work().kind {
            slices.push(ms);
            continue;
        }
        if !answer.reports.is_empty() {
            images.push(ms);
        }
        println!("{}", serde_json::to_string(&answer)?);
    }
    eprintln!("{} images: {}", images.len(), summary(&mut images));
    eprintln!("{} slices of mapping: {}", slices.len(), summary(&mut slices));
    Ok(())
}

fn summary(ms: &mut [f64]) -> String {
    ms.sort_by(f64::total_cmp);
    let at = |share: f64| ms.get((share * ms.len() as f64) as usize).copied().unwrap_or(0.0);
    let all = ms.iter().sum::<f64>() / 1000.0;
    let (p50, p95, p99, longest) = (at(0.5), at(0.95), at(0.99), ms.last().copied().unwrap_or(0.0));
    format!("p50 {p50:.1} ms, p95 {p95:.1} ms, p99 {p99:.1} ms, longest {longest:.1} ms, in all {all:.1} s")
}
