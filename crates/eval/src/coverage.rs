//! Coverage: the fraction of frames that have a pose. It is reported with every accuracy figure, since a system that
//! loses track in the difficult parts has small errors.

use cairn_geometry::associate;

/// The fraction of frames with a pose at most `max_difference_s` away in time: the coverage of a run, where the frames
/// are those of the source. Both lists must be sorted; 0 without frames.
pub fn coverage_of_frames(frames_ns: &[i64], estimate_ns: &[i64], max_difference_s: f64) -> f64 {
    if frames_ns.is_empty() {
        return 0.0;
    }
    let near =
        frames_ns.iter().filter(|stamp| !associate(&[**stamp], estimate_ns, max_difference_s).is_empty());
    near.count() as f64 / frames_ns.len() as f64
}

/// The fraction of the reference's poses that are near a pose of the estimate in time, for two trajectories of
/// different rates. Near means at most `max_difference_s`, or 0.6 of the estimate's median time step if that is more:
/// an estimate at 20 Hz fully covers a reference at 200 Hz, and reference poses in gaps or outside of the estimate
/// count as missing.
pub fn coverage_of_reference(reference_ns: &[i64], estimate_ns: &[i64], max_difference_s: f64) -> f64 {
    let mut steps: Vec<u64> = estimate_ns.windows(2).map(|w| w[1].abs_diff(w[0])).collect();
    steps.sort_unstable();
    let median_s = steps.get(steps.len() / 2).copied().unwrap_or(0) as f64 * 1e-9;
    coverage_of_frames(reference_ns, estimate_ns, max_difference_s.max(0.6 * median_s))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_and_ends_count_as_missing() {
        let reference: Vec<i64> = (0..1000).map(|i| i * 5).collect();
        let slow: Vec<i64> = (0..100).map(|i| i * 50).collect();
        assert!(coverage_of_reference(&reference, &slow, 1e-9) > 0.99);
        let half: Vec<i64> = (0..50).map(|i| i * 50).collect();
        assert!((coverage_of_reference(&reference, &half, 1e-9) - 0.5).abs() < 0.01);
        let with_gap: Vec<i64> = slow.iter().copied().filter(|s| !(1000..3000).contains(s)).collect();
        assert!((coverage_of_reference(&reference, &with_gap, 1e-9) - 0.6).abs() < 0.01);
        assert_eq!(coverage_of_frames(&slow, &half, 0.0), 0.5);
        assert_eq!(coverage_of_frames(&[], &half, 0.0), 0.0);
        assert_eq!(coverage_of_frames(&slow, &[], 0.0), 0.0);
    }
}
