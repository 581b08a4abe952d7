//! One request of tracking, done by mapping, whatever runs it.

use super::done::Taken;
use cairn_atlas::{Atlas, ImuSegment, LandmarkId, MapPrior, Readout, Snapshot};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_mapping::{Closed, KeyFrameInput, MapStart, Mapper, StartClocks};
use cairn_solve::to_end;
use cairn_tracking::{AnchoredPose, KeyFrameRequest, RelocationPrior};
use std::sync::Arc;

/// A message in mapping's queue.
pub(super) enum Input {
    Visibility(Vec<(LandmarkId, bool)>),
    KeyFrameRequest(Box<KeyFrameRequest>),
    /// Changes of closing on a snapshot that may be outdated by now.
    Closed(Arc<Snapshot>, Closed),
}

/// Inserts the key frame, or begins a map with it.
pub(super) fn take(
    mapper: &mut Mapper,
    atlas: &mut Atlas,
    request: &KeyFrameRequest,
    stop: impl FnMut() -> bool,
) -> Taken {
    to_end(take_in_slices(mapper, atlas, request, stop))
}

/// The same in slices.
pub(super) async fn take_in_slices(
    mapper: &mut Mapper,
    atlas: &mut Atlas,
    request: &KeyFrameRequest,
    stop: impl FnMut() -> bool,
) -> Taken {
    let key_frame = match request {
        KeyFrameRequest::First { frame, relocation_prior, imu } => {
            Some(mapper.start(atlas, frame, &map_start(relocation_prior, imu, true)))
        }
        KeyFrameRequest::Pair { first, second, first_from_second, points, relocation_prior, imu, clocks } => {
            let clocks = clocks.map(|c| StartClocks {
                offset_s: c.offset_s,
                readout: Readout { seconds: c.readout_s[0], sigma_s: c.readout_s[1] },
            });
            let map_start = MapStart { clocks, ..map_start(relocation_prior, imu, false) };
            mapper.start_pair(atlas, first, second, *first_from_second, points, &map_start)
        }
        KeyFrameRequest::Next {
            frame,
            landmarks,
            anchored,
            imu,
            orientation_only,
            rescale,
            motion,
            by_depth,
        } => {
            let AnchoredPose { reference, reference_from_camera, .. } = *anchored;
            let imu = imu.as_ref();
            let (orientation_only, rescale) = (*orientation_only, *rescale);
            let submitted = KeyFrameInput {
                frame,
                landmarks,
                reference,
                reference_from_camera,
                imu,
                orientation_only,
                rescale,
                motion: motion.as_ref(),
                by_depth: *by_depth,
            };
            let mapped = mapper.step_in_slices(atlas, &submitted, stop).await;
            return mapped.map_or(Taken::default(), |m| Taken {
                key_frame: Some(m.key_frame),
                attempt: m.attempt,
                scale_check: m.scale_check,
            });
        }
    };
    Taken { key_frame, ..Taken::default() }
}

/// The initial state of a map: at the prior pose in the previous map, or as the first one.
fn map_start(relocation_prior: &Option<RelocationPrior>, imu: &Option<ImuSegment>, metric: bool) -> MapStart {
    let map_start = relocation_prior.map_or(MapStart::default(), |prior| MapStart {
        world_from_camera: prior.anchored.world_from_camera,
        map_prior: Some(MapPrior {
            to: prior.anchored.reference,
            to_from_root: prior.anchored.reference_from_camera,
            sigma: prior.sigma,
            sigma_rad: prior.sigma_rad,
            sigma_log_scale: prior.sigma_log_scale,
        }),
        speed: prior.speed,
        gravity_aligned: metric && prior.gravity_aligned,
        assumed_since: prior.assumed_since,
        ..MapStart::default()
    });
    // The first map starts nearly upright, where the IMU shows the up direction.
    let up = imu.as_ref().and_then(|s| s.up).filter(|_| relocation_prior.is_none());
    let world_from_camera =
        up.map_or(map_start.world_from_camera, |up| Se3::new(upright(&up), Vec3::zeros()));
    MapStart { imu: imu.clone(), world_from_camera, ..map_start }
}

/// The smallest rotation that takes a direction to the z axis.
fn upright(up: &Vec3) -> So3 {
    let axis = up.cross(&Vec3::z());
    match axis.try_normalize(1e-9) {
        Some(axis) => So3::exp(&(axis * up.angle(&Vec3::z()))),
        None if up.z < 0.0 => So3::exp(&(Vec3::x() * std::f64::consts::PI)),
        None => So3::identity(),
    }
}

/// Why a stage panicked.
pub(super) fn text_of(cause: &Box<dyn std::any::Any + Send>) -> String {
    let text = cause
        .downcast_ref::<&str>()
        .map(|s| s.to_string())
        .or_else(|| cause.downcast_ref::<String>().cloned());
    format!("mapping stopped: {}", text.unwrap_or_else(|| "no reason given".into()))
}
