//! `cairn config`.

use crate::binary::{cairn, fails, folder, json, stdout};

#[test]
fn config_prints_every_entry_with_comments_and_as_json() {
    let text = stdout(&cairn(&["config"]));
    let value = json(&cairn(&["config", "--json"]));
    let levels = &value["front_end"]["orb"]["levels"];
    assert!(
        text.contains(&format!("# Levels of the image pyramid (1 to 16).\nlevels = {levels}\n")),
        "{text}"
    );
    let entries = text.lines().filter(|l| !l.starts_with('#') && l.contains(" = ")).count();
    fn leaves(value: &serde_json::Value) -> usize {
        value.as_object().map_or(1, |o| o.values().map(leaves).sum())
    }
    assert_eq!(entries, leaves(&value));
    assert!(text.contains("\n[guide]\n") && text.contains("\nprogress_m = 10.0\n"), "{text}");
}

#[test]
fn a_wrong_entry_is_told_with_its_line_before_anything_is_read() {
    let folder = folder("config");
    let file = folder.join("cairn.toml");
    std::fs::write(&file, "[guide]\n\nahead_m = 3.0\n").unwrap();
    let file = file.to_str().unwrap();
    fails(&["run", "sim:hall", "--config", file], &["line 3", "there is guide.matcher.ahead_m"]);
}
