//! A recorded route: points that are anchored to keyframes and follow them when the map is corrected.

use crate::anchor::{Anchor, eight, seven, stamp_ns};
use crate::ground::Ground;
use crate::notes::RouteNote;
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_sensor::Stamp;
use serde::{Deserialize, Serialize};

/// How far a pose can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Confidence {
    /// Tracked against the map.
    Good,
    /// Bridged by inertial or rotation-only tracking: good enough to continue, and marked.
    Low,
    /// No pose that is safe to walk by.
    Lost,
}

/// How the stretch from the previous point to this one is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stretch {
    /// Tracked.
    Tracked,
    /// Bridged while tracking was lost: low confidence.
    Bridged,
    /// A gap: only the two ends are known.
    Gap,
}

/// One recorded point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoutePoint {
    /// Time of the pose.
    #[serde(rename = "t", with = "stamp_ns")]
    pub stamp: Stamp,
    /// The keyframe it is anchored to.
    #[serde(rename = "a")]
    pub anchor: Anchor,
    /// Pose of the camera in that keyframe.
    #[serde(rename = "rel", with = "seven")]
    pub anchor_from_camera: Se3,
    /// Pose of the camera in the odom frame, for stretches whose keyframe is gone.
    #[serde(rename = "pose", with = "seven")]
    pub odom_from_camera: Se3,
    /// How the stretch before this point is known.
    #[serde(rename = "s")]
    pub stretch: Stretch,
    /// Tracking quality, 0 to 1.
    #[serde(rename = "q")]
    pub quality: f32,
}

/// The first line of a file holds this for the whole route; a later line of the same form replaces the earlier
/// ones, as when the scale is initialised while the route is being recorded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RouteHeader {
    /// Always [`RouteHeader::FORMAT`].
    pub format: String,
    /// Version of the file format; this program reads [`RouteHeader::VERSION`].
    pub version: u32,
    /// True when lengths are metres; false when the scale is unknown and only relative words may be said.
    pub metric: bool,
    /// The up direction in the frame of the poses.
    pub up: [f64; 3],
    /// A description of the source it was recorded from, for people.
    pub source: String,
    /// Transforms the recorded poses before this line into the frame and the unit of those after it:
    /// `[x, y, z, qx, qy, qz, qw, scale]`. Only in a later line.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "eight")]
    pub carried: Option<Sim3>,
    /// The name that its walker gave it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// When its recording began: seconds since 1970-01-01 00:00 UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded_s: Option<i64>,
    /// The identity of the atlas in whose key frames it is anchored, where that atlas is kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub atlas: Option<String>,
    /// True where it was recorded with a lens that was a guess: its lengths may be wrong by a third, and its turns by as much.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub lens_guessed: bool,
}

impl RouteHeader {
    /// The name of the format.
    pub const FORMAT: &'static str = "cairn-route";
    /// The name of the format in older files.
    pub const FORMER_FORMAT: &'static str = "cairn-way";
    /// The version written.
    pub const VERSION: u32 = 1;

    /// A header for poses in a frame with this ground.
    pub fn new(metric: bool, ground: &Ground, source: impl Into<String>) -> Self {
        let up = ground.up();
        let format = Self::FORMAT.to_owned();
        let source = source.into();
        Self {
            format,
            version: Self::VERSION,
            metric,
            up: [up.x, up.y, up.z],
            source,
            carried: None,
            name: None,
            recorded_s: None,
            atlas: None,
            lens_guessed: false,
        }
    }

    /// The ground plane of the poses; z up when the header's direction is not usable.
    pub fn ground(&self) -> Ground {
        Ground::new(Vec3::from(self.up)).unwrap_or_else(Ground::z_up)
    }
}

/// A recorded route, always kept as it was recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    /// The header.
    pub header: RouteHeader,
    /// The points in the order of time.
    pub points: Vec<RoutePoint>,
    /// What the walker noted along it, in the order of time.
    pub notes: Vec<RouteNote>,
    /// True when the file's last line was truncated by a crash and left out.
    pub torn: bool,
}

/// A point of a route, resolved in a frame of the current map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedPoint {
    /// When it was recorded.
    pub stamp: Stamp,
    /// Pose of the camera.
    pub frame_from_camera: Se3,
    /// How the stretch before it is known.
    pub stretch: Stretch,
    /// False when its keyframe is gone and it was placed relative to its neighbour.
    pub anchored: bool,
}

impl RoutePoint {
    /// The pose of a camera beside this point in the key frame that it is anchored to: `here_from_other` is in the unit of the recorded
    /// poses, of which a unit of that key frame is so many.
    pub(crate) fn beside(&self, here_from_other: &Se3, unit: f64) -> Se3 {
        let there = Se3::new(here_from_other.rotation, here_from_other.translation / unit);
        self.anchor_from_camera * there
    }
}

impl Route {
    /// A route without points.
    pub fn new(header: RouteHeader) -> Self {
        Self { header, points: Vec::new(), notes: Vec::new(), torn: false }
    }

