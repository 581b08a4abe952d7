//! Shared test helpers: temporary folders, generated images, the data folder.
#![allow(dead_code)] // each test file uses its own part

use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, DepthSensor, Rig};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// A temporary folder, removed when dropped.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new() -> Self {
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let name = format!("cairn-sources-{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub fn path(&self) -> &Path {
        &self.0
    }

    pub fn name(&self) -> &str {
        self.0.to_str().unwrap()
    }

    /// Writes a file, with the folders it needs.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, content).unwrap();
        path
    }

    pub fn remove(&self, name: &str) {
        std::fs::remove_file(self.0.join(name)).unwrap();
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A path in the data folder; prints "skipped" when it is missing.
pub fn data(name: &str) -> Option<PathBuf> {
    let folder = std::env::var("CAIRN_DATA")
        .unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data").into());
    let path = Path::new(&folder).join(name);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {} is missing", path.display());
    None
}

/// A PNG of 8- or 16-bit samples.
pub fn png(width: u32, height: u32, colour: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(data).unwrap();
    writer.finish().unwrap();
    out
}

/// An 8-bit gray PNG whose pixels count up from `start`.
pub fn gray_png(width: u32, height: u32, start: u8) -> Vec<u8> {
    let data: Vec<u8> = (0..width * height).map(|i| (i as u8).wrapping_add(start)).collect();
    png(width, height, png::ColorType::Grayscale, png::BitDepth::Eight, &data)
}

/// A 16-bit gray PNG of one value, with another in its first pixel.
pub fn depth_png(width: u32, height: u32, first: u16, value: u16) -> Vec<u8> {
    let mut data = first.to_be_bytes().to_vec();
    data.extend((1..width * height).flat_map(|_| value.to_be_bytes()));
    png(width, height, png::ColorType::Grayscale, png::BitDepth::Sixteen, &data)
}

/// A rig with unregistered depth, like a Kinect's.
pub fn rgbd_rig() -> Rig {
    let mut rig = Rig::mono(Camera::pinhole(8, 6, 7.0, 7.5, 4.0, 3.0));
    rig.cameras[0].body_from_camera =
        Se3::new(So3::exp(&Vec3::new(0.1, 0.2, 0.3)), Vec3::new(0.02, 0.0, -0.01));
    rig.depth = Some(DepthSensor {
        camera: Camera::pinhole(8, 6, 8.0, 8.0, 4.0, 3.0),
        body_from_depth: Se3::identity(),
        metres_per_unit: 0.001,
        registered: false,
    });
    rig
}
