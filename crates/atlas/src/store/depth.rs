//! Depth images of key frames in a saved map: attached parts, one or more a submap, so that a damaged one costs the rest
//! nothing. Programs that do not know them keep them as they are.
//!
//! ```text
//! layout u8 = 2 or 3 | camera: width u32, height u32, fx fy cx cy f64, lens text, coefficients u8 and f64 each
//! metres per unit f64 | submap: place | images u32
//! image: place | bytes u32 | the compressed image | in layout 3: bytes u32 | the compressed gray image, which may be empty
//! place: robot u16 and number u32 of a key frame, pose there as quaternion (x y z w) and translation, 7 f64
//! ```
//!
//! Layout 1 differs only in how the images are compressed, and compressed images tell that themselves: both are read.
//! The number went up so that programs that know only the older compression say so. Layout 3 is written only where images have colours.

use super::about::{numbers, pose};
use super::error::StoreError;
use super::layout::{ATTACHED, MapFile};
use super::wire::{Decoder, Encoder};
use crate::{KeyFrameName, Shift};
use cairn_geometry::Se3;
use cairn_sensor::{Camera, Distortion};
use std::sync::Arc;

/// Prefix of the names of attached parts that hold depth.
pub const DEPTH_PREFIX: &str = "depth/";
/// The layouts that are written; all older ones are read.
const LAYOUT: u8 = 2;
const WITH_GRAY: u8 = 3;
/// Images in one part: at about 0.2 MB each, a damaged part costs a few metres of a walk.
const IMAGES: usize = 32;
/// Pixels of a depth image, at most.
const MOST_PIXELS: usize = 1 << 25;

/// A pose in the frame of a key frame's camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The key frame.
    pub key_frame: KeyFrameName,
    /// The pose there, in metres.
    pub key_frame_from_it: Se3,
}

/// A depth image.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedDepth {
    /// Where the depth camera was.
    pub place: Place,
    /// The image, compressed; the store does not look into it.
    pub packed: Arc<[u8]>,
    /// What the same pixels look like, compressed likewise; empty where that is not known.
    pub gray: Arc<[u8]>,
}

/// Depth images that belong to one submap.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthPart {
    /// The depth camera.
    pub camera: Camera,
    /// Metres of a pixel's unit.
    pub metres_per_unit: f64,
    /// The submap's own frame.
    pub submap: Place,
    /// The images, oldest first.
    pub images: Vec<SavedDepth>,
}

impl DepthPart {
    fn encode(&self, images: &[SavedDepth]) -> Vec<u8> {
        let mut e = Encoder::default();
        let has_gray = images.iter().any(|image| !image.gray.is_empty());
        e.u8(if has_gray { WITH_GRAY } else { LAYOUT });
        let c = &self.camera;
        e.u32(c.width as u32);
        e.u32(c.height as u32);
        e.f64s(&[c.fx, c.fy, c.cx, c.cy]);
        e.text(c.distortion.name());
        let coefficients = c.distortion.coefficients();
        e.u8(coefficients.len() as u8);
        e.f64s(&coefficients);
        e.f64(self.metres_per_unit);
        encode_place(&mut e, &self.submap);
        e.u32(images.len() as u32);
        for image in images {
            encode_place(&mut e, &image.place);
            e.u32(image.packed.len() as u32);
            e.0.extend_from_slice(&image.packed);
            if has_gray {
                e.u32(image.gray.len() as u32);
                e.0.extend_from_slice(&image.gray);
            }
        }
        e.0
    }

    fn decode(name: &str, bytes: &[u8]) -> Result<Self, StoreError> {
        let mut d = Decoder::new(name, bytes);
        let layout = d.u8()?;
        if !(1..=WITH_GRAY).contains(&layout) {
            let why = format!("depth in layout {layout}, this program reads 1 to {WITH_GRAY}");
            return Err(d.wrong(why));
        }
        let camera = decode_camera(&mut d)?;
        let metres_per_unit = d.f64()?;
        if !(metres_per_unit.is_finite() && metres_per_unit > 0.0) {
            return Err(d.wrong(format!("depth in units of {metres_per_unit} m")));
        }
        let submap = decode_place(&mut d)?;
        let count = d.u32()?;
        let mut images = Vec::new();
        for _ in 0..count {
            let place = decode_place(&mut d)?;
            let length = d.u32()? as usize;
            let packed = d.bytes(length)?.into();
            let length = if layout == WITH_GRAY { d.u32()? as usize } else { 0 };
            images.push(SavedDepth { place, packed, gray: d.bytes(length)?.into() });
        }
        d.end()?;
        Ok(Self { camera, metres_per_unit, submap, images })
    }
}

