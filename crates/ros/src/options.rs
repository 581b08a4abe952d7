//! What the node is asked to do: its flags, and the words that ROS puts behind `--ros-args`.

use crate::arguments::{self, wrong};
use crate::faults::Log;
use crate::parameters::{self, Parameters};
use cairn::SensorMode;
use cairn::geometry::{Se3, So3, Vec3};
use clap::{CommandFactory, FromArgMatches, Parser, ValueEnum};
use std::path::PathBuf;

/// Topics of a usual driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Camera {
    /// The infrared pair of realsense2_camera.
    RealsenseStereo,
    /// Colour and aligned depth of realsense2_camera.
    RealsenseRgbd,
    /// left/image_raw and right/image_raw below the camera's namespace, as of most stereo drivers.
    Stereo,
    /// image_raw below the camera's namespace, as of usb_cam and v4l2_camera.
    Mono,
}

/// How service calls carry the identity of the caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Rmw {
    /// rmw_fastrtps_cpp, the usual one.
    Fastrtps,
    /// rmw_cyclonedds_cpp.
    Cyclonedds,
}

/// Cairn as a node of ROS 2: pictures in; odometry, tf, path and map out. No installation of ROS is needed.
///
/// Topics are named as in ROS: `/a/b` is absolute, `a/b` is in the node's namespace, `~/a` in the node's own.
/// Calibrations are taken from camera_info beside each picture topic, positions of the sensors from /tf_static;
/// --rig FILE replaces both. Each flag is a parameter too: `--ros-args -p image:=/a` or --params-file.
#[derive(Clone, Debug, Parser)]
#[command(name = "cairn-ros", version, max_term_width = 100, args_override_self = true)]
pub struct Options {
    /// Topics of a usual driver; --camera-namespace says where.
    #[arg(long, value_enum)]
    pub camera: Option<Camera>,
    /// Namespace of the camera's topics [default: /camera/camera for RealSense, /camera otherwise].
    #[arg(long, value_name = "NAMESPACE")]
    pub camera_namespace: Option<String>,
    /// Pictures of the first (left) camera; a name that ends in /compressed is of type CompressedImage.
    #[arg(long, value_name = "TOPIC")]
    pub image: Option<String>,
    /// Pictures of the right camera.
    #[arg(long, value_name = "TOPIC")]
    pub right: Option<String>,
    /// Depth images.
    #[arg(long, value_name = "TOPIC", conflicts_with = "right")]
    pub depth: Option<String>,
    /// Readings of an IMU.
    #[arg(long, value_name = "TOPIC")]
    pub imu: Option<String>,
    /// Odometry of the wheels (nav_msgs/Odometry of --base-frame): carries the pose where the camera sees too little. With stereo and
    /// depth cameras only.
    #[arg(long, value_name = "TOPIC")]
    pub wheels: Option<String>,
    /// Calibration of the first camera [default: camera_info beside its pictures].
    #[arg(long, value_name = "TOPIC")]
    pub image_info: Option<String>,
    /// Calibration of the right camera.
    #[arg(long, value_name = "TOPIC")]
    pub right_info: Option<String>,
    /// Calibration of the depth camera.
    #[arg(long, value_name = "TOPIC")]
    pub depth_info: Option<String>,
    /// Calibration file instead of camera_info and tf_static, in any form that `cairn run --rig` reads.
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Configuration entries that differ from the defaults; see `cairn config`.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Leaves the IMU of a rig unused.
    #[arg(long)]
    pub no_imu: bool,
    /// Pictures of one instant differ by this much at most, in milliseconds [default: 10, and 20 with depth images].
    #[arg(long, value_name = "MS")]
    pub pair_within_ms: Option<f64>,

    /// Map file: read at the start where it exists; written by ~/save_map.
    #[arg(long, value_name = "FILE")]
    pub map: Option<PathBuf>,
    /// Localises in the map, which stays unchanged.
    #[arg(long, requires = "map")]
    pub localize_only: bool,
    /// Route file: written by ~/record, followed by ~/guide_home.
    #[arg(long, value_name = "FILE", default_value = "cairn.route")]
    pub route: PathBuf,

