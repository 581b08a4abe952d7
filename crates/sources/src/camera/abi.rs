//! The structures of the kernel's `videodev2.h` and `uvcvideo.h` on 64-bit machines, their requests, and the unsafe steps that
//! use them: the calls themselves, and the mapping of a buffer.
//!
//! Layout and numbers are those of Linux' own documentation (userspace-api/media/v4l); a test compares them with the
//! installed header.

use rustix::fd::BorrowedFd;
use rustix::ioctl::{Opcode, Updater, ioctl, opcode};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::ffi::c_void;

/// `V4L2_BUF_TYPE_VIDEO_CAPTURE`.
pub const CAPTURE: u32 = 1;
/// `V4L2_MEMORY_MMAP`.
pub const MEMORY_MMAP: u32 = 1;
/// `V4L2_CAP_VIDEO_CAPTURE`.
pub const CAP_CAPTURE: u32 = 0x0000_0001;
/// `V4L2_CAP_STREAMING`.
pub const CAP_STREAMING: u32 = 0x0400_0000;
/// `V4L2_CAP_DEVICE_CAPS`.
pub const CAP_DEVICE_CAPS: u32 = 0x8000_0000;
/// `V4L2_BUF_FLAG_ERROR`.
pub const FLAG_ERROR: u32 = 0x0040;
/// `V4L2_BUF_FLAG_TIMESTAMP_MASK`.
pub const FLAG_STAMP_MASK: u32 = 0xe000;
/// `V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC`.
pub const FLAG_STAMP_MONOTONIC: u32 = 0x2000;
/// `V4L2_FRMSIZE_TYPE_DISCRETE` and `V4L2_FRMIVAL_TYPE_DISCRETE`.
pub const DISCRETE: u32 = 1;

/// A structure that the kernel reads and writes: integers only, every bit pattern of which is valid, and no pointer that the
/// kernel would follow.
pub trait Plain: Copy {}

macro_rules! plain {
    ($($(#[$doc:meta])* $name:ident { $($field:ident: $kind:ty = $zero:expr),* $(,)? })*) => { $(
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy)]
        pub struct $name { $(pub $field: $kind),* }
        impl Plain for $name {}
        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $zero),* }
            }
        }
    )* };
}

plain! {
    /// `v4l2_capability`
    Capability {
        driver: [u8; 16] = [0; 16], card: [u8; 32] = [0; 32], bus_info: [u8; 32] = [0; 32], version: u32 = 0,
        capabilities: u32 = 0, device_caps: u32 = 0, reserved: [u32; 3] = [0; 3],
    }
    /// `v4l2_fmtdesc`
    FormatDescription {
        index: u32 = 0, kind: u32 = CAPTURE, flags: u32 = 0, description: [u8; 32] = [0; 32], pixel_format: u32 = 0,
        media_bus_code: u32 = 0, reserved: [u32; 3] = [0; 3],
    }
    /// `v4l2_frmsizeenum`; `size` is width and height, or the least, largest and step of both (`v4l2_frmsize_stepwise`).
    FrameSize {
        index: u32 = 0, pixel_format: u32 = 0, kind: u32 = 0, size: [u32; 6] = [0; 6], reserved: [u32; 2] = [0; 2],
    }
    /// `v4l2_frmivalenum`; `interval` is a fraction in seconds, or the least, the largest and the step.
    FrameInterval {
        index: u32 = 0, pixel_format: u32 = 0, width: u32 = 0, height: u32 = 0, kind: u32 = 0,
        interval: [u32; 6] = [0; 6], reserved: [u32; 2] = [0; 2],
    }
    /// `v4l2_format` with `v4l2_pix_format` in its union.
    Format {
        kind: u32 = CAPTURE, pad: u32 = 0, width: u32 = 0, height: u32 = 0, pixel_format: u32 = 0, field: u32 = 0,
        bytes_per_line: u32 = 0, size_image: u32 = 0, rest: [u32; 44] = [0; 44],
    }
    /// `v4l2_requestbuffers`
    RequestBuffers {
        count: u32 = 0, kind: u32 = CAPTURE, memory: u32 = MEMORY_MMAP, capabilities: u32 = 0, flags: u32 = 0,
    }
    /// `v4l2_buffer` with an offset in its union.
    Buffer {
        index: u32 = 0, kind: u32 = CAPTURE, bytes_used: u32 = 0, flags: u32 = 0, field: u32 = 0, pad: u32 = 0,
        seconds: i64 = 0, microseconds: i64 = 0, timecode: [u32; 4] = [0; 4], sequence: u32 = 0,
        memory: u32 = MEMORY_MMAP, offset: u32 = 0, offset_rest: u32 = 0, length: u32 = 0, reserved: u32 = 0,
        request: u32 = 0, tail: u32 = 0,
    }
    /// `v4l2_streamparm` with `v4l2_captureparm` in its union.
    StreamParameters {
        kind: u32 = CAPTURE, capability: u32 = 0, mode: u32 = 0, seconds: u32 = 0, per: u32 = 0, extended: u32 = 0,
        read_buffers: u32 = 0, rest: [u32; 44] = [0; 44],
    }
    /// The `int` of `VIDIOC_STREAMON` and `VIDIOC_STREAMOFF`.
    BufferKind { kind: u32 = CAPTURE }
}

