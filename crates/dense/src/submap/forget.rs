//! Images are dropped for good: what they added to a submap is taken out again.

use super::{AnchorId, DenseMap};
use crate::DenseError;
use std::sync::Arc;

impl DenseMap {
    /// Drops the depth of a key frame, wherever it is anchored by now; false where there is none. The field is at once as if it had never
    /// been fused, free space after [`DenseMap::step`].
    ///
    /// # Errors
    /// An image that cannot be read; it is dropped all the same, and what it added stays.
    pub fn forget(&mut self, of: AnchorId) -> Result<bool, DenseError> {
        let Some(index) = self.kept.iter().position(|k| k.key_frame == Some(of)) else { return Ok(false) };
        let kept = self.kept.remove(index);
        self.waiting.retain(|&i| i != index);
        self.waiting.iter_mut().filter(|i| **i > index).for_each(|i| *i -= 1);
        for (_, next) in self.submaps.iter_mut().flatten().filter_map(|s| s.rebuilt.as_mut()) {
            *next -= usize::from(*next > index);
        }
        let Some(was) = kept.inside else { return Ok(true) };
        let colours = self.preparer.colours_packed(kept.gray.as_ref(), &mut self.colours)?;
        let frame = self.preparer.prepare_packed(&kept.depth)?;
        if let Some(submap) = self.submaps.get_mut(was.submap).and_then(Option::as_mut) {
            Arc::make_mut(&mut submap.tsdf).remove(frame, colours, &was.pose)?;
            (submap.stale, submap.rebuilt) = (true, None);
        }
        Ok(true)
    }
}
