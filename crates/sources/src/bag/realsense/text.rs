//! What the SDK writes as text since 2.58: `key=value;key=value`, lists with commas.

use cairn_bag::{CameraInfo, DecodeError, Header};
use cairn_geometry::{Mat3, Se3, So3, Vec3};
use cairn_sensor::check_rotation;
use std::str::FromStr;

/// The value of a key.
pub fn value<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let mut pairs = text.split(';').filter_map(|pair| pair.split_once('='));
    pairs.find(|(name, _)| *name == key).map(|(_, value)| value)
}

/// The number of a key.
fn number<T: FromStr>(text: &str, key: &str) -> Result<T, DecodeError> {
    let found = value(text, key).ok_or_else(|| DecodeError::new(format!("\"{key}\" is missing")))?;
    found.parse().map_err(|_| DecodeError::new(format!("\"{key}\" is \"{found}\", no number")))
}

/// The `N` numbers of a key.
fn numbers<const N: usize>(text: &str, key: &str) -> Result<[f64; N], DecodeError> {
    let found = value(text, key).ok_or_else(|| DecodeError::new(format!("\"{key}\" is missing")))?;
    let all: Result<Vec<f64>, _> = found.split(',').map(str::parse).collect();
    let all = all.ok().and_then(|all| <[f64; N]>::try_from(all).ok());
    all.ok_or_else(|| DecodeError::new(format!("\"{key}\" is \"{found}\", not {N} numbers")))
}

/// Intrinsics: `width, height, fx, ppx, fy, ppy, model, coeffs`. The model is in the SDK's words.
pub fn camera_info(text: &str) -> Result<CameraInfo, DecodeError> {
    let [fx, cx, fy, cy] =
        [number(text, "fx")?, number(text, "ppx")?, number(text, "fy")?, number(text, "ppy")?];
    Ok(CameraInfo {
        header: Header { stamp_ns: 0, frame_id: String::new() },
        height: number(text, "height")?,
        width: number(text, "width")?,
        model: value(text, "model").unwrap_or_default().to_owned(),
        d: numbers::<5>(text, "coeffs")?.to_vec(),
        k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: [0.0; 9],
        p: [0.0; 12],
    })
}

/// Extrinsics: `rotation` column by column and `translation` in metres, from the reference to the stream.
pub fn stream_from_reference(text: &str) -> Result<Se3, DecodeError> {
    let rotation = Mat3::from_column_slice(&numbers::<9>(text, "rotation")?);
    check_rotation("rotation", &rotation).map_err(DecodeError::new)?;
    let out = Se3::new(So3::from_matrix(&rotation), Vec3::from(numbers::<3>(text, "translation")?));
    if out.is_finite() { Ok(out) } else { Err(DecodeError::new("extrinsics that are not finite")) }
}

/// The device's time of a frame, nanoseconds: `timestamp` in milliseconds.
pub fn stamp_ns(text: &str) -> Option<i64> {
    let ms: f64 = value(text, "timestamp")?.parse().ok()?;
    ms.is_finite().then(|| (ms * 1e6).round() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_found_by_its_whole_name() {
        let text = "Frame number=7;timestamp_domain=Hardware Clock;system_time=0.5;timestamp=100050.125;";
        assert_eq!(value(text, "timestamp_domain"), Some("Hardware Clock"));
        assert_eq!(stamp_ns(text), Some(100_050_125_000));
        assert_eq!(value(text, "domain"), None);
        assert_eq!(stamp_ns("timestamp=nan"), None);
    }

    #[test]
    fn what_is_missing_or_broken_is_named() {
        let text =
            "width=32;height=24;fx=30;ppx=15.5;fy=31;ppy=11.5;model=Inverse Brown Conrady;coeffs=0,0,0,0,0";
        assert_eq!(camera_info(text).unwrap().k[4], 31.0);
        let why = |from: &str, to: &str| camera_info(&text.replace(from, to)).unwrap_err().to_string();
        assert!(why("fy=31", "fy=wide").contains("\"fy\" is \"wide\""));
        assert!(why("0,0,0,0,0", "0,0,0").contains("not 5 numbers"));
        assert!(why("height=24;", "").contains("\"height\" is missing"));
        let turned = "rotation=9,0,0,0,1,0,0,0,1;translation=0,0,0";
        assert!(stream_from_reference(turned).unwrap_err().to_string().contains("rotation"));
    }
}
