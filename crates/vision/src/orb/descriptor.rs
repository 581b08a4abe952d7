//! Steered BRIEF (Rublee et al. 2011, section 4) with a test pattern learned for this project (see [`super::pattern`]).

use super::Backend;
use super::pattern::PATTERN;
use crate::Descriptor;

/// What the bits of a descriptor mean: descriptors of another number cannot be compared with those computed here.
/// FNV-1a of the pattern of tests.
pub const DESCRIPTOR_ID: u32 = {
    let mut hash = 0x811c_9dc5_u32;
    let mut k = 0;
    while k < PATTERN.len() * 4 {
        hash = (hash ^ PATTERN[k / 4][k % 4] as u8 as u32).wrapping_mul(0x0100_0193);
        k += 1;
    }
    hash
};

/// One bit per test: is the blurred image darker at the first point than at the second?
///
/// `data` is the blurred level, `centre` the index of the keypoint's pixel in it, at least [`super::BORDER`] from
/// every edge, with four readable bytes behind the last pixel; `direction` is cosine and sine in units of 1/16384.
pub(super) fn describe(
    data: &[u8],
    stride: usize,
    centre: usize,
    direction: [i16; 2],
    backend: Backend,
) -> Descriptor {
    #[cfg(target_arch = "x86_64")]
    match backend {
        Backend::Avx512 => return super::descriptor_avx512::describe(data, stride, centre, direction),
        Backend::Avx2 => return super::descriptor_avx2::describe(data, stride, centre, direction),
        Backend::Scalar => {}
    }
    let _ = backend;
    // Apart from the look-up, so that compilers compute four or more at once.
    let mut offsets = [0; 2 * TESTS];
    for (offset, (x, y)) in offsets.iter_mut().zip(POINTS[0].iter().zip(&POINTS[1])) {
        *offset = rotated([*x, *y], direction, stride as i32);
    }
    let value = |k: usize| data[centre.wrapping_add_signed(offsets[k] as isize)];
    let mut out = [0u8; TESTS / 8];
    for (byte, first) in out.iter_mut().zip((0..TESTS).step_by(8)) {
        for bit in 0..8 {
            *byte |= ((value(first + bit) < value(TESTS + first + bit)) as u8) << bit;
        }
    }
    out
}

const TESTS: usize = PATTERN.len();

/// x and y of the first points of all tests, then of the second ones.
static POINTS: [[i16; 2 * TESTS]; 2] = {
    let mut out = [[0; 2 * TESTS]; 2];
    let mut i = 0;
    while i < TESTS {
        let mut k = 0;
        while k < 4 {
            out[k % 2][k / 2 * TESTS + i] = PATTERN[i][k] as i16;
            k += 1;
        }
        i += 1;
    }
    out
};

/// Offset in the image data of a rotated pattern point.
fn rotated([x, y]: [i16; 2], [c, s]: [i16; 2], stride: i32) -> i32 {
    let (x, y, c, s) = (x as i32, y as i32, c as i32, s as i32);
    let rotated_x = (x * c - y * s + 8192) >> 14;
    let rotated_y = (x * s + y * c + 8192) >> 14;
    rotated_y * stride + rotated_x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pattern_points_lie_in_the_disc() {
        for &[x0, y0, x1, y1] in PATTERN.iter() {
            for [x, y] in [[x0, y0], [x1, y1]] {
                assert!((x as i32).pow(2) + (y as i32).pow(2) <= 15 * 15);
            }
            assert_ne!([x0, y0], [x1, y1]);
        }
    }

    #[test]
    fn rotation_by_right_angles_is_exact() {
        assert_eq!(rotated([3, -5], [16384, 0], 100), -5 * 100 + 3);
        assert_eq!(rotated([3, -5], [0, 16384], 100), 3 * 100 + 5);
        assert_eq!(rotated([3, -5], [-16384, 0], 100), 5 * 100 - 3);
    }
}
