//! `cairn eval`: the error of an estimated trajectory against a reference.

use super::eval_doubts::doubts;
use crate::failure::Failure;
use crate::output::Output;
use crate::outputs::Outputs;
use cairn_eval::{
    Align, Delta, EvalError, EvalOptions, Evaluation, Statistics, evaluate_files, load_trajectory,
    reference_for, to_tum,
};
use std::path::PathBuf;

/// Compares a trajectory with its ground truth: absolute (ATE) and relative (RPE) error, and coverage.
///
/// Reads files in TUM, KITTI or EuRoC format (detected automatically), or the folder of a data set with its ground
/// truth. The figures agree with those of evo.
#[derive(clap::Args)]
pub struct Arguments {
    /// The ground truth.
    reference: PathBuf,
    /// The trajectory to evaluate.
    estimate: PathBuf,
    /// How the estimate is aligned to the reference: none, se3 or sim3; se3 by default, sim3 where the estimate's file
    /// says that its lengths are not metres.
    #[arg(long, value_name = "HOW")]
    align: Option<Align>,
    /// Writes the reference as it was compared, in the frame of the estimate's poses, in TUM format: for other programs.
    #[arg(long, value_name = "FILE")]
    reference_out: Option<PathBuf>,
    /// Replaces an existing file.
    #[arg(long)]
    overwrite: bool,
    /// Largest time difference between two poses that are compared, in seconds.
    #[arg(long, default_value_t = EvalOptions::default().max_difference_s, value_name = "S")]
    max_difference: f64,
    /// Distance between the two poses of the relative error, such as 1f (frames), 0.5m or 2s.
    #[arg(long, default_value_t = Delta::default(), value_name = "DISTANCE")]
    delta: Delta,
    /// Uses all pairs at that distance, not only consecutive ones.
    #[arg(long)]
    all_pairs: bool,
}

/// Compares the two trajectories and prints the figures.
///
/// # Errors
/// When a file cannot be read, or the trajectories cannot be associated or aligned.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    let load = |path: &PathBuf| {
        load_trajectory(path).map_err(|e| {
            let place = e.line.map_or_else(String::new, |line| format!(", line {line}"));
            let hint =
                "give a trajectory in TUM, KITTI or EuRoC format, or the folder of a data set with its ground truth";
            Failure::new(format!("{}{place}", e.file), e.reason, hint)
        })
    };
    let outputs = Outputs::new(arguments.overwrite)
        .input("the reference", Some(&arguments.reference))
        .input("the estimate", Some(&arguments.estimate))
        .output("--reference-out", arguments.reference_out.as_deref())
        .checked()?;
    let (reference, estimate) = (load(&arguments.reference)?, load(&arguments.estimate)?);
    let metric = estimate.header.as_ref().is_none_or(|h| h.metric);
    let options = EvalOptions {
        align: arguments.align.unwrap_or(if metric { Align::Se3 } else { Align::Sim3 }),
        max_difference_s: arguments.max_difference,
        delta: arguments.delta,
        all_pairs: arguments.all_pairs,
        ..EvalOptions::default()
    };
    let mut evaluation =
        evaluate_files(&reference, &estimate, &options).map_err(|e| explain(e, arguments))?;
    let doubts = doubts(&reference, &estimate, &options, &evaluation);
    evaluation.notes.extend(doubts);
    outputs.write("--reference-out", || Ok(to_tum(&reference_for(&estimate, &reference).0).into_bytes()))?;
    output.result(&evaluation, text)
}

fn explain(error: EvalError, arguments: &Arguments) -> Failure {
    let estimate = arguments.estimate.display().to_string();
    match error {
        EvalError::NoPairs { max_difference_s, reference_span, estimate_span } => Failure::new(
            estimate,
            format!(
                "no pose is within {max_difference_s} s of a pose of {} (it spans {estimate_span}, the reference {reference_span})",
                arguments.reference.display()
            ),
            "give two trajectories with the same clock, or allow more with --max-difference",
        ),
        EvalError::Alignment(why) => Failure::new(
            estimate,
            format!("cannot be aligned: {why}"),
            "compare it without alignment: --align none",
        ),
        EvalError::Counts { .. } => Failure::new(
            estimate,
            error.to_string(),
            "give poses of all frames, or poses with times (TUM) or with the number of their frame before the matrix",
        ),
        EvalError::NoTimes { .. } => Failure::new(
            estimate,
            error.to_string(),
            "put the recording's times.txt, with as many lines as it has poses, into its folder",
        ),
        EvalError::Option(why) => Failure::new("eval", why, "see cairn eval --help"),
    }
}

fn text(e: &Evaluation) -> String {
    let align = match e.align {
        Align::None => "not aligned".to_owned(),
        Align::Se3 => "aligned by SE3".to_owned(),
        Align::Sim3 => format!("aligned by Sim3, scale {:.6}", e.scale),
    };
    let drift = e.drift().map_or_else(String::new, |d| format!(" ({:.3} % of the path)", 100.0 * d));
    let of_frames = e.coverage.map_or_else(String::new, |c| format!("; coverage {c:.4} of the frames"));
    let mut lines = vec![
        format!("poses     {} of {} reference poses", e.estimate_poses, e.reference_poses),
        format!("pairs     {}, {align}, over {:.3} m", e.pairs, e.path_m),
        format!("covered   {:.4} of the reference{of_frames}", e.reference_covered),
        format!("ATE       {:.6} m RMSE{drift}{}", e.ate_m.rmse, rest(&e.ate_m, "m")),
    ];
    let more = [
        ("rotation", "deg", &e.ate_deg, String::new()),
        ("RPE", "m", &e.rpe_m, format!(" over {}", e.delta)),
        ("RPE", "deg", &e.rpe_deg, format!(" over {}", e.delta)),
    ];
    for (name, unit, statistics, over) in more {
        if let Some(s) = statistics {
            lines.push(format!("{name:<8}  {:.6} {unit} RMSE{over}{}", s.rmse, rest(s, unit)));
        }
    }
    if let Some(k) = &e.kitti {
        lines.push(format!(
            "KITTI     {:.4} %, {:.4} deg/100 m over {} segments of 100 to 800 m",
            k.all.translation_percent, k.all.rotation_deg_per_100m, k.all.segments
        ));
    }
    lines.extend(e.notes.iter().map(|note| format!("note      {note}")));
    lines.join("\n")
}

fn rest(s: &Statistics, unit: &str) -> String {
    format!(", median {:.6}, max {:.6} {unit}", s.median, s.max)
}
