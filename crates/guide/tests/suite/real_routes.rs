//! Cleaning of real walks recorded by phone (ARKit poses at 2 Hz, y up, 4x4 column-major).

use cairn_geometry::Vec3;
use cairn_guide::{CleanConfig, Ground, clean_line, largest_distance};
use std::path::PathBuf;

fn folder() -> PathBuf {
    let data = std::env::var_os("CAIRN_DATA").map(PathBuf::from);
    data.unwrap_or_else(|| concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data").into())
        .join("walks/arkit")
}

/// The walk's points; a step too long for half a second of walking is a gap.
fn load(path: &std::path::Path) -> Vec<(Vec3, bool)> {
    let value: serde_json::Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let mut line: Vec<(Vec3, bool)> = Vec::new();
    for pose in value["pose_data"].as_array().unwrap() {
        let number = |k: usize| pose["pose"][k].as_f64().unwrap();
        let p = Vec3::new(number(12), number(13), number(14));
        let gap = line.last().is_some_and(|(last, _)| (p - last).norm() > 1.5);
        line.push((p, gap));
    }
    line
}

#[test]
fn real_walks_are_cleaned_on_walked_ground() {
    let Ok(entries) = std::fs::read_dir(folder()) else {
        println!("skipped: no recordings at {}", folder().display());
        return;
    };
    let mut files: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "json"));
    files.sort();
    let ground = Ground::new(Vec3::y()).unwrap();
    for file in files {
        let record = load(&file);
        let points: Vec<Vec3> = record.iter().map(|p| p.0).collect();
        for cut_detours in [true, false] {
            let config = CleanConfig { cut_detours, ..CleanConfig::default() };
            let route = clean_line(&record, &record, &ground, &config);
            let far = largest_distance(&route.points, &points);
            println!(
                "{}: {:.1} m -> {:.1} m ({} cuts allowed: {cut_detours}), {} points -> {}, at most {far:.3} m off",
                file.file_name().unwrap().display(),
                route.before_m,
                route.after_m,
                route.cuts.len(),
                record.len(),
                route.points.len(),
            );
            assert!(far <= 0.31, "{far} m from the recorded route");
            assert!(route.after_m <= route.before_m);
            assert_eq!(route.points[route.points.len() - 1], points[points.len() - 1]);
            for cut in &route.cuts {
                assert!(largest_distance(&[cut.from, cut.to], &points) <= 0.31);
            }
        }
    }
}
