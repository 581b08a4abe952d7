//! Writes small bags for tests: ROS 1 and ROS 2 messages, rosbag1 and MCAP files, byte by byte after their
//! specifications.
#![allow(dead_code)]

use std::path::PathBuf;

/// A message of a bag.
#[derive(Clone)]
pub struct Message {
    pub topic: String,
    pub kind: &'static str,
    pub log_ns: i64,
    pub data: Vec<u8>,
}

/// A file that is removed when dropped.
pub struct Temporary(pub PathBuf);

impl Temporary {
    pub fn new(name: &str, bytes: &[u8]) -> Self {
        let path = std::env::temp_dir().join(format!("cairn-bag-{}-{name}", std::process::id()));
        std::fs::write(&path, bytes).unwrap();
        Self(path)
    }

    pub fn name(&self) -> &str {
        self.0.to_str().unwrap()
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Serialises in either format.
pub struct Fields {
    ros1: bool,
    bytes: Vec<u8>,
}

impl Fields {
    pub fn new(ros1: bool) -> Self {
        Self { ros1, bytes: if ros1 { vec![] } else { vec![0, 1, 0, 0] } }
    }

    pub fn end(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    fn put(&mut self, bytes: &[u8]) -> &mut Self {
        let n = bytes.len();
        while !self.ros1 && !(self.bytes.len() - 4).is_multiple_of(n) {
            self.bytes.push(0);
        }
        self.bytes.extend_from_slice(bytes);
        self
    }

    pub fn u8(&mut self, v: u8) -> &mut Self {
        self.put(&[v])
    }

    pub fn u32(&mut self, v: u32) -> &mut Self {
        self.put(&v.to_le_bytes())
    }

    pub fn f32(&mut self, v: f32) -> &mut Self {
        self.put(&v.to_le_bytes())
    }

    pub fn f64s(&mut self, v: &[f64]) -> &mut Self {
        for v in v {
            self.put(&v.to_le_bytes());
        }
        self
    }

    pub fn string(&mut self, v: &str) -> &mut Self {
        self.u32(v.len() as u32 + u32::from(!self.ros1));
        self.bytes.extend_from_slice(v.as_bytes());
        if !self.ros1 {
            self.bytes.push(0);
        }
        self
    }

    pub fn data(&mut self, v: &[u8]) -> &mut Self {
        self.u32(v.len() as u32);
        self.bytes.extend_from_slice(v);
        self
    }

    pub fn header(&mut self, ns: i64, frame: &str) -> &mut Self {
        if self.ros1 {
            self.u32(3);
        }
        self.u32((ns / 1_000_000_000) as u32).u32((ns % 1_000_000_000) as u32).string(frame)
    }
}

fn message(topic: &str, kind: &'static str, log_ns: i64, data: Vec<u8>) -> Message {
    Message { topic: topic.into(), kind, log_ns, data }
}

/// A `sensor_msgs/Image` without row padding.
pub fn image(
    ros1: bool,
    topic: &str,
    ns: i64,
    frame: &str,
    [w, h]: [u32; 2],
    encoding: &str,
    pixels: &[u8],
) -> Message {
    let step = pixels.len() as u32 / h;
    let mut f = Fields::new(ros1);
    f.header(ns, frame).u32(h).u32(w).string(encoding).u8(0).u32(step).data(pixels);
    message(topic, "sensor_msgs/msg/Image", ns, f.end())
}

pub fn compressed(ros1: bool, topic: &str, ns: i64, frame: &str, format: &str, file: &[u8]) -> Message {
    let mut f = Fields::new(ros1);
    f.header(ns, frame).string(format).data(file);
    message(topic, "sensor_msgs/msg/CompressedImage", ns, f.end())
}

/// A calibration: frame, size, model, coefficients, K, R, P.
pub struct Info<'a> {
    pub frame: &'a str,
    pub size: [u32; 2],
    pub model: &'a str,
    pub d: &'a [f64],
    pub k: [f64; 9],
    pub r: [f64; 9],
    pub p: [f64; 12],
}

pub fn camera_info(ros1: bool, topic: &str, ns: i64, info: &Info) -> Message {
    let mut f = Fields::new(ros1);
    f.header(ns, info.frame).u32(info.size[1]).u32(info.size[0]).string(info.model);
    f.u32(info.d.len() as u32).f64s(info.d).f64s(&info.k).f64s(&info.r).f64s(&info.p);
    f.u32(0).u32(0).u32(0).u32(0).u32(0).u32(0).u8(0);
    message(topic, "sensor_msgs/msg/CameraInfo", ns, f.end())
}

pub fn imu(ros1: bool, topic: &str, ns: i64, frame: &str, gyro: [f64; 3], accel: [f64; 3]) -> Message {
    let mut f = Fields::new(ros1);
    f.header(ns, frame).f64s(&[0.0; 13]).f64s(&gyro).f64s(&[0.0; 9]).f64s(&accel).f64s(&[0.0; 9]);
    message(topic, "sensor_msgs/msg/Imu", ns, f.end())
}

/// A transform with translation and quaternion `x y z w`.
pub fn tf_static(ros1: bool, ns: i64, edges: &[(&str, &str, [f64; 7])]) -> Message {
    let mut f = Fields::new(ros1);
    f.u32(edges.len() as u32);
    for (parent, child, pose) in edges {
        f.header(ns, parent).string(child).f64s(pose);
    }
    message("/tf_static", "tf2_msgs/msg/TFMessage", ns, f.end())
}

/// A pose by another system, with the covariance that its kind has.
pub fn truth(ros1: bool, topic: &str, kind: &'static str, ns: i64, pose: [f64; 7]) -> Message {
    let mut f = Fields::new(ros1);
    f.header(ns, "world");
    if kind.ends_with("TransformStamped") || kind.ends_with("Odometry") {
        f.string("body");
    }
    f.f64s(&pose);
    if kind.ends_with("PoseWithCovarianceStamped") || kind.ends_with("Odometry") {
        f.f64s(&[0.5; 36]);
    }
    if kind.ends_with("Odometry") {
        f.f64s(&[0.5; 42]);
    }
    message(topic, kind, ns, f.end())
}

pub fn transform(topic: &str, ns: i64, pose: [f64; 7]) -> Message {
    message(topic, "geometry_msgs/msg/Transform", ns, Fields::new(true).f64s(&pose).end())
}

pub fn float32(topic: &str, ns: i64, v: f32) -> Message {
    message(topic, "std_msgs/msg/Float32", ns, Fields::new(true).f32(v).end())
}

fn field(to: &mut Vec<u8>, name: &str, value: &[u8]) {
    to.extend((name.len() as u32 + 1 + value.len() as u32).to_le_bytes());
    to.extend_from_slice(name.as_bytes());
    to.push(b'=');
    to.extend_from_slice(value);
}

/// A record of rosbag1.
pub fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let mut header = Vec::new();
    fields.iter().for_each(|(name, value)| field(&mut header, name, value));
    let mut out = (header.len() as u32).to_le_bytes().to_vec();
    out.extend(header);
    out.extend((data.len() as u32).to_le_bytes());
    out.extend_from_slice(data);
    out
}

pub fn lz4(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut to = lz4_flex::frame::FrameEncoder::new(Vec::new());
    to.write_all(bytes).unwrap();
    to.finish().unwrap()
}

/// A rosbag1 file without its index (like one that was never closed), with `per_chunk` messages in each chunk.
pub fn rosbag1(messages: &[Message], compression: &str, per_chunk: usize) -> Vec<u8> {
    let mut out = b"#ROSBAG V2.0\n".to_vec();
    let zero = 0u64.to_le_bytes();
    out.extend(record(
        &[("op", &[3]), ("index_pos", &zero), ("conn_count", &[0; 4]), ("chunk_count", &[0; 4])],
        &[b' '; 64],
    ));
    let mut known: Vec<String> = Vec::new();
    for part in messages.chunks(per_chunk) {
        let mut chunk = Vec::new();
        for m in part {
            let id = known.iter().position(|t| *t == m.topic).unwrap_or_else(|| {
                known.push(m.topic.clone());
                let mut about = Vec::new();
                field(&mut about, "topic", m.topic.as_bytes());
                field(&mut about, "type", m.kind.replace("/msg/", "/").as_bytes());
                field(&mut about, "md5sum", b"*");
                field(&mut about, "message_definition", b"");
                let id = (known.len() as u32 - 1).to_le_bytes();
                chunk.extend(record(&[("op", &[7]), ("conn", &id), ("topic", m.topic.as_bytes())], &about));
                known.len() - 1
            });
            let time = (m.log_ns / 1_000_000_000) as u64 | ((m.log_ns % 1_000_000_000) as u64) << 32;
            let id = (id as u32).to_le_bytes();
            chunk.extend(record(&[("op", &[2]), ("conn", &id), ("time", &time.to_le_bytes())], &m.data));
        }
        let packed = if compression == "lz4" { lz4(&chunk) } else { chunk.clone() };
        let size = (chunk.len() as u32).to_le_bytes();
        out.extend(record(
            &[("op", &[5]), ("compression", compression.as_bytes()), ("size", &size)],
            &packed,
        ));
    }
    out
}

/// A record of MCAP.
pub fn mcap_record(kind: u8, content: &[u8]) -> Vec<u8> {
    let mut out = vec![kind];
    out.extend((content.len() as u64).to_le_bytes());
    out.extend_from_slice(content);
    out
}

pub fn mcap_text(text: &str) -> Vec<u8> {
    let mut out = (text.len() as u32).to_le_bytes().to_vec();
    out.extend_from_slice(text.as_bytes());
    out
}

/// An MCAP file without summary, with `per_chunk` messages in each chunk; 0 writes them without chunks.
pub fn mcap(messages: &[Message], encoding: &str, compression: &str, per_chunk: usize) -> Vec<u8> {
    let mut out = b"\x89MCAP0\r\n".to_vec();
    out.extend(mcap_record(1, &[mcap_text(""), mcap_text("test")].concat()));
    let mut known: Vec<String> = Vec::new();
    for part in messages.chunks(per_chunk.max(1)) {
        let mut chunk = Vec::new();
        for m in part {
            let id = known.iter().position(|t| *t == m.topic).unwrap_or_else(|| {
                known.push(m.topic.clone());
                let id = (known.len() as u16).to_le_bytes();
                let schema = [&id[..], &mcap_text(m.kind), &mcap_text("ros2msg"), &[0; 4]].concat();
                chunk.extend(mcap_record(3, &schema));
                let channel = [&id[..], &id, &mcap_text(&m.topic), &mcap_text(encoding), &[0; 4]].concat();
                chunk.extend(mcap_record(4, &channel));
                known.len() - 1
            });
            let id = (id as u16 + 1).to_le_bytes();
            let time = (m.log_ns as u64).to_le_bytes();
            chunk.extend(mcap_record(5, &[&id[..], &[0; 4], &time, &time, &m.data].concat()));
        }
        if per_chunk == 0 {
            out.extend(chunk);
            continue;
        }
        let packed = if compression == "lz4" { lz4(&chunk) } else { chunk.clone() };
        let mut content = [0; 16].to_vec();
        content.extend((chunk.len() as u64).to_le_bytes());
        content.extend(crc32fast::hash(&chunk).to_le_bytes());
        content.extend(mcap_text(compression));
        content.extend((packed.len() as u64).to_le_bytes());
        content.extend(packed);
        out.extend(mcap_record(6, &content));
    }
    out.extend(mcap_record(15, &[0; 4]));
    out.extend(mcap_record(2, &[0; 20]));
    out.extend(b"\x89MCAP0\r\n");
    out
}
