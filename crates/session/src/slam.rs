//! What tracks and maps for a session: an engine in this process, or one in a process of its own, which may die.

use cairn_atlas::Snapshot;
use cairn_atlas::store::MapFile;
use cairn_dense::{SubmapConfig, SurfaceChange};
use cairn_engine::{DenseMapper, DenseSetupError, Engine, Output, Status};
use cairn_sensor::{FramePacket, Rig};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Receiver;

/// Why a packet has no result.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotTracked {
    /// Its images do not fit the rig; the next packet may.
    #[error("{0}")]
    Refused(String),
    /// Tracking ended with an error of the program, which was said; there will be no more poses.
    #[error("{0}")]
    Failed(String),
    /// What tracks is late, dead or being started again ([`Slam::away`]).
    #[error("{0}")]
    Away(String),
}

/// Who makes surfaces of the depth of key frames.
pub enum Surfaces {
    /// A mapper, which is given every packet.
    Here(Box<DenseMapper>),
    /// A process of its own.
    Elsewhere {
        /// What changes, until the session's map ends.
        changes: Receiver<SurfaceChange>,
        /// Whether somebody wants to know.
        wanted: Arc<DepthWanted>,
    },
}

/// What somebody wants to know of what is made of the depth; at first nobody does.
#[derive(Debug, Default)]
pub struct DepthWanted {
    /// The surfaces, or more.
    pub any: AtomicBool,
    /// The columns too.
    pub columns: AtomicBool,
}

/// Packets in, poses and a map out.
pub trait Slam {
    /// Tracks a packet.
    ///
    /// # Errors
    /// [`NotTracked`]; the session goes on.
    fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, NotTracked>;

    /// Does the next slice of work that waits, where that is done between packets; false when there was nothing to do.
    fn work(&mut self) -> bool {
        false
    }

    /// Time passes without a packet: what may have died is looked after.
    fn look_after(&mut self) {}

    /// It ends for good, and so does its map: another takes its place ([`crate::Session::restart_slam`]).
    fn end(&mut self) {}

    /// Why there are no poses at present, where what tracks is late, dead or being started again.
    fn away(&self) -> Option<&str> {
        None
    }

    /// The latest map.
    fn snapshot(&self) -> Arc<Snapshot>;

    /// The camera of its poses.
    fn camera(&self) -> &RectifiedCamera;

    /// The status after the last packet.
    fn status(&self) -> &Status;

    /// Whether poses come from what the camera sees: then a route is ready only where it will see landmarks.
    fn is_visual(&self) -> bool {
        true
    }

    /// The latest map with its provenance, for saving.
    fn to_save(&self, program: &str, attached: BTreeMap<String, Vec<u8>>) -> MapFile;

    /// Surfaces of the depth of key frames from now on, which follow this map.
    ///
    /// # Errors
    /// Without a depth sensor, or without a map.
    fn surfaces(&mut self, _rig: &Rig, _config: SubmapConfig) -> Result<Surfaces, DenseSetupError> {
        Err(DenseSetupError::NoMapping)
    }

    /// Whether lengths in all maps are metres.
    fn is_metric(&self) -> bool {
        self.snapshot().is_metric(self.camera())
    }
}

impl Slam for Engine {
    fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, NotTracked> {
        Engine::on_packet(self, packet).map_err(|e| NotTracked::Refused(e.to_string()))
    }

    fn work(&mut self) -> bool {
        Engine::work(self)
    }

    fn snapshot(&self) -> Arc<Snapshot> {
        Engine::snapshot(self)
    }

    fn camera(&self) -> &RectifiedCamera {
        self.front_end().model()
    }

    fn status(&self) -> &Status {
        Engine::status(self)
    }

    fn to_save(&self, program: &str, attached: BTreeMap<String, Vec<u8>>) -> MapFile {
        Engine::to_save(self, program, attached)
    }

    fn surfaces(&mut self, rig: &Rig, config: SubmapConfig) -> Result<Surfaces, DenseSetupError> {
        Ok(Surfaces::Here(Box::new(DenseMapper::new(self, rig, config)?)))
    }
}

impl<S: Slam + ?Sized> Slam for Box<S> {
    fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, NotTracked> {
        (**self).on_packet(packet)
    }

    fn look_after(&mut self) {
        (**self).look_after();
    }

    fn end(&mut self) {
        (**self).end();
    }

    fn away(&self) -> Option<&str> {
        (**self).away()
    }

    fn snapshot(&self) -> Arc<Snapshot> {
        (**self).snapshot()
    }

    fn camera(&self) -> &RectifiedCamera {
        (**self).camera()
    }

    fn status(&self) -> &Status {
        (**self).status()
    }

    fn is_visual(&self) -> bool {
        (**self).is_visual()
    }

    fn to_save(&self, program: &str, attached: BTreeMap<String, Vec<u8>>) -> MapFile {
        (**self).to_save(program, attached)
    }

    fn surfaces(&mut self, rig: &Rig, config: SubmapConfig) -> Result<Surfaces, DenseSetupError> {
        (**self).surfaces(rig, config)
    }
}
