//! The first seconds of a recording are looked at before the first frame is tracked, and then delivered with the rest: for the focal
//! length of a camera that nobody calibrated ([`first_lens`]), and for depth that is not registered to its picture.

use crate::Config;
use cairn_dense::{DenseError, PackedDepth};
use cairn_sensor::{FramePacket, ImuSample, Live, Rig, Skips, Source, SourceError, SourceInfo};
use cairn_tracking::first_lens;
use cairn_vision::{Frame, FrontEnd, Misregistration, RegistrationCheck, SensorMode};
use std::collections::VecDeque;
use std::sync::Arc;

/// Seconds that are looked at for the focal length, and for the registration of depth.
const LENS_S: f64 = 6.0;
const REGISTRATION_S: f64 = 1.5;
/// Seconds between two looks at the registration.
const APART_S: f64 = 0.15;
/// A focal length that is known worse than this is not taken: a guess by the size of the images is about as good.
const MOST_SIGMA: f64 = 0.03;

/// A source with another rig, and the packets that were read of it already.
struct Looked {
    source: Box<dyn Source>,
    first: VecDeque<Packed>,
    rig: Rig,
    info: SourceInfo,
}

/// A packet whose depth is packed: a fifth of its size.
struct Packed {
    packet: FramePacket,
    depth: Option<PackedDepth>,
}

impl Packed {
    fn of(mut packet: FramePacket) -> Self {
        let depth = packet.depth.take().map(|depth| PackedDepth::pack(&depth));
        Self { packet, depth }
    }

    fn unpacked(self) -> Result<FramePacket, SourceError> {
        let Self { mut packet, depth } = self;
        let depth = depth.map(|depth| depth.unpack()).transpose();
        let fail =
            |e: DenseError| SourceError::new("depth", e.to_string(), "report this with the command line");
        packet.depth = depth.map_err(fail)?.map(Arc::new);
        Ok(packet)
    }
}

/// Reads the first seconds of a source; each packet is handed on.
fn read(source: &mut dyn Source, seconds: f64, mut take: impl FnMut(FramePacket)) -> Result<(), SourceError> {
    let mut first = None;
    while let Some(packet) = source.next_packet()? {
        let stamp = packet.stamp;
        take(packet);
        if stamp - *first.get_or_insert(stamp) >= seconds {
            break;
        }
    }
    Ok(())
}

/// Looks at the first seconds of a recording whose lens is assumed: with the focal length that they tell, where they do.
///
/// # Errors
/// When the source fails.
pub fn with_found_lens(mut source: Box<dyn Source>, config: &Config) -> Result<Box<dyn Source>, SourceError> {
    let (mut rig, mut info) = (source.rig().clone(), source.info().clone());
    let mut packets = Vec::new();
    read(source.as_mut(), LENS_S, |packet| packets.push(packet))?;
    if let Some(ratio) = focal_ratio(&rig, &packets, config)
        && let Some(camera) = rig.cameras.first_mut().map(|c| &mut c.camera)
    {
        (camera.fx, camera.fy) = (camera.fx * ratio, camera.fy * ratio);
        let found = format!("a focal length of {:.0} px, found from the first seconds", camera.fx);
        info.assumed = info.assumed.map(|assumed| format!("{found}, in place of {assumed}"));
    }
    Ok(Box::new(Looked { source, first: packets.into_iter().map(Packed::of).collect(), rig, info }))
}

/// Looks at the first seconds of a recording with depth that is said to be registered to its picture: how the two lie where they are
/// not.
///
/// # Errors
/// When the source fails.
pub fn with_checked_depth(
    mut source: Box<dyn Source>,
) -> Result<(Box<dyn Source>, Option<Misregistration>), SourceError> {
    if source.rig().depth.as_ref().is_none_or(|depth| !depth.registered) {
        return Ok((source, None));
    }
    let (rig, info) = (source.rig().clone(), source.info().clone());
    let (mut check, mut due, mut first) = (RegistrationCheck::default(), None, VecDeque::new());
    read(source.as_mut(), REGISTRATION_S, |packet| {
        let both = packet.depth.as_ref().zip(packet.images.first());
        if let Some((depth, picture)) = both.filter(|_| due.is_none_or(|due| packet.stamp >= due)) {
            check.look(depth, picture);
            due = Some(packet.stamp.plus_seconds(APART_S));
        }
        first.push_back(Packed::of(packet));
    })?;
    Ok((Box::new(Looked { source, first, rig, info }), check.found()))
}

/// The true focal length over that of the rig.
fn focal_ratio(rig: &Rig, packets: &[FramePacket], config: &Config) -> Option<f64> {
    let (camera, sensor) = (rig.cameras.first()?, rig.imu.as_ref()?);
    let mut front_end = FrontEnd::new(rig, SensorMode::Mono, config.front_end_for(rig)).ok()?;
    let frames = packets.iter().filter_map(|packet| front_end.extract(packet).ok());
    let frames: Vec<Arc<Frame>> = frames.map(Arc::new).collect();
    let samples: Vec<ImuSample> = packets.iter().flat_map(|packet| packet.imu.iter().copied()).collect();
    let model = front_end.model();
    let size = [camera.camera.width, camera.camera.height];
    let imu_from_camera = sensor.body_from_imu.inverse() * model.body_from_camera;
    let found = first_lens(model, size, &frames, &samples, sensor, &imu_from_camera)?;
    (found.sigma <= MOST_SIGMA).then(|| found.log_focal.exp())
}

impl Source for Looked {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        match self.first.pop_front() {
            Some(packet) => packet.unpacked().map(Some),
            None => self.source.next_packet(),
        }
    }

    fn skipped(&self) -> &[String] {
        self.source.skipped()
    }

    fn live(&self) -> Option<Arc<dyn Live>> {
        self.source.live()
    }

    fn skips(&self) -> Skips {
        self.source.skips()
    }
}
