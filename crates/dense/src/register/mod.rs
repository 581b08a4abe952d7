//! Global registration: the pose between two surfaces without a guess.
//!
//! Features of normals (FPFH), reciprocal matches, groups of them that one pose may explain, the pose of each group by
//! fast global registration, the best of them refined against the other's field. It is accepted when enough of the two
//! surfaces coincides, hardly any of it lies where the other saw free space, the surfaces fix all directions, and no other
//! pose fits as well (a bare room fits onto itself the other way round); the numbers are told in any case.

mod fgr;
mod fpfh;
mod matches;
mod refine;
mod surfels;
mod verify;
mod walls;

use crate::sample::Sampler;
use crate::{DenseError, OccupancyGrid, TsdfVolume};
use cairn_geometry::{Se3, So3, Vec3};
use surfels::Surfels;

/// A point this near to the other surface lies on it, in metres (a voxel where that is more).
const ON_M: f64 = 0.05;
/// Poses that put walls onto walls, the best of them, are tried for a rival.
const BY_WALLS: usize = 4;
/// Points that hypotheses are judged with, and those of the last judgement.
const FEW: usize = 300;
const MANY: usize = 1500;

/// Configuration of global registration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegisterConfig {
    /// Edge of the cubes that the surface is thinned to, in metres: one point in each.
    pub cell_m: f64,
    /// Radius of the features in metres.
    pub radius_m: f64,
    /// At most so many of the most distinct points of each surface are matched.
    pub distinct: usize,
    /// Matches agree when they differ by less than this, in metres.
    pub tolerance_m: f64,
    /// Groups of matches that are tried.
    pub groups: usize,
    /// At least this share of one surface lies on the other.
    pub least_overlap: f64,
    /// At most this share of what the other has looked at lies in its free space.
    pub most_violation: f64,
    /// For another pose that would be accepted by itself may speak at most this share of what speaks for the best: the
    /// overlap, less twice what lies in free space.
    pub most_rival: f64,
}

impl Default for RegisterConfig {
    fn default() -> Self {
        Self {
            cell_m: 0.1,
            radius_m: 0.35,
            distinct: 1000,
            tolerance_m: 0.1,
            groups: 8,
            least_overlap: 0.25,
            most_violation: 0.1,
            most_rival: 0.8,
        }
    }
}

/// Points, normals and features of a surface; made once, matched often.
#[derive(Clone, Debug)]
pub struct SurfaceFeatures {
    surfels: Surfels,
    fpfh: Vec<fpfh::Fpfh>,
    distinct: Vec<u32>,
    config: RegisterConfig,
}

impl SurfaceFeatures {
    /// The features of a field's surface.
    ///
    /// # Errors
    /// A configuration out of range.
    pub fn new(volume: &TsdfVolume, config: &RegisterConfig) -> Result<Self, DenseError> {
        config.check()?;
        let surfels = surfels::surfels(volume, config.cell_m);
        let fpfh = fpfh::features(&surfels, config.radius_m as f32);
        let distinct = matches::distinct(&fpfh, config.distinct);
        Ok(Self { surfels, fpfh, distinct, config: *config })
    }

    /// The configuration that they were made with.
    pub fn config(&self) -> &RegisterConfig {
        &self.config
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.surfels.points.len()
    }
}

impl RegisterConfig {
    pub(crate) fn check(&self) -> Result<(), DenseError> {
        let metres = (0.02..=1.0).contains(&self.cell_m)
            && self.radius_m > self.cell_m
            && self.radius_m <= 20.0 * self.cell_m
            && self.tolerance_m > 0.0
            && self.tolerance_m <= 1.0;
        let counts = (10..=5000).contains(&self.distinct) && (1..=100).contains(&self.groups);
        let shares = [self.least_overlap, self.most_violation, self.most_rival];
        let shares = shares.iter().all(|share| (0.0..=1.0).contains(share));
        if metres && counts && shares {
            return Ok(());
        }
        Err(DenseError::Config(format!("registration: {self:?}")))
    }
}

/// One of the two surfaces.
#[derive(Clone, Copy)]
pub struct Surface<'a> {
    /// Its field.
    pub tsdf: &'a TsdfVolume,
    /// Its free space, in the same frame.
    pub occupancy: &'a OccupancyGrid,
    /// Its features.
    pub features: &'a SurfaceFeatures,
    /// The direction against gravity in that frame, where it is known: with both known, only yaw and translation are
    /// looked for.
    pub up: Option<Vec3>,
}

