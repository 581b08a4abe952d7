//! Records the route: a point every 5 cm or 5 degrees while there is a pose; losses are marked; written to disk at
//! once.

use crate::anchor::Anchor;
use crate::ground::Ground;
use crate::notes::RouteNote;
use crate::route::{Confidence, Route, RouteHeader, RoutePoint, Stretch};
use crate::store::RouteWriter;
use cairn_geometry::{Camera, Odom, Pose, Se3, Sim3};
use cairn_sensor::Stamp;
use cairn_settings::Settings;
use std::io;

/// Config of the recorder.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct RecorderConfig {
    /// Metres between points.
    #[setting(default = 0.05, range = 0.01..=100.0)]
    pub step_m: f64,
    /// Degrees between points.
    #[setting(default = 5.0, range = 0.0..=180.0)]
    pub step_deg: f64,
    /// Seconds between syncs of the appended points to disk.
    #[setting(default = 1.0, range = 0.01..=100.0)]
    pub sync_s: f64,
}

/// One pose passed to the recorder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordInput {
    /// Time of the pose.
    pub stamp: Stamp,
    /// Pose of the camera in the odom frame.
    pub odom_from_camera: Pose<Odom, Camera>,
    /// The segment of odometry that the pose is in: the motion from a pose in another one is not known.
    pub segment: u32,
    /// The reference keyframe.
    pub anchor: Anchor,
    /// Pose of the camera in the reference keyframe.
    pub anchor_from_camera: Se3,
    /// Tracking confidence of the pose.
    pub confidence: Confidence,
    /// Tracking quality, 0 to 1.
    pub quality: f32,
}

/// What the walker should hear about the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RecorderEvent {
    /// Tracking weakened: the stretch is bridged and marked as such.
    Bridging,
    /// There is no pose: a gap begins.
    Lost,
    /// Tracking is good again: seconds without good tracking, and metres between the last good point and this one.
    Resumed {
        /// Seconds.
        seconds: f64,
        /// Metres, straight.
        metres: f64,
    },
}

/// The recorder.
pub struct Recorder {
    config: RecorderConfig,
    route: Route,
    writer: Option<RouteWriter>,
    last_sync: Option<Stamp>,
    confidence: Confidence,
    last_good: Option<(Stamp, Se3)>,
    segment: Option<u32>,
    gap: bool,
    refused: usize,
}

impl Recorder {
    /// Records into memory; `metric` says whether lengths are metres.
    pub fn new(config: RecorderConfig, metric: bool, ground: &Ground, source: impl Into<String>) -> Self {
        Self {
            config,
            route: Route::new(RouteHeader::new(metric, ground, source)),
            writer: None,
            last_sync: None,
            confidence: Confidence::Good,
            last_good: None,
            segment: None,
            gap: false,
            refused: 0,
        }
    }

    /// The same with another header: with a name, a date, an atlas.
    pub fn with_header(mut self, header: RouteHeader) -> Self {
        self.route.header = header;
        self
    }

    /// Continues an earlier recording after a gap: see [`RouteWriter::resume`].
    pub fn resume(config: RecorderConfig, route: Route) -> Self {
        let last = route.points.last().map(|p| (p.stamp, p.odom_from_camera));
        Self {
            config,
            gap: last.is_some(),
            route,
            writer: None,
            last_sync: None,
            confidence: Confidence::Lost,
            last_good: last,
            segment: None,
            refused: 0,
        }
    }

    /// A recording that was resumed goes on without a gap: its last point is of this segment of odometry, and what comes now
    /// follows it.
    pub fn goes_on_in(&mut self, segment: u32) {
        (self.segment, self.gap, self.confidence) = (Some(segment), false, Confidence::Good);
    }

    /// Records to disk as well: every point from now on is appended.
    pub fn with_writer(mut self, writer: RouteWriter) -> Self {
        self.writer = Some(writer);
        self
    }

    /// The route recorded so far.
    pub fn route(&self) -> &Route {
        &self.route
    }

    /// How many inputs were rejected: time not increasing, or values that are not finite.
    pub fn refused(&self) -> usize {
        self.refused
    }

