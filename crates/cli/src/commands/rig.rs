//! `cairn rig`: shows and checks a calibration file, and converts it to Cairn's own TOML.

use crate::failure::Failure;
use crate::output::{Output, note};
use crate::outputs::Outputs;
use cairn_geometry::Vec2;
use cairn_inertial::Readings;
use cairn_sensor::{Camera, Rig};
use cairn_sources::ImuWatch;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Checks and converts calibration files (cameras, lenses, extrinsics, IMU).
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Check(Check),
}

/// Reads a calibration, rejects impossible values, warns about unlikely ones, and prints a summary.
///
/// Reads Cairn's own TOML, EuRoC sensor.yaml, Kalibr camera chains, ORB-SLAM settings, stella_vslam configurations, ROS
/// camera_info and ost.txt, OpenCV, KITTI calib.txt, the factory's of RealSense, ZED and OAK, calibrations of VINS-Fusion, OKVIS2, SVO, maplab, Basalt,
/// Kimera, OpenVINS, OV2SLAM, XRSLAM, NICE-SLAM, MonoGS, SplaTAM, R-VIO, LARVIO, AirSLAM, R3LIVE, DSO, DROID-SLAM, COLMAP and nerfstudio,
/// or a folder that contains one of them. One that does not state the size of the images gets it from --with.
#[derive(clap::Args)]
struct Check {
    /// The calibration file.
    file: PathBuf,
    /// A recording made with this rig: its image sizes and IMU data are checked too.
    #[arg(long, value_name = "SOURCE")]
    with: Option<String>,
    /// How many seconds of that recording to check.
    #[arg(long, default_value_t = 30.0, value_name = "SECONDS")]
    seconds: f64,
    /// Writes the rig as Cairn's own TOML.
    #[arg(long, value_name = "OUT.toml")]
    write: Option<PathBuf>,
    /// Replace that file if it exists.
    #[arg(long, requires = "write")]
    overwrite: bool,
}

#[derive(Serialize)]
struct Report {
    cameras: Vec<CameraReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    stereo: Option<StereoReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    depth: Option<DepthReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    imu: Option<ImuReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    readings: Option<ReadingsReport>,
    /// Possible but unlikely values.
    warnings: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    written: Option<PathBuf>,
}

#[derive(Serialize)]
struct ReadingsReport {
    seconds: f64,
    images: usize,
    samples: usize,
    rate_hz: f64,
    missing_percent: f64,
    longest_step_s: f64,
    rest_s: f64,
    /// Mean norm of the accelerometer at rest, m/s^2; `None` if it is never at rest.
    rest_norm: Option<f64>,
    median_norm: f64,
    fastest_rad_s: f64,
    /// Mean time from an image to the last IMU sample delivered with it, seconds; positive if the sample is later.
    sample_after_image_s: Option<f64>,
    /// Images without an IMU sample at or after them.
    images_without: usize,
}

#[derive(Serialize)]
struct CameraReport {
    name: String,
    resolution: [usize; 2],
    focal_px: [f64; 2],
    centre_px: [f64; 2],
    distortion: &'static str,
    coefficients: Vec<f64>,
    /// Angles between the rays of opposite sides of the image, through its centre; `None` where a pixel has no ray.
    field_of_view_deg: [Option<f64>; 2],
    /// Share of the pixels of a 33 x 33 grid that have a ray.
    rays: f64,
    /// Largest distance between a pixel of that grid and the projection of its ray.
    round_trip_px: f64,
    position_m: [f64; 3],
}

#[derive(Serialize)]
struct StereoReport {
    baseline_m: f64,
    /// Angle between the optical axes.
    axes_deg: f64,
}

#[derive(Serialize)]
struct DepthReport {
    resolution: [usize; 2],
    metres_per_unit: f64,
    registered: bool,
}

#[derive(Serialize)]
struct ImuReport {
    rate_hz: f64,
    gyro_noise: f64,
    gyro_walk: f64,
    accel_noise: f64,
    accel_walk: f64,
    offset_s: f64,
}

