//! The real recordings used for accuracy, and the figures of a reference system on the same files.

use crate::Sensors;
use std::path::{Path, PathBuf};

/// One row of the table.
#[derive(Clone, Copy, Debug)]
pub struct Recording {
    /// Name of the row.
    pub name: &'static str,
    /// The first two columns of its row in the README.
    pub title: &'static str,
    /// Folder in the data folder.
    pub folder: &'static str,
    /// Sensors used.
    pub sensor: Sensors,
    /// Figures of ORB-SLAM3 V1.0.
    pub reference: Reference,
}

/// Figures of ORB-SLAM3 V1.0 on these files: two cores of the same kind, otherwise idle, fed in real time, three runs.
#[derive(Clone, Copy, Debug)]
pub struct Reference {
    /// ATE in metres, best and worst of the runs.
    pub ate_m: [f64; 2],
    /// Coverage.
    pub coverage: f64,
    /// Image to pose, p50 and p99 in milliseconds, as text with the range over the runs.
    pub step_ms: &'static str,
    /// Peak memory in MB.
    pub peak_mb: f64,
}

/// All rows.
pub const RECORDINGS: [Recording; 5] = [
    Recording {
        name: "euroc-mh01-stereo",
        title: "EuRoC MH_01, first 20 s | stereo, SE3",
        folder: "euroc-mh01",
        sensor: Sensors::Stereo,
        reference: Reference {
            ate_m: [0.0043, 0.0046],
            coverage: 1.0,
            step_ms: "19-25 / 29-44",
            peak_mb: 509.0,
        },
    },
    Recording {
        name: "euroc-mh01-mono",
        title: "EuRoC MH_01, first 20 s | mono, Sim3",
        folder: "euroc-mh01",
        sensor: Sensors::Mono,
        reference: Reference { ate_m: [0.0044, 0.0046], coverage: 0.99, step_ms: "12 / 34", peak_mb: 500.0 },
    },
    Recording {
        name: "7scenes-kitchen-rgbd",
        title: "7-Scenes RedKitchen, 300 frames | RGB-D, SE3",
        folder: "7scenes-kitchen",
        sensor: Sensors::Rgbd,
        reference: Reference { ate_m: [0.0286, 0.0296], coverage: 1.0, step_ms: "12.3 / 19", peak_mb: 495.0 },
    },
    Recording {
        name: "kitti-a-stereo",
        title: "KITTI odometry, 51 pairs | stereo, SE3",
        folder: "kitti-a",
        sensor: Sensors::Stereo,
        reference: Reference {
            ate_m: [0.052, 0.053],
            coverage: 1.0,
            step_ms: "22-26 / 33-51",
            peak_mb: 497.0,
        },
    },
    Recording {
        name: "kitti-a-mono",
        title: "KITTI odometry, 51 pairs | mono, Sim3",
        folder: "kitti-a",
        sensor: Sensors::Mono,
        reference: Reference {
            ate_m: [0.035, 0.050],
            coverage: 0.98,
            step_ms: "15 / 100-116",
            peak_mb: 490.0,
        },
    },
];

/// A row by its name.
pub fn recording(name: &str) -> Option<Recording> {
    RECORDINGS.into_iter().find(|r| r.name == name)
}

/// The folder of the recordings: `CAIRN_DATA`, else `../shared/data` beside the checkout.
pub fn data_folder() -> PathBuf {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    std::env::var_os("CAIRN_DATA").map_or_else(|| Path::new(beside).to_path_buf(), PathBuf::from)
}
