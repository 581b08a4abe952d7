//! The factory calibration of a RealSense, as the SDK's program prints it: `rs-enumerate-devices -c > camera.txt`.
//!
//! `Intrinsic of "Color" / 640x480 / {...}` is followed by width, height, `PPX`, `PPY`, `Fx`, `Fy`, the lens and its
//! coefficients `k1 k2 p1 p2 k3`; `Extrinsic from "A" To "B" :` by a rotation row by row and a translation in metres, with
//! `p_B = R p_A + t` (librealsense, `rs2_extrinsics` and `projection-in-rs`: the printed rotation is the matrix itself, and the
//! right infrared camera, 50 mm to the right, has t = -0.05). The text has every size that the camera knows, and no noise of
//! the IMU that could be used: that of a phone's is taken.

use super::document::CalibrationError;
use crate::text::place;
use cairn_geometry::{Mat3, Se3, So3, Vec3};
use cairn_sensor::{
    Camera, DepthSensor, Distortion, ImuNoise, ImuSensor, Rig, RigCamera, SourceError, check_rotation,
};
use std::path::{Path, PathBuf};

/// The size that is taken where none is asked for.
const USUAL_SIZE: [usize; 2] = [640, 480];
/// The depth unit that a D400 has unless its user changed it, metres.
const USUAL_UNIT_M: f64 = 0.001;
/// Noise of a phone's IMU: the chip (BMI055) is one of a phone.
const USUAL_NOISE: ImuNoise = ImuNoise { gyro: 3e-3, gyro_walk: 1e-4, accel: 3e-2, accel_walk: 1e-3 };
/// The rate of a D400's gyroscope, Hz.
const GYRO_HZ: f64 = 200.0;

/// Which of the cameras the rig is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cameras {
    /// Colour, with depth.
    Colour,
    /// The left infrared camera, with depth.
    Infrared,
    /// Both infrared cameras.
    Stereo,
}

/// What of a file is wanted: `FILE`, or `FILE:stereo`, `FILE:infrared`, `FILE:848x480`, `FILE:stereo:848x480`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The file.
    pub path: PathBuf,
    cameras: Cameras,
    size: Option<[usize; 2]>,
}

/// Splits what is written after the name of a file; `None` where nothing of it is understood, or a file has the whole name.
pub fn choice(path: &Path) -> Option<Choice> {
    let mut choice = Choice { path: path.to_owned(), cameras: Cameras::Colour, size: None };
    let mut rest = path.to_str()?;
    while !Path::new(rest).exists() {
        let (before, last) = rest.rsplit_once(':')?;
        match last {
            "stereo" => choice.cameras = Cameras::Stereo,
            "infrared" => choice.cameras = Cameras::Infrared,
            "colour" | "color" => choice.cameras = Cameras::Colour,
            size => {
                let (w, h) = size.split_once('x')?;
                choice.size = Some([w.parse().ok()?, h.parse().ok()?]);
            }
        }
        rest = before;
    }
    choice.path = rest.into();
    Some(choice)
}

/// Whether a text is such a calibration.
pub fn is(text: &str) -> bool {
    text.lines().any(|l| l.trim_start().starts_with("Intrinsic of \"")) && text.contains("PPX")
}

/// The rig of a calibration.
pub fn rig(text: &str, wanted: &Choice, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    let calibration = Calibration::parse(&wanted.path, text)?;
    let size = wanted.size.or(size).unwrap_or(USUAL_SIZE);
    let fail = |why: String| {
        SourceError::new(
            wanted.path.display().to_string(),
            why,
            "write it anew: rs-enumerate-devices -c > FILE",
        )
    };
    let find = |names: &[&str]| calibration.camera(names, size).map_err(|e| fail(e.0));
    const COLOUR: [&str; 1] = ["Color"];
    const LEFT: [&str; 2] = ["Infrared 1", "Infrared_1"];
    const RIGHT: [&str; 2] = ["Infrared 2", "Infrared_2"];
    let (names, first) = match wanted.cameras {
        Cameras::Colour => (&COLOUR[..], "color"),
        _ => (&LEFT[..], "infra1"),
    };
    let (stream, camera) = find(names)?;
    let between = |to: &str, from: &str| {
        let no = || fail(format!("has no line 'Extrinsic from \"{from}\" To \"{to}\"', nor the way back"));
        calibration.between(to, from).ok_or_else(no)
    };
    let mut cameras = vec![RigCamera { name: first.into(), camera, body_from_camera: Se3::identity() }];
    let mut depth = None;
    if wanted.cameras == Cameras::Stereo {
        let (right, camera) = find(&RIGHT)?;
        let body_from_camera = between(&stream, &right)?;
        cameras.push(RigCamera { name: "infra2".into(), camera, body_from_camera });
    } else {
        let (sensor, camera) = find(&["Depth"])?;
        let body_from_depth = between(&stream, &sensor)?;
        // Depth is computed in the frame of the left infrared camera.
        let registered = camera == cameras[0].camera && body_from_depth.log().norm() < 1e-6;
        depth = Some(DepthSensor { camera, body_from_depth, metres_per_unit: USUAL_UNIT_M, registered });
    }
    // The body is the IMU's frame, where there is one.
    let imu = ["Gyro", "Motion"].iter().find_map(|name| calibration.between(name, &stream));
    let mut rig = Rig { cameras, depth, imu: None };
    if let Some(body_from_first) = imu {
        rig.cameras.iter_mut().for_each(|c| c.body_from_camera = body_from_first * c.body_from_camera);
        rig.depth.iter_mut().for_each(|d| d.body_from_depth = body_from_first * d.body_from_depth);
        let (body_from_imu, noise) = (Se3::identity(), USUAL_NOISE);
        rig.imu = Some(ImuSensor { body_from_imu, rate_hz: GYRO_HZ, noise, offset_s: 0.0 });
    }
    Ok(rig)
}

