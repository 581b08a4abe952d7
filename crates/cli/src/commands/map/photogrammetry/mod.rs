//! `cairn map export --colmap`, `--nerfstudio`: a map for photogrammetry, with or without pictures.

mod colmap;
mod model;
mod nerfstudio;
mod pictures;
mod pinhole;

use crate::failure::Failure;
use crate::output::note;
use crate::outputs::folder;
use cairn::Map;
use cairn_atlas::MapId;
use cairn_atlas::store::MapFile;
use cairn_eval::write_bytes_whole;
use model::Model;
use pictures::Pictures;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The pictures in each folder, and which of their pixels are of the world.
const IMAGES: &str = "images";
const MASK: &str = "mask.png";

/// Models for photogrammetry.
#[derive(clap::Args)]
pub struct Arguments {
    /// Writes a COLMAP text model into this folder: key frames as images of a pinhole camera with their features, landmarks as
    /// points.
    #[arg(long, value_name = "DIR")]
    colmap: Option<PathBuf>,
    /// Writes nerfstudio's transforms.json into this folder, with landmarks as points.ply.
    #[arg(long, value_name = "DIR")]
    nerfstudio: Option<PathBuf>,
    /// The recording that the map was made from: its images are written beside the model, rectified and without colour.
    #[arg(long, value_name = "SOURCE")]
    images: Option<String>,
    /// The calibration of that recording, if the map was made with --rig.
    #[arg(long, value_name = "FILE", requires = "images")]
    rig: Option<PathBuf>,
}

/// What was written.
#[derive(Serialize)]
pub struct Report {
    pub folders: Vec<PathBuf>,
    pub views: usize,
    pub points: usize,
    /// Mean distance between features and projections.
    pub error_px: f64,
    pub pictures: usize,
    /// Whether lengths are metres.
    pub metric: bool,
}

impl Arguments {
    /// Whether a model is requested.
    ///
    /// # Errors
    /// Wrong usage where there are images for none.
    pub fn is_requested(&self) -> Result<bool, Failure> {
        let requested = self.colmap.is_some() || self.nerfstudio.is_some();
        match (requested, &self.images) {
            (false, Some(images)) => {
                let why = "images are written beside a model";
                Err(Failure::usage(format!("--images {images}"), why, "add --colmap DIR or --nerfstudio DIR"))
            }
            _ => Ok(requested),
        }
    }

    fn folders(&self) -> impl Iterator<Item = &PathBuf> {
        self.colmap.iter().chain(&self.nerfstudio)
    }

    /// Makes the folders; what a model is known by must not be there yet, unless it may be replaced.
    ///
    /// # Errors
    /// When a folder cannot be made, or has a model.
    pub fn prepare(&self, overwrite: bool) -> Result<(), Failure> {
        let known = [(&self.colmap, "cameras.txt"), (&self.nerfstudio, "transforms.json")];
        for (dir, name) in known.iter().filter_map(|(dir, name)| Some((dir.as_deref()?, *name))) {
            folder(dir)?;
            let there = [name, IMAGES].map(|name| dir.join(name)).into_iter().find(|path| path.exists());
            if let Some(path) = there.filter(|_| !overwrite) {
                let hint = "give another folder, or --overwrite to replace it";
                return Err(Failure::new(path.display().to_string(), "it exists already", hint));
            }
        }
        Ok(())
    }

    /// Writes the models.
    ///
    /// # Errors
    /// When the recording is not the map's or cannot be read, the map cannot be read, or a file cannot be written.
    pub fn write(&self, path: &Path, file: &MapFile, map: &Map, id: MapId) -> Result<Report, Failure> {
        let pictures = self.images.as_deref().map(|source| self.pictures(source, file, id)).transpose()?;
        let model = Model::of(map, id, pictures.as_ref());
        if let Some(fault) = map.snapshot().read_fault() {
            return Err(Failure::new(path.display().to_string(), fault.to_string(), "see cairn map check"));
        }
        match &pictures {
            None => note("note: the model has no pictures: give the recording with --images SOURCE"),
            Some(p) if p.missing > 0 => {
                note(&format!(
                    "note: {} key frames have no image in the recording and are left out",
                    p.missing
                ));
            }
            Some(_) => {}
        }
        let mask = pictures.as_ref().and_then(|p| p.mask.as_deref());
        if let Some(dir) = &self.colmap {
            save(dir, &colmap::files(&model), mask)?;
        }
        if let Some(dir) = &self.nerfstudio {
            save(dir, &nerfstudio::files(&model, IMAGES, mask.map(|_| MASK)), mask)?;
        }
        Ok(Report {
            folders: self.folders().cloned().collect(),
            views: model.views.len(),
            points: model.points.len(),
            error_px: model.error_px(),
            pictures: pictures.map_or(0, |p| p.written.len()),
            metric: model.metric,
        })
    }

    fn pictures(&self, source: &str, file: &MapFile, id: MapId) -> Result<Pictures, Failure> {
        let folders: Vec<PathBuf> = self.folders().map(|dir| dir.join(IMAGES)).collect();
        pictures::write((source, self.rig.as_deref()), file, id, &folders)
    }
}

fn save(dir: &Path, files: &[(&'static str, String)], mask: Option<&[u8]>) -> Result<(), Failure> {
    for (name, content) in files {
        write_bytes_whole(&dir.join(name), content.as_bytes())?;
    }
    mask.map_or(Ok(()), |png| Ok(write_bytes_whole(&dir.join(MASK), png)?))
}

impl Report {
    /// Lines for people.
    pub fn text(&self) -> String {
        let unit = if self.metric { "metres" } else { "lengths have no unit" };
        let Self { views, points, error_px, pictures, .. } = self;
        format!("model     {views} views, {points} points, {error_px:.2} px, {pictures} pictures; {unit}\n")
    }
}
