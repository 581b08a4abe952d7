//! The start of a map: from one frame with depth, or from two views, or from three where two leave it open.

use crate::rivals::{Rivals, Verdict};
use crate::state::{Offer, State};
use cairn_geometry::{Se3, Vec3};
use cairn_vision::{
    EyeModel, Frame, Target, TriangulateGate, TwoViewSetting, consistent_rotation, search,
    triangulate_checked, two_view_motions,
};
use std::sync::Arc;

/// Levels up to this one are fine enough to start from.
const FINE: u8 = 3;

/// Standard deviation of a keypoint, pixels: sub-pixel corners of the finest levels, half a pixel covers them.
pub(crate) const SIGMA_PX: f64 = 0.5;
/// Frames that are kept as the first of a pair at the same time: when the view has left one behind, the next goes on.
const TRIES: usize = 3;
/// Seconds between two of them.
const APART_S: f64 = 0.25;

/// Waits for a frame, or a pair of frames, from which a map can begin.
#[derive(Debug, Default)]
pub(crate) struct Starter {
    /// Oldest first.
    tries: Vec<Try>,
    attempts: u64,
}

/// A frame that may become the first of the pair.
#[derive(Debug)]
struct Try {
    first: Arc<Frame>,
    /// Where each of its features was seen last.
    trail: Vec<[f32; 2]>,
    /// Motions that explain it and a later frame about equally well.
    rivals: Option<Rivals>,
}

impl Starter {
    /// Looks at a frame: an offer when a map can begin, else what is missing. `features` is the eye's budget.
    pub fn step(&mut self, eye: &EyeModel, frame: &Arc<Frame>, features: usize) -> Result<Offer, State> {
        if eye.baseline_fx > 0.0 {
            // Relative to the budget, so that rooms with few features start too.
            let need = (features / 12).max(40);
            let have = (0..frame.len()).filter(|i| frame.has_depth(*i)).count();
            return if have >= need {
                Ok(Offer::First { frame: frame.clone(), adrift: None, sensed: None })
            } else {
                Err(State::Starting { have, need })
            };
        }
        self.pair(eye, frame, (features / 12).max(50))
    }

    fn pair(&mut self, eye: &EyeModel, frame: &Arc<Frame>, need: usize) -> Result<Offer, State> {
        let mut have = 0;
        let mut going_on = Vec::with_capacity(TRIES);
        for mut tried in std::mem::take(&mut self.tries) {
            let matches = tried.matches(frame);
            have = have.max(matches.len());
            if matches.len() < need {
                // The view has moved on too far.
                continue;
            }
            self.attempts += 1;
            if let Some((first_from_second, points)) = tried.look(eye, frame, &matches, need, self.attempts) {
                return Ok(Offer::Pair {
                    first: tried.first,
                    second: frame.clone(),
                    first_from_second,
                    points,
                    adrift: None,
                    sensed: None,
                });
            }
            going_on.push(tried);
        }
        self.tries = going_on;
        if self.tries.last().is_none_or(|t| frame.stamp - t.first.stamp >= APART_S) && frame.len() >= need {
            if self.tries.len() == TRIES {
                // The oldest has the most parallax, the youngest shares most with what comes.
                self.tries.remove(1);
            }
            self.tries.push(Try { first: frame.clone(), trail: frame.px.clone(), rivals: None });
        }
        Err(State::Starting { have, need })
    }
}

impl Try {
    /// The pair of the first and this frame, when two views, or three, tell the motion between them.
    fn look(
        &mut self,
        eye: &EyeModel,
        frame: &Arc<Frame>,
        matches: &[(usize, usize)],
        need: usize,
        seed: u64,
    ) -> Option<Pair> {
        if let Some(rivals) = &mut self.rivals {
            match rivals.look(eye, &self.first, frame, matches) {
                Verdict::Decided(first_from_third) => {
                    let pair = meet(eye, &self.first, frame, matches, &first_from_third);
                    return pair.filter(|p| p.1.len() >= need / 2);
                }
                // What two views tell alone is less than what is being weighed.
                Verdict::Open => return None,
                Verdict::Over => self.rivals = None,
            }
        }
        let (a, b): (Vec<[f32; 2]>, Vec<[f32; 2]>) =
            matches.iter().map(|(i, j)| (self.first.px[*i], frame.px[*j])).unzip();
        let motions = two_view_motions(eye, &a, &b, &two_view_setting(), seed).ok()?;
        if motions.len() > 1 {
            self.rivals.get_or_insert_with(|| Rivals::new(frame, matches, &motions));
            return None;
        }
        let found = motions.first()?;
        let points: Vec<_> = matches
            .iter()
            .zip(&found.points)
            .filter_map(|((i, j), p)| Some((*i as u16, *j as u16, (*p)?)))
            .collect();
        (points.len() >= need / 2).then(|| (found.second_from_first.inverse(), points))
    }