struct Calibration {
    /// Stream and intrinsics, one for each size.
    cameras: Vec<(String, Camera)>,
    /// `to_from`: to, from, transform.
    extrinsics: Vec<(String, String, Se3)>,
}

impl Calibration {
    fn parse(path: &Path, text: &str) -> Result<Self, SourceError> {
        let mut all = Self { cameras: Vec::new(), extrinsics: Vec::new() };
        let lines: Vec<&str> = text.lines().map(|l| l.trim().trim_start_matches('>').trim()).collect();
        for (i, line) in lines.iter().enumerate() {
            let wrong = |why: String| {
                SourceError::new(place(path, i + 1), why, "write it anew: rs-enumerate-devices -c > FILE")
            };
            let quoted: Vec<&str> = line.split('"').skip(1).step_by(2).collect();
            let rest = &lines[i + 1..];
            match quoted.as_slice() {
                [name, ..] if line.starts_with("Intrinsic of") => {
                    all.cameras.push(((*name).to_owned(), camera(rest).map_err(|e| wrong(e.0))?));
                }
                [from, to, ..] if line.starts_with("Extrinsic from") => {
                    let to_from = extrinsics(rest).map_err(|e| wrong(e.0))?;
                    all.extrinsics.push(((*to).to_owned(), (*from).to_owned(), to_from));
                }
                _ => {}
            }
        }
        Ok(all)
    }

    /// The camera of the first stream that is there, in this size.
    fn camera(&self, names: &[&str], size: [usize; 2]) -> Result<(String, Camera), CalibrationError> {
        let of = |c: &&(String, Camera)| names.contains(&c.0.as_str());
        let found = self.cameras.iter().filter(of).find(|(_, c)| [c.width, c.height] == size);
        found.cloned().ok_or_else(|| {
            let sizes: Vec<String> =
                self.cameras.iter().filter(of).map(|(_, c)| format!("{}x{}", c.width, c.height)).collect();
            let [w, h] = size;
            CalibrationError(match sizes.is_empty() {
                true => format!("has no intrinsics of {}", names[0]),
                false => format!(
                    "has {} in {}, not in {w}x{h}; append the size, FILE:848x480",
                    names[0],
                    sizes.join(", ")
                ),
            })
        })
    }

    /// `a_from_b`.
    fn between(&self, a: &str, b: &str) -> Option<Se3> {
        if a == b {
            return Some(Se3::identity());
        }
        let find = |to: &str, from: &str| {
            self.extrinsics.iter().find(|(t, f, _)| t == to && f == from).map(|(_, _, to_from)| *to_from)
        };
        find(a, b).or_else(|| find(b, a).map(|b_from_a| b_from_a.inverse()))
    }
}

