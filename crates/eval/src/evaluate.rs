//! The evaluation of an estimate against a reference: absolute and relative error, and coverage.
//!
//! Definitions: Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, section V, as
//! the public tool evo computes them; the results agree with evo's.

use crate::coverage::{coverage_of_frames, coverage_of_reference};
use crate::error::EvalError;
use crate::read::{Format, TrajectoryFile};
use crate::relative::{Delta, pairs};
use crate::segments::{KittiErrors, kitti_errors};
use crate::statistics::Statistics;
use crate::write::seconds_text;
use cairn_geometry::{Sim3, Trajectory, Vec3, associate, umeyama};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::str::FromStr;

/// Alignment of the estimate to the reference before the comparison.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Align {
    /// No alignment.
    None,
    /// Rotation and translation (Umeyama).
    #[default]
    Se3,
    /// Rotation, translation and scale (Umeyama).
    Sim3,
}

impl FromStr for Align {
    type Err = EvalError;
    fn from_str(text: &str) -> Result<Self, EvalError> {
        match text {
            "none" => Ok(Self::None),
            "se3" => Ok(Self::Se3),
            "sim3" => Ok(Self::Sim3),
            _ => Err(EvalError::Option(format!("'{text}' is not an alignment; write none, se3 or sim3"))),
        }
    }
}

/// How poses of the two trajectories are paired.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Association {
    /// By nearest time.
    #[default]
    Time,
    /// By index (KITTI files have no times).
    Index,
}

/// Options of the comparison. The defaults are evo's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvalOptions {
    /// Alignment before the comparison.
    pub align: Align,
    /// Maximum time difference of a pair, in seconds.
    pub max_difference_s: f64,
    /// How poses are paired.
    pub association: Association,
    /// Distance between the two poses of a pair, for the relative error.
    pub delta: Delta,
    /// True to use all pairs at that distance, not only consecutive ones.
    pub all_pairs: bool,
    /// Relative tolerance of the distance with `all_pairs`.
    pub delta_tolerance: f64,
    /// False when one side has positions only: then angles and relative error are not computed.
    pub rotations: bool,
}

impl Default for EvalOptions {
    fn default() -> Self {
        Self {
            align: Align::Se3,
            max_difference_s: 0.01,
            association: Association::Time,
            delta: Delta::default(),
            all_pairs: false,
            delta_tolerance: 0.1,
            rotations: true,
        }
    }
}

/// Two associated positions, both in the reference's frame, and their distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairError {
    /// Time of the estimate in nanoseconds.
    pub stamp_ns: i64,
    /// Position of the reference in metres.
    pub reference: Vec3,
    /// Position of the aligned estimate in metres.
    pub estimate: Vec3,
    /// Distance in metres.
    pub error_m: f64,
}

/// Result of the comparison of an estimate with its reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Requested alignment.
    pub align: Align,
    /// Scale found by the alignment; 1 without a similarity alignment.
    pub scale: f64,
    /// Number of compared pairs.
    pub pairs: usize,
    /// Number of poses of the reference.
    pub reference_poses: usize,
    /// Number of poses of the estimate.
    pub estimate_poses: usize,
    /// Fraction of the recording's frames that have a pose, where the estimate's file says how many frames there were.
    pub coverage: Option<f64>,
    /// Fraction of the reference that has a pose of the estimate near it, see [`coverage_of_reference`].
    pub reference_covered: f64,
    /// Path length of the reference over the pairs, in metres.
    pub path_m: f64,
    /// Absolute trajectory error (ATE): distances of positions in metres.
    pub ate_m: Statistics,
    /// Absolute rotation error in degrees.
    pub ate_deg: Option<Statistics>,
    /// Distance between the poses of a pair for the relative error, as `1f`, `0.5m`, `2s`.
    pub delta: String,
    /// Relative pose error (RPE), translation part, in metres.
    pub rpe_m: Option<Statistics>,
    /// Relative pose error (RPE), rotation angle, in degrees.
    pub rpe_deg: Option<Statistics>,
    /// The drift over segments of 100 to 800 m as in the KITTI odometry benchmark; `None` on shorter trajectories.
    pub kitti: Option<KittiErrors>,
    /// Remarks for the reader, in sentences.
    pub notes: Vec<String>,
    /// The alignment.
    #[serde(skip)]
    pub reference_from_estimate: Sim3,
    /// The pairs, in order of time, for plots.
    #[serde(skip)]
    pub errors: Vec<PairError>,
}

impl Evaluation {
    /// ATE (RMSE) as a fraction of the path length; `None` when the reference does not move.
    pub fn drift(&self) -> Option<f64> {
        (self.path_m > 1e-6).then(|| self.ate_m.rmse / self.path_m)
    }
}

