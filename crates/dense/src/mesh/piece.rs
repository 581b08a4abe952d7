//! The mesh of one block, built in memory that is used again: nothing is asked for while triangles are written, and what is handed out
//! is no larger than it must be.

use super::cells::{CELLS, MOST_TRIANGLES};
#[cfg(target_arch = "x86_64")]
use super::kernel_x86;
use super::live::Live;
use super::rows::{MOST, corner_of};
use super::samples::Samples;
use super::{Mesh, MeshConfig, Place, colour};
use crate::Backend;
use crate::block::BlockKey;
use crate::tsdf::TsdfVolume;

/// Room for the mesh of a block.
#[derive(Clone)]
pub(super) struct Buffers {
    pub samples: Samples,
    /// Numbers that the vertices of a block have in the mesh of several.
    pub vertices: [u32; MOST],
    positions: [[f32; 3]; MOST],
    triangles: [[u32; 3]; MOST_TRIANGLES],
}

impl Default for Buffers {
    fn default() -> Self {
        Self {
            samples: Samples::default(),
            vertices: [0; MOST],
            positions: [[0.0; 3]; MOST],
            triangles: [[0; 3]; MOST_TRIANGLES],
        }
    }
}

impl Buffers {
    /// The mesh of a block with live cells, without normals.
    pub fn mesh(
        &mut self,
        volume: &TsdfVolume,
        key: BlockKey,
        live: &Live,
        config: MeshConfig,
        backend: Backend,
    ) -> Mesh {
        let (Self { samples, positions, .. }, place) = (&mut *self, &Place::new(volume, key));
        samples.load(volume, live, config.least_weight, backend);
        let edges = &samples.edges;
        match backend {
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: a backend is only chosen when the processor has its instructions.
            Backend::Avx512 => unsafe { kernel_x86::positions(place, edges, positions) },
            _ => {
                for ((edge, part), to) in edges.iter().zip(positions.iter_mut()) {
                    *to = place.position(edge % 4, corner_of(edge / 4), part);
                }
            }
        }
        let of = |(edge, part)| colour(volume, samples, edge % 4, corner_of(edge / 4), part);
        let colours = if volume.config().colour { edges.iter().map(of).collect() } else { Vec::new() };
        let (count, triangles) = (edges.count, self.triangles(backend));
        Mesh {
            positions: self.positions[..count].to_vec(),
            normals: Vec::new(),
            colours,
            triangles: self.triangles[..triangles].to_vec(),
        }
    }

    /// Writes the triangles, and returns how many there are.
    fn triangles(&mut self, backend: Backend) -> usize {
        let Self { samples, triangles, .. } = self;
        let (cells, cases) = (samples.cells(), samples.cases());
        #[cfg(target_arch = "x86_64")]
        if backend == Backend::Avx512 {
            #[allow(unsafe_code)]
            // SAFETY: a backend is only chosen when the processor has its instructions.
            return unsafe { kernel_x86::triangles(cells, cases, &CELLS, &samples.edges, triangles) };
        }
        let _ = backend;
        let mut count = 0;
        for &cell in cells {
            let cell = cell as usize;
            for corners in CELLS[usize::from(cases[cell / 4])].iter() {
                triangles[count] = corners.map(|at| samples.edges.number(cell + usize::from(at)).into());
                count += 1;
            }
        }
        count
    }
}
