//! `cairn sim`: writes a simulated sequence with ground truth as a folder in a standard layout.

use crate::failure::Failure;
use crate::output::Output;
use crate::progress::Progress;
use cairn_sensor::{FramePacket, Rig, Skips, Source, SourceError, SourceInfo};
use cairn_sim::{SimConfig, WorldKind, write_euroc, write_tum};
use cairn_sources::{OpenOptions, open};
use serde::Serialize;
use std::path::PathBuf;

/// Writes a simulated recording with exact ground truth, in the EuRoC layout or (RGB-D) the TUM layout.
#[derive(clap::Args)]
#[command(after_long_help = keys())]
pub struct Arguments {
    /// The simulated world with its options, such as corridor or "office?seed=3&sensor=rgbd".
    #[arg(value_name = "WORLD")]
    world: String,
    /// The folder to write; must be new or empty.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The layout; by default TUM for RGB-D, else EuRoC.
    #[arg(long, value_enum, value_name = "LAYOUT")]
    layout: Option<Layout>,
}

#[derive(Clone, Copy, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
enum Layout {
    /// mav0/cam0, cam1, imu0 and the ground truth of the body.
    Euroc,
    /// rgb, depth, accelerometer and the ground truth of the camera.
    Tum,
}

#[derive(Serialize)]
struct Written {
    source: String,
    folder: PathBuf,
    layout: Layout,
    frames: usize,
    rate_hz: f64,
    length_m: f64,
}

/// The worlds and their options, for `--help`.
fn keys() -> String {
    let worlds: Vec<&str> = WorldKind::ALL.iter().map(|k| k.name()).collect();
    let keys: Vec<String> = SimConfig::KEYS.iter().map(|(k, what)| format!("  {k:<12}{what}")).collect();
    format!("Worlds: {}\nOptions (WORLD?key=value&key=value):\n{}", worlds.join(", "), keys.join("\n"))
}

/// Renders and writes the sequence.
///
/// # Errors
/// When the world is unknown or the folder cannot be written.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let address = if a.world.starts_with("sim:") { a.world.clone() } else { format!("sim:{}", a.world) };
    let source = open(&address, OpenOptions::default())?;
    let layout = a.layout.unwrap_or(if source.rig().depth.is_some() { Layout::Tum } else { Layout::Euroc });
    let info = source.info().clone();
    let progress = Progress::new(info.frames);
    let mut source = CountingSource { source, progress, given: 0 };
    let frames = match layout {
        Layout::Euroc => write_euroc(&a.out, &mut source)?,
        Layout::Tum => write_tum(&a.out, &mut source)?,
    };
    drop(source);
    let steps = info.truth.windows(2).map(|w| (w[1].1.translation - w[0].1.translation).norm());
    let written = Written {
        source: info.name,
        folder: a.out.clone(),
        layout,
        frames,
        rate_hz: info.rate_hz,
        length_m: steps.sum(),
    };
    output.result(&written, |w| {
        format!(
            "{}: {} frames at {} Hz over {:.1} m in {}",
            w.source,
            w.frames,
            w.rate_hz,
            w.length_m,
            w.folder.display()
        )
    })
}

/// A source that advances the progress bar with each packet.
struct CountingSource {
    source: Box<dyn Source>,
    progress: Progress,
    given: usize,
}

impl Source for CountingSource {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn rig(&self) -> &Rig {
        self.source.rig()
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        self.given += 1;
        self.progress.step(self.given);
        self.source.next_packet()
    }

    fn skipped(&self) -> &[String] {
        self.source.skipped()
    }

    fn skips(&self) -> Skips {
        self.source.skips()
    }
}
