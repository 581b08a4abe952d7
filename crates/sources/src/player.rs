//! Plays a recording: one thread reads ahead and decodes, a bounded queue hands packets over.

use crate::decode;
use crate::imu::ImuStream;
use crate::recording::{Instant, Recording};
use cairn_sensor::{
    Camera, DepthImage, FramePacket, GrayImage, ImuSample, Rig, Source, SourceError, SourceInfo,
};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time;

/// Packets decoded ahead of the reader: 6 MB of EuRoC stereo.
const READ_AHEAD: usize = 8;
/// Lines kept of what was skipped; a longer list only grows its last line's count.
const MOST_LINES: usize = 10_000;

/// A recording being read.
pub struct Player {
    info: SourceInfo,
    rig: Rig,
    skipped: Vec<String>,
    left_out: usize,
    packets: Option<Receiver<Step>>,
    reader: Option<JoinHandle<()>>,
}

/// One instant read: its packet, unless it was skipped, and what was left out on the way.
struct Step {
    packet: Option<FramePacket>,
    skipped: Vec<String>,
}

impl Player {
    /// Checks the rig against the first image of each camera and starts the reading thread.
    pub fn start(recording: Recording) -> Result<Self, SourceError> {
        let rate_hz = recording.rate_hz();
        let Recording { name, mut rig, instants, imu, truth, no_depth, skipped } = recording;
        if let Err(e) = rig.validate() {
            return Err(SourceError::new(name, format!("its rig is wrong: {e}"), "correct the calibration"));
        }
        check_sizes(&name, &rig, &instants)?;
        // Stamps are given in the images' clock, so nothing is left to add.
        let offset_s = rig.imu.as_mut().map_or(0.0, |imu| std::mem::take(&mut imu.offset_s));
        let stream = imu.map(|path| ImuStream::open(&path, offset_s)).transpose()?;

        let (sender, receiver) = sync_channel(READ_AHEAD);
        let work =
            Work { rig: rig.clone(), instants, imu: stream, no_depth, pending: Vec::new(), first: true };
        let frames = work.instants.len();
        let reader = std::thread::Builder::new()
            .name("cairn-reader".into())
            .spawn(move || work.run(&sender))
            .map_err(|e| {
                SourceError::new(&name, format!("no thread to read it ({e})"), "close other programs")
            })?;
        Ok(Self {
            info: SourceInfo { name, frames: Some(frames), rate_hz, truth },
            rig,
            skipped,
            left_out: 0,
            packets: Some(receiver),
            reader: Some(reader),
        })
    }

    fn note(&mut self, lines: Vec<String>) {
        for line in lines {
            if self.skipped.len() < MOST_LINES {
                self.skipped.push(line);
            } else if let Some(last) = self.skipped.last_mut() {
                self.left_out += 1;
                *last = format!("and {} more", self.left_out + 1);
            }
        }
    }
}

impl Source for Player {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        while let Some(step) = self.packets.as_ref().and_then(|p| p.recv().ok()) {
            self.note(step.skipped);
            if step.packet.is_some() {
                return Ok(step.packet);
            }
        }
        // The queue is closed: the thread is done, or it died.
        self.packets = None;
        match self.reader.take().map(JoinHandle::join) {
            Some(Err(_)) => Err(SourceError::new(
                &self.info.name,
                "the reading thread failed",
                "report it with the recording",
            )),
            _ => Ok(None),
        }
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }
}

impl Drop for Player {
    /// Closes the queue, which ends the thread after the packet in its hands.
    fn drop(&mut self) {
        self.packets = None;
        if let Some(reader) = self.reader.take() {
            // A panic there was already reported on standard error; there is no one left to tell.
            let _ = reader.join();
        }
    }
}

/// What the reading thread owns.
struct Work {
    rig: Rig,
    instants: Vec<Instant>,
    imu: Option<ImuStream>,
    no_depth: Option<u16>,
    /// Samples read but not given yet.
    pending: Vec<ImuSample>,
    first: bool,
}

