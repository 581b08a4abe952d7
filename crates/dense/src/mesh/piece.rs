//! The mesh of one block, built in memory that is used again: nothing is asked for while triangles are written, and what is handed out
//! is no larger than it must be.

use super::cells::{CELLS, MOST_TRIANGLES, MOST_VERTICES};
#[cfg(target_arch = "x86_64")]
use super::kernel_x86;
use super::rows::corner_of;
use super::samples::Samples;
use super::{Mesh, Place, VertexTable, colour};
use crate::Backend;
use crate::tsdf::TsdfVolume;

/// Room for the mesh of a block.
#[derive(Clone)]
pub(super) struct Buffers {
    positions: [[f32; 3]; MOST_VERTICES],
    triangles: [[u32; 3]; MOST_TRIANGLES],
}

impl Default for Buffers {
    fn default() -> Self {
        Self { positions: [[0.0; 3]; MOST_VERTICES], triangles: [[0; 3]; MOST_TRIANGLES] }
    }
}

impl Buffers {
    /// The mesh of the block whose cells and edges these are, without normals; `vertices` is written over.
    pub fn mesh(
        &mut self,
        samples: &Samples,
        place: &Place,
        volume: &TsdfVolume,
        vertices: &mut VertexTable,
        backend: Backend,
    ) -> Mesh {
        let mut count = 0;
        let mut colours = Vec::new();
        for (axis, edges) in samples.edges.iter().enumerate() {
            let arrays = edges.arrays();
            match backend {
                #[cfg(target_arch = "x86_64")]
                #[allow(unsafe_code)]
                // SAFETY: a backend is only chosen when the processor has its instructions.
                Backend::Avx512 => unsafe {
                    kernel_x86::positions(place, axis, arrays, &mut self.positions, count);
                },
                _ => {
                    for ((edge, part), to) in edges.iter().zip(&mut self.positions[count..]) {
                        *to = place.position(axis, corner_of(edge), part);
                    }
                }
            }
            if volume.config().colour {
                colours.extend(
                    edges.iter().map(|(edge, part)| colour(volume, samples, axis, corner_of(edge), part)),
                );
            }
            let (numbers, _, new) = arrays;
            for (i, &edge) in numbers[..new].iter().enumerate() {
                vertices[(4 * usize::from(edge) + axis) % vertices.len()] = (count + i) as u32;
            }
            count += new;
        }
        let triangles = self.triangles(samples, vertices, backend);
        Mesh {
            positions: self.positions[..count].to_vec(),
            normals: Vec::new(),
            colours,
            triangles: self.triangles[..triangles].to_vec(),
        }
    }

    /// Writes the triangles, and returns how many there are.
    fn triangles(&mut self, samples: &Samples, vertices: &VertexTable, backend: Backend) -> usize {
        let (cells, cases) = (samples.cells(), samples.cases());
        #[cfg(target_arch = "x86_64")]
        if backend == Backend::Avx512 {
            #[allow(unsafe_code)]
            // SAFETY: a backend is only chosen when the processor has its instructions.
            return unsafe { kernel_x86::triangles(cells, cases, &CELLS, vertices, &mut self.triangles) };
        }
        let _ = backend;
        let mut count = 0;
        for &cell in cells {
            let cell = usize::from(cell);
            for corners in CELLS[usize::from(cases[cell])].iter() {
                self.triangles[count] = corners.map(|at| vertices[4 * cell + usize::from(at)]);
                count += 1;
            }
        }
        count
    }
}
