//! The figures as text, each beside its goal.

use super::{Closed, Figures, Walked};
use std::fmt::Write;

/// One line: what, the figure, and its goal, where there is one.
fn row(text: &mut String, what: &str, figure: String, goal: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{what:<44}{figure:>34}   {goal}");
}

/// The figures as text.
pub fn table(f: &Figures) -> String {
    let mut text = String::new();
    row(&mut text, "", "measured".into(), "goal");
    let t = &mut text;
    let per = f.key_frames.max(1) as f64;
    row(t, "key frames", f.key_frames.to_string(), "10000");
    row(
        t,
        "features, landmarks per key frame",
        format!("{:.0}, {:.0}", f.features, f.landmarks as f64 / per),
        "",
    );
    row(
        t,
        "observations per landmark",
        format!("{:.1}", f.observations as f64 / f.landmarks.max(1) as f64),
        "",
    );
    row(
        t,
        "resident, kB per key frame",
        f.resident.map_or("unknown".into(), |b| format!("{:.1}", b / 1e3)),
        "40",
    );
    let b = &f.bytes;
    row(t, "  with features in memory, %", format!("{:.0}", 100.0 * b.in_memory), "");
    for (name, bytes) in [
        ("  features", b.features),
        ("  descriptors", b.descriptors),
        ("  words", b.words),
        ("  landmarks of features", b.shown),
        ("  covisible key frames", b.covisible),
        ("  landmarks", b.landmarks),
        ("  observations", b.observations),
    ] {
        row(t, name, format!("{:.1}", bytes / 1e3), "");
    }
    let tenths: Vec<String> = f.commit_ms.iter().map(|ms| format!("{ms:.1}")).collect();
    row(t, "commit of a key frame by tenths of the way, ms", tenths.join(" "), "flat");
    row(t, "place query, ms, p50, max", format!("{:.2}, {:.2}", f.query_ms.p50, f.query_ms.max), "50");
    walked(t, &f.new);
    match &f.closed {
        Some(c) => closed(t, c),
        None => row(t, "the loop", "not found".into(), "found"),
    }
    let least = |s: &[f64]| s.iter().copied().fold(f64::INFINITY, f64::min);
    row(t, "file, MB", format!("{:.1}", f.stored.file_mb), "");
    row(t, "saved in, s (least)", format!("{:.2}", least(&f.stored.save_s)), "10");
    row(t, "opened in, s (least)", format!("{:.2}", least(&f.stored.load_s)), "1");
    row(t, "first pose after that, ms", f.first_pose_ms.map_or("none".into(), |ms| format!("{ms:.1}")), "");
    text
}

fn walked(t: &mut String, [alone, large]: &[Walked; 2]) {
    let pair = |of: &dyn Fn(&Walked) -> f64| format!("{:.1}, {:.1}", of(alone), of(large));
    let goal = "1.3 times";
    row(t, "100 m of new walking: alone, in the large map", String::new(), "");
    row(t, "  frames with a pose, %", pair(&|w| 100.0 * w.frames[1] as f64 / w.frames[0].max(1) as f64), "");
    row(t, "  key frames", pair(&|w| w.mapped as f64), "");
    row(t, "  tracking p50, ms", pair(&|w| w.track_ms.p50), goal);
    row(t, "  tracking p99, ms", pair(&|w| w.track_ms.p99), goal);
    row(t, "  mapping p50, ms", pair(&|w| w.map_ms.p50), goal);
    row(t, "  mapping p99, ms", pair(&|w| w.map_ms.p99), goal);
    row(t, "  closing p50, ms", pair(&|w| w.close_ms.p50), "50");
    row(t, "  closing p99, ms", pair(&|w| w.close_ms.p99), "");
    row(t, "  memory, MB", pair(&|w| w.grown_mb.unwrap_or(f64::NAN)), goal);
}

fn closed(t: &mut String, c: &Closed) {
    let sum = |s: &[f64; 2]| format!("{:.2} + {:.2} = {:.2}", s[0], s[1], s[0] + s[1]);
    row(t, "the loop: closed and relaxed + committed, s", sum(&c.alone_s), "");
    row(t, "  beside tracking, s", sum(&c.beside_s), "5");
    let p99 = |p: &Option<cairn_eval::Percentiles>| p.map_or(f64::NAN, |p| p.p99);
    let [beside, quiet] = [p99(&c.track_ms[0]), p99(&c.track_ms[1])];
    row(t, "  tracking p99 before, beside, ms", format!("{quiet:.1}, {beside:.1}"), "1.3 times");
    row(t, "  frames beside, with a pose", format!("{}, {}", c.frames[0], c.frames[1]), "all");
    let pair = |[a, b]: [f64; 2]| format!("{a:.2}, {b:.2}");
    row(t, "  last key frame off before, after, m", pair(c.off_m), "");
    row(t, "  all key frames off, mean, m", pair(c.mean_off_m), "");
    row(t, "  memory while both maps are held, MB", format!("{:.0}", c.grown_mb.unwrap_or(f64::NAN)), "");
}
