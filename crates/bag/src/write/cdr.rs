//! Writes the fields of a message in CDR, little-endian (OMG formal/2002-06-51, 15.3).

use cairn_geometry::Se3;

/// A message being written.
pub(super) struct CdrWriter(Vec<u8>);

impl CdrWriter {
    /// Starts a message.
    pub fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    /// The finished bytes.
    pub fn end(self) -> Vec<u8> {
        self.0
    }

    /// Adds the bytes of a number, aligned to its size.
    fn put<const N: usize>(&mut self, bytes: [u8; N]) -> &mut Self {
        // The header before the fields has four bytes: a multiple of four, but not of eight.
        let at = self.0.len() - 4;
        self.0.resize(self.0.len() + (N - at % N) % N, 0);
        self.0.extend_from_slice(&bytes);
        self
    }

    pub fn u8(&mut self, v: u8) -> &mut Self {
        self.put([v])
    }

    pub fn u32(&mut self, v: u32) -> &mut Self {
        self.put(v.to_le_bytes())
    }

    pub fn f64(&mut self, v: f64) -> &mut Self {
        self.put(v.to_le_bytes())
    }

    /// The length of a sequence; no sequence here exceeds 32 bits.
    pub fn length(&mut self, n: usize) -> &mut Self {
        self.u32(u32::try_from(n).unwrap_or(u32::MAX))
    }

    pub fn string(&mut self, text: &str) -> &mut Self {
        self.length(text.len() + 1);
        self.0.extend_from_slice(text.as_bytes());
        self.0.push(0);
        self
    }

    pub fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.length(bytes.len());
        self.0.extend_from_slice(bytes);
        self
    }

    /// A `builtin_interfaces/Time`; seconds outside 32 bits are clamped.
    pub fn time(&mut self, stamp_ns: i64) -> &mut Self {
        let seconds = stamp_ns.div_euclid(1_000_000_000).clamp(i64::from(i32::MIN), i64::from(i32::MAX));
        self.put((seconds as i32).to_le_bytes());
        self.u32(stamp_ns.rem_euclid(1_000_000_000) as u32)
    }

    /// Translation, then quaternion `x y z w`: a `geometry_msgs/Pose`, and the fields of a transform.
    pub fn pose(&mut self, pose: &Se3) -> &mut Self {
        let (t, q) = (pose.translation, pose.rotation.quaternion().coords);
        [t.x, t.y, t.z, q.x, q.y, q.z, q.w].into_iter().for_each(|v| {
            self.f64(v);
        });
        self
    }
}
