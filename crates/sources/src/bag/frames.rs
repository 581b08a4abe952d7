//! A tree of static transforms, and where one frame is in another.

use cairn_geometry::Se3;
use std::collections::{BTreeSet, VecDeque};

/// Transforms between named frames.
#[derive(Clone, Debug, Default)]
pub struct Frames {
    /// Parent, child, `parent_from_child`.
    edges: Vec<(String, String, Se3)>,
}

impl Frames {
    /// Adds a transform; a later one between the same frames takes precedence.
    pub fn add(&mut self, parent: &str, child: &str, parent_from_child: Se3) {
        self.edges.retain(|(p, c, _)| (p.as_str(), c.as_str()) != (parent, child));
        self.edges.push((parent.into(), child.into(), parent_from_child));
    }

    /// `a_from_b`, by the shortest chain; `None` when there is none.
    pub fn between(&self, a: &str, b: &str) -> Option<Se3> {
        let mut queue = VecDeque::from([(a, Se3::identity())]);
        let mut seen = BTreeSet::from([a]);
        while let Some((at, a_from_at)) = queue.pop_front() {
            if at == b {
                return Some(a_from_at);
            }
            for (parent, child, parent_from_child) in &self.edges {
                let next = match (parent == at, child == at) {
                    (true, _) => (child.as_str(), a_from_at * *parent_from_child),
                    (_, true) => (parent.as_str(), a_from_at * parent_from_child.inverse()),
                    _ => continue,
                };
                if seen.insert(next.0) {
                    queue.push_back(next);
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So3, Vec3};

    #[test]
    fn chains_go_up_and_down() {
        let turned = Se3::new(So3::exp(&Vec3::new(0.1, -0.4, 0.9)), Vec3::new(1.0, 2.0, 3.0));
        let moved = Se3::new(So3::exp(&Vec3::new(-0.3, 0.2, 0.5)), Vec3::new(-1.0, 0.5, 0.1));
        let mut frames = Frames::default();
        frames.add("base", "left", turned);
        frames.add("base", "imu", moved);
        let imu_from_left = frames.between("imu", "left").unwrap();
        let expected = moved.inverse() * turned;
        assert!((imu_from_left.matrix() - expected.matrix()).norm() < 1e-12);
        assert!(
            (frames.between("left", "imu").unwrap().matrix() - expected.inverse().matrix()).norm() < 1e-12
        );
        assert!(frames.between("imu", "right").is_none());
        assert_eq!(frames.between("alone", "alone"), Some(Se3::identity()));
    }
}