/// `VIDIOC_QUERYCAP`
pub const QUERY_CAPABILITY: Opcode = opcode::read::<Capability>(b'V', 0);
/// `VIDIOC_ENUM_FMT`
pub const ENUM_FORMAT: Opcode = opcode::read_write::<FormatDescription>(b'V', 2);
/// `VIDIOC_S_FMT`
pub const SET_FORMAT: Opcode = opcode::read_write::<Format>(b'V', 5);
/// `VIDIOC_REQBUFS`
pub const REQUEST_BUFFERS: Opcode = opcode::read_write::<RequestBuffers>(b'V', 8);
/// `VIDIOC_QUERYBUF`
pub const QUERY_BUFFER: Opcode = opcode::read_write::<Buffer>(b'V', 9);
/// `VIDIOC_QBUF`
pub const QUEUE_BUFFER: Opcode = opcode::read_write::<Buffer>(b'V', 15);
/// `VIDIOC_DQBUF`
pub const DEQUEUE_BUFFER: Opcode = opcode::read_write::<Buffer>(b'V', 17);
/// `VIDIOC_STREAMON`
pub const STREAM_ON: Opcode = opcode::write::<BufferKind>(b'V', 18);
/// `VIDIOC_STREAMOFF`
pub const STREAM_OFF: Opcode = opcode::write::<BufferKind>(b'V', 19);
/// `VIDIOC_S_PARM`
pub const SET_PARAMETERS: Opcode = opcode::read_write::<StreamParameters>(b'V', 22);
/// `VIDIOC_ENUM_FRAMESIZES`
pub const ENUM_FRAME_SIZES: Opcode = opcode::read_write::<FrameSize>(b'V', 74);
/// `VIDIOC_ENUM_FRAMEINTERVALS`
pub const ENUM_FRAME_INTERVALS: Opcode = opcode::read_write::<FrameInterval>(b'V', 75);

/// `UVC_SET_CUR`: a control's value is set.
pub const UVC_SET: u8 = 0x01;
/// `UVC_GET_CUR`: a control's value is asked for.
pub const UVC_GET: u8 = 0x81;

/// `uvc_xu_control_query`
#[repr(C)]
struct ExtensionQuery {
    unit: u8,
    selector: u8,
    query: u8,
    size: u16,
    data: *mut u8,
}

/// `UVCIOC_CTRL_QUERY`
const EXTENSION_QUERY: Opcode = opcode::read_write::<ExtensionQuery>(b'u', 0x21);

/// Gets ([`UVC_GET`]) or sets ([`UVC_SET`]) a control of an extension unit through `uvcvideo`, which refuses another length than
/// the control has.
///
/// # Errors
/// What the kernel answers; `INVAL` for more bytes than a request can state.
#[allow(unsafe_code)]
pub fn ask_extension(
    fd: BorrowedFd<'_>,
    [unit, selector, query]: [u8; 3],
    value: &mut [u8],
) -> rustix::io::Result<()> {
    let size = u16::try_from(value.len()).map_err(|_| rustix::io::Errno::INVAL)?;
    let mut asked = ExtensionQuery { unit, selector, query, size, data: value.as_mut_ptr() };
    // SAFETY: the request states the size of `ExtensionQuery`, whose bytes the kernel copies; it reads or writes at most `size`
    // bytes at `data`, which `value` lends for the call.
    unsafe { ioctl(fd, Updater::<EXTENSION_QUERY, _>::new(&mut asked)) }
}

