//! A gyroscope or accelerometer of the kernel (Industrial I/O): its buffer as readings in SI units.
//!
//! After the kernel's ABI documents sysfs-bus-iio and "Industrial I/O core, buffers": `scan_elements/in_*_en` chooses what a
//! record has, `in_*_type` (`le:s32/32>>0`) its layout, `in_*_index` its order; each element is aligned to its own size.
//! A value is `(raw + offset) * scale`, rad/s or m/s^2.

use super::device::{DeviceError, MotionKind, MotionNode, Reading, Trouble};
use super::v4l2::readable;
use cairn_geometry::Vec3;
use std::fs::File;
use std::io::Read;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Records that the kernel keeps: a second at 400 Hz.
const KEPT: usize = 400;

/// How an element of a record is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Element {
    big_endian: bool,
    signed: bool,
    bits: u32,
    bytes: usize,
    shift: u32,
    index: usize,
}

impl Element {
    /// Parses `le:s32/64>>4`; `None` where it is of another form, or repeated (`X2`).
    fn parse(text: &str, index: usize) -> Option<Self> {
        let (endian, rest) = text.trim().split_once(':')?;
        let (bits, rest) = rest.split_once('/')?;
        let (stored, shift) = rest.split_once(">>").unwrap_or((rest, "0"));
        let signed = match bits.as_bytes().first()? {
            b's' => true,
            b'u' => false,
            _ => return None,
        };
        let (bits, stored, shift): (u32, u32, u32) =
            (bits[1..].parse().ok()?, stored.parse().ok()?, shift.parse().ok()?);
        let possible =
            matches!(stored, 8 | 16 | 32 | 64) && (1..=64).contains(&bits) && bits + shift <= stored;
        let big_endian = match endian {
            "be" => true,
            "le" => false,
            _ => return None,
        };
        possible.then_some(Self { big_endian, signed, bits, bytes: stored as usize / 8, shift, index })
    }

    fn value(&self, record: &[u8], at: usize) -> Option<i64> {
        let bytes = record.get(at..at + self.bytes)?;
        let fold = |all: u64, b: &u8| all << 8 | u64::from(*b);
        let raw = match self.big_endian {
            true => bytes.iter().fold(0, fold),
            false => bytes.iter().rev().fold(0, fold),
        };
        let unused = 64 - self.bits;
        let raw = (raw >> self.shift) << unused;
        Some(if self.signed { (raw as i64) >> unused } else { (raw >> unused) as i64 })
    }
}

/// The layout of a record: x, y, z and the time, with their places.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Layout {
    elements: [(Element, usize); 4],
    bytes: usize,
}

impl Layout {
    /// Elements in the order of their index, each aligned to its size, the whole to the largest.
    fn of(elements: [Element; 4]) -> Self {
        let mut order = [0, 1, 2, 3];
        order.sort_by_key(|i| elements[*i].index);
        let (mut at, mut largest) = (0_usize, 1);
        let mut places = elements.map(|e| (e, 0));
        for i in order {
            let size = elements[i].bytes;
            at = at.next_multiple_of(size);
            places[i].1 = at;
            (at, largest) = (at + size, largest.max(size));
        }
        Self { elements: places, bytes: at.next_multiple_of(largest) }
    }

    fn reading(&self, record: &[u8], offset: f64, scale: f64) -> Option<Reading> {
        let mut values = [0; 4];
        for (value, (element, at)) in values.iter_mut().zip(&self.elements) {
            *value = element.value(record, *at)?;
        }
        let [x, y, z, device_ns] = values;
        let value = Vec3::new(x as f64, y as f64, z as f64).map(|raw| (raw + offset) * scale);
        Some(Reading { device_ns, value })
    }
}

/// An opened node.
pub struct IioNode {
    path: PathBuf,
    /// Its folder in sysfs.
    folder: PathBuf,
    prefix: &'static str,
    file: File,
    layout: Layout,
    offset: f64,
    scale: f64,
    bytes: Vec<u8>,
    /// Bytes of a record that has not come whole.
    held: usize,
    started: bool,
}

