//! A video node of the kernel (Video4Linux2): its modes, and frames through mapped buffers.

use super::abi::{
    self, Buffer, BufferKind, Capability, Format, FormatDescription, FrameInterval, FrameSize, Mapping,
};
use super::abi::{RequestBuffers, StreamParameters, ask, ask_extension};
use super::device::{
    Dequeued, DeviceError, ExtensionControl, KernelStamp, Mode, PixelFormat, Trouble, VideoNode,
};
use super::sysfs::ExtensionUnit;
use cairn_sensor::Stamp;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fd::AsFd;
use std::fs::File;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Buffers that the driver fills in turn: enough that none is lost while one is copied.
const BUFFERS: u32 = 4;
/// Largest list that is asked of a driver, so that a broken one cannot go on without end.
const MAX_LISTED: u32 = 200;
/// Rates that are looked for where a driver gives a range.
const USUAL_RATES_HZ: [f64; 4] = [15.0, 30.0, 60.0, 90.0];
/// A size that is looked for where a driver gives a range.
const USUAL_SIZE: [u32; 2] = [640, 480];

/// An opened node.
pub struct V4l2Node {
    path: PathBuf,
    file: File,
    units: Vec<ExtensionUnit>,
    buffers: Vec<Mapping>,
    streaming: bool,
}

impl V4l2Node {
    /// Opens a node and checks that it captures video. `units` are the extension units of its device.
    ///
    /// # Errors
    /// [`DeviceError`] where there is none, this user may not, or it is of another kind.
    pub fn open(path: &Path, units: Vec<ExtensionUnit>) -> Result<Self, DeviceError> {
        let file = std::fs::OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(rustix::fs::OFlags::NONBLOCK.bits() as i32)
            .open(path)
            .map_err(|e| DeviceError::of(path, "opening it", &e))?;
        let node = Self { path: path.to_owned(), file, units, buffers: Vec::new(), streaming: false };
        let mut has = Capability::default();
        ask::<{ abi::QUERY_CAPABILITY }, _>(node.file.as_fd(), &mut has)
            .map_err(|e| node.error("VIDIOC_QUERYCAP", e))?;
        let caps =
            if has.capabilities & abi::CAP_DEVICE_CAPS != 0 { has.device_caps } else { has.capabilities };
        if caps & abi::CAP_CAPTURE == 0 || caps & abi::CAP_STREAMING == 0 {
            return Err(node.fail("gives no pictures (a node of metadata, or of another kind)"));
        }
        Ok(node)
    }

    fn error(&self, doing: &str, errno: rustix::io::Errno) -> DeviceError {
        DeviceError::of(&self.path, doing, &errno.into())
    }

    fn fail(&self, why: &str) -> DeviceError {
        DeviceError::new(Trouble::Unsuitable, self.path.display().to_string(), why)
    }

    fn sizes(&self, pixel_format: u32) -> Vec<[u32; 2]> {
        let mut sizes = Vec::new();
        for index in 0..MAX_LISTED {
            let mut entry = FrameSize { index, pixel_format, ..Default::default() };
            if ask::<{ abi::ENUM_FRAME_SIZES }, _>(self.file.as_fd(), &mut entry).is_err() {
                break;
            }
            let [w, h, step_w, h_least, h_most, _] = entry.size;
            if entry.kind == abi::DISCRETE {
                sizes.push([w, h]);
                continue;
            }
            // The least, the largest and the step of the width, then of the height.
            let [w_least, w_most, w_step] = [w, h, step_w];
            let [uw, uh] = USUAL_SIZE;
            let usual = (w_least..=w_most).contains(&uw) && (h_least..=h_most).contains(&uh);
            sizes.extend((usual && (uw - w_least).is_multiple_of(w_step.max(1))).then_some(USUAL_SIZE));
            sizes.push([w_most, h_most]);
            break;
        }
        sizes
    }

    fn rates_hz(&self, pixel_format: u32, [width, height]: [u32; 2]) -> Vec<f64> {
        let mut rates = Vec::new();
        for index in 0..MAX_LISTED {
            let mut entry = FrameInterval { index, pixel_format, width, height, ..Default::default() };
            if ask::<{ abi::ENUM_FRAME_INTERVALS }, _>(self.file.as_fd(), &mut entry).is_err() {
                break;
            }
            let [n, d, most_n, most_d, ..] = entry.interval;
            let rate = |seconds: u32, per: u32| f64::from(per) / f64::from(seconds.max(1));
            if entry.kind == abi::DISCRETE {
                rates.push(rate(n, d));
                continue;
            }
            let range = rate(most_n, most_d)..=rate(n, d);
            rates.extend(USUAL_RATES_HZ.iter().filter(|r| range.contains(r)));
            break;
        }
        // A driver that does not tell decides by itself.
        if rates.is_empty() { vec![30.0] } else { rates }
    }

