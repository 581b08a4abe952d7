//! Limits for initialisation and drift on real IMU data, 10 % above today's figures, at all starts of two recordings;
//! docs/figures/inertial.md has the full table.

use bench::data_folder;
use bench::inertial::{Chosen, Figures, run};

/// The figures of a recording; prints "skipped" if it is missing.
fn figures(recording: &str, condition: &str, every: usize) -> Option<Figures> {
    let chosen = Chosen { recording: Some(recording), condition: Some(condition), every };
    let found = run(&data_folder(), &chosen).expect("the recording is read").pop();
    if found.is_none() {
        println!("skipped: imu-truth/{recording} is not in {}", data_folder().display());
    }
    found
}

/// Checks limits: share accepted; scale error in percent at first and at 15 s (medians); gravity in degrees (median).
fn check(f: &Figures, accepted: f64, scale: [f64; 2], gravity: f64) {
    for t in &f.tries {
        println!("{}: {t:?}", f.name);
        assert!(
            t.starts >= 4 && t.accepted as f64 >= accepted * t.starts as f64,
            "{} of {}",
            t.accepted,
            t.starts
        );
        assert!(
            t.scale_percent[0][0] <= scale[0] && t.scale_percent[2][0] <= scale[1],
            "{:?}",
            t.scale_percent
        );
        assert!(t.gravity_deg[0] <= gravity, "{:?}", t.gravity_deg);
    }
}

#[test]
fn initialisation_on_a_quadrotor() {
    let Some(f) = figures("V1_02", "0.1 deg", 1) else { return };
    check(&f, 1.0, [2.1, 1.43], 0.519);
    let second = &f.drift[0];
    println!("{second:?}");
    assert!(second.place_m[0] < 0.025 && second.turn_deg[0] < 0.0864, "{second:?}");
}

#[test]
fn initialisation_handheld_with_lost_samples() {
    let Some(f) = figures("tumvi_room1", "1 % lost", 1) else { return };
    check(&f, 0.95, [0.517, 0.384], 0.323);
}

#[test]
fn time_offset_of_20_ms_is_estimated_within_a_millisecond() {
    let Some(f) = figures("V1_02", "20 ms, found first", 1) else { return };
    for t in &f.tries {
        assert!(
            t.offsets == t.starts && t.offset_ms[0] < 0.316 && t.offset_ms[1] < 0.873,
            "{:?}",
            t.offset_ms
        );
    }
    check(&f, 1.0, [1.78, 1.37], 0.541);
}

#[test]
fn real_imu_data_raise_no_warnings() {
    for name in bench::inertial::data::NAMES {
        if !data_folder().join("imu-truth").join(name).exists() {
            println!("skipped: imu-truth/{name} is not in {}", data_folder().display());
            continue;
        }
        let motion = bench::inertial::data::ImuRecording::read(&data_folder(), name).expect("it is read");
        let readings = cairn_inertial::Readings::of(&motion.samples, &motion.sensor);
        println!("{name}: {readings:?}");
        assert_eq!(readings.doubts(&motion.sensor), [], "{name}: {readings:?}");
    }
}
