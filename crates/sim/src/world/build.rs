//! The builder that worlds are made with: painted quads and boxes, lights, obstacles, routes.

use super::face::Face;
use super::footprint::{Footprint, distance_to_segment};
use super::options::WorldOptions;
use super::route::NamedRoute;
use crate::texture::{Canvas, Noise, Texture};
use cairn_geometry::{Vec2, Vec3};
use cairn_random::Random;

/// Frame of one side of a box: its origin, axes, width and height.
pub(crate) type Side = ([Vec3; 3], f64, f64);

/// Which side of a box is painted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BoxFace {
    /// Towards its own +x.
    Front,
    /// Towards -x.
    Back,
    /// Towards +y.
    Left,
    /// Towards -y.
    Right,
    /// Upwards.
    Top,
    /// Downwards.
    Bottom,
}

/// A box standing somewhere.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    /// Middle of its base in the world's x and y.
    pub at: Vec2,
    /// Height of its base.
    pub base: f64,
    /// Sizes along its own x (depth), y (width) and z (height).
    pub size: Vec3,
    /// Angle of its x axis.
    pub yaw: f64,
    /// Metres per texel.
    pub texel: f64,
}

/// A lamp.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lamp {
    /// Where it hangs.
    pub at: Vec3,
    /// How bright it is.
    pub power: f32,
    /// The room `[x0, y0, x1, y1]` whose walls contain its light, if any.
    pub room: Option<[f64; 4]>,
}

impl Lamp {
    /// True when no wall stands between the lamp and a surface with this middle.
    fn reaches(&self, p: &Vec3) -> bool {
        // A little more than half a wall's thickness: the jambs of doors belong to both sides.
        let slack = 0.081;
        self.room.is_none_or(|[x0, y0, x1, y1]| {
            p.x > x0 - slack && p.y > y0 - slack && p.x < x1 + slack && p.y < y1 + slack
        })
    }
}

/// A world under construction.
pub(crate) struct Builder {
    /// What the user asked for.
    pub options: WorldOptions,
    /// Faces so far.
    pub faces: Vec<Face>,
    /// Their textures.
    pub textures: Vec<Texture>,
    /// Rectangles `[x0, y0, x1, y1]` of walkable floor.
    pub areas: Vec<[f64; 4]>,
    /// Obstacles.
    pub footprints: Vec<Footprint>,
    /// Segments of the floor plan.
    pub plan: Vec<(Vec2, Vec2)>,
    /// Routes.
    pub routes: Vec<NamedRoute>,
    /// Places with a name.
    pub places: Vec<(String, Vec2)>,
    /// Doors that can be closed: the ends of the leaf.
    pub doors: Vec<(Vec2, Vec2)>,
    /// Lamps.
    pub lights: Vec<Lamp>,
    /// Light from everywhere.
    pub ambient: f32,
    /// Direction to the sun and its power, outdoors.
    pub sun: Option<(Vec3, f32)>,
    /// The current randomness.
    pub random: Random,
    seed: u64,
    noise: Noise,
}

/// Axes of a box turned about z.
pub(crate) fn turned(yaw: f64) -> [Vec3; 3] {
    let (s, c) = yaw.sin_cos();
    [Vec3::new(c, s, 0.0), Vec3::new(-s, c, 0.0), Vec3::z()]
}

/// The six sides of a box with its middle and axes: front, back, left, right, top, bottom.
pub(crate) fn sides(middle: &Vec3, axes: &[Vec3; 3], size: &Vec3) -> [(BoxFace, Side); 6] {
    let side = |normal: Vec3, up: Vec3, depth: f64, width: f64, height: f64| -> Side {
        let right = (-normal).cross(&up);
        let origin = middle + normal * (depth / 2.0) - right * (width / 2.0) + up * (height / 2.0);
        ([origin, right, -up], width, height)
    };
    let [x, y, z] = *axes;
    [
        (BoxFace::Front, side(x, z, size.x, size.y, size.z)),
        (BoxFace::Back, side(-x, z, size.x, size.y, size.z)),
        (BoxFace::Left, side(y, z, size.y, size.x, size.z)),
        (BoxFace::Right, side(-y, z, size.y, size.x, size.z)),
        (BoxFace::Top, side(z, x, size.z, size.y, size.x)),
        (BoxFace::Bottom, side(-z, x, size.z, size.y, size.x)),
    ]
}

impl Builder {
    /// An empty world.
    pub fn new(seed: u64, options: WorldOptions) -> Self {
        Self {
            options,
            faces: Vec::new(),
            textures: Vec::new(),
            areas: Vec::new(),
            footprints: Vec::new(),
            plan: Vec::new(),
            routes: Vec::new(),
            places: Vec::new(),
            doors: Vec::new(),
            lights: Vec::new(),
            ambient: 0.5,
            sun: None,
            random: Random::stream(seed, 0),
            seed,
            noise: Noise::new(seed),
        }
    }

    /// Starts a stream of randomness that depends only on the seed and this number.
    pub fn stream(&mut self, stream: u64) {
        self.random = Random::stream(self.seed, stream);
    }

