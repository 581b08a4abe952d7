//! `cairn page`: writes the web page with the engine in it as files, for any web server.

use crate::failure::Failure;
use crate::output::Output;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// How a module is made.
const BUILD: &str = "build it with tools/build_wasm, then give --module target/wasm/cairn.wasm";

/// Writes the page with the engine in it: a phone that has opened it once needs neither computer nor network.
///
/// The files can be served by any web server over HTTPS. Pictures, maps and routes stay in the phone. The engine is the
/// WebAssembly module that tools/build_wasm builds.
#[derive(clap::Args)]
pub struct Arguments {
    /// The folder to write; files of an earlier page in it are replaced.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The engine as a WebAssembly module; with the demo where its walker.wasm lies beside it.
    #[arg(long, value_name = "FILE")]
    module: Option<PathBuf>,
}

#[derive(Serialize)]
struct Written {
    folder: PathBuf,
    files: usize,
    bytes: usize,
}

/// Writes the files.
///
/// # Errors
/// Without a module, with another file for one, and when the folder cannot be written.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let module = a.module.as_deref().ok_or_else(|| Failure::usage("--module", "is missing", BUILD))?;
    let named = |why: String| Failure::new(module.display().to_string(), why, BUILD);
    let bytes = std::fs::read(module).map_err(|e| named(e.to_string()))?;
    let beside = module.with_file_name("walker.wasm");
    let walker = match std::fs::read(&beside) {
        Ok(bytes) => Some(bytes),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => None,
        Err(e) => return Err(Failure::new(beside.display().to_string(), e.to_string(), BUILD)),
    };
    let files = cairn_web::site(bytes, walker).map_err(|e| named(e.to_string()))?;
    for (name, bytes) in &files {
        write(&a.out.join(name), bytes)?;
    }
    let bytes = files.iter().map(|(_, bytes)| bytes.len()).sum();
    let written = Written { folder: a.out.clone(), files: files.len(), bytes };
    output.result(&written, |w| {
        format!("{} files, {:.1} MB, in {}", w.files, w.bytes as f64 / 1e6, w.folder.display())
    })
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let folder = path.parent().unwrap_or(path);
    let written = std::fs::create_dir_all(folder).and_then(|()| std::fs::write(path, bytes));
    written.map_err(|e| {
        Failure::new(path.display().to_string(), e.to_string(), "give another folder with --out")
    })
}
