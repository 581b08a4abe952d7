//! `cairn view`: a saved map, or a walk that goes on, in a window. The window is a program of its own, so that this one has nothing of
//! windows in it; it gets the messages that the page gets.

mod live;
mod saved;
mod window;

use crate::failure::Failure;
use crate::number::between;
use crate::output::Output;
use cairn_phrases::Language;
use std::path::PathBuf;

/// Shows a map in a window: points, key frames, routes, loops, and the surface and the free space where it has depth. Needs the program cairn-view.
///
/// A saved map is shown as it is; a map that grows, by the address of its page (cairn serve): a second page may be open meanwhile.
#[derive(clap::Args)]
#[command(after_long_help = keys())]
pub struct Arguments {
    /// A saved map, or the address that cairn serve has printed (https://...#k=...).
    #[arg(value_name = "MAP")]
    source: String,
    /// Which map of the file, by the number of its root key frame; by default the one with the most key frames.
    #[arg(long, value_name = "ROOT")]
    map: Option<usize>,
    /// Edge of a voxel of the surface of a saved map in metres.
    #[arg(long, default_value_t = 0.02, value_name = "M", value_parser = between(0.005, 0.5))]
    voxel: f64,
    /// The certificate of a page on another machine, or of its authority (PEM or DER); that of this machine is found in the data folder.
    #[arg(long, value_name = "FILE")]
    certificate: Option<PathBuf>,
    /// The language of the window.
    #[arg(long, default_value_t, value_name = "CODE")]
    language: Language,
    /// Writes what the window shows once a saved map is there, as PNG, and ends.
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
}

/// What the keys do; the same sentence is in the window and on the page.
fn keys() -> String {
    format!("Keys: {}", Language::English.text("page-map-help"))
}

/// Shows the map until its window is closed.
///
/// # Errors
/// When the program of the window is not installed, the map cannot be read, or the page cannot be reached.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let is_live = a.source.starts_with("https://");
    if let Some(option) = given(a, is_live) {
        let (what, hint) = match is_live {
            true => ("a map that grows", "give a saved map"),
            false => ("a saved map", "leave it out, or give the address of a page"),
        };
        return Err(Failure::usage(option, format!("{what} does not take it"), hint));
    }
    match is_live {
        true => live::show(a),
        false => saved::show(a, output),
    }
}

/// An option that was given and is not for this kind of map.
fn given(a: &Arguments, is_live: bool) -> Option<&'static str> {
    match is_live {
        true if a.map.is_some() => Some("--map"),
        true if a.picture.is_some() => Some("--picture"),
        false if a.certificate.is_some() => Some("--certificate"),
        _ => None,
    }
}
