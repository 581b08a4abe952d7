//! The picture of a scene: what is on the graphics card, and the shaders, which are those of the page (its `scene.js` and
//! `shaded.js`).

use super::gl::{self, DriverError, Mesh, Program, Value};
use cairn_view::{Block, By, Disc, Line, Look, Marks, Palette, Scene, Shading, V3};
use eframe::glow::Context;
use std::collections::BTreeMap;

// A disc and a line are as wide on the screen wherever they are. What is behind the eye is left out by the clipping.
const DISCS: [&str; 2] = [
    "attribute vec3 place; attribute vec3 colour; attribute vec2 corner; attribute float width;
uniform mat4 view; uniform vec2 pixels; uniform float scale; varying vec3 tone; varying vec2 at;
void main() {
  vec4 p = view * vec4(place, 1.0); p.xy += corner * width * scale / pixels * p.w;
  gl_Position = p; tone = colour; at = corner;
}",
    "varying vec3 tone; varying vec2 at;
void main() { if (dot(at, at) > 1.0) discard; colour_out = vec4(tone, 1.0); }",
];
const LINES: [&str; 2] = [
    "attribute vec3 place; attribute vec3 other; attribute vec2 side; attribute vec3 colour; attribute vec2 form;
uniform mat4 view; uniform vec2 pixels; uniform float scale; varying vec3 tone; varying float along; varying float dash;
void main() {
  vec4 a = view * vec4(place, 1.0); vec4 b = view * vec4(other, 1.0);
  vec2 d = (b.xy / max(b.w, 0.001) - a.xy / max(a.w, 0.001)) * pixels * side.x;
  vec2 n = length(d) > 0.0 ? normalize(vec2(-d.y, d.x)) : vec2(0.0);
  a.xy += n * side.y * form.x * scale / pixels * a.w;
  gl_Position = a; tone = colour; along = side.x > 0.0 ? 0.0 : length(d) / 2.0; dash = form.y * scale;
}",
    "varying vec3 tone; varying float along; varying float dash;
void main() { if (dash > 0.0 && mod(along, dash) > 0.6 * dash) discard; colour_out = vec4(tone, 1.0); }",
];
const SHADED: [&str; 2] = [
    "attribute vec3 place; attribute vec3 normal; attribute float born;
uniform mat4 view; uniform mat4 pose; uniform vec3 up; uniform vec3 into; uniform vec2 range; uniform float by;
uniform vec3 low; uniform vec3 middle; uniform vec3 high; varying vec3 tone;
void main() {
  vec4 p = pose * vec4(place, 1.0); vec3 n = normalize((pose * vec4(normal, 0.0)).xyz + vec3(1e-12));
  float value = by < 0.5 ? dot(up, p.xyz) : by < 1.5 ? born : dot(up, n);
  float s = clamp((value - range.x) / max(range.y - range.x, 1e-6), 0.0, 1.0);
  vec3 c = s < 0.5 ? mix(low, middle, 2.0 * s) : mix(middle, high, 2.0 * s - 1.0);
  gl_Position = view * p; tone = c * (0.4 + 0.6 * abs(dot(n, into)));
}",
    "varying vec3 tone; void main() { colour_out = vec4(tone, 1.0); }",
];
const UNMOVED: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// What a mesh on the card is of: a cube of a submap, or a tile of columns.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Of {
    Cube(u32, [i32; 3]),
    Tile([i32; 2]),
}

/// How a picture is to be.
pub struct Frame {
    pub look: Look,
    /// Width and height in pixels of the screen, and how many of these are one of a window.
    pub pixels: [f32; 2],
    pub scale: f32,
    pub up: V3,
    pub by: By,
    pub shading: Shading,
    pub surface: bool,
    pub columns: bool,
}

/// The graphics card's part of the view.
pub struct Canvas {
    discs: Program,
    lines: Program,
    shaded: Program,
    meshes: BTreeMap<Of, (u64, Mesh)>,
    /// What changes with the scene, and what changes with each picture.
    marks: [Option<Mesh>; 4],
}

impl Canvas {
    /// Compiles the shaders.
    ///
    /// # Errors
    /// What the driver says.
    pub fn new(gl: &Context) -> Result<Self, DriverError> {
        let discs = &[("place", 3), ("colour", 3), ("corner", 2), ("width", 1)];
        let lines = &[("place", 3), ("other", 3), ("side", 2), ("colour", 3), ("form", 2)];
        let shaded = &[("place", 3), ("normal", 3), ("born", 1)];
        Ok(Self {
            discs: Program::new(gl, DISCS, discs)?,
            lines: Program::new(gl, LINES, lines)?,
            shaded: Program::new(gl, SHADED, shaded)?,
            meshes: BTreeMap::new(),
            marks: [const { None }; 4],
        })
    }

    /// Draws the scene.
    ///
    /// # Errors
    /// What the driver says where it has no room.
    pub fn draw(
        &mut self,
        gl: &Context,
        scene: &Scene,
        marks: [Option<&Marks>; 2],
        f: &Frame,
    ) -> Result<(), DriverError> {
        let colours = Palette::DARK;
        gl::clear(gl, colours.canvas);
        self.keep_up(gl, scene, f)?;
        for (k, new) in marks.into_iter().enumerate() {
            let Some(new) = new else { continue };
            let meshes = [
                self.discs.mesh(gl, &discs(&new.discs), None)?,
                self.lines.mesh(gl, &lines(&new.lines), None)?,
            ];
            for (i, mesh) in meshes.into_iter().enumerate() {
                if let Some(old) = self.marks[2 * k + i].replace(mesh) {
                    old.delete(gl);
                }
            }
        }
        self.surfaces(gl, scene, f, &colours);
        let common = || {
            [
                ("view", Value::Matrix(&f.look.matrix)),
                ("pixels", Value::Two(f.pixels)),
                ("scale", Value::Float(f.scale)),
            ]
        };
        for (program, first) in [(&self.lines, 1), (&self.discs, 0)] {
            program.begin(gl, &common());
            self.marks.iter().skip(first).step_by(2).flatten().for_each(|mesh| mesh.draw(gl));
        }
        gl::end(gl);
        Ok(())
    }

