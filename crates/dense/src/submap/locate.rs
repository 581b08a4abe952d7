//! Where a depth image was taken, by the shape of the surfaces alone.
//!
//! In: submaps as they are at one moment ([`DenseMap::places`]), which share their volumes with the map, so that a search may run
//! on another thread while the map goes on; depth images. Out: poses that are believed or refused, with the numbers.

use super::{AnchorId, DenseMap, MapId, SubmapConfig};
use crate::prepare::DepthPreparer;
use crate::register::is_same_place;
use crate::sample::Sampler;
use crate::{
    DenseError, DepthFrame, Occupancy, OccupancyGrid, RegisterConfig, Registration, Surface, SurfaceFeatures,
    TrackConfig, TsdfVolume, Verdict, register, track,
};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::DepthImage;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A submap as it was when it was asked for.
#[derive(Clone)]
pub struct Place {
    /// The map it belongs to.
    pub map: MapId,
    /// Its pose in that map.
    pub world_from_submap: Se3,
    /// The key frame that it is anchored to, and its pose there.
    pub anchor: AnchorId,
    /// Its pose in the frame of that key frame.
    pub anchor_from_submap: Se3,
    /// The direction against gravity in its frame, where that is known.
    up: Option<Vec3>,
    index: usize,
    tsdf: Arc<TsdfVolume>,
    occupancy: Arc<OccupancyGrid>,
}

/// A pose found without a guess.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Located {
    /// The place it was found in, as a number in the list that was searched.
    pub place: usize,
    /// The pose of the depth camera in the map looked in.
    pub world_from_source: Se3,
    /// The numbers, and whether it is believed; its pose is in the frame of the submap.
    pub registration: Registration,
}

/// An image aligned with the surface of a place from a guess.
#[derive(Clone, Debug, PartialEq)]
pub struct Followed {
    /// The camera's pose in the submap.
    pub submap_from_camera: Se3,
    /// Share of the points near the surface.
    pub near: f64,
    /// Of the points that the submap has looked at, the share in its free space.
    pub violation: f64,
    /// Root mean square distance of the points near the surface, metres.
    pub rms_m: f64,
    /// Whether the alignment converged and the surface fixes all directions.
    pub is_fixed: bool,
}

/// Looks for places; keeps the features of the submaps that it has seen.
pub struct Locator {
    config: RegisterConfig,
    submaps: SubmapConfig,
    preparer: DepthPreparer,
    /// By submap: the field's revision that they are of.
    features: BTreeMap<usize, (u64, SurfaceFeatures)>,
}

impl DenseMap {
    /// What looks for places in this map's submaps.
    ///
    /// # Errors
    /// A configuration out of range.
    pub fn locator(&self, config: RegisterConfig) -> Result<Locator, DenseError> {
        config.check()?;
        let (camera, metres_per_unit) = self.camera();
        let preparer = DepthPreparer::new(self.config.depth, camera, metres_per_unit)?;
        Ok(Locator { config, submaps: self.config, preparer, features: BTreeMap::new() })
    }

    /// The submaps of a map as they are now, without those that are released ([`DenseMap::want_all`]); `up` is the direction against
    /// gravity in the map, where it is known. Nothing is copied.
    pub fn places(&self, map: MapId, up: Option<Vec3>) -> Vec<Place> {
        let one = |index: usize| {
            let (in_map, world_from_submap) = self.place(index)?;
            let submap = self.submaps.get(index)?.as_ref().filter(|_| in_map == map)?;
            Some(Place {
                map,
                world_from_submap,
                anchor: submap.anchored.anchor,
                anchor_from_submap: submap.anchored.pose,
                up: up.map(|up| world_from_submap.rotation.inverse() * up),
                index,
                tsdf: submap.field.whole()?.clone(),
                occupancy: submap.occupancy.clone(),
            })
        };
        (0..self.submaps.len()).filter_map(one).collect()
    }
}

impl Locator {
    /// Looks for the pose of a depth image in places, without a guess: the accepted result with the most overlap, else the
    /// rejected one with the most, to tell why. `up` is the direction against gravity in the camera: where it is known of both,
    /// only yaw and position are looked for. `None` without places. Where poses in different places fit about as well, the result is
    /// [`Verdict::Ambiguous`]; poses in two maps count as different. Some 15 ms for each place, and once for each that changed
    /// 5 ms more.
    ///
    /// # Errors
    /// Depth that cannot be used; a direction that is none.
    pub fn locate(
        &mut self,
        places: &[Place],
        depth: &DepthImage,
        up: Option<Vec3>,
    ) -> Result<Option<Located>, DenseError> {
        self.describe(places)?;
        let mut tsdf = TsdfVolume::new(self.submaps.tsdf)?;
        let mut occupancy = OccupancyGrid::new(self.submaps.occupancy)?;
        let frame = self.preparer.prepare(depth)?;
        tsdf.integrate(frame, None, &Se3::identity())?;
        occupancy.integrate(frame, &Se3::identity())?;
        let features = SurfaceFeatures::new(&tsdf, &self.config)?;
        let source = Surface { tsdf: &tsdf, occupancy: &occupancy, features: &features, up };
        let mut found = Vec::new();
        for (place, target) in self.surfaces(places) {
            let registration = register(&target, &source, &self.config)?;
            let world_from_source = places[place].world_from_submap * registration.target_from_source;
            found.push(Located { place, world_from_source, registration });
        }
        Ok(self.best(places, found))
    }

