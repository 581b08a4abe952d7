//! The camera of the view: turned around a point by mouse and keys, and walked through by keys. The page's `orbit.js` does the
//! same.

use crate::keys::Act;
use crate::vector::{V3, add, cross, dot, scaled, sub, unit};

/// Angle that is seen from below to above, radians.
const FIELD: f32 = 0.9;
/// A step, as a share of what is seen.
const STEP: f32 = 0.05;
/// How far the size may be changed.
const ZOOM: [f32; 2] = [0.2, 40.0];

/// Two directions in the ground, the second to the left of the first as seen from above, and up.
pub fn ground(up: V3) -> [V3; 3] {
    let up = if dot(up, up) > 0.0 { unit(up) } else { [0.0, -1.0, 0.0] };
    let other = if up[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let side = unit(cross(other, up));
    [side, cross(up, side), up]
}

/// How the view is turned, how large it is, and where it was walked to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// About the direction up, radians.
    pub yaw: f32,
    /// How far it looks down, radians: 0 along the ground, a quarter turn from above.
    pub pitch: f32,
    /// 1 shows all.
    pub zoom: f32,
    /// To the right and up on the screen, as shares of what is seen at zoom 1.
    pub aside: [f32; 2],
    /// Along the two directions in the ground and up, as shares of what is seen at zoom 1.
    pub walked: V3,
}

impl Default for Orbit {
    fn default() -> Self {
        Self { yaw: 0.6, pitch: 0.9, zoom: 1.0, aside: [0.0; 2], walked: [0.0; 3] }
    }
}

impl Orbit {
    /// What a key does; `moves` with Shift.
    pub fn act(&mut self, act: Act, moves: bool) {
        match act {
            Act::Turn([x, y]) if moves => self.shift(x, y),
            Act::Turn([yaw, pitch]) => self.turn(yaw, pitch),
            Act::Walk(by) => self.walk(by),
            Act::Grow(by) => self.grow(by),
            Act::All => *self = Self::default(),
        }
    }

    /// Turns by angles in radians.
    pub fn turn(&mut self, yaw: f32, pitch: f32) {
        self.yaw += yaw;
        self.pitch = (self.pitch + pitch).clamp(0.0, std::f32::consts::FRAC_PI_2);
    }

    /// Moves by a share of what is seen, to the right and up on the screen.
    pub fn shift(&mut self, right: f32, up: f32) {
        self.aside = [self.aside[0] + right / self.zoom, self.aside[1] + up / self.zoom];
    }

    /// Changes the size by a factor.
    pub fn grow(&mut self, by: f32) {
        self.zoom = (self.zoom * by).clamp(ZOOM[0], ZOOM[1]);
    }

    /// Steps along the ground as the view is turned, and up.
    fn walk(&mut self, [right, up, ahead]: V3) {
        let (s, c) = self.yaw.sin_cos();
        let by = [c * right + s * ahead, c * ahead - s * right, up];
        self.walked = add(self.walked, scaled(by, STEP / self.zoom));
    }

    /// The view around `target`, so that `size` is seen whole at zoom one, on a screen of `aspect` (width by height).
    pub fn look(&self, target: V3, size: f32, up: V3, aspect: f32) -> Look {
        let axes = ground(up);
        let ([s, c], [sp, cp]) = ([self.yaw.sin(), self.yaw.cos()], [self.pitch.sin(), self.pitch.cos()]);
        let across = sub(scaled(axes[0], c), scaled(axes[1], s));
        let away = add(scaled(axes[1], c), scaled(axes[0], s));
        // The eye looks down by the pitch.
        let into = sub(scaled(away, cp), scaled(axes[2], sp));
        let upward = add(scaled(away, sp), scaled(axes[2], cp));
        let walked = (0..3).fold(target, |at, k| add(at, scaled(axes[k], size * self.walked[k])));
        let [right, high] = self.aside.map(|v| v * size);
        let middle = add(walked, add(scaled(across, right), scaled(upward, high)));
        let distance = size / self.zoom / FIELD;
        let eye = sub(middle, scaled(into, distance));
        let focal = 1.0 / (FIELD / 2.0).tan();
        let (near, far) = (0.02 * distance, 20.0 * distance);
        let (a, b) = ((far + near) / (far - near), -2.0 * far * near / (far - near));
        let row = |v: V3, by: f32, more: f32| [by * v[0], by * v[1], by * v[2], more - by * dot(v, eye)];
        let rows =
            [row(across, focal / aspect, 0.0), row(upward, focal, 0.0), row(into, a, b), row(into, 1.0, 0.0)];
        let matrix = std::array::from_fn(|i| rows[i % 4][i / 4]);
        Look { matrix, eye, middle, into, distance, focal }
    }
}

/// Where one looks from, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// From the map to the screen, column by column.
    pub matrix: [f32; 16],
    /// The eye, and what is in the middle of the screen.
    pub eye: V3,
    /// What is in the middle of the screen.
    pub middle: V3,
    /// The direction in which it looks.
    pub into: V3,
    /// From the eye to the middle.
    pub distance: f32,
    focal: f32,
}

impl Look {
    /// Pixels of a screen of this height for one unit of the map at the middle.
    pub fn pixels(&self, height: f32) -> f32 {
        self.focal * height / 2.0 / self.distance
    }

