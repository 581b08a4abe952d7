//! Calibration files: Cairn's TOML, EuRoC's sensor.yaml, Kalibr's chains with their IMU file, ORB-SLAM's settings, KITTI's
//! calib.txt. Any text is read or refused; a rig that was read is sound, makes a front end or is refused by it, and is written
//! and read again.
//!
//! The input is a folder: a line `=== NAME` begins the file of that name, of those known here.
#![no_main]

use cairn_geometry::{Vec2, Vec3};
use cairn_sensor::Rig;
use cairn_sources::{read_rig_for, write_rig};
use cairn_vision::{FrontEnd, FrontEndConfig, SensorMode};
use libfuzzer_sys::fuzz_target;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

const NAMES: [&str; 8] = [
    "rig.toml",
    "camchain.yaml",
    "imu.yaml",
    "settings.yaml",
    "calib.txt",
    "cam0/sensor.yaml",
    "cam1/sensor.yaml",
    "imu0/sensor.yaml",
];

/// In memory where the system has such a folder: it is written for every input.
static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let memory = Path::new("/dev/shm");
    let root = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    let folder = root.join(format!("cairn-fuzz-rig-{}", std::process::id()));
    for part in ["cam0", "cam1", "imu0"] {
        std::fs::create_dir_all(folder.join(part)).expect("a folder for the files");
    }
    folder
});

fuzz_target!(|bytes: &[u8]| {
    let text = String::from_utf8_lossy(bytes);
    let mut here = Vec::new();
    for part in text.split("=== ").skip(1) {
        let (name, text) = part.split_once('\n').unwrap_or((part, ""));
        if let Some(name) = NAMES.iter().find(|n| **n == name.trim()) {
            let path = FOLDER.join(name);
            std::fs::write(&path, text).expect("a file in the folder");
            here.push(path);
        }
    }
    for path in std::iter::once(&*FOLDER).chain(&here) {
        for size in [None, Some([640, 480])] {
            if let Ok(rig) = read_rig_for(path, size) {
                check(&rig);
            }
        }
    }
    here.iter().for_each(|path| drop(std::fs::remove_file(path)));
});

fn check(rig: &Rig) {
    assert_eq!(rig.validate(), Ok(()));
    rig.doubts();
    for c in &rig.cameras {
        c.camera
            .unproject(&Vec2::new(c.camera.cx + 30.0, c.camera.cy - 20.0))
            .map(|ray| c.camera.project(&ray));
        c.camera.project(&Vec3::new(0.3, -0.2, 1.0));
    }
    // The tables of a large image take more time than they are worth here.
    if rig.cameras.iter().all(|c| c.camera.width * c.camera.height <= 1 << 15) {
        for mode in [SensorMode::Mono, SensorMode::Stereo, SensorMode::Rgbd] {
            let _ = FrontEnd::new(rig, mode, FrontEndConfig::default());
        }
    }
    let path = FOLDER.join("written.toml");
    std::fs::write(&path, write_rig(rig).expect("a rig that was read is written"))
        .expect("a file in the folder");
    let again = read_rig_for(&path, None).expect("what was written is not read");
    assert_eq!(again.cameras.len(), rig.cameras.len());
    assert_eq!((again.depth.is_some(), again.imu.is_some()), (rig.depth.is_some(), rig.imu.is_some()));
}
