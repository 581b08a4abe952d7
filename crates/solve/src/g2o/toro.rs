//! Pose graphs of TORO and iSAM as g2o text, line by line, so that errors name the lines of the original.
//!
//! In: `VERTEX2 id x y angle`, `EDGE2` (also `ODOMETRY`, `Constraint2`) `a b x y angle` with six numbers of its information,
//! `VERTEX3` (`POSE3D_INIT`) and `EDGE3` with roll, pitch, yaw and 21 numbers, `LANDMARK` and `POINT3`. Sources: Grisetti et al.,
//! "A tree parameterization for efficiently computing maximum likelihood maps" (2007), and the format of its program; Kaess,
//! Ranganathan and Dellaert, "iSAM: incremental smoothing and mapping" (2008), and the format of its program.
//!
//! What the two write alike but mean otherwise is decided by the content of the whole text:
//! - six numbers are in TORO's order (11, 12, 22, 33, 13, 23) where that gives positive semi-definite matrices, else by rows;
//! - iSAM's own tags mean square roots of information matrices, by rows; otherwise the numbers are the information;
//! - an edge leads from its first vertex to its second, or the other way round where that fits the vertices of the text.

use crate::graph::semi_definite;
use crate::text::{TextError, number, whole};
use cairn_geometry::{Mat3, Se3, So3, Vec3};
use nalgebra::{DMatrix, Matrix3, SMatrix};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Whose text a graph was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// That of g2o.
    G2o,
    /// That of TORO; its numbers are information matrices.
    Toro,
    /// That of iSAM; its numbers are square roots of information matrices.
    Isam,
}

/// What a line of either is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Vertex,
    Edge,
    Point,
}

/// Tags: what each is, whether it is in the plane, and whether only iSAM writes it.
static TAGS: [(&str, Kind, bool, bool); 9] = [
    ("VERTEX2", Kind::Vertex, true, false),
    ("EDGE2", Kind::Edge, true, false),
    ("Constraint2", Kind::Edge, true, true),
    ("ODOMETRY", Kind::Edge, true, true),
    ("LANDMARK", Kind::Point, true, true),
    ("VERTEX3", Kind::Vertex, false, false),
    ("POSE3D_INIT", Kind::Vertex, false, true),
    ("EDGE3", Kind::Edge, false, false),
    ("POINT3", Kind::Point, false, true),
];

struct Row {
    line: usize,
    kind: Kind,
    plane: bool,
    ids: [u64; 2],
    numbers: Vec<f64>,
}

/// The text as g2o text, and whose it was; a text without tags of TORO or iSAM is given back as it is.
///
/// # Errors
/// With the line: numbers that are missing, too many or not finite.
pub fn as_g2o(text: &str) -> Result<(Cow<'_, str>, Form), TextError> {
    let tags = || text.lines().filter_map(|line| line.split_whitespace().next());
    let known = |tag: &str| TAGS.iter().find(|known| known.0 == tag);
    if !tags().any(|tag| known(tag).is_some()) {
        return Ok((Cow::Borrowed(text), Form::G2o));
    }
    let form = if tags().filter_map(known).any(|known| known.3) { Form::Isam } else { Form::Toro };
    let mut rows = Vec::new();
    for (k, content) in text.lines().enumerate() {
        let mut words = content.split('#').next().unwrap_or_default().split_whitespace();
        if let Some(&(tag, kind, plane, _)) = words.next().and_then(known) {
            rows.push(row(k + 1, tag, kind, plane, words)?);
        }
    }
    let meaning = Meaning {
        form,
        toro_order: form == Form::Toro
            && rows.iter().all(|row| !row.has_plane_information() || row.is_toro()),
        reversed: reversed(&rows),
        first_point: rows
            .iter()
            .filter(|r| r.kind != Kind::Point)
            .flat_map(|r| r.ids)
            .max()
            .map_or(0, |id| id + 1),
    };
    let mut rows = rows.into_iter().peekable();
    let mut made = String::with_capacity(text.len() * 2);
    for (k, content) in text.lines().enumerate() {
        match rows.next_if(|row| row.line == k + 1) {
            Some(row) => meaning.write(&row, &mut made)?,
            None => made.push_str(content),
        }
        made.push('\n');
    }
    Ok((Cow::Owned(made), form))
}

