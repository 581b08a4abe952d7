//! The boundary to the kernel: what the rest asks of video and motion devices, and what can go wrong there.

use cairn_geometry::Vec3;
use cairn_sensor::{SourceError, Stamp};
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A pixel format by its four characters, as the kernel names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PixelFormat(pub [u8; 4]);

impl PixelFormat {
    /// Depth, 16 bits little endian; 0 means no measurement.
    pub const Z16: Self = Self(*b"Z16 ");
    /// Luminance, 8 bits.
    pub const GREY: Self = Self(*b"GREY");
    /// The two images of a stereo pair, 8 bits each, left and right pixel in turn.
    pub const Y8I: Self = Self(*b"Y8I ");
    /// Colour, luminance in every first of two bytes.
    pub const YUYV: Self = Self(*b"YUYV");
    /// Colour, luminance in every second of two bytes.
    pub const UYVY: Self = Self(*b"UYVY");
    /// Colour, a plane of luminance first.
    pub const NV12: Self = Self(*b"NV12");
    /// A JPEG each.
    pub const MJPG: Self = Self(*b"MJPG");

    /// The kernel's number of it.
    pub fn fourcc(self) -> u32 {
        u32::from_le_bytes(self.0)
    }

    /// From the kernel's number.
    pub fn from_fourcc(fourcc: u32) -> Self {
        Self(fourcc.to_le_bytes())
    }
}

impl fmt::Display for PixelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text: String =
            self.0.iter().map(|b| if b.is_ascii_graphic() { *b as char } else { ' ' }).collect();
        f.write_str(text.trim_end())
    }
}

/// A format with size and rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Layout of the pixels.
    pub format: PixelFormat,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Bytes from row to row; 0 in lists, and for JPEG.
    pub stride: usize,
    /// Frames per second.
    pub rate_hz: f64,
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}x{} at {:.0} Hz", self.format, self.width, self.height, self.rate_hz)
    }
}

/// Where a device is plugged in.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Usb {
    /// The port, such as `2-1.4`: the same for all nodes of a device.
    pub port: String,
    /// Number of the vendor.
    pub vendor: u16,
    /// Number of the product.
    pub product: u16,
    /// Serial number, empty where it has none.
    pub serial: String,
}

/// A video node that the kernel lists.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VideoFound {
    /// Such as `/dev/video0`.
    pub node: PathBuf,
    /// The name that the device gives itself.
    pub name: String,
    /// Where it is plugged in; `None` for cameras that are no USB devices.
    pub usb: Option<Usb>,
}

/// What a motion node measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionKind {
    /// Angular rate, rad/s.
    Gyro,
    /// Specific force, m/s^2.
    Accel,
}

/// A motion node that the kernel lists.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MotionFound {
    /// Such as `/dev/iio:device0`.
    pub node: PathBuf,
    /// What it measures.
    pub kind: MotionKind,
    /// Where it is plugged in.
    pub usb: Option<Usb>,
}

/// When the kernel says that a buffer was filled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KernelStamp {
    /// In the monotonic clock of this machine.
    Monotonic(Stamp),
    /// In no known clock.
    Unknown,
}

/// What comes with a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dequeued {
    /// When it was filled.
    pub stamp: KernelStamp,
    /// The driver's count; what it left out is missing in it.
    pub sequence: u32,
    /// The driver says that part of the data is missing.
    pub damaged: bool,
}

/// A control of one byte that a camera has beyond the standard of USB video, in an extension unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExtensionControl {
    /// The id of the kind of unit, as it stands in the device's descriptors.
    pub unit: [u8; 16],
    /// Which of its controls.
    pub selector: u8,
}

/// One reading of a motion node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Time in the node's clock, nanoseconds.
    pub device_ns: i64,
    /// rad/s or m/s^2, in the axes of the sensor.
    pub value: Vec3,
}

/// A video node that was opened.
pub trait VideoNode: Send {
    /// The formats, sizes and rates that it has.
    ///
    /// # Errors
    /// [`DeviceError`] where it does not answer.
    fn modes(&mut self) -> Result<Vec<Mode>, DeviceError>;

    /// Starts it in a mode; returns the one that the driver really set.
    ///
    /// # Errors
    /// [`DeviceError`] where it is busy or refuses.
    fn start(&mut self, wanted: &Mode) -> Result<Mode, DeviceError>;

    /// The bytes of the next frame; `None` when none came in this time.
    ///
    /// # Errors
    /// [`DeviceError`] where it is gone.
    fn dequeue(&mut self, wait: Duration, into: &mut Vec<u8>) -> Result<Option<Dequeued>, DeviceError>;

    /// The value of a control.
    ///
    /// # Errors
    /// [`DeviceError`] where the device has no such unit, or does not answer.
    fn control(&mut self, control: ExtensionControl) -> Result<u8, DeviceError>;