impl Surface<'_> {
    /// Its direction up with unit length.
    fn unit_up(&self) -> Result<Option<Vec3>, DenseError> {
        let Some(up) = self.up else { return Ok(None) };
        let unit = up.try_normalize(1e-6).filter(|u| u.iter().all(|v| v.is_finite()));
        unit.map(Some)
            .ok_or_else(|| DenseError::Config(format!("({}, {}, {}) is no direction", up.x, up.y, up.z)))
    }
}

/// Whether a pose is believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It is.
    Accepted,
    /// Too few matches of features agree on any pose.
    NoAgreement,
    /// Too little of the surfaces coincides.
    LittleOverlap,
    /// Too much lies where the other saw free space.
    FreeSpaceViolated,
    /// What coincides leaves a direction open, such as one bare wall.
    Unconstrained,
    /// Another pose fits nearly as well: rooms and things that look alike.
    Ambiguous,
}

/// Result of a registration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registration {
    /// The pose of the source in the target; means nothing for [`Verdict::NoAgreement`].
    pub target_from_source: Se3,
    /// Whether it is believed.
    pub verdict: Verdict,
    /// Reciprocal matches of features, and those that agree with the pose of the best group.
    pub matches: [usize; 2],
    /// Share of the points of the source on the target's surface, or the other way round, whichever is more.
    pub overlap: f64,
    /// Of the points that the other has looked at, the share in its free space.
    pub violation: f64,
    /// Root mean square distance of the source's points to the target's surface, in metres.
    pub rms_m: f64,
    /// Number of directions (of six) that what coincides leaves open.
    pub open: usize,
    /// Overlap of the best other pose that would be accepted by itself; 0 without one. Looked for where the best is accepted.
    pub rival: f64,
}

impl Registration {
    /// Whether the pose is believed.
    pub fn accepted(&self) -> bool {
        self.verdict == Verdict::Accepted
    }

    /// What speaks for the pose: the overlap, less twice the share in free space, as [`verify::Seen::score`] counts points.
    pub(crate) fn support(&self) -> f64 {
        let free_by_on = self.violation / (1.0 - self.violation).max(1e-9);
        self.overlap * (1.0 - 2.0 * free_by_on)
    }
}

/// Looks for the pose of `source` in `target`, whatever it is.
///
/// # Errors
/// A configuration out of range; a direction up that is not finite or has no length.
pub fn register(
    target: &Surface,
    source: &Surface,
    config: &RegisterConfig,
) -> Result<Registration, DenseError> {
    config.check()?;
    let ups = target.unit_up()?.zip(source.unit_up()?).map(|(a, b)| [a, b]);
    let matches = matches::reciprocal(target.features, source.features, ups, None);
    let samplers = [Sampler::new(target.tsdf), Sampler::new(source.tsdf)];
    let centre = refine::centre(source.features);
    let search = Search { target, source, centre, samplers, ups, config };
    let mut out = Registration {
        target_from_source: Se3::identity(),
        verdict: Verdict::NoAgreement,
        matches: [matches.len(), 0],
        overlap: 0.0,
        violation: 0.0,
        rms_m: f64::INFINITY,
        open: 6,
        rival: 0.0,
    };
    let nothing = out;
    let Some((pose, agree)) = search.best(&matches, None) else { return Ok(out) };
    out.matches[1] = agree;
    search.judge(&pose, &mut out);
    if out.accepted()
        && let Some(rival) = search.rival(&out, nothing)
    {
        out.rival = rival.overlap;
        if rival.support() > config.most_rival * out.support() {
            out.verdict = Verdict::Ambiguous;
        }
    }
    Ok(out)
}

/// Poses of a camera or submap farther apart than this (metres, radians) are two places.
const OTHER_M: f64 = 0.3;
const OTHER_RAD: f64 = 0.25;

/// Whether two poses are of one place, as registration tells them.
pub(crate) fn is_same_place(a: &Se3, b: &Se3) -> bool {
    let off = a.inverse() * *b;
    off.translation.norm() < OTHER_M && off.rotation.angle() < OTHER_RAD
}

struct Search<'a> {
    target: &'a Surface<'a>,
    source: &'a Surface<'a>,
    /// Of the source's points, which are moved relative to it.
    centre: Vec3,
    /// Of the target's and the source's field.
    samplers: [Sampler<'a>; 2],
    ups: Option<[Vec3; 2]>,
    config: &'a RegisterConfig,
}

