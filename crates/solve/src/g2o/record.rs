//! The two kinds of poses in g2o text: tags, and the numbers of a pose.

use crate::text::{TextError, number};
use cairn_geometry::{LieGroup, Se2, Se3, So3, Vec3};

/// A pose as written in the text.
pub trait Record<const D: usize>: LieGroup<D> {
    const VERTEX: &'static str;
    const EDGE: &'static str;
    /// Reads its numbers from the line.
    fn take<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<Self, TextError>;
    /// Its numbers.
    fn numbers(&self) -> Vec<f64>;
}

impl Record<3> for Se2 {
    const VERTEX: &'static str = "VERTEX_SE2";
    const EDGE: &'static str = "EDGE_SE2";

    fn take<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<Self, TextError> {
        let mut next = |what| number(words, line, what);
        Ok(Self::from_xy_angle(next("x")?, next("y")?, next("the angle")?))
    }

    fn numbers(&self) -> Vec<f64> {
        vec![self.translation.x, self.translation.y, self.rotation.log()]
    }
}

impl Record<6> for Se3 {
    const VERTEX: &'static str = "VERTEX_SE3:QUAT";
    const EDGE: &'static str = "EDGE_SE3:QUAT";

    fn take<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<Self, TextError> {
        let mut next = |what| number(words, line, what);
        let t = Vec3::new(next("x")?, next("y")?, next("z")?);
        let [x, y, z, w] = [next("qx")?, next("qy")?, next("qz")?, next("qw")?];
        let norm = (x * x + y * y + z * z + w * w).sqrt();
        match So3::from_xyzw(x, y, z, w) {
            // Rounded to two digits a quaternion is still near norm one; something else is no quaternion.
            Some(r) if (norm - 1.0).abs() < 0.1 => Ok(Self::new(r, t)),
            _ => Err(TextError::new(line, format!("the quaternion has norm {norm}, not 1"))),
        }
    }

    fn numbers(&self) -> Vec<f64> {
        let (t, q) = (&self.translation, self.rotation.quaternion());
        vec![t.x, t.y, t.z, q.i, q.j, q.k, q.w]
    }
}
