//! What the kernel lists in sysfs: video nodes, motion sensors, and the USB device that each belongs to.

use super::device::{DeviceError, MotionFound, MotionKind, Trouble, Usb, VideoFound};
use std::path::{Path, PathBuf};

/// An extension unit of a camera (USB Device Class Definition for Video Devices 1.5, 3.7.2.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExtensionUnit {
    /// The id of its kind, as it stands in the descriptor.
    pub guid: [u8; 16],
    /// Its number in the device.
    pub id: u8,
}

/// Those of one interface in a device's descriptors, as far as these can be read.
fn extension_units(mut descriptors: &[u8], interface: u8) -> Vec<ExtensionUnit> {
    let mut units = Vec::new();
    let mut inside = false;
    while let Some((one, rest)) = descriptors.first().and_then(|n| descriptors.split_at_checked((*n).into()))
    {
        match one {
            // An interface: here the one that controls video (class 14, subclass 1), whose number is asked for.
            [_, 0x04, number, _, _, class, subclass, ..] => {
                inside = *number == interface && (*class, *subclass) == (0x0e, 0x01);
            }
            // Of this class, an extension unit: number, then kind.
            [_, 0x24, 0x06, id, guid @ ..] if inside => {
                units.extend(guid.first_chunk().map(|guid| ExtensionUnit { guid: *guid, id: *id }));
            }
            // No descriptor is shorter than its length and its type.
            [] | [_] => break,
            _ => {}
        }
        descriptors = rest;
    }
    units
}

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

    /// The extension units of the camera of a video node, from its descriptors; none for other devices.
    pub fn extension_units(&self, node: &Path) -> Vec<ExtensionUnit> {
        let of = || {
            let name = node.file_name()?;
            let interface = self.0.join("class/video4linux").join(name).join("device").canonicalize().ok()?;
            let number = u8::from_str_radix(&text(&interface.join("bInterfaceNumber"))?, 16).ok()?;
            let device = interface.ancestors().find(|folder| usb_at(folder).is_some())?;
            Some(extension_units(&std::fs::read(device.join("descriptors")).ok()?, number))
        };
        of().unwrap_or_default()
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
        // The camera for depth has a unit of an id of its own; so has the one for colour, with the same number.
        put(usb.join("2-1:1.0/bInterfaceNumber"), "00\n");
        put(usb.join("2-1:1.3/bInterfaceNumber"), "03\n");
        let unit = |guid: u8| [&[25, 0x24, 0x06, 3], &[guid; 16][..], &[1, 1, 1, 0, 0]].concat();
        let interface = |number, class, subclass| [9, 0x04, number, 0, 1, class, subclass, 0, 0];
        let control =
            |number, guid| [&interface(number, 0x0e, 0x01)[..], &[5, 0x25, 1, 2, 3], &unit(guid)].concat();
        // What has the type of a unit in an interface that streams is a format, and here one that looks like a unit.
        let streams = [&interface(1, 0x0e, 0x02)[..], &unit(0xff)].concat();
        let all = [&[18, 1, 0, 2][..], &[0; 14], &control(0, 0xd0), &streams, &control(3, 0xc0)].concat();
        std::fs::write(usb.join("descriptors"), &all).unwrap();
        let sysfs = Sysfs(root.clone());
        let units = |n: usize| sysfs.extension_units(Path::new(&format!("/dev/video{n}")));
        assert_eq!(units(9), [ExtensionUnit { guid: [0xd0; 16], id: 3 }]);
        assert_eq!(units(10), [ExtensionUnit { guid: [0xc0; 16], id: 3 }]);
        assert_eq!(units(11), []);
        for end in 0..all.len() {
            // Cut off anywhere, and with a length that leads nowhere: what is whole is found.
            let found = extension_units(&all[..end], 0).len();
            assert_eq!(found, usize::from(end >= 18 + 9 + 5 + 25), "{end}");
            let broken: Vec<u8> = [&all[..end], &[0, 0x24, 0x06][..], &all[end..]].concat();
            assert!(extension_units(&broken, 0).len() <= 1);
        }
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
