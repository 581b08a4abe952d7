//! The cameras of the kernel that `cairn doctor` lists, on systems that can read them.

#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod built_in {
    pub use cairn_sources::camera::{CamerasReport as Cameras, inspect as found};

    /// A line a camera with its formats, and what was tried where one was not found.
    pub fn lines(cameras: &Cameras) -> Vec<(String, String)> {
        let mut lines = Vec::new();
        let under = |text: String| (String::new(), text);
        for camera in &cameras.cameras {
            let serial = camera.serial.as_ref().map_or(String::new(), |s| format!(", serial number {s}"));
            lines.push((camera.address.clone(), format!("{}{serial}", camera.name)));
            lines.extend(camera.formats.iter().chain(&camera.problem).cloned().map(under));
        }
        if cameras.cameras.is_empty() {
            lines.push(("cameras".to_owned(), "none found".to_owned()));
        }
        lines.extend(cameras.motion.iter().map(|m| ("motion sensor".to_owned(), m.clone())));
        lines.extend(cameras.tried.iter().cloned().map(under));
        lines
    }
}

#[cfg(not(all(target_os = "linux", target_pointer_width = "64")))]
mod built_in {
    /// This system has none.
    #[derive(serde::Serialize)]
    pub struct Cameras {
        built_in: bool,
    }

    /// Nothing is looked for.
    pub fn found() -> Cameras {
        Cameras { built_in: false }
    }

    /// What there is in their place.
    pub fn lines(_: &Cameras) -> Vec<(String, String)> {
        let state = "through ffmpeg (camera:0); v4l2: and realsense: need 64-bit Linux";
        vec![("cameras".to_owned(), state.to_owned())]
    }
}

pub use built_in::{Cameras, found, lines};
