//! `cairn team`.

use crate::{cairn, fails, folder, json, stderr, stdout};

/// A walk around a block of 24 steps, with loops across.
fn block() -> String {
    let mut lines: Vec<String> = (0..24)
        .map(|k| {
            let turn = if k % 6 == 5 { std::f64::consts::FRAC_PI_2 } else { 0.01 };
            format!("EDGE_SE2 {k} {} 1 0 {turn} 100 0 0 100 0 400", k + 1)
        })
        .collect();
    let across = ["0 24 0.1 0.05 0.1", "3 12 2 6.1 3.1", "5 9 1 2.9 1.6", "4 16 -2 6.1 3.1"];
    lines.extend(across.map(|e| format!("EDGE_SE2 {e} 10 0 0 10 0 40")));
    lines.join("\n")
}

#[test]
fn a_graph_is_split_and_agreed_on() {
    let folder = folder("team-split");
    let file = folder.join("block.g2o");
    std::fs::write(&file, block()).unwrap();
    let file = file.to_str().unwrap();
    let agreed = json(&cairn(&["team", "graph", file, "--robots", "3", "--exchanges", "8", "--json"]));
    assert_eq!(agreed["robots"].as_array().unwrap().len(), 3);
    assert_eq!(agreed["exchanges"].as_array().unwrap().len(), 8);
    assert_eq!(agreed["poses"], 25);
    assert!(agreed["exchanges"][7]["above"].as_f64().unwrap() < 1e-6, "{agreed}");
    assert!(agreed["robots"][0]["sent"].as_u64().unwrap() > 100, "{agreed}");
    assert_eq!(agreed["reached"].as_array().unwrap().len(), 3, "{agreed}");
    let text = stdout(&cairn(&["team", "graph", file, "--robots", "3", "--loss", "0.3", "--late", "0.2"]));
    assert!(text.starts_with("team        3 robots, 25 poses in the plane"), "{text}");
}

#[test]
fn what_is_no_team_is_said_in_one_line() {
    let folder = folder("team-wrong");
    let file = folder.join("block.g2o");
    std::fs::write(&file, block()).unwrap();
    let name = file.to_str().unwrap();
    for wrong in [&["team", "graph", name][..], &["team", "graph", name, name, "--robots", "2"]] {
        let output = cairn(wrong);
        assert_eq!(output.status.code(), Some(2), "{wrong:?}: {}", stderr(&output));
    }
    fails(&["team", "graph", name, "--robots", "99"], &["99 robots cannot share 25 poses"]);
    let empty = folder.join("empty");
    std::fs::create_dir_all(&empty).unwrap();
    fails(&["team", "graph", empty.to_str().unwrap()], &["no .g2o file"]);
    let other = folder.join("other.g2o");
    std::fs::write(&other, "EDGE_SE2 0 1 oops").unwrap();
    fails(&["team", "graph", name, other.to_str().unwrap()], &["other.g2o, line 1"]);
    // Edges alone say whose poses they are of nobody.
    fails(&["team", "graph", name, name], &["vertex 0 is in none of the texts"]);
}
