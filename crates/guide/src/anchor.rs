//! What a point of a route hangs on, and how stamps and poses are written in a file of a route.

use serde::{Deserialize, Serialize};

/// Identifies a keyframe: the robot that made it and its number there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Anchor {
    /// The robot's number.
    pub robot: u16,
    /// The keyframe's number, never reused.
    pub seq: u32,
}

/// A stamp as whole nanoseconds.
pub(crate) mod stamp_ns {
    use cairn_sensor::Stamp;
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(t: &Stamp, s: S) -> Result<S::Ok, S::Error> {
        s.serialize_i64(t.0)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Stamp, D::Error> {
        i64::deserialize(d).map(Stamp)
    }
}

/// A similarity as `[x, y, z, qx, qy, qz, qw, scale]`.
pub(crate) mod eight {
    use cairn_geometry::{Sim3, So3, Vec3};
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    pub fn serialize<S: Serializer>(t: &Option<Sim3>, s: S) -> Result<S::Ok, S::Error> {
        let numbers = t.map(|t| {
            let (p, q) = (t.translation, t.rotation.quaternion());
            [p.x, p.y, p.z, q.i, q.j, q.k, q.w, t.scale]
        });
        numbers.serialize(s)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Sim3>, D::Error> {
        let Some([x, y, z, qx, qy, qz, qw, scale]) = <Option<[f64; 8]>>::deserialize(d)? else {
            return Ok(None);
        };
        let rotation =
            So3::from_xyzw(qx, qy, qz, qw).ok_or_else(|| D::Error::custom("a rotation of norm 0"))?;
        let carried = Sim3::new(rotation, Vec3::new(x, y, z), scale);
        match carried.is_finite() && scale > 0.0 {
            true => Ok(Some(carried)),
            false => Err(D::Error::custom("not a similarity")),
        }
    }
}

/// A pose as `[x, y, z, qx, qy, qz, qw]`.
pub(crate) mod seven {
    use cairn_geometry::{Se3, So3, Vec3};
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    pub fn serialize<S: Serializer>(t: &Se3, s: S) -> Result<S::Ok, S::Error> {
        let (p, q) = (t.translation, t.rotation.quaternion());
        [p.x, p.y, p.z, q.i, q.j, q.k, q.w].serialize(s)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Se3, D::Error> {
        let [x, y, z, qx, qy, qz, qw] = <[f64; 7]>::deserialize(d)?;
        let rotation =
            So3::from_xyzw(qx, qy, qz, qw).ok_or_else(|| D::Error::custom("a rotation of norm 0"))?;
        Ok(Se3::new(rotation, Vec3::new(x, y, z)))
    }
}
