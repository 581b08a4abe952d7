//! Cameras of the kernel, simulated: frames of a recording through the code that reads real devices.

#![cfg(all(target_os = "linux", target_pointer_width = "64"))]

use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, DepthSensor, FramePacket, ImuNoise, ImuSensor, Rig, RigCamera, Source};
use cairn_sources::OpenOptions;
use cairn_sources::camera::{
    CameraAddress, CameraSource, Mode, MotionFound, MotionKind, PixelFormat, REPLAYED_SERIAL, Simulated,
    SimulatedMotion, SimulatedVideo, Trouble, VideoFound,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Frames of a folder of the recordings; `None` without it, which is said.
fn recording(name: &str, frames: usize) -> Option<(Rig, Vec<FramePacket>)> {
    let folder = data(name)?;
    let options = OpenOptions { frames: Some(frames), ..Default::default() };
    let mut source = cairn_sources::open(folder.to_str().unwrap(), options).unwrap();
    let packets = std::iter::from_fn(|| source.next_packet().unwrap()).collect();
    Some((source.rig().clone(), packets))
}

/// A folder of the recordings.
fn data(name: &str) -> Option<PathBuf> {
    let root =
        std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from("../../../shared/data"), PathBuf::from);
    let folder = root.join(name);
    if !folder.is_dir() {
        println!("skipped: {} is missing", folder.display());
    }
    folder.is_dir().then_some(folder)
}

/// The same of the kitchen.
fn kitchen(frames: usize) -> Option<(Rig, Vec<FramePacket>)> {
    recording("7scenes-kitchen", frames)
}

fn node(n: usize) -> PathBuf {
    PathBuf::from(format!("/dev/video{n}"))
}

fn mode(format: PixelFormat, [width, height]: [usize; 2], rate_hz: f64) -> Mode {
    Mode { format, width, height, stride: 0, rate_hz }
}

/// A gray image as a driver delivers it in YUYV.
fn yuyv(gray: &[u8]) -> Vec<u8> {
    gray.iter().flat_map(|y| [*y, 128]).collect()
}

fn webcam(frames: Vec<Vec<u8>>) -> SimulatedVideo {
    SimulatedVideo {
        found: VideoFound { node: node(0), name: "Webcam".into(), usb: None },
        modes: vec![mode(PixelFormat::YUYV, [640, 480], 30.0), mode(PixelFormat::YUYV, [320, 240], 30.0)],
        frames: Arc::new(move |k, mode| {
            (mode.width == 640)
                .then(|| yuyv(&frames[k as usize % frames.len()]))
                .or_else(|| Some(vec![0; 320 * 240 * 2]))
        }),
        phase_s: 0.0,
    }
}

fn open(machine: &Simulated, address: &str, rig: Option<Rig>) -> Result<CameraSource, String> {
    let options = OpenOptions { rig, ..Default::default() };
    let address = CameraAddress::of(address).unwrap().map_err(|e| e.to_string())?;
    CameraSource::open(Arc::new(machine.clone()), &address, &options).map_err(|e| e.to_string())
}

fn next(source: &mut CameraSource) -> FramePacket {
    source.next_packet().unwrap().unwrap()
}

#[test]
fn a_webcam_delivers_the_frames_as_they_were() {
    let Some((_, packets)) = kitchen(5) else { return };
    let gray: Vec<Vec<u8>> = packets.iter().map(|p| p.images[0].data().to_vec()).collect();
    let machine = Simulated::new();
    machine.add_video(webcam(gray.clone()));
    let mut source = open(&machine, "v4l2:/dev/video0", None).unwrap();
    assert!(source.info().assumed.as_ref().unwrap().contains("focal length"));
    assert!(source.info().name.contains("YUYV 640x480 at 30 Hz"), "{}", source.info().name);
    let live = source.live().unwrap();
    let mut last = None;
    for _ in 0..20 {
        let p = next(&mut source);
        assert!(gray.iter().any(|g| g == p.images[0].data()), "a frame that nobody sent");
        assert!(p.depth.is_none() && p.imu.is_empty());
        let age = live.clock().unwrap().now - p.stamp;
        assert!((0.0..0.1).contains(&age), "age {age}");
        assert!(last.is_none_or(|l| p.stamp > l));
        last = Some(p.stamp);
    }
    assert!(source.live().unwrap().trouble().is_none());
}

