//! What the poses of a trajectory file are of, in which unit, and of how many frames: comment lines at its beginning.
//!
//! | line | what it says |
//! |---|---|
//! | `# frame: NAME` | the poses are `world_from_NAME` |
//! | `# body_from_NAME: x y z qx qy qz qw` | where that is on the rig's body, metres |
//! | `# lengths: metres` or `# lengths: units of the map` | the unit of positions |
//! | `# frames: N` | frames of the recording, with and without a pose |

use cairn_geometry::{Se3, So3, Trajectory, Vec3};
use std::fmt::Write as _;

/// What the poses of a trajectory are of.
#[derive(Clone, Debug, PartialEq)]
pub struct TrajectoryHeader {
    /// The name of the frame: `body`, `cam0`.
    pub frame: String,
    /// Where it is on the rig's body, metres; the identity for the body itself.
    pub body_from_frame: Se3,
    /// True where positions are in metres.
    pub metric: bool,
    /// Number of frames of the recording, with and without a pose.
    pub frames: Option<usize>,
}

impl Default for TrajectoryHeader {
    /// A file that says nothing is taken for poses of the body, in metres.
    fn default() -> Self {
        Self { frame: "body".into(), body_from_frame: Se3::identity(), metric: true, frames: None }
    }
}

impl TrajectoryHeader {
    /// The comment lines.
    pub fn to_text(&self) -> String {
        let Self { frame, body_from_frame, metric, frames } = self;
        let (p, q) = (body_from_frame.translation, body_from_frame.rotation.quaternion());
        let unit = if *metric { "metres" } else { "units of the map" };
        let mut text = format!("# frame: {frame}\n# lengths: {unit}\n");
        if *body_from_frame != Se3::identity() {
            // Digits enough to give the same numbers again.
            let numbers = [p.x, p.y, p.z, q.i, q.j, q.k, q.w].map(|v| format!("{v:e}")).join(" ");
            let _ = writeln!(text, "# body_from_{frame}: {numbers}");
        }
        if let Some(frames) = frames {
            let _ = writeln!(text, "# frames: {frames}");
        }
        text
    }

    /// Takes up what a comment line of a file says; `None` where the line says nothing of this.
    pub(crate) fn read(header: &mut Option<Self>, comment: &str) -> Option<()> {
        let (key, value) = comment.trim_start_matches('#').trim().split_once(": ")?;
        if key == "frame" {
            *header = Some(Self { frame: value.to_owned(), ..Self::default() });
            return Some(());
        }
        let known = header.as_mut()?;
        match key {
            "lengths" => known.metric = value == "metres",
            "frames" => known.frames = Some(value.parse().ok()?),
            _ => {
                key.strip_prefix("body_from_").filter(|name| *name == known.frame)?;
                known.body_from_frame = pose_of_numbers(value)?;
            }
        }
        Some(())
    }

    /// Poses of this frame, given those of another one on the same body.
    pub fn poses_from(&self, other: &Self, poses: &Trajectory) -> Trajectory {
        let other_from_this = other.body_from_frame.inverse() * self.body_from_frame;
        poses.map(|pose| *pose * other_from_this)
    }
}

/// A pose from the numbers `x y z qx qy qz qw`; `None` where they are none.
fn pose_of_numbers(text: &str) -> Option<Se3> {
    let numbers: Result<Vec<f64>, _> = text.split_ascii_whitespace().map(str::parse).collect();
    let [x, y, z, qx, qy, qz, qw] = numbers.ok()?.try_into().ok()?;
    let translation = Vec3::new(x, y, z);
    let rotation = So3::from_xyzw(qx, qy, qz, qw)?;
    translation.iter().all(|v| v.is_finite()).then(|| Se3::new(rotation, translation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EvalOptions, evaluate_files, parse_trajectory, to_tum, to_tum_with};

    fn walk() -> Trajectory {
        let pose = |k: i64| {
            let a = 0.1 * k as f64;
            Se3::new(So3::exp(&Vec3::new(0.3 * a.sin(), 0.2 * a, a)), Vec3::new(a.cos(), a.sin(), 0.3 * a))
        };
        Trajectory::from_unsorted((0..60).map(|k| (k * 50_000_000, pose(k))).collect()).unwrap()
    }

    fn cam0(metric: bool) -> TrajectoryHeader {
        let body_from_frame = Se3::new(So3::exp(&Vec3::new(0.1, -1.2, 0.4)), Vec3::new(0.1, -0.4, 0.2));
        TrajectoryHeader { frame: "cam0".into(), body_from_frame, metric, frames: Some(80) }
    }

    #[test]
    fn header_is_read_as_it_was_written_and_other_comments_are_none() {
        for header in [cam0(false), cam0(true), TrajectoryHeader::default()] {
            let file = parse_trajectory(&to_tum_with(&header, &walk()), "a", None).unwrap();
            assert_eq!(file.header, Some(header));
        }
        let file = parse_trajectory(&format!("# made by: me\n# frames: 7\n{}", to_tum(&walk())), "a", None);
        assert_eq!(file.unwrap().header, None, "only a file that names its frame says anything");
    }

    #[test]
    fn poses_of_a_camera_are_compared_with_the_truth_at_the_camera() {
        let truth = walk();
        let at_camera = truth.map(|body| *body * cam0(true).body_from_frame);
        let reference = parse_trajectory(&to_tum(&truth), "truth", None).unwrap();
        let estimate = parse_trajectory(&to_tum_with(&cam0(true), &at_camera), "camera", None).unwrap();
        let found = evaluate_files(&reference, &estimate, &EvalOptions::default()).unwrap();
        assert!(found.ate_m.max < 1e-8 && found.ate_deg.unwrap().max < 1e-5, "{:?}", found.ate_m);
        assert_eq!(found.coverage, Some(60.0 / 80.0));
        assert!(found.notes[0].contains("moved to cam0"), "{:?}", found.notes);
        let plain = parse_trajectory(&to_tum(&at_camera), "camera", None).unwrap();
        let found = evaluate_files(&reference, &plain, &EvalOptions::default()).unwrap();
        assert!(found.ate_m.max > 0.1 && found.notes.is_empty(), "it cannot be known: {:?}", found.ate_m);
        let mut positions = parse_trajectory(&to_tum(&truth), "truth", None).unwrap();
        positions.has_rotations = false;
        let found = evaluate_files(&positions, &estimate, &EvalOptions::default()).unwrap();
        assert!(found.notes[0].contains("no rotations"), "{:?}", found.notes);
    }
}