    /// Frame of the map.
    #[arg(long, value_name = "FRAME", default_value = "map")]
    pub map_frame: String,
    /// Frame of the odometry.
    #[arg(long, value_name = "FRAME", default_value = "odom")]
    pub odom_frame: String,
    /// Frame of the robot.
    #[arg(long, value_name = "FRAME", default_value = "base_link")]
    pub base_frame: String,
    /// Where the first camera (its optical frame: z ahead, x right) is on the robot, where /tf_static does not say it.
    #[arg(long, value_name = "X Y Z QX QY QZ QW", num_args = 7, allow_negative_numbers = true)]
    pub base_from_camera: Option<Vec<f64>>,
    /// Publishes nothing on /tf.
    #[arg(long)]
    pub no_tf: bool,
    /// Publishes map -> odom on /tf, but not odom -> base_link: another node does.
    #[arg(long, conflicts_with = "no_tf")]
    pub no_odom_tf: bool,
    /// The robot moves on a plane: odometry, tf, pose and path have no height, roll and pitch; a floor that is not flat is reported.
    #[arg(long)]
    pub planar: bool,
    /// Longest range of the occupancy grid, in metres (only with depth images).
    #[arg(long, value_name = "M", default_value_t = 5.0)]
    pub grid_range_m: f64,
    /// Answers goals on ~/goal_pose with paths on ~/plan, for a robot without Nav2 (only with depth images).
    #[arg(long)]
    pub plan: bool,
    /// Radius of the robot, in metres: plans keep this far from what is in the grid.
    #[arg(long, value_name = "M", default_value_t = 0.25)]
    pub robot_radius_m: f64,

    /// Name of the node.
    #[arg(long, default_value = "cairn")]
    pub name: String,
    /// Namespace of the node.
    #[arg(long, default_value = "/")]
    pub namespace: String,
    /// Replaces the name of a topic or service; may be given again. Also __node:=NAME and __ns:=NAMESPACE.
    #[arg(short = 'r', long = "remap", value_name = "FROM:=TO")]
    pub remaps: Vec<String>,
    /// Domain [default: $ROS_DOMAIN_ID, else 0].
    #[arg(long, value_name = "NUMBER")]
    pub domain: Option<u16>,
    /// Time is that of /clock, or without it that of the messages' stamps: for bags that are played and for simulators.
    #[arg(long)]
    pub use_sim_time: bool,
    /// Asks for pictures to be sent again where they were lost: for drivers whose topics are reliable, over networks that
    /// lose packets.
    #[arg(long)]
    pub reliable: bool,
    /// Form of service calls [default: that of $RMW_IMPLEMENTATION, else fastrtps].
    #[arg(long, value_enum)]
    pub rmw: Option<Rmw>,
    /// Ends after this many seconds.
    #[arg(long, value_name = "S", hide = true)]
    pub for_s: Option<f64>,
    /// Which lines are said.
    #[arg(skip)]
    pub log: Log,
    /// What is not as the command line asks for.
    #[arg(skip)]
    pub notes: Vec<String>,
    /// The flags with their values.
    #[arg(skip)]
    pub parameters: Parameters,
}

/// No topic of pictures was named.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("which pictures? Give --image TOPIC, or --camera KIND for the topics of a usual driver")]
pub struct NoPictures;

/// The topics that are read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Topics {
    /// Pictures of the first camera, and its calibration.
    pub image: String,
    /// See [`Topics::image`].
    pub image_info: String,
    /// The right camera.
    pub right: Option<(String, String)>,
    /// The depth camera.
    pub depth: Option<(String, String)>,
    /// The IMU.
    pub imu: Option<String>,
}

impl Options {
    /// Reads arguments, the first of which is the program's name, with what ROS launch files put behind `--ros-args`.
    ///
    /// # Errors
    /// Clap's error, which prints itself: wrong usage, or a request for help.
    pub fn parse_arguments(arguments: impl IntoIterator<Item = String>) -> Result<Self, clap::Error> {
        let mut arguments = arguments.into_iter();
        let program = arguments.next().unwrap_or_default();
        let mut command = Self::command();
        let given = arguments::read(arguments, &command)?;
        let matches = command.try_get_matches_from_mut([vec![program], given.flags].concat())?;
        let mut options = Self::from_arg_matches(&matches)?;
        (options.log, options.notes) = (given.log, given.notes);
        options.parameters = Parameters::new(parameters::declared(&command, &matches));
        options.take_names()?;
        Ok(options)
    }

    /// Moves `__node` and `__ns` out of the remaps, and checks the others.
    fn take_names(&mut self) -> Result<(), clap::Error> {
        let mut rest = Vec::new();
        for remap in std::mem::take(&mut self.remaps) {
            match remap.split_once(":=") {
                Some(("__node" | "__name", name)) => self.name = name.to_owned(),
                Some(("__ns", namespace)) => self.namespace = namespace.to_owned(),
                Some((from, to)) if !from.is_empty() && !to.is_empty() => rest.push(remap),
                _ => return Err(wrong(format!("\"{remap}\" is not of the form FROM:=TO"))),
            }
        }
        self.remaps = rest;
        if let Some(numbers) = &self.base_from_camera
            && pose_of(numbers).is_none()
        {
            let why = "--base-from-camera wants x y z in metres and a unit quaternion qx qy qz qw";
            return Err(wrong(why.into()));
        }
        if self.pair_within_ms.is_some_and(|ms| !(ms.is_finite() && ms >= 0.0)) {
            return Err(wrong("--pair-within-ms wants a time in milliseconds".into()));
        }
        if !(self.grid_range_m.is_finite() && self.grid_range_m > 0.1) {
            return Err(wrong("--grid-range-m wants a range in metres".into()));
        }
        if !(self.robot_radius_m > 0.0 && self.robot_radius_m < 5.0) {
            return Err(wrong("--robot-radius-m wants a radius below 5 metres".into()));
        }
        Ok(())
    }

