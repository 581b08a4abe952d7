//! The devices of this machine.

use super::device::{DeviceError, Kernel, MotionFound, MotionNode, Trouble, VideoFound, VideoNode};
use super::iio::IioNode;
use super::sysfs::Sysfs;
use super::v4l2::V4l2Node;
use cairn_sensor::Stamp;
use rustix::time::{ClockId, clock_gettime};
use std::path::Path;

/// The kernel of this machine.
#[derive(Clone, Debug)]
pub struct Linux {
    sysfs: Sysfs,
}

impl Linux {
    /// With its devices as they are listed in `/sys`.
    pub fn new() -> Self {
        Self { sysfs: Sysfs("/sys".into()) }
    }

    /// USB devices of Intel that are RealSense cameras by their name: port and name.
    pub(super) fn realsense_on_usb(&self) -> Vec<(String, String)> {
        let all = self.sysfs.usb_of_vendor(super::select::INTEL);
        all.into_iter()
            .filter(|(_, name)| name.contains("RealSense"))
            .map(|(usb, name)| (usb.port, name))
            .collect()
    }
}

impl Default for Linux {
    fn default() -> Self {
        Self::new()
    }
}

impl Kernel for Linux {
    fn videos(&self) -> Result<Vec<VideoFound>, DeviceError> {
        self.sysfs.videos()
    }

    fn motions(&self) -> Result<Vec<MotionFound>, DeviceError> {
        Ok(self.sysfs.motions()?.into_iter().map(|(found, _)| found).collect())
    }

    fn video(&self, node: &Path) -> Result<Box<dyn VideoNode>, DeviceError> {
        Ok(Box::new(V4l2Node::open(node, self.sysfs.extension_units(node))?))
    }

    fn motion(&self, node: &Path) -> Result<Box<dyn MotionNode>, DeviceError> {
        let found = self.sysfs.motions()?.into_iter().find(|(found, _)| found.node == node);
        let (found, folder) = found
            .ok_or_else(|| DeviceError::new(Trouble::Missing, node.display().to_string(), "is not there"))?;
        Ok(Box::new(IioNode::open(node, &folder, found.kind)?))
    }

    fn now(&self) -> Stamp {
        let now = clock_gettime(ClockId::Monotonic);
        Stamp(now.tv_sec.saturating_mul(1_000_000_000).saturating_add(now.tv_nsec))
    }
}
