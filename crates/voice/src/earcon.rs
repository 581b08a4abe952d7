//! Synthesised earcons: sums of sines with soft starts and ends, placed to the left or right.
//!
//! Placement: constant-power panning for loudness, and Woodworth's delay of the farther ear, `r / c (sin b + b)` with
//! r = 8.75 cm (Woodworth 1938, Experimental Psychology), both by the bearing folded to the front.

use cairn_guide::Earcon;
use std::f64::consts::{FRAC_PI_2, PI};

/// One of the two ears.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// The left ear.
    Left = 0,
    /// The right ear.
    Right = 1,
}

/// Frequency in hertz, start and duration in seconds, amplitude.
type Note = (f64, f64, f64, f64);

fn notes(earcon: Earcon) -> &'static [Note] {
    match earcon {
        Earcon::OnCourse => &[(880.0, 0.0, 0.05, 0.15)],
        Earcon::OffCourse => &[(330.0, 0.0, 0.12, 0.4), (262.0, 0.14, 0.16, 0.4)],
        Earcon::Turn => &[(660.0, 0.0, 0.09, 0.4), (880.0, 0.1, 0.09, 0.4)],
        Earcon::Turning => &[(1047.0, 0.0, 0.07, 0.2)],
        Earcon::Waypoint => &[(988.0, 0.0, 0.12, 0.3)],
        Earcon::Arrival => &[(523.0, 0.0, 0.15, 0.4), (659.0, 0.16, 0.15, 0.4), (784.0, 0.32, 0.3, 0.4)],
        Earcon::Stop => &[(196.0, 0.0, 0.18, 0.6), (196.0, 0.25, 0.18, 0.6)],
    }
}

/// An earcon of a turn under way is deeper by so many octaves for each half turn that is left.
const OCTAVES_LEFT: f64 = 1.5;
/// Length of the fade at the start and end of a note, seconds.
const SOFT_S: f64 = 0.008;
/// Radius of a head over the speed of sound, seconds.
const HEAD_S: f64 = 0.0875 / 343.0;

/// Left and right samples in -1..1 of an earcon at `rate` samples a second, from `bearing_rad` (positive: left).
pub fn earcon(earcon: Earcon, bearing_rad: f64, rate: u32) -> Vec<[f32; 2]> {
    let rate = f64::from(rate);
    // A sound from behind is placed on its side: these cues do not distinguish front from back.
    let side = bearing_rad.sin().clamp(-1.0, 1.0).asin();
    let gains = { [(0.25 * PI + 0.5 * side).sin(), (0.25 * PI + 0.5 * side).cos()] };
    let late = HEAD_S * (side.abs().sin() + side.abs());
    let delays = if side > 0.0 { [0.0, late] } else { [late, 0.0] };
    let notes = notes(earcon);
    let end = notes.iter().map(|n| n.1 + n.2).fold(0.0, f64::max) + late;
    let mut out = vec![[0.0; 2]; (end * rate).ceil() as usize + 1];
    let pitch = match earcon {
        Earcon::Turning => (-OCTAVES_LEFT * bearing_rad.abs().min(PI) / PI).exp2(),
        _ => 1.0,
    };
    for &(hertz, begin, length, loud) in notes {
        let hertz = hertz * pitch;
        for ear in 0..2 {
            let first = ((begin + delays[ear]) * rate).ceil() as usize;
            let last = (((begin + delays[ear] + length) * rate) as usize).min(out.len() - 1);
            for k in first..=last {
                let t = k as f64 / rate - begin - delays[ear];
                let soft = (t.min(length - t) / SOFT_S).clamp(0.0, 1.0);
                let wave = (2.0 * PI * hertz * t).sin() * (FRAC_PI_2 * soft).sin();
                out[k][ear] += (loud * gains[ear] * wave) as f32;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Earcon; 7] = [
        Earcon::OnCourse,
        Earcon::OffCourse,
        Earcon::Turn,
        Earcon::Turning,
        Earcon::Waypoint,
        Earcon::Arrival,
        Earcon::Stop,
    ];

    fn power(sound: &[[f32; 2]], ear: Channel) -> f32 {
        sound.iter().map(|s| s[ear as usize].powi(2)).sum()
    }

    #[test]
    fn earcons_are_short_faded_and_not_clipped() {
        for e in ALL {
            let sound = earcon(e, 0.3, 22_050);
            assert!(sound.len() < 22_050 && sound.len() > 1000, "{e:?}");
            assert!(sound.iter().flatten().all(|v| v.abs() <= 0.95), "{e:?}");
            assert!(sound[0].iter().chain(&sound[sound.len() - 1]).all(|v| v.abs() < 0.02), "{e:?}");
        }
    }

    #[test]
    fn a_turn_under_way_rises() {
        // Crossings of zero, each half a period of the pitch.
        let pitch = |left_rad: f64| {
            let sound = earcon(Earcon::Turning, left_rad, 48_000);
            sound.windows(2).filter(|w| w[0][0].signum() != w[1][0].signum()).count()
        };
        let heard = [3.1, 2.0, 1.0, 0.3].map(pitch);
        assert!(heard.windows(2).all(|w| w[0] < w[1]), "{heard:?}");
    }

    #[test]
    fn side_is_encoded_in_level_and_delay() {
        for e in ALL {
            let (left, right, ahead) =
                (earcon(e, 1.0, 48_000), earcon(e, -1.0, 48_000), earcon(e, 0.0, 48_000));
            assert!(power(&left, Channel::Left) > 3.0 * power(&left, Channel::Right), "{e:?}");
            assert!(power(&right, Channel::Right) > 3.0 * power(&right, Channel::Left), "{e:?}");
            let balance = power(&ahead, Channel::Left) / power(&ahead, Channel::Right);
            assert!((balance - 1.0).abs() < 1e-3, "{e:?}");
            // The nearer ear hears it first.
            let begins = |s: &[[f32; 2]], ear: usize| s.iter().position(|v| v[ear].abs() > 1e-4).unwrap();
            assert!(begins(&left, 0) + 10 < begins(&left, 1), "{e:?}");
        }
        // No two sound the same.
        for (i, a) in ALL.iter().enumerate() {
            for b in &ALL[i + 1..] {
                assert_ne!(earcon(*a, 0.0, 8000), earcon(*b, 0.0, 8000));
            }
        }
    }
}
