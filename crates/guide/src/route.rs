//! A recorded way: points that hang on key frames and follow them when the map moves.

use crate::ground::Ground;
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_sensor::Stamp;
use serde::{Deserialize, Serialize};

/// The name of a key frame: which robot made it and its number there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Anchor {
    /// The robot.
    pub robot: u16,
    /// The key frame's number, never used again.
    pub seq: u32,
}

/// How far a pose can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Confidence {
    /// Tracked on the map.
    Good,
    /// Bridged by inertial or rotation-only tracking: good enough to go on with, marked.
    Low,
    /// No pose that anyone should walk by.
    Lost,
}

/// How the stretch from the point before to this one is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stretch {
    /// Tracked.
    Tracked,
    /// Bridged while the map was lost: low confidence.
    Bridged,
    /// Nothing is known but the two ends.
    Gap,
}

/// One recorded point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoutePoint {
    /// When.
    #[serde(rename = "t", with = "stamp_ns")]
    pub stamp: Stamp,
    /// The key frame it hangs on.
    #[serde(rename = "a")]
    pub anchor: Anchor,
    /// Where the camera was, seen from that key frame.
    #[serde(rename = "rel", with = "seven")]
    pub anchor_from_camera: Se3,
    /// Where the camera was in the smooth frame, for stretches whose key frame is gone.
    #[serde(rename = "pose", with = "seven")]
    pub odom_from_camera: Se3,
    /// How the stretch before it is known.
    #[serde(rename = "s")]
    pub stretch: Stretch,
    /// Tracking quality, 0 to 1.
    #[serde(rename = "q")]
    pub quality: f32,
}

/// The first line of a file holds this for the whole way; a later line of the same form replaces what the lines before it
/// told, as when the scale is found while the way is recorded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RouteHeader {
    /// Always [`RouteHeader::FORMAT`].
    pub format: String,
    /// Version of the file form; this program reads [`RouteHeader::VERSION`].
    pub version: u32,
    /// True when lengths are metres; false when the scale is not known and only relative words may be said.
    pub metric: bool,
    /// The direction that points up in the frame of the poses.
    pub up: [f64; 3],
    /// What it was recorded from, for people.
    pub source: String,
    /// Carries the recorded poses before this line into the frame and the unit of those after it:
    /// `[x, y, z, qx, qy, qz, qw, scale]`. Only in a later line.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "eight")]
    pub carried: Option<Sim3>,
}

impl RouteHeader {
    /// The name of the form.
    pub const FORMAT: &'static str = "cairn-route";
    /// What files written before that name say.
    pub const FORMER_FORMAT: &'static str = "cairn-way";
    /// The version written.
    pub const VERSION: u32 = 1;

    /// A header for poses in a frame with this ground.
    pub fn new(metric: bool, ground: &Ground, source: impl Into<String>) -> Self {
        let up = ground.up();
        let format = Self::FORMAT.to_owned();
        let source = source.into();
        Self { format, version: Self::VERSION, metric, up: [up.x, up.y, up.z], source, carried: None }
    }

    /// The ground plane of the poses; z up when the header's direction is none.
    pub fn ground(&self) -> Ground {
        Ground::new(Vec3::from(self.up)).unwrap_or_else(Ground::z_up)
    }
}

/// A recorded way, always kept as it was recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    /// What holds for all of it.
    pub header: RouteHeader,
    /// The points in the order of time.
    pub points: Vec<RoutePoint>,
    /// True when the file's last line was torn by a crash and left out.
    pub torn: bool,
}

/// A point of a way, placed in the frame of today's map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedPoint {
    /// When it was recorded.
    pub stamp: Stamp,
    /// Where the camera was.
    pub frame_from_camera: Se3,
    /// How the stretch before it is known.
    pub stretch: Stretch,
    /// False when its key frame is gone and it was placed by its neighbour.
    pub anchored: bool,
}

impl Route {
    /// A way without points.
    pub fn new(header: RouteHeader) -> Self {
        Self { header, points: Vec::new(), torn: false }
    }

    /// Takes a later header: the poses recorded so far are carried into its frame and unit.
    pub fn go_on_as(&mut self, mut header: RouteHeader) {
        if let Some(carried) = header.carried.take() {
            let poses = self.points.iter_mut().map(|p| &mut p.odom_from_camera);
            poses.for_each(|pose| *pose = carried.transform_pose(pose));
        }
        self.header = header;
    }

    /// Hangs points whose key frame is not known on the key frame of the nearest point before that has a known one (for
    /// the first points: after), where the recorded poses put them. Returns how many; `None` when no key frame is known.
    pub fn reanchor(&mut self, known: impl Fn(Anchor) -> bool) -> Option<usize> {
        let first = *self.points.iter().find(|p| known(p.anchor))?;
        let (mut near, mut count) = (first, 0);
        for p in &mut self.points {
            if known(p.anchor) {
                near = *p;
                continue;
            }
            let near_from_here = near.odom_from_camera.inverse() * p.odom_from_camera;
            (p.anchor, p.anchor_from_camera) = (near.anchor, near.anchor_from_camera * near_from_here);
            count += 1;
        }
        Some(count)
    }

