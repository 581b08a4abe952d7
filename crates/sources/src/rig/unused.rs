//! What a calibration states that a rig has no place for, for people: an IMU's scale and axes, the times of further sensors,
//! the readout of a shutter.

use super::document::Document;
use super::{basalt, kalibr};
use crate::text::read_text;
use cairn_files::yaml::{Node, Value};

/// A matrix nearer to the ideal one than this is the ideal one: no IMU is calibrated so well.
const IDEAL: f64 = 1e-6;
/// Two cameras whose times differ by less are taken as one: Kalibr gives pairs that are triggered together 0.4 ms (D455 of
/// OpenVINS).
const SAME_TIME_S: f64 = 5e-4;

/// All that is stated and not used.
pub fn unused(doc: &Document) -> Vec<String> {
    let mut told = Vec::new();
    let imu = kalibr::imu_path(doc).and_then(|path| Document::parse(&path, &read_text(&path).ok()?).ok());
    let imu_node = imu.as_ref().map(|imu| (imu, imu.root.get("imu0").unwrap_or(&imu.root)));
    let off = imu_node.map_or_else(|| basalt::off_ideal(doc), |(imu, node)| off_ideal(imu, node));
    if off > IDEAL {
        told.push(format!(
            "states scale and axes of the IMU, up to {:.2} % off: they are not used, samples are taken as they come",
            100.0 * off
        ));
    }
    let offset = imu_node.and_then(|(imu, node)| imu.number(node.get("time_offset")?).ok());
    if let Some(offset) = offset.filter(|offset| *offset != 0.0) {
        told.push(format!(
            "has an IMU with a time_offset of {offset} s: that to other IMUs, which is not used"
        ));
    }
    let shift = |key: &str| doc.number(doc.root.get(key)?.get("timeshift_cam_imu")?).ok();
    if let (Some(a), Some(b)) = (shift("cam0"), shift("cam1"))
        && (a - b).abs() > SAME_TIME_S
    {
        told.push(format!("gives cam1 a time shift {:.1} ms off that of cam0, whose is used", 1e3 * (b - a)));
    }
    told.extend(readout(&doc.root).map(|seconds| {
        format!(
            "states a rolling shutter of {:.1} ms, which is not used: set tracker.readout_s to {seconds}",
            1e3 * seconds
        )
    }));
    told
}

/// How far the matrices of an IMU file are from ideal ones at most: of OpenVINS, and of Kalibr's `scale-misalignment`.
fn off_ideal(doc: &Document, imu: &Node) -> f64 {
    let of = |node: Option<&Node>, diagonal: f64| {
        let m = node.and_then(|node| doc.matrix(node, "of the IMU").ok()).unwrap_or_default();
        m.iter()
            .enumerate()
            .map(|(i, v)| (v - if i % 4 == 0 { diagonal } else { 0.0 }).abs())
            .fold(0.0, f64::max)
    };
    let within = |sensor: &str, key: &str| imu.get(sensor).and_then(|n| n.get(key));
    let ones = ["Tw", "Ta", "R_IMUtoGYRO", "R_IMUtoACC"].map(|key| of(imu.get(key), 1.0));
    let more = [
        of(within("accelerometers", "M"), 1.0),
        of(within("gyroscopes", "M"), 1.0),
        of(within("gyroscopes", "C_gyro_i"), 1.0),
        of(within("gyroscopes", "A"), 0.0),
        of(imu.get("Tg"), 0.0),
    ];
    ones.into_iter().chain(more).fold(0.0, f64::max)
}

/// The readout time of a frame in seconds, where a file states one: VINS-Mono for the frame, SVO, maplab and Kalibr for each line.
fn readout(root: &Node) -> Option<f64> {
    let number = |node: &Node| node.text()?.parse::<f64>().ok().filter(|v| *v > 0.0);
    let Value::Map(entries) = &root.value else {
        return root.list()?.iter().find_map(readout);
    };
    let height =
        || number(root.get("image_height")?).or_else(|| number(root.get("resolution")?.list()?.get(1)?));
    entries.iter().find_map(|(key, node)| match key.as_str() {
        "rolling_shutter_tr" => {
            number(node).filter(|_| root.get("rolling_shutter").is_none_or(|n| n.text() != Some("0")))
        }
        "line-delay-nanoseconds" => Some(1e-9 * number(node)? * height()?),
        "line_delay" => Some(number(node)? * height()?),
        _ => readout(node),
    })
}
