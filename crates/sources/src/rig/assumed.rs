//! What a rig takes where its file does not state it, or states it otherwise than it is used: for people.

use super::{camodocal, kalibr, maplab, notation, okvis, orbslam, ros, unused};
use crate::text::read_text;
use cairn_files::yaml::{Node, Value};
use std::path::Path;

/// What is taken where the file of a rig does not state it, or states what is not used as it stands, for people; `None` where
/// it states all.
pub fn assumed_in(path: impl AsRef<Path>) -> Option<String> {
    let path = path.as_ref();
    let text = read_text(path).ok()?;
    let mut told = Vec::new();
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
        let file: toml::Table = text.parse().ok()?;
        let cameras = file.get("cameras").and_then(|c| c.as_array()).into_iter().flatten();
        let number = |v: &toml::Value| v.as_float().or(v.as_integer().map(|v| v as f64));
        let focal = |c: &toml::Value| number(c.get("focal")?.get(1)?);
        told.extend(cameras.filter_map(focal).any(|fy| fy < 0.0).then(negative_fy));
    } else {
        let doc = notation::document(path, &text).ok()??;
        told.extend(rate(&doc.root));
        told.extend(has_negative_fy(&doc.root).then(negative_fy));
        told.extend(kalibr::imu_left_out(&doc));
        told.extend(camodocal::imu_left_out(&doc.root));
        told.extend(orbslam::imu_left_out(&doc.root));
        told.extend(orbslam::not_raw(&doc));
        told.extend(ros::right_alone(&doc));
        told.extend(unused::unused(&doc));
    }
    (!told.is_empty()).then(|| told.join("; it "))
}

fn rate(root: &Node) -> Option<String> {
    let rate = "states no rate of the IMU";
    if camodocal::is(root) && camodocal::has_imu(root) {
        let hz = camodocal::RATE_HZ;
        Some(format!(
            "{rate}: {hz} samples a second are taken, and its noise as that of one sample at this rate"
        ))
    } else if (okvis::is(root) && okvis::lacks_rate(root))
        || maplab::has_imu(root)
        || kalibr::imu_of_xrslam(root).is_some()
    {
        Some(format!("{rate}: {} samples a second are taken", okvis::RATE_HZ))
    } else {
        None
    }
}

fn negative_fy() -> String {
    "has a negative focal length along y, of a camera whose y axis points up: y points down here as in the image, so \
     poses to compare with are to be mirrored along y"
        .into()
}

/// Whether a focal length along y is negative: by its key, or second of the intrinsics of a pinhole.
fn has_negative_fy(node: &Node) -> bool {
    let negative = |node: &Node| node.text().and_then(|t| t.parse::<f64>().ok()).is_some_and(|v| v < 0.0);
    match &node.value {
        Value::Map(entries) => entries.iter().any(|(key, value)| match key.as_str() {
            "fy" | "cam_fy" | "mv" | "gamma2" => negative(value),
            "focal_length" | "intrinsics" if matches!(value.list(), Some([_, _] | [_, _, _, _])) => {
                value.list().is_some_and(|list| negative(&list[1]) || list.iter().any(has_negative_fy))
            }
            key => (key.ends_with(".fy") && negative(value)) || has_negative_fy(value),
        }),
        Value::List(items) => items.iter().any(has_negative_fy),
        _ => false,
    }
}