    /// Places every point where its key frame is now.
    ///
    /// `frame_from_anchor` gives the pose of a key frame in the wanted frame (the world, or `odom` for
    /// guidance) with what its unit of length is there, `None` for one that is gone. Such a point keeps its recorded place relative to the
    /// nearest placed neighbour; when no key frame is known at all, the recorded poses are given.
    pub fn resolve(&self, frame_from_anchor: impl Fn(Anchor) -> Option<Sim3>) -> Vec<PlacedPoint> {
        let by_anchor: Vec<Option<Se3>> = (self.points.iter())
            .map(|p| {
                let frame_from_anchor = frame_from_anchor(p.anchor).filter(Sim3::is_finite)?;
                Some(frame_from_anchor.transform_pose(&p.anchor_from_camera))
            })
            .collect();
        let first = by_anchor.iter().zip(&self.points).find_map(|(placed, p)| placed.map(|t| (t, p)));
        // What carries recorded poses into the wanted frame, from the last point that could be placed.
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

    /// The points as they were recorded, in the smooth frame of that day.
    pub fn as_recorded(&self) -> Vec<PlacedPoint> {
        self.resolve(|_| None)
    }

    /// Metres per unit of the poses: 1 for a metric way; else a guess that the walker went at 0.8 m/s
    /// (median over the moving parts), good enough for when to speak but not for words.
    pub fn metres_per_unit(&self) -> f64 {
        const USUAL_SPEED: f64 = 0.8;
        if self.header.metric {
            return 1.0;
        }
        let mut speeds: Vec<f64> = (self.points.windows(2))
            .filter(|w| w[1].stretch == Stretch::Tracked && w[1].stamp > w[0].stamp)
            .map(|w| {
                let step = w[1].odom_from_camera.translation - w[0].odom_from_camera.translation;
                step.norm() / (w[1].stamp - w[0].stamp)
            })
            .filter(|v| v.is_finite() && *v > 1e-6)
            .collect();
        speeds.sort_by(f64::total_cmp);
        speeds.get(speeds.len() / 2).map_or(1.0, |v| USUAL_SPEED / v)
    }
}

mod stamp_ns {
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
mod eight {
    use super::{Sim3, So3, Vec3};
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
mod seven {
    use super::{Se3, So3, Vec3};
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

#[cfg(test)]
mod tests {
    use super::*;

    fn anchor(seq: u32) -> Anchor {
        Anchor { robot: 0, seq }
    }

    #[test]
    fn points_of_unknown_key_frames_hang_on_known_ones_and_stay_where_they_were() {
        let places = |route: &Route, known: &dyn Fn(u32) -> bool| -> Vec<Vec3> {
            let at = |seq: u32| Sim3::from(Se3::new(So3::identity(), Vec3::new((5 * seq) as f64, 0.0, 0.0)));
            let placed = route.resolve(|a| known(a.seq).then(|| at(a.seq)));
            assert!(placed.iter().all(|p| p.anchored));
            placed.iter().map(|p| p.frame_from_camera.translation).collect()
        };
        let before = places(&route(), &|_| true);
        for known in [0, 1] {
            let mut route = route();
            assert_eq!(route.reanchor(|a| a.seq == known), Some(5));
            for (a, b) in places(&route, &|seq| seq == known).iter().zip(&before) {
                assert!((a - b).norm() < 1e-12, "{a} {b}");
            }
            assert_eq!(route.reanchor(|a| a.seq == known), Some(0));
        }
        let mut nowhere = route();
        assert_eq!(nowhere.reanchor(|_| false), None);
        assert_eq!(nowhere, route());
    }

    fn route() -> Route {
        let mut route = Route::new(RouteHeader::new(true, &Ground::z_up(), "test"));
        for k in 0..10u32 {
            // Key frame k / 5 stands at x = 5 * (k / 5); the camera goes one metre a point.
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
    fn points_follow_their_key_frames() {
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
    fn a_lost_key_frame_is_bridged_by_its_neighbours() {
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
    fn without_scale_the_usual_speed_gives_the_unit() {
        let mut route = route();
        route.header.metric = false;
        for (k, p) in route.points.iter_mut().enumerate() {
            p.stamp = Stamp::from_seconds(10.0 * k as f64);
        }
        // One unit in ten seconds is 0.1 units a second: 8 metres a unit.
        assert!((route.metres_per_unit() - 8.0).abs() < 1e-9);
    }
}
