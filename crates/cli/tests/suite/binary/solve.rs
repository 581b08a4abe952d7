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
    // Along x alone: the angles follow from nothing.
    let loose = write("loose.g2o", b"EDGE_SE2 0 1 1 0 0 1 0 0 0 0 0\nEDGE_SE2 1 2 1 0 0 0 0 0 0 0 1\n");
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

/// A file of the shared cases; says "skipped" where they are missing.
fn case(name: &str) -> Option<String> {
    let folder = std::env::var("CAIRN_CASES")
        .unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/cases").into());
    let path = std::path::Path::new(&folder).join(name);
    if path.exists() {
        return Some(path.to_str().unwrap().to_owned());
    }
    println!("skipped: {} is missing", path.display());
    None
}

#[test]
fn nothing_of_a_graph_is_left_out_in_silence() {
    let folder = folder("solve-unknown");
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let odd = write("odd.g2o", &format!("{SQUARE}EDGE_RANGE_SE2 0 1 1 5\nEDGE_RANGE_SE2 1 2 1 5\n"));
    fails(&["solve", "graph", &odd], &["EDGE_RANGE_SE2 (2 lines)", "--ignore-unknown"]);
    let out = folder.join("out.g2o");
    let all = ["solve", "graph", &odd, "--ignore-unknown", "--json", "--out", out.to_str().unwrap()];
    assert_eq!(json(&cairn(&all))["unknown"]["EDGE_RANGE_SE2"], 2);
    assert!(std::fs::read_to_string(&out).unwrap().contains("EDGE_RANGE_SE2 1 2 1 5"), "it is still there");
    fails(&["team", "graph", &odd, "--robots", "2"], &["EDGE_RANGE_SE2", "--ignore-unknown"]);
    assert_eq!(
        json(&cairn(&["team", "graph", &odd, "--robots", "2", "--ignore-unknown", "--json"]))["poses"],
        4
    );
    let tutorial =
        write("tutorial.g2o", &SQUARE.replace("VERTEX", "TUTORIAL_VERTEX").replace("EDGE", "TUTORIAL_EDGE"));
    fails(&["solve", "graph", &tutorial], &["without an edge", "TUTORIAL_EDGE_SE2 (4 lines)"]);
    let toro = write("toro.graph", "VERTEX2 0 0 0 0\nVERTEX2 1 1.1 0 0\nEDGE2 0 1 1 0 0 1 0 1 1 0 0\n");
    let done = cairn(&["solve", "graph", &toro, "--json"]);
    assert!(json(&done)["chi2_after"].as_f64().is_some_and(|chi2| chi2 < 1e-9), "{}", stdout(&done));
    let told = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(told.contains("read as TORO's, its numbers as information matrices"), "{told}");
    assert_eq!(json(&cairn(&["team", "graph", &toro, "--robots", "2", "--json"]))["poses"], 2);
    let short = write("short.graph", "VERTEX2 0 0 0 0\nEDGE2 0 1 1 0 0 1 0\n");
    fails(&["solve", "graph", &short], &["short.graph, line 2", "EDGE2 needs 3 or 9 numbers"]);
    fails(&["team", "graph", &short, "--robots", "2"], &["line 2", "EDGE2 needs 3 or 9 numbers"]);
    // Two squares that nothing connects, the second far away by its numbers only.
    let second: String = SQUARE.replace("SE2 ", "SE2 1").lines().map(|l| format!("{l}\n")).collect();
    let second: String = second
        .lines()
        .map(|line| {
            let words: Vec<&str> = line.split(' ').collect();
            match words[0] {
                "EDGE_SE2" => format!("EDGE_SE2 {} 1{} {}\n", words[1], words[2], words[3..].join(" ")),
                _ => format!("{line}\n"),
            }
        })
        .collect();
    let two = write("two.g2o", &format!("{SQUARE}{second}"));
    let told = json(&cairn(&["solve", "graph", &two, "--json"]));
    assert_eq!((&told["parts"], &told["vertices"]), (&2.into(), &8.into()), "{told}");
    let text = stdout(&cairn(&["solve", "graph", &two]));
    assert!(text.contains("no measurement connects the 2 parts"), "{text}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn cases_of_graphs_end_as_they_should() {
    let (Some(land), Some(truth)) =
        (case("03-g2o-landmarks-2d/land.g2o"), case("03-g2o-landmarks-2d/truth.txt"))
    else {
        return;
    };
    let out = folder("solve-cases").join("out.g2o");
    let written = out.to_str().unwrap();
    let solved = json(&cairn(&["solve", "graph", &land, "--json", "--out", written]));
    assert_eq!(
        (&solved["edges"], &solved["points"], &solved["parts"]),
        (&77.into(), &5.into(), &1.into()),
        "{solved}"
    );
    // With all 77 measurements the last pose is within centimetres of the truth; by odometry alone it is not.
    let last = |text: &str, tag: &str| -> Vec<f64> {
        let line = text.lines().rfind(|l| l.starts_with(tag)).unwrap();
        line.trim_start_matches(tag).split_whitespace().map(|w| w.parse().unwrap()).collect()
    };
    let truth = last(&std::fs::read_to_string(truth).unwrap(), "");
    let found = last(&std::fs::read_to_string(&out).unwrap(), "VERTEX_SE2 23");
    let off = (found[0] - truth[1]).hypot(found[1] - truth[2]);
    println!("case 03: the last pose is {off:.3} m off");
    assert!(off < 0.2, "{off} m");
    for (name, parts) in [
        ("02-g2o-prior/prior.g2o", 1),
        ("04-g2o-trackxyz/known3.g2o", 1),
        ("09-g2o-zero-information/zero.g2o", 1),
        ("09-g2o-zero-information/zero-bridge.g2o", 2),
        ("11-g2o-disconnected/two.g2o", 2),
        ("11-g2o-disconnected/two-fix.g2o", 2),
        ("11-g2o-disconnected/edges-only.g2o", 2),
        ("11-g2o-disconnected/isolated.g2o", 2),
        ("15-g2o-text-odd/bom.g2o", 1),
        ("15-g2o-text-odd/utf16.g2o", 1),
        ("15-g2o-text-odd/crlf-tab.g2o", 1),
        ("15-g2o-text-odd/comment-end.g2o", 1),
    ] {
        let solved = json(&cairn(&["solve", "graph", &case(name).unwrap(), "--json"]));
        println!("case {name}: {} parts, chi2 {}", solved["parts"], solved["chi2_after"]);
        assert_eq!(solved["parts"], parts, "{name}: {solved}");
        let without = match name {
            "09-g2o-zero-information/zero.g2o" => 1,
            "09-g2o-zero-information/zero-bridge.g2o" => 2,
            _ => 0,
        };
        assert_eq!(solved["without_information"], without, "{name}: {solved}");
        let edges = solved["edges"].as_u64().unwrap() - without;
        assert!(solved["inliers"].as_u64().unwrap() <= edges, "{name}: {solved}");
    }
    let zero = stdout(&cairn(&["solve", "graph", &case("09-g2o-zero-information/zero.g2o").unwrap()]));
    assert!(zero.contains("1 of the 20 edges have zero information"), "{zero}");
    let tags = case("15-g2o-text-odd/blank-tag.g2o").unwrap();
    fails(&["solve", "graph", &tags], &["EDGE_SE3 (20 lines)"]);
    fails(&["solve", "graph", &case("05-g2o-tutorial-tags/tutorial.g2o").unwrap()], &["TUTORIAL_"]);
    let robots = case("13-team-distributed-mapper-8/two").unwrap();
    let team = json(&cairn(&["team", "graph", &robots, "--json"]));
    assert_eq!((&team["unsupported"], team["frames"].as_array().unwrap().len()), (&2.into(), 2), "{team}");
    let text = stdout(&cairn(&["team", "graph", &robots]));
    assert!(text.contains("fewer than 3") && text.contains("poses of one mean nothing"), "{text}");
    for problem in [
        "20-bal/problem.txt.gz",
        "20-bal/problem.txt.bz2",
        "21-bundler-out/Balbianello.out",
        "19-bom-everywhere/bal.txt",
    ] {
        let solved = json(&cairn(&["solve", "bundle", &case(problem).unwrap(), "--json"]));
        assert!(solved["rms_after_px"].as_f64() <= solved["rms_before_px"].as_f64(), "{problem}: {solved}");
    }
    let colmap = case("22-colmap-model").unwrap();
    fails(&["solve", "bundle", &colmap], &["COLMAP", "model_converter"]);
    fails(&["solve", "bundle", &format!("{colmap}/cameras.txt")], &["COLMAP"]);
}
