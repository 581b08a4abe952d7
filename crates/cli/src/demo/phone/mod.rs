//! `cairn demo --phone`: the demo's walk with a phone as phones are, through the page's own protocol, in real time.

mod error;
mod page;
mod walk;
mod walked;

use super::config::{DemoConfig, facing_name};
use crate::failure::Failure;
use crate::output::Output;
use cairn_eval::{Align, EvalOptions, evaluate, process};
use cairn_geometry::{Se3, So3, Trajectory, Vec3};
use cairn_sensor::Distortion;
use cairn_sim::PhoneTraits;
pub use cairn_trial::way::BODY_HZ;
use serde::Serialize;
use std::path::Path;
use walk::walk;
use walked::{Live, Walked};

/// Largest distance to the start that counts as arrived, metres.
const ARRIVAL_M: f64 = 1.0;
/// Farther than this from the path walked out, words have misled, metres.
const MISLED_M: f64 = 2.0;
/// Longer and shorter side of the pictures that the page asks the camera for.
const SIZE: [usize; 2] = [640, 480];

/// What differs from the phone as it is, to see what that matters.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// The server knows the lens.
    pub known_lens: bool,
    /// Seconds of the readout, instead of the phone's own.
    pub readout_s: Option<f64>,
    /// The phone is held upright.
    pub upright: bool,
    /// Replaces the files of an earlier demo.
    pub overwrite: bool,
}

/// The figures of a walk.
#[derive(Clone, Debug, Serialize)]
struct Figures {
    seed: u64,
    facing: &'static str,
    /// What the phone is truly like: focal length as a share of the longer side, radial distortion, readout in ms, the
    /// picture's stamp behind its exposure in ms.
    focal: f64,
    k1: f64,
    readout_ms: f64,
    stamp_delay_ms: f64,
    /// What the server found before the walk: focal length as above, and distortion (minus `k1`, about); and after how many
    /// seconds of walking about.
    lens: Option<[f64; 2]>,
    lens_after_s: Option<f64>,
    /// Connections that ended on the way.
    broken: usize,
    arrived: bool,
    told_arrival: bool,
    misled: bool,
    stopped: Option<String>,
    error_m: f64,
    farthest_off_m: f64,
    /// Seconds of walking until lengths were metres.
    metric_after_s: Option<f64>,
    /// How many times too long lengths of the live positions are, and their RMS error, metres: on the way out, and whole.
    scale_out: f64,
    ate_out_m: f64,
    scale: f64,
    ate_m: f64,
    pictures_hz: f64,
    /// Share of the pictures with a pose.
    tracked: f64,
    dropped: u64,
    withheld: usize,
    out_s: f64,
    home_s: f64,
    cpu_s: Option<f64>,
    said: Vec<(f64, String, [f64; 2])>,
    troubles: Vec<String>,
}

/// All walks.
#[derive(Serialize)]
struct Tally {
    runs: usize,
    arrived: usize,
    stopped: usize,
    misled: usize,
    each: Vec<Figures>,
}

/// Walks with one phone after the other and prints a row as each ends.
///
/// # Errors
/// When a walk fails or a walker did not arrive.
pub fn run(
    configs: impl Iterator<Item = DemoConfig>,
    options: Options,
    out: &Path,
    output: &Output,
) -> Result<(), Failure> {
    let mut each = Vec::new();
    output.text(HEAD)?;
    for config in configs {
        let figures = once(&config, options, out)?;
        output.text(&row(&figures))?;
        each.push(figures);
    }
    let tally = Tally {
        runs: each.len(),
        arrived: each.iter().filter(|f| f.arrived).count(),
        stopped: each.iter().filter(|f| !f.arrived && f.stopped.is_some()).count(),
        misled: each.iter().filter(|f| f.misled).count(),
        each,
    };
    if tally.arrived == tally.runs {
        return output.result(&tally, summary);
    }
    output.text(&summary(&tally))?;
    let why = format!("{} of {} walkers arrived", tally.arrived, tally.runs);
    Err(Failure::new("the demo with a phone", why, format!("see the transcripts in {}", out.display())))
}