fn row<'a>(
    line: usize,
    tag: &str,
    kind: Kind,
    plane: bool,
    mut words: impl Iterator<Item = &'a str>,
) -> Result<Row, TextError> {
    let first = whole(&mut words, line, "the id")?;
    let second = if kind == Kind::Vertex { first } else { whole(&mut words, line, "the second id")? };
    let mut words = words.peekable();
    let mut numbers = Vec::new();
    while words.peek().is_some() {
        numbers.push(number(&mut words, line, "an entry")?);
    }
    let row = Row { line, kind, plane, ids: [first, second], numbers };
    let (value, whole) = (row.value_count(), row.value_count() * (row.value_count() + 1) / 2);
    let wanted = if kind == Kind::Vertex { vec![value] } else { vec![value, value + whole] };
    if wanted.contains(&row.numbers.len()) {
        return Ok(row);
    }
    let wanted: Vec<String> = wanted.iter().map(ToString::to_string).collect();
    let why =
        format!("{tag} needs {} numbers after its ids, here are {}", wanted.join(" or "), row.numbers.len());
    Err(TextError::new(line, why))
}

impl Row {
    /// Numbers of the pose or point.
    fn value_count(&self) -> usize {
        match (self.kind, self.plane) {
            (Kind::Point, true) => 2,
            (Kind::Point, false) | (Kind::Vertex | Kind::Edge, true) => 3,
            (Kind::Vertex | Kind::Edge, false) => 6,
        }
    }

    /// The numbers of its information, none where it states none.
    fn information(&self) -> &[f64] {
        &self.numbers[self.value_count()..]
    }

    fn has_plane_information(&self) -> bool {
        self.kind == Kind::Edge && self.plane && !self.information().is_empty()
    }

    /// Whether its six numbers are an information matrix in TORO's order.
    fn is_toro(&self) -> bool {
        match *self.information() {
            [a, b, c, d, e, f] => semi_definite(&SMatrix::<f64, 3, 3>::new(a, b, e, b, c, f, e, f, d)),
            _ => false,
        }
    }

    /// The pose of a vertex or an edge, one in the plane with height zero.
    fn pose(&self) -> Se3 {
        match *self.numbers {
            [x, y, angle, ..] if self.plane => {
                Se3::new(So3::exp(&Vec3::new(0.0, 0.0, angle)), Vec3::new(x, y, 0.0))
            }
            [x, y, z, roll, pitch, yaw, ..] => {
                let about = |axis: Vec3, angle: f64| So3::exp(&(axis * angle));
                let rotation = about(Vec3::z(), yaw) * about(Vec3::y(), pitch) * about(Vec3::x(), roll);
                Se3::new(rotation, Vec3::new(x, y, z))
            }
            _ => Se3::identity(),
        }
    }
}

/// Whether the vertices fit the edges better when each edge leads from its second vertex to its first.
fn reversed(rows: &[Row]) -> bool {
    let of = |kind: Kind| rows.iter().filter(move |row| row.kind == kind);
    let vertices: BTreeMap<u64, Se3> = of(Kind::Vertex).map(|row| (row.ids[0], row.pose())).collect();
    let (mut forward, mut backward) = (0.0, 0.0);
    for edge in of(Kind::Edge) {
        let [Some(a), Some(b)] = edge.ids.map(|id| vertices.get(&id)) else { continue };
        let off = |a: &Se3, b: &Se3| ((*a * edge.pose()).translation - b.translation).norm();
        forward += off(a, b);
        backward += off(b, a);
    }
    backward < 0.5 * forward
}

/// What the numbers of a whole text mean.
struct Meaning {
    form: Form,
    toro_order: bool,
    reversed: bool,
    /// Points have numbers of their own in iSAM: they are counted on from here.
    first_point: u64,
}