impl IioNode {
    /// Opens a node; `folder` is its folder in sysfs.
    ///
    /// # Errors
    /// [`DeviceError`] where there is none, this user may not, or its records have another form.
    pub fn open(node: &Path, folder: &Path, kind: MotionKind) -> Result<Self, DeviceError> {
        let prefix = match kind {
            MotionKind::Gyro => "in_anglvel",
            MotionKind::Accel => "in_accel",
        };
        let fail = |why: String| DeviceError::new(Trouble::Unsuitable, node.display().to_string(), why);
        let element = |name: &str| {
            let read = |what: &str| read(&folder.join(format!("scan_elements/{name}_{what}"))).ok();
            let index = read("index").and_then(|t| t.parse().ok());
            let element = read("type").zip(index).and_then(|(text, index)| Element::parse(&text, index));
            element.ok_or_else(|| fail(format!("its records have no {name} that can be read")))
        };
        let axes = ["x", "y", "z"].map(|axis| element(&format!("{prefix}_{axis}")));
        let [x, y, z] = axes;
        let layout = Layout::of([x?, y?, z?, element("in_timestamp")?]);
        let number = |name: &str| read(&folder.join(format!("{prefix}_{name}"))).ok()?.parse::<f64>().ok();
        let scale = number("scale").filter(|s| s.is_finite() && *s > 0.0);
        let scale = scale.ok_or_else(|| fail(format!("{prefix}_scale is no number")))?;
        let file = std::fs::OpenOptions::new()
            .read(true)
            .custom_flags(rustix::fs::OFlags::NONBLOCK.bits() as i32)
            .open(node)
            .map_err(|e| DeviceError::of(node, "opening it", &e))?;
        Ok(Self {
            path: node.to_owned(),
            folder: folder.to_owned(),
            prefix,
            file,
            bytes: vec![0; layout.bytes * KEPT],
            layout,
            offset: number("offset").unwrap_or(0.0),
            scale,
            held: 0,
            started: false,
        })
    }

    fn set(&self, name: &str, value: &str) -> Result<(), DeviceError> {
        let path = self.folder.join(name);
        std::fs::write(&path, value)
            .map_err(|e| DeviceError::of(&path, &format!("writing {value} to it"), &e))
    }

    /// The rate nearest to the wanted one of those that it lists; the wanted one where it lists none.
    fn nearest_rate(&self, wanted_hz: f64) -> f64 {
        let names =
            [format!("{}_sampling_frequency_available", self.prefix), "sampling_frequency_available".into()];
        let list = names.iter().find_map(|name| read(&self.folder.join(name)).ok()).unwrap_or_default();
        let rates = list.split_whitespace().filter_map(|r| r.parse::<f64>().ok()).filter(|r| *r > 0.0);
        rates.min_by(|a, b| (a - wanted_hz).abs().total_cmp(&(b - wanted_hz).abs())).unwrap_or(wanted_hz)
    }
}

impl MotionNode for IioNode {
    fn start(&mut self, rate_hz: f64) -> Result<f64, DeviceError> {
        self.set("buffer/enable", "0")?;
        let rate = self.nearest_rate(rate_hz);
        let named = format!("{}_sampling_frequency", self.prefix);
        let name = if self.folder.join(&named).exists() { named } else { "sampling_frequency".to_owned() };
        self.set(&name, &rate.to_string())?;
        for axis in ["x", "y", "z"] {
            self.set(&format!("scan_elements/{}_{axis}_en", self.prefix), "1")?;
        }
        self.set("scan_elements/in_timestamp_en", "1")?;
        // Kernels before 4.8 have no choice; the clock is found out from the stamps either way.
        let _ = self.set("current_timestamp_clock", "monotonic");
        self.set("buffer/length", &KEPT.to_string())?;
        self.set("buffer/enable", "1")?;
        self.started = true;
        let told = read(&self.folder.join(&name)).ok().and_then(|t| t.parse().ok());
        Ok(told.filter(|r: &f64| r.is_finite() && *r > 0.0).unwrap_or(rate))
    }

    fn read(&mut self, wait: Duration, into: &mut Vec<Reading>) -> Result<(), DeviceError> {
        let error = |e: std::io::Error| DeviceError::of(&self.path, "reading it", &e);
        if !readable(&self.file, wait).map_err(|e| error(e.into()))? {
            return Ok(());
        }
        let count = match self.file.read(&mut self.bytes[self.held..]) {
            Ok(0) => {
                return Err(DeviceError::new(
                    Trouble::Gone,
                    self.path.display().to_string(),
                    "was unplugged",
                ));
            }
            Ok(count) => self.held + count,
            Err(e)
                if matches!(e.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::Interrupted) =>
            {
                return Ok(());
            }
            Err(e) => return Err(error(e)),
        };
        let whole = count - count % self.layout.bytes;
        let records = self.bytes[..whole].chunks_exact(self.layout.bytes);
        into.extend(records.filter_map(|r| self.layout.reading(r, self.offset, self.scale)));
        self.bytes.copy_within(whole..count, 0);
        self.held = count - whole;
        Ok(())
    }
}

impl Drop for IioNode {
    fn drop(&mut self) {
        if self.started {
            // It may have been unplugged.
            let _ = self.set("buffer/enable", "0");
        }
    }
}

