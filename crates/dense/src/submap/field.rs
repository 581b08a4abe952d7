//! The field of a submap: whole, or released to save memory. A released one is fused again from the stored depth when somebody
//! is to read it.

use crate::block::{BlockKey, KeyHasher};
use crate::{DenseError, DepthFrame, Fused, TsdfConfig, TsdfVolume};
use cairn_geometry::Se3;
use std::collections::HashSet;
use std::hash::BuildHasherDefault;
use std::sync::Arc;

type Blocks = HashSet<BlockKey, BuildHasherDefault<KeyHasher>>;

/// The field of a submap.
pub(super) enum Field {
    /// Shared with searches that run meanwhile: it is copied where it changes before they end.
    Whole(Arc<TsdfVolume>),
    Released(Released),
}

/// What is left of a field.
pub(super) struct Released {
    /// Its blocks, and those around what was added since.
    blocks: Blocks,
    revision: u64,
    /// The field fused again, with the next of its frames.
    again: Option<(Box<TsdfVolume>, usize)>,
}

impl Field {
    /// An empty one.
    ///
    /// # Errors
    /// A config value out of range.
    pub fn new(config: TsdfConfig) -> Result<Self, DenseError> {
        TsdfVolume::new(config).map(|volume| Self::Whole(Arc::new(volume)))
    }

    /// The field, unless it is released.
    pub fn whole(&self) -> Option<&Arc<TsdfVolume>> {
        match self {
            Self::Whole(volume) => Some(volume),
            Self::Released(_) => None,
        }
    }

    /// Fuses the image of this number; `blocks` are those around its surface.
    ///
    /// # Errors
    /// As [`TsdfVolume::integrate`].
    pub fn add(
        &mut self,
        number: usize,
        frame: &DepthFrame,
        pose: &Se3,
        blocks: &[BlockKey],
    ) -> Result<Fused, DenseError> {
        match self {
            Self::Whole(volume) => Arc::make_mut(volume).integrate(frame, None, pose),
            Self::Released(left) => {
                let fused = left.having(number).map(|volume| volume.integrate(frame, None, pose));
                left.blocks.extend(blocks);
                left.revision += 1;
                fused.unwrap_or(Ok(Fused::default()))
            }
        }
    }

    /// Removes the image of this number, which was fused with this pose.
    ///
    /// # Errors
    /// As [`TsdfVolume::remove`].
    pub fn remove(&mut self, number: usize, frame: &DepthFrame, pose: &Se3) -> Result<(), DenseError> {
        let volume = match self {
            Self::Whole(volume) => Some(Arc::make_mut(volume)),
            Self::Released(left) => {
                left.revision += 1;
                left.having(number)
            }
        };
        volume.map_or(Ok(()), |volume| volume.remove(frame, pose).map(drop))
    }

    /// Releases it.
    pub fn release(&mut self) {
        if let Self::Whole(volume) = self {
            let (blocks, revision) = (volume.changed_since(0).collect(), volume.revision());
            *self = Self::Released(Released { blocks, revision, again: None });
        }
    }

    /// Fuses one more frame of a released one: `next` gives the first from a number on, prepared, with its pose and its number.
    /// Without more frames it is whole again.
    ///
    /// # Errors
    /// A config value out of range.
    pub fn fuse_next<'a>(
        &mut self,
        config: TsdfConfig,
        next: impl FnOnce(usize) -> Option<(Result<&'a DepthFrame, DenseError>, Se3, usize)>,
    ) -> Result<(), DenseError> {
        let Self::Released(left) = self else { return Ok(()) };
        let (mut volume, from) = match left.again.take() {
            Some(partial) => partial,
            None => (Box::new(TsdfVolume::new(config)?.continuing(left.revision)), 0),
        };
        match next(from) {
            Some((frame, pose, number)) => {
                if let Ok(frame) = frame {
                    // A pose that was accepted before is accepted again.
                    let _ = volume.integrate(frame, None, &pose);
                }
                left.again = Some((volume, number + 1));
            }
            None => {
                let revision = left.revision.max(volume.revision());
                *self = Self::Whole(Arc::new(volume.continuing(revision)));
            }
        }
        Ok(())
    }

    /// The frame of this number has been dropped, so that later ones have other numbers.
    pub fn without(&mut self, number: usize) {
        if let Self::Released(Released { again: Some((_, next)), .. }) = self {
            *next -= usize::from(*next > number);
        }
    }

    /// Whether a block is in it.
    pub fn has(&self, key: BlockKey) -> bool {
        match self {
            Self::Whole(volume) => volume.slot(key).is_some(),
            Self::Released(left) => left.blocks.contains(&key),
        }
    }

    /// Incremented by every image fused or removed.
    pub fn revision(&self) -> u64 {
        match self {
            Self::Whole(volume) => volume.revision(),
            Self::Released(left) => left.revision,
        }
    }

    /// Bytes, tables included.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Whole(volume) => volume.bytes(),
            Self::Released(left) => {
                left.blocks.capacity() * 13 + left.again.as_ref().map_or(0, |(volume, _)| volume.bytes())
            }
        }
    }
}

impl Released {
    /// The field fused again, where the frame of this number is in it already.
    fn having(&mut self, number: usize) -> Option<&mut TsdfVolume> {
        self.again.as_mut().filter(|(_, next)| number < *next).map(|(volume, _)| &mut **volume)
    }
}
