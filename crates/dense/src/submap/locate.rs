//! Where a depth image was taken in a map, and how two maps lie to each other, by the shape of their surfaces alone.

use super::{DenseMap, MapId};
use crate::{
    DenseError, OccupancyGrid, RegisterConfig, Registration, Surface, SurfaceFeatures, TsdfVolume, register,
};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::DepthImage;

/// Directions against gravity, where they are known: of the place looked in, and of what is looked for, each in its own
/// frame. One alone is of no use.
pub type Up = Option<[Vec3; 2]>;

/// A registration against one submap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Located {
    /// The pose in the map looked in: of the depth camera, or of the other map.
    pub world_from_source: Se3,
    /// The numbers, and whether it is believed; its pose is in the frame of the submap.
    pub registration: Registration,
}

impl DenseMap {
    /// Looks for the pose of a depth image in the submaps of a map, without a guess: the accepted result with the most
    /// overlap, else the rejected one with the most, to tell why. `None` for a map without submaps. Some 10 ms for each
    /// submap, and once for each that changed 5 ms more.
    ///
    /// # Errors
    /// Depth that cannot be used; a configuration or direction out of range.
    pub fn locate(
        &mut self,
        map: MapId,
        depth: &DepthImage,
        up: Up,
        config: &RegisterConfig,
    ) -> Result<Option<Located>, DenseError> {
        self.describe(config)?;
        let mut tsdf = TsdfVolume::new(self.config.tsdf)?;
        let mut occupancy = OccupancyGrid::new(self.config.occupancy)?;
        let frame = self.preparer.prepare(depth)?;
        tsdf.integrate(frame, None, &Se3::identity())?;
        occupancy.integrate(frame, &Se3::identity())?;
        let features = SurfaceFeatures::new(&tsdf, config)?;
        let source =
            Surface { tsdf: &tsdf, occupancy: &occupancy, features: &features, up: up.map(|u| u[1]) };
        let mut best = None;
        for (world_from_submap, target) in self.surfaces(map, up.map(|u| u[0])) {
            let registration = register(&target, &source, config)?;
            keep_better(&mut best, world_from_submap, Se3::identity(), registration);
        }
        Ok(best)
    }

    /// Looks for the pose of map `source` in map `target` by all pairs of their submaps, as [`Self::locate`] does;
    /// nothing is moved.
    ///
    /// # Errors
    /// A configuration or direction out of range.
    pub fn register_maps(
        &mut self,
        target: MapId,
        source: MapId,
        up: Up,
        config: &RegisterConfig,
    ) -> Result<Option<Located>, DenseError> {
        self.describe(config)?;
        let mut best = None;
        for (source_from_submap, other) in self.surfaces(source, up.map(|u| u[1])) {
            for (world_from_submap, one) in self.surfaces(target, up.map(|u| u[0])) {
                let registration = register(&one, &other, config)?;
                keep_better(&mut best, world_from_submap, source_from_submap.inverse(), registration);
            }
        }
        Ok(best)
    }

    /// Makes the features of the submaps that changed.
    fn describe(&mut self, config: &RegisterConfig) -> Result<(), DenseError> {
        for submap in self.submaps.iter_mut().flatten() {
            let revision = submap.tsdf.revision();
            let known =
                submap.features.as_ref().is_some_and(|(of, f)| *of == revision && f.config() == config);
            if !known {
                submap.features = Some((revision, SurfaceFeatures::new(&submap.tsdf, config)?));
            }
        }
        Ok(())
    }

    /// Pose and surface of the described submaps of a map.
    fn surfaces(&self, map: MapId, up: Option<Vec3>) -> impl Iterator<Item = (Se3, Surface<'_>)> {
        self.submaps.iter().enumerate().filter_map(move |(i, submap)| {
            let (in_map, world_from_submap) = self.place(i)?;
            let submap = submap.as_ref().filter(|_| in_map == map)?;
            let (_, features) = submap.features.as_ref()?;
            let up = up.map(|up| world_from_submap.rotation.inverse() * up);
            let surface = Surface { tsdf: &submap.tsdf, occupancy: &submap.occupancy, features, up };
            Some((world_from_submap, surface))
        })
    }
}

/// Keeps the accepted before the rejected, then the one with more overlap.
fn keep_better(
    best: &mut Option<Located>,
    world_from_submap: Se3,
    submap_from_source: Se3,
    found: Registration,
) {
    let rank = |r: &Registration| (r.accepted(), r.overlap);
    if best.as_ref().is_none_or(|b| rank(&found) > rank(&b.registration)) {
        let world_from_source = world_from_submap * found.target_from_source * submap_from_source;
        *best = Some(Located { world_from_source, registration: found });
    }
}
