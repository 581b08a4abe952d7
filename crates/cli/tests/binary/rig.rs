//! `cairn rig check`.

use crate::{cairn, fails, folder, json, stderr, stdout};

const RIG: &str = r#"
[[cameras]]
name = "left"
resolution = [640, 480]
focal = [420.0, 420.0]
centre = [319.5, 239.5]
distortion = { model = "radial-tangential", coefficients = [-0.2, 0.05, 0.0, 0.0] }

[[cameras]]
resolution = [640, 480]
focal = [420.0, 420.0]
centre = [319.5, 239.5]
body_from_camera = { translation_m = [0.12, 0.0, 0.0] }
"#;

#[test]
fn rig_check_says_what_a_rig_is_and_writes_it_back() {
    let folder = folder("rig");
    let (path, copy) = (folder.join("rig.toml"), folder.join("copy.toml"));
    std::fs::write(&path, RIG).unwrap();
    let (path, copy) = (path.to_str().unwrap(), copy.to_str().unwrap());
    let text = cairn(&["rig", "check", path, "--write", copy]);
    assert_eq!(text.status.code(), Some(0), "{}", stderr(&text));
    assert!(stdout(&text).contains("baseline 0.1200 m"), "{}", stdout(&text));
    let first = json(&cairn(&["rig", "check", path, "--json"]));
    assert_eq!(first, json(&cairn(&["rig", "check", copy, "--json"])), "what was written is the same rig");
    assert_eq!(first["cameras"][0]["name"], "left");
    let degrees = first["cameras"][1]["field_of_view_deg"][0].as_f64().unwrap();
    assert!((degrees - 2.0 * (319.5f64 / 420.0).atan().to_degrees()).abs() < 1e-6, "{degrees}");
    assert!(first["cameras"][0]["round_trip_px"].as_f64().unwrap() < 1e-6);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn rig_check_refuses_what_can_not_be() {
    let folder = folder("rig-wrong");
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    fails(&["rig", "check", "/no/rig.toml"], &["/no/rig.toml"]);
    fails(&["rig", "check", folder.to_str().unwrap()], &["holds no rig"]);
    fails(
        &["rig", "check", &write("nan.toml", &RIG.replace("420.0, 420.0", "nan, 420.0"))],
        &["nan.toml", "NaN"],
    );
    fails(&["rig", "check", &write("line.toml", &RIG.replace("[319.5", "[;"))], &["line.toml, line 6"]);
    fails(&["rig", "check", &write("one.toml", &RIG.replace("0.12", "0.0"))], &["no baseline"]);
    let good = write("good.toml", RIG);
    let nowhere = folder.join("none/out.toml");
    fails(&["rig", "check", &good, "--write", nowhere.to_str().unwrap()], &["none/out.toml"]);
    assert_eq!(cairn(&["rig"]).status.code(), Some(2));
    std::fs::remove_dir_all(&folder).unwrap();
}