/// The lines after "Intrinsic of".
fn camera(lines: &[&str]) -> Result<Camera, CalibrationError> {
    let value = |key: &str| {
        let line = lines.iter().take(9).find_map(|l| l.strip_prefix(key)?.trim_start().strip_prefix(':'));
        line.map(str::trim).ok_or_else(|| CalibrationError(format!("is not followed by {key}")))
    };
    let number = |key: &str| {
        let text = value(key)?;
        text.parse::<f64>()
            .ok()
            .filter(|v| v.is_finite())
            .ok_or_else(|| CalibrationError(format!("{key} is \"{text}\", no number")))
    };
    let side = |key: &str| {
        let number = value(key)?.parse::<usize>();
        number.map_err(|_| CalibrationError(format!("{key} is no number of pixels")))
    };
    let coefficients: Vec<f64> = value("Coeffs")?.split_whitespace().filter_map(|c| c.parse().ok()).collect();
    let c: [f64; 5] =
        coefficients.try_into().map_err(|_| CalibrationError("Coeffs are not five numbers".into()))?;
    let distortion = match value("Distortion")? {
        _ if c == [0.0; 5] => Distortion::None,
        "None" => Distortion::None,
        // The SDK's "modified" and "inverse" model maps the distorted point to the undistorted one.
        "Inverse Brown Conrady" => Distortion::InverseRadialTangential(c),
        "Brown Conrady" => Distortion::RadialTangential(c),
        "Kannala Brandt4" => Distortion::Equidistant([c[0], c[1], c[2], c[3]]),
        other => return Err(CalibrationError(format!("the lens \"{other}\" is not known"))),
    };
    let plain = Camera::pinhole(
        side("Width")?,
        side("Height")?,
        number("Fx")?,
        number("Fy")?,
        number("PPX")?,
        number("PPY")?,
    );
    let camera = Camera { distortion, ..plain };
    camera.validate()?;
    Ok(camera)
}

