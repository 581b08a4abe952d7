//! What a run did wrong, in sentences, the worst first: for the top of its result.

use super::text::plural;
use cairn_eval::{ImuSummary, RunReport, ScaleReport};

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
    let metres = r.scale.iter().find_map(wrong_metres);
    if r.standing.imu.as_ref().is_some_and(|imu| !imu.initialised) {
        let why = match metres {
            Some(_) => "its metres are not those of the map",
            None => "scale and gravity are not known from it",
        };
        all.push(format!("The IMU was never initialised: {why}."));
    }
    all.extend(r.standing.imu.as_ref().and_then(without_imu));
    all.extend(metres);
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

/// A stretch of metres that the ground truth or the IMU contradicts: depth, a baseline or the truth itself is in another unit, most
/// often by a plain factor.
fn wrong_metres(s: &ScaleReport) -> Option<String> {
    /// Errors of metres that are found are smaller, those of units larger.
    const LEAST: f64 = 1.25;
    /// How far a plain factor may be from what was measured.
    const NEAR: f64 = 0.08;
    /// Where both agree so well nobody has walked far enough to tell, metres.
    const NO_ERROR_M: f64 = 0.05;
    let of_truth = s.metres_per_unit.filter(|_| s.ate_m.is_some_and(|ate| ate > NO_ERROR_M));
    let (by, metres) = [("ground truth", of_truth), ("IMU", s.metres_by_imu)]
        .into_iter()
        .filter_map(|(by, metres)| Some((by, metres?)))
        .find(|(_, metres)| s.metric && metres.ln().abs() > LEAST.ln())?;
    let factor = metres.max(1.0 / metres);
    let plain =
        [2.0, 5.0, 10.0, 100.0, 1000.0].into_iter().find(|plain: &f64| (factor / plain).ln().abs() < NEAR);
    let times = plain.map_or_else(|| format!("{factor:.2}"), |plain| format!("{plain}"));
    let size = if metres > 1.0 { "small" } else { "large" };
    Some(format!(
        "By the {by} the map is {times} times too {size}: check the unit of depth (metres_per_unit of the rig) or the baseline."
    ))
}

/// That the readings of the IMU were not used for a while.
fn without_imu(imu: &ImuSummary) -> Option<String> {
    let first = imu.faults.first()?;
    let times = if imu.faults.len() == 1 { "once".to_owned() } else { format!("{} times", imu.faults.len()) };
    let ended = match imu.faults.iter().any(|f| f.until_s.is_none()) {
        true => "to the end",
        false => "until its readings agreed with the images again",
    };
    Some(format!(
        "The IMU was not used {times}, first from {:.2} s on, {ended}: {}.",
        first.from_s, first.words
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_eval::{ImuFaultSummary, Lost, SkipReport};

    #[test]
    fn metres_that_truth_or_imu_contradict_are_told_with_the_plain_factor() {
        let said = |scale: ScaleReport| of(&RunReport { scale: vec![scale], ..RunReport::default() });
        let metric = ScaleReport { metric: true, ..ScaleReport::default() };
        let of_truth =
            |metres| ScaleReport { metres_per_unit: Some(metres), ate_m: Some(0.3), ..metric.clone() };
        for (metres, words) in [
            (4.95, "By the ground truth the map is 5 times too small"),
            (0.0995, "By the ground truth the map is 10 times too large"),
            (1.52, "By the ground truth the map is 1.52 times too small"),
        ] {
            let all = said(of_truth(metres));
            assert!(all[0].starts_with(words) && all[0].contains("metres_per_unit"), "{all:?}");
        }
        let by_imu = ScaleReport { metres_by_imu: Some(5.1), ..of_truth(1.02) };
        assert!(said(by_imu)[0].starts_with("By the IMU the map is 5 times too small"));
        assert!(said(of_truth(1.1)).is_empty());
        assert!(said(ScaleReport { metric: false, ..of_truth(5.0) }).is_empty(), "a unit of its own");
    }

    #[test]
    fn an_imu_that_contradicts_the_metres_is_not_said_to_know_none() {
        let said = |metres_by_imu| {
            let scale = ScaleReport { metric: true, metres_by_imu, ..ScaleReport::default() };
            let mut r = RunReport { scale: vec![scale], ..RunReport::default() };
            r.standing.imu = Some(ImuSummary::default());
            of(&r)
        };
        let none = said(None);
        assert!(matches!(&none[..], [one] if one.contains("are not known from it")), "{none:?}");
        let other = said(Some(0.1));
        assert!(other[0].ends_with("its metres are not those of the map."), "{other:?}");
        assert!(other[1].starts_with("By the IMU the map is 10 times too large"), "{other:?}");
    }

    #[test]
    fn an_imu_that_failed_is_told() {
        let fault = |from_s, until_s| ImuFaultSummary { from_s, until_s, words: "why".into() };
        let told = |faults| without_imu(&ImuSummary { faults, ..ImuSummary::default() });
        assert_eq!(told(vec![]), None);
        assert_eq!(
            told(vec![fault(8.0, Some(9.5))]).as_deref(),
            Some(
                "The IMU was not used once, first from 8.00 s on, until its readings agreed with the images again: why."
            )
        );
        assert_eq!(
            told(vec![fault(8.0, Some(9.5)), fault(12.0, None)]).as_deref(),
            Some("The IMU was not used 2 times, first from 8.00 s on, to the end: why.")
        );
    }

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
