//! The YAML of `map_server`: a flat list of keys, one of which has a list of three numbers as its value.

use cairn_geometry::Se2;
use std::collections::BTreeMap;
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
    let keys = keys_of(text)?;
    let find = |key: &str| {
        keys.get(key)
            .cloned()
            .ok_or_else(|| (0, format!("the key `{key}` is missing: not the YAML of a map")))
    };
    let number = |key: &str| {
        let (line, text) = find(key)?;
        finite(line, key, &text)
    };
    let (line, image) = find("image")?;
    if image.is_empty() {
        return Err((line, "`image` is empty".to_owned()));
    }
    let (line, list) = find("origin")?;
    let numbers: Vec<&str> = list.trim_matches(['[', ']']).split(',').map(str::trim).collect();
    let &[x, y, yaw] = numbers.as_slice() else {
        return Err((line, format!("`origin` needs three numbers, not {list:?}")));
    };
    let of = |text| finite(line, "origin", text);
    let description = Description {
        image: PathBuf::from(image),
        resolution_m: number("resolution")?,
        origin: Se2::from_xy_angle(of(x)?, of(y)?, of(yaw)?),
        negate: negate(keys.get("negate"))?,
        occupied_threshold: number("occupied_thresh")?,
        free_threshold: number("free_thresh")?,
        mode: mode(keys.get("mode"))?,
    };
    let (free, occupied) = (description.free_threshold, description.occupied_threshold);
    if !(0.0..=1.0).contains(&free) || !(0.0..=1.0).contains(&occupied) || free >= occupied {
        let line = find("occupied_thresh")?.0;
        return Err((
            line,
            format!("thresholds need 0 <= free_thresh ({free}) < occupied_thresh ({occupied}) <= 1"),
        ));
    }
    Ok(description)
}

fn negate(value: Option<&(usize, String)>) -> Result<bool, Wrong> {
    match value.map(|(line, text)| (line, text.as_str())) {
        None | Some((_, "0" | "false" | "False")) => Ok(false),
        Some((_, "1" | "true" | "True")) => Ok(true),
        Some((line, text)) => Err((*line, format!("`negate` is 0 or 1, not {text:?}"))),
    }
}

fn mode(value: Option<&(usize, String)>) -> Result<Mode, Wrong> {
    match value.map(|(line, text)| (line, text.as_str())) {
        None | Some((_, "trinary")) => Ok(Mode::Trinary),
        Some((_, "scale")) => Ok(Mode::Scale),
        Some((_, "raw")) => Ok(Mode::Raw),
        Some((line, text)) => Err((*line, format!("`mode` is trinary, scale or raw, not {text:?}"))),
    }
}

fn finite(line: usize, key: &str, text: &str) -> Result<f64, Wrong> {
    let value = text.parse().ok().filter(|v: &f64| v.is_finite());
    value.ok_or_else(|| (line, format!("`{key}` needs a number, not {text:?}")))
}

/// Each key with its line and value; a list on lines of its own is joined by commas.
fn keys_of(text: &str) -> Result<BTreeMap<String, (usize, String)>, Wrong> {
    let mut keys: BTreeMap<String, (usize, String)> = BTreeMap::new();
    let mut last: Option<String> = None;
    for (line, text) in text.lines().enumerate().map(|(i, l)| (i + 1, without_comment(l).trim())) {
        if text.is_empty() || text.starts_with("---") || text.starts_with('%') {
            continue;
        }
        if let Some(item) = text.strip_prefix("- ") {
            let list = last.as_ref().and_then(|key| keys.get_mut(key));
            let (_, list) = list.ok_or_else(|| (line, "a list item without a key".to_owned()))?;
            *list = if list.is_empty() { item.trim().to_owned() } else { format!("{list},{}", item.trim()) };
            continue;
        }
        let Some((key, value)) = text.split_once(':') else {
            return Err((line, format!("expected `key: value`, not {text:?}")));
        };
        let (key, value) = (key.trim().to_owned(), value.trim().trim_matches(['"', '\'']).to_owned());
        last = Some(key.clone());
        if keys.insert(key.clone(), (line, value)).is_some() {
            return Err((line, format!("the key `{key}` stands there twice")));
        }
    }
    Ok(keys)
}

/// The line without the comment that a `#` begins.
fn without_comment(line: &str) -> &str {
    let mut quote = None;
    let mut before = ' ';
    for (at, c) in line.char_indices() {
        match (quote, c) {
            (None, '#') if before.is_whitespace() => return &line[..at],
            (None, '"' | '\'') => quote = Some(c),
            (Some(q), _) if q == c => quote = None,
            _ => {}
        }
        before = c;
    }
    line
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
