//! Prints the figures of the filter: real logs compared with smoothing and surveys, consistency over simulated runs,
//! speed.
//!
//! `cargo run --release -p cairn-filter --example figures [mrclam|victoria|plaza|consistency|speed]`; logs are read
//! from `$CAIRN_DATA`, else `../shared/data`.

use cairn_filter::batch::BatchConfig;
use cairn_filter::chi2;
use cairn_filter::ekf::{Association, EkfConfig, EkfSlam, Linearisation};
use cairn_filter::log::{Log, load};
use cairn_filter::run::{align, position_rmse, run};
use cairn_filter::simulate::World;
use cairn_geometry::Se2;
use cairn_random::Random;
use nalgebra::{Matrix3, Vector3};
use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let only = std::env::args().nth(1);
    let wanted = |name: &str| only.as_deref().is_none_or(|o| o == name);
    let data = std::env::var_os("CAIRN_DATA")
        .map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from)
        .join("ekf");
    if wanted("mrclam") {
        mrclam(&data)?;
    }
    if wanted("victoria") {
        victoria(&data)?;
    }
    if wanted("plaza") {
        plaza(&data)?;
    }
    if wanted("consistency") {
        consistency(50);
    }
    if wanted("speed") {
        for landmarks in [200, 1000, 5000] {
            speed(landmarks);
        }
    }
    Ok(())
}

fn mrclam(data: &std::path::Path) -> Result<(), Box<dyn Error>> {
    println!(
        "MRCLAM data set 1: landmark RMSE against the survey / live position RMSE against smoothing, in cm"
    );
    let folder = data.join("mrclam1");
    let logs: Vec<Log> = (1..=3).map(|r| load(&folder, Some(r)).map(|l| l.1)).collect::<Result<_, _>>()?;
    let smoothed: Vec<_> = logs
        .iter()
        .map(|log| {
            let found = run(log, 0, &EkfConfig::default())?;
            let began = Instant::now();
            let smoothed = found.smoothed(log, 0, &BatchConfig::default())?.0;
            Ok((smoothed, began.elapsed().as_secs_f64() * 1e3))
        })
        .collect::<Result<_, cairn_filter::run::RunError>>()?;
    let row = |name: &str, config: EkfConfig| -> Result<(), Box<dyn Error>> {
        let (mut line, mut sums) = (format!("{name:<34}"), [0.0; 2]);
        for (log, (smooth, _)) in logs.iter().zip(&smoothed) {
            let mut r = run(log, 0, &config)?;
            // The minimum over several runs, since other programs share the machine.
            for _ in 0..if config.association == Association::Known { 5 } else { 0 } {
                r.filter_ms = r.filter_ms.min(run(log, 0, &config)?.filter_ms);
            }
            let Some((transform, rmse, _)) = align(&log.surveyed, &r.named()) else {
                return Err("no alignment".into());
            };
            let Some((smooth_to, ..)) = align(&log.surveyed, &smooth.landmarks) else {
                return Err("no alignment".into());
            };
            let position = position_rmse(&r.poses, &transform, &smooth.poses[0], &smooth_to);
            sums = [sums[0] + rmse / 3.0, sums[1] + position / 3.0];
            let wrong =
                r.wrong_associations.map_or_else(String::new, |w| format!(" wrong {:4.1} %", 100.0 * w));
            line +=
                &format!("| {:5.1} / {:5.1} {:3.0} ms{wrong} ", 100.0 * rmse, 100.0 * position, r.filter_ms);
        }
        println!("{line}| mean {:5.1} / {:5.1}", 100.0 * sums[0], 100.0 * sums[1]);
        Ok(())
    };
    let known = EkfConfig::default();
    row("known, 99.9 % gate (default)", known)?;
    for gate in [3.0, 4.0, 5.99, 8.0, 10.0, 12.0, 14.0] {
        row(&format!("known, gate {gate}"), known.with_gate_of_two(gate))?;
    }
    let textbook = EkfConfig { linearisation: Linearisation::Latest, recovery_fraction: 2.0, ..known };
    row("textbook, no gate", EkfConfig { gate_probability: 1.0, ..textbook })?;
    row("textbook, gate 5.99", textbook.with_gate_of_two(5.99))?;
    row("textbook, gate 3", textbook.with_gate_of_two(3.0))?;
    row("nearest neighbour", EkfConfig { association: Association::Nearest, ..known })?;
    row("joint compatibility", EkfConfig { association: Association::Joint, ..known })?;
    let mut line = format!("{:<34}", "smoothed");
    let mut sum = 0.0;
    for (log, (smooth, ms)) in logs.iter().zip(&smoothed) {
        if let Some((_, rmse, _)) = align(&log.surveyed, &smooth.landmarks) {
            sum += rmse / 3.0;
            line += &format!("| {:5.1}         {ms:3.0} ms ", 100.0 * rmse);
        }
    }
    println!("{line}| mean {:5.1}\n", 100.0 * sum);
    Ok(())
}