    /// Has the driver fill a buffer.
    fn queue(&self, index: u32) -> Result<(), DeviceError> {
        let mut buffer = Buffer { index, ..Default::default() };
        ask::<{ abi::QUEUE_BUFFER }, _>(self.file.as_fd(), &mut buffer)
            .map_err(|e| self.error("VIDIOC_QBUF", e))
    }

    fn ask_control(&self, control: ExtensionControl, query: u8, mut value: u8) -> Result<u8, DeviceError> {
        let unit = self.units.iter().find(|unit| unit.guid == control.unit);
        let unit = unit.ok_or_else(|| self.fail("has no such control"))?;
        ask_extension(
            self.file.as_fd(),
            [unit.id, control.selector, query],
            std::slice::from_mut(&mut value),
        )
        .map_err(|e| self.error("UVCIOC_CTRL_QUERY", e))?;
        Ok(value)
    }

    fn stop(&mut self) {
        if std::mem::take(&mut self.streaming) {
            // It may have been unplugged.
            let _ = ask::<{ abi::STREAM_OFF }, _>(self.file.as_fd(), &mut BufferKind::default());
        }
        self.buffers.clear();
    }

    fn set_format(&self, wanted: &Mode) -> Result<Mode, DeviceError> {
        let too_large = |_| self.fail("images of that size are impossible");
        let mut format = Format {
            width: u32::try_from(wanted.width).map_err(too_large)?,
            height: u32::try_from(wanted.height).map_err(too_large)?,
            pixel_format: wanted.format.fourcc(),
            // V4L2_FIELD_NONE: whole frames.
            field: 1,
            ..Default::default()
        };
        ask::<{ abi::SET_FORMAT }, _>(self.file.as_fd(), &mut format)
            .map_err(|e| self.error("VIDIOC_S_FMT", e))?;
        let mut rate =
            StreamParameters { seconds: 1000, per: (1000.0 * wanted.rate_hz) as u32, ..Default::default() };
        // Not every driver has a rate to set.
        let set = ask::<{ abi::SET_PARAMETERS }, _>(self.file.as_fd(), &mut rate).is_ok();
        let told = set && rate.seconds > 0 && rate.per > 0;
        Ok(Mode {
            format: PixelFormat::from_fourcc(format.pixel_format),
            width: format.width as usize,
            height: format.height as usize,
            stride: format.bytes_per_line as usize,
            rate_hz: if told { f64::from(rate.per) / f64::from(rate.seconds) } else { wanted.rate_hz },
        })
    }
}

impl VideoNode for V4l2Node {
    fn modes(&mut self) -> Result<Vec<Mode>, DeviceError> {
        let mut modes = Vec::new();
        for index in 0..MAX_LISTED {
            let mut entry = FormatDescription { index, ..Default::default() };
            match ask::<{ abi::ENUM_FORMAT }, _>(self.file.as_fd(), &mut entry) {
                Ok(()) => {}
                Err(rustix::io::Errno::INVAL) => break,
                Err(e) => return Err(self.error("VIDIOC_ENUM_FMT", e)),
            }
            let format = PixelFormat::from_fourcc(entry.pixel_format);
            for [w, h] in self.sizes(entry.pixel_format) {
                let rates = self.rates_hz(entry.pixel_format, [w, h]);
                let mode =
                    |rate_hz| Mode { format, width: w as usize, height: h as usize, stride: 0, rate_hz };
                modes.extend(rates.into_iter().map(mode));
            }
        }
        Ok(modes)
    }