    /// Surfaces and columns, coloured by what was chosen.
    fn surfaces(&self, gl: &Context, scene: &Scene, f: &Frame, colours: &Palette) {
        let (by, range) = match f.by {
            By::Height => (0.0, f.shading.heights),
            By::Age => (1.0, [0.0, scene.surface.latest_s]),
            By::Normal => (2.0, [-1.0, 1.0]),
        };
        let [low, middle, high] = colours.ramp.map(Value::Three);
        let values = [
            ("view", Value::Matrix(&f.look.matrix)),
            ("up", Value::Three(f.up)),
            ("into", Value::Three(f.look.into)),
            ("range", Value::Two(range)),
            ("by", Value::Float(by)),
            ("low", low),
            ("middle", middle),
            ("high", high),
        ];
        self.shaded.begin(gl, &values);
        gl::one_sided(gl, true);
        for (of, (_, mesh)) in &self.meshes {
            let pose = match of {
                Of::Cube(part, _) => scene.surface.parts.get(part).map_or(UNMOVED, |part| part.pose),
                Of::Tile(_) => UNMOVED,
            };
            let pose =
                std::array::from_fn(
                    |i| if i % 4 < 3 { pose[4 * (i % 4) + i / 4] } else { f32::from(i == 15) },
                );
            self.shaded.set(gl, &[("pose", Value::Matrix(&pose))]);
            mesh.draw(gl);
        }
        gl::one_sided(gl, false);
    }

    /// Brings what has changed to the card, and takes from it what is not shown.
    fn keep_up(&mut self, gl: &Context, scene: &Scene, f: &Frame) -> Result<(), DriverError> {
        let mut unused: std::collections::BTreeSet<Of> = self.meshes.keys().copied().collect();
        let Self { shaded, meshes, .. } = self;
        let mut put =
            |of: Of, version: u64, mesh: &dyn Fn() -> (Vec<f32>, Vec<u32>)| -> Result<(), DriverError> {
                unused.remove(&of);
                if meshes.get(&of).is_some_and(|(known, _)| *known == version) {
                    return Ok(());
                }
                let (vertices, corners) = mesh();
                let new = shaded.mesh(gl, &vertices, Some(&corners))?;
                if let Some((_, old)) = meshes.insert(of, (version, new)) {
                    old.delete(gl);
                }
                Ok(())
            };
        for (id, part) in scene.surface.parts.iter().filter(|_| f.surface) {
            for (at, cube) in part.cubes.iter().filter(|(_, cube)| !cube.blocks.is_empty()) {
                put(Of::Cube(*id, *at), cube.version, &|| joined(cube.blocks.values()))?;
            }
        }
        for (at, tile) in scene.columns.tiles.iter().filter(|_| f.columns) {
            put(Of::Tile(*at), tile.version, &|| joined([&scene.columns.boxes(*at, tile)]))?;
        }
        for of in unused {
            if let Some((_, mesh)) = self.meshes.remove(&of) {
                mesh.delete(gl);
            }
        }
        Ok(())
    }

    /// Gives back what it has on the graphics card.
    pub fn delete(&mut self, gl: &Context) {
        std::mem::take(&mut self.meshes).into_values().for_each(|(_, mesh)| mesh.delete(gl));
        self.marks.iter_mut().filter_map(Option::take).for_each(|mesh| mesh.delete(gl));
        [&self.discs, &self.lines, &self.shaded].into_iter().for_each(|program| program.delete(gl));
    }
}

/// Vertices (place, normal, time) and corners of blocks.
fn joined<'a>(blocks: impl IntoIterator<Item = &'a Block>) -> (Vec<f32>, Vec<u32>) {
    let (mut vertices, mut corners) = (Vec::new(), Vec::new());
    for block in blocks {
        let first = (vertices.len() / 7) as u32;
        for (place, normal) in block.places.iter().zip(&block.normals) {
            vertices.extend(place.iter().chain(normal).chain([&block.born_s]));
        }
        corners.extend(block.corners.iter().flatten().map(|c| first + u32::from(*c)));
    }
    (vertices, corners)
}

/// Two triangles each.
fn discs(discs: &[Disc]) -> Vec<f32> {
    let mut out = Vec::with_capacity(54 * discs.len());
    for Disc { place, colour, width } in discs {
        for corner in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
            out.extend(place.iter().chain(colour).chain(&corner).chain([width]));
        }
    }
    out
}

/// Two triangles each; what is left of the direction at one end is right of it at the other.
fn lines(lines: &[Line]) -> Vec<f32> {
    let mut out = Vec::with_capacity(78 * lines.len());
    for Line { ends: [a, b], colour, width, dash } in lines {
        let corners = [
            (a, b, 1.0, 1.0),
            (a, b, 1.0, -1.0),
            (b, a, -1.0, 1.0),
            (b, a, -1.0, 1.0),
            (a, b, 1.0, -1.0),
            (b, a, -1.0, -1.0),
        ];
        for (here, there, along, side) in corners {
            out.extend(here.iter().chain(there).chain(&[along, side]).chain(colour).chain([width, dash]));
        }
    }
    out
}