    /// Sets a control.
    ///
    /// # Errors
    /// [`DeviceError`] where the device has no such unit, or refuses.
    fn set_control(&mut self, control: ExtensionControl, value: u8) -> Result<(), DeviceError>;
}

/// A motion node that was opened.
pub trait MotionNode: Send {
    /// Starts it at the rate nearest to the wanted one, which is returned.
    ///
    /// # Errors
    /// [`DeviceError`] where it is busy or refuses.
    fn start(&mut self, rate_hz: f64) -> Result<f64, DeviceError>;

    /// Adds what was measured; waits this long for something.
    ///
    /// # Errors
    /// [`DeviceError`] where it is gone.
    fn read(&mut self, wait: Duration, into: &mut Vec<Reading>) -> Result<(), DeviceError>;
}

/// The devices of a machine.
pub trait Kernel: Send + Sync {
    /// All video nodes, by name.
    ///
    /// # Errors
    /// [`DeviceError`] where the kernel has no list of them.
    fn videos(&self) -> Result<Vec<VideoFound>, DeviceError>;

    /// All gyroscopes and accelerometers, by name.
    ///
    /// # Errors
    /// [`DeviceError`] where the kernel has no list of them.
    fn motions(&self) -> Result<Vec<MotionFound>, DeviceError>;

    /// Opens a video node.
    ///
    /// # Errors
    /// [`DeviceError`] where there is none, or this user may not.
    fn video(&self, node: &Path) -> Result<Box<dyn VideoNode>, DeviceError>;

    /// Opens a motion node.
    ///
    /// # Errors
    /// [`DeviceError`] where there is none, or this user may not.
    fn motion(&self, node: &Path) -> Result<Box<dyn MotionNode>, DeviceError>;

    /// The monotonic clock.
    fn now(&self) -> Stamp;
}

/// The kind of an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// There is no such device.
    Missing,
    /// This user may not use it.
    Denied,
    /// Another program uses it.
    Busy,
    /// It was unplugged.
    Gone,
    /// It is there, but is not what was asked for.
    Unsuitable,
    /// Anything else.
    Other,
}

/// What went wrong at a device.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{what}: {why}")]
pub struct DeviceError {
    /// Its kind.
    pub trouble: Trouble,
    /// The node, or what was looked for.
    pub what: String,
    /// What happened, in words.
    pub why: String,
}

impl DeviceError {
    /// An error in words.
    pub fn new(trouble: Trouble, what: impl Into<String>, why: impl Into<String>) -> Self {
        Self { trouble, what: what.into(), why: why.into() }
    }

    /// What the kernel answered, and to what.
    pub fn of(node: &Path, doing: &str, error: &std::io::Error) -> Self {
        let errno = rustix::io::Errno::from_io_error(error);
        let trouble = match errno {
            Some(rustix::io::Errno::NOENT | rustix::io::Errno::NXIO) => Trouble::Missing,
            Some(rustix::io::Errno::ACCESS | rustix::io::Errno::PERM) => Trouble::Denied,
            Some(rustix::io::Errno::BUSY) => Trouble::Busy,
            Some(rustix::io::Errno::NODEV | rustix::io::Errno::SHUTDOWN | rustix::io::Errno::PROTO) => {
                Trouble::Gone
            }
            Some(rustix::io::Errno::NOTTY) => Trouble::Unsuitable,
            _ => Trouble::Other,
        };
        let why = match trouble {
            Trouble::Missing => "is not there".to_owned(),
            Trouble::Denied => "this user may not use it".to_owned(),
            Trouble::Busy => "another program uses it".to_owned(),
            Trouble::Gone => "was unplugged".to_owned(),
            Trouble::Unsuitable => format!("is no such device ({doing})"),
            Trouble::Other => format!("{doing} failed ({error})"),
        };
        Self { trouble, what: node.display().to_string(), why }
    }

    /// What the user can do.
    pub fn cure(&self) -> &'static str {
        match self.trouble {
            Trouble::Missing | Trouble::Gone => "plug it in; cairn doctor lists the cameras that are found",
            Trouble::Denied => {
                "add yourself to its group (sudo usermod -aG video $USER, then log in again); motion sensors need a udev rule, see docs/guides/realsense.md"
            }
            Trouble::Busy => "close the program that uses it (fuser /dev/video* names it)",
            Trouble::Unsuitable => "choose another; cairn doctor lists the cameras with their formats",
            Trouble::Other => "unplug it and plug it in again; sudo dmesg tells what the kernel says of it",
        }
    }
}

impl From<DeviceError> for SourceError {
    fn from(e: DeviceError) -> Self {
        SourceError::new(&e.what, &e.why, e.cure())
    }
}
