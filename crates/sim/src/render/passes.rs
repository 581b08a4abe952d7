//! The passes over an image, compiled twice: for any machine, and with wider vectors where the processor has them.
//! Both do the same operations in the same order (nothing is contracted), so they give the same bytes.

use super::raster::Visibility;
use super::setup::Setup;
use super::{edges, shade};
use crate::texture::Texture;

/// Draws prepared faces into 256 times the grey level of each pixel; `grey` is as long as the buffer of inverse depths.
pub(crate) fn run(seen: &mut Visibility, setups: &[Setup], textures: &[Texture], grey: &mut [u16]) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        #[allow(unsafe_code)]
        // SAFETY: the processor was just asked whether it has AVX2; the function has no other condition.
        unsafe {
            wide(seen, setups, textures, grey);
        }
        return;
    }
    all::<false>(seen, setups, textures, grey);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn wide(seen: &mut Visibility, setups: &[Setup], textures: &[Texture], grey: &mut [u16]) {
    all::<true>(seen, setups, textures, grey);
}

#[inline(always)]
pub(crate) fn all<const AVX2: bool>(
    seen: &mut Visibility,
    setups: &[Setup],
    textures: &[Texture],
    grey: &mut [u16],
) {
    seen.clear();
    for (i, s) in setups.iter().enumerate() {
        seen.draw(s, i as u32 + 1);
    }
    grey.fill(shade::UNSHADED);
    edges::smooth(seen, setups, textures, grey);
    shade::shade::<AVX2>(seen, setups, textures, grey);
}