impl Meaning {
    /// The line in g2o's form.
    fn write(&self, row: &Row, made: &mut String) -> Result<(), TextError> {
        let [a, b] = row.ids;
        let point =
            || b.checked_add(self.first_point).ok_or_else(|| TextError::new(row.line, "the id is too large"));
        let value = &row.numbers[..row.value_count()];
        let head = match (row.kind, row.plane) {
            (Kind::Vertex, true) => format!("VERTEX_SE2 {a}"),
            (Kind::Vertex, false) => format!("VERTEX_SE3:QUAT {a}"),
            (Kind::Edge, plane) => {
                let [a, b] = if self.reversed { [b, a] } else { [a, b] };
                format!("{} {a} {b}", if plane { "EDGE_SE2" } else { "EDGE_SE3:QUAT" })
            }
            (Kind::Point, true) => format!("EDGE_SE2_XY {a} {}", point()?),
            (Kind::Point, false) => format!("EDGE_SE3_TRACKXYZ {a} {} 0", point()?),
        };
        made.push_str(&head);
        let space = !row.plane && row.kind != Kind::Point;
        if space {
            let (pose, q) = (row.pose(), row.pose().rotation);
            let q = q.quaternion();
            joined(made, [pose.translation.x, pose.translation.y, pose.translation.z, q.i, q.j, q.k, q.w]);
        } else {
            joined(made, value.iter().copied());
        }
        if row.kind != Kind::Vertex {
            let mut matrix = self.information(row);
            if space {
                let by = rotation_vector_from_angles(row.line, row.numbers[3], row.numbers[4])?;
                matrix = by.transpose() * matrix * by;
            }
            let n = matrix.nrows();
            joined(made, (0..n).flat_map(|r| (r..n).map(move |c| (r, c))).map(|at| matrix[at]));
        }
        Ok(())
    }

    /// The information matrix; the identity where none is stated.
    fn information(&self, row: &Row) -> DMatrix<f64> {
        let (n, v) = (row.value_count(), row.information());
        if v.is_empty() {
            return DMatrix::identity(n, n);
        }
        if let ([a, b, c, d, e, f], true) = (v, self.toro_order && row.kind == Kind::Edge && row.plane) {
            return DMatrix::from_row_slice(3, 3, &[*a, *b, *e, *b, *c, *f, *e, *f, *d]);
        }
        let mut upper = DMatrix::zeros(n, n);
        let places = (0..n).flat_map(|r| (r..n).map(move |c| (r, c)));
        places.zip(v).for_each(|(at, v)| upper[at] = *v);
        match self.form {
            Form::Isam => upper.transpose() * upper,
            _ => DMatrix::from_fn(n, n, |r, c| upper[(r.min(c), r.max(c))]),
        }
    }
}

/// What a small rotation vector of the second pose does to x, y, z, roll, pitch and yaw: the inverse of the angles' rates as a
/// rotation of the body (Diebel, "Representing attitude" (2006), eq. 76).
fn rotation_vector_from_angles(line: usize, roll: f64, pitch: f64) -> Result<DMatrix<f64>, TextError> {
    let ((sr, cr), (sp, cp)) = (roll.sin_cos(), pitch.sin_cos());
    let rates: Mat3 = Matrix3::new(1.0, 0.0, -sp, 0.0, cr, sr * cp, 0.0, -sr, cr * cp);
    let inverse = rates.try_inverse().filter(|_| cp.abs() > 1e-6);
    let inverse = inverse
        .ok_or_else(|| TextError::new(line, "a pitch of 90 degrees leaves roll and yaw undetermined"))?;
    let mut whole = DMatrix::identity(6, 6);
    whole.view_mut((3, 3), (3, 3)).copy_from(&inverse);
    Ok(whole)
}

fn joined(made: &mut String, numbers: impl IntoIterator<Item = f64>) {
    for v in numbers {
        // Writing to a string does not fail.
        let _ = write!(made, " {v}");
    }
}
