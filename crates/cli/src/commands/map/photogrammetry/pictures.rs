//! The pictures of key frames: images of the recording that the map was made from, rectified, so that a pinhole is exact.

use super::pinhole::Pinhole;
use crate::commands::rig::noted_rig_for;
use crate::failure::Failure;
use crate::output::warn;
use crate::outputs::folder as make_folder;
use cairn_atlas::store::MapFile;
use cairn_atlas::{KeyFrame, KeyFrameId, LandmarkId, MapId};
use cairn_eval::write_bytes_whole;
use cairn_geometry::Vec2;
use cairn_sensor::{GrayImage, Rig, Source, Stamp};
use cairn_sources::{OpenOptions, Validator, open};
use cairn_vision::{Frame, FrontEnd, FrontEndConfig, RectifiedCamera, Rectifier, SensorMode, hamming};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Features of two frames are of the same corner within so many pixels (a rolling shutter's are moved) and differing bits.
const SAME_PX: f32 = 8.0;
const SAME_BITS: u32 = 40;
/// Frames of the same image share at least this much, also where other settings found other corners.
const SAME_SHARE: f64 = 0.1;

/// The name of a key frame's picture.
pub fn picture_name(id: KeyFrameId) -> String {
    format!("kf_{:06}.png", id.index())
}

/// What was written.
#[derive(Default)]
pub struct Pictures {
    /// Key frames with a picture.
    pub written: BTreeSet<KeyFrameId>,
    /// Key frames without.
    pub missing: usize,
    /// Luminance of landmarks where a picture shows them first.
    pub luminance: BTreeMap<LandmarkId, u8>,
    /// Which pixels are of the world, as PNG, where not all are.
    pub mask: Option<Vec<u8>>,
}

/// Writes the picture of each key frame into all these folders.
///
/// # Errors
/// When the recording cannot be read, has another camera than the map, has no image of a key frame, or a file cannot be
/// written.
pub fn write(
    (source, rig): (&str, Option<&Path>),
    file: &MapFile,
    id: MapId,
    folders: &[PathBuf],
) -> Result<Pictures, Failure> {
    let rig = rig.map(|path| noted_rig_for(path, source)).transpose()?;
    let options = OpenOptions { rig, cancel: crate::interrupt::cancel(), ..OpenOptions::default() };
    let mut images = Validator::new(open(source, options)?, warn);
    let pinhole = Pinhole::of(&file.about.camera);
    let rig = calibration(&images, file);
    let (mut front_end, rectifier) = fitted(source, &rig, file)?;
    let rectified = Lookup::of(&rectifier, &rig, &pinhole);
    let key_frames = by_time(file, id);
    let mut pictures = Pictures { mask: rectified.mask().transpose()?, ..Pictures::default() };
    while let Some(packet) = images.next_packet()? {
        let (Some(k), Some(image)) = (key_frames.get(&packet.stamp), packet.images.first()) else { continue };
        if !front_end.extract(&packet).is_ok_and(|frame| is_of(k, &frame)) {
            continue;
        }
        let image = rectified.image(image);
        let png = png_of(&image)?;
        for folder in folders {
            make_folder(folder)?;
            write_bytes_whole(&folder.join(picture_name(k.id)), &png)?;
        }
        pictures.written.insert(k.id);
        for (px, landmark) in k.frame.px.iter().zip(&k.landmarks) {
            if let Some(landmark) = landmark {
                let at = Vec2::new(px[0].into(), px[1].into()) - pinhole.corner;
                pictures.luminance.entry(*landmark).or_insert_with(|| nearest(&image, at));
            }
        }
    }
    pictures.missing = file.snapshot.key_frames_of(id).count() - pictures.written.len();
    if pictures.written.is_empty() {
        let why = "no image is that of a key frame of the map";
        return Err(Failure::new(source, why, "give the recording that the map was made from"));
    }
    Ok(pictures)
}

/// The key frames that this recording may show: those of the atlas's camera whose time no other has.
fn by_time(file: &MapFile, id: MapId) -> BTreeMap<Stamp, &KeyFrame> {
    let mut of_time: BTreeMap<Stamp, Vec<&KeyFrame>> = BTreeMap::new();
    for k in file.snapshot.key_frames_of(id).filter(|k| k.other_camera.is_none()) {
        of_time.entry(k.stamp).or_default().push(k);
    }
    of_time
        .into_iter()
        .filter_map(|(at, all)| if let [one] = all[..] { Some((at, one)) } else { None })
        .collect()
}

/// Whether a key frame was made from the image of this frame: recordings that begin at zero have the same times.
fn is_of(k: &KeyFrame, frame: &Frame) -> bool {
    let found = k.frame.px.iter().zip(&k.frame.descriptors).filter(|(px, descriptor)| {
        let mut same = false;
        frame
            .near(px[0], px[1], SAME_PX, |i| same |= hamming(descriptor, &frame.descriptors[i]) <= SAME_BITS);
        same
    });
    found.count() as f64 >= SAME_SHARE * k.frame.len() as f64
}

/// The calibration of a recording; where it is only assumed, its focal lengths are those that the run found.
fn calibration(images: &dyn Source, file: &MapFile) -> Rig {
    let mut rig = images.rig().clone();
    let assumed = images.info().assumed.is_some() && file.about.sensor == SensorMode::Mono;
    if let Some(first) = rig.cameras.first_mut().filter(|_| assumed) {
        (first.camera.fx, first.camera.fy) = (file.about.camera.fx, file.about.camera.fy);
    }
    rig
}

/// The front end of a recording, and the way from its first image to the camera of the map.
fn fitted(source: &str, rig: &Rig, file: &MapFile) -> Result<(FrontEnd, Rectifier), Failure> {
    let other = |why: String| {
        Failure::new(
            source,
            why,
            "give the recording that the map was made from, and its calibration with --rig",
        )
    };
    let front_end =
        FrontEnd::new(rig, file.about.sensor, FrontEndConfig::default()).map_err(|e| other(e.to_string()))?;
    let (of_rig, of_map, octaves) = (front_end.model(), &file.about.camera, file.snapshot.octaves());
    // Of a pair only the first image is shown.
    let of_rig = RectifiedCamera { baseline_fx: of_map.baseline_fx / of_map.fx * of_rig.fx, ..*of_rig };
    file.about.fits(octaves, file.about.sensor, &of_rig, octaves).map_err(|e| other(e.to_string()))?;
    // The front end has checked that there is one.
    let first = rig.cameras.first().ok_or_else(|| other("has no camera".into()))?;
    let rectified_from_raw = of_rig.body_from_camera.rotation.inverse() * first.body_from_camera.rotation;
    let (focal, centre) = (Vec2::new(of_map.fx, of_map.fy), Vec2::new(of_map.cx, of_map.cy));
    Ok((front_end, Rectifier::new(&first.camera, &rectified_from_raw, focal, centre)))
}

/// Where each pixel of a picture is in the image; `None` where the image does not show it.
struct Lookup {
    width: usize,
    height: usize,
    raw: Vec<Option<Vec2>>,
}

impl Lookup {
    fn of(rectifier: &Rectifier, rig: &Rig, pinhole: &Pinhole) -> Self {
        let (width, height) = (pinhole.width, pinhole.height);
        let raw_of = |i: usize| {
            let centre = pinhole.corner + Vec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let raw = rectifier.raw([centre.x, centre.y])?;
            rig.cameras.first().is_some_and(|c| c.camera.contains(&raw)).then_some(raw)
        };
        Self { width, height, raw: (0..width * height).map(raw_of).collect() }
    }

    /// Bilinear between the four pixels around each place.
    fn image(&self, from: &GrayImage) -> GrayImage {
        let pixel = |raw: &Option<Vec2>| {
            let Some(raw) = raw else { return 0 };
            let (x, y) = (raw.x.floor() as usize, raw.y.floor() as usize);
            let (u, v) = (raw.x.fract(), raw.y.fract());
            let (right, below) = ((x + 1).min(from.width() - 1), (y + 1).min(from.height() - 1));
            let row = |y: usize| f64::from(from.at(x, y)) * (1.0 - u) + f64::from(from.at(right, y)) * u;
            (row(y) * (1.0 - v) + row(below) * v).round() as u8
        };
        let mut image = GrayImage::new(self.width, self.height);
        image.data_mut().iter_mut().zip(&self.raw).for_each(|(to, raw)| *to = pixel(raw));
        image
    }

    /// White where the image shows something.
    fn mask(&self) -> Option<Result<Vec<u8>, Failure>> {
        let mut mask = GrayImage::new(self.width, self.height);
        mask.data_mut()
            .iter_mut()
            .zip(&self.raw)
            .for_each(|(to, raw)| *to = if raw.is_some() { 255 } else { 0 });
        self.raw.iter().any(Option::is_none).then(|| png_of(&mask))
    }
}

fn nearest(image: &GrayImage, at: Vec2) -> u8 {
    let inside = |v: f64, side: usize| (v.max(0.0) as usize).min(side - 1);
    image.at(inside(at.x, image.width()), inside(at.y, image.height()))
}

fn png_of(image: &GrayImage) -> Result<Vec<u8>, Failure> {
    let fail =
        |e: png::EncodingError| Failure::new("a picture", e.to_string(), "report this with the command line");
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width() as u32, image.height() as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(fail)?;
    writer.write_image_data(image.data()).map_err(fail)?;
    writer.finish().map_err(fail)?;
    Ok(bytes)
}
