//! Digests: sixty-four bits that differ when any bit of the digested data differs (FNV-1a; not
//! cryptographic).

use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_tracking::{AnchoredPose, State};

/// An incremental digest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Digest(u64);

impl Default for Digest {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Digest {
    pub fn value(self) -> u64 {
        self.0
    }

    pub fn u64(&mut self, v: u64) {
        for byte in v.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    pub fn f64(&mut self, v: f64) {
        self.u64(v.to_bits());
    }

    fn vec(&mut self, v: &Vec3) {
        v.iter().for_each(|x| self.f64(*x));
    }

    fn id(&mut self, id: KeyFrameId) {
        self.u64(id.index() as u64);
    }

    pub fn pose(&mut self, pose: &Se3) {
        pose.rotation.quaternion().coords.iter().for_each(|x| self.f64(*x));
        self.vec(&pose.translation);
    }

    pub fn anchored(&mut self, anchored: Option<&AnchoredPose>) {
        self.u64(u64::from(anchored.is_some()));
        if let Some(p) = anchored {
            self.id(p.reference);
            self.pose(&p.reference_from_camera);
            self.pose(&p.world_from_camera);
        }
    }

    pub fn state(&mut self, state: State) {
        let numbers = match state {
            State::Starting { have, need } => [0, have, need],
            State::Tracking => [1, 0, 0],
            State::Lost { inliers, need } => [2, inliers, need],
            State::Coasting { since_s, sigma } => {
                self.f64(since_s);
                self.f64(sigma);
                [3, 0, 0]
            }
            State::RotationOnly { since_s, sigma } => {
                self.f64(since_s);
                self.f64(sigma);
                [4, 0, 0]
            }
        };
        numbers.iter().for_each(|n| self.u64(*n as u64));
    }

    /// Adds every key frame and landmark: pose, parents and links, and observations.
    pub fn snapshot(&mut self, snapshot: &Snapshot) {
        self.u64(snapshot.version());
        self.f64(snapshot.right_offset());
        for k in snapshot.key_frames() {
            self.id(k.id);
            self.id(k.map.root());
            k.parent.iter().chain(&k.links).for_each(|id| self.id(*id));
            self.pose(&k.world_from_camera);
            self.f64(k.unit);
            for z in &k.relative_poses {
                self.id(z.from);
                self.pose(&z.from_from_here);
            }
            if let Some(m) = &k.motion {
                [m.velocity, m.bias.gyro, m.bias.accel].iter().for_each(|v| self.vec(v));
                self.u64(m.imu_factor.as_ref().map_or(0, |f| 1 + f.since.index() as u64));
            }
            k.landmarks.iter().for_each(|l| self.u64(l.map_or(0, |l| 1 + l.index() as u64)));
        }
        for l in snapshot.landmarks() {
            self.u64(l.id.index() as u64);
            self.vec(&l.position);
        }
    }
}