/// Compares two trajectory files; handles files with positions only and files without times.
///
/// # Errors
/// As [`evaluate`], and when it is not known which poses belong together.
pub fn evaluate_files(
    reference: &TrajectoryFile,
    estimate: &TrajectoryFile,
    options: &EvalOptions,
) -> Result<Evaluation, EvalError> {
    let mut options = *options;
    options.rotations &= reference.has_rotations && estimate.has_rotations;
    options.association = association(reference, estimate)?;
    let (compared, note) = reference_for(estimate, reference);
    let mut out = evaluate(&compared, &estimate.trajectory, &options)?;
    out.notes.extend(note);
    let frames = estimate.header.as_ref().and_then(|h| h.frames).filter(|frames| *frames > 0);
    out.coverage = frames.map(|frames| estimate.trajectory.len() as f64 / frames as f64);
    for file in [reference, estimate] {
        if !file.has_rotations {
            out.notes.push(format!("{} has positions only: no angles and no relative error", file.name));
        }
        if file.unknown_poses > 0 {
            out.notes.push(format!("{}: {} lines are nan and were left out", file.name, file.unknown_poses));
        }
    }
    if reference.nominal_times != estimate.nominal_times {
        let without = if reference.nominal_times { reference } else { estimate };
        out.notes.push(match options.association {
            Association::Time => {
                format!(
                    "{} has no times: those of its frames' numbers were used, as in the other",
                    without.name
                )
            }
            Association::Index => format!("{} has no times: poses were paired in order", without.name),
        });
    }
    Ok(out)
}

/// The poses of the reference in the frame that the estimate's poses are of, and what there is to say of it. A file that names no frame
/// has poses of the rig's body.
pub fn reference_for<'a>(
    estimate: &TrajectoryFile,
    reference: &'a TrajectoryFile,
) -> (Cow<'a, Trajectory>, Option<String>) {
    let of = |file: &TrajectoryFile| file.header.clone().unwrap_or_default();
    let (ours, theirs) = (of(estimate), of(reference));
    let as_it_is = Cow::Borrowed(&reference.trajectory);
    if ours.body_from_frame == theirs.body_from_frame {
        return (as_it_is, None);
    }
    let names =
        format!("{} has poses of {}, {} of {}", estimate.name, ours.frame, reference.name, theirs.frame);
    if !reference.has_rotations || !theirs.metric {
        let lacks = if theirs.metric { "rotations" } else { "metres" };
        return (
            as_it_is,
            Some(format!("{names}: compared as they are, since the reference has no {lacks}")),
        );
    }
    let moved = ours.poses_from(&theirs, &reference.trajectory);
    (Cow::Owned(moved), Some(format!("{names}: the reference was moved to {}", ours.frame)))
}

/// How poses of two files are paired. Times that are only numbers of frames are paired with other times only where these
/// are the same numbers.
fn association(reference: &TrajectoryFile, estimate: &TrajectoryFile) -> Result<Association, EvalError> {
    let counts = (reference.trajectory.len(), estimate.trajectory.len());
    let kitti = |file: &TrajectoryFile| file.format == Format::Kitti && !file.frame_numbers;
    if kitti(reference) && kitti(estimate) {
        return match counts {
            (a, b) if a == b => Ok(Association::Index),
            (reference, estimate) => Err(EvalError::Counts { estimate, reference }),
        };
    }
    if reference.nominal_times == estimate.nominal_times {
        return Ok(Association::Time);
    }
    let (nominal, timed) =
        if reference.nominal_times { (reference, estimate) } else { (estimate, reference) };
    if on_grid(timed.trajectory.stamps_ns(), nominal.trajectory.stamps_ns()) {
        return Ok(Association::Time);
    }
    if counts.0 == counts.1 {
        return Ok(Association::Index);
    }
    let (poses, others) = (nominal.trajectory.len(), timed.trajectory.len());
    Err(EvalError::NoTimes { without: nominal.name.clone(), poses, others })
}

/// Whether every time is within a millisecond of one of the others, both in order.
fn on_grid(times_ns: &[i64], grid_ns: &[i64]) -> bool {
    times_ns.iter().all(|t| {
        let k = grid_ns.partition_point(|g| g < t);
        let near = grid_ns[k.saturating_sub(1)..grid_ns.len().min(k + 1)].iter();
        near.into_iter().any(|g| g.abs_diff(*t) <= 1_000_000)
    })
}

