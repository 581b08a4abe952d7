//! Where the robot is in a saved map: not known until an image shows it; what `initialpose` says of it; and whether the floor is flat.

use super::Node;
use crate::faults::Severity;
use crate::messages::PoseWithCovarianceStamped;
use crate::planar::{FloorWatch, NotFlat};
use crate::wheels::Wheels;
use cairn::atlas::MapId;
use cairn::engine::{HintOutcome, MeasuredMotion, PlaceHint};
use cairn::geometry::{Se3, So3, Vec3};
use cairn::sensor::{SkipKind, Stamp};
use std::collections::BTreeSet;

/// How far off a pose may be that is said to be exact, metres: it is set by hand.
const LEAST_M: f64 = 1.0;
/// Standard deviations within which a pose is looked for.
const SIGMAS: f64 = 3.0;

/// What is known of the robot's place.
#[derive(Default)]
pub(super) struct Placing {
    /// The maps of the file, while the robot has been recognised in none of them.
    unrecognised: BTreeSet<MapId>,
    /// What `initialpose` asked for last, and its outcome as last said.
    asked: Option<(String, HintOutcome)>,
    /// What the diagnostics say of it.
    words: Option<String>,
    floor: FloorWatch,
    wheels: Wheels,
    not_flat: Option<NotFlat>,
}

impl Placing {
    /// What speaks against the place, for the diagnostics.
    pub(super) fn words(&self) -> impl Iterator<Item = String> {
        let unrecognised =
            (!self.unrecognised.is_empty()).then(|| "not recognised in the saved map yet".to_owned());
        let not_flat = self.not_flat.map(|why| why.to_string());
        unrecognised.into_iter().chain(self.words.clone()).chain(not_flat)
    }

    /// Whether something is wrong.
    pub(super) fn warns(&self) -> bool {
        self.not_flat.is_some() || !self.unrecognised.is_empty()
    }
}

/// How the published map lies to a map of a file: its first key frame is where the robot began, as when the map was made. With
/// whether it is aligned with gravity.
fn published(map: &cairn::Map, id: MapId, base_from_camera: &Se3) -> Option<(Se3, bool)> {
    let snapshot = map.snapshot();
    let world_from_base = snapshot.key_frame(id.root())?.world_from_camera * base_from_camera.inverse();
    let aligned = snapshot.is_gravity_aligned(id);
    let begin = match aligned {
        true => {
            let ahead = world_from_base.rotation * Vec3::x();
            let heading = So3::exp(&(Vec3::z() * ahead.y.atan2(ahead.x)));
            Se3::new(heading, world_from_base.translation)
        }
        false => world_from_base,
    };
    Some((begin.inverse(), aligned))
}

