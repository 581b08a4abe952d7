//! A lost depth camera looks for its place in the submaps of all maps, by the shape of what it sees.
//!
//! In: submaps as they were when the search began, and the depth images since. Out: [`FoundByDepth`], once a pose has been
//! found without a guess ([`Locator::locate`]), the following images were aligned with the surface there one after the
//! other, and a second look, at a later image and again without a guess, has found the same place. Everything else is refused and
//! counted.

use cairn_atlas::KeyFrameId;
use cairn_dense::{Followed, Located, Locator, Place, Verdict};
use cairn_geometry::{Manifold, Se3, Vec3};
use cairn_sensor::{Clock, DepthImage, Stamp};
use cairn_tracking::{DepthPlaced, FoundByDepth};
use nalgebra::{Matrix6, Vector6};
use std::sync::Arc;

/// Images that are aligned one after the other before a second look.
const FOLLOWED: usize = 5;
/// Second looks that may be undecided (little overlap, no agreement) before the candidate is given up.
const SECOND_LOOKS: usize = 3;
/// Seconds from a refused look to the next one.
const RETRY_S: f64 = 0.3;
/// Longest gap between two images that are followed, seconds.
const GAP_S: f64 = 0.5;
/// An image is aligned when at least this share of its points is near the surface, at this distance at most (root mean
/// square, metres: where key frames are off by centimetres, so is the surface of the map), and at most this share of those that
/// were looked at before lies in free space.
const LEAST_NEAR: f64 = 0.5;
const MOST_RMS_M: f64 = 0.045;
const MOST_VIOLATION: f64 = 0.1;
/// Of a look without a guess, the share in free space for each metre that the other points are from the surface (root mean square): where
/// surfaces coincide to millimetres, what lies in free space is another room and no noise. In right places of simulated rooms it was
/// 0.6 at most and in those of the kitchen, whose surface is uneven by centimetres, 2.7; in wrong ones that fitted otherwise 1.5 to 19.
/// So it is just above what right places have: a right one that is refused is looked at again, and a wrong one below has to pass the images
/// that follow and the second look.
const MOST_VIOLATION_PER_M: f64 = 3.0;
/// How far the second look may be from the pose that was followed, metres and radians.
const AGREES_M: f64 = 0.15;
const AGREES_RAD: f64 = 0.1;
/// Images that are handed to tracking, at most.
const KEPT: usize = 12;
/// Standard deviation of the pose that is told, metres and radians: that of the map's surface against its key frames.
const SIGMA_M: f64 = 0.03;
const SIGMA_RAD: f64 = 0.02;

/// What searches by depth did.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct SearchCounts {
    /// Attempts to locate an image without a guess, second ones included.
    #[serde(rename = "looks")]
    pub attempts: usize,
    /// Attempts that found nothing that is believed: by the reason.
    pub refused: RefusedAttempts,
    /// Places that were believed at first, but the following images did not fit.
    pub not_followed: usize,
    /// Places that a second look did not confirm, or contradicted.
    pub not_confirmed: usize,
    /// Places that were found and handed to tracking.
    pub found: usize,
    /// Of these, where tracking went on.
    pub taken: usize,
    /// And where it did not: the next frame could not be aligned, the camera cannot have got there, or nothing but the shape
    /// speaks for the place.
    pub not_taken: usize,
    /// Seconds of recording from the first look of the last search to its end.
    pub last_search_s: f64,
    /// Longest look, in milliseconds of the search's thread.
    pub longest_look_ms: f64,
}

/// Refused attempts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct RefusedAttempts {
    /// No pose that features agree on, or an image that cannot be used.
    pub no_agreement: usize,
    /// Too little in common.
    pub little_overlap: usize,
    /// It would lie in free space.
    pub free_space: usize,
    /// A direction is left open, as before a bare wall.
    pub unconstrained: usize,
    /// Several poses fit.
    pub ambiguous: usize,
}

impl RefusedAttempts {
    /// All together.
    pub fn all(&self) -> usize {
        self.no_agreement + self.little_overlap + self.free_space + self.unconstrained + self.ambiguous
    }

