//! Every pose graph of the recordings reaches its known optimum from odometry initialisation.

use bench::data_folder;
use bench::graphs::{KNOWN, run};

#[test]
fn known_optima_are_reached_from_odometry() {
    let data = data_folder();
    let rows = run(&data, None, 1).expect("the files are read");
    if rows.len() < KNOWN.len() {
        println!(
            "skipped: {} of {} graphs are not in {}",
            KNOWN.len() - rows.len(),
            KNOWN.len(),
            data.display()
        );
    }
    for row in rows {
        let [gn, lm] = row.solved.map(|s| s.report.cost_after);
        println!("{}: {:.9}, {:+.1e} above; {gn:.9} {lm:.9}", row.known.name, row.reached, row.excess());
        assert!(row.excess().abs() <= 1e-6, "{}: the known optimum is {}", row.known.name, row.known.optimum);
        assert!(
            (gn - lm).abs() <= 1e-6 * lm,
            "{}: Gauss-Newton and Levenberg-Marquardt differ",
            row.known.name
        );
    }
}