/// Whether the command line asks for the names of built-in rigs: `--rig list`.
pub fn list_is_asked_for() -> bool {
    let all: Vec<String> = std::env::args().take_while(|a| a != "--").collect();
    let asked =
        all.iter().any(|a| a == "--rig=list") || all.windows(2).any(|w| w[0] == "--rig" && w[1] == "list");
    asked && !Path::new("list").exists()
}

/// Prints the names of built-in rigs, and how to give another.
pub fn list() -> std::process::ExitCode {
    let rigs = cairn_sources::NAMED_RIGS;
    let json = std::env::args().any(|a| a == "--json");
    let entry = |(name, what): &(&str, &str)| serde_json::json!({ "name": name, "what": what });
    let shown = serde_json::json!({ "rigs": rigs.iter().map(entry).collect::<Vec<_>>() });
    let done = Output::new(json).result(&shown, |_| {
        let lines: Vec<String> = rigs.iter().map(|(name, what)| format!("{name}  {what}")).collect();
        format!("{}\nAny other rig is a file: {FORMS}.", lines.join("\n"))
    });
    match done {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(failure) => Output::new(json).fail(&failure),
    }
}

/// The calibrations that are read.
const FORMS: &str = "Cairn's own TOML, EuRoC sensor.yaml, Kalibr camera chains, ORB-SLAM settings, stella_vslam configurations, ROS camera_info and ost.txt, OpenCV, KITTI calib.txt, the factory's of RealSense, ZED and OAK, and calibrations of VINS-Fusion, OKVIS2, SVO, maplab, Basalt, Kimera, OpenVINS, OV2SLAM, XRSLAM, NICE-SLAM, MonoGS, SplaTAM, R-VIO, LARVIO, AirSLAM, R3LIVE, DSO, DROID-SLAM, COLMAP and nerfstudio";

/// Runs the subcommand.
///
/// # Errors
/// When the calibration or the recording cannot be read or is invalid, or the output cannot be written.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    let Command::Check(check) = &arguments.command;
    let outputs = Outputs::new(check.overwrite)
        .input("the calibration", Some(&check.file))
        .input("--with", check.with.as_deref().map(Path::new))
        .output("--write", check.write.as_deref())
        .checked()?;
    let rig = rig_for(&check.file, check.with.as_deref().unwrap_or_default())?;
    let mut warnings = rig.doubts();
    warnings.extend(cairn_sources::assumed_in(&check.file));
    let readings = match &check.with {
        Some(source) => Some(readings(source, &rig, check.seconds, &mut warnings)?),
        None => None,
    };
    outputs.write("--write", || Ok(cairn_sources::write_rig(&rig)?.into_bytes()))?;
    output.result(&Report { readings, warnings, written: check.write.clone(), ..report(&rig) }, text)
}

/// As [`rig_for`], for a run: what is taken where the calibration does not state it is noted, once.
///
/// # Errors
/// As [`rig_for`].
pub fn noted_rig_for(path: &Path, source: &str) -> Result<Rig, Failure> {
    static NOTED: std::sync::Once = std::sync::Once::new();
    let rig = rig_for(path, source)?;
    if let Some(assumed) = cairn_sources::assumed_in(path) {
        let cure = "cairn rig check --write makes a file that states it";
        NOTED.call_once(|| note(&format!("note: {} {assumed}; {cure}", path.display())));
    }
    Ok(rig)
}

/// Reads a calibration; one that does not state the size of its images gets that of the source.
///
/// # Errors
/// When it cannot be read or is invalid, or states no size and the source has none that can be read.
pub fn rig_for(path: &Path, source: &str) -> Result<Rig, Failure> {
    let error = match cairn_sources::read_rig(path) {
        Ok(rig) => return Ok(rig),
        Err(error) => error,
    };
    let size = if path.is_file() { cairn_sources::image_size(source) } else { None };
    let with_size = size.and_then(|size| cairn_sources::read_rig_for(path, Some(size)).ok());
    with_size.ok_or_else(|| error.into())
}

