//! Scenarios run by tests, and that each of them is understood.

use bench::scenario::{self, Bindings, Chosen, Scenario, judge, tables};
use bench::{Figures, data_folder};

/// The figures of the runs that are chosen, which keep to the limits of the scenario; none where recordings are missing.
pub fn run(name: &str, set: &[(&str, &str)]) -> Vec<Figures> {
    run_with(name, set, "")
}

/// The same with settings of the engine in TOML.
pub fn run_with(name: &str, set: &[(&str, &str)], config: &str) -> Vec<Figures> {
    let scenario = Scenario::read(name).unwrap();
    let set: Bindings = set.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect();
    let chosen = Chosen {
        name: name.into(),
        set,
        data: data_folder(),
        times: Some(1),
        jobs: 1,
        config: config.into(),
        verbose: false,
        here: true,
    };
    let rows = scenario::run(&scenario, &chosen).unwrap();
    for (_, text) in tables(&scenario, &rows).unwrap() {
        println!("{text}");
    }
    assert_eq!(judge(&scenario, &rows).unwrap(), Vec::<String>::new());
    rows.iter().map(|row| row.figures().unwrap()).collect()
}

#[test]
fn every_scenario_is_understood() {
    for name in Scenario::all().unwrap().into_keys() {
        let scenario = Scenario::read(&name).unwrap();
        for run in scenario.runs(&Bindings::new()).unwrap() {
            let run = run.into_iter().chain([("data".to_owned(), String::new())]).collect();
            for text in [&scenario.run.address, &scenario.run.sensors]
                .into_iter()
                .chain(scenario.run.options.values())
            {
                scenario::fill(text, &run).unwrap_or_else(|e| panic!("{name}: {e}"));
            }
        }
        for page in scenario.table.iter().filter_map(|table| table.page.as_ref()) {
            let path = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(page);
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.contains(&format!("<!-- figures: {name} -->")), "{} has no {name}", page.display());
        }
    }
}

#[test]
fn seeds_cover_every_difficulty_in_every_world_and_drawn_ones_are_of_the_same_kind() {
    let scenario = Scenario::read("walks").unwrap();
    let set = |seeds: &str| -> Bindings {
        let set = [("seeds", seeds), ("sensors", "mono"), ("seed", "0..23")];
        set.map(|(name, value)| (name.to_owned(), value.to_owned())).into()
    };
    let fixed = scenario.runs(&set("fixed")).unwrap();
    let drawn = scenario.runs(&set("drawn")).unwrap();
    for world in ["corridor", "office", "hall", "street"] {
        let here: Vec<[&str; 3]> = fixed
            .iter()
            .filter(|run| run["world"] == world)
            .map(|run| ["poor", "passers", "blur"].map(|name| run[name].as_str()))
            .collect();
        assert!(here.iter().any(|[poor, passers, _]| *poor != "0" && *passers == "0"), "{here:?}");
        assert!(here.iter().any(|[_, passers, _]| *passers != "0"), "{here:?}");
        assert!(here.iter().any(|[_, _, blur]| *blur != "0"), "{here:?}");
        assert!(here.contains(&["0"; 3]), "{here:?}");
    }
    for (one, other) in fixed.iter().zip(&drawn) {
        assert_eq!(one["walk_seed"], one["seed"]);
        let seed: u64 = other["walk_seed"].parse().unwrap();
        assert!(seed >= 48);
        let again = [("seeds", "fixed".to_owned()), ("sensors", "mono".into()), ("seed", seed.to_string())];
        let again = scenario.runs(&again.map(|(name, value)| (name.to_owned(), value)).into()).unwrap();
        for name in ["world", "poor", "passers", "blur"] {
            assert_eq!(again[0][name], one[name], "{name} of {seed}");
        }
    }
}

#[test]
fn a_name_that_is_not_there_is_an_error() {
    let scenario = Scenario::read("walks").unwrap();
    for (name, value) in [("worlds", "hall"), ("sensors", "sonar"), ("seed", "two")] {
        let why = scenario.runs(&Bindings::from([(name.to_owned(), value.to_owned())])).unwrap_err();
        assert!(why.to_string().contains(name), "{why}");
    }
}