/// The lines after "Extrinsic from".
fn extrinsics(lines: &[&str]) -> Result<Se3, CalibrationError> {
    let numbers = |line: &str| -> Vec<f64> {
        line.split_whitespace().filter_map(|v| v.parse().ok()).filter(|v: &f64| v.is_finite()).collect()
    };
    let at = lines.iter().take(3).position(|l| l.starts_with("Rotation Matrix"));
    let rows = at.map(|at| &lines[at + 1..]).unwrap_or_default();
    let r: Vec<f64> = rows.iter().take(3).flat_map(|l| numbers(l)).collect();
    if r.len() != 9 {
        return Err(CalibrationError("is not followed by a rotation of three rows".into()));
    }
    let t = rows
        .iter()
        .take(6)
        .find_map(|l| l.strip_prefix("Translation Vector:"))
        .map(numbers)
        .unwrap_or_default();
    let [x, y, z] = t
        .try_into()
        .map_err(|_| CalibrationError("is not followed by a translation of three numbers".into()))?;
    let r = Mat3::from_row_slice(&r);
    check_rotation("its rotation", &r)?;
    // Newer devices state the place of their IMU in millimetres.
    let t = Vec3::new(x, y, z);
    let t = if t.norm() > 1.0 { t * 1e-3 } else { t };
    Ok(Se3::new(So3::from_matrix(&r), t))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
Device info:
    Name                          :     Intel RealSense D435I

 Intrinsic of "Depth" / 640x480 / {Z16}
  Width:        640
  Height:       480
  PPX:          319.5
  PPY:          236.25
  Fx:           384.25
  Fy:           384.25
  Distortion:   Brown Conrady
  Coeffs:       0       0       0       0       0
  FOV (deg):    79.58 x 63.98

 Intrinsic of "Color" / 1280x720 / {YUYV/RGB8/BGR8/RGBA8/BGRA8/Y16}
  Width:      	1280
  Height:     	720
  PPX:        	631.5
  PPY:        	356.75
  Fx:         	918.5
  Fy:         	916
  Distortion: 	Inverse Brown Conrady
  Coeffs:     	0.01  	-0.02  	0.001  	0.002  	0.003
  FOV (deg):  	69.7 x 42.9

 Intrinsic of "Color" / 640x480 / {YUYV/RGB8/BGR8/RGBA8/BGRA8/Y16}
  Width:      	640
  Height:     	480
  PPX:        	314.25
  PPY:        	237.75
  Fx:         	612.5
  Fy:         	610.5
  Distortion: 	Inverse Brown Conrady
  Coeffs:     	0  	0  	0  	0  	0
  FOV (deg):  	55.2 x 42.9

 Intrinsic of "Infrared 1" / 640x480 / {Y8}
  Width:      	640
  Height:     	480
  PPX:        	319.5
  PPY:        	236.25
  Fx:         	384.25
  Fy:         	384.25
  Distortion: 	Brown Conrady
  Coeffs:     	0  	0  	0  	0  	0

 Intrinsic of "Infrared 2" / 640x480 / {Y8}
  Width:      	640
  Height:     	480
  PPX:        	319.5
  PPY:        	236.25
  Fx:         	384.25
  Fy:         	384.25
  Distortion: 	Brown Conrady
  Coeffs:     	0  	0  	0  	0  	0

Extrinsic from "Depth"	  To	  "Color" :
 Rotation Matrix:
   0.8            -0.6             0
   0.6             0.8             0
   0               0               1

 Translation Vector: 0.015  -0.001  0.0002

Extrinsic from "Infrared 1"	  To	  "Infrared 2" :
 Rotation Matrix:
   1  0  0
   0  1  0
   0  0  1

 Translation Vector: -0.05  0  0

Extrinsic from "Depth"	  To	  "Infrared 1" :
 Rotation Matrix:
   1  0  0
   0  1  0
   0  0  1

 Translation Vector: 0  0  0

Extrinsic from "Color"	  To	  "Gyro" :
 Rotation Matrix:
   1  0  0
   0  1  0
   0  0  1

 Translation Vector: -0.02  0.005  0.012

Extrinsic from "Infrared 1"	  To	  "Gyro" :
 Rotation Matrix:
   1  0  0
   0  1  0
   0  0  1

 Translation Vector: -0.00552  0.0051  0.01174
"#;

    fn of(cameras: Cameras, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
        let rig = rig(TEXT, &Choice { path: "d435i.txt".into(), cameras, size }, None)?;
        rig.validate().unwrap();
        Ok(rig)
    }

    #[test]
    fn colour_comes_with_depth_beside_it() {
        assert!(is(TEXT) && !is("P0: 1 2 3"));
        let rig = of(Cameras::Colour, None).unwrap();
        let (c, d) = (&rig.cameras[0], rig.depth.as_ref().unwrap());
        assert_eq!((c.name.as_str(), c.camera.fx, c.camera.distortion), ("color", 612.5, Distortion::None));
        assert!(!d.registered && d.metres_per_unit == 0.001);
        // p_color = R p_depth + t, the rotation row by row.
        let color_from_depth = c.body_from_camera.inverse() * d.body_from_depth;
        let p = color_from_depth * Vec3::new(1.0, 0.0, 2.0);
        assert!((p - Vec3::new(0.815, 0.599, 2.0002)).norm() < 1e-9, "{p}");
        // The body is the IMU.
        assert!((c.body_from_camera.translation - Vec3::new(-0.02, 0.005, 0.012)).norm() < 1e-12);
        assert_eq!(rig.imu.unwrap().rate_hz, 200.0);
    }

    #[test]
    fn infrared_has_depth_of_its_own_or_a_partner_to_the_right() {
        let rig = of(Cameras::Infrared, None).unwrap();
        assert!(rig.depth.unwrap().registered && rig.cameras[0].name == "infra1");
        let rig = of(Cameras::Stereo, None).unwrap();
        let left_from_right = rig.cameras[0].body_from_camera.inverse() * rig.cameras[1].body_from_camera;
        assert!((left_from_right.translation - Vec3::new(0.05, 0.0, 0.0)).norm() < 1e-12);
        assert!(rig.depth.is_none() && rig.imu.is_some());
    }

    #[test]
    fn what_is_missing_or_broken_is_told_with_its_line() {
        let error = of(Cameras::Colour, Some([848, 480])).unwrap_err().to_string();
        assert!(error.contains("has Color in 1280x720, 640x480, not in 848x480"), "{error}");
        let error = of(Cameras::Colour, Some([1280, 720])).unwrap_err().to_string();
        assert!(error.contains("has Depth in 640x480"), "{error}");
        let broken = |from: &str, to: &str| {
            let choice = Choice { path: "d435i.txt".into(), cameras: Cameras::Colour, size: None };
            rig(&TEXT.replacen(from, to, 1), &choice, None).unwrap_err().to_string()
        };
        assert!(broken("Fx:           384.25", "Fx:  wide").contains("line 5: Fx is \"wide\""));
        assert!(broken("   0.8            -0.6             0\n", "").contains("rotation"));
        assert!(broken("0.8            -0.6", "9            -0.6").contains("not a rotation"));
        assert!(broken("Translation Vector: 0.015", "Translation Vector: nan").contains("translation"));
        assert!(
            broken("\"Depth\"\t  To\t  \"Color\"", "\"Depth\"\t  To\t  \"Fisheye\"")
                .contains("Extrinsic from")
        );
        assert!(
            broken("Distortion: \tInverse Brown Conrady", "Distortion: \tFTheta")
                .contains("\"FTheta\" is not known")
        );
    }

    #[test]
    fn the_choice_is_written_after_the_name() {
        let path = std::env::temp_dir().join(format!("cairn-rs-{}.txt", std::process::id()));
        std::fs::write(&path, TEXT).unwrap();
        let name = path.to_str().unwrap();
        let of = |end: &str| crate::read_rig(format!("{name}{end}"));
        assert_eq!(of("").unwrap().cameras[0].name, "color");
        assert_eq!(of(":stereo").unwrap().cameras.len(), 2);
        assert_eq!(of(":infrared:640x480").unwrap().cameras[0].name, "infra1");
        assert!(of(":stereo:848x480").unwrap_err().to_string().contains("not in 848x480"));
        assert!(of(":sideways").is_err());
        std::fs::remove_file(&path).unwrap();
        assert!(of("").is_err());
    }
}