/// Bytes that a request says its structure has.
const fn bytes_of(opcode: Opcode) -> usize {
    (opcode as usize >> 16) & 0x3fff
}

/// Asks the driver of a device; its answer replaces the value.
///
/// # Errors
/// What the kernel answers.
#[allow(unsafe_code)]
pub fn ask<const OPCODE: Opcode, T: Plain>(fd: BorrowedFd<'_>, value: &mut T) -> rustix::io::Result<()> {
    const { assert!(bytes_of(OPCODE) == size_of::<T>(), "the request is for another structure") };
    // SAFETY: the kernel copies as many bytes as the request states, which the assertion above makes those of `T`; `T` is
    // valid with whatever bits it writes (`Plain`), and holds no pointer: buffers are asked for by `MEMORY_MMAP` only.
    unsafe { ioctl(fd, Updater::<OPCODE, T>::new(value)) }
}

/// A buffer of a driver, mapped for reading until it is dropped.
pub struct Mapping {
    start: *mut c_void,
    length: usize,
}

// SAFETY: the mapping belongs to the process, not to a thread, and is only read through `&mut self`.
#[allow(unsafe_code)]
unsafe impl Send for Mapping {}

impl Mapping {
    /// Maps `length` bytes at the offset that the driver gave for the buffer.
    ///
    /// # Errors
    /// What the kernel answers.
    #[allow(unsafe_code)]
    pub fn new(fd: BorrowedFd<'_>, offset: u32, length: usize) -> rustix::io::Result<Self> {
        // SAFETY: the kernel chooses an address that nothing else uses.
        let start = unsafe {
            mmap(std::ptr::null_mut(), length, ProtFlags::READ, MapFlags::SHARED, fd, u64::from(offset))?
        };
        Ok(Self { start, length })
    }

    /// Copies the first bytes; only while the buffer is dequeued, when the driver does not write to it.
    #[allow(unsafe_code)]
    pub fn copy(&mut self, bytes: usize, into: &mut Vec<u8>) {
        let bytes = bytes.min(self.length);
        into.clear();
        into.reserve(bytes);
        // SAFETY: the mapping is readable over `length` bytes until the drop, also after the device was unplugged; `into` has
        // room for `bytes`, and is not the mapping.
        unsafe {
            std::ptr::copy_nonoverlapping(self.start.cast::<u8>(), into.as_mut_ptr(), bytes);
            into.set_len(bytes);
        }
    }
}

