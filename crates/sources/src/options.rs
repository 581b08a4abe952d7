//! What a source is opened with.

use crate::{Cancel, NamedTopic};
use cairn_sensor::Rig;

/// Options for reading a source.
#[derive(Clone, Debug, Default)]
pub struct OpenOptions {
    /// A rig to use instead of the source's own. It also decides what is read: with one camera, only that
    /// one's images.
    pub rig: Option<Rig>,
    /// What a folder is taken for; without it its kind is detected.
    pub kind: Option<SourceKind>,
    /// Seconds after the first image to start at.
    pub start_s: f64,
    /// The largest number of packets to read.
    pub frames: Option<usize>,
    /// Topics of a bag by sensor, where they should not be found by their types and names.
    pub topics: Vec<NamedTopic>,
    /// Numbers the images of a recording at this rate in the order of their list, instead of believing their times.
    pub number_frames_hz: Option<f64>,
    /// Ends waiting: for a stream to open, and for the next packet.
    pub cancel: Cancel,
    /// Is told at once what happens while a stream is waited for, which may take long: a line each.
    pub told: Option<fn(&str)>,
}

/// A kind of recording that is a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SourceKind {
    /// EuRoC and TUM-VI.
    Euroc,
    /// TUM RGB-D.
    Tum,
    /// KITTI odometry.
    Kitti,
    /// 7-Scenes.
    SevenScenes,
    /// Numbered frames of colour and depth: Replica, ScanNet, Stray Scanner, Record3D.
    Frames,
    /// UZH-FPV and the like: lists of numbers, times and files.
    Uzh,
    /// An Android phone's camera and sensors.
    Android,
    /// Images of one camera.
    Images,
}
