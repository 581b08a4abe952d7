//! `places`: place recognition on photographs with a loop matrix, and by ground-truth poses on worlds and recordings.

pub mod loops;
pub mod page;
pub mod recall;
pub mod times;

use crate::MeasureError;
use crate::error::{file, of};
use cairn_sensor::GrayImage;
use cairn_sources::{OpenOptions, open};
use cairn_vision::bow::{BagOfWords, Vocabulary};
use cairn_vision::{Descriptor, Features, OrbConfig, OrbExtractor};
use std::path::{Path, PathBuf};

/// The features and the bag of words of one image.
#[derive(Clone, Debug)]
pub struct View {
    /// Its features.
    pub features: Features,
    /// Its bag of words.
    pub bag: BagOfWords,
}

impl View {
    /// Extracts features and words.
    pub fn of(extractor: &mut OrbExtractor, image: &GrayImage, vocabulary: &Vocabulary) -> Self {
        let mut features = Features::default();
        extractor.extract(image, &mut features);
        let bag = vocabulary.bag(&features.descriptors);
        Self { features, bag }
    }
}

/// The feature extractor, with its default configuration.
pub fn extractor() -> OrbExtractor {
    OrbExtractor::new(OrbConfig::default())
}

/// The worlds, with seeds that no vocabulary was trained on; each is walked twice.
const WORLDS: [&str; 6] = [
    "sim:corridor?seed=3",
    "sim:corridor?seed=8&poor=0.5",
    "sim:office?seed=4",
    "sim:office?seed=7&look_alike=1",
    "sim:hall?seed=5",
    "sim:street?seed=6",
];
/// The two walks, as options of the world.
const WALKS: [&str; 2] = [
    "&way=long&sensor=mono&rate=1&duration=100",
    "&way=long&sensor=mono&rate=1&duration=100&height=1.6&look=12&pitch=9&speed=1.1&exposure=0.4&noise=5&passers=4",
];
/// The recordings; they have ground truth.
const RECORDINGS: [&str; 2] = ["7scenes-kitchen", "euroc-mh01"];

/// The figures of each vocabulary (the built-in one if none is named), as text.
///
/// # Errors
/// When an existing input cannot be read.
pub fn run(
    data: &Path,
    vocabularies: &[PathBuf],
    only_loops: bool,
    verbose: bool,
) -> Result<String, MeasureError> {
    let mut views = Vec::new();
    if !only_loops {
        for world in WORLDS {
            let walk = |more: &str| {
                let source = open(&format!("{world}{more}"), OpenOptions::default());
                recall::Views::read(world, source?.as_mut(), 1.0)
            };
            views.push(walk(WALKS[0])?.with(walk(WALKS[1])?));
        }
        for name in RECORDINGS {
            let folder = data.join(name);
            if !folder.exists() {
                eprintln!("skipped: {name} is not in {}", data.display());
                continue;
            }
            let mut source = open(&folder.to_string_lossy(), OpenOptions::default())?;
            views.push(recall::Views::read(name, source.as_mut(), 0.2)?);
        }
    }
    let others: Vec<Vocabulary> = vocabularies
        .iter()
        .map(|path| {
            let bytes = std::fs::read(path).map_err(file(path))?;
            Vocabulary::open(bytes).map_err(|e| of(path.display(), e.to_string()))
        })
        .collect::<Result<_, MeasureError>>()?;
    let chosen: Vec<&Vocabulary> =
        if others.is_empty() { vec![Vocabulary::embedded()] } else { others.iter().collect() };
    let mut text = String::new();
    for vocabulary in chosen {
        let walk = loops::read(data, vocabulary)?;
        if walk.is_none() {
            eprintln!("skipped: loops is not in {}", data.display());
        }
        let pairs = walk.as_ref().map_or(Vec::new(), |w| w.verified(loops::CANDIDATES));
        if verbose {
            let mut pairs = pairs.clone();
            pairs.sort_by_key(|p| p.inliers);
            for p in pairs {
                eprintln!(
                    "{} {}-{}: score {:.4}, {} matches, {} inliers, false alarms 10^{:.1}",
                    if p.truth { "same " } else { "other" },
                    p.query + 1,
                    p.earlier + 1,
                    p.score,
                    p.matches,
                    p.inliers,
                    p.log10_false_alarms
                );
            }
        }
        let recalls: Vec<recall::Recall> = views.iter().map(|v| v.recall(vocabulary)).collect();
        let frames: Vec<Vec<Descriptor>> =
            walk.iter().flat_map(|w| w.views.iter().map(|s| s.features.descriptors.clone())).collect();
        let times = vocabularies.is_empty().then(|| times::measure(&frames));
        text += &page::tables(&page::Figures {
            walk: walk.as_ref(),
            pairs: &pairs,
            recalls: &recalls,
            times: times.as_ref(),
            facts: vocabulary.facts(),
        });
    }
    Ok(text)
}
