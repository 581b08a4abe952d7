//! The focal length of a camera that nobody calibrated, from the first seconds of a recording: features that are followed from frame to
//! frame against how far the gyroscope says that the camera has turned, and how far its readings say that it has moved.
//!
//! In: frames as they were seen, in order, and the readings around them. Out: by how much the focal length is another than assumed. One
//! over the clocks ([`flow_clocks`]), then motions of a few seconds each ([`motion_of_tracks`]), whose estimates are weighed together.

use crate::first_clocks::pair;
use crate::flow::{FlowPair, flow_clocks};
use crate::shutter::{Moving, Shutter};
use crate::start::match_around;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{
    Bias, ImuBuffer, Preintegrated, TrackMotion, TrackPoint, TrackPriors, Tracks, motion_of_tracks,
};
use cairn_sensor::{ImuSample, ImuSensor, Stamp};
use cairn_solve::to_end;
use cairn_vision::{Frame, RectifiedCamera};
use std::sync::Arc;

/// Seconds between the frames that are related, and in a motion.
const STEP_S: f64 = 0.12;
const MOTION_S: f64 = 2.5;
/// Radius around where the turn predicts a feature, pixels: one who walks past things half a metre away.
const RADIUS_PX: f32 = 30.0;
/// Features a frame must have to be followed.
const LEAST_FEATURES: usize = 60;
/// Standard deviations: of a feature, pixels; of the biases, rad/s and m/s^2; of the logarithm of a focal length that is a guess.
const SEEN_PX: f64 = 1.0;
const BIAS: [f64; 2] = [0.01, 0.15];
const GUESS: f64 = 0.1;
/// Seconds of turning that are averaged for the skew of a frame.
const TURNING_S: f64 = 0.03;
/// Rays that must agree for a motion to be believed.
const LEAST_AGREEING: f64 = 0.7;
/// Standard deviation of the scale of a motion that tells a focal length: of one who hardly moves (`phone/a`) it comes out a fifth too
/// long.
const MOST_SCALE_SIGMA: f64 = 0.1;
/// What a motion leaves out (the lens's distortion, things that move) moves the focal length by this share on `phone/b`.
const LEAST_SIGMA: f64 = 0.01;

/// The logarithm of the focal length over that assumed, and its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstLens {
    /// The logarithm of the ratio.
    pub log_focal: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// Finds the focal length; `size` is that of the images, `imu_from_camera` in metres. `None` where nothing is told of it.
pub fn first_lens(
    camera: &RectifiedCamera,
    size: [usize; 2],
    frames: &[Arc<Frame>],
    samples: &[ImuSample],
    sensor: &ImuSensor,
    imu_from_camera: &Se3,
) -> Option<FirstLens> {
    let shutter = Shutter::new(None, size);
    let pairs: Vec<FlowPair> = frames.windows(2).map(|w| pair(camera, &shutter, &w[0], &w[1])).collect();
    let clocks = flow_clocks(&pairs, samples, &imu_from_camera.rotation.inverse(), camera.fx)?;
    let mut buffer = ImuBuffer::in_stream(sensor);
    buffer.push(samples);
    buffer.shift(clocks.offset_s[0]);
    let nodes = nodes(camera, &shutter, frames, &buffer, imu_from_camera, clocks.readout_s[0]);
    let priors = TrackPriors {
        ray: SEEN_PX / camera.fx,
        bias: BIAS,
        offset_s: clocks.offset_s[1],
        log_focal: GUESS,
        readout_s: clocks.readout_s[1],
    };
    let count = (MOTION_S / STEP_S) as usize;
    let motion = |nodes: &[Node]| motion_of(camera, nodes, &buffer, imu_from_camera, priors);
    let found: Vec<TrackMotion> =
        nodes.chunks(count).filter(|nodes| nodes.len() > count / 2).filter_map(motion).collect();
    let told = found.iter().filter(|m| is_told(m)).map(|m| m.log_focal);
    let told = told.map(|[log, sigma]| (log, sigma.hypot(LEAST_SIGMA).powi(-2)));
    let (sum, weight) = told.fold((0.0, 0.0), |(sum, weight), (log, w)| (sum + log * w, weight + w));
    (weight > 0.0)
        .then(|| FirstLens { log_focal: sum / weight, sigma: weight.sqrt().recip().max(LEAST_SIGMA) })
}

