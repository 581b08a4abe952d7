//! Submaps of the kitchen in frames turned at random, and pairs of them by how much they have in common.

use cairn_dense::{
    DepthFrame, OccupancyConfig, OccupancyGrid, Registration, Surface, SurfaceFeatures, TsdfConfig,
    TsdfVolume,
};
use cairn_geometry::{Se3, So3, Vec3};

/// A piece of the recording in a frame of its own.
pub struct Submap {
    pub tsdf: TsdfVolume,
    pub occupancy: OccupancyGrid,
    pub sub_from_world: Se3,
    /// A place of the recording that it shows.
    pub seen: Vec3,
    /// Its images, with their poses in the recording.
    pub images: Vec<(DepthFrame, Se3)>,
}

impl Submap {
    /// For registration; the recording's y axis points down.
    pub fn surface<'a>(&'a self, features: &'a SurfaceFeatures, gravity: bool) -> Surface<'a> {
        let up = gravity.then(|| self.sub_from_world.rotation * -Vec3::y());
        Surface { tsdf: &self.tsdf, occupancy: &self.occupancy, features, up }
    }
}

/// Any rotation, and up to two metres along each axis.
pub fn turned(k: u64) -> Se3 {
    let v = |i: u64| ((k * 7919 + i * 104_729) % 1000) as f64 / 1000.0 - 0.5;
    Se3::new(So3::exp(&(Vec3::new(v(1), v(2), v(3)) * 6.0)), Vec3::new(v(4), v(5), v(6)) * 4.0)
}

/// Submaps of one second each (every third of 30 images), 2 cm, one begun every half second; `image` gives a frame of
/// the recording by its number, with its pose.
pub fn kitchen_submaps(mut image: impl FnMut(usize) -> (DepthFrame, Se3)) -> Vec<Submap> {
    let starts = (0..=270).step_by(15);
    starts
        .map(|first| submap(turned(first as u64), (first..first + 30).step_by(3).map(&mut image).collect()))
        .collect()
}

fn submap(sub_from_world: Se3, images: Vec<(DepthFrame, Se3)>) -> Submap {
    let mut tsdf = TsdfVolume::new(TsdfConfig::default()).expect("in range");
    let mut occupancy = OccupancyGrid::new(OccupancyConfig::default()).expect("in range");
    for (frame, pose) in &images {
        tsdf.integrate(frame, None, &(sub_from_world * *pose)).expect("a pose");
        occupancy.integrate(frame, &(sub_from_world * *pose)).expect("a pose");
    }
    let seen = images[0].1 * Vec3::new(0.0, 0.0, 2.0);
    Submap { tsdf, occupancy, sub_from_world, seen, images }
}

/// The pairs whose overlap is nearest to a share: of the blocks (16 cm) around the second's images, in the first.
pub fn pairs_overlapping(submaps: &mut [Submap], share: f64, count: usize) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    for a in 0..submaps.len() {
        for b in a + 1..submaps.len() {
            let (first, second) = submaps.split_at_mut(b);
            let (one, other) = (&mut first[a], &second[0]);
            let of = |(image, pose): &(DepthFrame, Se3)| {
                one.tsdf.overlap(image, &(one.sub_from_world * *pose)).expect("a pose")
            };
            let overlap = other.images.iter().map(of).sum::<f64>() / other.images.len() as f64;
            found.push(((overlap - share).abs(), a, b));
        }
    }
    found.sort_by(|x, y| x.0.total_cmp(&y.0));
    found.truncate(count);
    found.into_iter().map(|(_, a, b)| (a, b)).collect()
}

/// How far a registration is from the recording's poses: centimetres at what the second shows, and degrees.
pub fn error(found: &Registration, target: &Submap, source: &Submap) -> [f64; 2] {
    let truth = target.sub_from_world * source.sub_from_world.inverse();
    let off = truth.inverse() * found.target_from_source;
    let there = source.sub_from_world * source.seen;
    [(off * there - there).norm() * 100.0, off.rotation.angle().to_degrees()]
}
