//! The factory calibration of a ZED (`SN*.conf`): `[LEFT_CAM_HD]`, `[RIGHT_CAM_HD]` and the like, one for each size of images, and
//! `[STEREO]` with millimetres and angles.

use crate::text::data_lines;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, Distortion, Rig, RigCamera, SourceError};
use std::collections::BTreeMap;
use std::path::Path;

/// The names of the sizes.
const SIZES: [(&str, [usize; 2]); 7] = [
    ("2K", [2208, 1242]),
    ("FHD1200", [1920, 1200]),
    ("FHD", [1920, 1080]),
    ("QHDPLUS", [3200, 1800]),
    ("HD", [1280, 720]),
    ("SVGA", [960, 600]),
    ("VGA", [672, 376]),
];

/// True when a text has a left camera and a `[STEREO]`.
pub fn is(text: &str) -> bool {
    let has = |start: &str| data_lines(text).any(|(_, line)| line.starts_with(start));
    has("[LEFT_CAM_") && has("[STEREO]")
}

/// Both cameras for images of a size, alone or side by side; without a size those of 1280x720, or of the one size in the file.
pub fn rig(path: &Path, text: &str, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    let wrong = |why: String, cure: &str| SourceError::new(path.display().to_string(), why, cure);
    let values = values(text);
    let has = |name: &str| values.contains_key(&(format!("LEFT_CAM_{name}"), "FX".to_owned()));
    let fits = |own: [usize; 2]| size.is_none_or(|[w, h]| h == own[1] && (w == own[0] || w == 2 * own[0]));
    let all: Vec<_> = SIZES.into_iter().filter(|(name, own)| has(name) && fits(*own)).collect();
    let Some(&(name, [width, height])) = all.iter().find(|(name, _)| *name == "HD").or(all.first()) else {
        let why = match size {
            Some([w, h]) => format!("has no cameras for images of {w}x{h}"),
            None => "has no cameras of a known size".into(),
        };
        return Err(wrong(why, "record in a size of the camera: 2208x1242, 1920x1080, 1280x720 or 672x376"));
    };
    let get = |section: &str, key: &str| values.get(&(section.to_owned(), key.to_owned())).copied();
    let need = |section: &str, key: &str| {
        get(section, key)
            .ok_or_else(|| wrong(format!("{key} is missing in [{section}]"), "download the file again"))
    };
    let camera = |side: &str| -> Result<Camera, SourceError> {
        let section = format!("{side}_CAM_{name}");
        let number = |key: &str| need(&section, key);
        let c = ["K1", "K2", "P1", "P2", "K3"].map(|key| get(&section, key).unwrap_or(0.0));
        let distortion = Distortion::RadialTangential(c);
        let camera = Camera {
            width,
            height,
            fx: number("FX")?,
            fy: number("FY")?,
            cx: number("CX")?,
            cy: number("CY")?,
            distortion,
        };
        camera.validate().map_err(|e| wrong(e.to_string(), "download the file again"))?;
        Ok(camera)
    };
    let of_size = |key: &str| get("STEREO", &format!("{key}_{name}"));
    let angle = |key: &str| of_size(key).unwrap_or(0.0);
    let offset = |key: &str| of_size(key).or(get("STEREO", key)).unwrap_or(0.0);
    // x_right = R x_left - t: the right camera is to the right.
    let r = So3::exp(&Vec3::new(angle("RX"), angle("CV"), angle("RZ")));
    let t = 1e-3 * Vec3::new(need("STEREO", "BASELINE")?, offset("TY"), offset("TZ"));
    let mut rig = Rig::mono(camera("LEFT")?);
    let body_from_camera = Se3::new(r, -t).inverse();
    rig.cameras.push(RigCamera { name: "cam1".into(), camera: camera("RIGHT")?, body_from_camera });
    Ok(rig)
}

/// The numbers by section and key, in capitals.
fn values(text: &str) -> BTreeMap<(String, String), f64> {
    let (mut section, mut values) = (String::new(), BTreeMap::new());
    for (_, line) in data_lines(text) {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.split(']').next()) {
            section = name.trim().to_ascii_uppercase();
        } else if let Some((key, value)) = line.split_once('=')
            && let Some(value) = value.trim().parse().ok().filter(|v: &f64| v.is_finite())
        {
            values.insert((section.clone(), key.trim().to_ascii_uppercase()), value);
        }
    }
    values
}
