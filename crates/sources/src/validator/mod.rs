//! Plausibility checks of packets as they come: an assumed calibration, implausible IMU data, clocks that are not
//! synchronised, depth that is missing, in another unit, not registered or late, pictures that do not change, a pair that is not the
//! calibrated one, pictures that turn otherwise than the gyroscope. Each doubt is reported once, as text with numbers.

mod delay;
mod fixed;
mod frozen;
mod matched;
mod pair;
mod registration;
mod turns;
mod unit;
mod watch;

use cairn_inertial::Readings;
use cairn_sensor::{
    DepthSensor, FramePacket, ImuSample, ImuSensor, Live, Rig, SkipKind, Skipped, Skips, Source, SourceError,
    SourceInfo, Stamp,
};
use cairn_vision::RegistrationCheck;
use delay::DelayWatch;
use fixed::FixedWatch;
use frozen::FrozenWatch;
use pair::PairWatch;
use std::sync::Arc;
use turns::TurnWatch;
use unit::UnitWatch;
use watch::Watch;

/// Longest plausible time in seconds from an image to the IMU sample after it.
const MAX_AFTER_S: f64 = 0.05;
/// Seconds of readings checked at the start.
const CHECKED_S: f64 = 10.0;

/// Seconds of depth images checked at the start.
const DEPTH_CHECKED_S: f64 = 1.0;
/// No depth camera measures only what is nearer, metres: the nearest that one measures at all is 0.07 m (D405).
pub const NEAREST_DEPTH_M: f64 = 0.05;

/// A second of depth images whose nearest is farther shows nothing that a depth camera measures, metres.
const NEAREST_AT_MOST_M: f64 = 30.0;

/// Readings that are kept while pictures repeat: a minute and a half at 200 a second.
const MOST_READINGS: usize = 20_000;

/// Collects the IMU data of packets, to check it.
#[derive(Clone, Debug, Default)]
pub struct ImuWatch {
    first: Option<Stamp>,
    samples: Vec<ImuSample>,
    images: usize,
    without: usize,
    /// Of these, those after the first sample.
    gaps: usize,
    after_s: f64,
}

impl ImuWatch {
    /// Takes a packet; returns how many seconds it lies after the first.
    pub fn packet(&mut self, packet: &FramePacket) -> f64 {
        self.images += 1;
        self.samples.extend(packet.imu.iter().filter(|s| !s.is_synthesised()));
        match self.samples.last() {
            Some(last) if last.stamp >= packet.stamp => self.after_s += last.stamp - packet.stamp,
            last => {
                self.without += 1;
                self.gaps += usize::from(last.is_some());
            }
        }
        packet.stamp - *self.first.get_or_insert(packet.stamp)
    }

    /// The number of images.
    pub fn images(&self) -> usize {
        self.images
    }

    /// Images without a real sample at or after them.
    pub fn without(&self) -> usize {
        self.without
    }

    /// Mean seconds from an image to the sample at or after it.
    pub fn mean_after_s(&self) -> Option<f64> {
        (self.images > self.without).then(|| self.after_s / (self.images - self.without) as f64)
    }

    /// Statistics of all readings.
    pub fn readings(&self, sensor: &ImuSensor) -> Readings {
        Readings::of(&self.samples, sensor)
    }

    /// The doubts about them, one line each.
    pub fn doubts(&self, sensor: &ImuSensor) -> Vec<String> {
        let mut out = Vec::new();
        let (without, images) = (self.without, self.images);
        if images == 0 {
            return out;
        }
        if self.samples.is_empty() {
            out.push("the rig has an IMU, but no sample lies near the images: is it the same clock?".into());
        } else if 10 * without > images {
            out.push(format!(
                "{without} of {images} images have no IMU sample at or after them: the clocks are apart, or the IMU's stream is \
                 short or late"
            ));
        }
        if let Some(late) = self.mean_after_s().filter(|late| *late > MAX_AFTER_S) {
            out.push(format!(
                "the IMU sample next to an image lies {late:.3} s after it on average: the clocks are apart"
            ));
        }
        out.extend(self.readings(sensor).doubts(sensor).iter().map(ToString::to_string));
        out
    }
}

/// Doubts that are known before a source is read: an assumed calibration, and implausible values of its rig.
pub fn doubts_of(info: &SourceInfo, rig: &Rig) -> Vec<String> {
    let assumed = info.assumed.iter().map(|what| {
        format!("no calibration is given, so this is assumed: {what}; poses are only as accurate as that, give --rig FILE")
    });
    assumed.chain(rig.doubts()).collect()
}