    /// Fine-level features of the first frame around where they were last seen.
    fn matches(&mut self, frame: &Frame) -> Vec<(usize, usize)> {
        let first = self.first.clone();
        let mut owner: Vec<Option<(usize, u32)>> = vec![None; frame.len()];
        for i in (0..first.len()).filter(|i| first.octave[*i] <= FINE) {
            let octave = first.octave[i];
            let target = Target {
                pixel: self.trail[i],
                right_x: f32::NAN,
                radius: 100.0,
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

/// Where the second eye stands in the first's frame, one unit away, and the points: feature in the first, in the second, place.
type Pair = (Se3, Vec<(u16, u16, Vec3)>);

fn two_view_setting() -> TwoViewSetting {
    TwoViewSetting { sigma_px: SIGMA_PX, ..TwoViewSetting::default() }
}

/// The points that two frames see whose motion is known, when they have as much parallax as two views alone must have; the
/// baseline is made one.
fn meet(
    eye: &EyeModel,
    first: &Frame,
    second: &Frame,
    matches: &[(usize, usize)],
    first_from_second: &Se3,
) -> Option<Pair> {
    let setting = two_view_setting();
    let unit = Se3::new(first_from_second.rotation, first_from_second.translation.try_normalize(1e-9)?);
    let second_from_first = unit.inverse();
    let gate = TriangulateGate { min_parallax_deg: setting.point_parallax_deg, ..TriangulateGate::default() };
    let (mut points, mut parallaxes) = (Vec::new(), Vec::new());
    for (i, j) in matches {
        let px = [first.px[*i], second.px[*j]];
        let met = triangulate_checked(eye, &second_from_first, px[0], px[1], [SIGMA_PX; 2], &gate);
        if let Ok(met) = met {
            points.push((*i as u16, *j as u16, met.point));
            parallaxes.push(met.parallax_deg);
        }
    }
    parallaxes.sort_by(|a, b| b.total_cmp(a));
    let parallax = *parallaxes.get((parallaxes.len() / 2).min(50))?;
    (points.len() >= setting.min_points && parallax >= setting.min_parallax_deg).then_some((unit, points))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::So3;
    use cairn_sensor::Stamp;
    use cairn_solve::ransac::Rng;

    fn eye() -> EyeModel {
        EyeModel {
            fx: 458.0,
            fy: 457.0,
            cx: 367.0,
            cy: 248.0,
            baseline_fx: 0.0,
            bounds: [0.0, 0.0, 752.0, 480.0],
            close_depth: 0.0,
            body_from_eye: Se3::identity(),
        }
    }

    const SEEDS: u64 = 25;

    /// Points with their looks.
    struct World(Vec<(Vec3, [u8; 32])>);

    impl World {
        /// A tilted wall some metres ahead, with a share of points anywhere before and behind it.
        fn new(rng: &mut Rng, off_wall: f64) -> Self {
            let tilt = [rng.range(-0.5, 0.5), rng.range(-0.5, 0.5)];
            let point = |rng: &mut Rng| {
                let (x, y) = (rng.range(-1.4, 1.4), rng.range(-1.1, 1.1));
                let wall = 4.0 / (1.0 + tilt[0] * x + tilt[1] * y).max(0.2);
                let z = if rng.unit() < off_wall { rng.range(2.0, 8.0) } else { wall };
                Vec3::new(x, y, 1.0) * z
            };
            Self(
                (0..900)
                    .map(|_| (point(rng), std::array::from_fn(|_| rng.range(0.0, 256.0) as u8)))
                    .collect(),
            )
        }

        /// What is seen from a pose; one feature in twenty looks like another point.
        fn seen(&self, rng: &mut Rng, world_from_eye: &Se3, seconds: f64, noise: f64) -> Arc<Frame> {
            let (eye, eye_from_world) = (eye(), world_from_eye.inverse());
            let mut f = Frame::default();
            f.stamp = Stamp((seconds * 1e9) as i64);
            for (p, look) in &self.0 {
                let Some([u, v, _]) = eye.project(&(eye_from_world * *p)) else { continue };
                let (u, v) = (u + noise * rng.normal(), v + noise * rng.normal());
                if !eye.contains(u, v) {
                    continue;
                }
                let other = self.0[rng.range(0.0, self.0.len() as f64) as usize].1;
                f.px.push([u as f32, v as f32]);
                f.descriptors.push(if rng.unit() < 0.05 { other } else { *look });
            }
            let n = f.px.len();
            f.raw = f.px.clone();
            (f.octave, f.angle) = (vec![0; n], vec![0.0; n]);
            (f.right_x, f.depth) = (vec![f32::NAN; n], vec![f32::NAN; n]);
            f.index(&eye);
            Arc::new(f)
        }
    }

    /// A hand that swings: centimetres and degrees around the start.
    fn swing(phase: &[f64; 6], t: f64) -> Se3 {
        let wave = |k: usize, hz: f64| (phase[k] + t * hz * std::f64::consts::TAU).sin() - phase[k].sin();
        let place = Vec3::new(0.3 * wave(0, 0.3), 0.2 * wave(1, 0.4), 0.2 * wave(2, 0.25));
        let turn = Vec3::new(0.06 * wave(3, 0.5), 0.1 * wave(4, 0.4), 0.03 * wave(5, 0.6));
        Se3::new(So3::exp(&turn), place)
    }

    /// Seconds until the start at 20 frames a second, with its errors of rotation and direction in degrees.
    fn start(seed: u64, off_wall: f64, noise: f64) -> Option<(f64, f64, f64)> {
        let mut rng = Rng::with_stream(seed, 12);
        let world = World::new(&mut rng, off_wall);
        let phase: [f64; 6] = std::array::from_fn(|_| rng.range(0.0, std::f64::consts::TAU));
        let mut starter = Starter::default();
        for k in 0..100 {
            let t = k as f64 * 0.05;
            let frame = world.seen(&mut rng, &swing(&phase, t), t, noise);
            let Ok(Offer::Pair { first, second, first_from_second, points, .. }) =
                starter.step(&eye(), &frame, 1000)
            else {
                continue;
            };
            assert!(
                points.iter().all(|(i, j, _)| (*i as usize) < first.len() && (*j as usize) < second.len())
            );
            let stood = |f: &Frame| swing(&phase, f.stamp.0 as f64 * 1e-9);
            let truth = stood(&first).inverse() * stood(&second);
            let rotation = (truth.rotation.inverse() * first_from_second.rotation).angle().to_degrees();
            let direction = truth.translation.angle(&first_from_second.translation).to_degrees();
            return Some((t, rotation, direction));
        }
        None
    }

    fn starts(name: &str, off_wall: f64, noise: f64) -> Vec<f64> {
        let found: Vec<_> = (0..SEEDS).filter_map(|seed| start(seed, off_wall, noise)).collect();
        let mut seconds: Vec<f64> = found.iter().map(|f| f.0).collect();
        seconds.sort_by(f64::total_cmp);
        let worst = |of: fn(&(f64, f64, f64)) -> f64| found.iter().map(of).fold(0.0, f64::max);
        println!(
            "{name}: {} of {SEEDS} start, median {:?} s, last {:?} s, worst rotation {:.2} direction {:.1} degrees",
            seconds.len(),
            seconds.get(seconds.len() / 2),
            seconds.last(),
            worst(|f| f.1),
            worst(|f| f.2)
        );
        // The other motion of a plane is tens of degrees off.
        assert!(found.iter().all(|f| f.1 < 2.0 && f.2 < 15.0), "a wrong motion: {found:?}");
        seconds
    }

    #[test]
    fn before_a_wall_the_right_motion_is_chosen() {
        for noise in [0.3, 0.6] {
            let seconds = starts(&format!("wall, {noise} px"), 0.0, noise);
            assert!(seconds.len() as u64 == SEEDS && seconds[seconds.len() / 2] < 1.5, "{seconds:?}");
        }
    }

    #[test]
    fn with_things_before_the_wall_too() {
        for off_wall in [0.3, 1.0] {
            let seconds = starts(&format!("{off_wall} off the wall"), off_wall, 0.5);
            assert!(seconds.len() as u64 == SEEDS && seconds[seconds.len() / 2] < 1.0, "{seconds:?}");
        }
    }
}