    /// The map file as it is set now.
    pub fn map_file(&self) -> Option<PathBuf> {
        self.parameters.file("map")
    }

    /// The route file as it is set now.
    pub fn route_file(&self) -> PathBuf {
        self.parameters.file("route").unwrap_or_else(|| self.route.clone())
    }

    /// The topics that are read.
    ///
    /// # Errors
    /// What is missing, with the flag that gives it.
    pub fn topics(&self) -> Result<Topics, NoPictures> {
        let (image, right, depth, imu) = self.usual();
        let image = self.image.clone().or(image);
        let image = image.ok_or(NoPictures)?;
        let beside = |topic: &String, given: &Option<String>| {
            given.clone().unwrap_or_else(|| format!("{}/camera_info", folder(topic)))
        };
        let with_info =
            |topic: Option<String>, given: &Option<String>| topic.map(|t| (t.clone(), beside(&t, given)));
        // A flag that names a second camera stands against the driver's.
        let right = self.right.clone().or(right.filter(|_| self.depth.is_none()));
        let depth = self.depth.clone().or(depth.filter(|_| self.right.is_none()));
        Ok(Topics {
            image_info: beside(&image, &self.image_info),
            image,
            right: with_info(right, &self.right_info),
            depth: with_info(depth, &self.depth_info),
            imu: self.imu.clone().or(imu).filter(|_| !self.no_imu),
        })
    }

    /// Topics of the driver that was named: image, right, depth, IMU.
    fn usual(&self) -> (Option<String>, Option<String>, Option<String>, Option<String>) {
        let realsense = matches!(self.camera, Some(Camera::RealsenseStereo | Camera::RealsenseRgbd));
        let default = if realsense { "/camera/camera" } else { "/camera" };
        let namespace = self.camera_namespace.as_deref().unwrap_or(default).trim_end_matches('/');
        let of = |name: &str| Some(format!("{namespace}/{name}"));
        match self.camera {
            None => (None, None, None, None),
            Some(Camera::RealsenseStereo) => {
                (of("infra1/image_rect_raw"), of("infra2/image_rect_raw"), None, None)
            }
            Some(Camera::RealsenseRgbd) => {
                (of("color/image_raw"), None, of("aligned_depth_to_color/image_raw"), None)
            }
            Some(Camera::Stereo) => (of("left/image_raw"), of("right/image_raw"), None, None),
            Some(Camera::Mono) => (of("image_raw"), None, None, None),
        }
    }

    /// A name after the remaps.
    pub fn remapped(&self, name: &str) -> String {
        let absolute = |name: &str| self.absolute(name);
        let found = self
            .remaps
            .iter()
            .filter_map(|r| r.split_once(":="))
            .find(|(from, _)| absolute(from) == absolute(name));
        absolute(found.map_or(name, |(_, to)| to))
    }

    /// The absolute name.
    fn absolute(&self, name: &str) -> String {
        let namespace = self.namespace.trim_end_matches('/');
        match name.strip_prefix("~/") {
            Some(own) => format!("{namespace}/{}/{own}", self.name),
            None if name.starts_with('/') => name.to_owned(),
            None => format!("{namespace}/{name}"),
        }
    }

    /// Where the first camera is on the robot, if it was given.
    pub fn given_base_from_camera(&self) -> Option<Se3> {
        pose_of(self.base_from_camera.as_deref()?)
    }

    /// The form of service calls.
    pub fn service_form(&self) -> Rmw {
        let by_environment = || match std::env::var("RMW_IMPLEMENTATION") {
            Ok(name) if name.contains("cyclonedds") => Rmw::Cyclonedds,
            _ => Rmw::Fastrtps,
        };
        self.rmw.unwrap_or_else(by_environment)
    }

    /// The domain.
    pub fn domain_id(&self) -> u16 {
        let by_environment = || std::env::var("ROS_DOMAIN_ID").ok().and_then(|text| text.trim().parse().ok());
        self.domain.or_else(by_environment).unwrap_or(0)
    }
}

impl Topics {
    /// The cameras that are used.
    pub fn mode(&self) -> SensorMode {
        match (&self.right, &self.depth) {
            (Some(_), _) => SensorMode::Stereo,
            (None, Some(_)) => SensorMode::Rgbd,
            (None, None) => SensorMode::Mono,
        }
    }
}