#[test]
fn what_cannot_be_opened_is_told_in_words() {
    let machine = Simulated::new();
    let mut camera = webcam(vec![vec![0; 640 * 480]]);
    machine.add_video(camera.clone());
    let rig = |w, h| Some(Rig::mono(Camera::pinhole(w, h, 600.0, 600.0, 0.5 * w as f64, 0.5 * h as f64)));
    let why = |address: &str, rig| open(&machine, address, rig).err().unwrap();
    let error = why("v4l2:/dev/video0", rig(800, 600));
    assert!(error.contains("has no images of 800x600") && error.contains("320x240, 640x480"), "{error}");
    let error = why("v4l2:/dev/video0?size=320x240", rig(640, 480));
    assert!(error.contains("320x240") && error.contains("640x480"), "{error}");
    assert!(why("v4l2:/dev/video7", None).contains("is not there"));
    assert!(why("realsense:", None).contains("rs-enumerate-devices -c"));
    assert!(why("realsense:", rig(640, 480)).contains("no RealSense is among"));
    machine.refuse(&node(0), Some(Trouble::Busy));
    assert!(why("v4l2:/dev/video0", None).contains("close the program"));
    machine.refuse(&node(0), Some(Trouble::Denied));
    assert!(why("v4l2:/dev/video0", None).contains("usermod -aG video"));
    // A camera that is there and says nothing.
    camera.found.node = node(3);
    camera.frames = Arc::new(|_, _| None);
    machine.add_video(camera);
    assert!(why("v4l2:3", None).contains("sent nothing within 5 s: The camera sends nothing."));
}

#[test]
fn frames_that_nobody_takes_give_way_to_newer_ones() {
    let machine = Simulated::new();
    machine.add_video(webcam(vec![vec![9; 640 * 480]]));
    let mut source = open(&machine, "v4l2:0", None).unwrap();
    let live = source.live().unwrap();
    next(&mut source);
    let since_s = machine.seconds();
    std::thread::sleep(Duration::from_millis(700));
    let late = next(&mut source);
    let sent = (30.0 * (machine.seconds() - since_s)) as usize;
    let age = live.clock().unwrap().now - late.stamp;
    assert!(age < 0.1, "the newest is {age} s old");
    let told = source.skipped().last().unwrap().clone();
    assert!(told.starts_with("frames lost: ") && told.contains("overtaken"), "{told}");
    let count: usize = told.split(' ').nth(2).unwrap().parse().unwrap();
    assert!((sent - 6..=sent + 1).contains(&count), "{told} of {sent}");
}

/// What it gives as soon as it gives something.
fn within_s<T>(limit_s: f64, mut look: impl FnMut() -> Option<T>) -> T {
    let begun = std::time::Instant::now();
    loop {
        if let Some(it) = look() {
            return it;
        }
        assert!(begun.elapsed().as_secs_f64() < limit_s, "nothing within {limit_s} s");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_camera_is_unplugged_and_comes_back() {
    let machine = Simulated::new();
    machine.add_video(webcam(vec![vec![9; 640 * 480]]));
    let mut source = open(&machine, "v4l2:0", None).unwrap();
    let live = source.live().unwrap();
    let before = next(&mut source).stamp;
    machine.unplug(true);
    let pulled = machine.clone();
    let watcher = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(600));
        let trouble = within_s(5.0, || live.trouble());
        pulled.unplug(false);
        trouble
    });
    // It waits; what was on the way may still come.
    let back = loop {
        let p = next(&mut source);
        if p.stamp - before > 0.5 {
            break p;
        }
    };
    assert_eq!(watcher.join().unwrap(), "The camera was unplugged. Plug it in again.");
    assert!(back.stamp > before);
    assert!(source.live().unwrap().trouble().is_none());
    let lines = source.skipped().join("\n");
    assert!(lines.contains("was unplugged") && lines.contains("The camera is back."), "{lines}");
    // Plugged in at a port too slow for what it did before: that is said, and lasts.
    machine.set_modes(&node(0), vec![mode(PixelFormat::YUYV, [320, 240], 30.0)]);
    machine.unplug(false);
    let live = source.live().unwrap();
    let trouble = within_s(5.0, || live.trouble());
    assert!(trouble.contains("no images of 640x480") && trouble.contains("320x240"), "{trouble}");
}

