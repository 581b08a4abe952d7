//! The written layouts.

use cairn_sensor::Source;
use cairn_sim::{SimSource, write_euroc, write_tum};
use std::fs;
use std::path::PathBuf;

fn folder(name: &str) -> PathBuf {
    let dir = std::env::temp_dir().join(format!("cairn-sim-{name}-{}", std::process::id()));
    let _ = fs::remove_dir_all(&dir);
    fs::create_dir_all(&dir).unwrap();
    dir
}

fn lines(path: PathBuf) -> Vec<String> {
    fs::read_to_string(&path).unwrap().lines().map(String::from).collect()
}

#[test]
fn euroc_layout_is_complete() {
    let dir = folder("euroc");
    let mut source = SimSource::open("sim:hall?duration=0.2&resolution=64x48&detail=0.1").unwrap();
    let stamp = source.info().truth[0].0.0;
    assert_eq!(write_euroc(&dir.join("walk"), &mut source).unwrap(), 5);
    let mav = dir.join("walk/mav0");
    for cam in ["cam0", "cam1"] {
        let list = lines(mav.join(cam).join("data.csv"));
        assert_eq!(list.len(), 6);
        assert_eq!(list[1], format!("{stamp},{stamp}.png"));
        for line in &list[1..] {
            let name = line.split(',').nth(1).unwrap();
            let decoder = png::Decoder::new(std::io::BufReader::new(
                fs::File::open(mav.join(cam).join("data").join(name)).unwrap(),
            ));
            let reader = decoder.read_info().unwrap();
            assert_eq!((reader.info().width, reader.info().height), (64, 48));
        }
        assert!(
            fs::read_to_string(mav.join(cam).join("sensor.yaml")).unwrap().contains("resolution: [64, 48]")
        );
    }
    assert_eq!(lines(mav.join("imu0/data.csv")).len(), 1 + 41);
    assert_eq!(lines(mav.join("state_groundtruth_estimate0/data.csv")).len(), 6);
    // A second time: the folder is not empty.
    let mut source = SimSource::open("sim:hall?duration=0&resolution=64x48&detail=0.1").unwrap();
    let error = write_euroc(&dir.join("walk"), &mut source).unwrap_err();
    assert!(error.to_string().contains("not empty"), "{error}");
    let left: Vec<_> = fs::read_dir(&dir).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["walk"]);
    fs::remove_dir_all(&dir).unwrap();
}

#[test]
fn tum_is_whole() {
    let dir = folder("tum");
    let mut source =
        SimSource::open("sim:office?duration=0.2&resolution=64x48&detail=0.1&sensor=rgbd-imu&effects=none")
            .unwrap();
    let mut same =
        SimSource::open("sim:office?duration=0.2&resolution=64x48&detail=0.1&sensor=rgbd-imu&effects=none")
            .unwrap();
    assert_eq!(write_tum(&dir.join("walk"), &mut source).unwrap(), 5);
    let walk = dir.join("walk");
    let first = lines(walk.join("depth.txt"))[3].clone();
    assert_eq!(first, "1.000000000 depth/1.000000000.png");
    let mut reader = png::Decoder::new(std::io::BufReader::new(
        fs::File::open(walk.join("depth/1.000000000.png")).unwrap(),
    ))
    .read_info()
    .unwrap();
    let mut bytes = vec![0; 64 * 48 * 2];
    reader.next_frame(&mut bytes).unwrap();
    let depth = same.next_packet().unwrap().unwrap().depth.unwrap();
    for (i, mm) in depth.data().iter().enumerate() {
        let units = u16::from_be_bytes([bytes[2 * i], bytes[2 * i + 1]]);
        assert!(units == mm.saturating_mul(5) || *mm > 13_107, "{units} for {mm} mm");
    }
    for (name, count) in [("rgb.txt", 8), ("groundtruth.txt", 8), ("accelerometer.txt", 3 + 41)] {
        assert_eq!(lines(walk.join(name)).len(), count, "{name}");
    }
    // Stereo has no depth: nothing is left of the attempt.
    let mut stereo = SimSource::open("sim:hall?duration=0&resolution=64x48&detail=0.1").unwrap();
    assert!(write_tum(&dir.join("other"), &mut stereo).is_err());
    assert_eq!(fs::read_dir(&dir).unwrap().count(), 1);
    fs::remove_dir_all(&dir).unwrap();
}