    fn add(&mut self, found: Option<&Located>) {
        let count = match found.map_or(Verdict::NoAgreement, |l| l.registration.verdict) {
            Verdict::Accepted => return,
            Verdict::NoAgreement => &mut self.no_agreement,
            Verdict::LittleOverlap => &mut self.little_overlap,
            Verdict::FreeSpaceViolated => &mut self.free_space,
            Verdict::Unconstrained => &mut self.unconstrained,
            Verdict::Ambiguous => &mut self.ambiguous,
        };
        *count += 1;
    }
}

/// A depth image of a lost camera; `up` is the direction against gravity in the depth sensor, where it is known.
pub(super) struct DepthQuery {
    pub stamp: Stamp,
    pub image: Arc<DepthImage>,
    pub up: Option<Vec3>,
}

/// A place that is believed so far.
struct Candidate {
    place: usize,
    /// Images with their poses (of the depth sensor) in the submap, oldest first.
    frames: Vec<(Stamp, Arc<DepthImage>, Se3)>,
    /// Images aligned since the last look without a guess.
    followed: usize,
    second_looks: usize,
    is_confirmed: bool,
}

/// The search, image by image.
pub(super) struct Seeker {
    locator: Locator,
    places: Vec<Place>,
    depth_from_camera: Se3,
    candidate: Option<Candidate>,
    /// The first and the last image that was looked at without a guess.
    looked: Option<[Stamp; 2]>,
    pub counts: SearchCounts,
    clock: Clock,
}

impl Seeker {
    pub fn new(locator: Locator, depth_from_camera: Se3, clock: Clock) -> Self {
        let counts = SearchCounts::default();
        Self { locator, places: Vec::new(), depth_from_camera, candidate: None, looked: None, counts, clock }
    }

    /// Begins anew, in these places; in none it rests.
    pub fn begin(&mut self, places: Vec<Place>) {
        (self.places, self.candidate, self.looked) = (places, None, None);
    }

    /// Whether it follows a place: then every image is of use, else only the newest.
    pub fn follows(&self) -> bool {
        self.candidate.is_some()
    }

    /// Takes the next image; `is_newest` where none waits behind it. A place is told once it is confirmed and the newest image
    /// was aligned there.
    pub fn take(&mut self, sight: &DepthQuery, is_newest: bool) -> Option<FoundByDepth> {
        if self.places.is_empty() {
            return None;
        }
        match self.candidate.take() {
            None => self.look(sight),
            Some(candidate) => match self.follow(candidate, sight)? {
                confirmed if confirmed.is_confirmed && is_newest => return self.tell(&confirmed),
                going_on => self.candidate = Some(going_on),
            },
        }
        None
    }

    /// The first look.
    fn look(&mut self, sight: &DepthQuery) {
        if self.looked.is_some_and(|[_, last]| sight.stamp - last < RETRY_S) {
            return;
        }
        self.looked = Some([self.looked.map_or(sight.stamp, |l| l[0]), sight.stamp]);
        let Some(found) = self.look_at(sight, None) else { return };
        let submap_from_depth = found.registration.target_from_source;
        self.candidate = Some(Candidate {
            place: found.place,
            frames: vec![(sight.stamp, sight.image.clone(), submap_from_depth)],
            followed: 0,
            second_looks: 0,
            is_confirmed: false,
        });
    }

    /// A look without a guess, in all places or in the map of one; refusals are counted.
    fn look_at(&mut self, sight: &DepthQuery, in_map_of: Option<usize>) -> Option<Located> {
        let start = self.clock.now();
        let map = in_map_of.map(|place| self.places[place].map);
        let kept: Vec<usize> =
            (0..self.places.len()).filter(|&i| map.is_none_or(|m| self.places[i].map == m)).collect();
        let places: Vec<Place> = kept.iter().map(|&i| self.places[i].clone()).collect();
        // An image that cannot be used is as one without anything in it.
        let mut found = self.locator.locate(&places, &sight.image, sight.up).ok().flatten();
        if let Some(Located { registration, .. }) = &mut found
            && registration.accepted()
            && registration.violation > MOST_VIOLATION_PER_M * registration.rms_m
        {
            registration.verdict = Verdict::FreeSpaceViolated;
        }
        let ms = self.clock.ms_since(start);
        let counts = &mut self.counts;
        counts.attempts += 1;
        counts.refused.add(found.as_ref());
        counts.longest_look_ms = counts.longest_look_ms.max(ms);
        let found = found.filter(|l| l.registration.accepted())?;
        Some(Located { place: kept[found.place], ..found })
    }

