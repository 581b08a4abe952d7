//! What the node says of itself once a second.

use super::{Node, SLOW};
use crate::features;
use crate::messages::Header;
use crate::results;
use cairn::sensor::FramePacket;
use cairn::{Output, Stamp};

/// Seconds between pictures with features.
const FEATURES_S: f64 = 0.2;

/// Numbers for the diagnostics.
#[derive(Default)]
pub(super) struct Counts {
    pub(super) packets: usize,
    pub(super) tracked: usize,
    pub(super) dropped: usize,
    /// Milliseconds of the last second: from the stamp to the published result, and of the step alone.
    pub(super) ages_ms: Vec<f64>,
    pub(super) steps_ms: Vec<f64>,
    pub(super) metric: bool,
    pub(super) scale: f64,
}

impl Node<'_> {
    /// Publishes the picture with its features, a few times a second, while somebody looks at it.
    pub(super) fn show_features(&mut self, packet: &FramePacket, output: &Output, stamp: Stamp) {
        let is_due = self.shown.features.is_none_or(|at| packet.stamp - at >= FEATURES_S);
        let Some(picture) = packet.images.first().filter(|_| is_due && self.network.wants_features()) else {
            return;
        };
        self.shown.features = Some(packet.stamp);
        let header = Header::new(stamp, &self.found.frame);
        self.network.features.publish(features::message(header, picture, &output.frame));
    }

    pub(super) fn publish_diagnostics(&mut self) {
        let status = self.slam.status();
        let silent = self.last.is_none_or(|(_, at)| at.elapsed() > SLOW);
        let counts = std::mem::take(&mut self.counts);
        let mut message = match (silent, status.phase) {
            (true, _) => "no pictures".into(),
            (false, phase) => phase.name().to_lowercase().replace('_', " "),
        };
        for wait in &status.waits {
            message += &format!("; {wait}");
        }
        for words in self.placing.words() {
            message += &format!("; {words}");
        }
        if counts.tracked > 0 && !counts.metric {
            message += "; lengths are not metres (one camera without an IMU knows no scale)";
        }
        let good = !silent && status.valid && counts.metric && !self.placing.warns();
        let level = if status.error.is_some() { 2 } else { u8::from(!good) };
        let map = self.slam.map();
        let mut values: Vec<(String, String)> = vec![
            ("frames".into(), counts.packets.to_string()),
            ("frames with a pose".into(), counts.tracked.to_string()),
            ("frames overtaken".into(), counts.dropped.to_string()),
            ("metric".into(), counts.metric.to_string()),
            ("map units in one of the odometry".into(), format!("{:.4}", counts.scale)),
            ("odometry begun anew".into(), self.tree.restarts().to_string()),
            ("key frames".into(), map.snapshot().key_frame_count().to_string()),
            ("landmarks".into(), map.snapshot().landmark_count().to_string()),
        ];
        for (name, of) in [("step ms", &counts.steps_ms), ("age of results ms", &counts.ages_ms)] {
            if let Some([median, max]) = median_and_max(of) {
                values.push((format!("{name}, median"), format!("{median:.1}")));
                values.push((format!("{name}, max"), format!("{max:.1}")));
            }
        }
        if let Some(error) = &status.error {
            values.push(("error".into(), error.clone()));
        }
        for skip in self.faults.counts().iter() {
            values.push((skip.reason.clone(), skip.count.to_string()));
        }
        let of_last = || self.last.map_or(Stamp(0), |(at, _)| self.clock.of_messages(at));
        let stamp = self.time.now().unwrap_or_else(of_last);
        self.network.diagnostics.publish(results::diagnostics(
            stamp,
            &self.options.name,
            level,
            message,
            values,
        ));
        self.counts = Counts { ages_ms: Vec::new(), steps_ms: Vec::new(), ..counts };
    }
}

fn median_and_max(values: &[f64]) -> Option<[f64; 2]> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    Some([*sorted.get(sorted.len() / 2)?, *sorted.last()?])
}
