//! The YAML of `map_server`: a mapping, one of whose keys has a list of three numbers as its value.

use cairn_files::yaml::{self, Node};
use cairn_geometry::Se2;
use std::f64::consts::TAU;
use std::path::PathBuf;

/// How pixels are converted to occupancy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Free, occupied or unknown.
    Trinary,
    /// A gradient between the thresholds.
    Scale,
    /// Pixel values are used as they are.
    Raw,
}

/// Content of the YAML.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// Path of the image, relative to the YAML.
    pub image: PathBuf,
    /// Side of a cell in metres.
    pub resolution_m: f64,
    /// Pose of the lower left corner: `world_from_grid`.
    pub origin: Se2,
    /// Whether white means occupied, instead of black.
    pub negate: bool,
    /// A cell is occupied above this probability.
    pub occupied_threshold: f64,
    /// A cell is free below this probability.
    pub free_threshold: f64,
    /// How pixels are converted to occupancy.
    pub mode: Mode,
}

/// Line and reason.
type Wrong = (usize, String);

/// Reads the text of a YAML.
///
/// # Errors
/// The line (0 for the whole file) and what is wrong: a key is missing or repeated, or its value is invalid.
pub fn read_description(text: &str) -> Result<Description, (usize, String)> {
    let root = yaml::parse(text)?;
    let find = |key: &str| {
        root.get(key).ok_or_else(|| (root.line, format!("the key `{key}` is missing: not the YAML of a map")))
    };
    let number = |key: &str| finite(key, find(key)?);
    let image = find("image")?;
    let name = image.text().ok_or_else(|| (image.line, "`image` is empty".to_owned()))?;
    let origin = find("origin")?;
    let [x, y, yaw] = match origin.list() {
        Some([x, y, yaw]) => [finite("origin", x)?, finite("origin", y)?, finite("origin", yaw)?],
        _ => return Err((origin.line, "`origin` needs three numbers: x, y and yaw".to_owned())),
    };
    if yaw.abs() > TAU {
        return Err((origin.line, format!("the yaw of `origin` is in radians: is {yaw} in degrees?")));
    }
    let description = Description {
        image: PathBuf::from(name),
        resolution_m: number("resolution")?,
        origin: Se2::from_xy_angle(x, y, yaw),
        negate: root.get("negate").map_or(Ok(false), negate)?,
        occupied_threshold: number("occupied_thresh")?,
        free_threshold: number("free_thresh")?,
        mode: root.get("mode").map_or(Ok(Mode::Trinary), mode)?,
    };
    let (free, occupied) = (description.free_threshold, description.occupied_threshold);
    if !(0.0..=1.0).contains(&free) || !(0.0..=1.0).contains(&occupied) || free >= occupied {
        let why = format!("thresholds need 0 <= free_thresh ({free}) < occupied_thresh ({occupied}) <= 1");
        return Err((find("occupied_thresh")?.line, why));
    }
    Ok(description)
}

/// A switch as YAML 1.1 has it, which ROS reads.
fn negate(node: &Node) -> Result<bool, Wrong> {
    match node.text().unwrap_or_default().to_ascii_lowercase().as_str() {
        "0" | "false" | "no" | "off" => Ok(false),
        "1" | "true" | "yes" | "on" => Ok(true),
        text => Err((node.line, format!("`negate` is 0 or 1, not {text:?}"))),
    }
}

fn mode(node: &Node) -> Result<Mode, Wrong> {
    match node.text().unwrap_or_default().to_ascii_lowercase().as_str() {
        "trinary" => Ok(Mode::Trinary),
        "scale" => Ok(Mode::Scale),
        "raw" => Ok(Mode::Raw),
        text => Err((node.line, format!("`mode` is trinary, scale or raw, not {text:?}"))),
    }
}

fn finite(key: &str, node: &Node) -> Result<f64, Wrong> {
    let text = node.text().unwrap_or("a list");
    let value = text.parse().ok().filter(|v: &f64| v.is_finite());
    value.ok_or_else(|| {
        let comma = if text.contains(',') { ": decimals begin with a point" } else { "" };
        (node.line, format!("`{key}` needs a number, not {text:?}{comma}"))
    })
}

/// The text of a YAML.
pub fn write_description(d: &Description) -> String {
    let (t, yaw) = (d.origin.translation, d.origin.rotation.log());
    let mode = match d.mode {
        Mode::Trinary => "trinary",
        Mode::Scale => "scale",
        Mode::Raw => "raw",
    };
    format!(
        "image: {}\nmode: {mode}\nresolution: {}\norigin: [{}, {}, {yaw}]\nnegate: {}\noccupied_thresh: {}\nfree_thresh: {}\n",
        d.image.display(),
        d.resolution_m,
        t.x,
        t.y,
        u8::from(d.negate),
        d.occupied_threshold,
        d.free_threshold
    )
}
