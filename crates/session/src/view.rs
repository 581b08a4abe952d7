//! A map as lines and points to draw.

use crate::reference_path::anchor_in_map;
use crate::status::View;
use cairn_atlas::{Landmark, MapId, Snapshot};
use cairn_geometry::Vec3;
use cairn_guide::Route;
use std::collections::BTreeMap;

/// Points of a drawn route, at most.
const MOST_OF_A_ROUTE: usize = 600;

pub(crate) fn single(v: &Vec3) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

impl View {
    /// A snapshot, or one of its maps, with at most `most` landmarks.
    pub fn of_map(map: &Snapshot, only: Option<MapId>, most: usize) -> Self {
        let is_shown = |l: &&Landmark| {
            let of = || Some(map.key_frame(l.observations.first()?.key_frame)?.map);
            only.is_none() || of() == only
        };
        // By their numbers, so that the same ones are shown while the map grows.
        let each = map.landmark_count().div_ceil(most.max(1)).next_power_of_two() as u64;
        let shown = map.landmarks().filter(|l| (l.id.index() as u64).is_multiple_of(each));
        let shown = shown.filter(is_shown).take(most);
        let (point_ids, points) = shown.map(|l| (l.id.index() as u64, single(&l.position))).unzip();
        let key_frames: Vec<_> = map.key_frames().filter(|k| only.is_none_or(|of| of == k.map)).collect();
        let numbers: BTreeMap<_, u32> = key_frames.iter().zip(0..).map(|(k, n)| (k.id, n)).collect();
        let loops = key_frames.iter().filter(|k| !k.links.is_empty()).flat_map(|k| {
            let others = k.links.iter().filter(|other| **other < k.id).filter_map(|other| numbers.get(other));
            others.map(|other| [*other, numbers[&k.id]]).collect::<Vec<_>>()
        });
        // A map without gravity begins with y down; of several maps the largest one counts.
        let mut sizes: BTreeMap<MapId, usize> = BTreeMap::new();
        key_frames.iter().for_each(|k| *sizes.entry(k.map).or_default() += 1);
        let largest = sizes.into_iter().max_by_key(|(_, size)| *size).map(|(of, _)| of);
        let is_level = largest.is_some_and(|of| map.is_gravity_aligned(of));
        Self {
            up: single(&if is_level { Vec3::z() } else { -Vec3::y() }),
            points,
            point_ids,
            loops: loops.collect(),
            key_frame_ids: key_frames.iter().map(|k| k.id.index() as u64).collect(),
            maps: key_frames.iter().map(|k| k.map.root().index() as u64).collect(),
            key_frames: key_frames.iter().map(|k| single(&k.world_from_camera.translation)).collect(),
            ..Self::default()
        }
    }

    /// Draws a recorded route as it lies in this map.
    pub fn record(&mut self, route: &Route, map: &Snapshot) {
        let anchored = route.resolve(|a| anchor_in_map(map, a));
        let each = anchored.len().div_ceil(MOST_OF_A_ROUTE).max(1);
        let shown = anchored.iter().step_by(each).map(|p| single(&p.frame_from_camera.translation));
        self.recorded = shown.collect();
    }
}
