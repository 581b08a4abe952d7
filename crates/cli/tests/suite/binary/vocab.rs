//! `cairn vocab`.

use crate::binary::{cairn, folder, json, stderr, stdout};

#[test]
fn vocab_training_is_deterministic() {
    let folder = folder("vocab-train");
    let path = |name: &str| folder.join(name).display().to_string();
    let images = path("images");
    let made = cairn(&["sim", "corridor?duration=1&rate=6&detail=0.2&sensor=mono", "--out", &images]);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let train = |out: &str, seed: &str| {
        let out = path(out);
        let shape = ["--branching", "6", "--depth", "3", "--seed", seed];
        cairn(&[&["vocab", "train", &images, "--out", &out, "--json"][..], &shape].concat())
    };
    let result = json(&train("a.voc", "4"));
    assert_eq!(result["images"].as_u64(), Some(7));
    assert!(result["descriptors"].as_u64() > Some(1000), "{result}");
    assert!(result["words"].as_u64() > Some(100) && result["depth"] == 3, "{result}");
    train("b.voc", "4");
    train("c.voc", "5");
    let bytes = |name: &str| std::fs::read(path(name)).unwrap();
    assert_eq!(bytes("a.voc"), bytes("b.voc"));
    assert_ne!(bytes("a.voc"), bytes("c.voc"));

    let info = json(&cairn(&["vocab", "info", &path("a.voc"), "--json"]));
    assert_eq!(info["checksum"], result["checksum"]);
    let mut broken = bytes("a.voc");
    broken[2000] ^= 1;
    std::fs::write(path("broken.voc"), broken).unwrap();
    let failed = cairn(&["vocab", "info", &path("broken.voc")]);
    assert_eq!(failed.status.code(), Some(1));
    assert!(stderr(&failed).contains("damaged"), "{}", stderr(&failed));
}

#[test]
fn vocab_info_without_a_file_shows_the_built_in_one() {
    let text = stdout(&cairn(&["vocab", "info"]));
    assert!(text.contains("words") && text.contains("trained on"), "{text}");
}

#[test]
fn vocab_import_reads_dbow2_and_reports_the_invalid_line() {
    let folder = folder("vocab-import");
    let (text, out) = (folder.join("v.txt"), folder.join("v.voc"));
    let arguments = ["vocab", "import", text.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json"];
    let line = |parent: u32, leaf: u32, byte: u8, weight: f64| {
        format!("{parent} {leaf} {}{weight}\n", format!("{byte} ").repeat(32))
    };
    let good = [
        "2 2 0 0\n".to_string(),
        line(0, 0, 0, 0.0),
        line(0, 1, 255, 1.5),
        line(1, 1, 1, 0.5),
        line(1, 1, 3, 2.0),
    ];
    std::fs::write(&text, good.concat()).unwrap();
    let result = json(&cairn(&arguments));
    assert_eq!(
        (result["words"].as_u64(), result["nodes"].as_u64(), result["depth"].as_u64()),
        (Some(3), Some(5), Some(2))
    );
    assert_eq!(
        json(&cairn(&["vocab", "info", out.to_str().unwrap(), "--json"]))["checksum"],
        result["checksum"]
    );

    std::fs::remove_file(&out).unwrap();
    std::fs::write(&text, good[..4].concat() + "1 1 300\n").unwrap();
    let failed = cairn(&arguments);
    assert_eq!(failed.status.code(), Some(1));
    assert!(stderr(&failed).contains("line 5") && stderr(&failed).contains("300"), "{}", stderr(&failed));
    assert!(!out.exists(), "an incomplete file was left behind");
}
