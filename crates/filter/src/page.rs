//! A page that replays a run: path, landmarks with their 95 % ellipses, and a time slider. One file that needs no
//! network.

use crate::ekf::Landmark;
use crate::run::{Run, Snapshot, ellipse_95};
use cairn_geometry::{Se2, Vec2};
use nalgebra::{Matrix2, Vector3};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Greatest number of poses of a path that are drawn.
const DRAWN: usize = 4000;

/// The page of this run; surveyed landmarks and smoothed positions are drawn if available, transformed into the map's
/// frame by `map_from_survey`.
pub fn page(
    title: &str,
    facts: &[(String, String)],
    run: &Run,
    surveyed: &BTreeMap<u32, Vec2>,
    map_from_survey: Option<&Se2>,
    smoothed: Option<&[Vector3<f64>]>,
) -> String {
    let every = run.poses.len().div_ceil(DRAWN).max(1);
    let path = |poses: &[Vector3<f64>]| -> Vec<Value> {
        poses.iter().step_by(every).map(|p| json!([round(p.x), round(p.y)])).collect()
    };
    let survey: Vec<Value> = map_from_survey.map_or_else(Vec::new, |t| {
        surveyed
            .iter()
            .map(|(name, p)| (name, *t * *p))
            .map(|(name, p)| json!([round(p.x), round(p.y), name]))
            .collect()
    });
    let data = json!({
        "path": path(&run.poses),
        "every": every,
        "smoothed": smoothed.map(path),
        "survey": survey,
        "frames": run.snapshots.iter().map(|s| frame(s, run)).collect::<Vec<_>>(),
    });
    let rows: String = facts
        .iter()
        .map(|(name, value)| format!("<div><dt>{}</dt><dd>{}</dd></div>", escape(name), escape(value)))
        .collect();
    // A '<' inside the data must not end the script element.
    let data = data.to_string().replace('<', "\\u003c");
    TEMPLATE.replace("@title@", &escape(title)).replace("@facts@", &rows).replace("@data@", &data)
}

fn frame(snapshot: &Snapshot, run: &Run) -> Value {
    let pose = &snapshot.pose;
    let landmark = |l: &Landmark| {
        let [long, short, angle] = ellipse_95(&l.covariance);
        let name = l.label.or_else(|| run.names.get(&l.id).copied());
        json!([
            round(l.position.x),
            round(l.position.y),
            round(long),
            round(short),
            round(angle),
            name,
            l.confirmed
        ])
    };
    let own: Matrix2<f64> = snapshot.covariance.fixed_view::<2, 2>(0, 0).into_owned();
    let [long, short, angle] = ellipse_95(&own);
    json!({
        "t": round(snapshot.time_s),
        "k": snapshot.step,
        "pose": [round(pose.x), round(pose.y), round(pose.z), round(long), round(short), round(angle)],
        "landmarks": snapshot.landmarks.iter().map(landmark).collect::<Vec<_>>(),
    })
}

/// Rounds to millimetres and milliradians, which is enough for a picture.
fn round(v: f64) -> f64 {
    (v * 1e3).round() / 1e3
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

const TEMPLATE: &str = include_str!("page.html");

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ekf::EkfConfig;
    use crate::log::parse_csv;
    use crate::run::run;

    #[test]
    fn holds_the_run_and_escapes_what_is_given() {
        let log =
            parse_csv("a", "0,velocity,1,0\n1,range_bearing,4,2,0.5\n2,range_bearing,4,1.3,0.9\n").unwrap();
        let run = run(&log, 0, &EkfConfig::default()).unwrap();
        let facts = [("robot".to_owned(), "</script><b>".to_owned())];
        let html = page("<run>", &facts, &run, &log.surveyed, None, None);
        assert!(html.contains("&lt;run&gt;") && html.contains("&lt;/script&gt;") && !html.contains("<run>"));
        assert!(html.contains("\"frames\":[") && html.contains("type=\"range\"") && !html.contains("@data@"));
        assert!(!html.contains("http://") && !html.contains("https://"), "the page needs no network");
    }
}
