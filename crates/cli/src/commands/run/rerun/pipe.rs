//! The program `cairn-rerun`, which writes the recording, and the pipe to it.

use crate::failure::Failure;
use crate::processes::beside_or_in_path;
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_rerun::{Message, Pose, Show, viewer, write};
use std::io::{BufWriter, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};

/// Its name; it is looked for beside this program, then in PATH.
const PROGRAM: &str = "cairn-rerun";

/// The pipe to the file or to the viewer while the run goes on. What fails is told by [`Pipe::end`]; nothing is written after the first failure.
pub struct Pipe {
    path: PathBuf,
    child: Child,
    to: Option<BufWriter<ChildStdin>>,
    failed: Option<String>,
}

impl Pipe {
    /// Starts the program.
    ///
    /// # Errors
    /// When it is not installed or cannot be started.
    pub fn begin(path: &Path, name: &str) -> Result<Self, Failure> {
        let mut command = Command::new(beside_or_in_path(PROGRAM));
        command.arg(path).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        // Ctrl-C ends this program, and with it the pipe; that one still has to close its file.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn().map_err(|e| match e.kind() {
            ErrorKind::NotFound => Failure::new(
                "--rerun",
                format!("the program {PROGRAM} is not installed"),
                "cargo install --path crates/rerun --features sdk; or use --mcap",
            ),
            _ => Failure::new(PROGRAM, e.to_string(), "check that it can be executed"),
        })?;
        let to = child.stdin.take().map(BufWriter::new);
        let mut pipe = Self { path: path.to_owned(), child, to, failed: None };
        pipe.write(&Message::Begin { name: name.to_owned() });
        Ok(pipe)
    }

    fn write(&mut self, message: &Message) {
        if let (Some(to), None) = (&mut self.to, &self.failed) {
            self.failed = write(to, message).err().map(|e| e.to_string());
        }
    }

    /// Sets the time of what follows.
    pub fn at(&mut self, stamp_ns: i64, frame: usize) {
        self.write(&Message::At { stamp_ns, frame: i64::try_from(frame).unwrap_or(i64::MAX) });
    }

    /// Sets what an entity shows.
    pub fn show(&mut self, entity: impl Into<String>, what: Show) {
        self.write(&Message::Show { entity: entity.into(), what });
    }

    /// Waits until the file is written.
    ///
    /// # Errors
    /// The failure of the program, or of the pipe.
    pub fn end(mut self) -> Result<(), Failure> {
        self.write(&Message::End);
        // The rest of the buffer is written and the pipe closed.
        let flushed =
            self.to.take().map_or(Ok(()), |to| to.into_inner().map(drop).map_err(|e| e.to_string()));
        let failed = self.failed.take().or(flushed.err());
        let mut said = String::new();
        if let Some(stderr) = &mut self.child.stderr {
            // What it says is only for the message below.
            let _ = stderr.take(4096).read_to_string(&mut said);
        }
        let ended = self.child.wait().map_err(|e| e.to_string());
        let why = match (ended, failed) {
            (Ok(status), None) if status.success() => return Ok(()),
            (Ok(status), _) if !status.success() => match said.trim() {
                "" => format!("{PROGRAM} ended with {status}"),
                said => said.lines().last().unwrap_or(said).to_owned(),
            },
            (ended, failed) => failed.or(ended.err()).unwrap_or_default(),
        };
        let hint = match viewer(&self.path) {
            Some(_) => {
                "start the viewer first (rerun), of the version of cairn-rerun or newer, and leave it open"
            }
            None => "check that the disk has room, and that cairn-rerun is of this release",
        };
        Err(Failure::new(self.path.display().to_string(), why, hint))
    }
}

/// A position as it is shown.
pub fn single(p: &Vec3) -> [f32; 3] {
    [p.x as f32, p.y as f32, p.z as f32]
}

/// A pose as it is shown.
pub fn pose(pose: &Se3) -> Show {
    similarity(&Sim3::new(pose.rotation, pose.translation, 1.0))
}

/// A pose with a scale as it is shown.
pub fn similarity(pose: &Sim3) -> Show {
    let q = pose.rotation.quaternion().coords;
    let xyzw = [q.x as f32, q.y as f32, q.z as f32, q.w as f32];
    Show::Pose(Pose { translation: single(&pose.translation), xyzw, scale: pose.scale as f32 })
}
