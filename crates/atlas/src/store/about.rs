//! How a map was made: program, sensors, camera; and whether another camera may continue in it.

use super::error::StoreError;
use super::wire::{Decoder, Encoder};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_vision::{Octaves, RectifiedCamera, SensorMode};
use nalgebra::{Quaternion, UnitQuaternion};

/// Largest distance in pixels between the images of one ray under two cameras that count as equal.
const SAME_PX: f64 = 0.5;
/// Largest relative difference of two baselines that count as equal.
const SAME_BASELINE: f64 = 0.005;

/// How a map was made.
#[derive(Clone, Debug, PartialEq)]
pub struct About {
    /// The program that wrote the file, with its version.
    pub program: String,
    /// Sensors.
    pub sensor: SensorMode,
    /// The rectified camera of all key frames.
    pub camera: RectifiedCamera,
}

/// What keeps a run from going on in a map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraMismatch {
    /// They use other sensors.
    #[error("the map was made with {}, this run uses {}", sensor_name(*.map), sensor_name(*.run))]
    Sensor {
        /// Those of the map.
        map: SensorMode,
        /// Those of the run.
        run: SensorMode,
    },
    /// Their pyramids differ.
    #[error(
        "the map has {} octaves of {}, this run {} of {}",
        .map.levels, .map.factor, .run.levels, .run.factor
    )]
    Octaves {
        /// That of the map.
        map: Octaves,
        /// That of the run.
        run: Octaves,
    },
    /// Their cameras show the same ray at pixels too far apart.
    #[error(
        "the map was made with another camera: fx {:.2} fy {:.2} cx {:.2} cy {:.2} where this run has {:.2} {:.2} \
         {:.2} {:.2}, up to {apart_px:.1} px apart",
        .map.fx, .map.fy, .map.cx, .map.cy, .run.fx, .run.fy, .run.cx, .run.cy
    )]
    Camera {
        /// That of the map.
        map: Box<RectifiedCamera>,
        /// That of the run.
        run: Box<RectifiedCamera>,
        /// How far, pixels.
        apart_px: f64,
    },
    /// Their stereo baselines differ.
    #[error("the map was made with a baseline of {map_m:.4} m, this run has {run_m:.4} m")]
    Baseline {
        /// That of the map, metres.
        map_m: f64,
        /// That of the run, metres.
        run_m: f64,
    },
}

impl About {
    /// Compares this with the camera and sensors that are to continue in the map; returns descriptions of
    /// small differences.
    ///
    /// # Errors
    ///
    /// A difference that would corrupt the map.
    pub fn fits(
        &self,
        octaves: Octaves,
        sensor: SensorMode,
        camera: &RectifiedCamera,
        now: Octaves,
    ) -> Result<Vec<String>, CameraMismatch> {
        if self.sensor != sensor {
            return Err(CameraMismatch::Sensor { map: self.sensor, run: sensor });
        }
        if octaves != now {
            return Err(CameraMismatch::Octaves { map: octaves, run: now });
        }
        let apart = self.pixels_apart(camera);
        if apart > SAME_PX {
            return Err(CameraMismatch::Camera {
                map: Box::new(self.camera),
                run: Box::new(*camera),
                apart_px: apart,
            });
        }
        let baseline = |camera: &RectifiedCamera| camera.baseline_fx / camera.fx;
        let (a, b) = (baseline(&self.camera), baseline(camera));
        if (a - b).abs() > SAME_BASELINE * a.max(b) {
            return Err(CameraMismatch::Baseline { map_m: a, run_m: b });
        }
        let mut notes = Vec::new();
        if apart > 1e-6 || a != b {
            notes.push(format!(
                "the cameras differ by up to {apart:.3} px, the baselines by {:.5} m",
                (a - b).abs()
            ));
        }
        let arm = self.camera.body_from_camera.inverse() * camera.body_from_camera;
        let (metres, degrees) = (arm.translation.norm(), arm.rotation.angle().to_degrees());
        if metres > 1e-6 || degrees > 1e-4 {
            notes.push(format!(
                "the camera is mounted {metres:.3} m and {degrees:.2} degrees from where it was on the body"
            ));
        }
        Ok(notes)
    }

    /// Largest distance in pixels between the images of one ray in the two cameras, over the corners and the
    /// middle of the view.
    fn pixels_apart(&self, other: &RectifiedCamera) -> f64 {
        let e = &self.camera;
        let [x0, y0, x1, y1] = e.bounds;
        let at = [(x0, y0), (x1, y0), (x0, y1), (x1, y1), (e.cx, e.cy)];
        let apart = |(u, v): (f64, f64)| {
            let (x, y) = ((u - e.cx) / e.fx, (v - e.cy) / e.fy);
            (other.fx * x + other.cx - u).hypot(other.fy * y + other.cy - v)
        };
        at.into_iter().map(apart).fold(0.0, f64::max)
    }

    pub(super) fn encode(&self, e: &mut Encoder) {
        e.text(&self.program);
        encode_camera(e, self.sensor, &self.camera);
    }

    pub(super) fn decode(d: &mut Decoder) -> Result<Self, StoreError> {
        let program = d.text()?;
        let (sensor, camera) = decode_camera(d)?;
        Ok(Self { program, sensor, camera })
    }
}

