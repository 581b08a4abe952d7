//! Recorded pose graphs of robots, one g2o text a robot, from `team/` of the folder in `CAIRN_DATA`, else of `../shared/data` beside the
//! checkout.

use cairn_geometry::Se3;
use cairn_team::RobotGraph;
use cairn_team::files::{TeamGraphs, read};
use std::path::PathBuf;

/// The texts of a recorded team; `None`, with a printed note, where it is missing.
pub fn texts(name: &str) -> Option<Vec<String>> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let root = std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    let folder = root.join("team").join(name);
    let texts: Vec<String> =
        (0..).map_while(|k| std::fs::read_to_string(folder.join(format!("{k}.g2o"))).ok()).collect();
    if texts.is_empty() {
        println!("skipped: {} is not there", folder.display());
        return None;
    }
    Some(texts)
}

/// Their graphs, which are in space, as one reader numbers them.
pub fn graphs(texts: &[String]) -> Vec<RobotGraph<Se3, 6>> {
    match read(&texts.iter().map(String::as_str).collect::<Vec<_>>(), false).unwrap() {
        TeamGraphs::Space(team) => team,
        TeamGraphs::Plane(_) => panic!("the graph is in the plane"),
    }
}