#[test]
fn a_silent_camera_is_told_and_goes_on() {
    let machine = Simulated::new();
    machine.add_video(webcam(vec![vec![9; 640 * 480]]));
    let mut source = open(&machine, "v4l2:0", None).unwrap();
    next(&mut source);
    machine.silence(&node(0), true);
    let live = source.live().unwrap();
    assert_eq!(within_s(5.0, || live.trouble()), "The camera sends nothing.");
    machine.silence(&node(0), false);
    let at = source.live().unwrap().clock().unwrap().now;
    while next(&mut source).stamp < at {}
    assert!(source.live().unwrap().trouble().is_none());
}

/// The rig of a D435i: colour and depth 15 mm apart, and the IMU.
fn d435i_rig(camera: Camera) -> Rig {
    let depth = Camera::pinhole(640, 480, 0.9 * camera.fx, 0.9 * camera.fy, 322.0, 238.0);
    let noise = ImuNoise { gyro: 3e-3, gyro_walk: 1e-4, accel: 3e-2, accel_walk: 1e-3 };
    Rig {
        cameras: vec![RigCamera { name: "color".into(), camera, body_from_camera: Se3::identity() }],
        depth: Some(DepthSensor {
            camera: depth,
            body_from_depth: Se3::new(
                So3::exp(&Vec3::new(0.002, -0.004, 0.003)),
                Vec3::new(-0.015, 0.0, 0.0),
            ),
            metres_per_unit: 0.001,
            registered: false,
        }),
        imu: Some(ImuSensor { body_from_imu: Se3::identity(), rate_hz: 200.0, noise, offset_s: 0.0 }),
    }
}

/// The rig of the infrared pair of a RealSense.
fn pair_rig() -> Rig {
    let camera = |name: &str, x| RigCamera {
        name: name.into(),
        camera: Camera::pinhole(640, 480, 384.0, 384.0, 320.0, 240.0),
        body_from_camera: Se3::new(So3::identity(), Vec3::new(x, 0.0, 0.0)),
    };
    Rig { cameras: vec![camera("infra1", 0.0), camera("infra2", 0.05)], depth: None, imu: None }
}

/// A D435i over frames of a recording: depth seen by a sensor beside the colour camera and triggered 12 ms after it, gyroscope
/// at 200 Hz and accelerometer at 63 Hz, both in a clock that is 4321.5 s behind the machine's. What they measure tells when.
fn d435i(rig: &Rig, packets: &[FramePacket]) -> Simulated {
    let machine = Simulated::replay(rig, packets, 30.0);
    let usb = Simulated::d435i("2-1", REPLAYED_SERIAL);
    for (n, kind, rate_hz) in [(0, MotionKind::Accel, 63.0), (1, MotionKind::Gyro, 200.0)] {
        machine.add_motion(SimulatedMotion {
            found: MotionFound { node: format!("/dev/iio:device{n}").into(), kind, usb: Some(usb.clone()) },
            rate_hz,
            offset_s: 4321.5,
            // Along x, which the driver's user turns by half a turn about y.
            values: Arc::new(|t| Vec3::new(-(t - 5000.0), 1.0, 2.0)),
        });
    }
    machine
}

