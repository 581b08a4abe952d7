//! The messages as an MCAP file.

use super::topics::{Destination, Topic};
use crate::failure::Failure;
use cairn_bag::{Channel, McapWriter};
use cairn_sensor::Stamp;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

/// The file while the run goes on.
pub struct McapFile {
    path: PathBuf,
    to: McapWriter<BufWriter<File>>,
    channels: [Channel; Topic::ALL.len()],
    failed: Option<io::Error>,
}

impl McapFile {
    /// Creates it.
    ///
    /// # Errors
    /// When it cannot be created.
    pub fn begin(path: &Path) -> Result<Self, Failure> {
        let fail = |e: io::Error| {
            Failure::new(path.display().to_string(), e.to_string(), "check that its folder is writable")
        };
        let mut to = McapWriter::new(BufWriter::new(File::create(path).map_err(fail)?)).map_err(fail)?;
        let channels = Topic::ALL.map(|topic| {
            let (name, schema) = topic.channel();
            to.channel(name, schema)
        });
        Ok(Self { path: path.to_owned(), to, channels, failed: None })
    }
}

impl Destination for McapFile {
    fn wants(&self, _: Topic) -> bool {
        self.failed.is_none()
    }

    fn put(&mut self, topic: Topic, stamp: Stamp, message: &[u8]) {
        if self.failed.is_none() {
            self.failed = self.to.message(self.channels[topic as usize], stamp.0, message).err();
        }
    }

    fn end(self: Box<Self>) -> Result<(), Failure> {
        let ended = match self.failed {
            Some(e) => Err(e),
            None => self.to.finish().map(drop),
        };
        let hint = "free some space on the disk";
        ended.map_err(|e| Failure::new(self.path.display().to_string(), e.to_string(), hint))
    }
}
