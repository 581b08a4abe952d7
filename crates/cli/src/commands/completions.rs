//! `cairn completions` and `cairn man`: what shells and manual readers need, from the same definitions as `--help`.

use crate::failure::Failure;
use crate::output::Output;
use crate::outputs::Outputs;
use clap::CommandFactory;
use std::io::Write;
use std::path::PathBuf;

/// Prints completions for a shell.
///
/// For bash: cairn completions bash > ~/.local/share/bash-completion/completions/cairn
#[derive(clap::Args)]
pub struct Completions {
    /// The shell.
    #[arg(value_enum, value_name = "SHELL")]
    shell: clap_complete::Shell,
}

/// Writes manual pages, one for each command.
#[derive(clap::Args)]
pub struct Man {
    /// The folder for the pages, such as /usr/local/share/man/man1.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Replaces pages that exist.
    #[arg(long)]
    overwrite: bool,
}

/// Prints the completions.
///
/// # Errors
/// When stdout cannot be written.
pub fn completions(a: &Completions) -> Result<(), Failure> {
    let mut text = Vec::new();
    clap_complete::generate(a.shell, &mut crate::Arguments::command(), "cairn", &mut text);
    match std::io::stdout().lock().write_all(&text) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::new("stdout", e.to_string(), "check where the output is redirected to"))
        }
        _ => Ok(()),
    }
}

/// The pages that were written.
#[derive(serde::Serialize)]
struct Written {
    pages: Vec<PathBuf>,
}

/// Writes the pages.
///
/// # Errors
/// When one of them exists or cannot be written.
pub fn man(a: &Man, output: &Output) -> Result<(), Failure> {
    crate::outputs::folder(&a.out)?;
    let mut command = crate::Arguments::command();
    command.build();
    let mut pages = Vec::new();
    gather(&command, "", &mut pages).map_err(|e| Failure::new("man", e.to_string(), "report this"))?;
    let mut checked = Vec::new();
    for (name, text) in pages {
        let path = a.out.join(format!("{name}.1"));
        let outputs = Outputs::new(a.overwrite).output("--out", Some(&path)).checked()?;
        checked.push((path, outputs, text));
    }
    let mut failures = Vec::new();
    let mut written = Vec::new();
    for (path, outputs, text) in checked {
        match outputs.write("--out", || Ok(text)) {
            Ok(()) => written.push(path),
            Err(failure) => failures.push(failure),
        }
    }
    Failure::all(failures)?;
    output.result(&Written { pages: written }, |w| format!("{} pages in {}", w.pages.len(), a.out.display()))
}

/// The page of a command, then those of its subcommands.
fn gather(command: &clap::Command, before: &str, pages: &mut Vec<(String, Vec<u8>)>) -> std::io::Result<()> {
    let name = match before {
        "" => command.get_name().to_owned(),
        before => format!("{before}-{}", command.get_name()),
    };
    let mut text = Vec::new();
    clap_mangen::Man::new(command.clone().name(name.clone())).render(&mut text)?;
    pages.push((name.clone(), text));
    let inner = command.get_subcommands().filter(|c| !c.is_hide_set() && c.get_name() != "help");
    inner.into_iter().try_for_each(|c| gather(c, &name, pages))
}
