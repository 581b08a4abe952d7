//! What a run did wrong, in sentences, the worst first: for the top of its result.

use super::text::plural;
use cairn_eval::RunReport;

/// One sentence for each problem; none where all is well.
pub fn of(r: &RunReport) -> Vec<String> {
    let mut all = Vec::new();
    let missing = r.frames.saturating_sub(r.tracked);
    if missing > 0 {
        let known = (r.skipped + r.dropped).min(missing);
        let parts = [(missing - known, "not tracked"), (r.dropped, "dropped"), (r.skipped, "skipped")];
        let parts: Vec<String> =
            parts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        let percent = 100.0 * missing as f64 / r.frames as f64;
        all.push(format!(
            "{missing} of {} frames ({percent:.1} %) have no pose: {}.",
            r.frames,
            parts.join(", ")
        ));
    }
    if let Some(first) = r.lost.first() {
        let times = if r.lost.len() == 1 { "once".to_owned() } else { format!("{} times", r.lost.len()) };
        all.push(format!("Tracking was lost {times}, first at {:.2} s: {}.", first.t, first.reason));
    }
    if r.maps > 1 {
        let apart = r.maps - 1;
        let maps = if apart == 1 { "map is".to_owned() } else { "maps are".to_owned() };
        all.push(format!(
            "{apart} {maps} not joined with the first: no place was recognised, so the pose between them is estimated."
        ));
    }
    if r.dropped > 0 {
        all.push(format!("Processing was slower than the camera: {} frames were dropped.", r.dropped));
    }
    if r.standing.imu.as_ref().is_some_and(|imu| !imu.initialised) {
        all.push("The IMU was never initialised: scale and gravity are not known from it.".to_owned());
    }
    for s in r.skips.iter().filter(|s| s.what != "frame") {
        let what = match s.what.as_str() {
            "other" => "The source reports".to_owned(),
            what => format!("{} {} skipped", s.count, plural(what, s.count)),
        };
        let detail = if s.what == "other" { &s.first } else { &s.reason };
        all.push(format!("{what}: {detail}."));
    }
    for s in r.skips.iter().filter(|s| s.what == "frame") {
        all.push(format!(
            "{} {} skipped: {}; the first: {}.",
            s.count,
            plural("frame", s.count),
            s.reason,
            s.first
        ));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_eval::{Lost, SkipReport};

    #[test]
    fn a_good_run_has_none() {
        let mut r = RunReport { maps: 1, ..RunReport::default() };
        r.set_frames(100, 100);
        assert!(of(&r).is_empty());
    }

    #[test]
    fn missing_frames_come_first_and_are_told_apart() {
        let mut r = RunReport { maps: 3, skipped: 2, dropped: 3, ..RunReport::default() };
        r.set_frames(100, 85);
        r.lost.push(Lost { t: 4.5, reason: "3 inlier matches, 15 are needed".into() });
        let skip = |what: &str| SkipReport {
            what: what.into(),
            reason: "why".into(),
            count: 2,
            first: "a.png".into(),
        };
        r.skips = vec![skip("frame"), skip("IMU reading")];
        let all = of(&r);
        assert_eq!(all[0], "15 of 100 frames (15.0 %) have no pose: 10 not tracked, 3 dropped, 2 skipped.");
        assert_eq!(all[1], "Tracking was lost once, first at 4.50 s: 3 inlier matches, 15 are needed.");
        assert!(all[2].starts_with("2 maps are not joined"), "{all:?}");
        assert!(all.contains(&"2 IMU readings skipped: why.".to_owned()), "{all:?}");
    }
}
