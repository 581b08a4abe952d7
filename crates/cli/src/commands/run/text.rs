//! The result of a run as a table for people.

use super::outcome::Outcome;
use super::truth::JUMP_M;
use crate::style::{self, Paint};
use cairn_engine::Phase;
use cairn_eval::{Align, RunReport};
use std::fmt::Write;

/// Metres, and how well they are known.
pub fn metres(sigma_log: Option<f64>) -> String {
    sigma_log.map_or_else(|| "metres".to_owned(), |sigma| format!("metres, to {:.1} %", 100.0 * sigma))
}

/// The name of one or several of a kind.
pub fn plural(what: &str, count: usize) -> String {
    if count == 1 || what == "other" { what.to_owned() } else { format!("{what}s") }
}

/// The report as a table for people.
pub fn of(ended: &Outcome, realtime: bool) -> String {
    let r = &ended.report;
    let mut text = String::new();
    // Writing to a string cannot fail.
    if ended.interrupted {
        let _ = writeln!(text, "ended     interrupted; everything until then is written");
    }
    for problem in &ended.problems {
        let _ = writeln!(text, "{} {problem}", style::on_stdout(Paint::Doubtful, "problem  "));
    }
    let _ = writeln!(text, "source    {}, {}", r.source, r.sensor);
    let dropped = if realtime { format!(", {} dropped", r.dropped) } else { String::new() };
    let _ = writeln!(
        text,
        "frames    {}, {} tracked (coverage {:.3}), {} skipped{dropped}",
        r.frames, r.tracked, r.coverage, r.skipped
    );
    let _ = writeln!(
        text,
        "map       {} key frames, {} landmarks, {} maps, {} loops, {} merges",
        r.keyframes, r.landmarks, r.maps, r.loops, r.merges
    );
    if let Some(s) = &ended.searches {
        let _ = writeln!(
            text,
            "by depth  {} looks while lost, {} refused; {} places not confirmed, {} found, {} gone on from",
            s.attempts,
            s.refused.all(),
            s.not_followed + s.not_confirmed,
            s.found,
            s.taken
        );
    }
    for s in r.skips.iter().filter(|s| s.what != "other") {
        let _ = writeln!(text, "skipped   {} {}: {}", s.count, plural(&s.what, s.count), s.reason);
    }
    if let Some(ms) = &r.ms {
        let _ = writeln!(text, "step      {ms} ms");
    }
    for (name, ms) in &r.stages.0 {
        let _ = writeln!(text, "  {name:<8}{ms} ms");
    }
    let number = |v: Option<f64>, unit: &str| v.map_or("unknown".into(), |v| format!("{v:.2} {unit}"));
    let _ = writeln!(
        text,
        "cost      first pose after {}, {:.2} s in total, {} of CPU time, peak memory {}",
        number(r.first_pose_s, "s"),
        r.wall_s,
        number(r.cpu_s, "s"),
        number(r.peak_rss_mb, "MB"),
    );
    if let Some(e) = &r.accuracy {
        let align = match e.align {
            Align::Sim3 => format!("Sim3, scale {:.4}", e.scale),
            _ => "SE3".into(),
        };
        let _ = writeln!(
            text,
            "truth     ATE {:.4} m RMSE ({align}) over {:.2} m, {} pairs, max {:.4} m",
            e.ate_m.rmse, e.path_m, e.pairs, e.ate_m.max
        );
    }
    if let Some(live) = &r.live {
        let _ = writeln!(
            text,
            "live      ATE {:.4} m; error changes by at most {:.3} m from pose to pose (p99 {:.4} m, {} above {JUMP_M} m)",
            live.ate_m, live.jump_max_m, live.jump_p99_m, live.jumps
        );
    }
    for s in r.scale.iter().filter(|_| r.scale.len() > 1 || r.scale.iter().any(|s| !s.metric)) {
        let known = match (s.metric, s.sigma_log) {
            (true, _) => metres(s.metres_sigma_log),
            (false, sigma) if sigma > 0.0 => {
                format!("unit of its own, known to {:.0} % by the pace", 100.0 * sigma)
            }
            _ => "unit of its own".to_owned(),
        };
        let against = s.ate_m.zip(s.metres_per_unit);
        let against = against
            .map_or_else(String::new, |(ate, m)| format!("; ATE {ate:.4} m, {m:.4} m per unit by the truth"));
        let _ =
            writeln!(text, "scale     {:.2} to {:.2} s, map {}: {known}{against}", s.from_s, s.to_s, s.map);
    }
    text += &status(r);
    for lost in &r.lost {
        let _ = writeln!(text, "lost      at {:.3} s: {}", lost.t, lost.reason);
    }
    for d in ended.processes.iter().flat_map(|p| &p.deaths) {
        let _ = writeln!(text, "died      {} at frame {}: {}", d.process, d.at_frame, d.why);
    }
    text
}

/// The lines on phases and the IMU.
fn status(r: &RunReport) -> String {
    let in_order = Phase::ALL.iter().filter_map(|p| Some((p, r.standing.seconds.get(p.name())?)));
    let phases: Vec<String> = in_order.map(|(phase, s)| format!("{phase} {s:.2} s")).collect();
    let mut text = match phases.is_empty() {
        true => String::new(),
        false => format!("phases    {}\n", phases.join(", ")),
    };
    if let Some(imu) = &r.standing.imu {
        let metric = r.standing.first_metric_pose_s;
        let first = metric.map_or("no metric pose".into(), |s| format!("metric after {s:.2} s"));
        let (synthesised, gaps) = (imu.synthesised, imu.gaps);
        text += &format!("IMU       {first}, {synthesised} readings synthesised, {gaps} gaps\n");
        if !imu.initialised {
            let failed: Vec<&str> =
                imu.gates.iter().filter(|g| !g.passed).map(|g| g.words.as_str()).collect();
            text += &match failed.is_empty() {
                true => "  lacks   key frames for a first initialisation attempt\n".to_owned(),
                false => format!("  lacks   {}\n", failed.join(", ")),
            };
        }
    }
    text
}