/// Whether a motion tells a focal length: its rays meet, it knows how far it has gone, and the lens is one that a camera may have.
fn is_told(motion: &TrackMotion) -> bool {
    motion.agreeing >= LEAST_AGREEING
        && motion.scale_sigma <= MOST_SCALE_SIGMA
        && motion.log_focal[0].abs() <= 2.0 * GUESS
}

/// A frame that is related to the one before it.
struct Node {
    frame: Arc<Frame>,
    /// The feature of the node before that each feature shows again.
    before: Vec<Option<usize>>,
}

/// Frames [`STEP_S`] apart, with their rows as exposed at once, and features found again where the gyroscope says.
fn nodes(
    camera: &RectifiedCamera,
    shutter: &Shutter,
    frames: &[Arc<Frame>],
    buffer: &ImuBuffer,
    imu_from_camera: &Se3,
    readout_s: f64,
) -> Vec<Node> {
    let camera_from_imu = imu_from_camera.rotation.inverse();
    let mut nodes: Vec<Node> = Vec::new();
    for frame in frames.iter().filter(|frame| frame.len() >= LEAST_FEATURES) {
        if nodes.last().is_some_and(|last| frame.stamp - last.frame.stamp < STEP_S) {
            continue;
        }
        let turning = camera_from_imu * rate(buffer, frame.stamp);
        let moving = Moving { turning, velocity: Vec3::zeros() };
        let mut frame = Frame::clone(frame);
        shutter.correct(&mut frame, camera, readout_s, &moving, std::iter::empty());
        let mut before = vec![None; frame.len()];
        if let Some(last) = nodes.last() {
            let turned = buffer.preintegrate(Bias::default(), last.frame.stamp, frame.stamp);
            let turned = turned.map_or_else(|_| So3::identity(), |sum| sum.gained(&Bias::default()).0);
            let now_from_last = camera_from_imu * turned.inverse() * imu_from_camera.rotation;
            let expected: Vec<Option<[f32; 2]>> = (last.frame.px.iter())
                .map(|px| {
                    let [u, v, _] = camera.project(&(now_from_last * camera.unproject(*px, 1.0)))?;
                    camera.contains(u, v).then_some([u as f32, v as f32])
                })
                .collect();
            for (i, j) in match_around(&last.frame, &frame, &expected, RADIUS_PX) {
                before[j] = Some(i);
            }
        }
        nodes.push(Node { frame: Arc::new(frame), before });
    }
    nodes
}

/// The mean rate of turning about an instant.
fn rate(buffer: &ImuBuffer, at: Stamp) -> Vec3 {
    let about = buffer.within(at.plus_seconds(-0.5 * TURNING_S), at.plus_seconds(0.5 * TURNING_S));
    let (sum, count) = about.fold((Vec3::zeros(), 0.0), |(sum, n), s| (sum + s.gyro, n + 1.0));
    if count > 0.0 { sum / count } else { Vec3::zeros() }
}

/// The motion over some nodes.
fn motion_of(
    camera: &RectifiedCamera,
    nodes: &[Node],
    buffer: &ImuBuffer,
    imu_from_camera: &Se3,
    priors: TrackPriors,
) -> Option<TrackMotion> {
    let link = |w: &[Node]| buffer.preintegrate(Bias::default(), w[0].frame.stamp, w[1].frame.stamp).ok();
    let links: Option<Vec<Preintegrated>> = nodes.windows(2).map(link).collect();
    let mut tracks: Vec<Vec<TrackPoint>> = Vec::new();
    let mut last: Vec<usize> = Vec::new();
    for (n, node) in nodes.iter().enumerate() {
        let frame = &node.frame;
        let mut here = Vec::with_capacity(frame.len());
        for i in 0..frame.len() {
            let of = node.before[i].filter(|_| n > 0).map(|before| last[before]);
            let track = of.unwrap_or_else(|| {
                tracks.push(Vec::new());
                tracks.len() - 1
            });
            let ray = camera.unproject(frame.px[i], 1.0);
            let by = frame.rolling.as_ref().map_or([0.0; 2], |r| r.slopes[i].map(f64::from));
            let by_readout = [by[0] / camera.fx, by[1] / camera.fy];
            tracks[track].push(TrackPoint { frame: n, ray: [ray.x, ray.y], by_readout });
            here.push(track);
        }
        last = here;
    }
    tracks.retain(|track| track.len() > 2);
    let imu_from_camera = *imu_from_camera;
    to_end(motion_of_tracks(&Tracks { links: &links?, tracks: &tracks, imu_from_camera, priors }))
}
