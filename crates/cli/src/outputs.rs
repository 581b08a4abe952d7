//! The files that a command writes: checked before the work starts, and written independently of each other.
//!
//! Nothing is overwritten unseen, no output may be an input or another output, and symbolic links are written through.

use crate::failure::Failure;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

const WRITABLE: &str = "check that its folder is writable and that the disk has room";

/// What may happen to a file that exists already.
#[derive(Clone, Copy)]
enum Existing {
    /// It is replaced with `--overwrite` only.
    Refused,
    /// It may be the input of this option, which is replaced.
    Input(&'static str),
    /// The command has a rule of its own.
    Own,
}

/// One output file.
struct Target {
    option: &'static str,
    /// As the user gave it.
    given: PathBuf,
    /// The file behind all symbolic links; as given until it is checked.
    file: PathBuf,
    existing: Existing,
    /// Whether it is a saved map; no other file replaces one.
    is_map: bool,
}

/// The files that a command reads and writes.
pub struct Outputs {
    overwrite: bool,
    inputs: Vec<(&'static str, PathBuf)>,
    targets: Vec<Target>,
}

impl Outputs {
    /// None yet; with `overwrite`, existing files may be replaced.
    pub fn new(overwrite: bool) -> Self {
        Self { overwrite, inputs: Vec::new(), targets: Vec::new() }
    }

    /// Adds a file or folder that is read. What does not exist (the address of a stream) is ignored.
    pub fn input(mut self, name: &'static str, path: Option<&Path>) -> Self {
        self.inputs.extend(path.and_then(|p| p.canonicalize().ok()).map(|p| (name, p)));
        self
    }

    /// Adds a file that is written.
    pub fn output(self, option: &'static str, path: Option<&Path>) -> Self {
        self.target(option, path, Existing::Refused, false)
    }

    /// Adds a map that is written.
    pub fn output_map(self, option: &'static str, path: Option<&Path>) -> Self {
        self.target(option, path, Existing::Refused, true)
    }

    /// Adds a map that is written and may be the same as the input of this name.
    pub fn output_map_over(self, option: &'static str, path: Option<&Path>, input: &'static str) -> Self {
        self.target(option, path, Existing::Input(input), true)
    }

    /// Adds a file for which the command itself decides what happens if it exists.
    pub fn output_kept(self, option: &'static str, path: Option<&Path>) -> Self {
        self.target(option, path, Existing::Own, false)
    }

    fn target(mut self, option: &'static str, path: Option<&Path>, existing: Existing, is_map: bool) -> Self {
        let target = |p: &Path| Target { option, given: p.into(), file: p.into(), existing, is_map };
        self.targets.extend(path.map(target));
        self
    }

    /// Checks every output; to be called before the work starts.
    ///
    /// # Errors
    /// Wrong usage where an output is an input or another output; a failure where one exists or cannot be written.
    pub fn checked(mut self) -> Result<Self, Failure> {
        for target in &mut self.targets {
            target.file = behind_links(&target.given)?;
        }
        for (i, target) in self.targets.iter().enumerate() {
            let shown = || format!("{} {}", target.option, target.given.display());
            if let Some(other) = self.targets[..i].iter().find(|other| same(&other.file, &target.file)) {
                let why = format!("is the same file as {} {}", other.option, other.given.display());
                return Err(Failure::usage(shown(), why, "give every output a file of its own"));
            }
            if let Some((name, input)) = self.inputs.iter().find(|(name, path)| target.hits(name, path)) {
                let why = match input.is_dir() {
                    true => format!("is a file in the folder of {name}, which is read"),
                    false => format!("is {name}, which is read"),
                };
                return Err(Failure::usage(shown(), why, "write to another file"));
            }
        }
        for target in &self.targets {
            let replaced = match target.existing {
                Existing::Own => continue,
                Existing::Refused => false,
                Existing::Input(name) => {
                    self.inputs.iter().any(|(n, path)| *n == name && same(path, &target.file))
                }
            };
            if target.file.exists() && !self.overwrite && !replaced {
                let hint = "give another name, or --overwrite to replace it";
                return Err(Failure::new(target.given.display().to_string(), "it exists already", hint));
            }
            if let Some(kind) = precious(&target.file).filter(|kind| !(target.is_map && *kind == MAP)) {
                let why = format!("it is {kind}, which this would replace by another kind of file");
                return Err(Failure::new(target.given.display().to_string(), why, "give another name"));
            }
            writable(&target.file)
                .map_err(|e| Failure::new(target.given.display().to_string(), e.to_string(), WRITABLE))?;
        }
        Ok(self)
    }

    /// The file of an option behind all symbolic links, if the option was given.
    pub fn file(&self, option: &str) -> Option<&Path> {
        self.targets.iter().find(|t| t.option == option).map(|t| t.file.as_path())
    }