    /// A point on the screen: to the right and up from the middle, 1 at its borders; `None` behind the eye.
    pub fn on_screen(&self, p: V3) -> Option<[f32; 2]> {
        let row = |k: usize| (0..3).map(|i| self.matrix[4 * i + k] * p[i]).sum::<f32>() + self.matrix[12 + k];
        let w = row(3);
        (w > 0.0).then(|| [row(0) / w, row(1) / w])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::keys::key_of;

    const UP: V3 = [0.0, 0.0, 1.0];

    fn pressed(orbit: &mut Orbit, keys: &[&str]) {
        keys.iter().for_each(|k| orbit.act(key_of(k).unwrap().act, false));
    }

    fn at(orbit: &Orbit, p: V3) -> [f32; 2] {
        orbit.look([0.0; 3], 10.0, UP, 1.0).on_screen(p).unwrap()
    }

    #[test]
    fn target_is_in_the_middle_and_up_is_up() {
        for up in [UP, [0.0, -1.0, 0.0], [0.3, 0.4, -0.2]] {
            for yaw in [0.0, 1.0, 3.0] {
                let orbit = Orbit { yaw, ..Orbit::default() };
                let look = orbit.look([4.0, 5.0, 6.0], 10.0, up, 1.5);
                let middle = look.on_screen([4.0, 5.0, 6.0]).unwrap();
                assert!(middle.iter().all(|v| v.abs() < 1e-5), "{middle:?}");
                let above = look.on_screen(add([4.0, 5.0, 6.0], unit(up))).unwrap();
                assert!(above[1] > 0.05 && above[0].abs() < 1e-5, "{above:?}");
                let behind = sub(look.eye, look.into);
                assert_eq!(look.on_screen(behind), None);
            }
        }
    }

    #[test]
    fn what_is_on_the_right_is_drawn_on_the_right() {
        // In a frame whose axes are right, down and forward, as a camera's: seen from behind it, and from above.
        for pitch in [0.0, std::f32::consts::FRAC_PI_2] {
            let look =
                Orbit { yaw: 0.0, pitch, ..Orbit::default() }.look([0.0; 3], 10.0, [0.0, -1.0, 0.0], 1.0);
            let [right, ahead] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]].map(|p| look.on_screen(p).unwrap());
            assert!(right[0] > 0.05 && ahead[0].abs() < 1e-5, "{right:?} {ahead:?}");
            assert!(pitch == 0.0 || ahead[1] > 0.05, "{ahead:?}");
        }
        // And turned by hand to the right, what is near goes to the right.
        let mut orbit = Orbit::default();
        let near = |orbit: &Orbit| {
            let look = Orbit::default().look([0.0; 3], 10.0, UP, 1.0);
            at(orbit, sub([0.0; 3], scaled(look.into, 2.0)))[0]
        };
        let before = near(&orbit);
        orbit.turn(0.1, 0.0);
        assert!(near(&orbit) > before + 0.01);
    }

    #[test]
    fn all_of_the_size_is_seen_and_plus_makes_it_larger() {
        let mut orbit = Orbit { pitch: std::f32::consts::FRAC_PI_2, yaw: 0.0, ..Orbit::default() };
        let border = |orbit: &Orbit| {
            let places = [at(orbit, [0.0, 5.0, 0.0]), at(orbit, [5.0, 0.0, 0.0])];
            places.iter().flatten().fold(0.0_f32, |most, v| most.max(v.abs()))
        };
        let before = border(&orbit);
        assert!((0.8..1.0).contains(&before), "{before}");
        pressed(&mut orbit, &["+"]);
        assert!((border(&orbit) / before - 1.2).abs() < 1e-3);
        pressed(&mut orbit, &["-", "0"]);
        assert_eq!(orbit, Orbit::default());
    }

    #[test]
    fn keys_walk_where_one_looks() {
        // A point ahead comes nearer with W, whichever way the view is turned; one on the right comes to the middle with D.
        for turns in 0..6 {
            let mut orbit = Orbit { pitch: 0.0, ..Orbit::default() };
            (0..turns * 10).for_each(|_| pressed(&mut orbit, &["ArrowRight"]));
            let look = orbit.look([0.0; 3], 10.0, UP, 1.0);
            let ahead = scaled(look.into, 2.0);
            let right = cross(look.into, UP);
            let away = |orbit: &Orbit| {
                let eye = orbit.look([0.0; 3], 10.0, UP, 1.0).eye;
                dot(sub(ahead, eye), sub(ahead, eye)).sqrt()
            };
            let before = away(&orbit);
            pressed(&mut orbit, &["w", "w"]);
            assert!((before - away(&orbit) - 2.0 * STEP * 10.0).abs() < 1e-3);
            pressed(&mut orbit, &["s", "s", "d"]);
            let moved = sub(orbit.look([0.0; 3], 10.0, UP, 1.0).middle, [0.0; 3]);
            assert!((dot(moved, right) - STEP * 10.0).abs() < 1e-3, "{moved:?}");
            pressed(&mut orbit, &["a", "e"]);
            let moved = orbit.look([0.0; 3], 10.0, UP, 1.0).middle;
            assert!((moved[2] - STEP * 10.0).abs() < 1e-3 && moved[0].abs() < 1e-3, "{moved:?}");
        }
    }

    #[test]
    fn arrows_turn_and_with_shift_they_move() {
        let mut orbit = Orbit::default();
        (0..40).for_each(|_| pressed(&mut orbit, &["ArrowUp"]));
        assert_eq!(orbit.pitch, std::f32::consts::FRAC_PI_2, "no farther than from above");
        orbit.act(key_of("ArrowRight").unwrap().act, true);
        assert!((orbit.aside[0] - 0.1).abs() < 1e-6 && orbit.yaw == 0.6);
        // What is drawn goes to the left then.
        assert!(at(&orbit, [0.0; 3])[0] < -0.05);
    }
}
