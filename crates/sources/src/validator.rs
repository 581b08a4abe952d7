//! Plausibility checks of a source while it is read: an assumed calibration, implausible IMU data, clocks
//! that are not synchronised. Each doubt is reported once, as text with numbers.

use cairn_inertial::Readings;
use cairn_sensor::{
    FramePacket, ImuSample, ImuSensor, Live, Rig, Skips, Source, SourceError, SourceInfo, Stamp,
};
use std::sync::Arc;

/// Longest plausible time in seconds from an image to the IMU sample after it.
const MAX_AFTER_S: f64 = 0.05;
/// Seconds of readings checked at the start.
const CHECKED_S: f64 = 10.0;

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

/// A source that reports doubts about its data.
pub struct Validator {
    source: Box<dyn Source>,
    watch: Option<ImuWatch>,
    may_lack_imu: bool,
    report: Box<dyn FnMut(&str) + Send>,
}

impl Validator {
    /// Reports what is known before reading at once; doubts about the IMU data after ten seconds, or at the
    /// end.
    pub fn new(source: Box<dyn Source>, mut report: impl FnMut(&str) + Send + 'static) -> Self {
        doubts_of(source.info(), source.rig()).iter().for_each(|doubt| report(doubt));
        let watch = source.rig().imu.is_some().then(ImuWatch::default);
        Self { source, watch, may_lack_imu: false, report: Box::new(report) }
    }

    /// The rig's IMU was reckoned with rather than found, as with a browser's camera: none at all is not doubtful.
    pub fn may_lack_imu(self) -> Self {
        Self { may_lack_imu: true, ..self }
    }

    fn report_imu_doubts(&mut self) {
        if let (Some(watch), Some(sensor)) = (self.watch.take(), &self.source.rig().imu) {
            if self.may_lack_imu && watch.samples.is_empty() {
                return;
            }
            // Nor is it doubtful that the sensor starts later than the camera.
            let watch = if self.may_lack_imu { ImuWatch { without: watch.gaps, ..watch } } else { watch };
            watch.doubts(sensor).iter().for_each(|doubt| (self.report)(doubt));
        }
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
        let packet = self.source.next_packet()?;
        let checked = match (&packet, &mut self.watch) {
            (Some(packet), Some(watch)) => watch.packet(packet) >= CHECKED_S,
            (None, _) => true,
            (Some(_), None) => false,
        };
        if checked {
            self.report_imu_doubts();
        }
        Ok(packet)
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
