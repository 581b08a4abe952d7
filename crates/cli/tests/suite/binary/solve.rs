//! `cairn solve`.

use crate::binary::{cairn, fails, folder, json, stdout};

/// A square in the plane with inaccurate vertices.
const SQUARE: &str = "\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1.1 0.1 1.6
VERTEX_SE2 2 0.8 1.2 3.0
VERTEX_SE2 3 0.1 0.9 -1.5
EDGE_SE2 0 1 1 0 1.570796 100 0 0 100 0 400
EDGE_SE2 1 2 1 0 1.570796 100 0 0 100 0 400
EDGE_SE2 2 3 1 0 1.570796 100 0 0 100 0 400
EDGE_SE2 3 0 1.02 0 1.570796 100 0 0 100 0 400
";

const BUNDLE: &str = "\
2 3 6
0 0 -9.5 5.5
0 1 12 3
0 2 2 14
1 0 -88 4
1 1 -70 -2
1 2 -80 10
0 0 0 0 0 -5 500 0 0
0 0 0 -1 0 -5 500 0 0
-0.1 0.05 0
0.1 0.03 -0.1
0.02 0.1 -0.2
";

#[test]
fn graphs_are_solved_from_every_start() {
    let folder = folder("solve-graph");
    let (file, out) = (folder.join("square.g2o"), folder.join("out.g2o"));
    std::fs::write(&file, SQUARE).unwrap();
    let (file, out) = (file.to_str().unwrap(), out.to_str().unwrap());
    let mut costs = Vec::new();
    for more in [
        &["--method", "gn"][..],
        &["--init", "odometry"],
        &["--init", "chordal", "--robust", "huber", "--robust-width", "5"],
        &["--out", out],
    ] {
        let solved = json(&cairn(&[&["solve", "graph", file, "--json"], more].concat()));
        let (before, after) =
            (solved["cost_before"].as_f64().unwrap(), solved["cost_after"].as_f64().unwrap());
        assert!(after <= before && solved["stop"] == "converged", "{more:?}: {solved}");
        assert_eq!(
            (&solved["vertices"], &solved["edges"], &solved["dimensions"]),
            (&4.into(), &4.into(), &2.into())
        );
        assert!(
            solved["seconds"].as_f64().unwrap() > 0.0 && solved["iterations"].as_u64().unwrap() > 0,
            "{solved}"
        );
        costs.push(after);
    }
    assert!(costs.iter().all(|c| (c - costs[0]).abs() < 1e-6 * costs[0]), "{costs:?}");
    // The written graph is already solved.
    let again = json(&cairn(&["solve", "graph", out, "--json"]));
    assert!((again["cost_before"].as_f64().unwrap() - costs[0]).abs() < 1e-9 * costs[0], "{again}");
    let text = stdout(&cairn(&["solve", "graph", file]));
    assert!(text.contains("4 vertices in the plane") && text.contains("converged"), "{text}");
    assert!(text.contains("of least cost: "), "{text}");
    // Without a choice the start of least cost is taken.
    let told = json(&cairn(&["solve", "graph", file, "--json"]));
    let starts = told["starts"].as_array().unwrap();
    assert!(starts.len() == 3 && starts.iter().all(|s| s[1].as_f64() >= starts[0][1].as_f64()), "{told}");
    assert_eq!((&told["init"], &told["cost_before"]), (&starts[0][0], &starts[0][1]));
    for wrong in [&["--method", "magic"][..], &["--robust-width", "-1"], &["--init", "nowhere"]] {
        assert_eq!(cairn(&[&["solve", "graph", file], wrong].concat()).status.code(), Some(2), "{wrong:?}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn bundles_are_adjusted() {
    let folder = folder("solve-bundle");
    let (file, out) = (folder.join("two.txt"), folder.join("out.txt"));
    std::fs::write(&file, BUNDLE).unwrap();
    let (file, out) = (file.to_str().unwrap(), out.to_str().unwrap());
    for more in [&["--out", out][..], &["--huber", "2"]] {
        let solved = json(&cairn(&[&["solve", "bundle", file, "--json"], more].concat()));
        assert!(solved["rms_after_px"].as_f64() < solved["rms_before_px"].as_f64(), "{solved}");
        assert_eq!(
            (&solved["cameras"], &solved["points"], &solved["observations"]),
            (&2.into(), &3.into(), &6.into())
        );
    }
    let text = stdout(&cairn(&["solve", "bundle", out, "--iterations", "0"]));
    assert!(text.contains("2 cameras, 3 points, 6 observations"), "{text}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn invalid_files_are_reported() {
    let folder = folder("solve-wrong");
    let write = |name: &str, text: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    fails(&["solve", "graph", "/no/graph.g2o"], &["/no/graph.g2o"]);
    fails(&["solve", "graph", &write("bytes.g2o", b"VERTEX \xff\xfe")], &["bytes.g2o", "UTF-8"]);
    let short = write("short.g2o", b"VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 1 1 0\n");
    fails(&["solve", "graph", &short], &["short.g2o, line 2", "missing"]);
    let edges = write("edges.g2o", b"EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n");
    fails(&["solve", "graph", &edges, "--init", "file"], &["no vertices", "--init odometry"]);
    let loose = write("loose.g2o", b"EDGE_SE2 0 1 1 0 0 0 0 0 0 0 0\n");
    fails(&["solve", "graph", &loose, "--init", "chordal"], &["chordal", "--init odometry"]);
    fails(
        &["solve", "graph", &write("good.g2o", SQUARE.as_bytes()), "--out", "/no/folder/x"],
        &["/no/folder/x"],
    );
    let indefinite = write(
        "indefinite.g2o",
        b"EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 1 0 0 1 2 0 1 0 5\nEDGE_SE2 0 2 2 0 0 1 0 0 1 0 1\n",
    );
    fails(
        &["solve", "graph", &indefinite],
        &[
            "indefinite.g2o, line 2",
            "not positive semi-definite",
            "1 of the file's edges",
            "--information nearest",
        ],
    );
    let told = json(&cairn(&["solve", "graph", &indefinite, "--information", "nearest", "--json"]));
    assert_eq!((&told["information_replaced"], &told["stop"]), (&1.into(), &"converged".into()), "{told}");
    let lie = write("lie.txt", b"1 1 5\n0 0 1 2\n");
    fails(&["solve", "bundle", &lie], &["lie.txt, line 2", "missing"]);
    let flat = write("flat.txt", b"1 1 1\n0 0 1 2\n0 0 0 0 0 0 500 0 0\n1 2 0\n");
    fails(&["solve", "bundle", &flat], &["flat.txt", "not finite"]);
    std::fs::remove_dir_all(&folder).unwrap();
}
