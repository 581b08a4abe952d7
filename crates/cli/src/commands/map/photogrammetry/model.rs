//! A map as photogrammetry has it: pinhole cameras, views with the features they show, points with the views that show them.

use super::pictures::{Pictures, picture_name};
use super::pinhole::Pinhole;
use cairn::Map;
use cairn_atlas::{KeyFrame, KeyFrameId, LandmarkId, MapId};
use cairn_geometry::{Se3, Vec2, Vec3};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeMap;

/// A point needs this many views.
const MIN_VIEWS: usize = 2;
/// Luminance of points that no picture shows.
const UNKNOWN: u8 = 128;

/// A key frame with its features.
pub struct View {
    pub id: KeyFrameId,
    /// Index of its camera.
    pub camera: usize,
    pub world_from_camera: Se3,
    /// Each feature, and the index of the point that it shows.
    pub features: Vec<(Vec2, Option<usize>)>,
}

impl View {
    /// The name of its picture.
    pub fn name(&self) -> String {
        picture_name(self.id)
    }
}

/// A landmark that several views show.
pub struct Point {
    pub position: Vec3,
    pub luminance: u8,
    /// Mean distance between feature and projection, pixels.
    pub error_px: f64,
    /// Views and their features, as indices.
    pub track: Vec<(usize, usize)>,
}

/// The whole.
pub struct Model {
    /// Whether lengths are metres.
    pub metric: bool,
    pub cameras: Vec<Pinhole>,
    pub views: Vec<View>,
    pub points: Vec<Point>,
}

impl Model {
    /// Of one map of an atlas; with pictures, of those key frames that have one.
    pub fn of(map: &Map, id: MapId, pictures: Option<&Pictures>) -> Self {
        let key_frames: Vec<&KeyFrame> = map
            .snapshot()
            .key_frames_of(id)
            .filter(|k| pictures.is_none_or(|p| p.written.contains(&k.id)))
            .collect();
        let mut cameras = Vec::new();
        let mut views: Vec<View> = key_frames.iter().map(|k| view(k, map.camera(), &mut cameras)).collect();
        let number: BTreeMap<KeyFrameId, usize> =
            key_frames.iter().zip(0..).map(|(k, i)| (k.id, i)).collect();
        let mut points = Vec::new();
        for landmark in map.landmarks(id) {
            let seen = landmark.observations.iter();
            let seen = seen.filter_map(|o| Some((*number.get(&o.key_frame)?, usize::from(o.feature))));
            let errors: Vec<((usize, usize), f64)> = seen
                .filter_map(|(view, feature)| {
                    let View { camera, world_from_camera, features, .. } = &views[view];
                    let projected =
                        cameras[*camera].project(&(world_from_camera.inverse() * landmark.position))?;
                    Some(((view, feature), (features.get(feature)?.0 - projected).norm()))
                })
                .collect();
            if errors.len() < MIN_VIEWS {
                continue;
            }
            for ((view, feature), _) in &errors {
                views[*view].features[*feature].1 = Some(points.len());
            }
            points.push(Point {
                position: landmark.position,
                luminance: luminance(pictures, landmark.id),
                error_px: errors.iter().map(|(_, e)| e).sum::<f64>() / errors.len() as f64,
                track: errors.into_iter().map(|(at, _)| at).collect(),
            });
        }
        Self { metric: map.is_metric(id), cameras, views, points }
    }

    /// Mean distance between features and projections over all observations, pixels.
    pub fn error_px(&self) -> f64 {
        let (sum, n) = self
            .points
            .iter()
            .fold((0.0, 0), |(sum, n), p| (sum + p.error_px * p.track.len() as f64, n + p.track.len()));
        sum / n.max(1) as f64
    }
}

fn luminance(pictures: Option<&Pictures>, landmark: LandmarkId) -> u8 {
    pictures.and_then(|p| p.luminance.get(&landmark)).copied().unwrap_or(UNKNOWN)
}

/// The view of a key frame, whose camera is added to those that are known.
fn view(k: &KeyFrame, atlas: &RectifiedCamera, cameras: &mut Vec<Pinhole>) -> View {
    let pinhole = Pinhole::of(k.camera(atlas));
    let camera = cameras.iter().position(|c| *c == pinhole).unwrap_or_else(|| {
        cameras.push(pinhole);
        cameras.len() - 1
    });
    let feature = |px: &[f32; 2]| (Vec2::new(px[0].into(), px[1].into()) - pinhole.corner, None);
    View {
        id: k.id,
        camera,
        world_from_camera: k.world_from_camera,
        features: k.frame.px.iter().map(feature).collect(),
    }
}