impl Search<'_> {
    /// The best pose in another place that would be accepted by itself.
    fn rival(&self, best: &Registration, nothing: Registration) -> Option<Registration> {
        let (target, source) = (self.target.features, self.source.features);
        let matches = matches::reciprocal(target, source, self.ups, Some(&best.target_from_source));
        let (pose, agree) = self.best(&matches, Some(&best.target_from_source))?;
        let mut rival = Registration { matches: [matches.len(), agree], ..nothing };
        self.judge(&pose, &mut rival);
        let elsewhere = !is_same_place(&rival.target_from_source, &best.target_from_source);
        (rival.accepted() && elsewhere).then_some(rival)
    }

    /// The pose of the group that the surfaces speak for most, near the surface, and the matches that agree with it; with `but`
    /// of those in another place.
    fn best(&self, all: &[matches::Match], but: Option<&Se3>) -> Option<(Se3, usize)> {
        let planes = refine::Planes::new(self.target.features, 2.0 * self.target.features.surfels.cell_m);
        let few = refine::sampled(self.source.features, FEW, &self.centre);
        let source_from_centred = Se3::new(So3::identity(), self.centre);
        let mut best: Option<(i64, Se3, usize)> = None;
        let but = but.map(|but| *but * source_from_centred);
        let is_elsewhere = |pose: &Se3| but.as_ref().is_none_or(|but| !is_same_place(but, pose));
        let mut starts: Vec<(Se3, usize)> =
            self.by_matches(all).map(|(pose, agree)| (pose * source_from_centred, agree)).collect();
        if but.is_some() {
            starts.extend(self.by_walls(&few, is_elsewhere).into_iter().map(|pose| (pose, 0)));
        }
        for (start, agree) in starts {
            let pose = refine::to_planes(&planes, &few, &start, self.source_up(), 6);
            if !is_elsewhere(&pose) {
                continue;
            }
            let score = verify::look(self.target, &self.samplers[0], &few, &pose).score();
            if best.as_ref().is_none_or(|b| score > b.0) {
                best = Some((score, pose, agree));
            }
        }
        let (_, pose, agree) = best?;
        let many = refine::sampled(self.source.features, MANY, &self.centre);
        Some((refine::to_planes(&planes, &many, &pose, self.source_up(), 12), agree))
    }

    /// The pose of each group of matches, and those that agree with it.
    fn by_matches<'a>(&'a self, all: &'a [matches::Match]) -> impl Iterator<Item = (Se3, usize)> + 'a {
        let tolerance_m = self.config.tolerance_m;
        matches::groups(all, self.ups, tolerance_m, self.config.groups).into_iter().filter_map(move |group| {
            let group: Vec<matches::Match> = group.into_iter().map(|i| all[i]).collect();
            fgr::align(&group, self.ups, tolerance_m)
        })
    }

    /// The poses of the centred source, of those that put walls onto walls, that the surfaces speak for most.
    fn by_walls(&self, points: &[(Vec3, Vec3)], is_elsewhere: impl Fn(&Se3) -> bool) -> Vec<Se3> {
        let target = refine::sampled(self.target.features, FEW, &Vec3::zeros());
        let fewer: Vec<(Vec3, Vec3)> = points.iter().step_by(3).copied().collect();
        let score = |pose: &Se3| verify::look(self.target, &self.samplers[0], &fewer, pose).score();
        let poses = walls::poses(&target, points, self.ups).into_iter().filter(is_elsewhere);
        let mut ranked: Vec<(i64, Se3)> = poses.map(|pose| (score(&pose), pose)).collect();
        ranked.sort_by_key(|r| std::cmp::Reverse(r.0));
        ranked.into_iter().take(BY_WALLS).map(|r| r.1).collect()
    }

    fn source_up(&self) -> Option<&Vec3> {
        self.ups.as_ref().map(|u| &u[1])
    }

    /// Refines a pose of the centred source and fills in the numbers.
    fn judge(&self, pose: &Se3, out: &mut Registration) {
        let points = refine::sampled(self.source.features, MANY, &self.centre);
        let refined = refine::to_field(self.target.tsdf, &self.samplers[0], &points, pose, self.source_up());
        let target_from_source = refined.pose * Se3::new(So3::identity(), -self.centre);
        let back = target_from_source.inverse();
        let there = verify::look(self.target, &self.samplers[0], &points, &refined.pose);
        let others = refine::sampled(self.target.features, MANY, &Vec3::zeros());
        let here = verify::look(self.source, &self.samplers[1], &others, &back);
        let share = |a: usize, b: usize| a as f64 / b.max(1) as f64;
        let (on, free) = (there.on + here.on, there.free + here.free);
        out.target_from_source = target_from_source;
        out.overlap = share(there.on, there.all).max(share(here.on, here.all));
        out.violation = share(free, on + free);
        out.rms_m = refined.rms_m;
        out.open = refined.free.len();
        out.verdict = if out.overlap < self.config.least_overlap {
            Verdict::LittleOverlap
        } else if out.violation > self.config.most_violation {
            Verdict::FreeSpaceViolated
        } else if out.open > 0 {
            Verdict::Unconstrained
        } else {
            Verdict::Accepted
        };
    }
}