/// The text of a file of sysfs.
fn read(path: &Path) -> std::io::Result<String> {
    std::fs::read_to_string(path).map(|text| text.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn elements_are_parsed_as_the_kernel_writes_them() {
        let e = Element::parse("le:s32/32>>0\n", 1).unwrap();
        assert_eq!((e.big_endian, e.signed, e.bits, e.bytes, e.shift, e.index), (false, true, 32, 4, 0, 1));
        let e = Element::parse("be:u12/16>>4", 0).unwrap();
        assert_eq!(e.value(&[0xab, 0xcf], 0), Some(0xabc));
        let e = Element::parse("le:s12/16>>4", 0).unwrap();
        assert_eq!(e.value(&[0xf0, 0xff], 0), Some(-1));
        for wrong in [
            "",
            "le:s32",
            "xe:s32/32>>0",
            "le:f32/32",
            "le:s33/32>>0",
            "le:s32/32X2>>0",
            "le:s0/8",
            "le:s30/32>>4",
        ] {
            assert_eq!(Element::parse(wrong, 0), None, "{wrong}");
        }
        assert_eq!(Element::parse("le:s32/32", 0).unwrap().value(&[0; 3], 0), None);
    }

    /// Three 32-bit values and a 64-bit time: the time begins at 16, after four bytes that are left free.
    #[test]
    fn a_record_is_laid_out_as_the_kernel_aligns_it() {
        let axis = |i| Element::parse("le:s32/32>>0", i).unwrap();
        let layout = Layout::of([axis(0), axis(1), axis(2), Element::parse("le:s64/64>>0", 3).unwrap()]);
        assert_eq!((layout.bytes, layout.elements[3].1), (24, 16));
        let mut record = Vec::new();
        for v in [100_i32, -200, 300, 0] {
            record.extend(v.to_le_bytes());
        }
        record.extend(1_234_567_890_123_i64.to_le_bytes());
        let reading = layout.reading(&record, 0.0, 0.01).unwrap();
        assert_eq!(reading.device_ns, 1_234_567_890_123);
        assert!((reading.value - Vec3::new(1.0, -2.0, 3.0)).norm() < 1e-12);
        assert!(layout.reading(&record[..20], 0.0, 1.0).is_none());
    }

    /// A folder as sysfs shows it and a pipe in place of the device: what is written to start it, and what is read.
    #[test]
    fn a_node_is_started_through_sysfs_and_read() {
        let root = std::env::temp_dir().join(format!("cairn-iio-{}", std::process::id()));
        for folder in ["scan_elements", "buffer"] {
            std::fs::create_dir_all(root.join(folder)).unwrap();
        }
        let put = |name: &str, text: &str| std::fs::write(root.join(name), text).unwrap();
        for (i, axis) in ["x", "y", "z"].iter().enumerate() {
            put(&format!("scan_elements/in_anglvel_{axis}_type"), "le:s32/32>>0\n");
            put(&format!("scan_elements/in_anglvel_{axis}_index"), &i.to_string());
        }
        put("scan_elements/in_timestamp_type", "le:s64/64>>0\n");
        put("scan_elements/in_timestamp_index", "3");
        put("in_anglvel_scale", "0.001\n");
        put("in_anglvel_sampling_frequency", "0");
        put("in_anglvel_sampling_frequency_available", "200 400");
        let fifo = root.join("device");
        assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
        let mut node = IioNode::open(&fifo, &root, MotionKind::Gyro).unwrap();
        assert_eq!(node.start(180.0).unwrap(), 200.0);
        let text = |name: &str| std::fs::read_to_string(root.join(name)).unwrap();
        assert_eq!(
            (text("buffer/enable"), text("in_anglvel_sampling_frequency")),
            ("1".into(), "200".into())
        );
        assert_eq!(text("scan_elements/in_anglvel_z_en"), "1");
        let mut writer = std::fs::OpenOptions::new().write(true).open(&fifo).unwrap();
        let mut record = Vec::new();
        [1000_i32, 0, -500, 0].iter().for_each(|v| record.extend(v.to_le_bytes()));
        record.extend(77_i64.to_le_bytes());
        // A record and a part of one; the rest of it follows.
        writer.write_all(&[&record[..], &record[..10]].concat()).unwrap();
        let mut readings = Vec::new();
        node.read(Duration::from_millis(100), &mut readings).unwrap();
        assert_eq!(readings, [Reading { device_ns: 77, value: Vec3::new(1.0, 0.0, -0.5) }]);
        writer.write_all(&record[10..]).unwrap();
        node.read(Duration::from_millis(100), &mut readings).unwrap();
        assert_eq!(readings.len(), 2);
        drop(writer);
        assert_eq!(node.read(Duration::from_millis(100), &mut readings).unwrap_err().trouble, Trouble::Gone);
        drop(node);
        assert_eq!(text("buffer/enable"), "0");
        let error = IioNode::open(&fifo, &root, MotionKind::Accel).err().unwrap();
        assert!(error.to_string().contains("in_accel_x"), "{error}");
        std::fs::remove_dir_all(&root).unwrap();
    }
}
