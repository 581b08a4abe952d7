//! `ost.txt` and `ost.ini` of ROS's calibration (`# oST version 5.0 parameters`): names, and the numbers in the lines below each.

use crate::text::{data_lines, fields};
use cairn_files::yaml::{Node, Value};

/// True when a text has its names.
pub fn is(text: &str) -> bool {
    let has = |name: &str| data_lines(text).any(|(_, line)| line == name);
    has("[image]") && has("camera matrix")
}

/// The same as in the YAML of `camera_info`. Of the two cameras of a pair the first, which is the left one.
pub fn root(text: &str) -> Node {
    let mut entries: Vec<(String, Node)> = Vec::new();
    for (line, content) in data_lines(text) {
        if fields(content).all(|word| word.parse::<f64>().is_ok()) {
            if let Some((_, Node { value: Value::List(items), .. })) = entries.last_mut() {
                let numbers =
                    fields(content).map(|word| Node { line, value: Value::Scalar(word.to_owned()) });
                items.extend(numbers);
            }
            continue;
        }
        let name = match content {
            "camera matrix" => "camera_matrix",
            "distortion" => "distortion_coefficients",
            "rectification" => "rectification_matrix",
            "projection" => "projection_matrix",
            name => name,
        };
        entries.push((name.to_owned(), Node { line, value: Value::List(Vec::new()) }));
    }
    // A single number is no list; four coefficients are those of a fisheye, a pinhole has at least five.
    let is_fisheye = |(name, node): &(String, Node)| {
        name == "distortion_coefficients" && node.list().is_some_and(|list| list.len() == 4)
    };
    let fisheye = entries.iter().find(|entry| is_fisheye(entry)).map(|(_, node)| node.line);
    for (_, node) in &mut entries {
        if let Some([one]) = node.list() {
            node.value = one.value.clone();
        }
    }
    entries.extend(fisheye.map(|line| {
        ("distortion_model".to_owned(), Node { line, value: Value::Scalar("equidistant".to_owned()) })
    }));
    Node { line: 1, value: Value::Map(entries) }
}