/// Reads a recording with the rig; a wrong resolution is rejected when it is opened.
fn readings(
    source: &str,
    rig: &Rig,
    seconds: f64,
    warnings: &mut Vec<String>,
) -> Result<ReadingsReport, Failure> {
    let given = if source.starts_with("sim:") { None } else { Some(rig.clone()) };
    let options =
        cairn_sources::OpenOptions { rig: given, cancel: crate::interrupt::cancel(), ..Default::default() };
    let mut source = cairn_sources::open(source, options)?;
    let mut watch = ImuWatch::default();
    while let Some(packet) = source.next_packet()? {
        if watch.packet(&packet) > seconds {
            break;
        }
    }
    let sensor = source.rig().imu.as_ref().or(rig.imu.as_ref());
    let found = sensor.map_or_else(Readings::default, |sensor| watch.readings(sensor));
    warnings.extend(sensor.map_or_else(Vec::new, |sensor| watch.doubts(sensor)));
    Ok(ReadingsReport {
        seconds: found.seconds,
        images: watch.images(),
        samples: found.samples,
        rate_hz: found.rate_hz,
        missing_percent: found.missing_percent,
        longest_step_s: found.longest_s,
        rest_s: found.rest_s,
        rest_norm: found.rest_norm,
        median_norm: found.norm,
        fastest_rad_s: found.fastest,
        sample_after_image_s: watch.mean_after_s(),
        images_without: watch.without(),
    })
}

fn report(rig: &Rig) -> Report {
    let stereo = match rig.cameras.as_slice() {
        [a, b, ..] => {
            let a_from_b = a.body_from_camera.inverse() * b.body_from_camera;
            let axis = a_from_b.rotation * cairn_geometry::Vec3::z();
            let axes_deg = axis.z.clamp(-1.0, 1.0).acos().to_degrees();
            Some(StereoReport { baseline_m: a_from_b.translation.norm(), axes_deg })
        }
        _ => None,
    };
    Report {
        cameras: rig
            .cameras
            .iter()
            .map(|c| camera(&c.name, &c.camera, c.body_from_camera.translation.into()))
            .collect(),
        stereo,
        depth: rig.depth.as_ref().map(|d| DepthReport {
            resolution: [d.camera.width, d.camera.height],
            metres_per_unit: d.metres_per_unit,
            registered: d.registered,
        }),
        imu: rig.imu.as_ref().map(|i| ImuReport {
            rate_hz: i.rate_hz,
            gyro_noise: i.noise.gyro,
            gyro_walk: i.noise.gyro_walk,
            accel_noise: i.noise.accel,
            accel_walk: i.noise.accel_walk,
            offset_s: i.offset_s,
        }),
        readings: None,
        warnings: Vec::new(),
        written: None,
    }
}

fn camera(name: &str, c: &Camera, position_m: [f64; 3]) -> CameraReport {
    let (right, bottom) = ((c.width - 1) as f64, (c.height - 1) as f64);
    let angle = |a: Vec2, b: Vec2| Some(c.unproject(&a)?.angle(&c.unproject(&b)?).to_degrees());
    let grid =
        (0..33 * 33).map(|i| Vec2::new(right * (i % 33) as f64 / 32.0, bottom * (i / 33) as f64 / 32.0));
    let (mut rays, mut round_trip_px) = (0, 0.0f64);
    for px in grid {
        let Some(ray) = c.unproject(&px) else { continue };
        rays += 1;
        round_trip_px = round_trip_px.max(c.project(&ray).map_or(f64::INFINITY, |back| (back - px).norm()));
    }
    CameraReport {
        name: name.to_owned(),
        resolution: [c.width, c.height],
        focal_px: [c.fx, c.fy],
        centre_px: [c.cx, c.cy],
        distortion: c.distortion.name(),
        coefficients: c.distortion.coefficients(),
        field_of_view_deg: [
            angle(Vec2::new(0.0, bottom / 2.0), Vec2::new(right, bottom / 2.0)),
            angle(Vec2::new(right / 2.0, 0.0), Vec2::new(right / 2.0, bottom)),
        ],
        rays: rays as f64 / (33.0 * 33.0),
        round_trip_px,
        position_m,
    }
}

