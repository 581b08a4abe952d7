//! ORB features: corners that are found again, and 256 bits that tell them apart.
//!
//! In: one gray image. Out: [`Features`], struct of arrays, at most as many as asked, spread over the image.
//! The steps, each in its file: [`pyramid`](Pyramid) (levels at a fixed ratio), `fast` (FAST-9 corners,
//! Rosten and Drummond 2006, score and non-maximum suppression), `distribute` (even spread), `subpixel`
//! (where in the pixel the corner is), `orientation` (intensity centroid), `blur` and `descriptor` (steered
//! BRIEF; both after Rublee et al., "ORB: an efficient alternative to SIFT or SURF", ICCV 2011).
//!
//! Every hot loop exists twice: plain Rust, and AVX2 chosen at run time; the two give the same bits.

mod backend;
mod blur;
#[cfg(target_arch = "x86_64")]
mod blur_avx2;
mod descriptor;
#[cfg(target_arch = "x86_64")]
mod descriptor_avx2;
mod distribute;
mod extractor;
mod fast;
#[cfg(target_arch = "x86_64")]
mod fast_avx2;
mod fast_score;
mod hamming;
#[cfg(target_arch = "x86_64")]
mod hamming_x86;
mod orientation;
#[cfg(target_arch = "x86_64")]
mod orientation_avx2;
mod pattern;
mod pyramid;
mod resize;
#[cfg(target_arch = "x86_64")]
mod resize_avx2;
mod subpixel;

#[cfg(test)]
mod tests;

pub use backend::Backend;
#[doc(hidden)]
pub use extractor::Stage;
pub use extractor::{Features, OrbConfig, OrbExtractor};
pub use hamming::{BestTwo, best_two, best_two_of, hamming};
pub use pyramid::Pyramid;

/// Pixels of a level, next to its edge, in which no feature is sought: the radius of the descriptor's and
/// the orientation's patch, and one.
pub(crate) const BORDER: usize = 16;
