//! The state of the filter: robots, landmarks, and what is known about each.

use super::active::{Active, Place};
use super::config::EkfConfig;
use super::delayed::Delayed;
use super::landmark::{LandmarkId, Record};
use super::reach::Reach;
use super::recent::Recent;
use super::region::Region;
use super::scatter::Scatter;
use std::collections::BTreeMap;

/// A robot of the state.
#[derive(Clone, Debug)]
pub(super) struct Robot {
    pub(super) place: Place,
    pub(super) store: Option<usize>,
    pub(super) recent: Recent,
    pub(super) scatter: Scatter,
    /// Distance travelled, in metres.
    pub(super) travelled_m: f64,
    /// Number of motions so far.
    pub(super) moves: usize,
}

/// The filter.
#[derive(Clone, Debug)]
pub struct EkfSlam {
    pub(super) config: EkfConfig,
    pub(super) active: Active,
    pub(super) robots: Vec<Robot>,
    /// In order of rising numbers.
    pub(super) landmarks: Vec<Record>,
    pub(super) by_label: BTreeMap<u32, LandmarkId>,
    pub(super) next_id: u32,
    /// Chi-square bounds by degrees of freedom.
    pub(super) gates: [f64; 4],
    /// The same beyond which a sighting speaks against the pose.
    pub(super) far: [f64; 4],
    pub(super) delayed: Delayed,
    pub(super) region: Option<Region>,
    pub(super) reach: Reach,
    /// Landmarks that turned out to be the same as another, and that other one.
    pub(super) joined: BTreeMap<LandmarkId, LandmarkId>,
    pub(super) recoveries: usize,
}
