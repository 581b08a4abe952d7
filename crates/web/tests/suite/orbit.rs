//! The camera of the page's map, run by Node where it is installed.

use std::path::Path;
use std::process::Command;

/// Looks along z in a camera's frame (right, down, forward), then from above; prints where a point on the right and one ahead are drawn.
const LOOK: &str = "
globalThis.matchMedia = () => ({ matches: true });
const { Orbit } = await import(process.argv[1]);
const canvas = { addEventListener() {}, clientWidth: 400, clientHeight: 400 };
const orbit = new Orbit(canvas, () => {}, () => ({}));
orbit.yaw = 0;
for (const pitch of [0, Math.PI / 2]) {
  Object.assign(orbit, { pitch, shown: null });
  orbit.aim([0, 0, 0], 10, [0, -1, 0]);
  const m = orbit.matrix;
  for (const p of [[1, 0, 0], [0, 0, 1]]) {
    const row = (k) => p[0] * m[k] + p[1] * m[4 + k] + p[2] * m[8 + k] + m[12 + k];
    console.log(row(0) / row(3), row(1) / row(3));
  }
}
// Walked ahead, what was ahead is in the middle.
Object.assign(orbit, { pitch: 0, yaw: 1, walked: [0, 0, 0] });
orbit.aim([0, 0, 0], 10, [0, -1, 0]);
for (let k = 0; k < 10; k += 1) orbit.walk(0, 0, 1);
console.log(...orbit.walked.map((v) => v.toFixed(4)));
";

#[test]
fn what_is_on_the_right_is_drawn_on_the_right() {
    let module = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/page/orbit.js");
    // As a module, whatever its ending.
    let copy = std::env::temp_dir().join(format!("cairn-orbit-{}.mjs", std::process::id()));
    std::fs::copy(&module, &copy).unwrap();
    let run = Command::new("node").args(["--input-type=module", "-e", LOOK]).arg(&copy).output();
    let _ = std::fs::remove_file(&copy);
    let Ok(run) = run else {
        println!("skipped: node is not installed");
        return;
    };
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let text = String::from_utf8(run.stdout).unwrap();
    let numbers = |line: &str| line.split(' ').map(|v| v.parse::<f64>().unwrap()).collect::<Vec<_>>();
    let lines: Vec<Vec<f64>> = text.lines().map(numbers).collect();
    let [right, ahead, right_below, ahead_below, walked] = &lines[..] else { panic!("{text}") };
    for point in [right, right_below] {
        assert!(point[0] > 0.05 && point[1].abs() < 1e-6, "to the right: {point:?}");
    }
    assert!(ahead[0].abs() < 1e-6 && ahead_below[0].abs() < 1e-6 && ahead_below[1] > 0.05, "{text}");
    // Half of what is seen, in the direction in which the view is turned.
    assert!((walked[0] - 5.0 * 1.0_f64.sin()).abs() < 1e-3 && (walked[1] - 5.0 * 1.0_f64.cos()).abs() < 1e-3);
}
