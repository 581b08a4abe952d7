//! Unreadable sources are refused with file, reason and remedy; and the reading thread ends with its source.

use crate::common;

use cairn_sensor::{Camera, Rig};
use cairn_sources::{OpenOptions, open, write_rig};
use common::{Folder, gray_png};

fn refused(source: &str) -> String {
    match open(source, OpenOptions::default()) {
        Ok(source) => panic!("opened {}", source.info().name),
        Err(error) => error.to_string(),
    }
}

fn small_rig() -> String {
    write_rig(&Rig::mono(Camera::pinhole(8, 6, 7.0, 7.0, 4.0, 3.0))).unwrap()
}

#[test]
fn unknown_sources_are_refused() {
    assert!(refused("/no/such/folder").contains("does not exist"));
    let folder = Folder::new();
    let text = refused(folder.name());
    assert!(text.contains("not a recording of a known kind") && text.contains("check the path"), "{text}");
    let file = folder.write("movie.xyz", "?");
    assert!(refused(file.to_str().unwrap()).contains("is a file, not a folder"));
    for (name, with) in [("walk.mcap.zstd", "zstd -d"), ("walk.bag.gz", "gunzip"), ("euroc.ZIP", "unzip")] {
        let text = refused(folder.write(name, "?").to_str().unwrap());
        assert!(text.contains("packed as a whole") && text.contains(with), "{text}");
    }
    for url in ["gopher://camera/1", "nothing:here"] {
        assert!(refused(url).contains("cannot be read"), "{}", refused(url));
    }
}

#[test]
fn folder_of_recordings_is_refused_with_a_hint() {
    let folder = Folder::new();
    folder.write("seq-01/frame-000000.color.png", "");
    assert!(refused(folder.name()).contains("did you mean"));
    folder.write("seq-02/frame-000000.color.png", "");
    let text = refused(folder.name());
    assert!(text.contains("it contains 2 recordings; choose one") && text.contains("seq-01"), "{text}");
}

#[test]
fn folders_of_a_pair_are_refused_with_the_layouts_of_pairs() {
    for [left, right] in [["left", "right"], ["cam_0", "cam_1"], ["camera1", "camera2"]] {
        let folder = Folder::new();
        for (name, k) in [(left, 0), (left, 1), (right, 0), (right, 1)] {
            folder.write(&format!("{name}/{k}.png"), gray_png(8, 6, k));
        }
        let text = refused(folder.name());
        assert!(text.contains(&format!("did you mean {}/{left}?", folder.name())), "{text}");
        assert!(text.contains("mav0/cam1/data"), "{text}");
    }
}

#[test]
fn two_kinds_in_one_folder_are_refused() {
    let folder = Folder::new();
    folder.write("rgb.txt", "1 a.png\n");
    folder.write("image_0/000000.png", "");
    let text = refused(folder.name());
    assert!(text.contains("more than one kind") && text.contains("TUM RGB-D and KITTI"), "{text}");
}

#[test]
fn empty_and_broken_csv_are_refused() {
    let folder = Folder::new();
    folder.write("rig.toml", small_rig());
    folder.write("cam0/data.csv", "#timestamp [ns],filename\n\n");
    let text = refused(folder.name());
    assert!(text.contains("data.csv: is empty"), "{text}");
    folder.write("cam0/data.csv", "#\ntoday,a.png\n");
    let text = refused(folder.name());
    assert!(text.contains("data.csv, line 2") && text.contains("time stamp, image file"), "{text}");
    folder.remove("cam0/data.csv");
    assert!(refused(folder.name()).contains("data.csv: cannot be read"));
}

#[test]
fn empty_imu_file_is_refused() {
    let folder = Folder::new();
    let imu = "\n[imu]\nrate_hz = 200.0\ngyro_noise = 1e-4\ngyro_walk = 1e-5\naccel_noise = 1e-3\naccel_walk = 1e-4\n";
    folder.write("rig.toml", small_rig() + imu);
    folder.write("cam0/data/a.png", gray_png(8, 6, 0));
    folder.write("cam0/data.csv", "0,a.png\n");
    folder.write("imu0/data.csv", "#only a header\n");
    let text = refused(folder.name());
    assert!(text.contains("imu0/data.csv: contains no sample"), "{text}");
}

