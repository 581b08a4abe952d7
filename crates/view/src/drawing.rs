//! What is drawn of a scene: discs, lines, and how surfaces are coloured; the same as on the page (its `map.js`).

use crate::orbit::{Look, ground};
use crate::scene::Scene;
use crate::vector::{V3, add, dot, scaled};

/// A colour: red, green and blue from 0 to 1.
type Rgb = [f32; 3];

/// The colours, which are those of the page on a dark ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Palette {
    /// Behind everything.
    pub canvas: Rgb,
    /// The grid, and free space.
    pub faint: Rgb,
    /// Points of which nothing is told.
    pub point: Rgb,
    /// The recorded route.
    pub route: Rgb,
    /// The cleaned route.
    pub plan: Rgb,
    /// The walker.
    pub eye: Rgb,
    /// The way of the camera.
    pub way: Rgb,
    /// Places seen again.
    pub again: Rgb,
    /// Lowest, middle and highest of what the colours tell.
    pub ramp: [Rgb; 3],
}

const fn rgb(hex: u32) -> Rgb {
    [(hex >> 16 & 255) as f32 / 255.0, (hex >> 8 & 255) as f32 / 255.0, (hex & 255) as f32 / 255.0]
}

impl Palette {
    /// On a dark ground.
    pub const DARK: Self = Self {
        canvas: rgb(0x0a0e13),
        faint: rgb(0x3a4654),
        point: rgb(0x6f8296),
        route: rgb(0x8fb4ff),
        plan: rgb(0xffd479),
        eye: rgb(0xff9d8a),
        way: rgb(0x7be0a0),
        again: rgb(0xe58cff),
        ramp: [rgb(0x4f9bff), rgb(0x5fd0a8), rgb(0xffd479)],
    };

    /// The colour of a share from 0 to 1.
    pub fn ramp(&self, share: f32) -> Rgb {
        let [low, middle, high] = self.ramp;
        let mix = |a: Rgb, b: Rgb, t: f32| std::array::from_fn(|i| a[i] + t * (b[i] - a[i]));
        let share = share.clamp(0.0, 1.0);
        if share < 0.5 { mix(low, middle, 2.0 * share) } else { mix(middle, high, 2.0 * share - 1.0) }
    }
}

/// What colours tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum By {
    /// How high it is.
    #[default]
    Height,
    /// When it was found.
    Age,
    /// Which way it faces.
    Normal,
}

/// What is to be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// What colours tell.
    pub by: By,
    /// Landmarks.
    pub points: bool,
    /// The surface.
    pub surface: bool,
    /// Free and occupied spans.
    pub columns: bool,
    /// The view goes along with the walker.
    pub follow: bool,
}

impl Default for Choice {
    fn default() -> Self {
        Self { by: By::Height, points: true, surface: true, columns: false, follow: false }
    }
}

/// A disc that faces the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// Where it is.
    pub place: V3,
    /// Its colour.
    pub colour: Rgb,
    /// Its width in pixels.
    pub width: f32,
}

/// A piece of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// From where to where.
    pub ends: [V3; 2],
    /// Its colour.
    pub colour: Rgb,
    /// Its width in pixels.
    pub width: f32,
    /// Length of a dash with its gap in pixels; 0 where it is whole.
    pub dash: f32,
}

/// Discs and lines.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Marks {
    /// Discs.
    pub discs: Vec<Disc>,
    /// Lines.
    pub lines: Vec<Line>,
}

/// How surfaces are coloured, and where all is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shading {
    /// The middle of what there is.
    pub middle: V3,
    /// How wide it is along the ground.
    pub size: f32,
    /// Height of the grid.
    pub floor: f32,
    /// Heights at the ends of the ramp.
    pub heights: [f32; 2],
}

/// How wide the widest of what is shown is along the ground, and where it is.
pub fn shading(scene: &Scene, choice: Choice) -> Shading {
    let axes = ground(scene.model.up);
    let along = |p: V3| axes.map(|axis| dot(axis, p));
    let way = scene.model.key_frames.values().map(|k| k.place).chain(scene.model.recorded.iter().copied());
    let seen: Vec<V3> = if choice.surface { scene.surface.middles().collect() } else { Vec::new() };
    let columns = choice.columns.then(|| scene.columns.corners()).into_iter().flatten();
    let all: Vec<V3> = way.chain(seen.iter().copied()).chain(columns).map(along).collect();
    let Some(first) = all.first() else { return Shading { size: 1.0, ..Shading::default() } };
    let bound =
        |f: fn(f32, f32) -> f32| all.iter().fold(*first, |m, p| std::array::from_fn(|i| f(m[i], p[i])));
    let (low, high) = (bound(f32::min), bound(f32::max));
    let points = scene.model.points.values().copied().chain(seen.iter().copied());
    let mut heights: Vec<f32> = points.map(|p| dot(axes[2], p)).collect();
    heights.sort_by(f32::total_cmp);
    let at = |share: f32| heights.get((share * heights.len().saturating_sub(1) as f32) as usize).copied();
    let heights = [at(0.05).unwrap_or(low[2]), at(0.95).unwrap_or(high[2])];
    let middle = (0..3).fold([0.0; 3], |sum, k| add(sum, scaled(axes[k], (low[k] + high[k]) / 2.0)));
    let size = (high[0] - low[0]).hypot(high[1] - low[1]).max(1e-3);
    Shading { middle, size, floor: heights[0].min(low[2]), heights }
}