#[test]
fn a_depth_camera_delivers_aligned_depth_and_motion_in_one_clock() {
    let Some((recorded, packets)) = kitchen(60) else { return };
    let rig = d435i_rig(recorded.cameras[0].camera);
    let machine = d435i(&rig, &packets);
    let mut source = open(&machine, "realsense:", Some(rig.clone())).unwrap();
    let depth = source.rig().depth.as_ref().unwrap();
    assert!(depth.registered && depth.camera == rig.cameras[0].camera, "{depth:?}");
    // The difference of both clocks, read between two looks at the machine's.
    let live = source.live().unwrap();
    let epoch_s = live.clock().unwrap().now.seconds() - machine.seconds();
    let (mut last_imu, mut with_depth, mut compared) = (None, 0, 0);
    for k in 0..45 {
        let p = next(&mut source);
        if let Some(depth) = &p.depth {
            with_depth += 1;
            // Both start from the first frame, so that number and time agree to within a frame.
            let same = packets.iter().filter_map(|r| {
                (r.images[0].data() == p.images[0].data()).then_some(r.depth.as_ref().unwrap())
            });
            for truth in same {
                let pairs = depth.data().iter().zip(truth.data()).filter(|(a, b)| **a > 0 && **b > 0);
                let mut off: Vec<u16> = pairs.map(|(a, b)| a.abs_diff(*b)).collect();
                off.sort_unstable();
                assert!(
                    off.len() > truth.data().iter().filter(|z| **z > 0).count() * 8 / 10,
                    "{} pixels",
                    off.len()
                );
                assert!(off[off.len() / 2] <= 8, "median {} mm", off[off.len() / 2]);
                compared += 1;
            }
        }
        if k < 5 {
            last_imu = p.imu.last().map(|s| s.stamp).or(last_imu);
            continue;
        }
        assert!(p.imu.last().is_some_and(|s| s.stamp >= p.stamp), "a reading after the image was waited for");
        for s in &p.imu {
            assert!(!s.is_synthesised());
            assert!(last_imu.is_none_or(|l| s.stamp > l));
            last_imu = Some(s.stamp);
            let measured_s = s.gyro.x + 5000.0;
            let stamped_s = s.stamp.seconds() - epoch_s;
            // Late by the way of the data, 2 ms, and by how late a thread is woken.
            let late = stamped_s - measured_s;
            assert!((-0.001..0.012).contains(&late), "stamped {late} s late");
            assert!((s.accel.x - s.gyro.x).abs() < 0.012, "both sensors in one clock");
            assert_eq!((s.gyro.y, s.gyro.z), (1.0, -2.0), "turned about y");
        }
    }
    assert!(with_depth >= 40 && compared >= 40, "{with_depth} with depth, {compared} compared");
    for offset in source.motion_offsets_s() {
        let off = offset.unwrap() - 4321.5;
        assert!((0.0..0.012).contains(&off), "t_host = t_device + offset, {off} s off");
    }
}

#[test]
fn without_depth_for_a_while_images_go_on_and_it_is_told() {
    let Some((recorded, packets)) = kitchen(1) else { return };
    let rig = d435i_rig(recorded.cameras[0].camera);
    // The first picture, for four seconds.
    let machine = d435i(&rig, &vec![packets[0].clone(); 120]);
    let mut source = open(&machine, &format!("realsense:{REPLAYED_SERIAL}"), Some(rig)).unwrap();
    next(&mut source);
    machine.silence(&node(0), true);
    let until = machine.seconds() + 1.4;
    let mut without = 0;
    while machine.seconds() < until {
        without += usize::from(next(&mut source).depth.is_none());
    }
    assert!(without > 20, "{without} images without depth");
    assert_eq!(source.live().unwrap().trouble().unwrap(), "The depth camera sends nothing.");
    machine.silence(&node(0), false);
    machine.silence(Path::new("/dev/iio:device1"), true);
    std::thread::sleep(Duration::from_millis(1300));
    (0..10).for_each(|_| drop(next(&mut source)));
    assert!(next(&mut source).depth.is_some());
    assert_eq!(source.live().unwrap().trouble().unwrap(), "The gyroscope sends nothing.");
}

#[test]
fn the_infrared_pair_is_taken_apart_and_motion_that_is_denied_is_left_out() {
    let rig = d435i_rig(Camera::pinhole(640, 480, 600.0, 600.0, 320.0, 240.0));
    let machine = d435i(&rig, &[]);
    let pair = Rig { imu: rig.imu, ..pair_rig() };
    machine.refuse(Path::new("/dev/iio:device1"), Some(Trouble::Denied));
    let mut source = open(&machine, "realsense:", Some(pair)).unwrap();
    assert!(source.rig().imu.is_none() && source.rig().cameras.len() == 2);
    assert!(
        source.skipped()[0].contains("motion sensors are not used") && source.skipped()[0].contains("udev")
    );
    let p = next(&mut source);
    let values: Vec<u8> = p.images.iter().map(|i| i.at(320, 240)).collect();
    assert_eq!((values, p.imu.len()), (vec![50, 60], 0));
    // A second one plugged in makes the address ambiguous.
    machine.add_video(SimulatedVideo {
        found: VideoFound {
            node: node(9),
            name: "Intel RealSense".into(),
            usb: Some(Simulated::d435i("2-2", "999")),
        },
        modes: Vec::new(),
        frames: Arc::new(|_, _| None),
        phase_s: 0.0,
    });
    let rig = d435i_rig(Camera::pinhole(640, 480, 600.0, 600.0, 320.0, 240.0));
    let error = open(&machine, "realsense:", Some(rig.clone())).err().unwrap();
    assert!(error.contains(&format!("{REPLAYED_SERIAL}, 999")), "{error}");
    assert!(open(&machine, "realsense:77", Some(rig)).err().unwrap().contains("serial number 77"));
}

