//! The results as Markdown and CSV.

use super::Results;
use super::row::Row;
use std::fmt::Write;

/// The runs of one recording with one sensor, in order.
pub fn groups(runs: &[Row]) -> Vec<&[Row]> {
    runs.chunk_by(|a, b| (&a.sequence, a.sensor) == (&b.sequence, b.sensor)).collect()
}

/// The heads of the columns; the cells are those of [`cells`].
pub const HEADS: [&str; 12] = [
    "recording",
    "sensor",
    "ATE m",
    "alignment",
    "RPE mm",
    "coverage",
    "scale off %",
    "live ATE m",
    "live jump m",
    "step p50 / p99 ms",
    "processor s",
    "peak MB",
];

/// One line of the table: the median over the repeats, with the range where they differ.
pub fn cells(group: &[Row]) -> Vec<String> {
    let Some(first) = group.first() else { return Vec::new() };
    let failed = group.iter().filter(|r| r.failed.is_some()).count();
    let coverage = match failed {
        0 => spread(group, |r| r.coverage, 3),
        n => format!("{n} of {} failed", group.len()),
    };
    let p50 = spread(group, |r| r.step_p50_ms, 1);
    let p99 = spread(group, |r| r.step_p99_ms, 1);
    let align = group.iter().find_map(|r| r.align.clone()).unwrap_or_else(|| "-".into());
    vec![
        first.sequence.clone(),
        first.sensor.into(),
        spread(group, |r| r.ate_m, 4),
        align,
        spread(group, |r| r.rpe_m.map(|m| 1e3 * m), 2),
        coverage,
        spread(group, |r| r.scale_error_percent, 2),
        spread(group, |r| r.live_ate_m, 4),
        spread(group, |r| r.live_jump_m, 3),
        format!("{p50} / {p99}"),
        spread(group, |r| r.cpu_s, 1),
        spread(group, |r| r.peak_mb, 0),
    ]
}

/// The median of the values there are, and their range where it shows; "-" without any.
fn spread(group: &[Row], value: impl Fn(&Row) -> Option<f64>, decimals: usize) -> String {
    let mut values: Vec<f64> = group.iter().filter_map(value).collect();
    values.sort_by(f64::total_cmp);
    let (Some(low), Some(high)) = (values.first(), values.last()) else { return "-".into() };
    let text = |v: f64| format!("{v:.decimals$}");
    let middle = (values[(values.len() - 1) / 2] + values[values.len() / 2]) / 2.0;
    if text(*low) == text(*high) {
        text(middle)
    } else {
        format!("{} ({}-{})", text(middle), text(*low), text(*high))
    }
}

/// What the figures mean, for the foot of the table.
pub fn legend(results: &Results) -> String {
    let how = if results.realtime { "real time, threaded" } else { "lockstep" };
    let machine = results.processor.as_deref().unwrap_or("an unknown processor");
    format!(
        "Cairn {}, {how}, {machine}, {} cores. ATE is the RMSE of the final trajectory after alignment by SE3, or Sim3 where \
         lengths are not metres; RPE that from frame to frame. Coverage is the fraction of frames with a pose. Scale off: how \
         wrong metres are, or by how much the units of two stretches differ. Live: the poses as they were given at the time, \
         and the largest change of their error from one to the next. A step is from the decoded image to the pose. Where runs \
         were repeated: median (range).",
        results.version, results.cores
    )
}

/// The table in Markdown.
pub fn markdown(results: &Results) -> String {
    let mut text = format!("| {} |\n|{}\n", HEADS.join(" | "), "---|".repeat(HEADS.len()));
    for group in groups(&results.runs) {
        let _ = writeln!(text, "| {} |", cells(group).join(" | "));
    }
    let _ = writeln!(text, "\n{}", legend(results));
    let kitti: Vec<String> =
        kitti(&results.runs).iter().map(|c| format!("| {} |\n", c.join(" | "))).collect();
    if !kitti.is_empty() {
        let _ = write!(text, "\n| {} |\n|---|---|---|---|\n{}", KITTI_HEADS.join(" | "), kitti.concat());
    }
    for run in results.runs.iter().filter(|r| r.failed.is_some()) {
        let _ = writeln!(text, "\n{}", run.line());
    }
    text
}

/// The heads of the table of KITTI's metric.
pub const KITTI_HEADS: [&str; 4] = ["recording", "sensor", "KITTI %", "deg / 100 m"];

/// KITTI's own metric, for the recordings that are long enough.
pub fn kitti(runs: &[Row]) -> Vec<Vec<String>> {
    let long = |group: &&[Row]| group.iter().any(|r| r.kitti_percent.is_some());
    let cells = |group: &[Row]| {
        let (name, sensor) = group.first().map_or((String::new(), ""), |r| (r.sequence.clone(), r.sensor));
        let errors = [spread(group, |r| r.kitti_percent, 3), spread(group, |r| r.kitti_deg_per_100m, 3)];
        [name, sensor.to_owned()].into_iter().chain(errors).collect()
    };
    groups(runs).into_iter().filter(long).map(cells).collect()
}

/// One line for each run; a figure that is missing is an empty field.
pub fn csv(runs: &[Row]) -> String {
    let mut text = String::from(
        "sequence,sensor,repeat,frames,coverage,align,ate_m,rpe_m,scale_error_percent,live_ate_m,live_jump_m,\
         kitti_percent,kitti_deg_per_100m,losses,maps,loops,dropped,step_p50_ms,step_p99_ms,cpu_s,wall_s,peak_mb,failed\n",
    );
    for r in runs {
        let n = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
        let fields = [
            quoted(&r.sequence),
            r.sensor.into(),
            r.repeat.to_string(),
            r.frames.to_string(),
            n(r.coverage),
            r.align.clone().unwrap_or_default(),
            n(r.ate_m),
            n(r.rpe_m),
            n(r.scale_error_percent),
            n(r.live_ate_m),
            n(r.live_jump_m),
            n(r.kitti_percent),
            n(r.kitti_deg_per_100m),
            r.losses.to_string(),
            r.maps.to_string(),
            r.loops.to_string(),
            r.dropped.to_string(),
            n(r.step_p50_ms),
            n(r.step_p99_ms),
            n(r.cpu_s),
            n(r.wall_s),
            n(r.peak_mb),
            quoted(r.failed.as_deref().unwrap_or_default()),
        ];
        text += &fields.join(",");
        text.push('\n');
    }
    text
}

/// A field of a CSV file (RFC 4180).
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeats_show_their_median_and_range() {
        let row = |ate_m| Row { ate_m, ..Row::default() };
        let of = |values: &[Option<f64>]| {
            spread(&values.iter().map(|v| row(*v)).collect::<Vec<_>>(), |r| r.ate_m, 2)
        };
        assert_eq!(of(&[Some(0.101), Some(0.102)]), "0.10");
        assert_eq!(of(&[Some(0.3), Some(0.1), None, Some(0.2)]), "0.20 (0.10-0.30)");
        assert_eq!(of(&[None]), "-");
    }

    #[test]
    fn fields_with_commas_and_quotes_are_quoted() {
        assert_eq!(quoted("a, \"b\""), "\"a, \"\"b\"\"\"");
        assert_eq!(quoted("plain"), "plain");
    }
}
