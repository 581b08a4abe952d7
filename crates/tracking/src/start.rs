//! The start of a map: from one frame with depth, or from two views.

use crate::state::{Offer, State};
use cairn_geometry::Vec3;
use cairn_vision::{EyeModel, Frame, Octaves, Target, consistent_rotation, search};
use std::sync::Arc;

/// Waits for a frame, or a pair of frames, from which a map can begin.
#[derive(Debug, Default)]
pub(crate) struct Starter {
    first: Option<Arc<Frame>>,
    /// Where each feature of the first frame was seen last.
    trail: Vec<[f32; 2]>,
    attempts: u64,
}

impl Starter {
    /// Looks at a frame: an offer when a map can begin, else what is missing. `features` is the eye's budget.
    pub fn step(
        &mut self,
        eye: &EyeModel,
        octaves: Octaves,
        frame: &Arc<Frame>,
        features: usize,
    ) -> Result<Offer, State> {
        if eye.baseline_fx > 0.0 {
            // Relative to the budget, so that rooms with few features start too.
            let need = (features / 12).max(40);
            let have = (0..frame.len()).filter(|i| frame.has_depth(*i)).count();
            return if have >= need {
                Ok(Offer::First(frame.clone()))
            } else {
                Err(State::Starting { have, need })
            };
        }
        self.pair(eye, octaves, frame, (features / 10).max(50))
    }

    fn pair(
        &mut self,
        eye: &EyeModel,
        octaves: Octaves,
        frame: &Arc<Frame>,
        need: usize,
    ) -> Result<Offer, State> {
        let Some(first) = self.first.clone() else {
            if frame.len() >= need {
                self.trail = frame.px.clone();
                self.first = Some(frame.clone());
            }
            return Err(State::Starting { have: 0, need });
        };
        let matches = self.matches(&first, frame);
        if matches.len() < need {
            // The view has moved on too far: begin again from here.
            self.first = None;
            return Err(State::Starting { have: matches.len(), need });
        }
        self.attempts += 1;
        let waiting = State::Starting { have: matches.len(), need };
        let Some((first_from_second, points)) =
            two_views(eye, octaves, &first, frame, &matches, self.attempts)
        else {
            return Err(waiting);
        };
        if points.len() < need / 2 {
            return Err(waiting);
        }
        *self = Self { attempts: self.attempts, ..Self::default() };
        Ok(Offer::Pair { first, second: frame.clone(), first_from_second, points })
    }

    /// Finest-level features of the first frame around where they were last seen.
    fn matches(&mut self, first: &Frame, frame: &Frame) -> Vec<(usize, usize)> {
        let mut owner: Vec<Option<(usize, u32)>> = vec![None; frame.len()];
        for i in (0..first.len()).filter(|i| first.octave[*i] == 0) {
            let target = Target {
                pixel: self.trail[i],
                right_x: f32::NAN,
                radius: 100.0,
                octaves: [0, 0],
                descriptor: &first.descriptors[i],
            };
            if let Some(f) = search(frame, &target, |_| true)
                && f.distance <= 50
                && (f.distance as f64) < 0.9 * f.second as f64
                && owner[f.feature].is_none_or(|(_, d)| f.distance < d)
            {
                owner[f.feature] = Some((i, f.distance));
            }
        }
        let turned = owner
            .iter()
            .enumerate()
            .filter_map(|(j, o)| o.map(|(i, _)| ((i, j), first.angle[i] - frame.angle[j])));
        let matches = consistent_rotation(turned.collect());
        for (i, j) in &matches {
            self.trail[*i] = frame.px[*j];
        }
        matches
    }
}

type Pair = (cairn_geometry::Se3, Vec<(u16, u16, Vec3)>);

fn two_views(
    _eye: &EyeModel,
    _octaves: Octaves,
    _first: &Frame,
    _second: &Frame,
    _matches: &[(usize, usize)],
    _seed: u64,
) -> Option<Pair> {
    None
}