fn encode_place(e: &mut Encoder, place: &Place) {
    e.0.extend(place.key_frame.robot.to_le_bytes());
    e.u32(place.key_frame.seq);
    e.f64s(&numbers(&place.key_frame_from_it));
}

fn decode_place(d: &mut Decoder) -> Result<Place, StoreError> {
    let robot = d.column_u16(1)?[0];
    let key_frame = KeyFrameName { robot, seq: d.u32()? };
    let key_frame_from_it = pose(d.f64s()?).ok_or_else(|| d.wrong("a pose is invalid"))?;
    Ok(Place { key_frame, key_frame_from_it })
}

fn decode_camera(d: &mut Decoder) -> Result<Camera, StoreError> {
    let (width, height) = (d.u32()? as usize, d.u32()? as usize);
    let [fx, fy, cx, cy] = d.f64s()?;
    let lens = d.text()?;
    let count = d.u8()?;
    let coefficients = (0..count).map(|_| d.f64()).collect::<Result<Vec<_>, _>>()?;
    let distortion = Distortion::from_parts(&lens, &coefficients)
        .ok_or_else(|| d.wrong(format!("a lens '{lens}' with {count} coefficients is unknown")))?;
    let camera = Camera { width, height, fx, fy, cx, cy, distortion };
    camera.validate().map_err(|e| d.wrong(format!("the depth camera is invalid: {e}")))?;
    if width * height > MOST_PIXELS {
        return Err(d.wrong(format!("depth images of {width}x{height} pixels are too large")));
    }
    Ok(camera)
}

impl MapFile {
    /// The depth of key frames in the order of its parts; empty where the map carries none.
    ///
    /// # Errors
    ///
    /// [`StoreError::Part`] for one of another layout, or that does not follow it.
    pub fn depth(&self) -> Result<Vec<DepthPart>, StoreError> {
        let parts = self.attached.iter().filter(|(name, _)| name.starts_with(DEPTH_PREFIX));
        parts.map(|(name, bytes)| DepthPart::decode(&format!("{ATTACHED}{name}"), bytes)).collect()
    }

    /// Bytes of the attached depth.
    pub fn depth_bytes(&self) -> usize {
        let parts = self.attached.iter().filter(|(name, _)| name.starts_with(DEPTH_PREFIX));
        parts.map(|(_, bytes)| bytes.len()).sum()
    }

    /// Adds depth under names that are free.
    pub fn add_depth(&mut self, parts: &[DepthPart]) {
        let mut number = 0;
        for part in parts {
            for images in part.images.chunks(IMAGES) {
                let mut name = format!("{DEPTH_PREFIX}{number:05}");
                while self.attached.contains_key(&name) {
                    number += 1;
                    name = format!("{DEPTH_PREFIX}{number:05}");
                }
                self.attached.insert(name, part.encode(images));
            }
        }
    }

    /// Takes the depth out.
    ///
    /// # Errors
    ///
    /// As [`MapFile::depth`]; the file is then unchanged.
    pub fn take_depth(&mut self) -> Result<Vec<DepthPart>, StoreError> {
        let parts = self.depth()?;
        self.attached.retain(|name, _| !name.starts_with(DEPTH_PREFIX));
        Ok(parts)
    }
}

impl DepthPart {
    /// The same where robots have other numbers.
    pub fn renamed(mut self, shift: &Shift) -> Self {
        let places = self.images.iter_mut().map(|image| &mut image.place);
        for place in places.chain([&mut self.submap]) {
            place.key_frame.robot = shift.robot(place.key_frame.robot);
        }
        self
    }
}
