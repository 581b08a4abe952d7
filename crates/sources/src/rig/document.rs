//! A parsed calibration file, with errors that name its path and line.

use crate::text::place;
use cairn_files::yaml::{self, Node, Value};
use cairn_geometry::{Mat3, Se3};
use cairn_sensor::{Camera, Distortion, RigError, SourceError, check_rotation};
use nalgebra::Matrix4;
use std::path::{Path, PathBuf};

/// Why a lens of the omnidirectional toolbox of Scaramuzza is refused, and the way out.
pub const SCARAMUZZA: &str =
    "a lens of Scaramuzza's polynomial is not read: calibrate it with Kalibr as omni-radtan or pinhole-equi";

/// What is wrong with a calibration; whoever reads the file adds its name and the line.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct CalibrationError(pub String);

impl CalibrationError {
    /// The same of a part of the calibration.
    pub fn of(self, part: &str) -> Self {
        Self(format!("{part}: {}", self.0))
    }
}

impl From<RigError> for CalibrationError {
    fn from(e: RigError) -> Self {
        Self(e.to_string())
    }
}

/// A YAML file.
pub struct Document {
    /// Its path.
    pub path: PathBuf,
    /// Its content.
    pub root: Node,
}

impl Document {
    /// Parses a file's text.
    pub fn parse(path: &Path, text: &str) -> Result<Self, SourceError> {
        match yaml::parse(text) {
            Ok(root) => Ok(Self { path: path.to_owned(), root }),
            Err((line, why)) => Err(SourceError::new(place(path, line), why, "correct that line")),
        }
    }

    /// The parameters of a file for ROS 2 (`/**: ros__parameters: ...`), or the file as it is.
    pub fn parameters(mut self) -> Self {
        if let Value::Map(nodes) = &self.root.value
            && let Some(inner) = nodes.iter().find_map(|(_, node)| node.get("ros__parameters"))
        {
            self.root = inner.clone();
        }
        self
    }

    /// An error at a line (0: the file as a whole).
    pub fn error(&self, line: usize, why: impl Into<String>) -> SourceError {
        SourceError::new(place(&self.path, line), why, "correct the calibration file")
    }

    /// The value of a required key.
    pub fn need<'a>(&self, node: &'a Node, key: &str) -> Result<&'a Node, SourceError> {
        let line = if std::ptr::eq(node, &self.root) { 0 } else { node.line };
        node.get(key).ok_or_else(|| self.error(line, format!("{key} is missing")))
    }

    /// A finite number.
    pub fn number(&self, node: &Node) -> Result<f64, SourceError> {
        let text = node.text().unwrap_or("a list");
        text.parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| self.error(node.line, format!("\"{text}\" is not a finite number")))
    }

    /// A finite number under a required key.
    pub fn need_number(&self, node: &Node, key: &str) -> Result<f64, SourceError> {
        self.number(self.need(node, key)?)
    }

    /// A sequence of finite numbers.
    pub fn numbers(&self, node: &Node) -> Result<Vec<f64>, SourceError> {
        let items = node.list().ok_or_else(|| self.error(node.line, "a list of numbers is expected"))?;
        items.iter().map(|item| self.number(item)).collect()
    }

    /// Exactly `N` numbers.
    pub fn array<const N: usize>(&self, node: &Node, what: &str) -> Result<[f64; N], SourceError> {
        let list = self.numbers(node)?;
        let count = list.len();
        list.try_into()
            .map_err(|_| self.error(node.line, format!("{what} needs {N} numbers, here are {count}")))
    }

    /// A matrix in row order: `{rows, cols, data}` with matching counts, a list of rows, or a plain list; `data` may be rows too.
    pub fn matrix(&self, node: &Node, what: &str) -> Result<Vec<f64>, SourceError> {
        if let Value::Map(_) = node.value {
            let count = self.need_number(node, "rows")? * self.need_number(node, "cols")?;
            let data = self.rows(self.need(node, "data")?)?;
            if data.len() as f64 != count {
                let why = format!("{what}: rows x cols is {count}, but data has {} numbers", data.len());
                return Err(self.error(node.line, why));
            }
            return Ok(data);
        }
        self.rows(node)
    }

    /// The numbers of a list, or of a list of rows.
    fn rows(&self, node: &Node) -> Result<Vec<f64>, SourceError> {
        match node.list() {
            Some(rows) if rows.iter().all(|r| r.list().is_some()) => {
                rows.iter().map(|row| self.numbers(row)).collect::<Result<Vec<_>, _>>().map(|r| r.concat())
            }
            _ => self.numbers(node),
        }
    }

    /// A rigid transform from a 4x4 (or 3x4) matrix.
    pub fn transform(&self, node: &Node, what: &str) -> Result<Se3, SourceError> {
        let mut m = self.matrix(node, what)?;
        if m.len() == 12 {
            m.extend([0.0, 0.0, 0.0, 1.0]);
        }
        rigid(&m, what).map_err(|e| self.error(node.line, e.0))
    }

    /// Width and height, which are whole; `line` is where an error is told.
    pub fn size(&self, line: usize, size: [f64; 2]) -> Result<[usize; 2], SourceError> {
        let whole = |side: f64| side.fract() == 0.0 && (0.0..1e9).contains(&side);
        match size.iter().all(|side| whole(*side)) {
            true => Ok(size.map(|side| side as usize)),
            false => {
                let why = format!("images of {}x{} pixels: sides are whole numbers", size[0], size[1]);
                Err(self.error(line, why))
            }
        }
    }

    /// A camera of these numbers; `line` is where an error is told. A negative focal length along y is that of a camera whose y
    /// axis points up: the same pixels with y down ([`super::assumed_in`] tells it).
    pub fn camera(
        &self,
        line: usize,
        [width, height]: [usize; 2],
        [fx, fy, cx, cy]: [f64; 4],
        distortion: Distortion,
    ) -> Result<Camera, SourceError> {
        let camera = Camera { width, height, fx, fy: fy.abs(), cx, cy, distortion };
        camera.validate().map_err(|e| self.error(line, e.to_string()))?;
        Ok(camera)
    }

    /// A lens by its name in EuRoC and Kalibr files.
    pub fn distortion(&self, line: usize, name: &str, c: &[f64]) -> Result<Distortion, SourceError> {
        lens(name, c).map_err(|e| self.error(line, e.0))
    }
}