    /// From now on lengths in the map are metres: the scale was initialised while the route was recorded. `carried`
    /// transforms the poses recorded so far into the frame and unit of those to come, whose ground plane is `ground`.
    ///
    /// # Errors
    /// The disk's error; the route in memory has the new scale all the same.
    pub fn found_scale(&mut self, carried: Sim3, ground: &Ground) -> io::Result<()> {
        let up = RouteHeader::new(true, ground, "").up;
        let header = RouteHeader { metric: true, up, carried: Some(carried), ..self.route.header.clone() };
        self.route.apply_header(header.clone());
        self.last_good = self.last_good.map(|(t, pose)| (t, carried.transform_pose(&pose)));
        self.writer.as_mut().map_or(Ok(()), |w| w.append_header(&header))
    }

    /// Adds a note, on disk at once; its poses are in the frame and unit of the points.
    ///
    /// # Errors
    /// The disk's error; the note is still kept in memory.
    pub fn note(&mut self, note: RouteNote) -> io::Result<()> {
        let written = self.writer.as_mut().map_or(Ok(()), |w| w.append_note(&note));
        self.route.notes.push(note);
        written
    }

    /// Ends the recording: syncs it to disk and returns the route.
    pub fn finish(mut self) -> (Route, io::Result<()>) {
        let synced = self.writer.as_mut().map_or(Ok(()), RouteWriter::make_durable);
        (self.route, synced)
    }

    /// Takes a pose.
    ///
    /// # Errors
    /// The disk's error; the point is still kept in memory.
    pub fn observe(&mut self, input: &RecordInput) -> io::Result<Option<RecorderEvent>> {
        let late = self.route.points.last().is_some_and(|p| p.stamp >= input.stamp);
        let finite = input.odom_from_camera.se3.is_finite() && input.anchor_from_camera.is_finite();
        if input.confidence != Confidence::Lost && (late || !finite) {
            self.refused += 1;
            return Ok(None);
        }
        let event = self.change(input);
        if input.confidence == Confidence::Lost {
            self.gap = !self.route.points.is_empty();
        } else {
            let before = self.segment.replace(input.segment);
            self.gap |= before.is_some_and(|before| before != input.segment) && !self.route.points.is_empty();
            if input.confidence == Confidence::Good {
                self.last_good = Some((input.stamp, input.odom_from_camera.se3));
            }
            if self.wanted(input) {
                self.add(input)?;
            }
        }
        self.sync(input.stamp)?;
        Ok(event)
    }

    fn change(&mut self, input: &RecordInput) -> Option<RecorderEvent> {
        let before = std::mem::replace(&mut self.confidence, input.confidence);
        match (before, input.confidence) {
            (Confidence::Good, Confidence::Low) => Some(RecorderEvent::Bridging),
            (Confidence::Good | Confidence::Low, Confidence::Lost) => Some(RecorderEvent::Lost),
            (Confidence::Low | Confidence::Lost, Confidence::Good) => {
                self.last_good.map(|(stamp, pose)| RecorderEvent::Resumed {
                    seconds: input.stamp - stamp,
                    metres: (input.odom_from_camera.se3.translation - pose.translation).norm(),
                })
            }
            _ => None,
        }
    }

    fn wanted(&self, input: &RecordInput) -> bool {
        let Some(last) = self.route.points.last() else { return input.confidence == Confidence::Good };
        let moved = last.odom_from_camera.inverse() * input.odom_from_camera.se3;
        self.gap
            || moved.translation.norm() >= self.config.step_m
            || moved.rotation.angle().to_degrees() >= self.config.step_deg
    }

    fn add(&mut self, input: &RecordInput) -> io::Result<()> {
        let stretch = match (std::mem::take(&mut self.gap), input.confidence) {
            (true, _) => Stretch::Gap,
            (false, Confidence::Good) => Stretch::Tracked,
            (false, _) => Stretch::Bridged,
        };
        let point = RoutePoint {
            stamp: input.stamp,
            anchor: input.anchor,
            anchor_from_camera: input.anchor_from_camera,
            odom_from_camera: input.odom_from_camera.se3,
            stretch,
            quality: input.quality,
        };
        self.route.points.push(point);
        self.writer.as_mut().map_or(Ok(()), |w| w.append(&point))
    }

