//! Which landmarks a camera should see from a pose: the one query of tracking, recognition of places, fusion, and of what
//! is said about the way back. A landmark is in view where its pixel lies inside the image, at a distance at which the
//! detector finds it, from a side from which it was seen before (Mur-Artal et al. 2015, section V-D).

use crate::Landmark;
use cairn_geometry::{Mat3, Se3, Vec3};
use cairn_vision::RectifiedCamera;

/// Cosine of the angle, 60 degrees, between the view and the views so far up to which a landmark is recognised.
const LEAST_COSINE: f64 = 0.5;
/// By how much the range of distances is widened at either end.
const SLACK: [f64; 2] = [0.8, 1.2];

/// A camera at a pose.
#[derive(Clone, Debug)]
pub struct Viewpoint<'a> {
    camera: &'a RectifiedCamera,
    rotation: Mat3,
    translation: Vec3,
    centre: Vec3,
    focal_ratio: f64,
}

/// How a landmark in view should appear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Pixel and right x.
    pub pixel: [f64; 3],
    /// From the camera's centre, in map units.
    pub distance: f64,
    /// Greatest distance at which this camera would find it.
    pub farthest: f64,
    /// Cosine of the angle between the view and the mean view so far.
    pub cosine: f64,
}

impl<'a> Viewpoint<'a> {
    /// The atlas's camera at a pose.
    pub fn new(camera: &'a RectifiedCamera, world_from_camera: &Se3) -> Self {
        Self::of_camera(camera, world_from_camera, 1.0)
    }

    /// Another camera; `focal_ratio` is its focal length over that of the atlas's.
    pub fn of_camera(camera: &'a RectifiedCamera, world_from_camera: &Se3, focal_ratio: f64) -> Self {
        let camera_from_world = world_from_camera.inverse();
        let (rotation, translation) = (camera_from_world.rotation.matrix(), camera_from_world.translation);
        Self { camera, rotation, translation, centre: world_from_camera.translation, focal_ratio }
    }

    /// How a landmark appears; `None` where it is not in view.
    #[inline]
    pub fn sees(&self, landmark: &Landmark) -> Option<Sighting> {
        self.sees_along(landmark, &landmark.normal)
    }

    /// The same for a landmark that was seen along `direction` (unit length), in place of the mean of its views.
    #[inline]
    pub fn sees_along(&self, landmark: &Landmark, direction: &Vec3) -> Option<Sighting> {
        let q = self.rotation * landmark.position + self.translation;
        let pixel = self.camera.project(&q)?;
        if !self.camera.contains(pixel[0], pixel[1]) {
            return None;
        }
        let distance = q.norm();
        let [nearest, farthest] =
            [landmark.min_distance, landmark.max_distance].map(|d| d * self.focal_ratio);
        if distance < SLACK[0] * nearest || distance > SLACK[1] * farthest {
            return None;
        }
        let cosine = (landmark.position - self.centre).dot(direction) / distance;
        (cosine >= LEAST_COSINE).then_some(Sighting { pixel, distance, farthest, cosine })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::LandmarkId;
    use cairn_geometry::So3;

    fn camera() -> RectifiedCamera {
        RectifiedCamera {
            fx: 100.0,
            fy: 100.0,
            cx: 50.0,
            cy: 50.0,
            baseline_fx: 0.0,
            bounds: [0.0, 0.0, 100.0, 100.0],
            close_depth: 0.0,
            body_from_camera: Se3::identity(),
        }
    }

    /// Four metres ahead of the origin, seen from there, found from 2 to 6 m.
    fn landmark() -> Landmark {
        let mut l = Landmark::new(LandmarkId::from_index(0).unwrap(), Vec3::new(0.0, 0.0, 4.0));
        (l.normal, l.min_distance, l.max_distance) = (Vec3::z(), 2.0, 6.0);
        l
    }

    fn seen_at(position: Vec3, turned_deg: f64) -> Option<Sighting> {
        let turn = So3::exp(&(Vec3::y() * turned_deg.to_radians()));
        Viewpoint::new(&camera(), &Se3::new(turn, position)).sees(&landmark())
    }

    #[test]
    fn a_landmark_in_view_is_seen_where_it_projects() {
        let seen = seen_at(Vec3::new(-0.4, 0.0, 0.0), 0.0).unwrap();
        assert!((seen.pixel[0] - 60.0).abs() < 1e-9 && (seen.pixel[1] - 50.0).abs() < 1e-9, "{seen:?}");
        assert!((seen.distance - 16.16f64.sqrt()).abs() < 1e-12 && seen.farthest == 6.0, "{seen:?}");
        assert!((seen.cosine - 4.0 / seen.distance).abs() < 1e-12, "{seen:?}");
    }

    #[test]
    fn outside_the_image_too_near_too_far_and_from_behind_it_is_not() {
        assert!(seen_at(Vec3::zeros(), 25.0).is_some() && seen_at(Vec3::zeros(), 28.0).is_none(), "image");
        assert!(seen_at(Vec3::zeros(), 180.0).is_none(), "behind the camera");
        for (z, seen) in [(2.3, true), (2.5, false), (-3.1, true), (-3.3, false)] {
            assert_eq!(seen_at(Vec3::new(0.0, 0.0, z), 0.0).is_some(), seen, "{} m away", 4.0 - z);
        }
        // From the side, facing it: up to 60 degrees from where it was seen.
        for (degrees, seen) in [(58.0_f64, true), (62.0, false)] {
            let (s, c) = degrees.to_radians().sin_cos();
            let at = Vec3::new(4.0 * s, 0.0, 4.0 - 4.0 * c);
            assert_eq!(seen_at(at, -degrees).is_some(), seen, "{degrees} degrees");
        }
    }

    #[test]
    fn a_longer_lens_finds_it_farther_away_and_another_view_counts_in_its_place() {
        let far = Se3::new(So3::identity(), Vec3::new(0.0, 0.0, -8.0));
        let camera = camera();
        assert!(Viewpoint::new(&camera, &far).sees(&landmark()).is_none());
        assert_eq!(Viewpoint::of_camera(&camera, &far, 2.0).sees(&landmark()).unwrap().farthest, 12.0);
        let here = Se3::default();
        assert!(Viewpoint::new(&camera, &here).sees_along(&landmark(), &-Vec3::z()).is_none());
    }
}
