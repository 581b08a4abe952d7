//! `cairn config`.

use crate::{cairn, json, stdout};

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
}
