//! The camera is covered around a corner: a new map begins, and the maps merge when a place is recognised again.

use crate::scenarios::run;

#[test]
fn maps_merge_after_a_covered_camera() {
    let dark = [("trial", "dark"), ("seed", "4"), ("sensors", "mono")];
    for row in run("revisit", &dark) {
        assert_eq!((row.map.maps, row.map.merges), (1, 1));
        assert!(row.ate_m.is_some_and(|ate| ate < 0.036), "{:?}", row.ate_m);
        assert!(row.coverage > 0.945, "{}", row.coverage);
    }
}
