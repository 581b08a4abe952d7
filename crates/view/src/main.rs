//! The program `cairn-view`: messages of a map on standard input, a window with it. `cairn view` starts it.

mod window;

use cairn_phrases::Language;
use clap::Parser;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::process::ExitCode;

/// Shows in a window the map whose messages come on standard input; cairn view starts it.
#[derive(Parser)]
#[command(name = "cairn-view", version)]
struct Arguments {
    /// The language of the window.
    #[arg(long, default_value_t, value_name = "CODE")]
    language: Language,
    /// Writes what the window shows once all is there, as PNG, and ends.
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
}

fn main() -> ExitCode {
    let a = Arguments::parse();
    if std::io::stdin().is_terminal() {
        eprintln!("error: cairn-view shows what another program sends it: use cairn view MAP");
        return ExitCode::from(2);
    }
    match window::show(a.language, a.picture) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("error: the window: {why}");
            ExitCode::FAILURE
        }
    }
}