    fn start(&mut self, wanted: &Mode) -> Result<Mode, DeviceError> {
        self.stop();
        let mode = self.set_format(wanted)?;
        let mut request = RequestBuffers { count: BUFFERS, ..Default::default() };
        ask::<{ abi::REQUEST_BUFFERS }, _>(self.file.as_fd(), &mut request)
            .map_err(|e| self.error("VIDIOC_REQBUFS", e))?;
        if request.count == 0 {
            return Err(self.fail("gave no buffer"));
        }
        for index in 0..request.count {
            let mut buffer = Buffer { index, ..Default::default() };
            ask::<{ abi::QUERY_BUFFER }, _>(self.file.as_fd(), &mut buffer)
                .map_err(|e| self.error("VIDIOC_QUERYBUF", e))?;
            let mapping = Mapping::new(self.file.as_fd(), buffer.offset, buffer.length as usize);
            self.buffers.push(mapping.map_err(|e| self.error("mapping a buffer", e))?);
            self.queue(index)?;
        }
        ask::<{ abi::STREAM_ON }, _>(self.file.as_fd(), &mut BufferKind::default())
            .map_err(|e| self.error("VIDIOC_STREAMON", e))?;
        self.streaming = true;
        Ok(mode)
    }

    fn dequeue(&mut self, wait: Duration, into: &mut Vec<u8>) -> Result<Option<Dequeued>, DeviceError> {
        if !readable(&self.file, wait).map_err(|e| self.error("waiting", e))? {
            return Ok(None);
        }
        let mut buffer = Buffer::default();
        match ask::<{ abi::DEQUEUE_BUFFER }, _>(self.file.as_fd(), &mut buffer) {
            Ok(()) => {}
            Err(rustix::io::Errno::AGAIN | rustix::io::Errno::INTR) => return Ok(None),
            Err(e) => return Err(self.error("VIDIOC_DQBUF", e)),
        }
        let mapping = self.buffers.get_mut(buffer.index as usize);
        let mapping = mapping.ok_or_else(|| {
            DeviceError::new(
                Trouble::Other,
                self.path.display().to_string(),
                "gave a buffer that it does not have",
            )
        })?;
        mapping.copy(buffer.bytes_used as usize, into);
        self.queue(buffer.index)?;
        let monotonic = buffer.flags & abi::FLAG_STAMP_MASK == abi::FLAG_STAMP_MONOTONIC;
        let ns = buffer
            .seconds
            .saturating_mul(1_000_000_000)
            .saturating_add(buffer.microseconds.saturating_mul(1000));
        Ok(Some(Dequeued {
            stamp: if monotonic { KernelStamp::Monotonic(Stamp(ns)) } else { KernelStamp::Unknown },
            sequence: buffer.sequence,
            damaged: buffer.flags & abi::FLAG_ERROR != 0,
        }))
    }

    fn control(&mut self, control: ExtensionControl) -> Result<u8, DeviceError> {
        self.ask_control(control, abi::UVC_GET, 0)
    }

    fn set_control(&mut self, control: ExtensionControl, value: u8) -> Result<(), DeviceError> {
        self.ask_control(control, abi::UVC_SET, value).map(drop)
    }
}

impl Drop for V4l2Node {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Waits until there is something to read; false when nothing came in time. A device that is gone counts as readable: reading
/// it tells why.
///
/// # Errors
/// What the kernel answers.
pub fn readable(file: &File, wait: Duration) -> rustix::io::Result<bool> {
    let mut fds = [PollFd::new(file, PollFlags::IN)];
    let limit =
        rustix::event::Timespec { tv_sec: wait.as_secs() as i64, tv_nsec: i64::from(wait.subsec_nanos()) };
    match poll(&mut fds, Some(&limit)) {
        Ok(count) => Ok(count > 0),
        Err(rustix::io::Errno::INTR) => Ok(false),
        Err(e) => Err(e),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_camera_is_told() {
        let missing = V4l2Node::open(Path::new("/dev/video-none"), Vec::new()).err().unwrap();
        assert_eq!(missing.trouble, Trouble::Missing);
        assert_eq!(missing.to_string(), "/dev/video-none: is not there");
        let other = V4l2Node::open(Path::new("/dev/null"), Vec::new()).err().unwrap();
        assert_eq!(other.trouble, Trouble::Unsuitable);
        assert!(other.to_string().contains("no such device"), "{other}");
    }

    #[test]
    fn waiting_ends() {
        let (reader, mut writer) = std::io::pipe().unwrap();
        let reader = File::from(std::os::fd::OwnedFd::from(reader));
        assert!(!readable(&reader, Duration::from_millis(10)).unwrap());
        std::io::Write::write_all(&mut writer, b"x").unwrap();
        assert!(readable(&reader, Duration::from_millis(10)).unwrap());
    }
}
