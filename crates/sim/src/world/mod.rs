//! Worlds: textured flat faces, obstacles, and routes that can be walked.

mod apartment;
mod arena;
mod build;
mod corridor;
mod deadend;
mod face;
mod figure;
mod footprint;
mod furniture;
mod hall;
mod house;
mod office;
mod options;
mod plan;
mod route;
mod street;
mod thing;

pub(crate) use face::Face;
pub use figure::{Figure, Passer};
pub use options::{UnknownWorld, WorldKind, WorldOptions};
pub use route::NamedRoute;
pub use thing::Thing;

use crate::texture::Texture;
use build::Builder;
use cairn_geometry::{Vec2, Vec3};
use footprint::Footprint;

/// A simulated place. The world frame has z up and the floor at z = 0; metres.
pub struct World {
    kind: WorldKind,
    seed: u64,
    pub(crate) faces: Vec<Face>,
    pub(crate) textures: Vec<Texture>,
    areas: Vec<[f64; 4]>,
    footprints: Vec<Footprint>,
    plan: Vec<(Vec2, Vec2)>,
    routes: Vec<NamedRoute>,
    places: Vec<(String, Vec2)>,
    doors: Vec<(Vec2, Vec2)>,
    pub(crate) wardrobe: Vec<figure::Wardrobe>,
}

impl World {
    /// Builds a world; the same arguments give the same world, texel for texel.
    pub fn build(kind: WorldKind, seed: u64, options: &WorldOptions) -> World {
        let mut b = Builder::new(seed, *options);
        match kind {
            WorldKind::Corridor => corridor::ring(&mut b),
            WorldKind::Demo => corridor::demo(&mut b),
            WorldKind::Office => office::build(&mut b),
            WorldKind::Hall => hall::build(&mut b),
            WorldKind::Street => street::build(&mut b),
            WorldKind::Arena => arena::build(&mut b),
            WorldKind::DeadEnd => deadend::build(&mut b),
            WorldKind::Apartment => apartment::build(&mut b),
        }
        let wardrobe = figure::wardrobes(&mut b);
        World {
            kind,
            seed,
            faces: b.faces,
            textures: b.textures,
            areas: b.areas,
            footprints: b.footprints,
            plan: b.plan,
            routes: b.routes,
            places: b.places,
            doors: b.doors,
            wardrobe,
        }
    }

    /// Which kind.
    pub fn kind(&self) -> WorldKind {
        self.kind
    }

    /// Its seed.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Named routes that can be walked; the first is the usual one.
    pub fn routes(&self) -> &[NamedRoute] {
        &self.routes
    }

    /// A route by name.
    pub fn route(&self, name: &str) -> Option<&NamedRoute> {
        self.routes.iter().find(|w| w.name == name)
    }

    /// Places with a name, where there is room to stand: the rooms of an apartment. Metres.
    pub fn places(&self) -> &[(String, Vec2)] {
        &self.places
    }

    /// Doors that can be closed ([`WorldOptions::closed_door`]), as the two ends of the closed leaf, metres.
    pub fn doors(&self) -> &[(Vec2, Vec2)] {
        &self.doors
    }

    /// Floor plan: walls and outlines of furniture seen from above, as segments in metres.
    pub fn plan(&self) -> &[(Vec2, Vec2)] {
        &self.plan
    }

    /// True where someone can stand: inside the world and outside all obstacles.
    pub fn is_free(&self, x: f64, y: f64) -> bool {
        let p = Vec2::new(x, y);
        self.areas.iter().any(|a| x >= a[0] && y >= a[1] && x <= a[2] && y <= a[3])
            && !self.footprints.iter().any(|f| f.distance(&p) <= 0.0)
    }

    /// Metres to the nearest wall or obstacle; 0 where no one can stand.
    pub fn clearance(&self, x: f64, y: f64) -> f64 {
        if !self.is_free(x, y) {
            return 0.0;
        }
        let p = Vec2::new(x, y);
        self.plan.iter().map(|(a, b)| footprint::distance_to_segment(&p, a, b)).fold(f64::MAX, f64::min)
    }

    /// Metres from a point to the nearest surface of the world; people and things put in later do not count.
    pub fn distance_to_surface(&self, p: &Vec3) -> f64 {
        let mut best = f64::MAX;
        for face in &self.faces {
            if (face.centre - p).norm() - face.radius < best {
                best = best.min(face.distance(p));
            }
        }
        best
    }
}