    /// Aligns a depth image with the surface of a place, near a guess of the camera's pose in the submap; `None` where it cannot
    /// be used.
    pub fn follow(
        &mut self,
        place: &Place,
        depth: &DepthImage,
        submap_from_camera: &Se3,
    ) -> Option<Followed> {
        let frame = self.preparer.prepare(depth).ok()?;
        let config = TrackConfig { fixed_m: FIXED_M, ..TrackConfig::default() };
        let tracked = track(&place.tsdf, frame, submap_from_camera, &config).ok()?;
        let [near, all] = tracked.points;
        Some(Followed {
            submap_from_camera: tracked.volume_from_camera,
            near: near as f64 / all.max(1) as f64,
            violation: violation(place, frame, &tracked.volume_from_camera),
            rms_m: tracked.rms_m,
            is_fixed: tracked.converged && tracked.free.is_empty(),
        })
    }

    /// The best of what was found in places; ambiguous where another place fits about as well.
    fn best(&self, places: &[Place], found: Vec<Located>) -> Option<Located> {
        let rank = |l: &Located| (l.registration.accepted(), l.registration.overlap);
        let mut best: Option<Located> = None;
        for one in &found {
            if best.as_ref().is_none_or(|b| rank(one) > rank(b)) {
                best = Some(*one);
            }
        }
        let mut best = best?;
        if best.registration.accepted() {
            let is_other = |l: &&Located| {
                let elsewhere = places[l.place].map != places[best.place].map;
                let believed = matches!(l.registration.verdict, Verdict::Accepted | Verdict::Ambiguous);
                believed && (elsewhere || !is_same_place(&l.world_from_source, &best.world_from_source))
            };
            let rival = found.iter().filter(is_other).map(|l| l.registration.overlap).fold(0.0, f64::max);
            best.registration.rival = best.registration.rival.max(rival);
            if rival > self.config.most_rival * best.registration.overlap {
                best.registration.verdict = Verdict::Ambiguous;
            }
        }
        Some(best)
    }

    /// Makes the features of the places that changed.
    fn describe(&mut self, places: &[Place]) -> Result<(), DenseError> {
        for place in places {
            let revision = place.tsdf.revision();
            if self.features.get(&place.index).is_none_or(|(of, _)| *of != revision) {
                let features = SurfaceFeatures::new(&place.tsdf, &self.config)?;
                self.features.insert(place.index, (revision, features));
            }
        }
        Ok(())
    }

    /// The surfaces of described places.
    fn surfaces<'a>(&'a self, places: &'a [Place]) -> impl Iterator<Item = (usize, Surface<'a>)> {
        places.iter().enumerate().filter_map(|(i, place)| {
            let (_, features) = self.features.get(&place.index)?;
            let (tsdf, occupancy) = (&*place.tsdf, &*place.occupancy);
            Some((i, Surface { tsdf, occupancy, features, up: place.up }))
        })
    }
}

/// A direction is fixed where the surface gives it with this standard deviation, metres or radians.
const FIXED_M: f64 = 0.02;
/// Pixels that are looked at across an image.
const ACROSS: usize = 40;

/// Of the points of an image that a place has looked at, the share that would lie in its free space.
fn violation(place: &Place, frame: &DepthFrame, submap_from_camera: &Se3) -> f64 {
    let (sampler, camera) = (Sampler::new(&place.tsdf), frame.camera());
    let voxel_m = place.tsdf.config().voxel_m;
    let away_m = 0.6 * place.tsdf.band_m();
    let stride = (camera.width / ACROSS).max(1);
    let (mut looked, mut free) = (0usize, 0usize);
    for y in (stride / 2..camera.height).step_by(stride) {
        for x in (stride / 2..camera.width).step_by(stride) {
            let Some(z) = frame.depth_m(x, y).map(f64::from) else { continue };
            let ray = Vec3::new((x as f64 - camera.cx) / camera.fx, (y as f64 - camera.cy) / camera.fy, 1.0);
            let at = *submap_from_camera * (ray * z);
            match sampler.at([at.x as f32, at.y as f32, at.z as f32]) {
                Some(sample) => {
                    let slope = Vec3::from(sample.gradient.map(f64::from)).norm().max(32.0);
                    looked += 1;
                    free += usize::from(f64::from(sample.steps) / slope * voxel_m > away_m);
                }
                None if place.occupancy.at(&at) == Occupancy::Free => (looked, free) = (looked + 1, free + 1),
                None => {}
            }
        }
    }
    free as f64 / looked.max(1) as f64
}
