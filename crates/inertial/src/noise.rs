//! The white noise of an IMU: what its rig states, and what its sensor has.

use cairn_sensor::ImuNoise;

/// The white noise of a poor MEMS sensor by its data sheet: rad/s/sqrt(Hz), m/s^2/sqrt(Hz) (those in phones state about
/// 1e-4 and 2e-3).
const POOR: [f64; 2] = [4e-4, 4e-3];

/// The noise of the sensor itself. Rigs often state several times as much, to allow for vibration and for errors of
/// scale and alignment (Kalibr's manual advises to; the rig of a phone, of which nothing is known, states ten times). Such
/// an allowance says nothing of how uncertain scale is, and adjustments that allow for more than the data sheet anyway
/// would count it twice. Sensors that are noisier than this in fact show it in the residuals, by which
/// [`initialise`](crate::initialise) raises the noise.
pub fn of_data_sheet(stated: &ImuNoise) -> ImuNoise {
    ImuNoise { gyro: stated.gyro.min(POOR[0]), accel: stated.accel.min(POOR[1]), ..*stated }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_allowance_is_left_out_and_a_data_sheet_kept() {
        let phone = ImuNoise { gyro: 3e-3, gyro_walk: 1e-4, accel: 3e-2, accel_walk: 1e-3 };
        let adis = ImuNoise { gyro: 1.7e-4, gyro_walk: 1.9e-5, accel: 2e-3, accel_walk: 3e-3 };
        assert_eq!(of_data_sheet(&phone), ImuNoise { gyro: POOR[0], accel: POOR[1], ..phone });
        assert_eq!(of_data_sheet(&adis), adis);
    }
}
