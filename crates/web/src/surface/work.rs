//! The thread that keeps the surface of the pages: depth of key frames into submaps and meshes of what has changed, or what a
//! process of surfaces sends.

use super::Surface;
use crate::hub::Hub;
use cairn_dense::{ColumnChanges, SubmapConfig, SurfaceChange, SurfaceChanges};
use cairn_engine::{DenseMapper, Output};
use cairn_geometry::Vec3;
use cairn_sensor::FramePacket;
use cairn_session::{DepthWanted, Surfaces};
use std::collections::BTreeSet;
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
/// Tiles of columns that are looked at each time, at most.
const TILES: usize = 12;

/// The running thread; it ends when this is dropped.
pub(crate) struct SurfaceWork {
    hub: Arc<Hub>,
    /// Packets, where surfaces are made here.
    to: Option<SyncSender<(FramePacket, Output)>>,
    thread: Option<JoinHandle<()>>,
}

impl SurfaceWork {
    /// Begins with surfaces that follow the session's map.
    ///
    /// # Errors
    /// When the system provides no thread.
    pub fn begin(surfaces: Surfaces, config: &SubmapConfig, hub: Arc<Hub>) -> std::io::Result<Self> {
        lock(&hub).voxels(config.tsdf.voxel_m as f32);
        let named = std::thread::Builder::new().name("cairn-surface".into());
        let shown = Shown { hub: hub.clone(), began: Instant::now() };
        match surfaces {
            Surfaces::Here(mapper) => {
                let (to, from) = sync_channel(MOST_WAITING);
                let (changes, columns) = (SurfaceChanges::new(), ColumnChanges::new());
                let work = Work { mapper: *mapper, changes, columns, shown, meshed: None };
                let thread = Some(named.spawn(move || work.run(&from))?);
                Ok(Self { hub, to: Some(to), thread })
            }
            Surfaces::Elsewhere { changes, wanted } => {
                // It ends with the session's map, which nobody waits for here.
                named.spawn(move || shown.follow(&changes, &wanted))?;
                Ok(Self { hub, to: None, thread: None })
            }
        }
    }

    /// Takes a packet that the engine has processed; does not wait.
    pub fn on_packet(&self, packet: &FramePacket, output: &Output) {
        if let Some(to) = &self.to {
            // A thread that is behind misses a packet; one that has ended has said why.
            let _ = to.try_send((packet.clone(), output.clone()));
        } else if let (Some(pose), Ok(mut surface)) = (output.world_from_body(), self.hub.surface.try_lock())
        {
            at(&mut surface, &pose.se3.translation);
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

fn at(surface: &mut Surface, camera: &Vec3) {
    surface.camera_at([camera.x, camera.y, camera.z].map(|v| v as f32));
}

/// The surface that pages draw.
struct Shown {
    hub: Arc<Hub>,
    began: Instant,
}

impl Shown {
    /// Whether a page wants the surface or the columns.
    fn is_wanted(&self) -> bool {
        self.hub.wanted.surfaces.load(Ordering::Relaxed) > 0 || self.are_columns_wanted()
    }

    fn are_columns_wanted(&self) -> bool {
        self.hub.wanted.columns.load(Ordering::Relaxed) > 0
    }

    /// Takes what another process sends, which is told whether a page wants it.
    fn follow(&self, changes: &Receiver<SurfaceChange>, wanted: &DepthWanted) {
        loop {
            wanted.any.store(self.is_wanted(), Ordering::Relaxed);
            wanted.columns.store(self.are_columns_wanted(), Ordering::Relaxed);
            match changes.recv_timeout(MESH_EVERY) {
                Ok(change) => self.put(change),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    fn put(&self, change: SurfaceChange) {
        let now = (10.0 * self.began.elapsed().as_secs_f64()) as u32;
        let numbers: BTreeSet<u32> = change.submaps.iter().map(|(number, _)| *number).collect();
        let mut surface = lock(&self.hub);
        surface.keep(|number| numbers.contains(&number));
        change.submaps.iter().for_each(|(number, pose)| surface.place(*number, pose));
        change.blocks.iter().for_each(|(number, key, mesh)| surface.set(*number, *key, mesh, now));
        drop(surface);
        let mut columns = self.hub.columns.lock().unwrap_or_else(PoisonError::into_inner);
        columns.take(change.columns, now);
    }
}

struct Work {
    mapper: DenseMapper,
    changes: SurfaceChanges,
    columns: ColumnChanges,
    shown: Shown,
    meshed: Option<Instant>,
}

impl Work {
    fn run(mut self, from: &Receiver<(FramePacket, Output)>) {
        let mut camera = Vec3::zeros();
        loop {
            match from.recv_timeout(MESH_EVERY) {
                Ok((packet, output)) => {
                    self.mapper.on_packet(&packet, &output);
                    camera = output.world_from_body().map_or(camera, |pose| pose.se3.translation);
                }
                // Mapping goes on behind the last packet.
                Err(RecvTimeoutError::Timeout) => self.mapper.follow(),
                Err(RecvTimeoutError::Disconnected) => return,
            }
            self.mapper.step(&camera, FUSED_AGAIN);
            let is_due = self.meshed.is_none_or(|at| at.elapsed() >= MESH_EVERY);
            if is_due && self.shown.is_wanted() {
                self.meshed = Some(Instant::now());
                let mut change = self.changes.of(self.mapper.map());
                if self.shown.are_columns_wanted() {
                    let up = Vec3::from(self.shown.hub.map.borrow().up().map(f64::from));
                    // A map that is too high for columns is shown without.
                    let columns = self.columns.of(self.mapper.map(), None, &up, &camera, TILES);
                    change.columns = columns.unwrap_or_default();
                }
                at(&mut lock(&self.shown.hub), &camera);
                self.shown.put(change);
            }
        }
    }
}
