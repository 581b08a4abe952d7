//! The surface as `cairn-web` sends it (its `surface/sent.rs` has the format): meshes of blocks in the frames of their submaps.
//! Blocks are gathered in cubes, each of which is drawn at once.

use crate::read::{Malformed, Reader};
use crate::vector::{V3, add, cross, dot, sub};
use std::collections::BTreeMap;

/// Blocks along the edge of a cube.
const CUBE: i32 = 4;
/// Units of a voxel's edge, and voxels along the edge of a block.
const UNITS: f32 = 4096.0;
const SIDE: f32 = 8.0;

/// The mesh of a block, in the frame of its submap.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Block {
    /// Seconds from the beginning until it had a surface.
    pub born_s: f32,
    /// Its vertices.
    pub places: Vec<V3>,
    /// At each vertex the sum over the triangles around it, as long as they are large.
    pub normals: Vec<V3>,
    /// Corners of the triangles, counter-clockwise as seen from free space.
    pub corners: Vec<[u16; 3]>,
    /// Of its surface.
    pub area: f32,
}

/// Blocks that are drawn at once.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cube {
    /// By their keys.
    pub blocks: BTreeMap<[i32; 3], Block>,
    /// Another whenever a block has changed, and of no other cube.
    pub version: u64,
}

/// A submap.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part {
    /// Its pose in the map: rows of the rotation, each followed by its part of the translation.
    pub pose: [f32; 12],
    /// By their places, in edges of a cube.
    pub cubes: BTreeMap<[i32; 3], Cube>,
}

impl Part {
    /// A point of the submap in the map.
    pub fn in_map(&self, p: V3) -> V3 {
        std::array::from_fn(|row| {
            let [a, b, c, t] = std::array::from_fn(|i| self.pose[4 * row + i]);
            a * p[0] + b * p[1] + c * p[2] + t
        })
    }
}

/// The surface of all submaps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Edge of a voxel, metres.
    pub voxel_m: f32,
    /// Submaps by their numbers.
    pub parts: BTreeMap<u32, Part>,
    /// When the youngest block was born, seconds.
    pub latest_s: f32,
    versions: u64,
}

impl Surface {
    /// Takes a message of kind 3.
    ///
    /// # Errors
    /// One that is cut off or too long, or that names what is not there.
    pub fn take(&mut self, message: &[u8]) -> Result<(), Malformed> {
        let mut r = Reader(message);
        let [_, whole, ..] = r.bytes::<4>()?;
        if whole == 1 {
            *self = Self { versions: self.versions, ..Self::default() };
        }
        self.voxel_m = r.float()?;
        r.each(|r| {
            self.parts.remove(&r.number()?);
            Ok(())
        })?;
        r.each(|r| {
            let (part, pose) = (r.number()?, r.floats()?);
            self.parts.entry(part).or_default().pose = pose;
            Ok(())
        })?;
        r.each(|r| {
            let (part, key) = (r.number()?, [r.signed()?, r.signed()?, r.signed()?]);
            let block = block(r, key, self.voxel_m)?;
            self.put(part, key, block)
        })?;
        r.end()
    }

    fn put(&mut self, part: u32, key: [i32; 3], block: Block) -> Result<(), Malformed> {
        let part = self.parts.get_mut(&part).ok_or(Malformed::Dangling)?;
        let cube = part.cubes.entry(key.map(|k| k.div_euclid(CUBE))).or_default();
        self.versions += 1;
        cube.version = self.versions;
        if block.corners.is_empty() {
            cube.blocks.remove(&key);
            return Ok(());
        }
        self.latest_s = self.latest_s.max(block.born_s);
        cube.blocks.insert(key, block);
        Ok(())
    }

    /// All blocks with their submaps.
    pub fn blocks(&self) -> impl Iterator<Item = (&Part, &Block)> {
        self.parts.values().flat_map(|part| {
            let blocks = part.cubes.values().flat_map(|cube| cube.blocks.values());
            blocks.map(move |block| (part, block))
        })
    }

    /// The middles of the cubes that have a surface, in the map.
    pub fn middles(&self) -> impl Iterator<Item = V3> {
        let edge = CUBE as f32 * SIDE * self.voxel_m;
        self.parts.values().flat_map(move |part| {
            let seen = part.cubes.iter().filter(|(_, cube)| !cube.blocks.is_empty());
            seen.map(move |(at, _)| part.in_map(at.map(|k| (k as f32 + 0.5) * edge)))
        })
    }
}

fn block(r: &mut Reader, key: [i32; 3], voxel_m: f32) -> Result<Block, Malformed> {
    let born_s = r.number()? as f32 / 10.0;
    let (vertices, triangles) = (r.short()?, r.short()?);
    let mut out = Block { born_s, ..Block::default() };
    for _ in 0..vertices {
        let at = [r.short()?, r.short()?, r.short()?];
        out.places.push(std::array::from_fn(|i| voxel_m * (SIDE * key[i] as f32 + f32::from(at[i]) / UNITS)));
    }
    for _ in 0..triangles {
        let mut corner = || if vertices <= 256 { r.byte().map(u16::from) } else { r.short() };
        let corners = [corner()?, corner()?, corner()?];
        if corners.iter().any(|c| *c >= vertices) {
            return Err(Malformed::Dangling);
        }
        out.corners.push(corners);
    }
    out.normals = vec![[0.0; 3]; out.places.len()];
    for corners in &out.corners {
        let [a, b, c] = corners.map(|c| out.places[usize::from(c)]);
        let normal = cross(sub(b, a), sub(c, a));
        out.area += dot(normal, normal).sqrt() / 2.0;
        for corner in corners {
            let sum = &mut out.normals[usize::from(*corner)];
            *sum = add(*sum, normal);
        }
    }
    Ok(out)
}