#[test]
fn missing_and_invalid_calibration_are_refused() {
    let folder = Folder::new();
    folder.write("cam0/data/a.png", gray_png(8, 6, 0));
    folder.write("cam0/data.csv", "0,a.png\n");
    let text = refused(folder.name());
    assert!(text.contains("sensor.yaml: is missing") && text.contains("--rig"), "{text}");
    folder.write("rig.toml", small_rig().replace("[7.0, 7.0]", "[nan, 7.0]"));
    assert!(refused(folder.name()).contains("fx is NaN"));
    // NaN in a given rig is refused as well.
    let mut rig = Rig::mono(Camera::pinhole(8, 6, 7.0, 7.0, 4.0, 3.0));
    rig.cameras[0].body_from_camera.translation.x = f64::NAN;
    let error = open(folder.name(), OpenOptions { rig: Some(rig), ..Default::default() }).err().unwrap();
    assert!(error.to_string().contains("not finite"), "{error}");
}

#[test]
fn image_size_must_match_the_rig() {
    let folder = Folder::new();
    folder.write("rig.toml", small_rig());
    folder.write("cam0/data/a.png", gray_png(10, 6, 0));
    folder.write("cam0/data.csv", "0,a.png\n");
    let text = refused(folder.name());
    assert!(text.contains("cam0 has 10x6 pixels, the rig says 8x6") && text.contains("a.png"), "{text}");
}

#[test]
fn recording_without_readable_images_is_refused() {
    let folder = Folder::new();
    folder.write("rig.toml", small_rig());
    folder.write("cam0/data.csv", "0,a.png\n1,b.png\n");
    let text = refused(folder.name());
    assert!(text.contains("not a single image of cam0 can be read") && text.contains("a.png"), "{text}");
}

#[test]
fn incomplete_kitti_is_refused() {
    let folder = Folder::new();
    folder.write("image_0/readme.txt", "");
    assert!(refused(folder.name()).contains("calib.txt: is missing"));
    folder.write("calib.txt", "P0: 7 0 4 0 0 7 3 0 0 0 1 0\n");
    assert!(refused(folder.name()).contains("no numbered PNG or JPEG"));
    folder.write("image_0/000000.png", gray_png(8, 6, 0));
    folder.write("times.txt", "");
    assert!(refused(folder.name()).contains("times.txt: is empty"));
    folder.write("times.txt", "zero\n");
    let text = refused(folder.name());
    assert!(text.contains("contains no image") && text.contains("line 1"), "{text}");
    folder.write("calib.txt", "P0: 7 0 4 0 0 inf 3 0 0 0 1 0\n");
    assert!(refused(folder.name()).contains("calib.txt, line 1"));
}

/// Threads of this process with the reader's name, where the system lists them.
#[cfg(target_os = "linux")]
fn readers() -> usize {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap();
    let names = tasks.filter_map(|t| std::fs::read_to_string(t.ok()?.path().join("comm")).ok());
    names.filter(|n| n.trim() == "cairn-reader").count()
}

#[cfg(target_os = "linux")]
#[test]
fn reading_thread_ends_with_its_source() {
    let folder = Folder::new();
    folder.write("rig.toml", small_rig());
    folder.write("cam0/data/a.png", gray_png(8, 6, 0));
    let csv: String = (0..1000).map(|i| format!("{i}00000000,a.png\n")).collect();
    folder.write("cam0/data.csv", csv);
    for read in [0, 1, 20] {
        let mut source = open(folder.name(), OpenOptions::default()).unwrap();
        for _ in 0..read {
            assert!(source.next_packet().unwrap().is_some());
        }
        // It waits with its queue full and goes no further.
        std::thread::sleep(std::time::Duration::from_millis(50));
        assert!(readers() >= 1);
        drop(source);
    }
    // Other tests of this process may have one for a moment.
    let gone = (0..200).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(10));
        readers() == 0
    });
    assert!(gone);
}