impl Work {
    fn run(mut self, sender: &SyncSender<Step>) {
        for instant in std::mem::take(&mut self.instants) {
            let mut skipped = Vec::new();
            let packet = self.read(&instant, &mut skipped);
            if sender.send(Step { packet, skipped }).is_err() {
                return; // no one listens any more
            }
        }
    }

    fn read(&mut self, instant: &Instant, skipped: &mut Vec<String>) -> Option<FramePacket> {
        let start = time::Instant::now();
        let decoded = self.decode(instant);
        let decode_ms = start.elapsed().as_secs_f64() * 1e3;
        if let Some(imu) = &mut self.imu {
            imu.take_until(instant.stamp, &mut self.pending, skipped);
            if self.first {
                self.pending.retain(|s| s.stamp >= instant.stamp.plus_seconds(-1.0));
            }
        }
        match decoded {
            Ok((images, depth)) => {
                self.first = false;
                let imu = std::mem::take(&mut self.pending);
                Some(FramePacket { stamp: instant.stamp, images, depth, imu, decode_ms })
            }
            Err(why) => {
                skipped.push(format!("{}: {why}", instant.stamp));
                None
            }
        }
    }

    fn decode(&self, instant: &Instant) -> Result<Decoded, String> {
        let mut images = Vec::with_capacity(instant.images.len());
        for (path, c) in instant.images.iter().zip(&self.rig.cameras) {
            let image = decode::gray(path)?;
            fits(&c.name, &c.camera, image.width(), image.height())?;
            images.push(Arc::new(image));
        }
        let depth = match (&instant.depth, &self.rig.depth) {
            (Some(path), Some(sensor)) => {
                let mut image = decode::depth(path)?;
                fits("depth", &sensor.camera, image.width(), image.height())?;
                if let Some(none) = self.no_depth {
                    image.data_mut().iter_mut().filter(|d| **d == none).for_each(|d| *d = 0);
                }
                Some(Arc::new(image))
            }
            _ => None,
        };
        Ok((images, depth))
    }
}

type Decoded = (Vec<Arc<GrayImage>>, Option<Arc<DepthImage>>);

fn fits(name: &str, camera: &Camera, width: usize, height: usize) -> Result<(), String> {
    if (width, height) == (camera.width, camera.height) {
        return Ok(());
    }
    Err(format!("{name} has {width}x{height} pixels, the rig says {}x{}", camera.width, camera.height))
}

/// The first readable image of each camera must be of the rig's size; a recording without any is an error.
fn check_sizes(name: &str, rig: &Rig, instants: &[Instant]) -> Result<(), SourceError> {
    let cameras = rig.cameras.iter().enumerate().map(|(i, c)| (c.name.as_str(), &c.camera, Some(i)));
    let depth = rig.depth.iter().map(|d| ("depth", &d.camera, None));
    for (camera_name, camera, index) in cameras.chain(depth) {
        let mut first_problem = None;
        let mut files = instants.iter().filter_map(|i| match index {
            Some(index) => i.images.get(index),
            None => i.depth.as_ref(),
        });
        let found = files.find_map(|path| match decode::size(path) {
            Ok(size) => Some((path, size)),
            Err(e) => {
                first_problem.get_or_insert(e);
                None
            }
        });
        match found {
            Some((path, [w, h])) => fits(camera_name, camera, w, h).map_err(|why| {
                SourceError::new(path.display().to_string(), why, "give the rig of these images with --rig")
            })?,
            None if index.is_none() && first_problem.is_none() => {} // a rig with depth, images without
            None => {
                return Err(SourceError::new(
                    name,
                    format!(
                        "not one image of {camera_name} can be read (the first: {})",
                        first_problem.unwrap_or_else(|| "none is named".into())
                    ),
                    "check that the image files are there and whole",
                ));
            }
        }
    }
    Ok(())
}
