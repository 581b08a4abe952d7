//! `cairn route`.

use crate::binary::{cairn, fails, folder, json, stderr, stdout};

/// A route east, into a dead end to the north and back, and on east, as `cairn run --record` writes it.
fn recorded_route() -> String {
    let leg =
        |n: i32, at: &dyn Fn(f64) -> [f64; 2]| (0..n).map(|i| at(0.1 * f64::from(i))).collect::<Vec<_>>();
    let mut line = leg(100, &|d| [d, 0.0]);
    line.extend(leg(40, &|d| [10.0, d]));
    line.extend(leg(40, &|d| [10.0, 4.0 - d]));
    line.extend(leg(60, &|d| [10.0 + d, 0.0]));
    line.extend(leg(50, &|d| [16.0, -d]));
    let header = r#"{"format":"cairn-way","version":1,"metric":true,"up":[0,0,1],"source":"a test"}"#;
    let mut text = format!("{header}\n");
    for (i, [x, y]) in line.iter().enumerate() {
        let (t, pose) = (i as i64 * 100_000_000, format!("[{x},{y},0,0,0,0,1]"));
        text += &format!(
            r#"{{"t":{t},"a":{{"robot":0,"seq":0}},"rel":{pose},"pose":{pose},"s":"tracked","q":1.0}}"#
        );
        text.push('\n');
    }
    text
}

#[test]
fn route_commands_show_the_effect_of_cleaning() {
    let folder = folder("route");
    let (route, picture) = (folder.join("walk.route"), folder.join("walk.svg"));
    std::fs::write(&route, recorded_route()).unwrap();
    let (route, picture) = (route.to_str().unwrap(), picture.to_str().unwrap());
    let info = json(&cairn(&["route", "info", route, "--json"]));
    assert!((info["length_m"].as_f64().unwrap() - 28.9).abs() < 0.2, "{info}");
    assert!((info["cleaned_m"].as_f64().unwrap() - 20.9).abs() < 0.5, "the dead end is cut out: {info}");
    let cleaned = json(&cairn(&["route", "clean", route, "--json"]));
    assert_eq!(cleaned["cuts"].as_array().unwrap().len(), 1, "{cleaned}");
    // The last corner turns right on the way out, so it turns left on the return.
    let home = cleaned["home"].as_array().unwrap();
    assert!(home.len() == 1 && (home[0]["turn_deg"].as_f64().unwrap() - 90.0).abs() < 10.0, "{cleaned}");
    let text = stdout(&cairn(&["route", "clean", route]));
    assert!(text.contains("deg left"), "{text}");
    let shown = cairn(&["route", "show", route, "--out", picture]);
    assert_eq!(shown.status.code(), Some(0), "{}", stderr(&shown));
    let svg = std::fs::read_to_string(picture).unwrap();
    assert!(svg.contains("<svg") && svg == stdout(&cairn(&["route", "show", route])));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn invalid_route_files_are_reported() {
    let folder = folder("route-wrong");
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let good = recorded_route();
    fails(&["route", "info", "/no/walk.route"], &["/no/walk.route"]);
    fails(&["route", "info", &write("empty.route", "")], &["empty.route", "not a recorded route"]);
    fails(
        &["route", "show", &write("other.route", "{\"a\": 1}\n")],
        &["other.route", "not a recorded route"],
    );
    fails(
        &["route", "clean", &write("broken.route", &good.replacen("\"t\":100000000,", "", 1))],
        &["broken.route, line 3"],
    );
    let still: String = good.lines().take(2).map(|line| format!("{line}\n")).collect();
    fails(&["route", "clean", &write("still.route", &still)], &["still.route", "at least 2"]);
    // A crash truncates at most the last line: that is reported, not an error.
    let torn = json(&cairn(&["route", "info", &write("torn.route", &good[..good.len() - 20]), "--json"]));
    assert_eq!(torn["torn"], true);
    std::fs::remove_dir_all(&folder).unwrap();
}
