//! Images are dropped for good: what they added to a submap is taken out again.

use super::{AnchorId, DenseMap, Inside, Kept};
use crate::DenseError;

impl DenseMap {
    /// Drops the depth of a key frame, wherever it is anchored by now; false where there is none. The field is at once as if it had never
    /// been fused, free space after [`DenseMap::step`].
    ///
    /// # Errors
    /// An image that cannot be read; it is dropped all the same, and what it added stays.
    pub fn forget(&mut self, of: AnchorId) -> Result<bool, DenseError> {
        let Some(index) = self.kept.iter().position(|k| k.key_frame == Some(of)) else { return Ok(false) };
        let kept = self.kept.remove(index);
        let removed = kept.inside.map_or(Ok(()), |was| self.take_out(index, &kept, &was));
        self.waiting.retain(|&i| i != index);
        self.waiting.iter_mut().filter(|i| **i > index).for_each(|i| *i -= 1);
        for submap in self.submaps.iter_mut().flatten() {
            if let Some((_, next)) = submap.rebuilt.as_mut() {
                *next -= usize::from(*next > index);
            }
            submap.field.without(index);
        }
        removed.map(|()| true)
    }

    fn take_out(&mut self, number: usize, kept: &Kept, was: &Inside) -> Result<(), DenseError> {
        let frame = self.preparer.prepare_packed(&kept.depth)?;
        if let Some(submap) = self.submaps.get_mut(was.submap).and_then(Option::as_mut) {
            submap.field.remove(number, frame, &was.pose)?;
            (submap.stale, submap.rebuilt) = (true, None);
        }
        Ok(())
    }
}
