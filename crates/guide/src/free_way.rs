//! Where a walker may be sent: what a watch over his way found free around him.

use std::f64::consts::TAU;

/// Seconds from a short direction until the walker follows it.
pub const ANSWER_S: f64 = 1.6;

/// How far one can walk straight on in each direction, and how far it must be free for a walker to be sent there: what he walks
/// until he has heard "stop" and stands.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeWay {
    free_m: Vec<f64>,
    needed_m: f64,
    /// The same from where he will be when he follows a short direction; `None` for here.
    answered_m: Option<Vec<f64>>,
}

impl FreeWay {
    /// From the metres that are free in the headings `k * 2 pi / n` (radians, counter-clockwise from x of the ground plane) and
    /// the metres that must be.
    pub fn new(free_m: Vec<f64>, needed_m: f64) -> Self {
        Self { free_m, needed_m, answered_m: None }
    }

    /// The same with what is free from where he will be when he follows a short direction ([`ANSWER_S`]): who is told to bear while he
    /// walks bears there.
    pub fn answered(self, free_m: Vec<f64>) -> Self {
        Self { answered_m: Some(free_m), ..self }
    }

    /// The same where so many metres must be free.
    pub fn requiring(&self, needed_m: f64) -> Self {
        Self { needed_m, ..self.clone() }
    }

    /// Metres that must be free.
    pub fn needed_m(&self) -> f64 {
        self.needed_m
    }

    /// Metres that are free in a heading, radians: the least of the two directions that it lies between. Endless where nothing
    /// was given.
    pub fn free_m(&self, heading: f64) -> f64 {
        least(&self.free_m, heading, 0.0)
    }

    /// Whether a walker with this heading may walk on.
    pub fn admits(&self, heading: f64) -> bool {
        self.admits_within(heading, 0.0)
    }

    /// The same for all headings that are off by at most `tolerance_rad`.
    pub fn admits_within(&self, heading: f64, tolerance_rad: f64) -> bool {
        least(&self.free_m, heading, tolerance_rad) >= self.needed_m
    }

    /// Whether who walks may bear to this heading: from where he will be by then.
    pub fn admits_bearing(&self, heading: f64) -> bool {
        least(self.answered_m.as_ref().unwrap_or(&self.free_m), heading, 0.0) >= self.needed_m
    }
}

/// The least of what is free in the headings within a tolerance.
fn least(free_m: &[f64], heading: f64, tolerance_rad: f64) -> f64 {
    let n = free_m.len();
    let bin = TAU / n.max(1) as f64;
    let (first, last) = ((heading - tolerance_rad) / bin, (heading + tolerance_rad) / bin);
    if !(first.is_finite() && last.is_finite()) {
        return 0.0;
    }
    let (first, last) = (first.floor() as i64, last.ceil() as i64);
    let at = |k: i64| free_m.get(k.rem_euclid(n.max(1) as i64) as usize).copied();
    (first..=last.min(first + n as i64)).filter_map(at).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heading_is_free_when_its_neighbours_are() {
        let mut free = vec![3.0; 72];
        free[10] = 1.0;
        let way = FreeWay::new(free, 2.0);
        let deg = f64::to_radians;
        assert!(
            way.admits(deg(44.0))
                && !way.admits(deg(46.0))
                && !way.admits(deg(54.0))
                && way.admits(deg(56.0))
        );
        assert!(way.admits(deg(404.0)) && !way.admits(deg(-310.0)));
        assert!(!way.admits_within(deg(38.0), deg(10.0)) && way.admits_within(deg(38.0), deg(6.0)));
        assert_eq!((way.free_m(deg(52.0)), way.needed_m()), (1.0, 2.0));
        assert!(!way.admits(f64::NAN) && !way.admits_within(0.0, 7.0));
        assert!(FreeWay::new(Vec::new(), 2.0).admits(1.0));
        // Where he will be by then it is the heading beside it that is not free.
        assert!(!way.admits_bearing(deg(52.0)));
        let mut by_then = vec![3.0; 72];
        by_then[12] = 1.0;
        let way = way.answered(by_then);
        assert!(way.admits_bearing(deg(52.0)) && !way.admits_bearing(deg(58.0)) && !way.admits(deg(52.0)));
    }
}
