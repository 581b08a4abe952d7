//! Compares an estimated trajectory with its reference.
//!
//! `evaluate REFERENCE ESTIMATE [--align none|se3|sim3] [--max-difference S] [--delta 1f|0.5m|2s] [--all-pairs]
//! [--json]`

use cairn_eval::{EvalOptions, evaluate_files, load_trajectory};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let mut options = EvalOptions::default();
    let (mut paths, mut json) = (Vec::new(), false);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or(format!("{arg} needs a value"));
        match arg.as_str() {
            "--align" => options.align = value()?.parse()?,
            "--max-difference" => options.max_difference_s = value()?.parse()?,
            "--delta" => options.delta = value()?.parse()?,
            "--all-pairs" => options.all_pairs = true,
            "--json" => json = true,
            _ => paths.push(arg),
        }
    }
    let [reference, estimate] = paths.as_slice() else { return Err("two files: REFERENCE ESTIMATE".into()) };
    let (reference, estimate) =
        (load_trajectory(Path::new(reference))?, load_trajectory(Path::new(estimate))?);
    let result = evaluate_files(&reference, &estimate, &options)?;
    if json {
        println!("{}", serde_json::to_string_pretty(&result)?);
        return Ok(());
    }
    println!(
        "pairs {}, reference covered {:.3}, path {:.3} m",
        result.pairs, result.reference_covered, result.path_m
    );
    println!("ATE {:.6} m (rmse), scale {:.6}", result.ate_m.rmse, result.scale);
    if let (Some(m), Some(deg)) = (result.rpe_m, result.rpe_deg) {
        println!("RPE {:.6} m, {:.6} deg (rmse) over {}", m.rmse, deg.rmse, result.delta);
    }
    for note in &result.notes {
        println!("note: {note}");
    }
    Ok(())
}