/// What does not depend on where one looks from.
pub fn marks(scene: &Scene, choice: Choice, shading: &Shading, colours: &Palette) -> Marks {
    let Scene { model, .. } = scene;
    let up = ground(model.up)[2];
    let mut out = Marks::default();
    let last = model.points.len().saturating_sub(1).max(1) as f32;
    let [low, high] = shading.heights;
    for (i, place) in model.points.values().enumerate().filter(|_| choice.points) {
        let colour = match choice.by {
            By::Height => colours.ramp((dot(up, *place) - low) / (high - low).max(1e-6)),
            // Points come in the order in which they were found.
            By::Age => colours.ramp(i as f32 / last),
            // A point has no direction.
            By::Normal => colours.point,
        };
        out.discs.push(Disc { place: *place, colour, width: 3.0 });
    }
    let line = |ends, colour, width, dash| Line { ends, colour, width, dash };
    let key_frames: Vec<_> = model.key_frames.values().collect();
    for pair in key_frames.windows(2).filter(|pair| pair[0].map == pair[1].map) {
        out.lines.push(line([pair[0].place, pair[1].place], colours.way, 1.5, 0.0));
    }
    out.discs.extend(key_frames.iter().map(|k| Disc { place: k.place, colour: colours.way, width: 5.0 }));
    let place = |id: &u32| model.key_frames.get(id).map(|k| k.place);
    for [a, b] in &model.loops {
        out.lines.extend(place(a).zip(place(b)).map(|(a, b)| line([a, b], colours.again, 2.0, 0.0)));
    }
    let routes = [(&model.recorded, colours.route, 4.0, 0.0), (&model.plan, colours.plan, 3.0, 24.0)];
    for (route, colour, width, dash) in routes {
        out.lines.extend(route.windows(2).map(|pair| line([pair[0], pair[1]], colour, width, dash)));
    }
    if choice.columns {
        let free = scene.columns.free();
        out.lines.extend(free.into_iter().map(|ends| line(ends, colours.faint, 1.0, 0.0)));
    }
    out
}

/// Squares of the grid across what is seen.
const SQUARES: i16 = 12;
/// Height of the walker's wedge in pixels.
const WEDGE: f32 = 16.0;

impl Marks {
    /// Adds squares on the floor around a point; returns the edge of one.
    pub fn add_grid(&mut self, up: V3, shading: &Shading, zoom: f32, around: V3, colour: Rgb) -> f32 {
        let axes = ground(up);
        let square = round_length(2.0 * shading.size / zoom / f32::from(SQUARES));
        let at =
            |x: f32, y: f32| add(add(scaled(axes[0], x), scaled(axes[1], y)), scaled(axes[2], shading.floor));
        let [u, v] = [axes[0], axes[1]].map(|axis| square * (dot(axis, around) / square).round());
        let half = f32::from(SQUARES) * square;
        for k in -SQUARES..=SQUARES {
            let k = f32::from(k) * square;
            let across = [at(u + k, v - half), at(u + k, v + half)];
            let along = [at(u - half, v + k), at(u + half, v + k)];
            self.lines.extend([across, along].map(|ends| Line { ends, colour, width: 1.5, dash: 0.0 }));
        }
        square
    }

    /// Adds a wedge that opens where the walker looks, as large on the screen at any size of the view.
    pub fn add_walker(&mut self, [place, side, down, ahead]: [V3; 4], look: &Look, height: f32, colour: Rgb) {
        let size = WEDGE / look.pixels(height);
        let corner = |s: f32, d: f32| {
            let by = add(add(scaled(side, s), scaled(down, d)), ahead);
            add(place, scaled(by, size))
        };
        let corners = [corner(-0.6, -0.4), corner(0.6, -0.4), corner(0.6, 0.4), corner(-0.6, 0.4)];
        for k in 0..4 {
            for ends in [[place, corners[k]], [corners[k], corners[(k + 1) % 4]]] {
                self.lines.push(Line { ends, colour, width: 3.0, dash: 0.0 });
            }
        }
        self.discs.push(Disc { place, colour, width: 9.0 });
    }
}

