//! The two kinds of poses in g2o text: tags, and the numbers of a pose and of a point.

use crate::text::{TextError, number};
use cairn_geometry::{LieGroup, Se2, Se3, So3, Vec3};

/// A pose as written in the text, and what may be measured of it.
pub trait Record<const D: usize>: LieGroup<D> {
    const VERTEX: &'static str;
    const EDGE: &'static str;
    /// A point, the edge of a pose that saw one, and where the sensor that saw it sits on the pose.
    const POINT: &'static str;
    const SEEN: &'static str;
    const OFFSET: &'static str;
    /// A pose that is known in the world.
    const PRIORS: &'static [&'static str];
    /// A position that is known in the world.
    const POSITION: &'static str;
    /// Numbers of a point.
    const N: usize;
    /// Whether edges to points and the world name the offset of their sensor.
    const NAMES_OFFSET: bool;
    /// Reads its numbers from the line.
    fn take<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<Self, TextError>;
    /// Reads the numbers of a point: a pose without rotation.
    fn take_point<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<Self, TextError>;
    /// Its numbers, the first of them those of its point.
    fn numbers(&self) -> Vec<f64>;
}

impl Record<3> for Se2 {
    const VERTEX: &'static str = "VERTEX_SE2";
    const EDGE: &'static str = "EDGE_SE2";
    const POINT: &'static str = "VERTEX_XY";
    const SEEN: &'static str = "EDGE_SE2_XY";
    const OFFSET: &'static str = "PARAMS_SE2OFFSET";
    const PRIORS: &'static [&'static str] = &["EDGE_SE2_PRIOR", "EDGE_PRIOR_SE2"];
    const POSITION: &'static str = "EDGE_PRIOR_SE2_XY";
    const N: usize = 2;
    const NAMES_OFFSET: bool = false;

    fn take<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<Self, TextError> {
        let mut next = |what| number(words, line, what);
        Ok(Self::from_xy_angle(next("x")?, next("y")?, next("the angle")?))
    }

    fn take_point<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<Self, TextError> {
        Ok(Self::from_xy_angle(number(words, line, "x")?, number(words, line, "y")?, 0.0))
    }

    fn numbers(&self) -> Vec<f64> {
        vec![self.translation.x, self.translation.y, self.rotation.log()]
    }
}

impl Record<6> for Se3 {
    const VERTEX: &'static str = "VERTEX_SE3:QUAT";
    const EDGE: &'static str = "EDGE_SE3:QUAT";
    const POINT: &'static str = "VERTEX_TRACKXYZ";
    const SEEN: &'static str = "EDGE_SE3_TRACKXYZ";
    const OFFSET: &'static str = "PARAMS_SE3OFFSET";
    const PRIORS: &'static [&'static str] = &["EDGE_SE3_PRIOR"];
    const POSITION: &'static str = "EDGE_SE3_XYZPRIOR";
    const N: usize = 3;
    const NAMES_OFFSET: bool = true;

    fn take<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<Self, TextError> {
        let t = Self::take_point(words, line)?.translation;
        let mut next = |what| number(words, line, what);
        let [x, y, z, w] = [next("qx")?, next("qy")?, next("qz")?, next("qw")?];
        let norm = (x * x + y * y + z * z + w * w).sqrt();
        match So3::from_xyzw(x, y, z, w) {
            // Rounded to two digits a quaternion is still near norm one; something else is no quaternion.
            Some(r) if (norm - 1.0).abs() < 0.1 => Ok(Self::new(r, t)),
            _ => Err(TextError::new(line, format!("the quaternion has norm {norm}, not 1"))),
        }
    }

    fn take_point<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<Self, TextError> {
        let mut next = |what| number(words, line, what);
        Ok(Self::new(So3::identity(), Vec3::new(next("x")?, next("y")?, next("z")?)))
    }

    fn numbers(&self) -> Vec<f64> {
        let (t, q) = (&self.translation, self.rotation.quaternion());
        vec![t.x, t.y, t.z, q.i, q.j, q.k, q.w]
    }
}