/// Whether images have depth, and how far it goes.
#[derive(Clone, Debug, Default)]
struct DepthWatch {
    first: Option<Stamp>,
    images: usize,
    farthest: u16,
    nearest: Option<u16>,
    any: bool,
}

impl DepthWatch {
    /// Takes a packet; returns whether all is seen.
    fn packet(&mut self, packet: &FramePacket) -> bool {
        self.images += 1;
        if let Some(depth) = &packet.depth {
            self.any = true;
            for units in depth.data().iter().copied().filter(|units| !matches!(*units, 0 | u16::MAX)) {
                self.farthest = self.farthest.max(units);
                self.nearest = Some(self.nearest.map_or(units, |nearest| nearest.min(units)));
            }
        }
        packet.stamp - *self.first.get_or_insert(packet.stamp) >= DEPTH_CHECKED_S
    }

    fn doubt(&self, sensor: &DepthSensor) -> Option<String> {
        let [nearest_m, farthest_m] =
            [self.nearest.unwrap_or(0), self.farthest].map(|units| f64::from(units) * sensor.metres_per_unit);
        match self.any {
            _ if self.images == 0 => None,
            false => Some("the rig has a depth sensor, but no image has depth".into()),
            true if self.farthest > 0 && farthest_m < NEAREST_DEPTH_M => Some(format!(
                "the farthest depth is {} units of {} m, {farthest_m:.3} m: is it in metres?",
                self.farthest, sensor.metres_per_unit
            )),
            true if nearest_m > NEAREST_AT_MOST_M => Some(format!(
                "the nearest depth is {} units of {} m, {nearest_m:.0} m, farther than depth cameras measure: is the unit right?",
                self.nearest.unwrap_or(0),
                sensor.metres_per_unit
            )),
            true => None,
        }
    }
}

/// All that may be found in the packets of these sensors, in the order in which it is reported.
fn watches(rig: &Rig) -> Vec<Box<dyn Watch>> {
    fn boxed<'a>(watch: impl Watch + 'a) -> Box<dyn Watch + 'a> {
        Box::new(watch)
    }
    let mut all = vec![
        boxed(FixedWatch::new(rig.cameras.first().map_or("", |c| &c.name))),
        boxed(UnitWatch::default()),
        boxed(DelayWatch::default()),
    ];
    all.extend(RegistrationCheck::of(rig).map(boxed));
    all.extend(PairWatch::new(rig).map(boxed));
    all.extend(TurnWatch::new(rig).map(boxed));
    all
}

/// Checks packets as they come, wherever they come from; each doubt is returned once, as text with numbers.
pub struct PacketValidator {
    imu: Option<(ImuWatch, ImuSensor)>,
    depth: Option<(DepthWatch, DepthSensor)>,
    frozen: Vec<FrozenWatch>,
    watches: Vec<Box<dyn Watch>>,
    may_lack_imu: bool,
}

impl PacketValidator {
    /// For packets of these sensors.
    pub fn new(rig: &Rig) -> Self {
        Self {
            imu: rig.imu.clone().map(|sensor| (ImuWatch::default(), sensor)),
            depth: rig.depth.clone().map(|sensor| (DepthWatch::default(), sensor)),
            frozen: rig.cameras.iter().enumerate().map(|(k, c)| FrozenWatch::new(k, &c.name)).collect(),
            watches: watches(rig),
            may_lack_imu: false,
        }
    }

    /// Takes a packet. Depth is judged after a second, the IMU after ten, all else at any time.
    pub fn packet(&mut self, packet: &FramePacket) -> Vec<String> {
        let depth_is_seen = self.depth.as_mut().is_some_and(|(watch, _)| watch.packet(packet));
        let imu_is_seen = self.imu.as_mut().is_some_and(|(watch, _)| watch.packet(packet) >= CHECKED_S);
        let depth = if depth_is_seen { self.depth_doubt() } else { None };
        let mut doubts: Vec<String> = depth.into_iter().collect();
        doubts.extend(self.frozen.iter_mut().filter_map(|watch| watch.packet(packet)));
        doubts.extend(self.watches.iter_mut().filter_map(|watch| watch.packet(packet)));
        doubts.extend(if imu_is_seen { self.imu_doubts() } else { Vec::new() });
        doubts
    }

    /// No more packets come: what was not judged yet.
    pub fn end(&mut self) -> Vec<String> {
        self.depth_doubt().into_iter().chain(self.imu_doubts()).collect()
    }

    /// Whether all pictures of the last packet repeat those of the one before although the IMU turns.
    fn is_stale(&self) -> bool {
        !self.frozen.is_empty() && self.frozen.iter().all(|watch| watch.is_stale)
    }

    /// Whether a camera delivers its last picture again and again, rather than each a second time.
    fn is_frozen(&self) -> bool {
        self.frozen.iter().any(FrozenWatch::is_frozen)
    }