    /// Aligns the next image where the last one was; `None` where it does not fit.
    fn follow(&mut self, mut candidate: Candidate, sight: &DepthQuery) -> Option<Candidate> {
        let Some(pose) = self.aligned(&candidate, sight) else {
            self.counts.not_followed += 1;
            return None;
        };
        if candidate.frames.len() == KEPT {
            candidate.frames.remove(0);
        }
        candidate.frames.push((sight.stamp, sight.image.clone(), pose));
        candidate.followed += 1;
        if candidate.is_confirmed || candidate.followed < FOLLOWED {
            return Some(candidate);
        }
        (candidate.followed, candidate.second_looks) = (0, candidate.second_looks + 1);
        let again = self.look_at(sight, Some(candidate.place));
        let here = self.places[candidate.place].world_from_submap * pose;
        let agrees = again.map(|again| {
            let off = here.inverse() * again.world_from_source;
            off.translation.norm() < AGREES_M && off.rotation.angle() < AGREES_RAD
        });
        candidate.is_confirmed = agrees == Some(true);
        if agrees == Some(false) || (agrees.is_none() && candidate.second_looks == SECOND_LOOKS) {
            self.counts.not_confirmed += 1;
            return None;
        }
        Some(candidate)
    }

    /// The pose of an image in the candidate's submap, from that of the image before and the motion before that.
    fn aligned(&mut self, candidate: &Candidate, sight: &DepthQuery) -> Option<Se3> {
        let (last, _, pose) = candidate.frames.last()?;
        let since_s = Some(sight.stamp - *last).filter(|s| *s > 0.0 && *s < GAP_S)?;
        let before = candidate.frames.len().checked_sub(2).map(|i| &candidate.frames[i]);
        let moved = before.map_or(Vector6::zeros(), |(at, _, then)| {
            then.local(pose) * (since_s / (*last - *at).max(1e-6)).min(2.0)
        });
        let place = self.places.get(candidate.place)?;
        let followed = self.locator.follow(place, &sight.image, &pose.retract(&moved))?;
        let Followed { submap_from_camera, near, violation, rms_m, is_fixed } = followed;
        let fits = near >= LEAST_NEAR && violation <= MOST_VIOLATION && rms_m <= MOST_RMS_M;
        (fits && is_fixed && submap_from_camera.is_finite()).then_some(submap_from_camera)
    }

    /// What tracking is told; the search rests until it is asked again.
    fn tell(&mut self, candidate: &Candidate) -> Option<FoundByDepth> {
        let place = &self.places[candidate.place];
        let key_frame = KeyFrameId::from_index(usize::try_from(place.anchor.0).ok()?)?;
        let frame = |(stamp, image, submap_from_depth): &(Stamp, Arc<DepthImage>, Se3)| DepthPlaced {
            stamp: *stamp,
            image: image.clone(),
            key_frame_from_camera: place.anchor_from_submap * *submap_from_depth * self.depth_from_camera,
        };
        let frames: Vec<DepthPlaced> = candidate.frames.iter().map(frame).collect();
        let [m, rad] = [SIGMA_M * SIGMA_M, SIGMA_RAD * SIGMA_RAD];
        let covariance = Matrix6::from_diagonal(&Vector6::new(m, m, m, rad, rad, rad));
        self.counts.found += 1;
        if let (Some([first, _]), Some(last)) = (self.looked, frames.last()) {
            self.counts.last_search_s = last.stamp - first;
            self.looked = Some([first, last.stamp]);
        }
        Some(FoundByDepth { key_frame, frames, covariance })
    }
}
