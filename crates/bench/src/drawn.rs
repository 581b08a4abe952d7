//! A phone drawn by a seed on a planned walk, as a source: lens, rolling shutter, stamps, readings and start are those of
//! [`PhoneTraits`], as in `cairn demo --phone`, but without a page, JPEGs and real time, so that runs are reproducible.

use crate::MeasureError;
use cairn_geometry::Se3;
use cairn_random::Random;
use cairn_sensor::{
    FramePacket, GrayImage, ImuSensor, Merge, MergeConfig, Rig, Source, SourceError, SourceInfo, Stamp,
};
use cairn_sim::{Effects, MotionSensors, PhoneTraits, RollingCamera, SimConfig, World};
use std::sync::Arc;

/// Pictures are every second or third of the camera's, 10 to 15 a second.
const SKIPPED: [u64; 2] = [2, 3];
/// Pictures come this long after the source's time begins, so that no stamp is negative.
const EPOCH_S: f64 = 1.0;

/// A picture in the making: seconds of the exposure of its middle row, and its stamp.
type Shot = (f64, Stamp);

/// The source.
pub struct DrawnPhone {
    info: SourceInfo,
    rig: Rig,
    traits: PhoneTraits,
    motion: cairn_sim::ContinuousTrajectory,
    camera: RollingCamera,
    sensors: MotionSensors,
    shots: std::vec::IntoIter<Shot>,
    merge: Merge<Arc<GrayImage>, ()>,
}

impl DrawnPhone {
    /// The phone of the config's seed in a motion. Its rig has the true lens, and of the motion sensors only what
    /// [`ImuSensor::of_phone`] assumes. Only every `every`-th of its pictures comes, as with a server that is too slow for more.
    ///
    /// # Errors
    /// When the lens cannot be drawn.
    pub fn new(
        config: &SimConfig,
        world: &Arc<World>,
        motion: cairn_sim::ContinuousTrajectory,
        traits: &PhoneTraits,
        every: usize,
    ) -> Result<Self, MeasureError> {
        let effects = Effects { noise: 3.0, ..config.effects };
        let camera = RollingCamera::new(world, &traits.camera, traits.readout_s, effects, config.seed);
        let camera = camera?;
        let rig = Rig { imu: Some(ImuSensor::of_phone()), ..Rig::mono(traits.camera) };
        let shots =
            shots(traits, motion.end(), config.seed).into_iter().step_by(every.max(1)).collect::<Vec<_>>();
        let truth = shots.iter().map(|(at, stamp)| (*stamp, motion.pose(*at))).collect();
        let info = SourceInfo {
            name: format!("a phone, seed {}", config.seed),
            frames: Some(shots.len()),
            rate_hz: traits.camera_hz / 2.5,
            truth,
            assumed: None,
        };
        let imu_period_s = Some(1.0 / traits.imu_hz);
        let merge = Merge::new(MergeConfig { imu_period_s, ..MergeConfig::default() });
        let sensors = MotionSensors::new(traits, config.seed);
        Ok(Self { info, rig, traits: *traits, motion, camera, sensors, shots: shots.into_iter(), merge })
    }
}

/// The pictures of a walk of so many seconds.
fn shots(traits: &PhoneTraits, end_s: f64, seed: u64) -> Vec<Shot> {
    let mut random = Random::stream(seed, 0x57A4);
    let mut shots = Vec::new();
    let mut nth = 0;
    loop {
        let at = nth as f64 / traits.camera_hz;
        if at + traits.readout_s > end_s {
            return shots;
        }
        let late = traits.stamp_delay_s + traits.stamp_jitter_s * random.standard_normal();
        shots.push((at, Stamp::from_seconds(EPOCH_S + at + late)));
        nth += SKIPPED[random.below(SKIPPED.len())];
    }
}

impl Source for DrawnPhone {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let Some((at, stamp)) = self.shots.next() else { return Ok(None) };
        let poses: Vec<Se3> =
            self.camera.times().iter().map(|dt| self.motion.pose((at + dt).max(0.0))).collect();
        let image = Arc::new(self.camera.picture(at, &poses));
        let packet = |images, imu| FramePacket { stamp, images, depth: None, imu, decode_ms: 0.0 };
        if at < self.traits.imu_start_s {
            return Ok(Some(packet(vec![image], Vec::new())));
        }
        let fail = |why: String| SourceError::new(self.info.name.clone(), why, "choose another seed");
        self.merge.push_image(0, stamp, image).map_err(|e| fail(e.to_string()))?;
        // Beyond the stamp by more than the jitter.
        let until_s = at + self.traits.stamp_delay_s + 3.0 / self.traits.imu_hz;
        for mut sample in self.sensors.until(&self.motion, until_s) {
            sample.stamp = sample.stamp.plus_seconds(EPOCH_S);
            self.merge.push_imu(sample).map_err(|e| fail(e.to_string()))?;
        }
        let merged = self.merge.pop().ok_or_else(|| fail("no reading after a picture".into()))?;
        Ok(Some(packet(merged.images, merged.imu)))
    }

    fn skipped(&self) -> &[String] {
        &[]
    }
}
