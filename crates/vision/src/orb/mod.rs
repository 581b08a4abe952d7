//! ORB features: oriented multi-scale FAST corners with 256-bit binary descriptors.
//!
//! Input: one gray image. Output: [`Features`], a struct of arrays, distributed over the image.
//! The stages, each in its file: [`pyramid`](Pyramid) (levels at a fixed ratio), `fast` (FAST-9 corners,
//! Rosten and Drummond 2006, score and non-maximum suppression), `distribute` (spatial distribution), `subpixel`
//! (sub-pixel refinement), `orientation` (intensity centroid), `blur` and `descriptor` (steered
//! BRIEF; both after Rublee et al., "ORB: an efficient alternative to SIFT or SURF", ICCV 2011).
//!
//! Every hot loop exists twice: portable Rust, written such that compilers vectorise it for other processors and for
//! WebAssembly, and AVX2 selected at run time; those that gain most by it a third time, for AVX-512. All are bit-identical.

mod backend;
mod blur;
#[cfg(target_arch = "x86_64")]
mod blur_avx2;
#[cfg(target_arch = "x86_64")]
mod blur_avx512;
mod blur_scalar;
mod descriptor;
#[cfg(target_arch = "x86_64")]
mod descriptor_avx2;
#[cfg(target_arch = "x86_64")]
mod descriptor_avx512;
mod distribute;
mod extractor;
mod fast;
#[cfg(target_arch = "x86_64")]
mod fast_avx2;
#[cfg(target_arch = "x86_64")]
mod fast_avx512;
mod fast_scalar;
mod fast_score;
mod hamming;
mod hamming_scalar;
#[cfg(target_arch = "x86_64")]
mod hamming_x86;
mod orientation;
#[cfg(target_arch = "x86_64")]
mod orientation_avx2;
#[cfg(target_arch = "x86_64")]
mod orientation_avx512;
mod orientation_scalar;
mod pattern;
mod pyramid;
mod resize;
#[cfg(target_arch = "x86_64")]
mod resize_avx2;
mod resize_scalar;
#[cfg(target_feature = "simd128")]
mod resize_simd128;
mod subpixel;

#[cfg(test)]
mod tests;

pub use backend::Backend;
pub use descriptor::DESCRIPTOR_ID;
#[doc(hidden)]
pub use extractor::Stage;
pub use extractor::{Features, OrbConfig, OrbExtractor};
pub use hamming::{BestTwo, best_two, best_two_of, hamming};
pub use pyramid::Pyramid;

/// Width in pixels of the border of a level in which no feature is detected: the radius of the descriptor and
/// orientation patch, plus one.
pub(crate) const BORDER: usize = 16;
