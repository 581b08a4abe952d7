//! Video that comes as it happens, and video files: everything that the `ffmpeg` program can open, through a child process.
//!
//! In: an address. Out: a [`Source`] with one camera. Nothing of ffmpeg is linked; pictures come as gray rows over a
//! pipe. Live streams give the newest picture, forget what is too old, and come back by themselves.

mod address;
mod child;
mod file;
mod phone;
mod slot;
mod stream;

pub use address::waiting_for;
pub use phone::{Motion, PhonePort, PhoneSource};

use crate::open::OpenOptions;
use address::Address;
use cairn_sensor::{Camera, Rig, Source, SourceError};

/// Whether a source comes as it happens, so that nothing may pace it.
pub fn is_live(source: &str) -> bool {
    matches!(Address::of(source), Some(Ok(address)) if address.live)
}

/// Opens the address if it is one of video: `None` for what is none.
pub fn open(source: &str, options: &OpenOptions) -> Option<Result<Box<dyn Source>, SourceError>> {
    let address = Address::of(source)?;
    Some(address.and_then(|address| open_video(&address, options)))
}

fn open_video(address: &Address, options: &OpenOptions) -> Result<Box<dyn Source>, SourceError> {
    if let Some(rig) = &options.rig
        && (rig.cameras.len() != 1 || rig.depth.is_some())
    {
        let why = format!("has one camera, the rig {} and depth: {}", rig.cameras.len(), rig.depth.is_some());
        return Err(SourceError::new(&address.shown, why, "give a rig with one camera"));
    }
    if !address.live {
        return file::open(address, options);
    }
    if options.start_s > 0.0 {
        let cure = "leave --start out: what is live begins now";
        return Err(SourceError::new(&address.shown, "a live stream has no place to start at", cure));
    }
    Ok(Box::new(stream::Stream::open(address, options.rig.clone(), options.frames)?))
}

/// The rig for pictures of this size: the given one, which must fit, else a guess, which is told in words.
///
/// Without a calibration the focal length is taken as 0.7 of the longer side (a horizontal view of 71 degrees, as most
/// phones film), and the middle of the picture as the principal point.
fn rig_for(
    shown: &str,
    [width, height]: [usize; 2],
    given: Option<Rig>,
) -> Result<(Rig, Option<String>), SourceError> {
    let Some(rig) = given else {
        let camera = guessed(width, height);
        let assumed =
            format!("a focal length of {:.0} px (0.7 of the longer side), no distortion", camera.fx);
        return Ok((Rig::mono(camera), Some(assumed)));
    };
    match rig.cameras.first() {
        Some(c) if [c.camera.width, c.camera.height] == [width, height] => Ok((rig, None)),
        Some(c) => {
            let (w, h) = (c.camera.width, c.camera.height);
            let why = format!("gives pictures of {width}x{height}, the rig is for {w}x{h}");
            Err(SourceError::new(shown, why, "set the camera to that size, or give its own --rig"))
        }
        None => Err(SourceError::new(shown, "the rig has no camera", "give a rig with one camera")),
    }
}

/// What a camera of which nothing is known probably looks like.
pub fn guessed(width: usize, height: usize) -> Camera {
    let f = 0.7 * width.max(height) as f64;
    Camera::pinhole(width, height, f, f, 0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0))
}