    /// Takes a later header: the poses recorded so far are transformed into its frame and unit.
    pub fn apply_header(&mut self, mut header: RouteHeader) {
        if let Some(carried) = header.carried.take() {
            let notes = self.notes.iter_mut().map(|n| &mut n.odom_from_camera);
            let poses = self.points.iter_mut().map(|p| &mut p.odom_from_camera).chain(notes);
            poses.for_each(|pose| *pose = carried.transform_pose(pose));
        }
        self.header = header;
    }

    /// Re-anchors points whose keyframe is unknown to the keyframe of the nearest earlier point that has a known one
    /// (for the first points: later), at their recorded relative pose. Returns how many; `None` when no keyframe is
    /// known. Notes are re-anchored likewise, to the nearest point in time.
    ///
    /// `unit` is the length of a known keyframe's unit in that of the recorded poses.
    pub fn reanchor(&mut self, unit: impl Fn(Anchor) -> Option<f64>) -> Option<usize> {
        let known = |p: &RoutePoint| Some((*p, unit(p.anchor)?));
        let first = self.points.iter().find_map(known)?;
        let near_in_time = |stamp: Stamp, points: &[RoutePoint]| {
            let later = points.partition_point(|p| p.stamp < stamp);
            points[..later].iter().rev().chain(&points[later..]).find_map(known)
        };
        for note in self.notes.iter_mut().filter(|n| unit(n.anchor).is_none()) {
            let (near, unit) = near_in_time(note.stamp, &self.points).unwrap_or(first);
            let near_from_here = near.odom_from_camera.inverse() * note.odom_from_camera;
            (note.anchor, note.anchor_from_camera) = (near.anchor, near.beside(&near_from_here, unit));
        }
        let (mut near, mut count) = (first, 0);
        for p in &mut self.points {
            if let Some(unit) = unit(p.anchor) {
                near = (*p, unit);
                continue;
            }
            let (near, unit) = near;
            let near_from_here = near.odom_from_camera.inverse() * p.odom_from_camera;
            (p.anchor, p.anchor_from_camera) = (near.anchor, near.beside(&near_from_here, unit));
            count += 1;
        }
        Some(count)
    }

    /// Resolves every point to the present pose of its keyframe.
    ///
    /// `frame_from_anchor` returns the pose of a keyframe in the wanted frame (the map, or `odom` for guidance) with
    /// the length of the keyframe's unit there, `None` for one that is gone. Such a point keeps its recorded place
    /// relative to the nearest placed neighbour; when no keyframe is known at all, the recorded poses are returned.
    pub fn resolve(&self, frame_from_anchor: impl Fn(Anchor) -> Option<Sim3>) -> Vec<PlacedPoint> {
        let by_anchor: Vec<Option<Se3>> = (self.points.iter())
            .map(|p| {
                let frame_from_anchor = frame_from_anchor(p.anchor).filter(Sim3::is_finite)?;
                Some(frame_from_anchor.transform_pose(&p.anchor_from_camera))
            })
            .collect();
        let first = by_anchor.iter().zip(&self.points).find_map(|(placed, p)| placed.map(|t| (t, p)));
        // The transform from recorded poses to the wanted frame, from the last point that could be resolved.
        let mut frame_from_odom =
            first.map_or(Se3::identity(), |(placed, p)| placed * p.odom_from_camera.inverse());
        let mut out = Vec::with_capacity(self.points.len());
        for (p, placed) in self.points.iter().zip(by_anchor) {
            if let Some(t) = placed {
                frame_from_odom = t * p.odom_from_camera.inverse();
            }
            out.push(PlacedPoint {
                stamp: p.stamp,
                frame_from_camera: placed.unwrap_or(frame_from_odom * p.odom_from_camera),
                stretch: p.stretch,
                anchored: placed.is_some(),
            });
        }
        out
    }

    /// Resolves every note as [`Route::resolve`] does the points: the pose of the camera where it was taken. A note whose
    /// keyframe is gone keeps its recorded place relative to the nearest placed point in time.
    pub fn resolve_notes(&self, frame_from_anchor: impl Fn(Anchor) -> Option<Sim3>) -> Vec<Se3> {
        let mut placed_points = None;
        let mut place = |note: &RouteNote| {
            if let Some(frame_from_anchor) = frame_from_anchor(note.anchor).filter(Sim3::is_finite) {
                return frame_from_anchor.transform_pose(&note.anchor_from_camera);
            }
            let placed = placed_points.get_or_insert_with(|| self.resolve(&frame_from_anchor));
            let near =
                (self.points.iter().zip(placed.iter())).min_by_key(|(p, _)| p.stamp.0.abs_diff(note.stamp.0));
            near.map_or(note.odom_from_camera, |(p, placed)| {
                placed.frame_from_camera * p.odom_from_camera.inverse() * note.odom_from_camera
            })
        };
        self.notes.iter().map(&mut place).collect()
    }

    /// The points as they were recorded, in the odom frame of that recording.
    pub fn as_recorded(&self) -> Vec<PlacedPoint> {
        self.resolve(|_| None)
    }