/// Sixteen numbers in row order as a rigid transform.
pub fn rigid(m: &[f64], what: &str) -> Result<Se3, CalibrationError> {
    if m.len() != 16 {
        return Err(CalibrationError(format!("{what} needs 4x4 numbers, here are {}", m.len())));
    }
    let m = Matrix4::from_row_slice(m);
    let r: Mat3 = m.fixed_view::<3, 3>(0, 0).into();
    check_rotation(what, &r)?;
    // Some files leave the last row zero.
    let last = m.row(3);
    if last.norm() > 0.0 && (last - nalgebra::RowVector4::new(0.0, 0.0, 0.0, 1.0)).norm() > 1e-6 {
        return Err(CalibrationError(format!("{what}: the last row must be 0 0 0 1")));
    }
    Ok(Se3::from_matrix(&m))
}

/// A lens by its name in Cairn's own files; the names of the other formats are accepted too.
pub fn lens(name: &str, c: &[f64]) -> Result<Distortion, CalibrationError> {
    let counted = |wanted: &str| {
        CalibrationError(format!("{name} distortion needs {wanted} coefficients, here are {}", c.len()))
    };
    match name.to_ascii_lowercase().as_str() {
        "none" | "" => match c.iter().find(|v| **v != 0.0) {
            Some(v) => Err(CalibrationError(format!("distortion is \"none\", but a coefficient is {v}"))),
            None => Ok(Distortion::None),
        },
        "radtan"
        | "radial-tangential"
        | "radialtangential"
        | "radialtangential8"
        | "plumb_bob"
        | "pinhole-radtan8"
        | "rational_polynomial"
        | "rational" => match *c {
            [k1, k2, p1, p2] => Ok(Distortion::RadialTangential([k1, k2, p1, p2, 0.0])),
            [k1, k2, p1, p2, k3] => Ok(Distortion::RadialTangential([k1, k2, p1, p2, k3])),
            // Of OpenCV's twelve and fourteen the last are thin prism and tilt.
            [k1, k2, p1, p2, k3, k4, k5, k6, ref rest @ ..] if rest.iter().all(|v| *v == 0.0) => {
                Ok(Distortion::Rational([k1, k2, p1, p2, k3, k4, k5, k6]))
            }
            _ => Err(counted("4, 5 or 8")),
        },
        "inverse-radial-tangential" | "inverse_brown_conrady" => match *c {
            [k1, k2, p1, p2, k3] => Ok(Distortion::InverseRadialTangential([k1, k2, p1, p2, k3])),
            _ => Err(counted("5")),
        },
        "equi" | "equidistant" | "kannala_brandt" | "kannala-brandt" | "kb4" => match *c {
            [k1, k2, k3, k4] => Ok(Distortion::Equidistant([k1, k2, k3, k4])),
            _ => Err(counted("4")),
        },
        "fov" => match *c {
            [w] => Ok(Distortion::Fov(w)),
            _ => Err(counted("1")),
        },
        "double-sphere" => match *c {
            [xi, alpha] => Ok(Distortion::DoubleSphere { xi, alpha }),
            _ => Err(counted("2")),
        },
        "unified" => match *c {
            [xi, k1, k2, p1, p2] => Ok(Distortion::Unified([xi, k1, k2, p1, p2])),
            _ => Err(counted("5")),
        },
        "extended-unified" => match *c {
            [alpha, beta] => Ok(Distortion::ExtendedUnified { alpha, beta }),
            _ => Err(counted("2")),
        },
        "division" => match *c {
            [k] => Ok(Distortion::Division(k)),
            _ => Err(counted("1")),
        },
        other => Err(CalibrationError(format!(
            "distortion \"{other}\" is not known (none, radtan, rational, inverse-radial-tangential, equidistant, fov, double-sphere, unified, extended-unified, division are)"
        ))),
    }
}
