//! Map initialisation: from one frame with depth, or from two views.

use crate::state::{KeyFrameRequest, State};
use cairn_geometry::Vec3;
use cairn_vision::{Frame, RectifiedCamera, Target, TwoViewConfig, consistent_rotation, search, two_view};
use std::sync::Arc;

/// The coarsest pyramid level used for the two-view initialisation.
const FINE: u8 = 3;

/// Waits for a frame, or a pair of frames, from which a map can be initialised.
#[derive(Debug, Default)]
pub(crate) struct Starter {
    first: Option<Arc<Frame>>,
    /// Where each feature of the first frame was seen last.
    trail: Vec<[f32; 2]>,
    attempts: u64,
}

impl Starter {
    /// Examines a frame: a request when a map can be initialised, else the progress so far. `features` is the
    /// feature budget of the front end.
    pub fn step(
        &mut self,
        camera: &RectifiedCamera,
        frame: &Arc<Frame>,
        features: usize,
    ) -> Result<KeyFrameRequest, State> {
        if camera.has_depth() {
            // Relative to the budget, so that scenes with few features can start too.
            let need = (features / 12).max(40);
            let have = (0..frame.len()).filter(|i| frame.has_depth(*i)).count();
            return if have >= need {
                Ok(KeyFrameRequest::First { frame: frame.clone(), relocation_prior: None, imu: None })
            } else {
                Err(State::Starting { have, need })
            };
        }
        self.pair(camera, frame, (features / 12).max(50))
    }

    /// Follows the features of the first frame through one with which no map is to begin.
    pub fn follow(&mut self, frame: &Arc<Frame>, features: usize) {
        let need = (features / 12).max(50);
        let matched = self.first.clone().map_or(0, |first| self.matches(&first, frame).len());
        if matched < need {
            self.set_first(frame, need);
        }
    }

    fn pair(
        &mut self,
        camera: &RectifiedCamera,
        frame: &Arc<Frame>,
        need: usize,
    ) -> Result<KeyFrameRequest, State> {
        let Some(first) = self.first.clone() else {
            self.set_first(frame, need);
            return Err(State::Starting { have: 0, need });
        };
        let matches = self.matches(&first, frame);
        if matches.len() < need {
            // Too little overlap with the first frame: start again from this one.
            self.set_first(frame, need);
            return Err(State::Starting { have: matches.len(), need });
        }
        self.attempts += 1;
        let waiting = State::Starting { have: matches.len(), need };
        let Some((first_from_second, points)) = two_views(camera, &first, frame, &matches, self.attempts)
        else {
            return Err(waiting);
        };
        if points.len() < need / 2 {
            return Err(waiting);
        }
        *self = Self { attempts: self.attempts, ..Self::default() };
        Ok(KeyFrameRequest::Pair {
            first,
            second: frame.clone(),
            first_from_second,
            points,
            relocation_prior: None,
            imu: None,
            clocks: None,
        })
    }

    /// Makes a frame the first of the pair, when it has enough features.
    fn set_first(&mut self, frame: &Arc<Frame>, need: usize) {
        self.trail = frame.px.clone();
        self.first = (frame.len() >= need).then(|| frame.clone());
    }

    /// Matches fine-level features of the first frame around where they were last seen.
    fn matches(&mut self, first: &Frame, frame: &Frame) -> Vec<(usize, usize)> {
        let expected: Vec<Option<[f32; 2]>> = self.trail.iter().copied().map(Some).collect();
        let matches = match_around(first, frame, &expected, 100.0);
        for (i, j) in &matches {
            self.trail[*i] = frame.px[*j];
        }
        matches
    }
}

/// Matches fine-level features of one frame within a radius of where each is in another.
pub(crate) fn match_within(first: &Frame, second: &Frame, radius: f32) -> Vec<(usize, usize)> {
    let here: Vec<Option<[f32; 2]>> = first.px.iter().copied().map(Some).collect();
    match_around(first, second, &here, radius)
}

/// Matches fine-level features of one frame within a radius of where each is expected in another.
pub(crate) fn match_around(
    first: &Frame,
    frame: &Frame,
    expected: &[Option<[f32; 2]>],
    radius: f32,
) -> Vec<(usize, usize)> {
    let mut owner: Vec<Option<(usize, u32)>> = vec![None; frame.len()];
    for i in (0..first.len()).filter(|i| first.octave[*i] <= FINE) {
        let Some(pixel) = expected[i] else { continue };
        let octave = first.octave[i];
        let target = Target {
            pixel,
            right_x: f32::NAN,
            radius,
            octaves: [octave.saturating_sub(1), octave + 1],
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
    let angle_changes = owner
        .iter()
        .enumerate()
        .filter_map(|(j, o)| o.map(|(i, _)| ((i, j), first.angle[i] - frame.angle[j])));
    consistent_rotation(angle_changes.collect())
}

type Pair = (cairn_geometry::Se3, Vec<(u16, u16, Vec3)>);

fn two_views(
    camera: &RectifiedCamera,
    first: &Frame,
    second: &Frame,
    matches: &[(usize, usize)],
    seed: u64,
) -> Option<Pair> {
    let (a, b): (Vec<[f32; 2]>, Vec<[f32; 2]>) =
        matches.iter().map(|(i, j)| (first.px[*i], second.px[*j])).unzip();
    // Corners of the finest levels are located with subpixel accuracy: half a pixel covers their error.
    let config = TwoViewConfig { sigma_px: 0.5, ..TwoViewConfig::default() };
    let found = two_view(camera, &a, &b, &config, seed).ok()?;
    let points =
        matches.iter().zip(&found.points).filter_map(|((i, j), p)| Some((*i as u16, *j as u16, (*p)?)));
    Some((found.second_from_first.inverse(), points.collect()))
}
