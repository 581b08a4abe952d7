//! The kitchen recording, read without the other crates of the project.

use cairn_geometry::Se3;
use cairn_sensor::{Camera, DepthImage};
use std::path::{Path, PathBuf};

/// Folder of the kitchen recording; `None`, with a message, where it is missing.
pub fn kitchen() -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let data = std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    let folder = data.join("7scenes-kitchen");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: no recording {}", folder.display());
    None
}

/// The data set's depth camera.
pub fn camera() -> Camera {
    Camera::pinhole(640, 480, 585.0, 585.0, 320.0, 240.0)
}

/// Depth in millimetres and `world_from_camera` of a frame.
pub fn frame(folder: &Path, number: usize) -> (DepthImage, Se3) {
    let stem = format!("frame-{number:06}");
    let file = std::fs::File::open(folder.join(format!("{stem}.depth.png"))).expect("a depth image");
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut bytes).expect("pixels");
    let data = bytes.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect();
    let depth = DepthImage::from_vec(info.width as usize, info.height as usize, data).expect("all rows");
    let text = std::fs::read_to_string(folder.join(format!("{stem}.pose.txt"))).expect("a pose");
    let numbers: Vec<f64> = text.split_whitespace().map(|v| v.parse().expect("a number")).collect();
    (depth, Se3::from_matrix(&nalgebra::Matrix4::from_row_slice(&numbers)))
}
