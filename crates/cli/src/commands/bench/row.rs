//! The figures of one run.

use super::plan::Task;
use serde::Serialize;
use serde_json::Value;

/// One run; a figure that it does not have is `None`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Row {
    pub sequence: String,
    pub sensor: &'static str,
    pub repeat: u16,
    /// The folder of its files below `runs`.
    pub folder: String,
    /// Why it failed.
    pub failed: Option<String>,
    pub frames: usize,
    /// Fraction of the frames with a pose.
    pub coverage: Option<f64>,
    /// `se3`, or `sim3` where lengths are not metres.
    pub align: Option<String>,
    /// RMSE of the final trajectory, metres.
    pub ate_m: Option<f64>,
    /// RMSE from one frame to the next, metres.
    pub rpe_m: Option<f64>,
    /// By how much lengths are wrong, percent, as if all lengths were metres; for those without metres the largest
    /// difference between two stretches of one unit.
    pub scale_error_percent: Option<f64>,
    /// RMSE of the poses as they were given live, metres.
    pub live_ate_m: Option<f64>,
    /// Largest change of the live error from one pose to the next, metres.
    pub live_jump_m: Option<f64>,
    /// Drift over segments of 100 to 800 m as in the KITTI benchmark, percent.
    pub kitti_percent: Option<f64>,
    pub kitti_deg_per_100m: Option<f64>,
    pub losses: usize,
    pub maps: usize,
    pub loops: usize,
    pub dropped: usize,
    /// Decoded image to pose, milliseconds.
    pub step_p50_ms: Option<f64>,
    pub step_p99_ms: Option<f64>,
    /// Processor time of all threads, seconds.
    pub cpu_s: Option<f64>,
    pub wall_s: Option<f64>,
    pub peak_mb: Option<f64>,
}

impl Row {
    fn new(task: &Task) -> Self {
        Self {
            sequence: task.sequence.clone(),
            sensor: task.sensor.name(),
            repeat: task.repeat,
            folder: task.folder(),
            ..Self::default()
        }
    }

    /// A run that failed.
    pub fn failed(task: &Task, why: String) -> Self {
        Self { failed: Some(why), ..Self::new(task) }
    }

    /// From the report that `cairn run --report` writes.
    pub fn read(task: &Task, report: &str) -> Self {
        let Ok(r) = serde_json::from_str::<Value>(report) else {
            return Self::failed(task, "its report is no JSON".into());
        };
        let number = |path: &str| r.pointer(path).and_then(Value::as_f64);
        let count = |path: &str| r.pointer(path).and_then(Value::as_u64).unwrap_or(0) as usize;
        Self {
            frames: count("/frames"),
            coverage: number("/coverage"),
            align: r.pointer("/accuracy/align").and_then(Value::as_str).map(str::to_owned),
            ate_m: number("/accuracy/ate_m/rmse"),
            rpe_m: number("/accuracy/rpe_m/rmse"),
            scale_error_percent: scale_error(&r),
            live_ate_m: number("/live/ate_m"),
            live_jump_m: number("/live/jump_max_m"),
            kitti_percent: number("/accuracy/kitti/translation_percent"),
            kitti_deg_per_100m: number("/accuracy/kitti/rotation_deg_per_100m"),
            losses: r.pointer("/lost").and_then(Value::as_array).map_or(0, Vec::len),
            maps: count("/maps"),
            loops: count("/loops"),
            dropped: count("/dropped"),
            step_p50_ms: number("/ms/p50"),
            step_p99_ms: number("/ms/p99"),
            cpu_s: number("/cpu_s"),
            wall_s: number("/wall_s"),
            peak_mb: number("/peak_rss_mb"),
            ..Self::new(task)
        }
    }

    /// One line for people.
    pub fn line(&self) -> String {
        let name = format!("{} {}", self.sequence, self.sensor);
        if let Some(why) = &self.failed {
            return format!("{name}: failed: {why}");
        }
        let ate = self.ate_m.map_or("no truth".into(), |m| format!("ATE {m:.4} m"));
        let coverage = self.coverage.map_or(String::new(), |c| format!(", coverage {c:.3}"));
        let wall = self.wall_s.map_or(String::new(), |s| format!(", {s:.0} s"));
        format!("{name}: {ate}{coverage}{wall}")
    }
}

/// By how much the lengths of the stretches differ from metres, or from each other, in percent.
fn scale_error(report: &Value) -> Option<f64> {
    let stretches: Vec<(bool, f64)> = report
        .get("scale")?
        .as_array()?
        .iter()
        .filter_map(|s| Some((s.get("metric")?.as_bool()?, s.get("metres_per_unit")?.as_f64()?)))
        .filter(|(_, unit)| unit.is_finite() && *unit > 0.0)
        .collect();
    let units = || stretches.iter().map(|(_, unit)| *unit);
    if stretches.is_empty() {
        return None;
    }
    if stretches.iter().all(|(metric, _)| *metric) {
        return units().map(|u| 100.0 * (1.0 / u - 1.0).abs()).max_by(f64::total_cmp);
    }
    let (low, high) = units().fold((f64::INFINITY, 0.0f64), |(l, h), u| (l.min(u), h.max(u)));
    (stretches.len() > 1).then_some(100.0 * (high / low - 1.0))
}
