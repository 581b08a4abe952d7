//! Which node of which device delivers a stream, found by what the nodes have.

use super::address::Place;
use super::device::{
    DeviceError, Kernel, Mode, MotionKind, MotionNode, PixelFormat, Trouble, Usb, VideoFound, VideoNode,
};
use super::format::{IMAGE, ModeRequest, choose};
use super::projector::darken;
use cairn_sensor::Rig;
use std::path::PathBuf;

/// Intel's number on USB.
pub const INTEL: u16 = 0x8086;

/// What a stream is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// One camera, whatever its colours; of a RealSense the one that is neither depth nor infrared.
    Colour,
    /// The left camera of an infrared pair.
    Infrared,
    /// Both cameras of an infrared pair.
    Pair,
    /// Depth.
    Depth,
}

impl Role {
    /// The formats that will do.
    pub fn formats(self) -> Vec<PixelFormat> {
        match self {
            Self::Colour => IMAGE.to_vec(),
            Self::Infrared => vec![PixelFormat::GREY],
            Self::Pair => vec![PixelFormat::Y8I],
            Self::Depth => vec![PixelFormat::Z16],
        }
    }

    /// In messages.
    fn name(self) -> &'static str {
        match self {
            Self::Colour => "colour",
            Self::Infrared => "infrared",
            Self::Pair => "pair of infrared",
            Self::Depth => "depth",
        }
    }

    /// Whether a node of a RealSense with these modes is the one.
    fn is(self, modes: &[Mode]) -> bool {
        let has = |format| modes.iter().any(|m| m.format == format);
        let infrared = has(PixelFormat::GREY) || has(PixelFormat::Y8I);
        match self {
            Self::Colour => !infrared && !has(PixelFormat::Z16) && IMAGE.iter().any(|f| has(*f)),
            Self::Infrared | Self::Pair => infrared,
            Self::Depth => has(PixelFormat::Z16),
        }
    }
}

/// What is to be opened, told by the rig.
pub struct Streams {
    /// The images.
    pub image: Role,
    /// Whether there is depth beside them.
    pub depth: bool,
    /// The rate of the motion sensors, if they are wanted.
    pub motion: Option<f64>,
    /// Whether the projector of a RealSense has to be off: infrared images without depth, which needs its dots.
    pub dark: bool,
}

impl Streams {
    /// With one camera of any colour where there is no rig.
    pub fn of(place: &Place, rig: Option<&Rig>) -> Self {
        let Some(rig) = rig else {
            return Self { image: Role::Colour, depth: false, motion: None, dark: false };
        };
        let name = rig.cameras.first().map_or(String::new(), |c| c.name.to_ascii_lowercase());
        let image = match rig.cameras.len() {
            0 | 1 if name.starts_with("infra") && matches!(place, Place::RealSense { .. }) => Role::Infrared,
            0 | 1 => Role::Colour,
            _ => Role::Pair,
        };
        let depth = rig.depth.is_some();
        let dark = image != Role::Colour && !depth && matches!(place, Place::RealSense { .. });
        Self { image, depth, dark, motion: rig.imu.as_ref().map(|imu| imu.rate_hz) }
    }
}

/// A node that delivers.
pub struct Started {
    /// The node.
    pub node: Box<dyn VideoNode>,
    /// The mode that it was started in.
    pub mode: Mode,
    /// Where it is plugged in.
    pub usb: Option<Usb>,
    /// Why the projector could not be switched off, where that was wanted.
    pub projector: Option<DeviceError>,
}

