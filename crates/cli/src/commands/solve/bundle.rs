//! `cairn solve bundle`: solves a bundle adjustment problem in the format of BAL or Bundler.

use super::{stop_name, text_of};
use crate::failure::Failure;
use crate::interrupt;
use crate::number::positive;
use crate::output::Output;
use crate::outputs::Outputs;
use crate::progress::Progress;
use cairn_solve::bal::{self, BalConfig};
use cairn_solve::{Loss, Stop};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Bundle adjustment of a BAL file; each camera has its own focal length and radial distortion.
///
/// The cost is half the sum of the (robust) losses of the squared reprojection errors in pixels.
#[derive(clap::Args)]
pub struct Arguments {
    /// The problem in BAL (Bundle Adjustment in the Large) or Bundler format; also compressed (.bz2, .gz, .xz, .zst).
    file: PathBuf,
    /// Uses the Huber loss with this width in pixels, to reduce the weight of outliers.
    #[arg(long, value_name = "W", value_parser = positive())]
    huber: Option<f64>,
    /// Largest number of iterations.
    #[arg(long, default_value_t = BalConfig::default().iterations, value_name = "N")]
    iterations: usize,
    /// Converged when a step is predicted to lower the cost by less than this fraction.
    #[arg(long, default_value_t = BalConfig::default().tolerance, value_name = "PART", value_parser = positive())]
    tolerance: f64,
    /// Writes the adjusted problem here, in BAL format.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace the file if it exists.
    #[arg(long)]
    overwrite: bool,
}

/// The printed result.
#[derive(Serialize)]
struct Solved {
    cameras: usize,
    points: usize,
    observations: usize,
    huber: Option<f64>,
    cost_before: f64,
    cost_after: f64,
    /// Root mean square reprojection error, without the robust loss.
    rms_before_px: f64,
    rms_after_px: f64,
    iterations: usize,
    stop: &'static str,
    /// Time of solving, without reading and writing.
    seconds: f64,
}

/// How a model of COLMAP is made a file that is read.
const COLMAP: &str = "this is a model of COLMAP: write it as Bundler's with colmap model_converter --input_path DIR --output_path model --output_type Bundler, and give model.bundle.out";

fn is_colmap(folder: &Path) -> bool {
    ["txt", "bin"].iter().any(|kind| {
        ["cameras", "images", "points3D"].iter().all(|name| folder.join(name).with_extension(kind).is_file())
    })
}

/// Reads, solves and prints.
///
/// # Errors
/// When the file is invalid, the solver makes no progress, or the result cannot be written.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    let name = arguments.file.display().to_string();
    let outputs = Outputs::new(arguments.overwrite)
        .input("the problem", Some(&arguments.file))
        .output("--out", arguments.out.as_deref())
        .checked()?;
    if arguments.file.is_dir() && is_colmap(&arguments.file) {
        return Err(Failure::new(&name, "is a model of COLMAP, not one file", COLMAP));
    }
    let text = text_of(&arguments.file, "BAL")?;
    let mut bal = bal::read(&text).map_err(|e| {
        let colmap = arguments.file.parent().is_some_and(is_colmap);
        let hint = match colmap && text.starts_with('#') {
            true => COLMAP,
            false => "give a problem of BAL (counts, observations, nine numbers for each camera, three for each point) or of Bundler",
        };
        Failure::new(format!("{name}, line {}", e.line), e.reason, hint)
    })?;
    drop(text);
    let config = BalConfig {
        loss: arguments.huber.map_or(Loss::Squared, Loss::Huber),
        iterations: arguments.iterations,
        tolerance: arguments.tolerance,
    };
    let rms = |bal: &bal::Bal| (2.0 * bal.cost(Loss::Squared) / bal.observations.len() as f64).sqrt();
    let rms_before_px = rms(&bal);
    interrupt::in_order();
    let progress = Progress::new(None);
    let mut steps = 0;
    let began = Instant::now();
    let report = bal.solve(&config, || {
        steps += 1;
        progress.step(steps);
        interrupt::requested()
    });
    let seconds = began.elapsed().as_secs_f64();
    drop(progress);
    if !report.cost_before.is_finite() {
        return Err(Failure::new(
            &name,
            "a point has zero depth in a camera that observes it, so the initial cost is not finite",
            "remove that observation, or start from other values",
        ));
    }
    if report.stop == Stop::NoDescent && report.cost_after >= report.cost_before && report.cost_before > 1e-12
    {
        let why = format!("no step lowers the cost of {:.6e}", report.cost_before);
        return Err(Failure::new(
            &name,
            why,
            "it may be solved already; otherwise try a robust loss with --huber",
        ));
    }
    outputs.write("--out", || Ok(bal::write(&bal).into_bytes()))?;
    let solved = Solved {
        cameras: bal.cameras.len(),
        points: bal.points.len(),
        observations: bal.observations.len(),
        huber: arguments.huber,
        cost_before: report.cost_before,
        cost_after: report.cost_after,
        rms_before_px,
        rms_after_px: rms(&bal),
        iterations: report.iterations,
        stop: stop_name(report.stop),
        seconds,
    };
    output.result(&solved, summary)
}

fn summary(s: &Solved) -> String {
    [
        format!("bundle      {} cameras, {} points, {} observations", s.cameras, s.points, s.observations),
        format!("cost        {:.9} before, {:.9} after", s.cost_before, s.cost_after),
        format!("RMS         {:.6} px before, {:.6} px after", s.rms_before_px, s.rms_after_px),
        format!("iterations  {} ({})", s.iterations, s.stop),
        format!("time        {:.3} s", s.seconds),
    ]
    .join("\n")
}
