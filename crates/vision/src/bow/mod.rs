//! Bags of words: what an image shows as a short list of numbers, so that the same place is found among thousands.
//!
//! A [`Vocabulary`] is a tree of cluster centres over binary descriptors (Nister and Stewenius, "Scalable recognition
//! with a vocabulary tree", CVPR 2006; over bits: Galvez-Lopez and Tardos, "Bags of binary words for fast place
//! recognition in image sequences", T-RO 2012). A descriptor goes down the tree, at each node to the nearest child; the
//! leaf where it ends is its word. A [`Bag`] holds the words of one image, weighted by how rare they are, and for each
//! feature the node of a middle level that it passed, so that two images are matched feature by feature without comparing
//! all with all ([`match_through_nodes`]).
//!
//! The file of a vocabulary is used as it lies (`format.rs`): opening checks it and copies nothing.

mod bag;
mod build;
mod dbow2;
mod format;
mod matching;
mod train;
mod vocabulary;

pub use bag::{Bag, WordId};
pub use dbow2::{Dbow2Error, import_dbow2};
pub use format::VocabularyError;
pub use matching::{NodeMatchConfig, match_through_nodes};
pub use train::{TrainConfig, TrainError, Trained, train};
pub use vocabulary::{Vocabulary, VocabularyFacts};
