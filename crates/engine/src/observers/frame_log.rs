//! Keeps the result of every frame.

use super::observer::{DoneFrame, Observer};
use crate::log::{Log, Logged};
use crate::output::Output;

impl Observer for Log {
    fn done(&mut self, frame: &mut DoneFrame, output: &mut Output) {
        for (stamp, anchored) in frame.earlier.iter().chain(&frame.first_of_pair) {
            self.amend(*stamp, *anchored);
        }
        self.push(Logged {
            stamp: output.stamp,
            state: output.state,
            anchored: output.pose.map(|pose| pose.anchored),
            odometry: output.pose.map(|pose| pose.odometry),
            metric: output.is_metric(),
            scale_supported: frame.scale_supported,
        });
    }
}