    fn depth_doubt(&mut self) -> Option<String> {
        self.depth.take().and_then(|(watch, sensor)| watch.doubt(&sensor))
    }

    fn imu_doubts(&mut self) -> Vec<String> {
        let Some((watch, sensor)) = self.imu.take() else { return Vec::new() };
        if self.may_lack_imu && watch.samples.is_empty() {
            return Vec::new();
        }
        // Nor is it doubtful that the sensor starts later than the camera.
        let watch = if self.may_lack_imu { ImuWatch { without: watch.gaps, ..watch } } else { watch };
        watch.doubts(&sensor)
    }
}

/// A source that reports doubts about its data, and leaves out packets whose pictures repeat those before while the IMU turns: they
/// would show vision a camera that rests.
pub struct Validator {
    source: Box<dyn Source>,
    packets: PacketValidator,
    report: Box<dyn FnMut(&str) + Send>,
    /// What was reported about packets and what was left out, for the report of a run.
    skips: Skips,
    /// Readings of packets that were left out, for the next.
    readings: Vec<ImuSample>,
}

impl Validator {
    /// Reports what is known before reading at once; doubts about depth after a second and about the IMU data after ten, or
    /// at the end.
    pub fn new(source: Box<dyn Source>, mut report: impl FnMut(&str) + Send + 'static) -> Self {
        doubts_of(source.info(), source.rig()).iter().for_each(|doubt| report(doubt));
        let packets = PacketValidator::new(source.rig());
        Self { source, packets, report: Box::new(report), skips: Skips::default(), readings: Vec::new() }
    }

    /// The rig's IMU was reckoned with rather than found, as with a browser's camera: none at all is not doubtful.
    pub fn may_lack_imu(mut self) -> Self {
        self.packets.may_lack_imu = true;
        self
    }
}

impl Source for Validator {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn rig(&self) -> &Rig {
        self.source.rig()
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        loop {
            let packet = self.source.next_packet()?;
            let doubts = match &packet {
                Some(packet) => self.packets.packet(packet),
                None => self.packets.end(),
            };
            for doubt in &doubts {
                (self.report)(doubt);
                self.skips.add_many(SkipKind::Other, doubt, 1, doubt);
            }
            let Some(mut packet) = packet else { return Ok(None) };
            if !self.packets.is_stale() {
                packet.imu.splice(0..0, self.readings.drain(..));
                return Ok(Some(packet));
            }
            self.readings.extend(packet.imu.into_iter().filter(|sample| !sample.is_synthesised()));
            self.readings.drain(..self.readings.len().saturating_sub(MOST_READINGS));
            let kind = if self.packets.is_frozen() { SkipKind::Frame } else { SkipKind::Repeat };
            let at = format!("at {:.3} s of the source's clock", packet.stamp.seconds());
            let why = "the picture repeats the one before bit by bit, while the IMU turns";
            self.skips.add(&Skipped::new(kind, why, at).at(packet.stamp));
        }
    }

    fn skipped(&self) -> &[String] {
        self.source.skipped()
    }

    fn live(&self) -> Option<Arc<dyn Live>> {
        self.source.live()
    }

    fn skips(&self) -> Skips {
        let mut all = self.source.skips();
        all.add_all(&self.skips);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_sim::{SimConfig, SimSource};
    use std::sync::{Arc, Mutex};

    /// The doubts about a walk of 12 s whose packets are changed.
    fn doubts_about(
        mut change: impl FnMut(&mut FramePacket) + Send + 'static,
        rig: impl Fn(&mut Rig),
    ) -> Vec<String> {
        struct Changed<F>(SimSource, Rig, F);
        impl<F: FnMut(&mut FramePacket) + Send> Source for Changed<F> {
            fn info(&self) -> &SourceInfo {
                self.0.info()
            }
            fn rig(&self) -> &Rig {
                &self.1
            }
            fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
                let mut packet = self.0.next_packet()?;
                packet.iter_mut().for_each(&mut self.2);
                Ok(packet)
            }
            fn skipped(&self) -> &[String] {
                &[]
            }
        }
        let text = "sim:corridor?sensor=mono-imu&resolution=32x24&detail=0.05&start=14&duration=12&rate=5";
        let source = SimSource::new(&SimConfig::parse(text).unwrap()).unwrap();
        let mut changed_rig = source.rig().clone();
        rig(&mut changed_rig);
        let reported = Arc::new(Mutex::new(Vec::new()));
        let receiver = reported.clone();
        let changed = Changed(source, changed_rig, move |p: &mut FramePacket| change(p));
        let mut validator =
            Validator::new(Box::new(changed), move |d| receiver.lock().unwrap().push(d.to_owned()));
        while validator.next_packet().unwrap().is_some() {}
        let reported = reported.lock().unwrap();
        reported.clone()
    }

