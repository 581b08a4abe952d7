//! `cairn demo`: the main job on an embedded world. A walker goes out, the engine sees rendered images, the way is
//! recorded and cleaned; then a walker who hears only the announced words comes home, again through rendered images.
//!
//! The guide gets only what the engine says. Which way is up it learns from the walk itself (`Ground::of_walk`): the
//! map begins at the first camera and knows no gravity. The truth of the simulation is used for the figures alone.

mod body;
mod camera;
mod config;
mod home;
mod once;
mod out;
mod report;
mod seeds;

use crate::failure::Failure;
use crate::output::Output;
use cairn_guide::Facing;
use cairn_sim::SimSensor;
use clap::ValueEnum;
use config::DemoConfig;
use std::path::PathBuf;

/// A walker goes out through an embedded world and is guided home by words.
///
/// Walks about 40 m with three turns, records and cleans the way, and brings a simulated walker home who hears only
/// what is announced. Prints what was said and the figures, and writes a report that opens in any browser.
#[derive(clap::Args)]
pub struct Arguments {
    /// How the walker goes home.
    #[arg(long, value_enum, default_value = "home")]
    facing: FacingArgument,
    /// What the engine sees with.
    #[arg(long, value_enum, default_value = "stereo")]
    sensor: SensorArgument,
    /// Seed of the world, of the sensors' noise and of the walker.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Runs so many seeds from --seed on, and prints a table of them.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: Option<u64>,
    /// Walks only so much of the way out, in metres.
    #[arg(long, value_name = "M", value_parser = metres)]
    metres: Option<f64>,
    /// The folder for report, transcript, way and trajectories.
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
}

/// The three ways back.
#[derive(Clone, Copy, ValueEnum)]
enum FacingArgument {
    /// Turns round and walks with the camera ahead.
    Home,
    /// Turns the camera round on the chest: it looks back while the walker goes forwards.
    Back,
    /// Walks backwards, the camera as on the way out.
    Backwards,
    /// All three, with --seeds.
    All,
}

#[derive(Clone, Copy, ValueEnum)]
enum SensorArgument {
    /// Two cameras.
    Stereo,
    /// One camera and depth.
    Rgbd,
}

fn metres(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(m) if (5.0..=1000.0).contains(&m) => Ok(m),
        _ => Err("must be a number of metres from 5".into()),
    }
}

/// Runs one demo or a table of them.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    let facings: &[Facing] = match arguments.facing {
        FacingArgument::Home => &[Facing::Home],
        FacingArgument::Back => &[Facing::Back],
        FacingArgument::Backwards => &[Facing::Backwards],
        FacingArgument::All => &[Facing::Home, Facing::Back, Facing::Backwards],
    };
    let sensor = match arguments.sensor {
        SensorArgument::Stereo => SimSensor::Stereo,
        SensorArgument::Rgbd => SimSensor::Rgbd,
    };
    let config = |seed, facing| DemoConfig::new(seed, facing, sensor, arguments.metres);
    match (arguments.seeds, facings) {
        (Some(count), _) => {
            let seeds = (0..count).map(|k| arguments.seed.saturating_add(k));
            let all = facings.iter().flat_map(|f| seeds.clone().map(move |seed| (seed, *f)));
            seeds::run(all.map(|(seed, f)| config(seed, f)), output)
        }
        (None, [facing]) => report::run(&config(arguments.seed, *facing), &arguments.out, output),
        (None, _) => Err(Failure::new(
            "--facing all",
            "is for many demos",
            "add --seeds N, or choose one of home, back, backwards",
        )),
    }
}