fn once(config: &DemoConfig, options: Options, out: &Path) -> Result<Figures, Failure> {
    let failed = |why: String| {
        Failure::new("the demo with a phone", why, "try again on a machine with less other work")
    };
    let name = format!("phone-{}-{}", facing_name(config.facing), config.seed);
    let folder = out.join(format!("{name}-routes"));
    let system = |e: std::io::Error| failed(format!("{}: {e}", folder.display()));
    if folder.exists() && !options.overwrite {
        let why = format!("{} exists", folder.display());
        return Err(Failure::usage("--out", why.clone(), "give another folder, or --overwrite"));
    }
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(system)?;
    }
    std::fs::create_dir_all(&folder).map_err(system)?;
    let [long, short] = SIZE;
    let [width, height] = if options.upright { [short, long] } else { [long, short] };
    let own = PhoneTraits::new(config.seed, width, height);
    let traits = PhoneTraits { readout_s: options.readout_s.unwrap_or(own.readout_s), ..own };
    let cpu = process::cpu_s();
    let walked = walk(config, &traits, options.known_lens, &folder).map_err(|e| failed(e.to_string()))?;
    let cpu_s = process::cpu_s().zip(cpu).map(|(now, before)| now - before);
    let figures = figures(config, &traits, &walked, cpu_s);
    std::fs::write(out.join(format!("{name}.txt")), transcript(&figures)).map_err(system)?;
    let line = |l: &Live| {
        let (s, w) = (l.said, l.truth);
        let [s, w] = [s, w].map(|p| format!("{:.3} {:.3} {:.3}", p.x, p.y, p.z));
        format!("{:.2} {s} {w} {}\n", l.t_s, l.state)
    };
    let live = walked.live.iter().map(line).fold(String::from(LIVE_HEAD), |all, line| all + &line);
    std::fs::write(out.join(format!("{name}-live.txt")), live).map_err(system)?;
    Ok(figures)
}

fn figures(config: &DemoConfig, traits: &PhoneTraits, walked: &Walked, cpu_s: Option<f64>) -> Figures {
    let end_out_s = walked.live.first().map_or(0.0, |l| l.t_s) + walked.took_s[0];
    let (scale_out, ate_out_m) = compared(walked.live.iter().filter(|l| l.t_s < end_out_s));
    let (scale, ate_m) = compared(walked.live.iter());
    let error_m = walked.error_m();
    let k1 = match traits.camera.distortion {
        Distortion::RadialTangential([k1, ..]) => k1,
        _ => 0.0,
    };
    Figures {
        seed: config.seed,
        facing: facing_name(config.facing),
        focal: traits.camera.fx / SIZE[0] as f64,
        k1,
        readout_ms: 1e3 * traits.readout_s,
        stamp_delay_ms: 1e3 * traits.stamp_delay_s,
        lens: walked.lens.map(|(lens, _)| lens),
        lens_after_s: walked.lens.map(|(_, after_s)| after_s),
        broken: walked.broken,
        arrived: walked.told_arrival && error_m <= ARRIVAL_M,
        told_arrival: walked.told_arrival,
        misled: (walked.told_arrival && error_m > ARRIVAL_M) || walked.farthest_off_m() > MISLED_M,
        stopped: walked.stopped.clone(),
        error_m,
        farthest_off_m: walked.farthest_off_m(),
        metric_after_s: walked.metric_after_s,
        scale_out,
        ate_out_m,
        scale,
        ate_m,
        pictures_hz: walked.pictures as f64 / (walked.took_s[0] + walked.took_s[1]),
        tracked: walked.tracked as f64 / walked.pictures.max(1) as f64,
        dropped: walked.dropped,
        withheld: walked.withheld,
        out_s: walked.took_s[0],
        home_s: walked.took_s[1],
        cpu_s,
        said: walked.said.iter().map(|s| (s.t_s, s.words.clone(), s.at.into())).collect(),
        troubles: walked.troubles.clone(),
    }
}