    #[test]
    fn each_doubt_is_reported_once_and_a_good_source_has_none() {
        assert_eq!(doubts_about(|_| {}, |_| {}), [""; 0]);
        let degrees = doubts_about(|p| p.imu.iter_mut().for_each(|s| s.gyro *= 57.3), |_| {});
        assert!(matches!(&degrees[..], [one] if one.contains("is it in degrees?")), "{degrees:?}");
        let in_g = doubts_about(|p| p.imu.iter_mut().for_each(|s| s.accel /= 9.81), |_| {});
        assert!(matches!(&in_g[..], [one] if one.contains("is it in g?")), "{in_g:?}");
        let late =
            doubts_about(|p| p.imu.iter_mut().for_each(|s| s.stamp = s.stamp.plus_seconds(0.3)), |_| {});
        assert!(matches!(&late[..], [one] if one.contains("the clocks are apart")), "{late:?}");
        let none = doubts_about(|p| p.imu.clear(), |_| {});
        assert!(matches!(&none[..], [one] if one.contains("same clock")), "{none:?}");
        let slow = doubts_about(|_| {}, |rig| rig.imu.as_mut().unwrap().rate_hz = 50.0);
        assert!(
            matches!(&slow[..], [a, b] if a.contains("50 samples") && b.contains("rig says 50.0")),
            "{slow:?}"
        );
    }

    #[test]
    fn exchanged_sensors_and_depth_in_another_unit_or_missing_are_named() {
        let swap = |p: &mut FramePacket| {
            p.imu.iter_mut().for_each(|s| (s.gyro, s.accel) = (s.accel, s.gyro));
        };
        let exchanged = doubts_about(swap, |_| {});
        assert!(matches!(&exchanged[..], [one] if one.contains("are they exchanged?")), "{exchanged:?}");
        let camera = cairn_sensor::Camera::pinhole(4, 2, 4.0, 4.0, 1.5, 0.5);
        let body_from_depth = cairn_geometry::Se3::identity();
        let sensor = DepthSensor { camera, body_from_depth, metres_per_unit: 0.001, registered: true };
        let rig = Rig { depth: Some(sensor), ..Rig::mono(camera) };
        let of = |units: Option<u16>| {
            let mut checks = PacketValidator::new(&rig);
            let doubts: Vec<String> = (0..20)
                .flat_map(|k| {
                    let depth = units
                        .map(|v| Arc::new(cairn_sensor::DepthImage::from_vec(4, 2, vec![v; 8]).unwrap()));
                    let stamp = Stamp::from_seconds(0.1 * f64::from(k));
                    checks.packet(&FramePacket {
                        stamp,
                        images: Vec::new(),
                        depth,
                        imu: Vec::new(),
                        decode_ms: 0.0,
                    })
                })
                .collect();
            assert!(checks.end().is_empty(), "each once");
            doubts
        };
        assert_eq!(of(Some(1500)), [""; 0]);
        assert_eq!(of(Some(0)), [""; 0], "nothing was near enough");
        let metres = of(Some(4));
        assert!(matches!(&metres[..], [one] if one.contains("0.004 m: is it in metres?")), "{metres:?}");
        let none = of(None);
        assert!(matches!(&none[..], [one] if one.contains("no image has depth")), "{none:?}");
        let far = of(Some(31_000));
        assert!(
            matches!(&far[..], [one] if one.contains("31 m, farther than depth cameras measure")),
            "{far:?}"
        );
    }

    /// A sensor that starts after the camera is no doubt where it was only reckoned with; one that pauses is.
    #[test]
    fn late_start_of_a_reckoned_sensor_is_not_doubtful() {
        let counts = |present: fn(f64) -> bool| {
            let mut watch = ImuWatch::default();
            for k in 0..200 {
                let at = 0.05 * f64::from(k);
                let stamp = Stamp::from_seconds(at);
                let after = ImuSample::new(
                    stamp.plus_seconds(1e-3),
                    cairn_geometry::Vec3::zeros(),
                    cairn_geometry::Vec3::new(0.0, -9.8, 0.0),
                );
                let imu = if present(at) { vec![after] } else { Vec::new() };
                watch.packet(&FramePacket { stamp, images: Vec::new(), depth: None, imu, decode_ms: 0.0 });
            }
            (watch.without(), watch.gaps)
        };
        assert_eq!(counts(|t| t >= 3.0), (60, 0));
        assert_eq!(counts(|t| !(4.0..6.0).contains(&t)), (40, 40));
    }
}
