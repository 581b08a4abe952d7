//! The clock of a device against that of this machine.

use std::collections::VecDeque;

/// Offsets below this are the way of the data, not another clock, nanoseconds.
const SAME_CLOCK_NS: i64 = 30_000_000;
/// A clock that is off by more than this was set anew: the offset jumps, nanoseconds.
const JUMP_NS: i64 = 100_000_000;
/// Of smaller corrections, the part of the time that passes, so that rates of samples change by no more.
const SLEW: f64 = 0.005;
/// How long the least delay is taken of a stretch, and of how many stretches, nanoseconds: longer than any disturbance, short
/// enough for crystals that differ by 50 ppm (0.5 ms in 10 s).
const STRETCH_NS: i64 = 500_000_000;
const STRETCHES: usize = 20;

/// The offset of a device's clock, estimated from when its data arrives: `t_host = t_device + offset`.
///
/// Data arrives later than it was measured, never earlier, so the least of `arrival - t_device` over the last ten seconds is
/// the offset and the shortest way of the data, which cannot be told apart (Cristian 1989 needs the round trip for that).
/// Stamps are late by that way: about a millisecond over USB. Devices whose stamps are the host's already, within 30 ms, are
/// left as they are.
#[derive(Clone, Debug, Default)]
pub struct DeviceClock {
    /// The start of a stretch (arrival) and the least delay in it.
    least: VecDeque<(i64, i64)>,
    offset_ns: Option<i64>,
    last_arrival: i64,
    jumps: usize,
}

impl DeviceClock {
    /// A clock of which nothing is known.
    pub fn new() -> Self {
        Self::default()
    }

    /// The host's time of data that the device stamped `device_ns` and that came at `arrived_ns`.
    pub fn host_ns(&mut self, device_ns: i64, arrived_ns: i64) -> i64 {
        let delay = arrived_ns.saturating_sub(device_ns);
        match self.offset_ns {
            // The device's clock was set ahead: data would come before it was measured.
            Some(offset) if offset.saturating_sub(delay) > JUMP_NS => self.restart(),
            _ => {}
        }
        match self.least.back_mut() {
            Some((start, least)) if arrived_ns.saturating_sub(*start) < STRETCH_NS => {
                *least = delay.min(*least)
            }
            _ => self.least.push_back((arrived_ns, delay)),
        }
        while self.least.len() > STRETCHES {
            self.least.pop_front();
        }
        let target = self.least.iter().map(|(_, least)| *least).min().unwrap_or(delay);
        let target = if (0..SAME_CLOCK_NS).contains(&target) { 0 } else { target };
        let offset = match self.offset_ns {
            None => target,
            Some(offset) if target.saturating_sub(offset).saturating_abs() > JUMP_NS => {
                self.jumps += 1;
                target
            }
            Some(offset) => {
                let most = (SLEW * arrived_ns.saturating_sub(self.last_arrival).max(0) as f64) as i64;
                offset + (target - offset).clamp(-most, most)
            }
        };
        (self.offset_ns, self.last_arrival) = (Some(offset), arrived_ns);
        device_ns.saturating_add(offset)
    }

    /// The offset in seconds, `t_host = t_device + offset`; `None` before any data.
    pub fn offset_s(&self) -> Option<f64> {
        self.offset_ns.map(|ns| ns as f64 * 1e-9)
    }

    /// How often the device's clock was set anew.
    pub fn jumps(&self) -> usize {
        self.jumps
    }

    /// Forgets the offset: the device was started anew.
    pub fn restart(&mut self) {
        self.jumps += usize::from(self.offset_ns.take().is_some());
        self.least.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Data of a device at 200 Hz for some seconds: its clock is `offset_s` behind ours and goes `ppm` too slow; the way takes
    /// 0.8 ms and up to 6 ms more. Returns the largest error of the stamps after the first second, seconds.
    fn worst_error_s(clock: &mut DeviceClock, offset_s: f64, ppm: f64, seconds: f64) -> f64 {
        let mut worst = 0.0_f64;
        let mut last = i64::MIN;
        for k in 0..(200.0 * seconds) as u64 {
            let t = 1000.0 + k as f64 * 0.005;
            let device = (t - offset_s) - (t - 1000.0) * ppm * 1e-6;
            // A spread without a pattern in time (the golden ratio's multiples).
            let jitter = (k as f64 * 0.618_033_988_75).fract();
            let arrived = t + 0.0008 + 0.006 * jitter * jitter;
            let host = clock.host_ns((device * 1e9) as i64, (arrived * 1e9) as i64);
            assert!(host > last, "stamps go on");
            last = host;
            if t > 1001.0 {
                worst = worst.max((host as f64 * 1e-9 - t).abs());
            }
        }
        worst
    }

    #[test]
    fn the_offset_is_found_with_its_sign_and_followed() {
        for offset_s in [950.0, -3600.0, 0.5] {
            let mut clock = DeviceClock::new();
            let worst = worst_error_s(&mut clock, offset_s, 0.0, 30.0);
            let found = clock.offset_s().unwrap();
            assert!((found - offset_s - 0.0008).abs() < 2e-4, "{offset_s}: {found}");
            assert!(worst < 1.5e-3, "{offset_s}: {worst}");
        }
        for ppm in [50.0, -50.0] {
            let worst = worst_error_s(&mut DeviceClock::new(), 950.0, ppm, 120.0);
            assert!(worst < 2e-3, "{ppm} ppm: {worst}");
        }
    }

    #[test]
    fn stamps_of_our_own_clock_are_left_alone() {
        let mut clock = DeviceClock::new();
        assert!(worst_error_s(&mut clock, 0.0, 0.0, 5.0) < 1e-6);
        assert_eq!(clock.offset_s(), Some(0.0));
    }

    #[test]
    fn a_clock_that_was_set_anew_is_followed_at_once() {
        let mut clock = DeviceClock::new();
        clock.host_ns(5_000_000_000, 100_000_000_000);
        // It began again from zero: data seems to be late, until the delays before are forgotten after ten seconds.
        clock.restart();
        assert_eq!(clock.host_ns(0, 101_000_000_000), 101_000_000_000);
        // It was set ahead: that is known from one reading.
        assert_eq!(clock.host_ns(50_000_000_000, 101_005_000_000), 101_005_000_000);
        assert_eq!(clock.jumps(), 2);
    }
}
