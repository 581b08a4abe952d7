//! Mapping and closing inline, in step with tracking.

use super::done::Done;
use super::work::{take, text_of};
use cairn_atlas::{Atlas, KeyFrameId};
use cairn_mapping::{Closer, Mapper};
use cairn_tracking::KeyFrameRequest;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// The stages and the atlas they write to.
pub(crate) struct Inline {
    pub mapper: Mapper,
    pub closer: Closer,
    pub atlas: Atlas,
    /// Ends adjustments of whole maps early.
    pub stop: Arc<AtomicBool>,
}

impl Inline {
    /// Processes a request, and runs closing after it.
    pub fn submit(&mut self, request: &KeyFrameRequest, done: &mut Done) -> Option<KeyFrameId> {
        let Self { mapper, closer, atlas, stop } = self;
        let start = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| take(mapper, atlas, request, || false)));
        done.ms.push(start.elapsed().as_secs_f64() * 1e3);
        let closed = result.and_then(|taken| {
            let id = done.taken(taken);
            catch_unwind(AssertUnwindSafe(|| close_inline(closer, atlas, id, stop, done))).map(|()| id)
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
}

/// Runs closing for a key frame, and the adjustment of the whole map after it.
fn close_inline(
    closer: &mut Closer,
    atlas: &mut Atlas,
    id: Option<KeyFrameId>,
    stop: &AtomicBool,
    done: &mut Done,
) {
    let Some(id) = id else { return };
    let start = Instant::now();
    let closed = closer.step(atlas.latest(), id);
    done.verdicts.extend(closed.verdicts);
    atlas.commit(closed.changes);
    done.close_ms.push(start.elapsed().as_secs_f64() * 1e3);
    if let Some(map) = closed.joined.and_then(|id| atlas.latest().key_frame(id)).map(|k| k.map) {
        let start = Instant::now();
        let changes = closer.adjust_whole(atlas.latest(), map, || stop.load(Ordering::Relaxed));
        atlas.commit(changes);
        done.close_ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
}
