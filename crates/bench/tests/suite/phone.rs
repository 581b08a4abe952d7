//! A real phone that nobody calibrated (`data/phone`): one map, metres soon, clocks and lens.

use bench::phone::{Chosen, Figures, run};
use bench::recordings::data_folder;

/// The figures of a recording from this second on; `None` where it is not there.
fn figures(recording: &str, start_s: u32) -> Option<Figures> {
    let data = data_folder();
    if !data.join(recording).exists() {
        println!("skipped: {recording} is not in {}", data.display());
        return None;
    }
    let chosen = Chosen { only: Some(recording.to_owned()), starts: vec![start_s], ..Chosen::default() };
    run(&data, &chosen).expect("the engine runs").pop()
}

#[test]
fn a_walk_with_a_real_phone_has_one_map_and_metres_within_five_seconds() {
    let Some(f) = figures("phone/b", 7) else { return };
    assert!(f.coverage >= 0.98, "{}", f.coverage);
    assert_eq!(f.maps, [1, 1]);
    let (after_s, sigma) = f.metric.expect("metres");
    assert!(after_s <= 5.0 && sigma <= 0.1, "after {after_s} s with {sigma}");
    assert!((f.offset_s - 0.037).abs() < 0.008, "{}", f.offset_s);
    let focal = f.focal[0].expect("a camera");
    assert!((focal / 505.0 - 1.0).abs() < 0.03, "{focal} px");
}
