//! Bags of binary words for place recognition: an image as a sparse vector of visual words, so that images of the same
//! place are found among thousands.
//!
//! A [`Vocabulary`] is a tree of cluster centres over binary descriptors (Nister and Stewenius, "Scalable recognition
//! with a vocabulary tree", CVPR 2006; over bits: Galvez-Lopez and Tardos, "Bags of binary words for fast place
//! recognition in image sequences", T-RO 2012). A descriptor descends the tree, at each node to the nearest child; the
//! leaf it reaches is its word. A [`BagOfWords`] holds the words of one image with tf-idf weights and, as direct index, the
//! node of a middle level that each feature passed, so that the features of two images are matched without comparing
//! all with all ([`match_through_nodes`]).
//!
//! A vocabulary file is used in place (`format.rs`): opening validates it and copies nothing.

mod bag;
mod build;
mod dbow2;
mod error;
mod format;
mod matching;
mod train;
mod vocabulary;

pub use bag::{BagOfWords, WordId};
pub use dbow2::{Dbow2Error, import_dbow2};
pub use error::VocabularyError;
pub use format::VocabularyFacts;
pub use matching::{NodeMatchConfig, match_through_nodes};
pub use train::{TrainConfig, TrainError, Trained, train};
pub use vocabulary::Vocabulary;
