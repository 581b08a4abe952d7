//! Brings simulated walkers home over random ways on poses, and prints the figures.
//! `cargo run --release -p cairn-guide --example walks -- [WAYS] [SEED-TO-SHOW [WHICH]]`: the transcript of
//! one seed can be shown, for all or for one (0 to 5) of the six kinds of trial.

use cairn_guide::Facing;
use cairn_guide::trial::{Noise, Outcome, Tally, TrialSetting, random_way, run};

fn trial(seed: u64, facing: Facing, noise: Noise) -> Outcome {
    let crossing = seed % 4 == 3;
    let line = random_way(seed, crossing);
    let corridor_m = 1.5 + 0.1 * (seed % 16) as f64;
    run(&line, &TrialSetting { facing, noise, corridor_m, cut_detours: !crossing, seed })
}

fn main() {
    let numbers: Vec<u64> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let ways = numbers.first().copied().unwrap_or(200);
    let mut kind = 0;
    for (facing, name) in
        [(Facing::Home, "home"), (Facing::Back, "camera back"), (Facing::Backwards, "backwards")]
    {
        for noise in [Noise::None, Noise::Usual] {
            let mut tally = Tally::default();
            let mut worst: Vec<(f64, u64)> = Vec::new();
            for seed in 0..ways {
                let o = trial(seed, facing, noise);
                tally.add(&o);
                let miss = if o.arrived { 0.0 } else { 100.0 };
                worst.push((miss + o.error_m + o.off_path as f64 + 10.0 * o.wrong_side as f64, seed));
            }
            worst.sort_by(|a, b| b.0.total_cmp(&a.0));
            let mut errors = tally.errors_m.clone();
            errors.sort_by(f64::total_cmp);
            println!(
                "{name:<12} {:<6} {} ways, {:.0} m: arrived within 1 m {:.1} %, error p50 {:.2} m, max {:.2} m; \
                 off path {:.2} per 50 m; wrong side {}; utterances {:.1} per 100 m",
                if noise == Noise::None { "exact" } else { "noisy" },
                tally.trials,
                tally.metres,
                100.0 * tally.arrival_rate(),
                errors[errors.len() / 2],
                errors[errors.len() - 1],
                tally.off_path_per_50_m(),
                tally.wrong_side,
                tally.said_per_100_m(),
            );
            let kinds: Vec<String> = (tally.kinds.iter())
                .map(|(k, n)| format!("{k} {:.1}", 100.0 * *n as f64 / tally.metres))
                .collect();
            println!("    per 100 m: {}", kinds.join(", "));
            println!("    worst seeds: {:?}", worst.iter().take(5).map(|w| w.1).collect::<Vec<_>>());
            kind += 1;
            if let Some(seed) = numbers.get(1).filter(|_| numbers.get(2).is_none_or(|k| *k + 1 == kind)) {
                println!("{}", trial(*seed, facing, noise).transcript());
            }
        }
    }
}
