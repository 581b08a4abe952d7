//! What a page shows of a walk: the status often, the routes where they have changed, the map by differences.

use cairn_engine::Engine;
use cairn_session::{Drawn, RouteListed, Session, SessionStatus};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Most landmarks that are drawn.
const MOST_POINTS: usize = 4000;

/// What a page shows, but for the map.
#[derive(Debug, Serialize)]
pub struct Shown {
    /// The status.
    pub status: SessionStatus,
    /// The kept routes, newest first, where they have changed since they were last told.
    pub routes: Option<Vec<RouteListed>>,
    /// What the user should know of the map and the lens that the walk goes on with, since it was last told.
    pub notes: Vec<String>,
    /// Where the camera is in the map, while it is tracked: position, then the axes right, down and forward.
    pub camera: Option<[[f32; 3]; 4]>,
}

/// What the page was told last.
#[derive(Default)]
pub(crate) struct Told {
    routes: Option<(u64, Option<PathBuf>)>,
    map: Drawn,
}

impl Told {
    /// What is to be shown now.
    pub fn shown(&mut self, session: &Session<Engine>, notes: Vec<String>) -> Shown {
        let (version, held) = session.routes_version();
        let version = Some((version, held.map(Path::to_owned)));
        let routes = (self.routes != version).then(|| session.routes());
        self.routes = version;
        let camera = session.camera().filter(|_| session.engine_status().valid);
        Shown { status: session.status(), routes, notes, camera }
    }

    /// The map as bytes (`cairn_session::Drawn`): what has changed since the last, or the whole of it.
    pub fn map(&mut self, session: &Session<Engine>, whole: bool) -> Vec<u8> {
        let before = std::mem::take(&mut self.map);
        self.map = Drawn::of(&session.view(MOST_POINTS), &before);
        self.map.message(Some(&before).filter(|_| !whole))
    }
}
