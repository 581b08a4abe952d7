//! What a window estimates of the calibration: the disparity error of a stereo pair, and the readout time of a rolling shutter.

use cairn_atlas::{Change, Readout, Snapshot};
use cairn_solve::{Calibration, Moves};

/// Standard deviation by which the readout time of the rows may be another one from window to window, seconds: windows share
/// most of what they are of, and it is told anew by each.
const READOUT_WALK_S: f64 = 0.001;

/// The variables of a bundle: the disparity error, then, where observations move with it, what has to be added to the readout time.
pub fn variables(snapshot: &Snapshot, slopes: Vec<[f32; 2]>) -> Vec<Calibration> {
    let value = snapshot.right_offset();
    // A calibration that nothing has refuted is kept.
    let held = value == 0.0;
    let disparity = Calibration { value, prior: value, held, ..Calibration::default() };
    if slopes.is_empty() {
        return vec![disparity];
    }
    let sigma = snapshot.readout().sigma_s.hypot(READOUT_WALK_S).min(Readout::default().sigma_s);
    vec![disparity, Calibration { moves: Moves::Along(slopes), sigma, ..Calibration::default() }]
}

/// What was found, where the map had this readout time.
pub fn changes(readout: &Readout, variables: &[Calibration]) -> Vec<Change> {
    let change = |c: &Calibration| match c.moves {
        Moves::Disparity => (c.sigma > 0.0 && !c.held).then_some(Change::Calibrate(c.value)),
        Moves::Along(_) => (c.information > 0.0).then(|| {
            let seconds = (readout.seconds + c.value).clamp(-Readout::MOST_S, Readout::MOST_S);
            Change::Readout(Readout { seconds, sigma_s: c.information.sqrt().recip() })
        }),
    };
    variables.iter().filter_map(change).collect()
}
