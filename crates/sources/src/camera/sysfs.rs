//! What the kernel lists in sysfs: video nodes, motion sensors, and the USB device that each belongs to.

use super::device::{DeviceError, MotionFound, MotionKind, Trouble, Usb, VideoFound};
use std::path::{Path, PathBuf};

/// A tree of sysfs, `/sys` on a real machine.
#[derive(Clone, Debug)]
pub struct Sysfs(pub PathBuf);

impl Sysfs {
    /// All video nodes, in the order of their numbers.
    ///
    /// # Errors
    /// Where the kernel has no video devices at all.
    pub fn videos(&self) -> Result<Vec<VideoFound>, DeviceError> {
        let folder = self.0.join("class/video4linux");
        let entries = entries(&folder).ok_or_else(|| {
            let why =
                "the kernel lists no video device: none is plugged in, or its driver (uvcvideo) is missing";
            DeviceError::new(Trouble::Missing, folder.display().to_string(), why)
        })?;
        let found = entries.into_iter().filter(|(name, _)| name.starts_with("video")).map(|(name, path)| {
            VideoFound {
                node: PathBuf::from("/dev").join(&name),
                name: text(&path.join("name")).unwrap_or_else(|| name.clone()),
                usb: usb_of(&path.join("device")),
            }
        });
        Ok(found.collect())
    }

    /// All gyroscopes and accelerometers, with their folders.
    ///
    /// # Errors
    /// Where the kernel has no Industrial I/O.
    pub fn motions(&self) -> Result<Vec<(MotionFound, PathBuf)>, DeviceError> {
        let folder = self.0.join("bus/iio/devices");
        let entries = entries(&folder).ok_or_else(|| {
            let why = "the kernel lists no motion sensor: drivers hid-sensor-gyro-3d and hid-sensor-accel-3d are missing, \
                       or none is plugged in";
            DeviceError::new(Trouble::Missing, folder.display().to_string(), why)
        })?;
        let found = entries.into_iter().filter(|(name, _)| name.starts_with("iio:device")).filter_map(
            |(name, path)| {
                let has = |element: &str| path.join(format!("scan_elements/{element}_x_en")).exists();
                let kind = match (has("in_anglvel"), has("in_accel")) {
                    (true, _) => MotionKind::Gyro,
                    (_, true) => MotionKind::Accel,
                    _ => return None,
                };
                let node = PathBuf::from("/dev").join(&name);
                Some((MotionFound { node, kind, usb: usb_of(&path) }, path))
            },
        );
        Ok(found.collect())
    }

    /// USB devices of a vendor, whatever driver they have: product and name.
    pub fn usb_of_vendor(&self, vendor: u16) -> Vec<(Usb, String)> {
        let all = entries(&self.0.join("bus/usb/devices")).unwrap_or_default();
        all.into_iter()
            .filter_map(|(_, path)| Some((usb_at(&path)?, text(&path.join("product")).unwrap_or_default())))
            .filter(|(usb, _)| usb.vendor == vendor)
            .collect()
    }
}

/// Names and resolved folders, numbers in their order (`video10` after `video9`).
fn entries(folder: &Path) -> Option<Vec<(String, PathBuf)>> {
    let mut all: Vec<(String, PathBuf)> = std::fs::read_dir(folder)
        .ok()?
        .filter_map(|e| {
            let e = e.ok()?;
            Some((e.file_name().into_string().ok()?, e.path().canonicalize().ok()?))
        })
        .collect();
    all.sort_by_key(|(name, _)| (name.len(), name.clone()));
    Some(all)
}

/// The USB device that a folder of sysfs is in: the nearest one above with a number of a vendor.
fn usb_of(folder: &Path) -> Option<Usb> {
    folder.canonicalize().ok()?.ancestors().find_map(usb_at)
}

fn usb_at(folder: &Path) -> Option<Usb> {
    let number = |name: &str| u16::from_str_radix(&text(&folder.join(name))?, 16).ok();
    Some(Usb {
        vendor: number("idVendor")?,
        product: number("idProduct")?,
        port: folder.file_name()?.to_str()?.to_owned(),
        serial: text(&folder.join("serial")).unwrap_or_default(),
    })
}

fn text(path: &Path) -> Option<String> {
    Some(std::fs::read_to_string(path).ok()?.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    /// The tree of a D435i as Linux lays it out: nodes are links into the folder of the USB device.
    #[test]
    fn nodes_of_a_device_are_found_with_their_port() {
        let root = std::env::temp_dir().join(format!("cairn-sysfs-{}", std::process::id()));
        let usb = root.join("devices/pci0000:00/0000:00:14.0/usb2/2-1");
        let put = |path: PathBuf, text: &str| {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        put(usb.join("idVendor"), "8086\n");
        put(usb.join("idProduct"), "0b3a\n");
        put(usb.join("serial"), "841612070000\n");
        put(usb.join("product"), "Intel(R) RealSense(TM) Depth Camera 435i\n");
        let class = root.join("class/video4linux");
        let iio = root.join("bus/iio/devices");
        for folder in [&class, &iio, &root.join("bus/usb/devices")] {
            std::fs::create_dir_all(folder).unwrap();
        }
        for (n, interface) in [(10, "2-1:1.3"), (9, "2-1:1.0")] {
            let node = usb.join(format!("{interface}/video4linux/video{n}"));
            put(node.join("name"), "Intel(R) RealSense(TM) Depth Ca\n");
            symlink(usb.join(interface), node.join("device")).unwrap();
            symlink(&node, class.join(format!("video{n}"))).unwrap();
        }
        for (n, element) in [(0, "in_accel"), (1, "in_anglvel"), (2, "in_illuminance")] {
            let node = usb.join(format!("2-1:1.5/0003:8086:0B3A.0004/HID-SENSOR-200073.auto/iio:device{n}"));
            put(node.join(format!("scan_elements/{element}_x_en")), "0");
            symlink(&node, iio.join(format!("iio:device{n}"))).unwrap();
        }
        symlink(&usb, root.join("bus/usb/devices/2-1")).unwrap();
        let sysfs = Sysfs(root.clone());
        let videos = sysfs.videos().unwrap();
        let nodes: Vec<_> = videos.iter().map(|v| v.node.to_str().unwrap()).collect();
        assert_eq!(nodes, ["/dev/video9", "/dev/video10"]);
        let expected =
            Usb { port: "2-1".into(), vendor: 0x8086, product: 0x0b3a, serial: "841612070000".into() };
        assert!(videos.iter().all(|v| v.usb.as_ref() == Some(&expected)), "{videos:?}");
        let motions = sysfs.motions().unwrap();
        let kinds: Vec<_> = motions.iter().map(|(m, _)| (m.kind, m.usb.clone().unwrap().port)).collect();
        assert_eq!(kinds, [(MotionKind::Accel, "2-1".into()), (MotionKind::Gyro, "2-1".into())]);
        let found = sysfs.usb_of_vendor(0x8086);
        assert!(found.len() == 1 && found[0].1.contains("435i"), "{found:?}");
        std::fs::remove_dir_all(&root).unwrap();
        assert!(sysfs.videos().unwrap_err().why.contains("uvcvideo"));
        assert!(sysfs.motions().unwrap_err().why.contains("hid-sensor"));
    }
}
