//! `cairn plan`.

use crate::binary::{cairn, fails, folder, json, stdout};
use std::path::Path;

/// A room of 4 m x 3 m in cells of 0.1 m with a wall that leaves 1 m free, and the upper right corner unknown.
fn room(name: &str) -> String {
    let folder = folder(name);
    let mut image = b"P5\n40 30\n255\n".to_vec();
    for y in (0..30).rev() {
        for x in 0..40 {
            image.push(if x == 20 && y < 20 {
                0
            } else if x > 34 && y > 24 {
                205
            } else {
                254
            });
        }
    }
    std::fs::write(folder.join("room.pgm"), image).unwrap();
    let yaml = "image: room.pgm\nresolution: 0.1\norigin: [-1.0, -1.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";
    let file = folder.join("room.yaml");
    std::fs::write(&file, yaml).unwrap();
    file.to_str().unwrap().to_owned()
}

#[test]
fn a_path_around_a_wall_with_its_picture() {
    let map = room("plan");
    for kind in ["costs", "astar", "jump", "any-angle"] {
        let told = json(&cairn(&[
            "plan",
            &map,
            "--from",
            "-0.5,-0.5",
            "--to",
            "2.5,-0.5",
            "--search",
            kind,
            "--json",
        ]));
        let number = |key: &str| told[key].as_f64().unwrap();
        assert!((4.5..7.0).contains(&number("length_m")), "{kind}: {told}");
        assert!(
            number("clearance_m") >= 0.3 && number("expanded") > 0.0 && number("cost") > 0.0,
            "{kind}: {told}"
        );
        assert!(told["cells"].as_array().unwrap().len() >= 3);
    }
    for end in ["svg", "png"] {
        let out = folder("plan").join(format!("picture.{end}"));
        let out = out.to_str().unwrap();
        let arguments = ["plan", &map, "--from", "-0.5,-0.5", "--to", "2.5,-0.5", "--out", out];
        assert!(stdout(&cairn(&arguments)).contains("picture"));
        let bytes = std::fs::read(out).unwrap();
        assert!(bytes.starts_with(if end == "svg" { &b"<svg"[..] } else { b"\x89PNG" }));
        fails(&arguments, &["exists", "--overwrite"]);
        assert_eq!(cairn(&[&arguments[..], &["--overwrite"]].concat()).status.code(), Some(0));
    }
}

#[test]
fn no_path_says_why() {
    let map = room("plan-none");
    let from = ["plan", &map, "--from", "-0.5,-0.5"];
    for (to, more, words) in [
        ("1.05,0", &[][..], &["goal", "obstacle"][..]),
        ("2.9,1.9", &[], &["goal", "unknown"]),
        ("9,9", &[], &["goal", "outside"]),
        ("nan,0", &[], &["goal", "finite"]),
        ("2.5,-0.5", &["--radius", "0.7", "--from", "-0.1,0"], &["reached"]),
        ("2.5,-0.5", &["--radius=-1"], &["radius"]),
        ("2.5,-0.5", &["--out", "picture.gif"], &["svg"]),
    ] {
        let from = if more.contains(&"--from") { &from[..2] } else { &from[..] };
        fails(&[from, &["--to", to], more].concat(), words);
    }
    // A map of which nothing is known yet.
    let empty = room("plan-empty");
    std::fs::write(
        Path::new(&empty).with_file_name("room.pgm"),
        [b"P5\n40 30\n255\n", &[205u8; 1200][..]].concat(),
    )
    .unwrap();
    fails(&["plan", &empty, "--from", "0,0", "--to", "1,1"], &["free"]);
    fails(&["plan", "/nowhere/map.yaml", "--from", "0,0", "--to", "1,1"], &["nowhere"]);
    assert_eq!(cairn(&["plan", &map, "--from", "1", "--to", "2,2"]).status.code(), Some(2));
}