/// A round number near a length: 1, 2 or 5 times a power of ten.
pub fn round_length(length: f32) -> f32 {
    let power = 10_f32.powf(length.max(1e-6).log10().floor());
    let round = [1.0, 2.0, 5.0, 10.0].into_iter().find(|n| n * power >= 0.999 * length);
    power * round.unwrap_or(10.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::KeyFrame;
    use crate::orbit::Orbit;

    const UP: V3 = [0.0, 0.0, 1.0];

    /// Two maps: a walk of four key frames along x, and one beside it; ten points that rise.
    fn scene() -> Scene {
        let mut scene = Scene { is_metric: true, ..Scene::default() };
        scene.model.up = UP;
        let key_frame = |k: u32| (k, KeyFrame { place: [k as f32, 0.0, 1.5], map: k / 4 });
        scene.model.key_frames = (0..5).map(key_frame).collect();
        scene.model.points = (0..10).map(|k| (k, [k as f32, 2.0, 0.3 * k as f32])).collect();
        scene.model.loops = vec![[3, 0], [3, 77]];
        scene.model.recorded = vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        scene
    }

    #[test]
    fn maps_are_drawn_apart_and_loops_join_key_frames_that_are_there() {
        let (scene, colours, choice) = (scene(), Palette::DARK, Choice::default());
        let drawn = marks(&scene, choice, &shading(&scene, choice), &colours);
        let of = |colour: Rgb| drawn.lines.iter().filter(|l| l.colour == colour).count();
        assert_eq!((of(colours.way), of(colours.again), of(colours.route), of(colours.plan)), (3, 1, 2, 0));
        assert_eq!(drawn.discs.len(), 10 + 5);
        let without = Choice { points: false, ..choice };
        assert_eq!(marks(&scene, without, &shading(&scene, without), &colours).discs.len(), 5);
    }

    #[test]
    fn colours_tell_height_and_age() {
        let (mut scene, colours) = (scene(), Palette::DARK);
        // The highest is the oldest.
        scene.model.points = (0..10).map(|k| (k, [k as f32, 2.0, -0.3 * k as f32])).collect();
        let colour = |by, k: usize| {
            let choice = Choice { by, ..Choice::default() };
            marks(&scene, choice, &shading(&scene, choice), &colours).discs[k].colour
        };
        assert_eq!((colour(By::Height, 0), colour(By::Height, 9)), (colours.ramp[2], colours.ramp[0]));
        assert_eq!((colour(By::Age, 0), colour(By::Age, 9)), (colours.ramp[0], colours.ramp[2]));
        assert_eq!(colour(By::Normal, 3), colours.point);
    }

    #[test]
    fn all_is_seen_and_the_grid_is_round() {
        let scene = scene();
        let shading = shading(&scene, Choice::default());
        let look = Orbit::default().look(shading.middle, shading.size, UP, 1.0);
        for k in scene.model.key_frames.values() {
            let [x, y] = look.on_screen(k.place).unwrap();
            assert!(x.abs() < 1.0 && y.abs() < 1.0, "{x} {y}");
        }
        let mut marks = Marks::default();
        assert_eq!(marks.add_grid(UP, &shading, 1.0, shading.middle, [0.0; 3]), 1.0);
        assert!(marks.lines.iter().all(|l| l.ends.iter().all(|p| (p[2] - shading.floor).abs() < 1e-5)));
        for (length, round) in [(0.03, 0.05), (0.7, 1.0), (1.2, 2.0), (4.0, 5.0), (7.0, 10.0)] {
            assert!((round_length(length) / round - 1.0).abs() < 1e-5, "{length}");
        }
        // A scene with nothing in it is one too.
        assert_eq!(super::shading(&Scene::default(), Choice::default()).size, 1.0);
    }

    #[test]
    fn walker_is_as_large_at_any_zoom() {
        let width = |zoom: f32| {
            let look = Orbit { zoom, pitch: 0.0, ..Orbit::default() }.look([0.0; 3], 10.0, UP, 1.0);
            let mut marks = Marks::default();
            let [side, down] = [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
            marks.add_walker([[0.0; 3], side, down, [1.0, 0.0, 0.0]], &look, 600.0, [0.0; 3]);
            let ends = marks.lines.iter().flat_map(|l| l.ends).filter_map(|p| look.on_screen(p));
            300.0 * ends.fold(0.0_f32, |most, p| most.max(p[0].abs()))
        };
        assert!((width(1.0) / width(8.0) - 1.0).abs() < 0.1, "{} {}", width(1.0), width(8.0));
        assert!((5.0..30.0).contains(&width(1.0)));
    }
}