/// Sensors and camera: 1 byte and 17 numbers.
pub(super) fn encode_camera(e: &mut Encoder, sensor: SensorMode, m: &RectifiedCamera) {
    e.u8(match sensor {
        SensorMode::Mono => 0,
        SensorMode::Stereo => 1,
        SensorMode::Rgbd => 2,
    });
    e.f64s(&[m.fx, m.fy, m.cx, m.cy, m.baseline_fx, m.close_depth]);
    e.f64s(&m.bounds);
    e.f64s(&numbers(&m.body_from_camera));
}

/// The inverse of [`encode_camera`].
pub(super) fn decode_camera(d: &mut Decoder) -> Result<(SensorMode, RectifiedCamera), StoreError> {
    let sensor = match d.u8()? {
        0 => SensorMode::Mono,
        1 => SensorMode::Stereo,
        2 => SensorMode::Rgbd,
        other => return Err(d.wrong(format!("sensor {other} is unknown"))),
    };
    let [fx, fy, cx, cy, baseline_fx, close_depth] = d.f64s()?;
    let bounds: [f64; 4] = d.f64s()?;
    let body_from_camera = pose(d.f64s()?).ok_or_else(|| d.wrong("the camera's pose is invalid"))?;
    let camera = RectifiedCamera { fx, fy, cx, cy, baseline_fx, bounds, close_depth, body_from_camera };
    let finite = [fx, fy, cx, cy, baseline_fx, close_depth].iter().chain(&bounds).all(|v| v.is_finite());
    let valid = fx > 0.0 && fy > 0.0 && baseline_fx >= 0.0 && bounds[0] < bounds[2] && bounds[1] < bounds[3];
    if !(finite && valid) {
        return Err(d.wrong(format!("the camera is invalid: {camera:?}")));
    }
    Ok((sensor, camera))
}

/// The name of a sensor mode on the command line.
pub fn sensor_name(sensor: SensorMode) -> &'static str {
    match sensor {
        SensorMode::Mono => "mono",
        SensorMode::Stereo => "stereo",
        SensorMode::Rgbd => "rgbd",
    }
}

/// A pose as quaternion (x y z w) and translation, bit-exact.
pub(super) fn numbers(pose: &Se3) -> [f64; 7] {
    let (q, t) = (pose.rotation.quaternion(), pose.translation);
    [q.i, q.j, q.k, q.w, t.x, t.y, t.z]
}

/// The pose from its numbers; `None` where they are invalid. The quaternion is not normalised, so that saving
/// changes nothing.
pub(super) fn pose([i, j, k, w, x, y, z]: [f64; 7]) -> Option<Se3> {
    let q = Quaternion::new(w, i, j, k);
    let pose = Se3::new(So3::from_quaternion(UnitQuaternion::new_unchecked(q)), Vec3::new(x, y, z));
    ((q.norm() - 1.0).abs() < 1e-6 && pose.is_finite()).then_some(pose)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn about() -> About {
        let camera = RectifiedCamera {
            fx: 450.0,
            fy: 451.0,
            cx: 320.0,
            cy: 240.0,
            baseline_fx: 45.0,
            bounds: [0.0, 0.0, 640.0, 480.0],
            close_depth: 4.0,
            body_from_camera: Se3::new(So3::exp(&Vec3::new(0.1, 0.2, 0.3)), Vec3::new(0.4, 0.5, 0.6)),
        };
        About { program: "a test".into(), sensor: SensorMode::Stereo, camera }
    }

    #[test]
    fn round_trip() {
        let mut e = Encoder::default();
        about().encode(&mut e);
        let mut d = Decoder::new("about", &e.0);
        assert_eq!(About::decode(&mut d).unwrap(), about());
        d.end().unwrap();
        e.0[8] = 9;
        assert!(
            About::decode(&mut Decoder::new("about", &e.0)).unwrap_err().to_string().contains("sensor 9")
        );
    }

    #[test]
    fn other_camera_is_refused_and_similar_one_noted() {
        let octaves = Octaves { levels: 8, factor: 1.2 };
        let (a, mut camera) = (about(), about().camera);
        let fits = |camera: &RectifiedCamera| a.fits(octaves, SensorMode::Stereo, camera, octaves);
        assert_eq!(fits(&camera), Ok(vec![]));
        camera.fx += 0.1;
        assert!(fits(&camera).unwrap()[0].contains("0.071 px"), "{:?}", fits(&camera));
        camera.fx += 10.0;
        let message = fits(&camera).unwrap_err().to_string();
        assert!(
            message.contains("fx 450.00") && message.contains("460.10") && message.contains("7.2 px"),
            "{message}"
        );
        camera = about().camera;
        camera.baseline_fx = 54.0;
        assert!(fits(&camera).unwrap_err().to_string().contains("0.1000 m, this run has 0.1200 m"));
        assert!(
            a.fits(octaves, SensorMode::Mono, &a.camera, octaves).unwrap_err().to_string().contains("stereo")
        );
        let fewer = Octaves { levels: 4, factor: 1.2 };
        assert!(
            a.fits(octaves, SensorMode::Stereo, &a.camera, fewer)
                .unwrap_err()
                .to_string()
                .contains("octaves")
        );
    }
}
