//! A folder that appears only when it is complete: it is filled under a temporary name beside its target and then
//! renamed.

use cairn_sensor::{DepthImage, GrayImage, SourceError};
use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A folder under construction; dropped without [`Folder::finish`] it leaves nothing behind.
pub(super) struct Folder {
    target: PathBuf,
    part: PathBuf,
    done: bool,
}

/// Makes an error about a path.
pub(super) fn fail(path: &Path, e: impl std::fmt::Display) -> SourceError {
    SourceError::new(
        path.display().to_string(),
        e.to_string(),
        "check the path, the permissions and the free space",
    )
}

impl Folder {
    /// Starts; the target must not exist or must be empty.
    pub fn begin(target: &Path) -> Result<Self, SourceError> {
        if let Ok(mut entries) = fs::read_dir(target) {
            if entries.next().is_some() {
                let name = target.display().to_string();
                return Err(SourceError::new(name, "is not empty", "give a new or an empty folder"));
            }
        } else if target.exists() {
            let name = target.display().to_string();
            return Err(SourceError::new(name, "is not a folder", "give a new or an empty folder"));
        }
        let Some(name) = target.file_name() else {
            return Err(SourceError::new(
                target.display().to_string(),
                "has no name",
                "give a new or an empty folder",
            ));
        };
        let mut hidden = std::ffi::OsString::from(".");
        hidden.push(name);
        hidden.push(format!(".{}.part", std::process::id()));
        let part = target.with_file_name(hidden);
        fs::create_dir_all(&part).map_err(|e| fail(&part, e))?;
        Ok(Self { target: target.into(), part, done: false })
    }

    /// Creates a subfolder.
    pub fn folder(&self, name: &str) -> Result<(), SourceError> {
        let path = self.part.join(name);
        fs::create_dir_all(&path).map_err(|e| fail(&path, e))
    }

    /// Writes a text file.
    pub fn text(&self, name: &str, text: &str) -> Result<(), SourceError> {
        let path = self.part.join(name);
        fs::write(&path, text).map_err(|e| fail(&path, e))
    }

    /// Writes an eight-bit image.
    pub fn gray(&self, name: &str, image: &GrayImage) -> Result<(), SourceError> {
        self.png(name, image.width(), image.height(), png::BitDepth::Eight, image.data())
    }

    /// Writes a sixteen-bit image.
    pub fn depth(&self, name: &str, image: &DepthImage) -> Result<(), SourceError> {
        let bytes: Vec<u8> = image.data().iter().flat_map(|v| v.to_be_bytes()).collect();
        self.png(name, image.width(), image.height(), png::BitDepth::Sixteen, &bytes)
    }

    fn png(
        &self,
        name: &str,
        w: usize,
        h: usize,
        bits: png::BitDepth,
        bytes: &[u8],
    ) -> Result<(), SourceError> {
        let path = self.part.join(name);
        let file = fs::File::create(&path).map_err(|e| fail(&path, e))?;
        let mut out = BufWriter::new(file);
        let (w, h) =
            (u32::try_from(w).map_err(|e| fail(&path, e))?, u32::try_from(h).map_err(|e| fail(&path, e))?);
        let mut encoder = png::Encoder::new(&mut out, w, h);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(bits);
        encoder.set_compression(png::Compression::Fast);
        let mut writer = encoder.write_header().map_err(|e| fail(&path, e))?;
        writer.write_image_data(bytes).map_err(|e| fail(&path, e))?;
        writer.finish().map_err(|e| fail(&path, e))?;
        out.flush().map_err(|e| fail(&path, e))
    }

    /// Renames the folder to its target.
    pub fn finish(mut self) -> Result<(), SourceError> {
        if self.target.exists() {
            // Removes only an empty folder: the call refuses any other.
            fs::remove_dir(&self.target).map_err(|e| fail(&self.target, e))?;
        }
        fs::rename(&self.part, &self.target).map_err(|e| fail(&self.target, e))?;
        self.done = true;
        Ok(())
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if !self.done {
            // There is no remedy where even this fails.
            let _ = fs::remove_dir_all(&self.part);
        }
    }
}