fn against_batch(name: &str, log: &Log, config: &EkfConfig) -> Result<(), Box<dyn Error>> {
    let r = run(log, 0, config)?;
    let began = Instant::now();
    let (smooth, report) = r.smoothed(log, 0, &BatchConfig::default())?;
    let ms = began.elapsed().as_secs_f64() * 1e3;
    let named = r.named();
    let Some((onto, landmarks, _)) = align(&smooth.landmarks, &named) else {
        return Err("too few landmarks".into());
    };
    let position = position_rmse(&r.poses, &onto, &smooth.poses[0], &Se2::identity());
    println!(
        "{name}: {} poses, {} landmarks, {} taken, {} rejected, {} recoveries, NIS a degree of freedom {:.2}, {:.1} % within 95 %, filter {:.0} ms",
        r.poses.len(),
        named.len(),
        r.counts.taken,
        r.counts.rejected,
        r.recoveries,
        r.nis_per_dof,
        100.0 * r.nis_within_95,
        r.filter_ms
    );
    println!(
        "  laid onto smoothing ({} steps, {:.0} ms, converged {}): landmarks RMSE {landmarks:.3} m, live positions {position:.3} m",
        report.iterations, ms, report.converged
    );
    Ok(())
}

fn victoria(data: &std::path::Path) -> Result<(), Box<dyn Error>> {
    let (_, log) = load(&data.join("victoria_park.txt"), None)?;
    let config = EkfConfig { gate_probability: log.gate_probability, ..EkfConfig::default() };
    against_batch("Victoria Park, all active", &log, &config)?;
    against_batch(
        "Victoria Park, local within 60 m",
        &log,
        &EkfConfig { local_radius_m: Some(60.0), ..config },
    )?;
    println!();
    Ok(())
}

fn plaza(data: &std::path::Path) -> Result<(), Box<dyn Error>> {
    let (_, log) = load(&data.join("Plaza1_DR.txt"), None)?;
    against_batch("Plaza 1, ranges only", &log, &EkfConfig::default())?;
    println!();
    Ok(())
}

/// Normalised estimation error squared of the pose at every step.
fn nees(world: &World, seed: u64, config: EkfConfig) -> Vec<f64> {
    let simulated = world.drive(seed);
    let mut filter = EkfSlam::new(config);
    // The initial pose has errors of 5 cm and 2 degrees (standard deviation), drawn at random.
    let mut random = Random::new(seed + 1_000_000);
    let deviations = Vector3::new(0.05, 0.05, 0.035);
    let start = Se2::from_xy_angle(
        0.05 * random.standard_normal(),
        0.05 * random.standard_normal(),
        0.035 * random.standard_normal(),
    );
    let covariance = Matrix3::from_diagonal(&deviations.component_mul(&deviations));
    let Ok(id) = filter.add_robot(&start, &covariance) else { return Vec::new() };
    let mut values = Vec::with_capacity(simulated.steps.len());
    for (step, truth) in simulated.steps.iter().zip(&simulated.truth) {
        let done = filter.predict(id, &step.motion).and_then(|()| filter.observe(id, &step.sightings));
        let (Ok(_), Some((pose, covariance))) = (done, filter.pose(id)) else { return values };
        let mut error: Vector3<f64> = pose - truth;
        error.z = cairn_filter::angle::wrap(error.z);
        values.push(covariance.cholesky().map_or(f64::INFINITY, |c| error.dot(&c.solve(&error))));
    }
    values
}

