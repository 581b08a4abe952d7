//! A RealSense that is not there, over the frames of an RGB-D recording.

use super::align::DepthAligner;
use super::device::{Mode, PixelFormat, VideoFound};
use super::simulated::{FramesOf, Simulated, SimulatedVideo};
use cairn_sensor::{DepthImage, DepthSensor, FramePacket, Rig, RigCamera};
use std::sync::Arc;

/// How long after the colour camera the depth sensor is triggered, seconds.
const DEPTH_LATE_S: f64 = 0.012;

/// Where it is plugged in.
const PORT: &str = "2-1";

/// The serial number of a replayed camera.
pub const SERIAL: &str = "841612070000";

impl Simulated {
    /// A D435i at port `2-1` with nodes `/dev/video0` (depth), `/dev/video2` (infrared, both cameras of one shade each) and
    /// `/dev/video4` (colour), which plays the packets of a recording with registered depth, once. `rig` is the simulated
    /// device's: its depth sensor is beside its first camera, and the recording's depth is moved there.
    pub fn replay(rig: &Rig, packets: &[FramePacket], rate_hz: f64) -> Self {
        let machine = Self::new();
        let (Some(camera), Some(sensor)) = (rig.cameras.first(), &rig.depth) else { return machine };
        let size = [camera.camera.width, camera.camera.height];
        let colour = packets.iter().map(|p| p.images.first().map_or(Vec::new(), |image| yuyv(image.data())));
        machine.add_video(video(4, &[(PixelFormat::YUYV, size)], rate_hz, 0.0, once(colour.collect())));
        // The recording's depth is the colour camera's.
        let of_colour =
            DepthSensor { camera: camera.camera, body_from_depth: camera.body_from_camera, ..sensor.clone() };
        let beside = RigCamera {
            name: "depth".into(),
            camera: sensor.camera,
            body_from_camera: sensor.body_from_depth,
        };
        let aligner = DepthAligner::new(&of_colour, &beside);
        let bytes = |depth: &DepthImage| depth.data().iter().flat_map(|z| z.to_le_bytes()).collect();
        let depth = packets
            .iter()
            .map(|p| p.depth.as_ref().and_then(|d| aligner.align(d)).as_ref().map_or(Vec::new(), bytes));
        let of_depth = [sensor.camera.width, sensor.camera.height];
        machine.add_video(video(
            0,
            &[(PixelFormat::Z16, of_depth)],
            rate_hz,
            DEPTH_LATE_S,
            once(depth.collect()),
        ));
        let shades: FramesOf = Arc::new(|_, mode| {
            let pixels = mode.width * mode.height;
            Some(if mode.format == PixelFormat::Y8I { [50, 60].repeat(pixels) } else { vec![50; pixels] })
        });
        let infrared = [(PixelFormat::GREY, of_depth), (PixelFormat::Y8I, of_depth)];
        machine.add_video(video(2, &infrared, rate_hz, 0.0, shades));
        machine.add_projector(PORT);
        machine
    }
}

/// A gray image as a driver delivers it in YUYV.
fn yuyv(gray: &[u8]) -> Vec<u8> {
    gray.iter().flat_map(|y| [*y, 128]).collect()
}

/// Each frame by its number.
fn once(frames: Vec<Vec<u8>>) -> FramesOf {
    Arc::new(move |k, _| frames.get(usize::try_from(k).ok()?).cloned())
}

fn video(
    n: usize,
    modes: &[(PixelFormat, [usize; 2])],
    rate_hz: f64,
    phase_s: f64,
    frames: FramesOf,
) -> SimulatedVideo {
    let usb = Some(Simulated::d435i(PORT, SERIAL));
    let mode =
        |&(format, [width, height]): &(_, [usize; 2])| Mode { format, width, height, stride: 0, rate_hz };
    SimulatedVideo {
        found: VideoFound {
            node: format!("/dev/video{n}").into(),
            name: "Intel(R) RealSense(TM) Depth Ca".into(),
            usb,
        },
        modes: modes.iter().map(mode).collect(),
        frames,
        phase_s,
    }
}
