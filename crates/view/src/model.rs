//! The map as `cairn-session` describes it by differences (its `drawn.rs` has the format): points, key frames, loops, routes.

use crate::read::{Malformed, Reader};
use crate::vector::V3;
use std::collections::BTreeMap;

/// A key frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyFrame {
    /// Where it is.
    pub place: V3,
    /// The map it belongs to.
    pub map: u32,
}

/// What was told of the map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// The direction up.
    pub up: V3,
    /// Landmarks by their numbers, which are in the order in which they were found.
    pub points: BTreeMap<u32, V3>,
    /// Key frames by their numbers.
    pub key_frames: BTreeMap<u32, KeyFrame>,
    /// Pairs of key frames that see the same place.
    pub loops: Vec<[u32; 2]>,
    /// The route as recorded.
    pub recorded: Vec<V3>,
    /// The cleaned route.
    pub plan: Vec<V3>,
}

impl Model {
    /// Takes a message of kind 2.
    ///
    /// # Errors
    /// One that is cut off or too long.
    pub fn take(&mut self, message: &[u8]) -> Result<(), Malformed> {
        let mut r = Reader(message);
        let [_, whole, ..] = r.bytes::<4>()?;
        if whole == 1 {
            *self = Self::default();
        }
        let step = r.float()?;
        self.up = r.floats()?;
        let place = |r: &mut Reader| -> Result<V3, Malformed> {
            Ok([r.short()?, r.short()?, r.short()?].map(|v| step * f32::from(v.cast_signed())))
        };
        r.each(|r| {
            self.points.remove(&r.number()?);
            Ok(())
        })?;
        r.each(|r| {
            self.points.insert(r.number()?, place(r)?);
            Ok(())
        })?;
        r.each(|r| {
            self.key_frames.remove(&r.number()?);
            Ok(())
        })?;
        r.each(|r| {
            self.key_frames.insert(r.number()?, KeyFrame { place: place(r)?, map: r.number()? });
            Ok(())
        })?;
        self.loops.clear();
        r.each(|r| {
            self.loops.push([r.number()?, r.number()?]);
            Ok(())
        })?;
        for line in [&mut self.recorded, &mut self.plan] {
            line.truncate(r.number()? as usize);
            r.each(|r| {
                line.push(place(r)?);
                Ok(())
            })?;
        }
        r.end()
    }
}
