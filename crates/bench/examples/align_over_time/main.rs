//! Would observations be better if the patch of a feature were aligned with that of its match in a later image?
//!
//! For features matched some time apart: how far they are from where the true motion says, as found by the front end and as
//! aligned. `cargo run --release -p bench --example align_over_time [PART]`, where PART is in the address of the wanted
//! sources.

mod compare;
mod geometry;
mod patch;
mod recording;

use bench::recordings::data_folder;
use cairn_sensor::Stamp;
use cairn_vision::SensorMode;
use compare::{Row, compare, mean, quantile};
use patch::Alignment;
use recording::{Recording, Warp, Way, read};

const fn way(name: &'static str, warp: Warp, side: usize, gain: bool, max_shift: f64) -> Way {
    Way { name, warp, how: Alignment { side, gain, max_shift, min_correlation: 0.8 } }
}

/// The way of the first table.
const CHOSEN: Way = way("motion and depth", Warp::Facing, 9, true, 1.5);

/// The ways of the second table.
const WAYS: [Way; 9] = [
    way("levels and angles", Warp::Angle, 9, true, 1.5),
    CHOSEN,
    way("the same, at most 1 px", Warp::Facing, 9, true, 1.0),
    way("the same, gain of 1", Warp::Facing, 9, false, 1.5),
    way("the same, 7x7", Warp::Facing, 7, true, 1.5),
    way("the same, 8x8", Warp::Facing, 8, true, 1.5),
    way("the same, 13x13", Warp::Facing, 13, true, 1.5),
    way("motion, depth and normal", Warp::Normal, 9, true, 1.5),
    way("homography of that plane", Warp::Plane, 9, true, 1.5),
];

/// Pairs of views so many seconds apart that the camera has moved between.
fn pairs(r: &Recording, seconds: f64) -> Vec<(usize, usize)> {
    let stamps: Vec<Stamp> = r.views.iter().map(|v| v.frame.stamp).collect();
    let later = |i: usize| {
        let off = |j: &usize| (stamps[*j] - stamps[i] - seconds).abs();
        let j = (i + 1..stamps.len()).min_by(|a, b| off(a).total_cmp(&off(b)))?;
        let moved = r.views[i].world_from_camera.inverse() * r.views[j].world_from_camera;
        (off(&j) < 0.06 && moved.translation.norm() > 0.02).then_some((i, j))
    };
    (0..stamps.len()).step_by(5).filter_map(later).collect()
}

/// All matches of all pairs, and the errors of the poses in mm as found and as aligned.
fn all(r: &Recording, seconds: f64, way: &Way) -> (Vec<Row>, [Vec<f64>; 2]) {
    let (mut rows, mut poses) = (Vec::new(), Default::default());
    for (i, j) in pairs(r, seconds) {
        compare(r, &r.views[i], &r.views[j], way, &mut rows, &mut poses);
    }
    (rows, poses)
}

/// Median and 95 %.
fn spread(values: impl Iterator<Item = f64>) -> String {
    let mut v: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    if v.is_empty() {
        return "-".into();
    }
    format!("{:.2} / {:.2}", quantile(&mut v, 0.5), quantile(&mut v, 0.95))
}

fn median(v: &mut [f64]) -> String {
    if v.is_empty() { "-".into() } else { format!("{:.2}", quantile(v, 0.5)) }
}

/// Number of matches, share refused, and distances as found and as aligned (those refused as found).
fn distances(rows: &[&Row]) -> String {
    let refused = rows.iter().filter(|r| r.aligned.is_none()).count() as f64 / rows.len().max(1) as f64;
    let found = spread(rows.iter().map(|r| r.found));
    let aligned = spread(rows.iter().map(|r| r.aligned.unwrap_or(r.found)));
    format!("{} | {:.1} | {found} | {aligned}", rows.len(), 100.0 * refused)
}

/// Mean distance along the parallax beside outlines, in pixels of the level, as found and as aligned.
fn outlines(rows: &[Row]) -> String {
    let along = rows.iter().filter(|r| r.outline).filter_map(|r| {
        let (found, aligned) = r.along?;
        Some((found / r.scale, aligned.unwrap_or(found) / r.scale))
    });
    let (found, aligned): (Vec<f64>, Vec<f64>) = along.unzip();
    if found.is_empty() { "- | -".into() } else { format!("{:+.2} | {:+.2}", mean(&found), mean(&aligned)) }
}

fn first_table(name: &str, r: &Recording) {
    for seconds in [0.1, 0.2, 0.5, 1.0] {
        let (rows, [mut found, mut aligned]) = all(r, seconds, &CHOSEN);
        let fitted = [0, 1].map(|k| spread(rows.iter().map(|r| r.fitted[k])));
        println!(
            "| {name} | {seconds} | {} | {} | {} | {} | {} | {} |",
            distances(&rows.iter().collect::<Vec<_>>()),
            fitted[0],
            fitted[1],
            median(&mut found),
            median(&mut aligned),
            outlines(&rows)
        );
    }
}

fn second_table(name: &str, r: &Recording) {
    println!(
        "\n| {name}, 0.5 s, warp by | matches | refused % | found px | aligned px | pose mm | aligned mm |"
    );
    println!("|---|---|---|---|---|---|---|");
    for way in &WAYS {
        let (rows, [mut found, mut aligned]) = all(r, 0.5, way);
        let all: Vec<&Row> = rows.iter().collect();
        println!(
            "| {} | {} | {} | {} |",
            way.name,
            distances(&all),
            median(&mut found),
            median(&mut aligned)
        );
    }
    let (rows, _) = all(r, 0.5, &CHOSEN);
    for levels in [0..=1, 2..=3, 4..=7] {
        let some: Vec<&Row> = rows.iter().filter(|r| levels.contains(&r.level)).collect();
        println!(
            "| {}, levels {} to {} | {} | | |",
            CHOSEN.name,
            levels.start(),
            levels.end(),
            distances(&some)
        );
    }
}

fn main() -> Result<(), String> {
    let data = data_folder();
    let path = |name: &str| data.join(name).display().to_string();
    let sim =
        |world: &str, rest: &str| format!("sim:{world}?sensor=rgbd&depth_noise=0&rate=10&duration={rest}");
    let list = [
        ("office", sim("office", "40&seed=1"), SensorMode::Rgbd, 1000, true),
        ("apartment", sim("apartment", "40&seed=2"), SensorMode::Rgbd, 1000, true),
        ("street, 3 m/s", sim("street", "20&speed=3"), SensorMode::Rgbd, 1000, true),
        ("EuRoC MH_01", path("euroc-mh01"), SensorMode::Stereo, 1200, false),
        ("KITTI", path("kitti-a"), SensorMode::Stereo, 2000, false),
        ("RedKitchen", path("7scenes-kitchen"), SensorMode::Rgbd, 1000, false),
    ];
    let part = std::env::args().nth(1).unwrap_or_default();
    println!(
        "| images | s apart | matches | refused % | found px | aligned px | own motion, found px | aligned px | \
         pose mm | aligned mm | outlines px | aligned px |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    let mut rest = Vec::new();
    for (name, address, mode, features, exact) in list.into_iter().filter(|l| l.1.contains(&part)) {
        let r = read(&address, mode, features, exact)?;
        first_table(name, &r);
        if name.starts_with("office") || name.starts_with("street") {
            rest.push((name, r));
        }
    }
    rest.iter().for_each(|(name, r)| second_table(name, r));
    Ok(())
}
