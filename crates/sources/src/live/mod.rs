//! Live video and video files: everything that the `ffmpeg` program can open, through a child process.
//!
//! In: an address. Out: a [`Source`] with one camera. ffmpeg is not linked; images come as gray rows over a
//! pipe. Live streams deliver the newest image, drop images that are too old, and reconnect by themselves.

mod address;
mod child;
mod file;
mod film;
mod page_clock;
mod phone;
mod phone_port;
mod resize;
mod rtmp_port;
mod slot;
mod stream;

pub use address::waiting_for;
pub use film::Film;
pub use phone::PhoneSource;
pub use phone_port::{MotionReading, PhonePort};

use crate::options::OpenOptions;
use address::Address;
use cairn_sensor::{Camera, Rig, Source, SourceError};

/// Whether a source is live, so that it must not be paced.
pub fn is_live(source: &str) -> bool {
    is_camera(source) || matches!(Address::of(source), Some(Ok(address)) if address.live)
}

/// Whether an address is of a camera of the kernel, whether or not this build can open it.
pub fn is_camera(source: &str) -> bool {
    source.starts_with("v4l2:") || source.starts_with("realsense:")
}

/// Width and height of the images of a video file; `None` for anything else.
pub fn image_size(source: &str) -> Option<[usize; 2]> {
    let address = Address::of(source)?.ok().filter(|address| !address.live)?;
    file::size(&address)
}

/// Opens the address if it is video; `None` if it is not.
pub fn open(source: &str, options: &OpenOptions) -> Option<Result<Box<dyn Source>, SourceError>> {
    let address = Address::of(source)?;
    Some(address.and_then(|address| open_video(&address, options)))
}

fn open_video(address: &Address, options: &OpenOptions) -> Result<Box<dyn Source>, SourceError> {
    // Video has one camera, or two side by side in a file: of a rig with more, with depth or an IMU, only these count.
    let mut options = options.clone();
    if let Some(rig) = &mut options.rig {
        rig.cameras.truncate(if address.live { 1 } else { 2 });
        (rig.depth, rig.imu) = (None, None);
    }
    let options = &options;
    if !address.live {
        return file::open(address, options);
    }
    if options.start_s > 0.0 {
        let cure = "leave --start out: a live stream starts now";
        return Err(SourceError::new(&address.shown, "a live stream has no start position", cure));
    }
    Ok(Box::new(stream::Stream::open(address, options)?))
}

/// The rig for images of this size: the given one, which must fit, else a guess, with a description of it.
///
/// Without a calibration the focal length is taken as 0.7 of the longer side (a horizontal field of view of
/// 71 degrees, as most phones film), and the centre of the image as the principal point.
pub(crate) fn rig_for(
    shown: &str,
    [width, height]: [usize; 2],
    given: Option<Rig>,
) -> Result<(Rig, Option<String>), SourceError> {
    let Some(rig) = given else {
        let camera = Camera::guessed(width, height);
        let assumed =
            format!("a focal length of {:.0} px (0.7 of the longer side), no distortion", camera.fx);
        return Ok((Rig::mono(camera), Some(assumed)));
    };
    match rig.cameras.first() {
        Some(c) if [c.camera.width, c.camera.height] == [width, height] => Ok((rig, None)),
        Some(c) => {
            let (w, h) = (c.camera.width, c.camera.height);
            let why = format!("has images of {width}x{height}, the rig is for {w}x{h}");
            Err(SourceError::new(shown, why, "set the camera to that size, or give its own --rig"))
        }
        None => Err(SourceError::new(shown, "the rig has no camera", "give a rig with one camera")),
    }
}
