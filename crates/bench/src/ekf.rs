//! `ekf`: the filter on real logs, compared with smoothing and surveys; consistency over simulated runs; speed.

use crate::MeasureError;
use crate::processor::now_ms;
use cairn_filter::batch::BatchConfig;
use cairn_filter::chi2;
use cairn_filter::ekf::{Association, EkfConfig, EkfSlam, Linearisation, Verdict};
use cairn_filter::log::{Log, Noise, Target, load};
use cairn_filter::motion::VelocityModel;
use cairn_filter::run::{align, position_rmse, run};
use cairn_filter::simulate::World;
use cairn_geometry::Se2;
use cairn_random::Random;
use nalgebra::{Matrix3, Vector3};
use std::path::Path;
use std::time::Instant;

/// A section of the page: its lines, in Markdown.
type Lines = Result<Vec<String>, MeasureError>;

/// The sections of the page.
pub const SECTIONS: [&str; 6] = ["mrclam", "noise", "victoria", "plaza", "consistency", "speed"];

/// A section of the page, as text.
///
/// # Errors
/// When there is no such section, or its log cannot be read.
pub fn section(data: &Path, name: &str) -> Result<String, MeasureError> {
    let data = data.join("ekf");
    let lines = match name {
        "mrclam" => mrclam(&data),
        "noise" => noise(&data),
        "victoria" => victoria(&data),
        "plaza" => plaza(&data),
        "consistency" => Ok(consistency(50)),
        "speed" => Ok(speeds(&[200, 1000, 5000])),
        other => Err(format!("there is no section {other:?}, there are {}", SECTIONS.join(", ")).into()),
    };
    Ok(lines?.join("\n") + "\n")
}

fn mrclam(data: &Path) -> Lines {
    let folder = data.join("mrclam1");
    let logs: Vec<Log> = (1..=3).map(|r| load(&folder, Some(r)).map(|l| l.1)).collect::<Result<_, _>>()?;
    let smoothed: Vec<_> = logs
        .iter()
        .map(|log| Ok(run(log, 0, &EkfConfig::default())?.smoothed(log, 0, &BatchConfig::default())?.0))
        .collect::<Result<_, cairn_filter::run::RunError>>()?;
    let mut lines = vec![
        "| | robot 1 | robot 2 | robot 3 | mean | longest, ms |".to_owned(),
        "|---|---|---|---|---|---|".to_owned(),
    ];
    let mut row = |name: &str, config: EkfConfig| -> Result<(), MeasureError> {
        let (mut line, mut sums, mut longest_ms) = (format!("| {name} |"), [0.0; 2], 0f64);
        for (log, smooth) in logs.iter().zip(&smoothed) {
            let mut least_ms = f64::INFINITY;
            // The least of some runs, of processor time: other programs share the machine.
            let mut found = None;
            for _ in 0..5 {
                let began_ms = now_ms();
                found = Some(run(log, 0, &config)?);
                least_ms = least_ms.min(now_ms() - began_ms);
            }
            let Some(r) = found else { continue };
            let (survey, of_smooth) =
                (align(&log.surveyed, &r.named()), align(&log.surveyed, &smooth.landmarks));
            let (Some((to, rmse, _)), Some((smooth_to, ..))) = (survey, of_smooth) else {
                return Err("no alignment".into());
            };
            let position = position_rmse(&r.poses, &to, &smooth.poses[0], &smooth_to);
            sums = [sums[0] + rmse / 3.0, sums[1] + position / 3.0];
            longest_ms = longest_ms.max(least_ms);
            let wrong =
                r.wrong_associations.map_or_else(String::new, |w| format!(", {:.1} % wrong", 100.0 * w));
            line += &format!(" {:.1} / {:.1}{wrong} |", 100.0 * rmse, 100.0 * position);
        }
        lines.push(format!("{line} {:.1} / {:.1} | {longest_ms:.0} |", 100.0 * sums[0], 100.0 * sums[1]));
        Ok(())
    };
    let known = EkfConfig::default();
    row("labels, gate 13.8 (99.9 %, default)", known)?;
    for gate in [3.0, 4.0, 5.99, 8.0, 10.0, 12.0, 14.0] {
        row(&format!("labels, gate {gate}"), known.with_gate_of_two(gate))?;
    }
    let textbook = EkfConfig { linearisation: Linearisation::Latest, recovery_fraction: 2.0, ..known };
    row("textbook filter, no gate", EkfConfig { gate_probability: 1.0, ..textbook })?;
    row("textbook filter, gate 5.99", textbook.with_gate_of_two(5.99))?;
    row("textbook filter, gate 3", textbook.with_gate_of_two(3.0))?;
    row("no labels, nearest neighbour", EkfConfig { association: Association::Nearest, ..known })?;
    row("no labels, joint compatibility", EkfConfig { association: Association::Joint, ..known })?;
    row("no labels, decisions deferred", EkfConfig { association: Association::Deferred, ..known })?;
    let (mut line, mut sum) = ("| smoothed, landmarks only |".to_owned(), 0.0);
    for (log, smooth) in logs.iter().zip(&smoothed) {
        let Some((_, rmse, _)) = align(&log.surveyed, &smooth.landmarks) else {
            return Err("no alignment".into());
        };
        sum += rmse / 3.0;
        line += &format!(" {:.1} |", 100.0 * rmse);
    }
    lines.push(format!("{line} {:.1} | |", 100.0 * sum));
    Ok(lines)
}

