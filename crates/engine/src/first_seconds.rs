//! The first seconds of a recording are looked at before the first frame is tracked, and then delivered with the rest: for the focal
//! length of a camera that nobody calibrated ([`first_lens`]).

use crate::Config;
use cairn_sensor::{FramePacket, ImuSample, Live, Rig, Skips, Source, SourceError, SourceInfo};
use cairn_tracking::first_lens;
use cairn_vision::{Frame, FrontEnd, SensorMode};
use std::collections::VecDeque;
use std::sync::Arc;

/// Seconds that are looked at.
const LENS_S: f64 = 6.0;
/// A focal length that is known worse than this is not taken: a guess by the size of the images is about as good.
const MOST_SIGMA: f64 = 0.03;

/// A source with another rig, and the packets that were read of it already.
struct Looked {
    source: Box<dyn Source>,
    first: VecDeque<FramePacket>,
    rig: Rig,
    info: SourceInfo,
}

/// Looks at the first seconds of a recording whose lens is assumed: with the focal length that they tell, where they do.
///
/// # Errors
/// When the source fails.
pub fn with_found_lens(mut source: Box<dyn Source>, config: &Config) -> Result<Box<dyn Source>, SourceError> {
    let (mut rig, mut info) = (source.rig().clone(), source.info().clone());
    let mut packets: Vec<FramePacket> = Vec::new();
    while let Some(packet) = source.next_packet()? {
        packets.push(packet);
        if packets[packets.len() - 1].stamp - packets[0].stamp >= LENS_S {
            break;
        }
    }
    if let Some(ratio) = focal_ratio(&rig, &packets, config)
        && let Some(camera) = rig.cameras.first_mut().map(|c| &mut c.camera)
    {
        (camera.fx, camera.fy) = (camera.fx * ratio, camera.fy * ratio);
        let found = format!("a focal length of {:.0} px, found from the first seconds", camera.fx);
        info.assumed = info.assumed.map(|assumed| format!("{found}, in place of {assumed}"));
    }
    Ok(Box::new(Looked { source, first: packets.into(), rig, info }))
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
            Some(packet) => Ok(Some(packet)),
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
