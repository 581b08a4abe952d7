//! OpenGL: programs, buffers and the drawing of them; the only place of this crate that calls it. Version 3 or ES 3, or what egui's
//! shader header makes of 2.1 and ES 2 with vertex arrays.
//!
//! All calls here need the context to be current on this thread, which is so in the paint callbacks of `egui_glow` and when the
//! window begins and ends; nothing else calls this.
#![allow(unsafe_code)]

use eframe::egui_glow::ShaderVersion;
use eframe::glow::{self, Context, HasContext};

/// What the driver says is wrong.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct DriverError(String);

impl From<String> for DriverError {
    fn from(log: String) -> Self {
        Self(log)
    }
}

/// Vertices on the graphics card, as triangles.
pub struct Mesh {
    array: glow::VertexArray,
    buffers: Vec<glow::Buffer>,
    count: i32,
    has_corners: bool,
}

/// A program, with the sizes of its attributes by name, in the order of a vertex.
pub struct Program {
    program: glow::Program,
    attributes: &'static [(&'static str, i32)],
}

/// The value of a uniform.
pub enum Value<'a> {
    /// A number.
    Float(f32),
    /// Two numbers.
    Two([f32; 2]),
    /// A vector.
    Three([f32; 3]),
    /// A matrix, column by column.
    Matrix(&'a [f32; 16]),
}

impl Program {
    /// Compiles a program; the sources say `attribute` and `varying`, and `colour_out` for the colour of a pixel.
    ///
    /// # Errors
    /// What the driver says.
    pub fn new(
        gl: &Context,
        [vertex, fragment]: [&str; 2],
        attributes: &'static [(&'static str, i32)],
    ) -> Result<Self, DriverError> {
        let version = ShaderVersion::get(gl);
        let head = version.version_declaration();
        let is_new = version.is_new_shader_interface();
        let [ins, outs, colour] = match is_new {
            true => [
                "#define attribute in\n#define varying out\n",
                "#define varying in\n",
                "out vec4 colour_out;\n",
            ],
            false => ["", "", "#define colour_out gl_FragColor\n"],
        };
        let precision = if version.is_embedded() { "precision highp float;\n" } else { "" };
        let sources = [
            (glow::VERTEX_SHADER, format!("{head}{precision}{ins}{vertex}")),
            (glow::FRAGMENT_SHADER, format!("{head}{precision}{outs}{colour}{fragment}")),
        ];
        // Safety: see the head of this file.
        unsafe {
            let program = gl.create_program()?;
            for (kind, source) in sources {
                let shader = gl.create_shader(kind)?;
                gl.shader_source(shader, &source);
                gl.compile_shader(shader);
                if !gl.get_shader_compile_status(shader) {
                    return Err(gl.get_shader_info_log(shader).into());
                }
                gl.attach_shader(program, shader);
                gl.delete_shader(shader);
            }
            for (i, (name, _)) in (0..).zip(attributes) {
                gl.bind_attrib_location(program, i, name);
            }
            gl.link_program(program);
            match gl.get_program_link_status(program) {
                true => Ok(Self { program, attributes }),
                false => Err(gl.get_program_info_log(program).into()),
            }
        }
    }

    /// Vertices, their attributes one after another, for this program; with `corners` triangles of these, else three in a row are one.
    ///
    /// # Errors
    /// What the driver says.
    pub fn mesh(&self, gl: &Context, vertices: &[f32], corners: Option<&[u32]>) -> Result<Mesh, DriverError> {
        let bytes: Vec<u8> = vertices.iter().flat_map(|v| v.to_ne_bytes()).collect();
        let width: i32 = self.attributes.iter().map(|(_, n)| n).sum();
        let count = corners.map_or(vertices.len() / width as usize, <[u32]>::len) as i32;
        // Safety: see the head of this file; the attributes lie within a vertex.
        unsafe {
            let array = gl.create_vertex_array()?;
            gl.bind_vertex_array(Some(array));
            let mut buffers = vec![gl.create_buffer()?];
            gl.bind_buffer(glow::ARRAY_BUFFER, Some(buffers[0]));
            gl.buffer_data_u8_slice(glow::ARRAY_BUFFER, &bytes, glow::STATIC_DRAW);
            let mut offset = 0;
            for (i, (_, n)) in (0..).zip(self.attributes) {
                gl.enable_vertex_attrib_array(i);
                gl.vertex_attrib_pointer_f32(i, *n, glow::FLOAT, false, 4 * width, offset);
                offset += 4 * n;
            }
            if let Some(corners) = corners {
                let bytes: Vec<u8> = corners.iter().flat_map(|v| v.to_ne_bytes()).collect();
                let buffer = gl.create_buffer()?;
                gl.bind_buffer(glow::ELEMENT_ARRAY_BUFFER, Some(buffer));
                gl.buffer_data_u8_slice(glow::ELEMENT_ARRAY_BUFFER, &bytes, glow::STATIC_DRAW);
                buffers.push(buffer);
            }
            gl.bind_vertex_array(None);
            Ok(Mesh { array, buffers, count, has_corners: corners.is_some() })
        }
    }

    /// What is drawn from now on is drawn by this, with these values.
    pub fn begin(&self, gl: &Context, values: &[(&str, Value)]) {
        // Safety: see the head of this file.
        unsafe { gl.use_program(Some(self.program)) };
        self.set(gl, values);
    }

    /// Changes values while it is drawn by this.
    pub fn set(&self, gl: &Context, values: &[(&str, Value)]) {
        // Safety: see the head of this file.
        unsafe {
            for (name, value) in values {
                let at = gl.get_uniform_location(self.program, name);
                match value {
                    Value::Float(v) => gl.uniform_1_f32(at.as_ref(), *v),
                    Value::Two([x, y]) => gl.uniform_2_f32(at.as_ref(), *x, *y),
                    Value::Three([x, y, z]) => gl.uniform_3_f32(at.as_ref(), *x, *y, *z),
                    Value::Matrix(m) => gl.uniform_matrix_4_f32_slice(at.as_ref(), false, *m),
                }
            }
        }
    }

    /// Gives back what it has on the graphics card.
    pub fn delete(&self, gl: &Context) {
        // Safety: see the head of this file.
        unsafe { gl.delete_program(self.program) };
    }
}