impl Node<'_> {
    /// The published map is the largest one of the file from now on; the robot has no place in it yet.
    pub(super) fn enter_saved_map(&mut self) {
        let map = self.slam.map();
        self.placing.unrecognised = map.maps().collect();
        self.shown.map = map.largest();
        self.publish_in(map.largest());
    }

    fn publish_in(&mut self, id: Option<MapId>) {
        let map = self.slam.map();
        let placed = id.and_then(|id| published(&map, id, &self.tree.base_from_camera(map.is_metric(id))));
        if let Some((map_from_world, aligned)) = placed {
            self.tree.in_saved_map(map_from_world, aligned);
        }
    }

    /// Whether a pose in this map is one in the published map: it is not while the robot makes a map of its own beside the saved ones.
    pub(super) fn is_placed(&mut self, map: MapId) -> bool {
        if !self.placing.unrecognised.is_empty() {
            if !self.placing.unrecognised.contains(&map) {
                return false;
            }
            self.placing.unrecognised.clear();
            self.publish_in(Some(map));
            self.faults.say(Severity::Info, "recognised in the saved map");
        }
        self.shown.map = Some(map);
        true
    }

    /// Takes what is said of the robot's place as a hint: it counts once an image confirms it.
    pub(super) fn take_initial_pose(&mut self, said: &PoseWithCovarianceStamped) {
        let line = match self.hint_of(said) {
            Ok((hint, words)) => {
                self.slam.hint(hint);
                self.placing.words = Some(format!("looking for {words}"));
                let line = format!("initialpose: looking for {words}");
                self.placing.asked = Some((words, HintOutcome::Searching));
                (Severity::Info, line)
            }
            Err(why) => {
                let line = format!("initialpose: refused: {why}");
                self.placing.words = Some(line.clone());
                (Severity::Warn, line)
            }
        };
        self.faults.say(line.0, &line.1);
    }

    fn hint_of(&self, said: &PoseWithCovarianceStamped) -> Result<(PlaceHint, String), String> {
        let frame = &said.header.frame_id;
        let map = self.slam.map();
        let id = self.shown.map.ok_or("there is no map yet")?;
        let map_from_world = self.tree.map_from_world().ok_or("there is no map yet")?;
        let map_from_frame = self.map_from(frame).ok_or_else(|| {
            format!("the frame \"{frame}\" is not {}, or it is not known where it is", self.names.map)
        })?;
        let map_from_base = map_from_frame * said.pose.pose.se3().ok_or("its pose is none")?;
        let rows = &said.pose.covariance;
        let variance = rows[0][0].max(rows[1][1]);
        if ![rows[0][0], rows[1][1]].iter().all(|v| v.is_finite() && *v >= 0.0) {
            return Err("its covariance is none".into());
        }
        let radius = LEAST_M.max(SIGMAS * variance.sqrt());
        let world_from_map = map_from_world.inverse();
        let base_from_camera = self.tree.base_from_camera(map.is_metric(id));
        let hint = PlaceHint {
            map: id,
            world_from_camera: world_from_map * map_from_base * base_from_camera,
            radius,
            // Such poses are set on a plan, which has no heights.
            free: Some(world_from_map.rotation * Vec3::z()),
        };
        let at = map_from_base.translation;
        Ok((hint, format!("the place ({:.1}, {:.1}), within {radius:.1} m", at.x, at.y)))
    }

    /// Says what has become of the last hint, once.
    pub(super) fn report_hint(&mut self) {
        let Some((words, before)) = &self.placing.asked else { return };
        let Some(outcome) = self.slam.hint_outcome().filter(|outcome| outcome != before) else { return };
        let (severity, line) = match outcome {
            HintOutcome::Searching => return,
            HintOutcome::Agrees => {
                (Severity::Info, format!("initialpose: {words}: that is where the robot is"))
            }
            HintOutcome::Recognised => (Severity::Info, format!("initialpose: {words}: recognised")),
            HintOutcome::NotRecognised { key_frames: 0, .. } => {
                (Severity::Warn, format!("initialpose: {words}: refused: the map has nothing there"))
            }
            HintOutcome::NotRecognised { inliers, need, key_frames } => (
                Severity::Warn,
                format!(
                    "initialpose: {words}: refused: no image shows it ({inliers} of {need} matches at best, {key_frames} key frames)"
                ),
            ),
        };
        self.placing.words = (severity == Severity::Warn).then(|| line.clone());
        self.placing.asked = None;
        self.faults.say(severity, &line);
    }

    /// Gives what the wheels measured up to a picture, as a motion of the rig's body. The time is that of messages.
    pub(super) fn give_wheels(&mut self, picture: Stamp) {
        let readings = std::mem::take(&mut self.requests.lock().wheels);
        for reading in readings {
            let child = reading.child_frame_id.trim_start_matches('/');
            match reading.pose.pose.se3() {
                Some(pose) if child == self.names.base => {
                    self.placing.wheels.add(reading.header.stamp.stamp(), pose)
                }
                Some(_) => {
                    let line = "readings of the wheels are not of the robot's frame";
                    self.faults.count(
                        SkipKind::Other,
                        line,
                        &format!("of \"{child}\", not of {}", self.names.base),
                    );
                }
                None => self.faults.count(SkipKind::Other, "a reading of the wheels has no pose", ""),
            }
        }
        let Some(motion) = self.placing.wheels.motion_to(picture) else { return };
        let body_from_camera =
            self.found.rig.cameras.first().map_or_else(Se3::identity, |c| c.body_from_camera);
        let body_from_base = body_from_camera * self.found.base_from_camera.inverse();
        let last_from_now = body_from_base * motion.last_from_now * body_from_base.inverse();
        self.slam.motion_measured(&MeasuredMotion { last_from_now, ..motion });
    }

    /// Looks whether the floor is flat, where the robot is said to move on a plane.
    pub(super) fn watch_floor(&mut self, stamp: Stamp, metric: bool) {
        let Some(map_from_base) = self.tree.map_from_base().filter(|_| self.options.planar) else { return };
        let before = self.placing.not_flat.take();
        self.placing.not_flat = self.placing.floor.step(stamp, &map_from_base, metric);
        if let (None, Some(why)) = (before, self.placing.not_flat) {
            self.faults.say(Severity::Warn, &why.to_string());
        }
    }
}