fn consistency(runs: u64) {
    let world = World::default();
    let (low, high) = chi2::mean_bounds(0.95, 3, runs as usize);
    println!(
        "Consistency: {} landmarks, {} s, {runs} runs; NEES of the pose (3 degrees of freedom), 95 % band of the mean {low:.2} to {high:.2}",
        world.landmarks, world.duration_s
    );
    for (name, linearisation) in [
        ("plain EKF", Linearisation::Latest),
        ("first estimates", Linearisation::First),
        ("invariant", Linearisation::Invariant),
    ] {
        let config = EkfConfig {
            linearisation,
            gate_probability: 1.0,
            local_radius_m: Some(20.0),
            ..EkfConfig::default()
        };
        let all: Vec<Vec<f64>> = (0..runs).map(|seed| nees(&world, seed, config)).collect();
        let steps = all.iter().map(Vec::len).min().unwrap_or(0);
        let mean: Vec<f64> =
            (0..steps).map(|k| all.iter().map(|r| r[k]).sum::<f64>() / runs as f64).collect();
        let within = mean.iter().filter(|m| (low..=high).contains(*m)).count() as f64 / steps.max(1) as f64;
        let minutes: Vec<String> = mean
            .chunks((60.0 * world.rate_hz) as usize)
            .map(|c| format!("{:.2}", c.iter().sum::<f64>() / c.len() as f64))
            .collect();
        println!(
            "  {name:<16} mean NEES by minute {}; in the band {:.0} % of the time",
            minutes.join(" "),
            100.0 * within
        );
    }
    println!();
}

/// CPU time of this thread in milliseconds; wall-clock time where the system does not report it (Linux does).
fn thread_ms(clock: &Instant) -> f64 {
    let own = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let own = own.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    own.map_or_else(|| clock.elapsed().as_secs_f64() * 1e3, |ns| ns * 1e-6)
}

fn speed(landmarks: usize) {
    let clock = Instant::now();
    // A ring that is long enough for this many landmarks at constant density, driven slightly more than once around at
    // 10 Hz.
    let radius_m = 30.0 * landmarks as f64 / 200.0;
    let duration_s = 1.1 * std::f64::consts::TAU * radius_m;
    let world = World { landmarks, radius_m, duration_s, rate_hz: 10.0, ..World::default() };
    let simulated = world.drive(1);
    for local_radius_m in [Some(20.0), None] {
        if local_radius_m.is_none() && landmarks > 1000 {
            continue;
        }
        let config = EkfConfig { local_radius_m, gate_probability: 0.999, ..EkfConfig::default() };
        let mut filter = EkfSlam::new(config);
        let Ok(id) = filter.add_robot(&Se2::identity(), &(Matrix3::identity() * 1e-12)) else { return };
        let mut ms = Vec::new();
        let own_began = thread_ms(&clock);
        let last =
            if local_radius_m.is_some() { simulated.steps.len() } else { 3000.min(simulated.steps.len()) };
        for step in &simulated.steps[..last] {
            let began = Instant::now();
            let done = filter.predict(id, &step.motion).and_then(|()| filter.observe(id, &step.sightings));
            if done.is_err() {
                return;
            }
            ms.push(began.elapsed().as_secs_f64() * 1e3);
        }
        let own_ms = (thread_ms(&clock) - own_began) / ms.len() as f64;
        // The second half of the run, when the map is large; the loop is closed in it.
        let mut late = ms.split_off(ms.len() / 2);
        late.sort_by(f64::total_cmp);
        let at = |p: f64| late[((late.len() - 1) as f64 * p) as usize];
        println!(
            "Speed, {:>4} landmarks mapped, {:<16} {:.1} sightings an update: mean {own_ms:.2} ms of processor time; passed in the second half: mean {:.2} ms, median {:.2}, 99 % {:.2}, max {:.2} (active state {})",
            filter.landmarks().len(),
            local_radius_m.map_or("all active,".into(), |r| format!("within {r} m,")),
            simulated.steps.iter().map(|s| s.sightings.len()).sum::<usize>() as f64
                / simulated.steps.len() as f64,
            late.iter().sum::<f64>() / late.len() as f64,
            at(0.5),
            at(0.99),
            at(1.0),
            filter.active_size()
        );
    }
}
