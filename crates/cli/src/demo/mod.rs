//! `cairn demo`: the main use case in a simulated world. A walker goes out, the engine gets rendered images, the route
//! is recorded and cleaned; then a simulated walker who gets only the announcements returns, again with rendered
//! images.
//!
//! The guide gets only the engine's output. The up direction is estimated from the walk itself (`Ground::of_walk`): the
//! map starts at the first camera and is not gravity-aligned. Ground truth is used only for the figures.

mod camera;
mod config;
mod home;
mod once;
mod out;
mod phone;
mod report;
mod robot;
mod seeds;
mod team;

use crate::commands::run::sensors;
use crate::failure::Failure;
use crate::number::number;
use crate::output::Output;
use crate::speaking::Speaking;
use cairn_engine::SensorMode;
use cairn_engine::Sensors;
use cairn_guide::Facing;
use clap::ValueEnum;
use config::DemoConfig;
use std::path::PathBuf;

/// Simulates a walk out and a guided return, and reports how it went.
///
/// Walks about 40 m with three turns through a built-in simulated world, records and cleans the route, and guides a
/// simulated walker back who gets nothing but the announcements. Prints the announcements and the figures, and writes a
/// report that opens in any browser.
#[derive(clap::Args)]
pub struct Arguments {
    /// How the walker faces on the return.
    #[arg(long, value_enum, default_value = "home")]
    facing: FacingArgument,
    /// Which sensor the engine uses.
    #[arg(long, value_parser = sensors(), default_value = "stereo")]
    sensor: Sensors,
    /// Seed of the world, the sensor noise and the walker.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Runs N seeds, starting with --seed, and prints a table.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: Option<u64>,
    /// Walks only the first M metres of the route (5 to 1000).
    #[arg(long, value_name = "M", value_parser = number(5.0..=1000.0, "a number of metres from 5 to 1000"))]
    metres: Option<f64>,
    /// A robot instead of a walker: it explores an apartment that it does not know and is sent to three rooms, while
    /// people walk about and a door closes.
    #[arg(long, conflicts_with_all = ["facing", "sensor", "metres"])]
    robot: bool,
    /// N robots instead of a walker: they walk through one world at once, each in processes of its own, and share their
    /// maps over the loopback; one is killed in the middle and brought back (about a minute).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=4),
        conflicts_with_all = ["facing", "sensor", "metres", "robot", "phone", "obstacles", "dense", "seeds"])]
    team: Option<u16>,
    /// A phone as phones are instead of a calibrated camera: pictures at 10 to 20 Hz with a rolling shutter and an unknown
    /// lens, motion at 60 Hz, through the page's own protocol and in real time (about three minutes for each walk).
    #[arg(long, conflicts_with_all = ["robot", "sensor", "obstacles", "dense"])]
    phone: bool,
    /// With --phone: the server is given the phone's true lens, as with cairn serve --rig.
    #[arg(long, requires = "phone")]
    known_lens: bool,
    /// With --phone: milliseconds from the first row of a picture to the last, instead of the phone's own 15 to 25; 0 is a
    /// global shutter.
    #[arg(long, value_name = "MS", requires = "phone", 
        value_parser = number(0.0..=100.0, "milliseconds from 0 to 100"))]
    readout: Option<f64>,
    /// With --phone: the phone is held upright, so that its pictures are higher than wide and the rows of its sensor are their
    /// columns.
    #[arg(long, requires = "phone")]
    upright: bool,
    /// Puts N things into the walker's way after the route was recorded (boxes on the floor, boxes at head height, a barrier
    /// that is taken away later); needs depth. The walker's cane does not feel them.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=20))]
    obstacles: u64,
    /// Also writes the surface of what was seen as surface.ply and a picture of it as surface.png; needs depth.
    #[arg(long)]
    dense: bool,
    /// The folder for the report, the transcript, the route and the trajectories.
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    /// Replaces the files of an earlier demo in that folder.
    #[arg(long)]
    overwrite: bool,
    #[command(flatten)]
    speaking: Speaking,
}

/// How the walker faces on the return.
#[derive(Clone, Copy, ValueEnum)]
enum FacingArgument {
    /// The walker turns round and walks with the camera facing ahead.
    Home,
    /// The walker turns the camera round on the chest: it looks back while the walker walks forwards.
    Back,
    /// The walker walks backwards, the camera as on the way out.
    Backwards,
    /// All three, one after the other; needs --seeds.
    All,
}

/// Runs one demo or a table of them.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    if let Some(count) = arguments.team {
        return team::run(count, arguments.seed, &arguments.out, arguments.overwrite, output);
    }
    if arguments.robot {
        let seeds = arguments.seeds.map(|count| (0..count).map(|k| arguments.seed.saturating_add(k)));
        return match seeds {
            Some(seeds) => robot::many(seeds, output),
            None => robot::one(arguments.seed, &arguments.out, arguments.overwrite, output),
        };
    }
    let facings: &[Facing] = match arguments.facing {
        FacingArgument::Home => &[Facing::Home],
        FacingArgument::Back => &[Facing::Back],
        FacingArgument::Backwards => &[Facing::Backwards],
        FacingArgument::All => &[Facing::Home, Facing::Back, Facing::Backwards],
    };
    if arguments.phone {
        let seeds = (0..arguments.seeds.unwrap_or(1)).map(|k| arguments.seed.saturating_add(k));
        let all = facings.iter().flat_map(|f| seeds.clone().map(move |seed| (seed, *f)));
        let config = |(seed, facing)| {
            let mut config =
                DemoConfig::new(seed, facing, Sensors::MonoImu, arguments.metres, arguments.speaking.clone());
            config.sim.rate_hz = phone::BODY_HZ;
            config
        };
        let options = phone::Options {
            known_lens: arguments.known_lens,
            readout_s: arguments.readout.map(|ms| 1e-3 * ms),
            upright: arguments.upright,
            overwrite: arguments.overwrite,
        };
        return phone::run(all.map(config), options, &arguments.out, output);
    }
    let depth = arguments.sensor.mode() == SensorMode::Rgbd;
    for (option, given) in [("--obstacles", arguments.obstacles > 0), ("--dense", arguments.dense)] {
        if given && !depth {
            return Err(Failure::usage(option, "needs depth", "add --sensor rgbd or rgbd-imu"));
        }
    }
    let config = |seed, facing| DemoConfig {
        obstacles: arguments.obstacles as usize,
        dense: arguments.dense,
        ..DemoConfig::new(seed, facing, arguments.sensor, arguments.metres, arguments.speaking.clone())
    };
    match (arguments.seeds, facings) {
        (Some(count), _) => {
            let seeds = (0..count).map(|k| arguments.seed.saturating_add(k));
            let all = facings.iter().flat_map(|f| seeds.clone().map(move |seed| (seed, *f)));
            seeds::run(all.map(|(seed, f)| config(seed, f)), output)
        }
        (None, [facing]) => {
            report::run(&config(arguments.seed, *facing), &arguments.out, arguments.overwrite, output)
        }
        (None, _) => Err(Failure::new(
            "--facing all",
            "needs --seeds",
            "add --seeds N, or choose one of home, back, backwards",
        )),
    }
}
