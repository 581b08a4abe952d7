//! A kind of factor of a window: an IMU, wheels, relative poses, a prior. One file and one [`Window`](crate::Window)`::of(..).add(..)` each.
//!
//! The solver's part is its supertrait [`Factors`]: the variables that each factor touches, residuals and Jacobians. Here is the map's part:
//! which key frames it needs, what it measured between them, and what it says when they contradict it.

use cairn_atlas::{Change, KeyFrameId, MapId, Snapshot};
use cairn_geometry::Se3;
use cairn_solve::{Factors, Freedom};

/// Factors of one kind in a window. All but [`WindowFactors::bind`] have a default.
pub trait WindowFactors: Factors + Send {
    /// Key frames that have to move with a centre, beside those that share its landmarks; `None` where there can be no window.
    fn chain(&self, _: &Snapshot, _centre: KeyFrameId) -> Option<Chain> {
        Some(Chain::default())
    }
    /// Adds key frames that stay, and says of poses how far they may move.
    fn choose(&mut self, _: &Snapshot, _: &mut Frames) {}
    /// Takes its factors between the key frames of the window; returns how many there are.
    fn bind(&mut self, snapshot: &Snapshot, frames: &Frames) -> usize;
    /// Damping of the first step, relative to the diagonal. The least of all kinds counts.
    fn first_damping(&self) -> f64 {
        1e-5
    }
    /// Leaves out its outliers, before the second part of a solve.
    fn leave_out_outliers(&mut self, _poses: &[Se3]) {}
    /// What it says of the poses after a solve.
    fn judge(&mut self, _before: &[Se3], _after: &[Se3]) -> Judgement {
        Judgement::Agrees
    }
    /// What was found of its own variables.
    fn changes(&self, _: &Frames, _poses: &[Se3]) -> Vec<Change> {
        Vec::new()
    }
}

/// Key frames that belong together.
#[derive(Clone, Debug, Default)]
pub struct Chain {
    /// They move.
    pub moving: Vec<KeyFrameId>,
    /// It does not.
    pub before: Option<KeyFrameId>,
}

/// What a kind of factor says of poses that a solve led to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Judgement {
    /// They agree with what was measured, or outweigh it.
    Agrees,
    /// They contradict some of it, which was left out: the window is solved again from where it was.
    LeftOut,
    /// They contradict it, and those before were right: they stay, and landmarks follow.
    PosesWereRight,
}

/// The key frames of a window.
#[derive(Clone, Debug)]
pub struct Frames {
    /// Those that move, then those that stay.
    pub key_frames: Vec<KeyFrameId>,
    /// How many of them move, unless their freedom says otherwise.
    pub moving: usize,
    /// Poses before the solve, `world_from_camera`.
    pub poses: Vec<Se3>,
    /// How far each may move: without further ado all that move, but for the root of the map.
    pub freedom: Vec<Freedom>,
    /// The map they are of.
    pub map: MapId,
    /// The one that the window is around; `None` in that of a whole map.
    pub centre: Option<KeyFrameId>,
    /// True where factors say where the map is; else one pose is fixed.
    pub is_anchored: bool,
}

impl Frames {
    pub(crate) fn of(
        snapshot: &Snapshot,
        map: MapId,
        centre: Option<KeyFrameId>,
        key_frames: Vec<KeyFrameId>,
        moving: usize,
    ) -> Self {
        let pose = |id: &KeyFrameId| snapshot.key_frame(*id).map_or(Se3::identity(), |k| k.world_from_camera);
        let freedom = |(slot, id): (usize, &KeyFrameId)| match slot < moving && *id != map.root() {
            true => Freedom::Free,
            false => Freedom::Fixed,
        };
        let poses = key_frames.iter().map(pose).collect();
        let freedom = key_frames.iter().enumerate().map(freedom).collect();
        Self { key_frames, moving, poses, freedom, map, centre, is_anchored: false }
    }

    /// The index of a key frame among the poses.
    pub fn slot(&self, id: KeyFrameId) -> Option<usize> {
        self.key_frames.iter().position(|k| *k == id)
    }

    /// Whether one of these poses may move.
    pub fn any_moves(&self, slots: &[usize]) -> bool {
        slots.iter().any(|slot| self.freedom[*slot] != Freedom::Fixed)
    }

    /// Adds a key frame that stays, if the window does not have it yet.
    pub fn hold(&mut self, snapshot: &Snapshot, id: KeyFrameId) {
        if let Some(k) = snapshot.key_frame(id).filter(|_| self.slot(id).is_none()) {
            self.key_frames.push(id);
            self.poses.push(k.world_from_camera);
            self.freedom.push(Freedom::Fixed);
        }
    }

    /// Something must fix where the map is: where no key frame stays it is the oldest one.
    pub(crate) fn fix_one(&mut self) {
        if !self.is_anchored
            && !self.freedom.contains(&Freedom::Fixed)
            && let Some(oldest) = (0..self.key_frames.len()).min_by_key(|slot| self.key_frames[*slot])
        {
            self.freedom[oldest] = Freedom::Fixed;
        }
    }
}
