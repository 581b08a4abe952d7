//! The renderer's public interface: a camera, its buffers, one image at a time.

use super::passes;
use super::raster::Visibility;
use super::setup::{Setup, View};
use crate::world::{Figure, Thing, World};
use cairn_geometry::Se3;
use cairn_sensor::{Camera, DepthImage, Distortion, GrayImage, RigError};
use std::sync::Arc;

/// Renders a world for one pinhole camera, on one core; keeps buffers between images.
pub struct Renderer {
    world: Arc<World>,
    camera: Camera,
    seen: Visibility,
    setups: Vec<Setup>,
    grey: Vec<u16>,
}

impl Renderer {
    /// For a camera without distortion.
    ///
    /// # Errors
    /// When the camera is not a pinhole, has distortion, or is larger than 4096 pixels on a side.
    pub fn new(world: &Arc<World>, camera: Camera) -> Result<Self, RigError> {
        camera.validate()?;
        Self::off_centre(world, camera)
    }

    /// As [`Renderer::new`], for a part of an image: the principal point may lie far outside.
    ///
    /// # Errors
    /// As there.
    pub(crate) fn off_centre(world: &Arc<World>, camera: Camera) -> Result<Self, RigError> {
        if camera.distortion != Distortion::None {
            return Err(RigError("the renderer draws pinhole images only; remove the distortion".into()));
        }
        if camera.width > 4096 || camera.height > 4096 || camera.width < 8 || camera.height < 8 {
            return Err(RigError(format!(
                "resolution {}x{} is not in 8..=4096",
                camera.width, camera.height
            )));
        }
        let (w, h) = (camera.width, camera.height);
        let seen = Visibility::new(w, h);
        let grey = vec![0; seen.inverse_depth.len()];
        Ok(Self { world: Arc::clone(world), camera, seen, setups: Vec::new(), grey })
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The world.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// Renders another world from now on.
    pub fn set_world(&mut self, world: &Arc<World>) {
        self.world = Arc::clone(world);
    }

    /// Renders the world without passers-by; see [`Renderer::render_with`].
    pub fn render(&mut self, world_from_camera: &Se3, image: &mut GrayImage, depth: Option<&mut DepthImage>) {
        self.render_with(world_from_camera, &[], image, depth);
    }

    /// Renders the world with passers-by. The images take the camera's size; depth is along the optical axis at the
    /// pixel's centre, in millimetres, 0 where there is no surface or it is farther than 65.535 m.
    pub fn render_with(
        &mut self,
        world_from_camera: &Se3,
        figures: &[Figure],
        image: &mut GrayImage,
        depth: Option<&mut DepthImage>,
    ) {
        self.draw(world_from_camera, figures, &[]);
        image.resize(self.camera.width, self.camera.height);
        for (o, g) in image.data_mut().iter_mut().zip(&self.grey) {
            *o = ((u32::from(*g) + 128) >> 8).min(255) as u8;
        }
        if let Some(depth) = depth {
            self.depth(depth);
        }
    }

    /// Renders and returns 256 times the grey level of each pixel.
    pub(crate) fn draw(&mut self, world_from_camera: &Se3, figures: &[Figure], things: &[Thing]) -> &[u16] {
        let view = View::new(&self.camera, world_from_camera);
        self.setups.clear();
        self.setups.extend(self.world.faces.iter().filter_map(|f| view.setup(f)));
        let added = figures.iter().map(|f| f.faces(&self.world));
        for faces in added.chain(things.iter().map(|t| t.faces(&self.world))) {
            self.setups.extend(faces.iter().filter_map(|f| view.setup(f)));
        }
        passes::run(&mut self.seen, &self.setups, &self.world.textures, &mut self.grey);
        &self.grey[..self.camera.width * self.camera.height]
    }

    /// The depth of the last image, in millimetres.
    pub(crate) fn depth(&self, depth: &mut DepthImage) {
        depth.resize(self.camera.width, self.camera.height);
        for (o, q) in depth.data_mut().iter_mut().zip(&self.seen.inverse_depth) {
            let mm = 1000.0 / q.max(1e-6) + 0.5;
            *o = if mm < 65536.0 { mm as u16 } else { 0 };
        }
    }
}
