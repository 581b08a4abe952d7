//! Occupancy maps in the file format of ROS `map_server`: a YAML file that names an image, and the image.
//!
//! Values are those of `nav_msgs/OccupancyGrid`: 0 (free) to 100 (occupied), [`UNKNOWN`] = -1. With `x` the grey value
//! of a pixel, the occupancy probability is `p = (255 - x) / 255`, or `x / 255` where `negate` is set. The modes are
//! those of the `map_server` documentation:
//!
//! - `trinary` (default): 100 where `p > occupied_thresh`, 0 where `p < free_thresh`, else unknown;
//! - `scale`: 100 and 0 as in `trinary`, between them `99 (p - free_thresh) / (occupied_thresh - free_thresh)`;
//!   half transparent pixels are unknown;
//! - `raw`: the pixel is the value; above 100 it is unknown.
//!
//! A pixel that is wholly transparent is unknown in every mode, whatever colour lies under it: that is what an eraser leaves.

mod image;
mod yaml;

use crate::grid::{Grid, GridError, GridFrame};

pub use image::ImageError;
use image::Pixels;
use std::path::{Path, PathBuf};
pub use yaml::{Description, Mode, read_description, write_description};

/// Value of an unknown cell.
pub const UNKNOWN: i8 = -1;

/// A map that could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum MapFileError {
    /// The system could not read or write a file.
    #[error("{file}: {source}")]
    File {
        /// The file.
        file: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The YAML does not describe a map.
    #[error("{file}, line {line}: {reason}")]
    Yaml {
        /// The file.
        file: PathBuf,
        /// Line, from 1; 0 for the file as a whole.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// The image is not a readable grey image.
    #[error("{file}: {source}")]
    Image {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        source: ImageError,
    },
    /// Size, resolution or origin do not give a valid grid.
    #[error("{file}: {source}")]
    Grid {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        source: GridError,
    },
    /// `scale` marks unknown cells by transparency, which a PGM does not have.
    #[error("mode `scale` cannot hold the {unknown} unknown cells in a PGM; save as `trinary` or `raw`")]
    ScaleWithUnknown {
        /// How many cells are unknown.
        unknown: usize,
    },
}

/// Largest size of a map file: enough for the image of a square kilometre at 5 cm.
pub(crate) const MAX_BYTES: u64 = 512 * cairn_files::MIB;

/// Reads a map: the YAML file, and the PGM, PBM, PNG or BMP that it names, relative to it.
///
/// # Errors
/// When a file is missing, truncated or malformed; the error names the file and what is wrong.
pub fn load(yaml: &Path) -> Result<(Grid<i8>, Description), MapFileError> {
    let open = |file: &Path| {
        cairn_files::read(file, MAX_BYTES)
            .map_err(|source| MapFileError::File { file: file.to_owned(), source })
    };
    let text = cairn_files::read_text_lossy(yaml, MAX_BYTES)
        .map_err(|source| MapFileError::File { file: yaml.to_owned(), source })?;
    let description = read_description(&text).map_err(|(line, reason)| MapFileError::Yaml {
        file: yaml.to_owned(),
        line,
        reason,
    })?;
    let file = image_beside(yaml, &description.image);
    let pixels =
        image::read(&open(&file)?).map_err(|source| MapFileError::Image { file: file.clone(), source })?;
    let grid = to_grid(&pixels, &description).map_err(|source| MapFileError::Grid { file, source })?;
    Ok((grid, description))
}

/// The image that a YAML names: relative to it, in the folder of the user where it begins with `~`, and with separators of
/// another system.
pub fn image_beside(yaml: &Path, image: &Path) -> PathBuf {
    let folder = yaml.parent().unwrap_or(Path::new(""));
    let name = image.to_string_lossy();
    match (name.strip_prefix("~/"), std::env::home_dir()) {
        (Some(rest), Some(home)) => home.join(rest),
        _ if name.contains('\\') && !folder.join(image).exists() => folder.join(name.replace('\\', "/")),
        _ => folder.join(image),
    }
}

/// Writes a map as `yaml` and a PGM of the same name beside it, in the form that `map_server` reads.
///
/// In a `trinary` file all values become 0, 100 or unknown, by the thresholds 0.196 and 0.65.
///
/// # Errors
/// When a file cannot be written, or a map with unknown cells should be written as `scale`.
pub fn save(yaml: &Path, grid: &Grid<i8>, mode: Mode) -> Result<(), MapFileError> {
    let unknown = grid.values().iter().filter(|&&v| !(0..=100).contains(&v)).count();
    if mode == Mode::Scale && unknown > 0 {
        return Err(MapFileError::ScaleWithUnknown { unknown });
    }
    let pgm = yaml.with_extension("pgm");
    let description = Description {
        image: pgm.file_name().map(PathBuf::from).unwrap_or_default(),
        resolution_m: grid.frame().resolution_m(),
        origin: grid.frame().world_from_grid(),
        negate: false,
        occupied_threshold: 0.65,
        free_threshold: 0.196,
        mode,
    };
    let write = |file: &Path, bytes: &[u8]| {
        std::fs::write(file, bytes).map_err(|source| MapFileError::File { file: file.to_owned(), source })
    };
    write(&pgm, &image::write_pgm(&to_pixels(grid, &description)))?;
    write(yaml, write_description(&description).as_bytes())
}

/// Values from pixels; the first row of an image is the row of greatest y.
fn to_grid(pixels: &Pixels, d: &Description) -> Result<Grid<i8>, GridError> {
    let frame = GridFrame::new(pixels.width, pixels.height, d.resolution_m, d.origin)?;
    let value = |grey: u8, opaque: bool| {
        if d.mode == Mode::Raw {
            return if grey <= 100 { grey as i8 } else { UNKNOWN };
        }
        let p = f64::from(if d.negate { grey } else { 255 - grey }) / 255.0;
        if p > d.occupied_threshold {
            100
        } else if p < d.free_threshold {
            0
        } else if d.mode == Mode::Trinary || !opaque {
            UNKNOWN
        } else {
            (99.0 * (p - d.free_threshold) / (d.occupied_threshold - d.free_threshold)).round() as i8
        }
    };
    let mut table = [[0i8; 256]; 2];
    for (opaque, row) in table.iter_mut().enumerate() {
        (0..=255u8).for_each(|grey| row[grey as usize] = value(grey, opaque == 1));
    }
    let mut values = Vec::with_capacity(frame.len());
    for y in (0..pixels.height).rev() {
        let row = y * pixels.width..(y + 1) * pixels.width;
        let opaque = |i: usize| pixels.alpha.as_ref().is_none_or(|a| a[i] == 255);
        let erased = |i: usize| pixels.alpha.as_ref().is_some_and(|a| a[i] == 0);
        let value = |i| match erased(i) {
            true => UNKNOWN,
            false => table[usize::from(opaque(i))][pixels.grey[i] as usize],
        };
        values.extend(row.map(value));
    }
    Grid::from_values(frame, values)
}

/// The pixels that [`to_grid`] converts to these values.
fn to_pixels(grid: &Grid<i8>, d: &Description) -> Pixels {
    let grey = |value: i8| match (d.mode, value) {
        (Mode::Raw, 0..=100) => value as u8,
        (Mode::Raw, _) => 255,
        (_, v) if !(0..=100).contains(&v) => 205,
        (Mode::Trinary, v) if f64::from(v) > 100.0 * d.occupied_threshold => 0,
        (Mode::Trinary, v) if f64::from(v) < 100.0 * d.free_threshold => 254,
        (Mode::Trinary, _) => 205,
        (Mode::Scale, 0) => 254,
        (Mode::Scale, 100) => 0,
        (Mode::Scale, v) => {
            let p = d.free_threshold + f64::from(v) / 99.0 * (d.occupied_threshold - d.free_threshold);
            (255.0 * (1.0 - p)).round() as u8
        }
    };
    let (width, height) = (grid.frame().width(), grid.frame().height());
    let pixels = (0..height).rev().flat_map(|y| grid.row(y).iter().map(|&v| grey(v))).collect();
    Pixels { width, height, grey: pixels, alpha: None }
}
