//! A path as a polyline with arc length: where a body is along it, how far beside it, and what lies ahead.

use cairn_geometry::Vec2;

/// A point relative to a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Distance along the path to its nearest point, in metres.
    pub along_m: f64,
    /// Lateral offset in metres, positive on the left.
    pub lateral_m: f64,
}

/// How far a body has come along a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Progress {
    /// Where it is.
    pub projection: Projection,
    /// Metres from there to the end.
    pub left_m: f64,
    /// Whether it is at the end.
    pub at_end: bool,
}

/// A polyline with arc length.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferencePath {
    points: Vec<Vec2>,
    along: Vec<f64>,
}

impl ReferencePath {
    /// From points in metres, world. Consecutive duplicates are dropped; `None` if a point is not finite or there is no
    /// point at all.
    pub fn new(line: &[Vec2]) -> Option<Self> {
        let mut points: Vec<Vec2> = Vec::with_capacity(line.len());
        let mut along = Vec::with_capacity(line.len());
        for &point in line {
            if !point.iter().all(|v| v.is_finite()) {
                return None;
            }
            let gone = points.last().map(|last| (point - last).norm());
            if gone.is_none_or(|g| g > 1e-9) {
                along.push(along.last().copied().unwrap_or(0.0) + gone.unwrap_or(0.0));
                points.push(point);
            }
        }
        (!points.is_empty()).then_some(Self { points, along })
    }

    /// Length in metres.
    pub fn length_m(&self) -> f64 {
        self.along.last().copied().unwrap_or(0.0)
    }

    /// All points.
    pub fn points(&self) -> &[Vec2] {
        &self.points
    }

    /// The last point.
    pub fn end(&self) -> Vec2 {
        self.points.last().copied().unwrap_or_default()
    }

    /// Index of the first point of the segment that contains a distance along the path.
    fn segment(&self, along_m: f64) -> usize {
        let after = self.along.partition_point(|&a| a <= along_m);
        after.saturating_sub(1).min(self.points.len().saturating_sub(2))
    }

    /// The point at this distance along the path, and the direction there (unit length; zero for a path of one point).
    pub fn at(&self, along_m: f64) -> (Vec2, Vec2) {
        let i = self.segment(along_m);
        let (Some(&a), Some(&b)) = (self.points.get(i), self.points.get(i + 1)) else {
            return (self.end(), Vec2::zeros());
        };
        let direction = (b - a) / (self.along[i + 1] - self.along[i]);
        let along = along_m.clamp(0.0, self.length_m());
        (a + direction * (along - self.along[i]), direction)
    }

    /// The nearest point of the path between two distances along it.
    pub fn project(&self, point: Vec2, from_m: f64, to_m: f64) -> Projection {
        let (first, last) = (self.segment(from_m.max(0.0)), self.segment(to_m.max(from_m)));
        let mut best = (f64::INFINITY, Projection { along_m: from_m.max(0.0), lateral_m: 0.0 });
        for i in first..=last {
            let (Some(&a), Some(&b)) = (self.points.get(i), self.points.get(i + 1)) else { break };
            let long = self.along[i + 1] - self.along[i];
            let direction = (b - a) / long;
            let gone = direction.dot(&(point - a)).clamp(0.0, long);
            let off = point - (a + direction * gone);
            if off.norm_squared() < best.0 {
                let side = if direction.perp(&off) < 0.0 { -1.0 } else { 1.0 };
                let lateral_m = side * off.norm();
                best = (off.norm_squared(), Projection { along_m: self.along[i] + gone, lateral_m });
            }
        }
        best.1
    }

    /// How far a body has come that was at `along_m` a step ago; the end is reached within a tolerance.
    pub(super) fn progress(&self, point: Vec2, along_m: f64, tolerance_m: f64) -> Progress {
        let projection = self.project(point, along_m - 0.3, along_m + 1.0);
        let left_m = self.length_m() - projection.along_m;
        let at_end = (self.end() - point).norm() <= tolerance_m && left_m <= 2.0 * tolerance_m;
        Progress { projection, left_m, at_end }
    }

    /// Curvature at this distance along the path in 1/m, positive to the left: the change of direction over `span_m`
    /// around it.
    pub fn curvature(&self, along_m: f64, span_m: f64) -> f64 {
        let (_, before) = self.at((along_m - 0.5 * span_m).max(0.0));
        let (_, after) = self.at((along_m + 0.5 * span_m).min(self.length_m()));
        before.perp(&after).atan2(before.dot(&after)) / span_m
    }
}