/// The noise that makes the innovations of the labelled runs likeliest, robot by robot and for all of them: coordinate descent over the
/// logarithms of the deviations, from the same start for each.
fn noise(data: &Path) -> Lines {
    let folder = data.join("mrclam1");
    let logs: Vec<Log> = (1..=3).map(|r| load(&folder, Some(r)).map(|l| l.1)).collect::<Result<_, _>>()?;
    let mut lines = vec![
        "| | speed | by speed | by turn | turn | by speed | by turn | range, m | by range | bearing, rad | minus twice the log likelihood a sighting |".to_owned(),
        "|---|---|---|---|---|---|---|---|---|---|---|".to_owned(),
    ];
    let mut row = |name: &str, values: &[f64; 9], cost: f64| {
        let values: String = values.iter().map(|v| format!(" {v:.4} |")).collect();
        lines.push(format!("| {name} |{values} {cost:.3} |"));
    };
    let all: Vec<&Log> = logs.iter().collect();
    let mut tries: Vec<(String, Vec<&Log>)> =
        logs.iter().map(|log| (log.robots[0].name.clone(), vec![log])).collect();
    tries.push(("all".into(), all.clone()));
    for (name, of) in tries {
        let cost =
            |values: &[f64; 9]| of.iter().map(|log| unlikely(log, values)).sum::<f64>() / of.len() as f64;
        let mut values = [0.05, 0.1, 0.05, 0.05, 0.05, 0.1, 0.1, 0.05, 0.03];
        let (mut least, mut steps) = (cost(&values), [0.7f64; 9]);
        for _ in 0..8 {
            for i in 0..9 {
                let better = [1.0, -1.0].into_iter().find_map(|sign| {
                    let mut next = values;
                    next[i] *= (sign * steps[i]).exp();
                    Some((next, cost(&next))).filter(|(_, c)| *c < least)
                });
                steps[i] *= if better.is_some() { 1.5 } else { 0.6 };
                (values, least) = better.unwrap_or((values, least));
            }
        }
        row(&name, &values, least);
    }
    for (name, noise) in
        [("with labels, tuned", Noise::mrclam()), ("without labels", Noise::mrclam_unlabelled())]
    {
        let v = noise.velocity;
        let values = [
            v.speed,
            v.speed_by_speed,
            v.speed_by_turn,
            v.turn,
            v.turn_by_speed,
            v.turn_by_turn,
            noise.range_m,
            noise.range_by_range,
            noise.bearing_rad,
        ];
        row(name, &values, all.iter().map(|log| unlikely(log, &values)).sum::<f64>() / 3.0);
    }
    Ok(lines)
}