    /// Paints and lights a rectangle, stores it, and returns its texture and texels per metre.
    pub fn paint(
        &mut self,
        frame: [Vec3; 3],
        width: f64,
        height: f64,
        texel: f64,
        paint: impl FnOnce(&mut Canvas<'_>, &mut Random),
    ) -> (usize, f64) {
        let offset = (self.random.below(500), self.random.below(500));
        let detail = self.options.detail.clamp(0.02, 4.0);
        let mut canvas = Canvas::new(width, height, texel / detail, offset, &self.noise);
        paint(&mut canvas, &mut self.random);
        let [origin, along, down] = frame;
        let normal = -along.cross(&down);
        let middle = origin + along * (width / 2.0) + down * (height / 2.0);
        let reach = 0.5 * width.hypot(height) + 9.0;
        let near: Vec<Lamp> = self
            .lights
            .iter()
            .filter(|l| (l.at - middle).norm() < reach && l.reaches(&middle))
            .copied()
            .collect();
        let (ambient, sun) = (self.ambient, self.sun);
        canvas.light(|x, y| {
            let p = origin + along * f64::from(x) + down * f64::from(y);
            let mut sum = ambient;
            if let Some((to_sun, power)) = sun {
                sum += power * normal.dot(&to_sun).max(0.0) as f32;
            }
            for Lamp { at, power, .. } in &near {
                let d = at - p;
                let r2 = d.norm_squared();
                let facing = (normal.dot(&d) / r2.sqrt().max(0.1)).max(0.0) as f32;
                let fade = (1.0 - r2 as f32 / 81.0).max(0.0);
                sum += power * (0.3 + 0.7 * facing) * fade * fade / (1.0 + r2 as f32 / 5.0);
            }
            sum.min(1.35)
        });
        let texels_per_m = 1.0 / f64::from(canvas.texel);
        self.textures.push(canvas.finish());
        (self.textures.len() - 1, texels_per_m)
    }

    /// A painted rectangle, seen from its front only.
    pub fn quad(
        &mut self,
        frame: [Vec3; 3],
        width: f64,
        height: f64,
        texel: f64,
        paint: impl FnOnce(&mut Canvas<'_>, &mut Random),
    ) {
        let corners =
            vec![Vec2::zeros(), Vec2::new(width, 0.0), Vec2::new(width, height), Vec2::new(0.0, height)];
        self.polygon(frame, corners, texel, paint);
    }

    /// A painted convex polygon, corners clockwise in the frame, all with positive coordinates.
    pub fn polygon(
        &mut self,
        frame: [Vec3; 3],
        corners: Vec<Vec2>,
        texel: f64,
        paint: impl FnOnce(&mut Canvas<'_>, &mut Random),
    ) {
        let width = corners.iter().map(|c| c.x).fold(0.0, f64::max);
        let height = corners.iter().map(|c| c.y).fold(0.0, f64::max);
        let (texture, texels_per_m) = self.paint(frame, width, height, texel, paint);
        self.faces.push(Face::new(frame, corners, texture, texels_per_m));
    }

    /// A box whose sides are painted one by one; the bottom only where it hangs above the floor.
    pub fn block(&mut self, block: &Block, paint: impl Fn(BoxFace, &mut Canvas<'_>, &mut Random)) {
        let middle = Vec3::new(block.at.x, block.at.y, block.base + block.size.z / 2.0);
        for (which, (frame, w, h)) in sides(&middle, &turned(block.yaw), &block.size) {
            if which == BoxFace::Bottom && block.base < 0.3
                || which == BoxFace::Top
                    && block.base + block.size.z > 2.3
                    && block.base < 0.01
                    && self.sun.is_none()
            {
                continue;
            }
            self.quad(frame, w, h, block.texel, |c, r| paint(which, c, r));
        }
    }

    /// Registers an obstacle, for walkers and for the floor plan.
    pub fn add_obstacle(&mut self, at: Vec2, half: Vec2, yaw: f64) {
        let f = Footprint { centre: at, half, yaw };
        let k = f.corners();
        self.plan.extend((0..4).map(|i| (k[i], k[(i + 1) % 4])));
        self.footprints.push(f);
    }

    /// True when a thing here leaves `margin` metres to every route and to every other thing, and stays inside.
    pub fn has_room(&self, at: Vec2, half: Vec2, yaw: f64, margin: f64) -> bool {
        let f = Footprint { centre: at, half, yaw };
        let corners = f.corners();
        let inside =
            |p: &Vec2| self.areas.iter().any(|a| p.x > a[0] && p.y > a[1] && p.x < a[2] && p.y < a[3]);
        if !corners.iter().all(inside) {
            return false;
        }
        let ways_clear = self.routes.iter().all(|w| {
            w.points.windows(2).all(|s| {
                let n = ((s[1] - s[0]).norm() / 0.1).ceil().max(1.0);
                (0..=n as usize).all(|i| f.distance(&(s[0] + (s[1] - s[0]) * (i as f64 / n))) > margin)
            })
        });
        let others_clear = self.footprints.iter().all(|o| {
            f.distance(&o.centre) > 0.02
                && o.distance(&f.centre) > 0.02
                && o.corners().iter().all(|c| f.distance(c) > 0.02)
                && corners.iter().all(|c| o.distance(c) > 0.02)
        });
        let k = corners;
        let walls_clear = self.plan.iter().all(|(a, b)| {
            let n = ((b - a).norm() / 0.15).ceil().max(1.0);
            (0..=n as usize).all(|i| f.distance(&(a + (b - a) * (i as f64 / n))) > 0.0)
                && k.iter().all(|c| distance_to_segment(c, a, b) > 0.0)
        });
        ways_clear && others_clear && walls_clear
    }
}
