//! Ids in an atlas: ordered by creation, never reused; an unknown id is answered with `None`. Who created what, on which
//! robot, is in `names.rs`.

use std::num::NonZeroU32;

macro_rules! id {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(NonZeroU32);

        impl $name {
            /// The first id.
            pub const FIRST: Self = Self(NonZeroU32::MIN);

            /// The id with this index in order of creation, from 0; `None` when the index is too large.
            pub fn from_index(index: usize) -> Option<Self> {
                u32::try_from(index).ok()?.checked_add(1).and_then(NonZeroU32::new).map(Self)
            }

            /// The id with this number, from 1; `None` for 0.
            pub(crate) fn from_raw(raw: u32) -> Option<Self> {
                NonZeroU32::new(raw).map(Self)
            }

            pub(crate) fn raw(self) -> u32 {
                self.0.get()
            }

            /// Index in order of creation, from 0.
            pub fn index(self) -> usize {
                (self.0.get() - 1) as usize
            }
        }
    };
}

id!(
    /// A key frame.
    KeyFrameId
);
id!(
    /// A landmark.
    LandmarkId
);