    fn sync(&mut self, now: Stamp) -> io::Result<()> {
        let due = self.last_sync.is_none_or(|t| now - t >= self.config.sync_s);
        match &mut self.writer {
            Some(writer) if due => {
                self.last_sync = Some(now);
                writer.make_durable()
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So3, Vec3};
    use std::sync::{Arc, Mutex};

    fn input(t: f64, x: f64, yaw: f64, confidence: Confidence) -> RecordInput {
        let pose = Se3::new(So3::exp(&Vec3::new(0.0, 0.0, yaw)), Vec3::new(x, 0.0, 0.0));
        RecordInput {
            stamp: Stamp::from_seconds(t),
            odom_from_camera: Pose::new(pose),
            segment: 0,
            anchor: Anchor { robot: 0, seq: 0 },
            anchor_from_camera: pose,
            confidence,
            quality: 1.0,
        }
    }

    fn recorder() -> Recorder {
        Recorder::new(RecorderConfig::default(), true, &Ground::z_up(), "test")
    }

    #[test]
    fn records_a_point_every_5_cm_or_5_degrees() {
        let mut r = recorder();
        for k in 0..=100 {
            r.observe(&input(k as f64 * 0.1, k as f64 * 0.0101, 0.0, Confidence::Good)).unwrap();
        }
        assert_eq!(r.route().points.len(), 1 + 100 / 5);
        for k in 1..=30 {
            let yaw = (k as f64 * 1.01).to_radians();
            r.observe(&input(20.0 + k as f64 * 0.1, 1.01, yaw, Confidence::Good)).unwrap();
        }
        assert_eq!(r.route().points.len(), 21 + 30 / 5);
    }

    #[test]
    fn tracking_losses_are_marked_and_reported() {
        let mut r = recorder();
        let mut events = Vec::new();
        let mut t = 0.0;
        for (confidence, from, to) in [
            (Confidence::Good, 0.0, 1.0),
            (Confidence::Low, 1.0, 1.5),
            (Confidence::Good, 1.5, 2.0),
            (Confidence::Lost, 2.0, 2.0),
            (Confidence::Good, 3.0, 3.5),
        ] {
            for k in 0..10 {
                t += 0.1;
                let x = from + (to - from) * k as f64 / 10.0;
                events.extend(r.observe(&input(t, x, 0.0, confidence)).unwrap());
            }
        }
        assert_eq!(events[0], RecorderEvent::Bridging);
        assert!(matches!(events[1], RecorderEvent::Resumed { .. }));
        assert_eq!(events[2], RecorderEvent::Lost);
        let RecorderEvent::Resumed { seconds, metres } = events[3] else { panic!("{events:?}") };
        assert!((seconds - 1.1).abs() < 1e-6 && (metres - 1.05).abs() < 1e-6, "{seconds} {metres}");
        let stretches: Vec<Stretch> = r.route().points.iter().map(|p| p.stretch).collect();
        assert_eq!(stretches.iter().filter(|s| **s == Stretch::Gap).count(), 1);
        assert!(stretches.iter().filter(|s| **s == Stretch::Bridged).count() >= 5);
    }

    #[test]
    fn a_new_segment_of_odometry_is_a_gap() {
        let mut r = recorder();
        (0..10).for_each(|k| drop(r.observe(&input(0.1 * k as f64, 0.1 * k as f64, 0.0, Confidence::Good))));
        let after = RecordInput { segment: 1, ..input(1.0, 0.9, 0.0, Confidence::Good) };
        r.observe(&after).unwrap();
        let stretches: Vec<Stretch> = r.route().points.iter().map(|p| p.stretch).collect();
        assert_eq!((stretches.len(), stretches[10]), (11, Stretch::Gap), "{stretches:?}");
        assert_eq!(stretches.iter().filter(|s| **s == Stretch::Gap).count(), 1);
    }

    #[test]
    fn resumed_recording_starts_with_a_gap() {
        let mut r = recorder();
        (0..10).for_each(|k| drop(r.observe(&input(k as f64, k as f64, 0.0, Confidence::Good))));
        let (route, _) = r.finish();
        let mut r = Recorder::resume(RecorderConfig::default(), route);
        assert_eq!(
            r.observe(&input(3.0, 3.0, 0.0, Confidence::Good)).unwrap(),
            None,
            "it is older than the record"
        );
        let event = r.observe(&input(100.0, 9.5, 0.0, Confidence::Good)).unwrap();
        assert_eq!(event, Some(RecorderEvent::Resumed { seconds: 91.0, metres: 0.5 }));
        r.observe(&input(101.0, 10.0, 0.0, Confidence::Good)).unwrap();
        let stretches: Vec<Stretch> = r.route().points[9..].iter().map(|p| p.stretch).collect();
        assert_eq!(stretches, [Stretch::Tracked, Stretch::Gap, Stretch::Tracked]);
    }

    #[test]
    fn late_scale_transforms_points_in_memory_and_on_disk() {
        let path = std::env::temp_dir().join(format!("cairn-route-scale-{}.route", std::process::id()));
        let _ = std::fs::remove_file(&path);
        let header = RouteHeader::new(false, &Ground::first_camera(), "test");
        let mut r = Recorder::new(RecorderConfig::default(), false, &Ground::first_camera(), "test")
            .with_writer(RouteWriter::create(&path, &header).unwrap());
        (0..10).for_each(|k| drop(r.observe(&input(k as f64, k as f64, 0.0, Confidence::Good))));
        // A unit is 2.5 m long, and the map was rotated.
        let turn = So3::exp(&Vec3::new(0.0, 0.0, 1.0));
        let carried = Sim3::new(turn, Vec3::new(3.0, 0.0, -1.0), 2.5);
        r.found_scale(carried, &Ground::z_up()).unwrap();
        let next = input(10.0, 10.0, 0.0, Confidence::Good);
        let pose = carried.transform_pose(&next.odom_from_camera.se3);
        r.observe(&RecordInput { odom_from_camera: Pose::new(pose), ..next }).unwrap();
        let (route, synced) = r.finish();
        synced.unwrap();
        let at = |i: usize| route.points[i].odom_from_camera.translation;
        (0..10).for_each(|i| assert!(((at(i + 1) - at(i)).norm() - 2.5).abs() < 1e-9, "step {i}"));
        assert!(route.header.metric && route.header.up == [0.0, 0.0, 1.0]);
        let read = Route::load(&path).unwrap();
        assert!(read.header.metric && read.points.len() == route.points.len());
        for (a, b) in read.points.iter().zip(&route.points) {
            let apart = a.odom_from_camera.inverse() * b.odom_from_camera;
            assert!(apart.translation.norm() < 1e-9 && apart.rotation.angle() < 1e-9);
        }
        let (resumed, _) = RouteWriter::resume(&path).unwrap();
        assert_eq!(resumed, read);
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn rejects_invalid_inputs() {
        let mut r = recorder();
        r.observe(&input(1.0, 0.0, 0.0, Confidence::Good)).unwrap();
        r.observe(&input(0.5, 1.0, 0.0, Confidence::Good)).unwrap();
        r.observe(&input(2.0, f64::NAN, 0.0, Confidence::Good)).unwrap();
        assert_eq!((r.route().points.len(), r.refused()), (1, 2));
    }

    #[derive(Clone, Default)]
    struct Shared(Arc<Mutex<(Vec<u8>, usize)>>);

    impl io::Write for Shared {
        fn write(&mut self, data: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().0.extend_from_slice(data);
            Ok(data.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl crate::store::Durable for Shared {
        fn make_durable(&mut self) -> io::Result<()> {
            let mut inner = self.0.lock().unwrap();
            inner.1 = inner.0.len();
            Ok(())
        }
    }

    #[test]
    fn crash_loses_at_most_one_second() {
        let disk = Shared::default();
        let header = RouteHeader::new(true, &Ground::z_up(), "test");
        let mut r = recorder().with_writer(RouteWriter::new(Box::new(disk.clone()), &header).unwrap());
        for k in 0..200 {
            let t = k as f64 * 0.05;
            r.observe(&input(t, t, 0.0, Confidence::Good)).unwrap();
            // The bytes that are certainly on disk, read as after a crash at this moment.
            let inner = disk.0.lock().unwrap();
            let route = Route::read(&inner.0[..inner.1]).unwrap();
            let kept = route.points.last().map_or(0.0, |p| p.stamp.seconds());
            assert!(t - kept <= 1.06, "at {t} s only {kept} s were safe");
        }
        let (route, synced) = r.finish();
        synced.unwrap();
        let inner = disk.0.lock().unwrap();
        assert_eq!(Route::read(&inner.0[..inner.1]).unwrap().points.len(), route.points.len());
    }
}
