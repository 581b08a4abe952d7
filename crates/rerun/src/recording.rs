//! Messages as rerun's archetypes, in a file or in a viewer.

use crate::error::RecordError;
use cairn_rerun::{Colour, Level, Pose, Show, viewer};
use re_sdk::{RecordingStream, RecordingStreamBuilder, TimeCell};
use re_sdk_types::AsComponents;
use re_sdk_types::archetypes::{
    Boxes3D, Image, LineStrips3D, Pinhole, Points2D, Points3D, Scalars, TextLog, Transform3D, ViewCoordinates,
};
use re_sdk_types::components::{self, Color, LineStrip3D, Radius};
use re_sdk_types::datatypes::{Mat3x3, Quaternion};
use std::fs::File;
use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Stamps of at least this many nanoseconds (the year 1973) count from 1970; smaller ones from the start of a recording.
const EPOCH_NS: i64 = 100_000_000_000_000_000;

/// The time line of the source's stamps, and that of the numbers of frames.
const TIME: &str = "time";
const FRAME: &str = "frame";

/// The size at which points and lines are shown, in points of the screen.
const POINT: f32 = 1.5;

/// How long a viewer may take to answer at the start, and to take what is left at the end.
const ANSWER: Duration = Duration::from_secs(3);
const REST: Duration = Duration::from_secs(20);

/// A recording while it is written.
pub struct Recording {
    /// `None` in a viewer.
    path: Option<PathBuf>,
    stream: RecordingStream,
}

impl Recording {
    /// Creates the file (an existing one is replaced), or connects to the viewer. Every recording gets an id of its own, so
    /// that the viewer can show two of the same source side by side: files of equal runs differ in it.
    ///
    /// # Errors
    /// When the file cannot be created, or no viewer listens.
    pub fn begin(to: &Path, name: &str) -> Result<Self, RecordError> {
        let builder = RecordingStreamBuilder::new("cairn").recording_name(name).enabled(true);
        if let Some(host) = viewer(to) {
            // The SDK would go on trying, and keep everything in memory meanwhile.
            is_there(host)?;
            let stream = builder.connect_grpc_opts(to.to_string_lossy())?;
            return Ok(Self { path: None, stream });
        }
        File::create(to).map_err(RecordError::File)?;
        let stream = builder.save(to)?;
        Ok(Self { path: Some(to.to_owned()), stream })
    }

    /// Sets the time of what follows, with the number of the frame.
    pub fn at(&self, stamp_ns: i64, frame: i64) {
        let time = match stamp_ns >= EPOCH_NS {
            true => TimeCell::from_timestamp_nanos_since_epoch(stamp_ns),
            false => TimeCell::from_duration_nanos(stamp_ns),
        };
        self.stream.set_time(TIME, time);
        self.stream.set_time_sequence(FRAME, frame);
    }

    fn put(&self, entity: &str, what: &dyn AsComponents) -> Result<(), RecordError> {
        Ok(self.stream.log(entity, what)?)
    }

