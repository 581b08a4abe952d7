//! A small version of the example `walks`, with required figures, and transcripts that people can read.
//! `CAIRN_UPDATE=1 cargo test -p cairn-guide --test walks` rewrites the transcripts.

use cairn_guide::trial::{Noise, Outcome, Tally, TrialConfig, random_route, run};
use cairn_guide::{Facing, Travel};
use std::path::PathBuf;

fn trial(seed: u64, facing: Facing, noise: Noise) -> Outcome {
    let crossing = seed % 4 == 3;
    let corridor_m = 1.5 + 0.1 * (seed % 16) as f64;
    run(
        &random_route(seed, crossing),
        &TrialConfig { facing, travel: Travel::Home, noise, corridor_m, cut_detours: !crossing, seed },
    )
}

fn tally(facing: Facing, noise: Noise) -> Tally {
    let mut tally = Tally::default();
    for seed in 1000..1100 {
        tally.add(&trial(seed, facing, noise));
    }
    println!(
        "{facing:?} {noise:?}: {:.3} arrived, {:.2} off, {} wrong of {}, {:.1} said",
        tally.arrival_rate(),
        tally.off_path_per_50_m(),
        tally.wrong_side,
        tally.said,
        tally.said_per_100_m()
    );
    tally
}

#[test]
fn walkers_arrive_home() {
    for facing in [Facing::Home, Facing::Back, Facing::Backwards] {
        for noise in [Noise::None, Noise::Usual] {
            let t = tally(facing, noise);
            assert!(t.arrival_rate() >= 0.99, "{facing:?} {noise:?}: {} arrived", t.arrival_rate());
            assert!(t.off_path_per_50_m() <= 1.0, "{facing:?} {noise:?}: {}", t.off_path_per_50_m());
            assert!(
                t.wrong_side as f64 <= 0.001 * t.said as f64,
                "{facing:?} {noise:?}: {} wrong",
                t.wrong_side
            );
            let most = if facing == Facing::Backwards { 52.0 } else { 36.0 };
            assert!(t.said_per_100_m() <= most, "{facing:?} {noise:?}: {}", t.said_per_100_m());
        }
    }
}

#[test]
fn trials_are_deterministic() {
    assert_eq!(trial(7, Facing::Home, Noise::Usual), trial(7, Facing::Home, Noise::Usual));
}

#[test]
fn transcripts() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/transcripts");
    for (name, seed, facing, noise) in [
        ("home", 1, Facing::Home, Noise::None),
        ("home-with-losses", 2, Facing::Home, Noise::Usual),
        ("backwards", 5, Facing::Backwards, Noise::None),
    ] {
        let o = trial(seed, facing, noise);
        let text = format!(
            "{:.0} m home in {:.0} s, {:.1} m from the end, {} utterances\n\n{}",
            o.length_m,
            o.seconds,
            o.error_m,
            o.said.len(),
            o.transcript()
        );
        let path = folder.join(format!("{name}.txt"));
        if std::env::var_os("CAIRN_UPDATE").is_some() {
            std::fs::write(&path, &text).unwrap();
        }
        let kept = std::fs::read_to_string(&path).unwrap_or_default();
        assert_eq!(
            text,
            kept,
            "the transcript changed: read it, then CAIRN_UPDATE=1 writes {}",
            path.display()
        );
    }
}