    /// Metres per unit of the poses: 1 for a metric route; else an estimate that the walker moved at 0.8 m/s
    /// (median over the moving parts), good enough for when to speak but not for words. `placed` are the points in the
    /// frame whose unit it is.
    pub fn metres_per_unit(&self, placed: &[PlacedPoint]) -> f64 {
        const USUAL_SPEED: f64 = 0.8;
        if self.header.metric {
            return 1.0;
        }
        let mut speeds: Vec<f64> = (placed.windows(2))
            .filter(|w| w[1].stretch == Stretch::Tracked && w[1].stamp > w[0].stamp)
            .map(|w| {
                let step = w[1].frame_from_camera.translation - w[0].frame_from_camera.translation;
                step.norm() / (w[1].stamp - w[0].stamp)
            })
            .filter(|v| v.is_finite() && *v > 1e-6)
            .collect();
        speeds.sort_by(f64::total_cmp);
        speeds.get(speeds.len() / 2).map_or(1.0, |v| USUAL_SPEED / v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::So3;

    fn anchor(seq: u32) -> Anchor {
        Anchor { robot: 0, seq }
    }

    #[test]
    fn points_of_unknown_keyframes_are_re_anchored_in_place() {
        let places = |route: &Route, known: &dyn Fn(u32) -> bool| -> Vec<Vec3> {
            let at = |seq: u32| Sim3::from(Se3::new(So3::identity(), Vec3::new((5 * seq) as f64, 0.0, 0.0)));
            let placed = route.resolve(|a| known(a.seq).then(|| at(a.seq)));
            assert!(placed.iter().all(|p| p.anchored));
            placed.iter().map(|p| p.frame_from_camera.translation).collect()
        };
        let before = places(&route(), &|_| true);
        for known in [0, 1] {
            let mut route = route();
            assert_eq!(route.reanchor(|a| (a.seq == known).then_some(1.0)), Some(5));
            for (a, b) in places(&route, &|seq| seq == known).iter().zip(&before) {
                assert!((a - b).norm() < 1e-12, "{a} {b}");
            }
            assert_eq!(route.reanchor(|a| (a.seq == known).then_some(1.0)), Some(0));
        }
        let mut nowhere = route();
        assert_eq!(nowhere.reanchor(|_| None), None);
        assert_eq!(nowhere, route());
    }

    fn route() -> Route {
        let mut route = Route::new(RouteHeader::new(true, &Ground::z_up(), "test"));
        for k in 0..10u32 {
            // Keyframe k / 5 is at x = 5 * (k / 5); the camera moves one metre a point.
            let odom = Se3::new(So3::identity(), Vec3::new(k as f64, 0.0, 0.0));
            let key = Se3::new(So3::identity(), Vec3::new((k / 5 * 5) as f64, 0.0, 0.0));
            route.points.push(RoutePoint {
                stamp: Stamp(k as i64),
                anchor: anchor(k / 5),
                anchor_from_camera: key.inverse() * odom,
                odom_from_camera: odom,
                stretch: Stretch::Tracked,
                quality: 1.0,
            });
        }
        route
    }

    #[test]
    fn points_follow_their_keyframes() {
        let turned = Se3::new(So3::exp(&Vec3::new(0.0, 0.0, 0.5)), Vec3::new(3.0, -1.0, 0.2));
        let placed = route().resolve(|a| {
            Some((turned * Se3::new(So3::identity(), Vec3::new(5.0 * a.seq as f64, 0.0, 0.0))).into())
        });
        for (k, p) in placed.iter().enumerate() {
            let expected = turned * Vec3::new(k as f64, 0.0, 0.0);
            assert!((p.frame_from_camera.translation - expected).norm() < 1e-12);
            assert!(p.anchored);
        }
    }

    #[test]
    fn points_of_a_lost_keyframe_follow_their_neighbours() {
        let moved = Se3::new(So3::identity(), Vec3::new(0.0, 7.0, 0.0));
        for gone in [0, 1] {
            let placed = route().resolve(|a| {
                let key = Se3::new(So3::identity(), Vec3::new(5.0 * a.seq as f64, 0.0, 0.0));
                (a.seq != gone).then(|| (moved * key).into())
            });
            for (k, p) in placed.iter().enumerate() {
                assert!((p.frame_from_camera.translation - Vec3::new(k as f64, 7.0, 0.0)).norm() < 1e-12);
                assert_eq!(p.anchored, k as u32 / 5 != gone);
            }
        }
        assert_eq!(route().as_recorded()[9].frame_from_camera.translation.x, 9.0);
    }

    #[test]
    fn unit_without_scale_comes_from_walking_speed() {
        let mut route = route();
        route.header.metric = false;
        for (k, p) in route.points.iter_mut().enumerate() {
            p.stamp = Stamp::from_seconds(10.0 * k as f64);
        }
        // One unit in ten seconds is 0.1 units a second: 8 metres a unit.
        assert!((route.metres_per_unit(&route.as_recorded()) - 8.0).abs() < 1e-9);
    }
}