/// By how many times lengths are too long after Sim3 alignment, and the RMS distance; NaN where nothing can be compared.
fn compared<'a>(live: impl Iterator<Item = &'a Live>) -> (f64, f64) {
    let (mut said, mut truth) = (Trajectory::new(), Trajectory::new());
    for l in live {
        let pose = |p: &Vec3| Se3::new(So3::identity(), *p);
        let ns = (l.t_s * 1e9) as i64;
        if said.push(ns, pose(&l.said)).is_ok() {
            let _ = truth.push(ns, pose(&l.truth));
        }
    }
    let options = EvalOptions { align: Align::Sim3, max_difference_s: 1e-6, ..EvalOptions::default() };
    match evaluate(&truth, &said, &options) {
        Ok(e) => (1.0 / e.reference_from_estimate.scale, e.ate_m.rmse),
        Err(_) => (f64::NAN, f64::NAN),
    }
}

const LIVE_HEAD: &str = "# seconds, position in the map, true position, phase, unit, features, inliers, step ms, picture's longer side\n";
const HEAD: &str = "seed  facing     arrived  error m  off m  metric s  scale out  ATE out  scale  ATE m  pictures/s  tracked  dropped  held back  said  home s  cpu s   phone";

fn row(f: &Figures) -> String {
    let outcome = match (f.misled, f.arrived, &f.stopped) {
        (true, _, _) => "misled",
        (_, true, _) => "yes",
        (_, _, Some(_)) => "stopped",
        _ => "no",
    };
    let metric = f.metric_after_s.map_or("never".into(), |s| format!("{s:.1}"));
    let lens = match (f.lens, f.lens_after_s) {
        (Some([focal, radial]), Some(s)) => format!(" (found f {focal:.3} k1 {:+.3} in {s:.0} s)", -radial),
        _ => String::new(),
    };
    format!(
        "{:>4}  {:<9}  {:<7}  {:>7.2}  {:>5.2}  {:>8}  {:>9.3}  {:>7.3}  {:>5.3}  {:>5.2}  {:>10.1}  {:>7.2}  {:>7}  {:>9}  {:>4}  {:>6.0}  {:>5.0}   f {:.3} k1 {:+.3}{lens}, rows {:.0} ms, stamps {:.0} ms, {} broken connections",
        f.seed,
        f.facing,
        outcome,
        f.error_m,
        f.farthest_off_m,
        metric,
        f.scale_out,
        f.ate_out_m,
        f.scale,
        f.ate_m,
        f.pictures_hz,
        f.tracked,
        f.dropped,
        f.withheld,
        f.said.len(),
        f.home_s,
        f.cpu_s.unwrap_or(f64::NAN),
        f.focal,
        f.k1,
        f.readout_ms,
        f.stamp_delay_ms,
        f.broken
    )
}

fn summary(tally: &Tally) -> String {
    let line = |name: &str, each: &[&Figures]| {
        format!(
            "{name}: {} of {} arrived within 1 m, {} stopped with the reason, {} misled",
            each.iter().filter(|f| f.arrived).count(),
            each.len(),
            each.iter().filter(|f| !f.arrived && f.stopped.is_some()).count(),
            each.iter().filter(|f| f.misled).count()
        )
    };
    let mut lines = vec![line("all", &tally.each.iter().collect::<Vec<_>>())];
    for facing in ["home", "back", "backwards"] {
        let here: Vec<_> = tally.each.iter().filter(|f| f.facing == facing).collect();
        if !here.is_empty() && here.len() < tally.runs {
            lines.push(line(facing, &here));
        }
    }
    lines.join("\n")
}

fn transcript(f: &Figures) -> String {
    let mut text = format!("{HEAD}\n{}\n", row(f));
    for (t, words, [x, y]) in &f.said {
        text += &format!("{t:>7.1} s  ({x:>6.2}, {y:>6.2})  {words}\n");
    }
    if let Some(why) = &f.stopped {
        text += &format!("stopped: {why}\n");
    }
    for trouble in &f.troubles {
        text += &format!("shown: {trouble}\n");
    }
    text
}