#[test]
fn a_webcam_that_sends_jpegs_is_decoded() {
    let Some(folder) = data("7scenes-kitchen") else { return };
    let file = folder.join("frame-000000.color.jpg");
    let (bytes, gray) = (std::fs::read(&file).unwrap(), cairn_sources::read_gray(&file).unwrap());
    let machine = Simulated::new();
    let mut camera = webcam(Vec::new());
    camera.modes = vec![mode(PixelFormat::MJPG, [640, 480], 30.0)];
    // Every third is cut off on the way.
    camera.frames =
        Arc::new(move |k, _| Some(if k % 3 == 1 { bytes[..9000].to_vec() } else { bytes.clone() }));
    machine.add_video(camera);
    let mut source = open(&machine, "v4l2:0", None).unwrap();
    for _ in 0..6 {
        assert_eq!(*next(&mut source).images[0], gray);
    }
    let told = source.skipped().join("\n");
    assert!(told.contains("a picture cannot be read"), "{told}");
}

#[test]
fn a_stereo_recording_goes_through_an_interleaved_pair_unchanged() {
    let Some((rig, packets)) = recording("euroc-mh01", 8) else { return };
    let pair: Vec<Vec<u8>> = packets
        .iter()
        .map(|p| p.images[0].data().iter().zip(p.images[1].data()).flat_map(|(l, r)| [*l, *r]).collect())
        .collect();
    let machine = Simulated::new();
    let mut camera = webcam(Vec::new());
    camera.modes = vec![mode(PixelFormat::Y8I, [752, 480], 20.0)];
    camera.frames = Arc::new(move |k, _| Some(pair[k as usize % pair.len()].clone()));
    machine.add_video(camera);
    let mut source = open(&machine, "v4l2:0?rate=20", Some(rig)).unwrap();
    assert_eq!((source.rig().cameras.len(), source.rig().imu.is_some()), (2, false));
    for _ in 0..10 {
        let live = next(&mut source);
        let recorded =
            packets.iter().find(|p| p.images[0] == live.images[0]).expect("a left image that was recorded");
        assert_eq!(recorded.images[1], live.images[1], "the right one of the same instant");
    }
}

#[test]
fn the_projector_is_off_while_the_infrared_pair_is_read_and_then_as_before() {
    let rig = d435i_rig(Camera::pinhole(640, 480, 600.0, 600.0, 320.0, 240.0));
    let machine = Simulated::replay(&rig, &[], 30.0);
    let is_on = || machine.projector_is_on("2-1");
    assert_eq!(is_on(), Some(true));
    let mut source = open(&machine, "realsense:", Some(pair_rig())).unwrap();
    let before = next(&mut source).stamp;
    assert_eq!(is_on(), Some(false));
    // A camera that is plugged in again has its projector on.
    machine.unplug(true);
    machine.unplug(false);
    assert_eq!(is_on(), Some(true));
    while next(&mut source).stamp - before < 0.3 {}
    assert_eq!(is_on(), Some(false));
    assert!(!source.skipped().join("\n").contains("projector"), "{:?}", source.skipped());
    drop(source);
    assert_eq!(is_on(), Some(true));
    // Depth needs its dots; a camera without one says so.
    let packets: Vec<_> = kitchen(1).into_iter().flat_map(|(_, packets)| packets).collect();
    if let [packet] = &packets[..] {
        let machine = Simulated::replay(&rig, &vec![packet.clone(); 60], 30.0);
        let mut source = open(&machine, "realsense:", Some(Rig { imu: None, ..rig.clone() })).unwrap();
        next(&mut source);
        assert_eq!(machine.projector_is_on("2-1"), Some(true));
    }
    let without = Simulated::new();
    without.add_video(SimulatedVideo {
        found: VideoFound {
            node: node(2),
            name: "Intel RealSense".into(),
            usb: Some(Simulated::d435i("2-1", "405")),
        },
        modes: vec![mode(PixelFormat::Y8I, [640, 480], 30.0)],
        frames: Arc::new(|_, _| Some(vec![0; 640 * 480 * 2])),
        phase_s: 0.0,
    });
    let mut source = open(&without, "realsense:", Some(pair_rig())).unwrap();
    next(&mut source);
    let told = source.skipped().join("\n");
    assert!(told.contains("projector could not be switched off: /dev/video2: has no such control"), "{told}");
}
