//! Cameras plugged into this machine, read through the kernel (Video4Linux2, Industrial I/O), without a vendor's SDK.
//!
//! `v4l2:/dev/videoN` is any camera of the kernel (UVC webcams), `realsense:` an Intel RealSense D4xx with depth, infrared,
//! colour and motion. Everything above [`Kernel`] is the same for real devices and for [`Simulated`] ones, which feed
//! frames of a recording and can be unplugged; tests use those. No RealSense was at hand when this was written.
//!
//! One thread a stream takes buffers as they come (`reader.rs`); the source synchronises what they took (`source.rs`).

mod abi;
mod address;
mod align;
mod clock;
mod device;
mod format;
mod iio;
mod inspect;
mod linux;
mod projector;
mod reader;
mod replayed;
mod select;
mod simulated;
mod source;
mod sysfs;
mod v4l2;

pub use address::{CameraAddress, Place};
pub use align::DepthAligner;
pub use clock::DeviceClock;
pub use device::{
    Dequeued, DeviceError, ExtensionControl, Kernel, KernelStamp, Mode, MotionFound, MotionKind, MotionNode,
    PixelFormat, Reading, Trouble, Usb, VideoFound, VideoNode,
};
pub use inspect::{CameraReport, CamerasReport, inspect};
pub use linux::Linux;
pub use replayed::SERIAL as REPLAYED_SERIAL;
pub use simulated::{FramesOf, Simulated, SimulatedMotion, SimulatedVideo, ValuesOf};
pub use source::CameraSource;

use crate::options::OpenOptions;
use cairn_sensor::{Source, SourceError};
use std::sync::Arc;

/// Opens the address if it is a camera of the kernel; `None` if it is not.
pub(crate) fn open(source: &str, options: &OpenOptions) -> Option<Result<Box<dyn Source>, SourceError>> {
    let address = CameraAddress::of(source)?;
    Some(address.and_then(|address| {
        let source = CameraSource::open(Arc::new(Linux::new()), &address, options)?;
        Ok(Box::new(source) as Box<dyn Source>)
    }))
}