/// The camera model in words: most lenses are distortion of a pinhole, others project onto a sphere.
fn model(distortion: &str) -> String {
    match distortion {
        "none" => "pinhole without distortion".into(),
        "equidistant" => "equidistant fisheye (Kannala-Brandt)".into(),
        "unified" => "unified (Mei), with radial-tangential distortion".into(),
        "extended-unified" | "double-sphere" => format!("{distortion} fisheye"),
        lens => format!("pinhole with {lens} distortion"),
    }
}

fn text(r: &Report) -> String {
    let mut lines = Vec::new();
    for c in &r.cameras {
        let [w, h] = c.resolution;
        let [across, down] = c.field_of_view_deg.map(|a| a.map_or("no ray".into(), |a| format!("{a:.1}")));
        // Adding zero turns a negative zero into a positive one.
        let [x, y, z] = c.position_m.map(|v| v + 0.0);
        lines.push(format!("{}  {w}x{h}, field of view {across} x {down} deg", c.name));
        lines.push(format!(
            "  focal {:.3} {:.3} px, centre {:.3} {:.3} px",
            c.focal_px[0], c.focal_px[1], c.centre_px[0], c.centre_px[1]
        ));
        lines.push(format!("  model {} {:?}", model(c.distortion), c.coefficients));
        lines.push(format!("  at {x:.4} {y:.4} {z:.4} m in the body frame"));
        lines.push(format!(
            "  rays for {:.1} % of the image, unproject-project error at most {:.1e} px",
            100.0 * c.rays,
            c.round_trip_px
        ));
    }
    if let Some(s) = &r.stereo {
        lines.push(format!("stereo  baseline {:.4} m, axes {:.3} deg apart", s.baseline_m, s.axes_deg));
    }
    if let Some(d) = &r.depth {
        let registered =
            if d.registered { "registered to the first camera" } else { "with its own projection" };
        lines.push(format!(
            "depth  {}x{}, {} m per unit, {registered}",
            d.resolution[0], d.resolution[1], d.metres_per_unit
        ));
    }
    if let Some(i) = &r.imu {
        lines.push(format!(
            "imu  {} Hz, {:+.6} s offset to the image clock (t_imu + offset = t_image)",
            i.rate_hz,
            i.offset_s + 0.0
        ));
        lines.push(format!("  gyro {:e} rad/s/sqrt(Hz), random walk {:e}", i.gyro_noise, i.gyro_walk));
        lines.push(format!("  accel {:e} m/s^2/sqrt(Hz), random walk {:e}", i.accel_noise, i.accel_walk));
    }
    if let Some(f) = &r.readings {
        lines
            .push(format!("recording  {} images; {} IMU samples in {:.1} s", f.images, f.samples, f.seconds));
        if f.samples > 0 {
            lines.push(format!(
                "  {:.1} Hz, {:.2} % missing, longest gap {:.3} s",
                f.rate_hz, f.missing_percent, f.longest_step_s
            ));
            let rest = f.rest_norm.map_or("never at rest".into(), |n| {
                format!("at rest for {:.1} s with {n:.3} m/s^2", f.rest_s)
            });
            lines.push(format!(
                "  {rest}; median {:.3} m/s^2; turns at most {:.2} rad/s",
                f.median_norm, f.fastest_rad_s
            ));
        }
    }
    lines.extend(r.warnings.iter().map(|w| format!("warning: {w}")));
    if let Some(path) = &r.written {
        lines.push(format!("written to {}", path.display()));
    }
    lines.join("\n")
}
