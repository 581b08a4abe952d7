//! What is plugged in, for people: each camera with its nodes and formats, and what was tried where there is none.

use super::device::{Kernel, MotionKind, PixelFormat, Usb};
use super::linux::Linux;
use super::select::realsenses;
use serde::Serialize;
use std::collections::BTreeMap;

/// A node of a camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraReport {
    /// Its address for `cairn run`.
    pub address: String,
    /// The name that the device gives itself.
    pub name: String,
    /// Its serial number, if it has one.
    pub serial: Option<String>,
    /// Formats with sizes and the fastest rate, such as `YUYV 640x480 (30 Hz)`.
    pub formats: Vec<String>,
    /// Why it cannot be used, with what to do.
    pub problem: Option<String>,
}

/// All cameras of a machine.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CamerasReport {
    /// Each node that gives pictures, or could not be asked.
    pub cameras: Vec<CameraReport>,
    /// Gyroscopes and accelerometers.
    pub motion: Vec<String>,
    /// What was tried, where something was not found.
    pub tried: Vec<String>,
}

/// Asks the kernel of this machine.
pub fn inspect() -> CamerasReport {
    let linux = Linux::new();
    let mut report = of(&linux);
    for (port, name) in linux.realsense_on_usb() {
        if !report.cameras.iter().any(|c| c.name.contains("RealSense")) {
            report.tried.push(format!("{name} is plugged in at USB port {port}, but the kernel has no video device of it: load its driver (sudo modprobe uvcvideo)"));
        }
    }
    report
}

/// The same of any kernel.
pub(super) fn of(kernel: &dyn Kernel) -> CamerasReport {
    let mut report = CamerasReport::default();
    match kernel.videos() {
        Ok(videos) => {
            for video in &videos {
                let asked = kernel.video(&video.node).and_then(|mut node| node.modes());
                let (formats, problem) = match asked {
                    Ok(modes) => (listed(&modes), None),
                    Err(e) if e.trouble == super::Trouble::Unsuitable => continue,
                    Err(e) => (Vec::new(), Some(format!("{e}; {}", e.cure()))),
                };
                let serial = video.usb.as_ref().map(|u| u.serial.clone()).filter(|s| !s.is_empty());
                let address = format!("v4l2:{}", video.node.display());
                report.cameras.push(CameraReport {
                    address,
                    name: video.name.clone(),
                    serial,
                    formats,
                    problem,
                });
            }
            let whole = realsenses(videos.clone()).into_iter().map(|(usb, nodes)| CameraReport {
                address: format!("realsense:{}", usb.serial),
                name: nodes.first().map_or(String::new(), |n| n.name.clone()),
                serial: Some(usb.serial).filter(|s| !s.is_empty()),
                formats: vec![format!("depth, infrared and colour together; USB port {}", usb.port)],
                problem: None,
            });
            report.cameras.splice(0..0, whole);
            if report.cameras.is_empty() {
                report
                    .tried
                    .push(format!("none of {} video devices of the kernel gives pictures", videos.len()));
            }
        }
        Err(e) => report.tried.push(e.to_string()),
    }
    match kernel.motions() {
        Ok(found) => report.motion.extend(found.iter().map(|m| {
            let kind = if m.kind == MotionKind::Gyro { "gyroscope" } else { "accelerometer" };
            let at = m.usb.as_ref().map_or(String::new(), |Usb { port, .. }| format!(" at USB port {port}"));
            format!("{} ({kind}{at})", m.node.display())
        })),
        Err(e) => report.tried.push(e.to_string()),
    }
    report
}

/// One line a format, with all its sizes.
fn listed(modes: &[super::Mode]) -> Vec<String> {
    let mut sizes: BTreeMap<PixelFormat, BTreeMap<[usize; 2], f64>> = BTreeMap::new();
    for m in modes {
        let fastest = sizes.entry(m.format).or_default().entry([m.width, m.height]).or_insert(m.rate_hz);
        *fastest = fastest.max(m.rate_hz);
    }
    let line = |sizes: &BTreeMap<[usize; 2], f64>| {
        let each: Vec<String> =
            sizes.iter().map(|([w, h], rate)| format!("{w}x{h} ({rate:.0} Hz)")).collect();
        each.join(", ")
    };
    sizes.iter().map(|(format, sizes)| format!("{format} {}", line(sizes))).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Mode, Simulated, SimulatedVideo, Trouble, VideoFound};
    use super::*;
    use std::sync::Arc;

    #[test]
    fn cameras_are_listed_or_it_is_told_why_not() {
        let machine = Simulated::new();
        let node = std::path::PathBuf::from("/dev/video0");
        let mode =
            |w, h, rate_hz| Mode { format: PixelFormat::YUYV, width: w, height: h, stride: 0, rate_hz };
        machine.add_video(SimulatedVideo {
            found: VideoFound { node: node.clone(), name: "Webcam".into(), usb: None },
            modes: vec![mode(640, 480, 15.0), mode(640, 480, 30.0), mode(1280, 720, 10.0)],
            frames: Arc::new(|_, _| None),
            phase_s: 0.0,
        });
        let found = of(&machine);
        assert_eq!(found.cameras[0].formats, ["YUYV 640x480 (30 Hz), 1280x720 (10 Hz)"]);
        assert_eq!(found.cameras[0].address, "v4l2:/dev/video0");
        machine.refuse(&node, Some(Trouble::Denied));
        let problem = of(&machine).cameras[0].problem.clone().unwrap();
        assert!(problem.contains("usermod -aG video"), "{problem}");
        machine.add_video(SimulatedVideo {
            found: VideoFound {
                node: "/dev/video4".into(),
                name: "Intel RealSense".into(),
                usb: Some(Simulated::d435i("2-1", "841612")),
            },
            modes: vec![mode(640, 480, 30.0)],
            frames: Arc::new(|_, _| None),
            phase_s: 0.0,
        });
        let addresses: Vec<String> = of(&machine).cameras.into_iter().map(|c| c.address).collect();
        assert_eq!(addresses, ["realsense:841612", "v4l2:/dev/video0", "v4l2:/dev/video4"]);
        machine.unplug(true);
        assert!(of(&machine).tried[0].contains("none of 0 video devices"));
    }
}
