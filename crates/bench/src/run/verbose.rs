//! A frame of a run as lines on stderr.

use cairn_engine::{Engine, Output, StageEvent};

/// Prints a frame, its attempts to initialise the IMU, and its verdicts on loops and merges.
pub fn print(number: usize, out: &Output, engine: &Engine, step_error_m: f64) {
    let (map, seen) = (engine.snapshot(), out.evidence);
    eprintln!(
        "{number:4} {:?} features {} expected {} matched {} inliers {} key frames {}{}{} step error {step_error_m:.3} m",
        out.state,
        seen.features,
        seen.expected,
        seen.matched,
        seen.inliers,
        map.key_frame_count(),
        if out.timings.map_ms.is_empty() { "" } else { " +" },
        if out.is_metric() { " metric" } else { "" },
    );
    if let Some(check) = out.events.iter().find_map(StageEvent::scale_check) {
        eprintln!("{check:?}");
    }
    if let Some(attempt) = out.events.iter().find_map(StageEvent::attempt) {
        let gates: Vec<String> = attempt.failed().map(ToString::to_string).collect();
        let found = attempt.found.as_ref().map(|f| {
            (f.scale, f.scale_sigma, f.residual, f.bias, f.noise_times, f.offset_s, f.offset_sigma_s)
        });
        eprintln!("initialising: {} {found:?} clocks {:?}", gates.join("; "), map.imu_offset());
    }
    for verdict in out.verdicts() {
        match verdict.result {
            Ok(a) => eprintln!("closed {:?} with {:?}: {a:?}", verdict.key_frame, verdict.candidate),
            Err(why) => eprintln!("rejected {:?} with {:?}: {why}", verdict.key_frame, verdict.candidate),
        }
    }
}
