//! The thread that makes surfaces: depth of key frames into submaps, meshes of what has changed for the pages.

use super::Surface;
use crate::hub::Hub;
use cairn_dense::{BlockKey, Mesh, MeshConfig, Mesher, SubmapConfig, SubmapView};
use cairn_engine::{DenseMapper, Output};
use cairn_geometry::Vec3;
use cairn_sensor::FramePacket;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Packets that may wait for the thread; more are left out, and so is the depth of key frames among them.
const MOST_WAITING: usize = 64;
/// Interval of the meshes.
const MESH_EVERY: Duration = Duration::from_millis(500);
/// Images that are fused again after each packet, at most, where the map has been corrected.
const FUSED_AGAIN: usize = 4;

/// The running thread; it ends when this is dropped.
pub(crate) struct SurfaceWork {
    to: Option<SyncSender<(FramePacket, Output)>>,
    thread: Option<JoinHandle<()>>,
}

impl SurfaceWork {
    /// Begins with a mapper that follows the session's map.
    ///
    /// # Errors
    /// When the system provides no thread.
    pub fn begin(mapper: DenseMapper, config: &SubmapConfig, hub: Arc<Hub>) -> std::io::Result<Self> {
        let (to, from) = sync_channel(MOST_WAITING);
        lock(&hub).voxels(config.tsdf.voxel_m as f32);
        let work = Work { mapper, meshes: Meshes::new(), hub, began: Instant::now(), meshed: None };
        let thread =
            std::thread::Builder::new().name("cairn-surface".into()).spawn(move || work.run(&from))?;
        Ok(Self { to: Some(to), thread: Some(thread) })
    }

    /// Takes a packet that the engine has processed; does not wait.
    pub fn on_packet(&self, packet: &FramePacket, output: &Output) {
        if let Some(to) = &self.to {
            // A thread that is behind misses a packet; one that has ended has said why.
            let _ = to.try_send((packet.clone(), output.clone()));
        }
    }
}

impl Drop for SurfaceWork {
    fn drop(&mut self) {
        self.to = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn lock(hub: &Hub) -> std::sync::MutexGuard<'_, Surface> {
    hub.surface.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Work {
    mapper: DenseMapper,
    meshes: Meshes,
    hub: Arc<Hub>,
    began: Instant,
    meshed: Option<Instant>,
}

impl Work {
    fn run(mut self, from: &Receiver<(FramePacket, Output)>) {
        let mut camera = Vec3::zeros();
        loop {
            match from.recv_timeout(MESH_EVERY) {
                Ok((packet, output)) => {
                    self.mapper.on_packet(&packet, &output);
                    camera = output.world_from_body.map_or(camera, |pose| pose.se3.translation);
                }
                // Mapping goes on behind the last packet.
                Err(RecvTimeoutError::Timeout) => self.mapper.follow(),
                Err(RecvTimeoutError::Disconnected) => return,
            }
            self.mapper.step(&camera, FUSED_AGAIN);
            let is_due = self.meshed.is_none_or(|at| at.elapsed() >= MESH_EVERY);
            if is_due && self.hub.surfaces_wanted.load(Ordering::Relaxed) > 0 {
                self.meshed = Some(Instant::now());
                self.mesh(&camera);
            }
        }
    }

    /// Meshes what has changed, for the pages.
    fn mesh(&mut self, camera: &Vec3) {
        let now = (10.0 * self.began.elapsed().as_secs_f64()) as u32;
        let submaps: Vec<SubmapView> = self.mapper.map().submaps().collect();
        let numbers: BTreeSet<u32> = submaps.iter().map(|s| s.number as u32).collect();
        let changed: Vec<(u32, BlockKey, Mesh)> =
            submaps.iter().flat_map(|submap| self.meshes.changed(submap)).collect();
        self.meshes.known.retain(|number, _| numbers.contains(number));
        let mut surface = lock(&self.hub);
        surface.camera_at([camera.x, camera.y, camera.z].map(|v| v as f32));
        surface.keep(|number| numbers.contains(&number));
        submaps.iter().for_each(|s| surface.place(s.number as u32, &s.world_from_submap));
        changed.iter().for_each(|(number, key, mesh)| surface.set(*number, *key, mesh, now));
    }
}

/// What has been meshed.
struct Meshes {
    mesher: Mesher,
    /// For each submap the revision of its field, and the blocks that it had.
    known: BTreeMap<u32, (u64, BTreeSet<BlockKey>)>,
}

impl Meshes {
    fn new() -> Self {
        Self { mesher: Mesher::new(MeshConfig::of_key_frames()), known: BTreeMap::new() }
    }

    /// The meshes of a submap's blocks that have changed since it was asked last.
    fn changed(&mut self, submap: &SubmapView) -> Vec<(u32, BlockKey, Mesh)> {
        let (number, field) = (submap.number as u32, submap.tsdf);
        let (revision, had) = self.known.entry(number).or_default();
        if *revision == field.revision() {
            return Vec::new();
        }
        let has: BTreeSet<BlockKey> = field.changed_since(0).collect();
        // A block that is gone is none of those that have changed.
        let gone = Mesher::affected(had.difference(&has).copied());
        let mut out: Vec<(BlockKey, Mesh)> = self.mesher.changed(field, *revision).collect();
        let known: BTreeSet<BlockKey> = out.iter().map(|(key, _)| *key).collect();
        for key in gone.into_iter().filter(|key| !known.contains(key)) {
            out.push((key, self.mesher.block(field, key)));
        }
        (*revision, *had) = (field.revision(), has);
        out.into_iter().map(|(key, mesh)| (number, key, mesh)).collect()
    }
}