/// Finds the node for a stream and starts it, `dark` with the projector off as long as it is open ([`darken`]).
///
/// # Errors
/// [`DeviceError`] where there is no such device or node, it has no fitting mode, or cannot be started.
pub fn start(
    kernel: &dyn Kernel,
    place: &Place,
    role: Role,
    size: Option<[usize; 2]>,
    rate_hz: f64,
    dark: bool,
) -> Result<Started, DeviceError> {
    let (path, usb, node, modes) = match place {
        Place::Node(path) => {
            let mut node = kernel.video(path)?;
            let modes = node.modes()?;
            let usb =
                kernel.videos().ok().into_iter().flatten().find(|v| v.node == *path).and_then(|v| v.usb);
            (path.clone(), usb, node, modes)
        }
        Place::RealSense { serial } => of_realsense(kernel, serial.as_deref(), role)?,
    };
    let shown = path.display().to_string();
    let wanted = choose(&shown, &modes, &ModeRequest { formats: role.formats(), size, rate_hz })?;
    let (mut node, projector) = if dark { darken(node) } else { (node, None) };
    let mode = node.start(&wanted)?;
    if (mode.format, mode.width, mode.height) != (wanted.format, wanted.width, wanted.height) {
        let why = format!("set itself to {mode} in place of {wanted}");
        return Err(DeviceError::new(Trouble::Unsuitable, shown, why));
    }
    Ok(Started { node, mode, usb, projector })
}

/// The RealSense cameras that are plugged in, each with its video nodes.
pub fn realsenses(videos: Vec<VideoFound>) -> Vec<(Usb, Vec<VideoFound>)> {
    let mut all: Vec<(Usb, Vec<VideoFound>)> = Vec::new();
    for video in videos {
        let Some(usb) = video.usb.clone().filter(|u| u.vendor == INTEL && video.name.contains("RealSense"))
        else {
            continue;
        };
        match all.iter_mut().find(|(known, _)| *known == usb) {
            Some((_, nodes)) => nodes.push(video),
            None => all.push((usb, vec![video])),
        }
    }
    all
}

type Opened = (PathBuf, Option<Usb>, Box<dyn VideoNode>, Vec<Mode>);

fn of_realsense(kernel: &dyn Kernel, serial: Option<&str>, role: Role) -> Result<Opened, DeviceError> {
    let fail = |trouble, why: String| DeviceError::new(trouble, "realsense:", why);
    let mut all = realsenses(kernel.videos()?);
    all.retain(|(usb, _)| serial.is_none_or(|s| usb.serial == s));
    let (usb, nodes) = match (all.pop(), all.len()) {
        (Some(one), 0) => one,
        (Some((last, _)), _) => {
            let serials: Vec<&str> =
                all.iter().map(|(u, _)| &u.serial).chain([&last.serial]).map(String::as_str).collect();
            let why = format!(
                "more than one is plugged in; write realsense:SERIAL with one of {}",
                serials.join(", ")
            );
            return Err(fail(Trouble::Unsuitable, why));
        }
        (None, _) => {
            let with = serial.map_or(String::new(), |s| format!(" with the serial number {s}"));
            return Err(fail(
                Trouble::Missing,
                format!("no RealSense{with} is among the kernel's video devices"),
            ));
        }
    };
    let mut refused = None;
    for found in nodes {
        let opened = kernel.video(&found.node).and_then(|mut node| {
            let modes = node.modes()?;
            Ok((node, modes))
        });
        match opened {
            Ok((node, modes)) if role.is(&modes) => return Ok((found.node, Some(usb), node, modes)),
            // Every second node is one of metadata.
            Err(e) if e.trouble != Trouble::Unsuitable => refused = refused.or(Some(e)),
            _ => {}
        }
    }
    Err(refused.unwrap_or_else(|| fail(Trouble::Unsuitable, format!("it has no node of {}", role.name()))))
}

/// Finds the motion sensor of a device and starts it; returns its rate too.
///
/// # Errors
/// [`DeviceError`] where it has none, or it cannot be started.
pub fn start_motion(
    kernel: &dyn Kernel,
    port: &str,
    kind: MotionKind,
    rate_hz: f64,
) -> Result<(Box<dyn MotionNode>, f64), DeviceError> {
    let of_port = |usb: &Option<Usb>| usb.as_ref().is_some_and(|u| u.port == port);
    let found = kernel.motions()?.into_iter().find(|m| m.kind == kind && of_port(&m.usb));
    let name = match kind {
        MotionKind::Gyro => "gyroscope",
        MotionKind::Accel => "accelerometer",
    };
    let found = found.ok_or_else(|| {
        DeviceError::new(
            Trouble::Missing,
            format!("USB port {port}"),
            format!("the kernel lists no {name} there"),
        )
    })?;
    let mut node = kernel.motion(&found.node)?;
    let rate = node.start(rate_hz)?;
    Ok((node, rate))
}
