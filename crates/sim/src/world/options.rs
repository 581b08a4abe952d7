//! Which world, and its variants.

use std::fmt;
use std::str::FromStr;

/// The kind of world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WorldKind {
    /// A ring of corridors with doors, notices and a side branch.
    Corridor,
    /// A corridor with furnished rooms on both sides.
    Office,
    /// One big room with furniture and columns.
    Hall,
    /// Houses along a road, with trees, poles, cars and sky.
    Street,
    /// Corridors with three turns, about 40 m of route.
    Demo,
    /// One empty room of any size: for a motion that was not planned around furniture.
    Arena,
    /// A straight corridor with a plain end, for turning around there.
    DeadEnd,
    /// Five furnished rooms around a corridor, with doors that can be closed.
    Apartment,
}

impl WorldKind {
    /// All of them.
    pub const ALL: [WorldKind; 8] = [
        WorldKind::Corridor,
        WorldKind::Office,
        WorldKind::Hall,
        WorldKind::Street,
        WorldKind::Demo,
        WorldKind::Arena,
        WorldKind::DeadEnd,
        WorldKind::Apartment,
    ];

    /// Its name in `sim:NAME`.
    pub fn name(self) -> &'static str {
        match self {
            WorldKind::Corridor => "corridor",
            WorldKind::Office => "office",
            WorldKind::Hall => "hall",
            WorldKind::Street => "street",
            WorldKind::Demo => "demo",
            WorldKind::Arena => "arena",
            WorldKind::DeadEnd => "dead-end",
            WorldKind::Apartment => "apartment",
        }
    }
}

impl fmt::Display for WorldKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that no world has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no world \"{0}\"; known are {known}", known = WorldKind::ALL.map(WorldKind::name).join(", "))]
pub struct UnknownWorld(String);

impl FromStr for WorldKind {
    type Err = UnknownWorld;
    fn from_str(s: &str) -> Result<Self, UnknownWorld> {
        WorldKind::ALL.into_iter().find(|k| k.name() == s).ok_or_else(|| UnknownWorld(s.to_owned()))
    }
}

/// Variants of worlds of one kind and seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldOptions {
    /// Share of walls (0 to 1) that are plain, with almost no texture.
    pub poor_walls: f64,
    /// Rooms of the office that look alike.
    pub look_alike: bool,
    /// Texels a metre, as a share of the usual: 0.2 builds quickly and is fine enough for small images.
    pub detail: f64,
    /// Width, depth and height of the arena, metres; without it 10 x 8 x 4.
    pub size_m: Option<[f64; 3]>,
    /// Index of a door of the apartment that is closed ([`World::doors`](crate::World::doors)).
    pub closed_door: Option<usize>,
}

impl Default for WorldOptions {
    fn default() -> Self {
        Self { poor_walls: 0.0, look_alike: false, detail: 1.0, size_m: None, closed_door: None }
    }
}
