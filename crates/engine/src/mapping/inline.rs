//! Mapping and closing inline, in step with tracking.

use super::done::Done;
use super::work::{take, text_of};
use cairn_atlas::{Atlas, KeyFrameId};
use cairn_mapping::{Closer, Mapper};
use cairn_sensor::Clock;
use cairn_tracking::KeyFrameRequest;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The stages and the atlas they write to.
pub(crate) struct Inline {
    pub mapper: Mapper,
    pub closer: Closer,
    pub atlas: Atlas,
    /// Ends adjustments of whole maps early.
    pub stop: Arc<AtomicBool>,
    pub clock: Clock,
}

impl Inline {
    /// Processes a request, and runs closing after it.
    pub fn submit(&mut self, request: &KeyFrameRequest, done: &mut Done) -> Option<KeyFrameId> {
        let start = self.clock.now();
        let Self { mapper, atlas, .. } = self;
        let result = catch_unwind(AssertUnwindSafe(|| take(mapper, atlas, request, || false)));
        done.ms.push(self.clock.ms_since(start));
        let closed = result.and_then(|taken| {
            let id = done.taken(taken);
            catch_unwind(AssertUnwindSafe(|| self.close(id, done))).map(|()| id)
        });
        closed.unwrap_or_else(|cause| {
            done.stage_failed = Some(text_of(&cause));
            None
        })
    }

    /// Runs the final bundle adjustment of all maps.
    pub fn final_adjustment(&mut self, done: &mut Done) {
        let stop = || self.stop.load(Ordering::Relaxed);
        if let Err(cause) =
            catch_unwind(AssertUnwindSafe(|| self.mapper.final_adjustment(&mut self.atlas, stop)))
        {
            done.stage_failed = Some(text_of(&cause));
        }
    }

    /// Runs closing for a key frame, and the adjustment of the whole map after it.
    fn close(&mut self, id: Option<KeyFrameId>, done: &mut Done) {
        let Some(id) = id else { return };
        let Self { closer, atlas, stop, clock, .. } = self;
        let start = clock.now();
        let closed = closer.step(atlas.latest(), id);
        done.verdicts.extend(closed.verdicts);
        atlas.commit(closed.changes);
        done.close_ms.push(clock.ms_since(start));
        if let Some(map) = closed.joined.and_then(|id| atlas.latest().key_frame(id)).map(|k| k.map) {
            let start = clock.now();
            let changes = closer.adjust_whole(atlas.latest(), map, || stop.load(Ordering::Relaxed));
            atlas.commit(changes);
            done.close_ms.push(clock.ms_since(start));
        }
    }
}