/// The namespace of a picture topic: `/a/image_raw/compressed` is in `/a`.
fn folder(topic: &str) -> &str {
    let plain = transport(topic).map_or(topic, |name| &topic[..topic.len() - name.len() - 1]);
    plain.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// `compressed` or `compressedDepth` where a topic's name ends so.
pub fn transport(topic: &str) -> Option<&str> {
    topic
        .rsplit_once('/')
        .map(|(_, name)| name)
        .filter(|name| matches!(*name, "compressed" | "compressedDepth"))
}

fn pose_of(numbers: &[f64]) -> Option<Se3> {
    let [x, y, z, qx, qy, qz, qw] = *numbers else { return None };
    let norm = (qx * qx + qy * qy + qz * qz + qw * qw).sqrt();
    let rotation = So3::from_xyzw(qx, qy, qz, qw).filter(|_| (norm - 1.0).abs() < 1e-2)?;
    Some(Se3::new(rotation, Vec3::new(x, y, z))).filter(Se3::is_finite)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(line: &str) -> Result<Options, clap::Error> {
        Options::parse_arguments(format!("cairn-ros {line}").split_whitespace().map(String::from))
    }

    #[test]
    fn topics_of_a_driver_and_their_calibrations() {
        let topics = options("--camera realsense-rgbd --imu /imu").unwrap().topics().unwrap();
        assert_eq!(topics.image, "/camera/camera/color/image_raw");
        let depth = (
            "/camera/camera/aligned_depth_to_color/image_raw",
            "/camera/camera/aligned_depth_to_color/camera_info",
        );
        assert_eq!(topics.depth.as_ref().map(|(a, b)| (a.as_str(), b.as_str())), Some(depth));
        assert_eq!((topics.mode(), topics.imu.as_deref()), (SensorMode::Rgbd, Some("/imu")));
        let stereo = options("--camera stereo --camera-namespace /rig/ --right-info /r/info")
            .unwrap()
            .topics()
            .unwrap();
        assert_eq!(
            (stereo.image.as_str(), stereo.image_info.as_str()),
            ("/rig/left/image_raw", "/rig/left/camera_info")
        );
        assert_eq!(stereo.right, Some(("/rig/right/image_raw".into(), "/r/info".into())));
        let compressed = options("--image /a/b/image_raw/compressed").unwrap().topics().unwrap();
        assert_eq!(
            (compressed.image_info.as_str(), compressed.mode()),
            ("/a/b/camera_info", SensorMode::Mono)
        );
        assert!(options("").unwrap().topics().is_err());
    }

    #[test]
    fn names_are_remapped_as_ros_does() {
        let o = options("--ros-args -r odom:=/vo -r ~/save_map:=keep -r __ns:=/robot -p use_sim_time:=true")
            .unwrap();
        assert!(o.use_sim_time);
        assert_eq!(o.remapped("odom"), "/vo");
        assert_eq!(o.remapped("~/save_map"), "/robot/keep");
        assert_eq!((o.remapped("path").as_str(), o.remapped("/tf").as_str()), ("/robot/path", "/tf"));
        assert_eq!(o.remapped("~/guide_home"), "/robot/cairn/guide_home");
        let o = options("-r /robot/pose:=here --namespace /robot/").unwrap();
        assert_eq!((o.remapped("pose").as_str(), o.remapped("/pose").as_str()), ("/robot/here", "/pose"));
    }

    #[test]
    fn wrong_usage_is_refused() {
        for line in [
            "-r odom",
            "-r :=a",
            "--ros-args -p speed:=3",
            "--base-from-camera 0 0 0 0 0 0 0",
            "--localize-only",
        ] {
            assert!(options(line).is_err(), "{line}");
        }
        assert!(options("--pair-within-ms nan").is_err() && options("--robot-radius-m nan").is_err());
        let base =
            options("--base-from-camera 0.1 0 0.2 -0.5 0.5 -0.5 0.5").unwrap().given_base_from_camera();
        assert!((base.unwrap().translation.z - 0.2).abs() < 1e-12);
    }

    #[test]
    fn command_lines_of_the_documents_are_understood() {
        let pages = [include_str!("../../../docs/ros.md"), include_str!("../README.md")];
        let lines = pages.iter().flat_map(|page| page.lines()).filter_map(|line| {
            let line = line.split(" # ").next().unwrap_or(line).trim();
            line.strip_prefix("target/release/").unwrap_or(line).strip_prefix("cairn-ros ")
        });
        let mut checked = 0;
        for line in lines.filter(|line| !line.contains("--help")) {
            let options = options(line).unwrap_or_else(|e| panic!("{line}: {e}"));
            assert!(options.topics().is_ok(), "{line}");
            checked += 1;
        }
        assert!(checked > 8, "only {checked} command lines were found");
    }
}