impl Drop for Mapping {
    #[allow(unsafe_code)]
    fn drop(&mut self) {
        // SAFETY: `start` and `length` are of one mapping, which nothing refers to any more.
        let _ = unsafe { munmap(self.start, self.length) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::offset_of;

    /// Ours with the name that the header has for it.
    fn ours() -> Vec<(&'static str, usize)> {
        let op = |o: Opcode| o as usize;
        vec![
            ("sizeof(struct v4l2_capability)", size_of::<Capability>()),
            ("offsetof(struct v4l2_capability, device_caps)", offset_of!(Capability, device_caps)),
            ("sizeof(struct v4l2_fmtdesc)", size_of::<FormatDescription>()),
            ("offsetof(struct v4l2_fmtdesc, pixelformat)", offset_of!(FormatDescription, pixel_format)),
            ("sizeof(struct v4l2_frmsizeenum)", size_of::<FrameSize>()),
            ("offsetof(struct v4l2_frmsizeenum, discrete)", offset_of!(FrameSize, size)),
            ("sizeof(struct v4l2_frmivalenum)", size_of::<FrameInterval>()),
            ("offsetof(struct v4l2_frmivalenum, discrete)", offset_of!(FrameInterval, interval)),
            ("sizeof(struct v4l2_format)", size_of::<Format>()),
            ("offsetof(struct v4l2_format, fmt.pix.width)", offset_of!(Format, width)),
            ("offsetof(struct v4l2_format, fmt.pix.pixelformat)", offset_of!(Format, pixel_format)),
            ("offsetof(struct v4l2_format, fmt.pix.bytesperline)", offset_of!(Format, bytes_per_line)),
            ("offsetof(struct v4l2_format, fmt.pix.sizeimage)", offset_of!(Format, size_image)),
            ("sizeof(struct v4l2_requestbuffers)", size_of::<RequestBuffers>()),
            ("offsetof(struct v4l2_requestbuffers, memory)", offset_of!(RequestBuffers, memory)),
            ("sizeof(struct v4l2_buffer)", size_of::<Buffer>()),
            ("offsetof(struct v4l2_buffer, bytesused)", offset_of!(Buffer, bytes_used)),
            ("offsetof(struct v4l2_buffer, flags)", offset_of!(Buffer, flags)),
            ("offsetof(struct v4l2_buffer, timestamp.tv_sec)", offset_of!(Buffer, seconds)),
            ("offsetof(struct v4l2_buffer, timestamp.tv_usec)", offset_of!(Buffer, microseconds)),
            ("offsetof(struct v4l2_buffer, sequence)", offset_of!(Buffer, sequence)),
            ("offsetof(struct v4l2_buffer, memory)", offset_of!(Buffer, memory)),
            ("offsetof(struct v4l2_buffer, m.offset)", offset_of!(Buffer, offset)),
            ("offsetof(struct v4l2_buffer, length)", offset_of!(Buffer, length)),
            ("sizeof(struct v4l2_streamparm)", size_of::<StreamParameters>()),
            (
                "offsetof(struct v4l2_streamparm, parm.capture.timeperframe)",
                offset_of!(StreamParameters, seconds),
            ),
            ("VIDIOC_QUERYCAP", op(QUERY_CAPABILITY)),
            ("VIDIOC_ENUM_FMT", op(ENUM_FORMAT)),
            ("VIDIOC_S_FMT", op(SET_FORMAT)),
            ("VIDIOC_REQBUFS", op(REQUEST_BUFFERS)),
            ("VIDIOC_QUERYBUF", op(QUERY_BUFFER)),
            ("VIDIOC_QBUF", op(QUEUE_BUFFER)),
            ("VIDIOC_DQBUF", op(DEQUEUE_BUFFER)),
            ("VIDIOC_STREAMON", op(STREAM_ON)),
            ("VIDIOC_STREAMOFF", op(STREAM_OFF)),
            ("VIDIOC_S_PARM", op(SET_PARAMETERS)),
            ("VIDIOC_ENUM_FRAMESIZES", op(ENUM_FRAME_SIZES)),
            ("VIDIOC_ENUM_FRAMEINTERVALS", op(ENUM_FRAME_INTERVALS)),
            ("sizeof(struct uvc_xu_control_query)", size_of::<ExtensionQuery>()),
            ("offsetof(struct uvc_xu_control_query, selector)", offset_of!(ExtensionQuery, selector)),
            ("offsetof(struct uvc_xu_control_query, query)", offset_of!(ExtensionQuery, query)),
            ("offsetof(struct uvc_xu_control_query, size)", offset_of!(ExtensionQuery, size)),
            ("offsetof(struct uvc_xu_control_query, data)", offset_of!(ExtensionQuery, data)),
            ("UVCIOC_CTRL_QUERY", op(EXTENSION_QUERY)),
            ("UVC_SET_CUR", usize::from(UVC_SET)),
            ("UVC_GET_CUR", usize::from(UVC_GET)),
            ("V4L2_BUF_TYPE_VIDEO_CAPTURE", CAPTURE as usize),
            ("V4L2_MEMORY_MMAP", MEMORY_MMAP as usize),
            ("V4L2_CAP_VIDEO_CAPTURE", CAP_CAPTURE as usize),
            ("V4L2_CAP_STREAMING", CAP_STREAMING as usize),
            ("V4L2_CAP_DEVICE_CAPS", CAP_DEVICE_CAPS as usize),
            ("V4L2_BUF_FLAG_ERROR", FLAG_ERROR as usize),
            ("V4L2_BUF_FLAG_TIMESTAMP_MASK", FLAG_STAMP_MASK as usize),
            ("V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC", FLAG_STAMP_MONOTONIC as usize),
            ("V4L2_FRMSIZE_TYPE_DISCRETE", DISCRETE as usize),
            ("V4L2_FRMIVAL_TYPE_DISCRETE", DISCRETE as usize),
            ("V4L2_PIX_FMT_Z16", crate::camera::PixelFormat::Z16.fourcc() as usize),
            ("V4L2_PIX_FMT_GREY", crate::camera::PixelFormat::GREY.fourcc() as usize),
            ("V4L2_PIX_FMT_Y8I", crate::camera::PixelFormat::Y8I.fourcc() as usize),
            ("V4L2_PIX_FMT_YUYV", crate::camera::PixelFormat::YUYV.fourcc() as usize),
            ("V4L2_PIX_FMT_UYVY", crate::camera::PixelFormat::UYVY.fourcc() as usize),
            ("V4L2_PIX_FMT_NV12", crate::camera::PixelFormat::NV12.fourcc() as usize),
            ("V4L2_PIX_FMT_MJPEG", crate::camera::PixelFormat::MJPG.fourcc() as usize),
        ]
    }

    /// What the documentation of the kernel gives for 64-bit machines, where no header is installed.
    #[test]
    fn structures_have_the_size_of_the_kernels() {
        let sizes = [
            size_of::<Capability>(),
            size_of::<FormatDescription>(),
            size_of::<FrameSize>(),
            size_of::<FrameInterval>(),
            size_of::<Format>(),
            size_of::<RequestBuffers>(),
            size_of::<Buffer>(),
            size_of::<StreamParameters>(),
            size_of::<ExtensionQuery>(),
        ];
        assert_eq!(sizes, [104, 64, 44, 52, 208, 20, 88, 204, 16]);
        assert_eq!(DEQUEUE_BUFFER, 0xc058_5611);
        assert_eq!(EXTENSION_QUERY, 0xc010_7521);
    }

    /// Compiles a program against the installed header, which prints the same list.
    #[test]
    fn structures_and_numbers_are_those_of_the_installed_header() {
        if !std::path::Path::new("/usr/include/linux/videodev2.h").is_file() {
            println!("skipped: /usr/include/linux/videodev2.h is not installed");
            return;
        }
        let lines: String =
            ours().iter().map(|(name, _)| format!("printf(\"%zu\\n\",(size_t)({name}));\n")).collect();
        let text = format!(
            "#include <stdio.h>\n#include <stddef.h>\n#include <linux/videodev2.h>\n#include <linux/usb/video.h>\n#include <linux/uvcvideo.h>\nint main(void){{\n{lines}return 0;}}\n"
        );
        let folder = std::env::temp_dir().join(format!("cairn-abi-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let (source, program) = (folder.join("sizes.c"), folder.join("sizes"));
        std::fs::write(&source, text).unwrap();
        let built = std::process::Command::new("cc").arg(&source).arg("-o").arg(&program).status();
        if !built.is_ok_and(|s| s.success()) {
            println!("skipped: no C compiler \"cc\" that compiles this");
            return;
        }
        let output = std::process::Command::new(&program).output().unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        let found = String::from_utf8(output.stdout).unwrap();
        let found: Vec<usize> = found.lines().map(|l| l.parse().unwrap()).collect();
        assert_eq!(found.len(), ours().len());
        for ((name, ours), found) in ours().iter().zip(found) {
            assert_eq!(*ours, found, "{name}");
        }
    }

    /// Without a camera: the call reaches the kernel, which refuses a file that is no device.
    #[test]
    fn a_file_that_is_no_device_is_refused() {
        use rustix::fd::AsFd;
        let file = std::fs::File::open("/dev/null").unwrap();
        let answer = ask::<QUERY_CAPABILITY, _>(file.as_fd(), &mut Capability::default());
        assert_eq!(answer, Err(rustix::io::Errno::NOTTY));
        let answer = ask_extension(file.as_fd(), [3, 2, UVC_GET], &mut [0]);
        assert_eq!(answer, Err(rustix::io::Errno::NOTTY));
        let answer = ask_extension(file.as_fd(), [3, 2, UVC_GET], &mut vec![0; 70_000]);
        assert_eq!(answer, Err(rustix::io::Errno::INVAL));
    }
}
