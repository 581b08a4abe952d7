//! A recording with its truth, and the alignment of features between two of its images.

use crate::patch::{Alignment, Pair, align};
use cairn_geometry::{Se3, So3, Vec2, Vec3};
use cairn_sensor::{DepthImage, FramePacket, GrayImage, Stamp};
use cairn_sources::{OpenOptions, open};
use cairn_vision::orb::Backend;
use cairn_vision::{
    Frame, FrontEnd, FrontEndConfig, Octaves, Pyramid, RectifiedCamera, Rectifier, SensorMode, rectify_pair,
};
use nalgebra::{Matrix2, Matrix3, Rotation2, Vector2, Vector3};
use std::sync::Arc;

/// How the patch is warped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Warp {
    /// By the features' levels and angles.
    Angle,
    /// By the true motion and the depth, as if the surface faced the earlier camera.
    Facing,
    /// The same with the surface's normal from the depth image.
    Normal,
    /// The same with the homography of that plane, not only its affine part.
    Plane,
}

/// One way to align.
#[derive(Clone, Copy, Debug)]
pub struct Way {
    pub name: &'static str,
    pub warp: Warp,
    pub how: Alignment,
}

/// One image with its truth.
pub struct View {
    pub frame: Frame,
    levels: Vec<GrayImage>,
    depth: Option<Arc<DepthImage>>,
    pub world_from_camera: Se3,
}

/// A recording that is held in memory.
pub struct Recording {
    pub camera: RectifiedCamera,
    lens: Rectifier,
    pub octaves: Octaves,
    pub views: Vec<View>,
    pub exact: bool,
}

/// Reads all of a source; `exact`: its depth images are the truth.
pub fn read(address: &str, mode: SensorMode, features: usize, exact: bool) -> Result<Recording, String> {
    let mut source = open(address, OpenOptions::default()).map_err(|e| e.to_string())?;
    let mut config = FrontEndConfig::default();
    config.orb.features = features;
    let rig = source.rig().clone();
    let mut front_end = FrontEnd::new(&rig, mode, config).map_err(|e| e.to_string())?;
    let camera = *front_end.model();
    let lens = if mode == SensorMode::Stereo {
        rectify_pair(&rig.cameras[0], &rig.cameras[1]).map_err(|e| e.to_string())?.left
    } else {
        let c = &rig.cameras[0].camera;
        Rectifier::new(c, &So3::identity(), Vec2::new(c.fx, c.fy), Vec2::new(c.cx, c.cy))
    };
    let truth: Vec<(Stamp, Se3)> = source.info().truth.clone();
    let octaves = front_end.octaves();
    let mut pyramid = Pyramid::new(octaves.levels, octaves.factor);
    let mut views = Vec::new();
    while let Some(packet) = source.next_packet().map_err(|e| e.to_string())? {
        let FramePacket { stamp, ref images, ref depth, .. } = packet;
        let near = truth.iter().min_by(|a, b| (a.0 - stamp).abs().total_cmp(&(b.0 - stamp).abs()));
        let Some((_, body)) = near.filter(|n| (n.0 - stamp).abs() < 0.003) else { continue };
        pyramid.build(&images[0], Backend::detect());
        views.push(View {
            levels: pyramid.levels().to_vec(),
            depth: depth.clone(),
            world_from_camera: *body * camera.body_from_camera,
            frame: front_end.extract(&packet).map_err(|e| e.to_string())?,
        });
    }
    Ok(Recording { camera, lens, octaves, views, exact })
}

impl Recording {
    /// Depth of a feature, and true where an outline is beside it.
    pub fn depth(&self, view: &View, i: usize) -> Option<(f64, bool)> {
        let is_measured = view.frame.has_depth(i);
        if !self.exact {
            return is_measured.then(|| (f64::from(view.frame.depth[i]), false));
        }
        let image = view.depth.as_ref()?;
        let [x, y] = view.frame.raw[i];
        let r = if is_measured { 0.0 } else { 1.5 * self.octaves.scale(view.frame.octave[i]) as f32 };
        let range = |c: f32| (c - r).round().max(0.0) as usize..=(c + r).round() as usize;
        let near =
            range(y).flat_map(|y| range(x).filter_map(move |x| image.get(x, y))).filter(|d| *d > 0).min();
        Some((f64::from(near?) * 0.001, !is_measured))
    }