    /// Writes the file of an option completely or not at all; without the option `content` is not asked for.
    ///
    /// # Errors
    /// When the content cannot be made or the file cannot be written; an older file is then unchanged.
    pub fn write(
        &self,
        option: &str,
        content: impl FnOnce() -> Result<Vec<u8>, Failure>,
    ) -> Result<(), Failure> {
        let Some(target) = self.targets.iter().find(|t| t.option == option) else { return Ok(()) };
        cairn_eval::write_bytes_whole(&target.file, &content()?)
            .map_err(|e| Failure::new(target.given.display().to_string(), e.reason, WRITABLE))
    }
}

/// What a saved map is called in messages.
const MAP: &str = "a saved map";

/// What an existing file is, where it is a work of hours that nothing else should replace.
fn precious(file: &Path) -> Option<&'static str> {
    let mut start = [0; 64];
    let read = File::open(file).ok()?.read(&mut start).ok()?;
    let start = &start[..read];
    let has = |text: &[u8]| start.windows(text.len()).any(|w| w == text);
    match start {
        _ if start.starts_with(b"\x8ccairn\r\n") => Some(MAP),
        [b'{', ..] if has(b"\"cairn-route\"") || has(b"\"cairn-way\"") => Some("a recorded route"),
        _ => None,
    }
}

impl Target {
    /// Whether writing this file would change that input.
    fn hits(&self, name: &str, input: &Path) -> bool {
        match self.existing {
            Existing::Input(allowed) if allowed == name => false,
            Existing::Refused | Existing::Input(_) if input.is_dir() => {
                self.file.starts_with(input) && self.file.exists()
            }
            _ => same(input, &self.file),
        }
    }
}

/// The regular file that a path names, or would create, with symbolic links followed.
fn behind_links(given: &Path) -> Result<PathBuf, Failure> {
    const MOST_LINKS: usize = 40;
    let fail = |why: String, hint: &str| Failure::new(given.display().to_string(), why, hint);
    let mut path = given.to_owned();
    let mut links = 0;
    while let Ok(to) = std::fs::read_link(&path) {
        links += 1;
        if links > MOST_LINKS {
            return Err(fail("its symbolic links lead in a circle".into(), "name a file"));
        }
        path = folder_of(&path).join(to);
    }
    let folder = folder_of(&path);
    if !folder.is_dir() {
        return Err(fail(format!("its folder {} does not exist", folder.display()), "make the folder first"));
    }
    if path.is_dir() {
        return Err(fail("is a folder".into(), "name a file"));
    }
    if path.exists() && !path.is_file() {
        return Err(fail("is a device or a pipe, not a file".into(), "name a file"));
    }
    let name = path.file_name().ok_or_else(|| fail("names no file".into(), "name a file"))?;
    Ok(folder.canonicalize().map_err(|e| fail(e.to_string(), WRITABLE))?.join(name))
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Whether two paths without symbolic links are the same file, hard links included.
fn same(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    if let (Ok(a), Ok(b)) = (std::fs::metadata(a), std::fs::metadata(b)) {
        use std::os::unix::fs::MetadataExt;
        return (a.dev(), a.ino()) == (b.dev(), b.ino());
    }
    a == b
}

/// Makes a folder for outputs, or checks that files can be made in it if it is there.
///
/// # Errors
/// When it cannot be made, or no file can be made in it.
pub fn folder(path: &Path) -> Result<(), Failure> {
    let made = std::fs::create_dir_all(path).and_then(|()| writable(&path.join(".cairn")));
    made.map_err(|e| Failure::new(path.display().to_string(), e.to_string(), WRITABLE))
}

/// Checks that a folder which is made later, where it is needed, can be made, and that files can be made in it.
///
/// # Errors
/// As [`folder`].
pub fn folder_later(path: &Path) -> Result<(), Failure> {
    let mut there = path;
    while !there.exists() {
        there = folder_of(there);
    }
    let fail = |why: String| Failure::new(path.display().to_string(), why, WRITABLE);
    if !there.is_dir() {
        return Err(fail(format!("{} is not a folder", there.display())));
    }
    writable(&there.join(".cairn")).map_err(|e| fail(e.to_string()))
}

/// Whether the file, and a temporary file beside it, can be written; leaves both as they were.
fn writable(file: &Path) -> io::Result<()> {
    if file.exists() {
        File::options().append(true).open(file)?;
    }
    let mut beside = std::ffi::OsString::from(".");
    beside.push(file.file_name().unwrap_or_default());
    beside.push(format!(".{}.check", std::process::id()));
    let beside = file.with_file_name(beside);
    File::options().write(true).create_new(true).open(&beside)?;
    std::fs::remove_file(&beside)
}
