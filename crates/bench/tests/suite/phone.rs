//! A real phone that nobody calibrated (`data/phone`): one map, metres soon, clocks and lens.

use crate::scenarios::run;

#[test]
fn a_walk_with_a_real_phone_has_one_map_and_metres_within_five_seconds() {
    for f in run("phone", &[("recording", "phone/b"), ("start", "7")]) {
        assert!(f.coverage >= 0.98, "{}", f.coverage);
        assert_eq!((f.map.resets, f.map.maps), (0, 1));
        let (after_s, sigma) = (f.imu.metric_s.expect("metres"), f.imu.sigma[0].expect("a sigma"));
        assert!(after_s <= 5.0 && sigma <= 0.1, "after {after_s} s with {sigma}");
        assert!((f.imu.offset_ms - 37.0).abs() < 8.0, "{}", f.imu.offset_ms);
        assert!((f.map.focal_px / 505.0 - 1.0).abs() < 0.03, "{} px", f.map.focal_px);
    }
}