    /// Normal of the surface at a feature: inverse depth is linear in the pixels of a plane.
    fn normal(&self, view: &View, i: usize) -> Option<Vec3> {
        let image = view.depth.as_ref()?;
        if !view.frame.has_depth(i) {
            return None;
        }
        let r = (4.0 * self.octaves.scale(view.frame.octave[i])).round() as i64;
        let (x, y) = (view.frame.raw[i][0].round() as i64, view.frame.raw[i][1].round() as i64);
        let (mut h, mut g) = (Matrix3::zeros(), Vector3::zeros());
        for (dy, dx) in (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| (dy, dx))) {
            let Some(d) = image.get(usize::try_from(x + dx).ok()?, usize::try_from(y + dy).ok()?) else {
                continue;
            };
            if d > 0 && d < 60000 {
                let ray = self.camera.unproject([(x + dx) as f32, (y + dy) as f32], 1.0);
                h += ray * ray.transpose();
                g += ray * (1000.0 / f64::from(d));
            }
        }
        // n . p = 1 on the plane, so n . ray = 1 / depth.
        Some(h.cholesky()?.solve(&g))
    }

    /// Where the raw pixel at an offset from feature `i` of `a` is seen in `b`, through a plane.
    fn through(
        &self,
        a: &View,
        i: usize,
        plane: &[Vec3; 2],
        b_from_a: &Se3,
        o: Vector2<f64>,
    ) -> Option<Vec2> {
        let [x, y] = a.frame.raw[i];
        let [point, normal] = plane;
        let ray = self.camera.unproject(self.lens.rectify([x + o.x as f32, y + o.y as f32])?, 1.0);
        let p = *b_from_a * (ray * (normal.dot(point) / normal.dot(&ray)));
        let [u, v, _] = self.camera.project(&p)?;
        self.lens.raw([u, v])
    }

    /// Where feature `j` of `b` is after the alignment with feature `i` of `a`, in rectified pixels.
    pub fn aligned(
        &self,
        a: &View,
        b: &View,
        (i, j): (usize, usize),
        b_from_a: &Se3,
        way: &Way,
    ) -> Option<[f64; 2]> {
        let (oa, ob) = (a.frame.octave[i], b.frame.octave[j]);
        let (sa, sb) = (self.octaves.scale(oa), self.octaves.scale(ob));
        let depth = self.depth(a, i).map_or(1e4, |d| d.0);
        let point = self.camera.unproject(a.frame.px[i], depth);
        let measured = if matches!(way.warp, Warp::Normal | Warp::Plane) { self.normal(a, i) } else { None };
        let plane = [point, measured.unwrap_or_else(|| point.normalize())];
        let middle = self.through(a, i, &plane, b_from_a, Vector2::zeros())?;
        let warp = |o: Vector2<f64>| Some((self.through(a, i, &plane, b_from_a, o * sa)? - middle) / sb);
        let affine = if way.warp == Warp::Angle {
            *Rotation2::new(f64::from(b.frame.angle[j] - a.frame.angle[i])).matrix()
        } else {
            let slope = |o: Vector2<f64>| Some((warp(o)? - warp(-o)?) / 8.0);
            Matrix2::from_columns(&[slope(Vector2::new(4.0, 0.0))?, slope(Vector2::new(0.0, 4.0))?])
        };
        let on_level = |raw: [f32; 2], s: f64| raw.map(|c| (f64::from(c) + 0.5) / s - 0.5);
        let pair = Pair {
            from: &a.levels[usize::from(oa)],
            at: on_level(a.frame.raw[i], sa),
            to: &b.levels[usize::from(ob)],
            found: on_level(b.frame.raw[j], sb),
            affine,
            warp: (way.warp == Warp::Plane).then_some(&warp),
        };
        let found = align(&pair, &way.how)?;
        let raw = found.map(|c| ((c + 0.5) * sb - 0.5) as f32);
        Some(self.lens.rectify(raw)?.map(f64::from))
    }
}
