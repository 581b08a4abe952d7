//! Steered BRIEF: Rublee et al. 2011, section 4; the tests are our own (see [`super::pattern`]).

use super::Backend;
use super::pattern::PATTERN;
use crate::Descriptor;

/// One bit per test: is the blurred image darker at the first point than at the second?
///
/// `data` is the blurred level, `centre` the index of the keypoint's pixel in it, at least [`super::BORDER`] from
/// every edge, with four readable bytes behind the last pixel; `direction` is cosine and sine in 1/16384ths.
pub(super) fn describe(
    data: &[u8],
    stride: usize,
    centre: usize,
    direction: [i16; 2],
    backend: Backend,
) -> Descriptor {
    #[cfg(target_arch = "x86_64")]
    if backend == Backend::Avx2 {
        return super::descriptor_avx2::describe(data, stride, centre, direction);
    }
    let _ = backend;
    let value = |x: i8, y: i8| data[centre.wrapping_add_signed(offset([x, y], direction, stride))];
    let mut out = [0u8; 32];
    for (byte, tests) in out.iter_mut().zip(PATTERN.chunks_exact(8)) {
        for (bit, &[x0, y0, x1, y1]) in tests.iter().enumerate() {
            *byte |= ((value(x0, y0) < value(x1, y1)) as u8) << bit;
        }
    }
    out
}

/// Where a point of the pattern falls once turned, as a distance in the image's data.
fn offset([x, y]: [i8; 2], [c, s]: [i16; 2], stride: usize) -> isize {
    let (x, y, c, s) = (x as i32, y as i32, c as i32, s as i32);
    let turned_x = (x * c - y * s + 8192) >> 14;
    let turned_y = (x * s + y * c + 8192) >> 14;
    turned_y as isize * stride as isize + turned_x as isize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pattern_stays_in_its_disc_however_turned() {
        for &[x0, y0, x1, y1] in PATTERN.iter() {
            for [x, y] in [[x0, y0], [x1, y1]] {
                assert!((x as i32).pow(2) + (y as i32).pow(2) <= 15 * 15);
            }
            assert_ne!([x0, y0], [x1, y1]);
        }
    }

    #[test]
    fn turning_by_a_right_angle_is_exact() {
        assert_eq!(offset([3, -5], [16384, 0], 100), -5 * 100 + 3);
        assert_eq!(offset([3, -5], [0, 16384], 100), 3 * 100 + 5);
        assert_eq!(offset([3, -5], [-16384, 0], 100), 5 * 100 - 3);
    }
}