impl Mesh {
    /// Draws it by the program that was begun.
    pub fn draw(&self, gl: &Context) {
        // Safety: see the head of this file; there are `count` corners or vertices.
        unsafe {
            gl.bind_vertex_array(Some(self.array));
            match self.has_corners {
                true => gl.draw_elements(glow::TRIANGLES, self.count, glow::UNSIGNED_INT, 0),
                false => gl.draw_arrays(glow::TRIANGLES, 0, self.count),
            }
            gl.bind_vertex_array(None);
        }
    }

    /// Gives back what it has on the graphics card.
    pub fn delete(self, gl: &Context) {
        // Safety: see the head of this file.
        unsafe {
            gl.delete_vertex_array(self.array);
            self.buffers.iter().for_each(|buffer| gl.delete_buffer(*buffer));
        }
    }
}

/// Begins a picture on this ground: what is nearer hides what is farther.
pub fn clear(gl: &Context, [r, g, b]: [f32; 3]) {
    // Safety: see the head of this file.
    unsafe {
        gl.disable(glow::BLEND);
        gl.enable(glow::DEPTH_TEST);
        gl.depth_mask(true);
        gl.depth_func(glow::LEQUAL);
        gl.clear_color(r, g, b, 1.0);
        gl.clear_depth_f32(1.0);
        gl.clear(glow::COLOR_BUFFER_BIT | glow::DEPTH_BUFFER_BIT);
    }
}

/// Whether triangles seen from behind are left out from now on.
pub fn one_sided(gl: &Context, is_so: bool) {
    // Safety: see the head of this file.
    unsafe {
        match is_so {
            true => gl.enable(glow::CULL_FACE),
            false => gl.disable(glow::CULL_FACE),
        }
    }
}

/// Ends a picture: the rest of the window is drawn as egui expects.
pub fn end(gl: &Context) {
    // Safety: see the head of this file.
    unsafe {
        gl.disable(glow::DEPTH_TEST);
        gl.disable(glow::CULL_FACE);
    }
}