/// Minus twice the log likelihood of a sighting, up to a constant, in the mean of a labelled run; the normalised innovation squared counts up to
/// its gate.
fn unlikely(log: &Log, values: &[f64; 9]) -> f64 {
    let [speed, speed_by_speed, speed_by_turn, turn, turn_by_speed, turn_by_turn, ..] = *values;
    let velocity = VelocityModel { speed, speed_by_speed, speed_by_turn, turn, turn_by_speed, turn_by_turn };
    let noise = Noise {
        velocity,
        range_m: values[6],
        range_by_range: values[7],
        bearing_rad: values[8],
        ..Noise::mrclam()
    };
    let Ok(steps) = log.robots[0].steps(&noise, &[]) else { return f64::INFINITY };
    let config = EkfConfig::default();
    let (mut filter, gate) = (EkfSlam::new(config), config.gate(2));
    let Ok(id) = filter.add_robot(&Se2::identity(), &(Matrix3::identity() * 1e-12)) else {
        return f64::INFINITY;
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for step in &steps {
        if filter.predict(id, &step.motion).is_err() {
            return f64::INFINITY;
        }
        for sighting in &step.sightings {
            let Target::Landmark(label) = sighting.target else { continue };
            if let Some([nis, determinant]) = filter.innovation(id, label, &sighting.measurement) {
                (sum, count) = (sum + nis.min(gate) + determinant, count + 1.0);
            }
            if filter.observe(id, std::slice::from_ref(sighting)).is_err() {
                return f64::INFINITY;
            }
        }
    }
    sum / count
}

const AGAINST_SMOOTHING: [&str; 2] = [
    "| | poses | landmarks | sightings taken / rejected | NIS a degree of freedom | within 95 % | map off smoothing, RMS, m | live positions off smoothing, RMS, m | filter, ms |",
    "|---|---|---|---|---|---|---|---|---|",
];

fn against_smoothing(name: &str, log: &Log, config: &EkfConfig) -> Result<String, MeasureError> {
    let r = run(log, 0, config)?;
    let ms = now_ms();
    let began_ms = now_ms();
    let again = run(log, 0, config)?;
    let ms = ms.min(now_ms() - began_ms);
    let (smooth, report) = again.smoothed(log, 0, &BatchConfig::default())?;
    if !report.converged {
        return Err(format!("{name}: smoothing did not converge").into());
    }
    let named = r.named();
    let Some((onto, landmarks, _)) = align(&smooth.landmarks, &named) else {
        return Err("too few landmarks".into());
    };
    let position = position_rmse(&r.poses, &onto, &smooth.poses[0], &Se2::identity());
    Ok(format!(
        "| {name} | {} | {} | {} / {} | {:.2} | {:.1} % | {landmarks:.3} | {position:.3} | {ms:.0} |",
        r.poses.len(),
        named.len(),
        r.counts.taken,
        r.counts.rejected,
        r.nis_per_dof,
        100.0 * r.nis_within_95,
    ))
}

/// Instants at which all that was known until then is smoothed.
const KNOWN_LIVE: u32 = 40;

fn victoria(data: &Path) -> Lines {
    let (_, log) = load(&data.join("victoria_park.txt"), None)?;
    let config = EkfConfig { gate_probability: log.gate_probability, ..EkfConfig::default() };
    let local = EkfConfig { local_radius_m: Some(60.0), ..config };
    let mut lines = AGAINST_SMOOTHING.map(str::to_owned).to_vec();
    lines.push(against_smoothing("Victoria Park, everything active", &log, &config)?);
    lines.push(against_smoothing("Victoria Park, local within 60 m", &log, &local)?);
    lines.push(String::new());
    lines.push(known_live(&log, &config)?);
    Ok(lines)
}

/// How far off the positions are that smoothing of all that was known at the time gives: no estimate that is told at once can be expected to be
/// nearer to smoothing of the whole log.
fn known_live(log: &Log, config: &EkfConfig) -> Result<String, MeasureError> {
    let batch = BatchConfig::default();
    let (whole, _) = run(log, 0, config)?.smoothed(log, 0, &batch)?;
    let last = log.robots[0].entries.last().map_or(0.0, |e| e.time_s);
    let (mut sum, mut count, mut filtered) = (0.0, 0.0, 0.0);
    for part in 1..=KNOWN_LIVE {
        let until_s = last * f64::from(part) / f64::from(KNOWN_LIVE);
        let mut so_far = log.clone();
        so_far.robots[0].entries.retain(|e| e.time_s <= until_s);
        let live = run(&so_far, 0, config)?;
        let (smooth, _) = live.smoothed(&so_far, 0, &batch)?;
        let (Some(known), Some(by_filter)) = (smooth.poses[0].last(), live.poses.last()) else { continue };
        let Some(truth) = whole.poses[0].get(live.poses.len() - 1) else { continue };
        sum += (known - truth).xy().norm_squared();
        filtered += (by_filter - truth).xy().norm_squared();
        count += 1.0;
    }
    let rms = |sum: f64| (sum / f64::max(count, 1.0)).sqrt();
    Ok(format!(
        "At {count} instants: live positions of the filter {:.2} m off smoothing of the whole log, RMS; those of smoothing of all that was known then {:.2} m.",
        rms(filtered),
        rms(sum)
    ))
}

fn plaza(data: &Path) -> Lines {
    let (_, log) = load(&data.join("Plaza1_DR.txt"), None)?;
    let mut lines = AGAINST_SMOOTHING.map(str::to_owned).to_vec();
    lines.push(against_smoothing("Plaza 1, ranges only", &log, &EkfConfig::default())?);
    Ok(lines)
}

/// Normalised estimation error squared of the pose at every step, and the sum of the normalised innovations squared with their
/// degrees of freedom.
fn errors(world: &World, seed: u64, config: EkfConfig) -> (Vec<f64>, [f64; 2]) {
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
    let (mut values, mut nis) = (Vec::with_capacity(simulated.steps.len()), [0.0; 2]);
    let Ok(id) = filter.add_robot(&start, &covariance) else { return (values, nis) };
    for (step, truth) in simulated.steps.iter().zip(&simulated.truth) {
        let done = filter.predict(id, &step.motion).and_then(|()| filter.observe(id, &step.sightings));
        let (Ok(verdicts), Some((pose, covariance))) = (done, filter.pose(id)) else { break };
        for verdict in verdicts {
            if let Verdict::Taken { nis: n, dof, .. } = verdict {
                nis = [nis[0] + n, nis[1] + dof as f64];
            }
        }
        let mut error: Vector3<f64> = pose - truth;
        error.z = cairn_filter::angle::wrap(error.z);
        values.push(covariance.cholesky().map_or(f64::INFINITY, |c| error.dot(&c.solve(&error))));
    }
    (values, nis)
}

fn consistency(runs: u64) -> Vec<String> {
    let world = World::default();
    let (low, high) = chi2::mean_bounds(0.95, 3, runs as usize);
    let minutes = (world.duration_s / 60.0) as usize;
    let numbers: String = (1..=minutes).map(|m| format!(" {m} |")).collect();
    let mut lines = vec![
        format!(
            "{} landmarks, {} s, {runs} runs. Mean NEES of the pose (3 degrees of freedom) by minute; 95 % band of the mean over the runs: {low:.2} to {high:.2}.",
            world.landmarks, world.duration_s
        ),
        String::new(),
        format!(
            "| filter |{numbers} in the band, part of the time | NIS a degree of freedom | its 95 % band |"
        ),
        format!("|---|{}---|---|---|", "---|".repeat(minutes)),
    ];
    for (name, linearisation) in [
        ("plain EKF", Linearisation::Latest),
        ("first estimates", Linearisation::First),
        ("invariant (default)", Linearisation::Invariant),
    ] {
        let config = EkfConfig {
            linearisation,
            gate_probability: 1.0,
            local_radius_m: Some(20.0),
            ..EkfConfig::default()
        };
        let all: Vec<(Vec<f64>, [f64; 2])> = (0..runs).map(|seed| errors(&world, seed, config)).collect();
        let steps = all.iter().map(|(nees, _)| nees.len()).min().unwrap_or(0);
        let mean: Vec<f64> =
            (0..steps).map(|k| all.iter().map(|(nees, _)| nees[k]).sum::<f64>() / runs as f64).collect();
        let within = mean.iter().filter(|m| (low..=high).contains(*m)).count() as f64 / steps.max(1) as f64;
        let by_minute: String = mean
            .chunks((60.0 * world.rate_hz) as usize)
            .map(|c| format!(" {:.2} |", c.iter().sum::<f64>() / c.len() as f64))
            .collect();
        let [nis, dof] = all.iter().fold([0.0; 2], |sum, (_, n)| [sum[0] + n[0], sum[1] + n[1]]);
        let (nis_low, nis_high) = chi2::mean_bounds(0.95, 1, dof as usize);
        lines.push(format!(
            "| {name} |{by_minute} {:.0} % | {:.4} | {nis_low:.4} to {nis_high:.4} |",
            100.0 * within,
            nis / dof.max(1.0)
        ));
    }
    lines.push(String::new());
    lines.push(nis_by_noise(runs.min(10)));
    lines
}

/// What linearising at the first estimates costs is of second order in the noise: with half of it, a quarter.
fn nis_by_noise(runs: u64) -> String {
    let config = EkfConfig {
        linearisation: Linearisation::First,
        gate_probability: 1.0,
        local_radius_m: Some(20.0),
        ..EkfConfig::default()
    };
    let parts: Vec<String> = [1.0, 0.5, 0.25]
        .iter()
        .map(|factor| {
            let mut world = World::default();
            world.range_m *= factor;
            world.bearing_rad *= factor;
            world.velocity.speed *= factor;
            world.velocity.turn *= factor;
            let [nis, dof] = (0..runs)
                .map(|seed| errors(&world, seed, config).1)
                .fold([0.0; 2], |sum, n| [sum[0] + n[0], sum[1] + n[1]]);
            let (low, high) = chi2::mean_bounds(0.95, 1, dof as usize);
            format!("{factor}: {:.4} (band {low:.4} to {high:.4})", nis / dof.max(1.0))
        })
        .collect();
    format!("NIS a degree of freedom of first estimates, {runs} runs, all noises times {}.", parts.join("; "))
}

fn speeds(counts: &[usize]) -> Vec<String> {
    let mut lines = vec![
        "| landmarks mapped | active | sightings an update | processor time an update, mean, ms | passed in the second half: mean / median / 99 %, ms | active state |".to_owned(),
        "|---|---|---|---|---|---|".to_owned(),
    ];
    lines.extend(counts.iter().flat_map(|n| speed(*n)));
    lines
}

fn speed(landmarks: usize) -> Vec<String> {
    // A ring that is long enough for this many landmarks at constant density, driven slightly more than once around at
    // 10 Hz.
    let radius_m = 30.0 * landmarks as f64 / 200.0;
    let duration_s = 1.1 * std::f64::consts::TAU * radius_m;
    let world = World { landmarks, radius_m, duration_s, rate_hz: 10.0, ..World::default() };
    let simulated = world.drive(1);
    let mut lines = Vec::new();
    for local_radius_m in [Some(20.0), None] {
        if local_radius_m.is_none() && landmarks > 1000 {
            continue;
        }
        let config = EkfConfig { local_radius_m, gate_probability: 0.999, ..EkfConfig::default() };
        let mut filter = EkfSlam::new(config);
        let Ok(id) = filter.add_robot(&Se2::identity(), &(Matrix3::identity() * 1e-12)) else { continue };
        let mut ms = Vec::new();
        let own_began = now_ms();
        let last =
            if local_radius_m.is_some() { simulated.steps.len() } else { 3000.min(simulated.steps.len()) };
        for step in &simulated.steps[..last] {
            let began = Instant::now();
            let done = filter.predict(id, &step.motion).and_then(|()| filter.observe(id, &step.sightings));
            if done.is_err() {
                break;
            }
            ms.push(began.elapsed().as_secs_f64() * 1e3);
        }
        let own_ms = (now_ms() - own_began) / ms.len().max(1) as f64;
        // The second half of the run, when the map is large; the loop is closed in it.
        let mut late = ms.split_off(ms.len() / 2);
        late.sort_by(f64::total_cmp);
        let at =
            |p: f64| late.get(((late.len().max(1) - 1) as f64 * p) as usize).copied().unwrap_or_default();
        lines.push(format!(
            "| {} | {} | {:.1} | {own_ms:.2} | {:.2} / {:.2} / {:.2} | {} |",
            filter.landmarks().len(),
            local_radius_m.map_or("all".into(), |r| format!("within {r} m")),
            simulated.steps.iter().map(|s| s.sightings.len()).sum::<usize>() as f64
                / simulated.steps.len() as f64,
            late.iter().sum::<f64>() / late.len().max(1) as f64,
            at(0.5),
            at(0.99),
            filter.active_size()
        ));
    }
    lines
}
