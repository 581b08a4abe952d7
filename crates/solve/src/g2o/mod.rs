//! Pose graphs as g2o text: `VERTEX_SE2`, `EDGE_SE2`, `VERTEX_SE3:QUAT`, `EDGE_SE3:QUAT` and `FIX`; points that were seen
//! (`VERTEX_XY`, `EDGE_SE2_XY`, `VERTEX_TRACKXYZ`, `EDGE_SE3_TRACKXYZ` with `PARAMS_SE3OFFSET`); and what is known in the
//! world (`EDGE_SE2_PRIOR`, `EDGE_PRIOR_SE2`, `EDGE_PRIOR_SE2_XY`, `EDGE_SE3_PRIOR`, `EDGE_SE3_XYZPRIOR`).
//!
//! Source: Kuemmerle et al., "g2o: a general framework for graph optimization" (2011), and its file format. Information
//! matrices are taken as they are, for (x, y, angle) and (x, y, z, rotation vector), as GTSAM and SE-Sync take them.
//! A file without vertices gets those that its edges name. Texts of TORO and iSAM are read as well ([`as_g2o`]).

mod content;
mod lines;
mod parts;
mod read;
mod record;
mod toro;
mod write;

pub use content::{G2o, Graph, Named, Replaced};
pub use read::{read, read_nearest, tags_text};
pub use toro::{Form, as_g2o};
pub use write::write;