    /// Sets what an entity shows.
    ///
    /// # Errors
    /// When the image is not as large as it says, or the SDK cannot take it.
    pub fn show(&self, entity: &str, what: &Show) -> Result<(), RecordError> {
        match what {
            Show::Axes { z_is_up: true } => self.put(entity, &ViewCoordinates::RIGHT_HAND_Z_UP()),
            Show::Axes { z_is_up: false } => self.put(entity, &ViewCoordinates::RDF()),
            Show::Lens { size, focal, centre } => {
                let ([fx, fy], [cx, cy]) = (*focal, corner(centre));
                // Column by column.
                let matrix = Mat3x3([fx, 0.0, 0.0, 0.0, fy, 0.0, cx, cy, 1.0]);
                let lens = Pinhole::new(matrix)
                    .with_resolution(size.map(|n| n as f32))
                    .with_camera_xyz(components::ViewCoordinates::RDF);
                Ok(self.stream.log_static(entity, &lens)?)
            }
            Show::Pose(pose) => self.put(entity, &transform(pose)),
            &Show::Image { size: [width, height], ref gray } => {
                if u64::from(width) * u64::from(height) != gray.len() as u64 {
                    return Err(RecordError::Image { width, height, pixels: gray.len() });
                }
                self.put(entity, &Image::from_l8(gray.clone(), [width, height]))
            }
            Show::Pixels(pixels, colour) => {
                let points = Points2D::new(pixels.iter().map(corner)).with_colors([color(*colour)]);
                self.put(entity, &points.with_radii([Radius::new_ui_points(POINT)]))
            }
            Show::Points(points, colour) => {
                let points = Points3D::new(points.iter().copied()).with_colors([color(*colour)]);
                self.put(entity, &points.with_radii([Radius::new_ui_points(POINT)]))
            }
            Show::Lines(lines, colour) => {
                let lines =
                    LineStrips3D::new(lines.iter().map(|line| LineStrip3D::from_iter(line.iter().copied())))
                        .with_colors([color(*colour)]);
                self.put(entity, &lines.with_radii([Radius::new_ui_points(POINT)]))
            }
            Show::Boxes(boxes, colour) => {
                let between =
                    |[a, b]: &[[f32; 3]; 2]| std::array::from_fn::<f32, 3, _>(|i| (a[i] + b[i]) / 2.0);
                let half = |[a, b]: &[[f32; 3]; 2]| std::array::from_fn::<f32, 3, _>(|i| (b[i] - a[i]) / 2.0);
                let boxes =
                    Boxes3D::from_centers_and_half_sizes(boxes.iter().map(between), boxes.iter().map(half));
                self.put(entity, &boxes.with_colors([color(*colour)]))
            }
            Show::Text(level, text) => {
                self.put(entity, &TextLog::new(text.as_str()).with_level(name(*level)))
            }
            Show::Number(number) => self.put(entity, &Scalars::new([*number])),
        }
    }

    /// Writes what is left, and closes the file or leaves the viewer.
    ///
    /// # Errors
    /// When that fails, as on a full disk, or when the viewer has gone.
    pub fn end(self) -> Result<(), RecordError> {
        let Some(path) = &self.path else {
            return self.stream.flush_with_timeout(REST).map_err(RecordError::ViewerGone);
        };
        self.stream.flush_blocking().map_err(RecordError::Rest)?;
        // The footer is written when the sink goes; only then is the file complete.
        self.stream.disconnect();
        match std::fs::metadata(path) {
            Ok(file) if file.len() == 0 => Err(RecordError::Empty),
            Ok(_) => Ok(()),
            Err(e) => Err(RecordError::File(e)),
        }
    }
}

/// Whether something listens at `HOST:PORT`.
fn is_there(host: &str) -> Result<(), RecordError> {
    let connect = || {
        let address = host.to_socket_addrs()?.next();
        let address = address.ok_or_else(|| io::Error::other("the name has no address"))?;
        TcpStream::connect_timeout(&address, ANSWER)
    };
    connect().map(drop).map_err(|why| RecordError::NoViewer { host: host.to_owned(), why })
}

/// rerun's origin is the corner of the first pixel, ours its centre.
fn corner([x, y]: &[f32; 2]) -> [f32; 2] {
    [x + 0.5, y + 0.5]
}

fn color(Colour(r, g, b): Colour) -> Color {
    Color::from_rgb(r, g, b)
}

fn name(level: Level) -> &'static str {
    match level {
        Level::Info => "INFO",
        Level::Warning => "WARN",
    }
}

fn transform(pose: &Pose) -> Transform3D {
    let unscaled =
        Transform3D::from_translation(pose.translation).with_quaternion(Quaternion::from_xyzw(pose.xyzw));
    // A scale is written only where there is one: transforms of rigid bodies stay readable.
    if pose.scale == 1.0 { unscaled } else { unscaled.with_scale(pose.scale) }
}