/// Compares an estimate with a reference, both `world_from_body` of the same body.
///
/// # Errors
/// When no poses are associated, the alignment is not determined, or an option is invalid.
pub fn evaluate(
    reference: &Trajectory,
    estimate: &Trajectory,
    options: &EvalOptions,
) -> Result<Evaluation, EvalError> {
    if !(options.max_difference_s >= 0.0 && options.max_difference_s.is_finite()) {
        return Err(EvalError::Option(format!(
            "--max-difference {}: must be zero or more seconds",
            options.max_difference_s
        )));
    }
    let matches = match options.association {
        Association::Time => associate(reference.stamps_ns(), estimate.stamps_ns(), options.max_difference_s),
        Association::Index => (0..reference.len().min(estimate.len())).map(|i| (i, i)).collect(),
    };
    if matches.is_empty() {
        return Err(EvalError::NoPairs {
            max_difference_s: options.max_difference_s,
            reference_span: span(reference),
            estimate_span: span(estimate),
        });
    }
    let targets: Vec<Vec3> = matches.iter().map(|(i, _)| reference.poses()[*i].translation).collect();
    let sources: Vec<Vec3> = matches.iter().map(|(_, j)| estimate.poses()[*j].translation).collect();
    let aligned_from_estimate = match options.align {
        Align::None => Sim3::identity(),
        Align::Se3 => umeyama(&targets, &sources, false)?,
        Align::Sim3 => umeyama(&targets, &sources, true)?,
    };
    let matched = Matched::new(reference, estimate, &matches, &aligned_from_estimate);
    let errors: Vec<PairError> = matched.errors();
    let distances: Vec<f64> = errors.iter().map(|e| e.error_m).collect();
    let ate_m = Statistics::of(&distances)
        .ok_or_else(|| EvalError::Option("the distances are not finite numbers".into()))?;
    let reference_covered = match options.association {
        Association::Time => {
            coverage_of_reference(reference.stamps_ns(), estimate.stamps_ns(), options.max_difference_s)
        }
        Association::Index => matches.len() as f64 / reference.len() as f64,
    };
    let mut notes = Vec::new();
    let (mut ate_deg, mut rpe_m, mut rpe_deg, mut kitti) = (None, None, None, None);
    if options.rotations {
        ate_deg = Statistics::of(&matched.angles_deg());
        kitti = kitti_errors(&matched.reference, &matched.estimate);
        let (metres, degrees) = matched.relative(options);
        (rpe_m, rpe_deg) = (Statistics::of(&metres), Statistics::of(&degrees));
        if metres.is_empty() {
            notes.push(format!("no two poses are {} apart: no relative error", options.delta));
        }
    }
    Ok(Evaluation {
        align: options.align,
        scale: aligned_from_estimate.scale,
        pairs: matches.len(),
        reference_poses: reference.len(),
        estimate_poses: estimate.len(),
        coverage: None,
        reference_covered,
        path_m: targets.windows(2).map(|w| (w[1] - w[0]).norm()).sum(),
        ate_m,
        ate_deg,
        delta: options.delta.to_string(),
        rpe_m,
        rpe_deg,
        kitti,
        notes,
        reference_from_estimate: aligned_from_estimate,
        errors,
    })
}

/// The fraction of a source's frames that have a pose (the coverage of a run), where frame and pose times must be equal
/// to the nanosecond.
pub fn tracked_fraction(frames_ns: &[i64], estimate: &Trajectory) -> f64 {
    coverage_of_frames(frames_ns, estimate.stamps_ns(), 0.0)
}

fn span(trajectory: &Trajectory) -> String {
    match (trajectory.stamps_ns().first(), trajectory.stamps_ns().last()) {
        (Some(a), Some(b)) => format!("{} to {} s", seconds_text(*a), seconds_text(*b)),
        _ => "without poses".to_owned(),
    }
}

/// The associated poses, with the estimate already aligned; all lists have the same length.
struct Matched {
    stamps_ns: Vec<i64>,
    reference: Vec<cairn_geometry::Se3>,
    estimate: Vec<cairn_geometry::Se3>,
}

impl Matched {
    fn new(reference: &Trajectory, estimate: &Trajectory, matches: &[(usize, usize)], align: &Sim3) -> Self {
        Self {
            stamps_ns: matches.iter().map(|(_, j)| estimate.stamps_ns()[*j]).collect(),
            reference: matches.iter().map(|(i, _)| reference.poses()[*i]).collect(),
            estimate: matches.iter().map(|(_, j)| align.transform_pose(&estimate.poses()[*j])).collect(),
        }
    }

    fn errors(&self) -> Vec<PairError> {
        let poses = self.reference.iter().zip(&self.estimate);
        let pair = |((r, e), stamp_ns): ((&cairn_geometry::Se3, &cairn_geometry::Se3), &i64)| PairError {
            stamp_ns: *stamp_ns,
            reference: r.translation,
            estimate: e.translation,
            error_m: (e.translation - r.translation).norm(),
        };
        poses.zip(&self.stamps_ns).map(pair).collect()
    }

    fn angles_deg(&self) -> Vec<f64> {
        let poses = self.reference.iter().zip(&self.estimate);
        poses.map(|(r, e)| (r.rotation.inverse() * e.rotation).angle().to_degrees()).collect()
    }

    /// Sturm et al. eq. 2: `(Q_i^-1 Q_j)^-1 (P_i^-1 P_j)`, its translation in metres and angle in degrees.
    fn relative(&self, options: &EvalOptions) -> (Vec<f64>, Vec<f64>) {
        let index_pairs =
            pairs(&self.estimate, &self.stamps_ns, options.delta, options.all_pairs, options.delta_tolerance);
        let error = |(i, j): (usize, usize)| {
            let reference = self.reference[i].inverse() * self.reference[j];
            let estimate = self.estimate[i].inverse() * self.estimate[j];
            let error = reference.inverse() * estimate;
            (error.translation.norm(), error.rotation.angle().to_degrees())
        };
        index_pairs.into_iter().map(error).unzip()
    }
}
