//! `cairn vocab`: trains a vocabulary of visual words, tells what is in one, reads those of others.

use crate::failure::Failure;
use crate::output::Output;
use crate::progress::Progress;
use cairn_eval::write_bytes_whole;
use cairn_sources::read_gray;
use cairn_vision::bow::{Dbow2Error, TrainConfig, Vocabulary, VocabularyFacts, import_dbow2, train};
use cairn_vision::{Descriptor, Features, OrbConfig, OrbExtractor};
use serde::Serialize;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Trains, inspects and imports vocabularies of visual words.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Learns a vocabulary from images; the same images and seed give the same file.
    Train(Train),
    /// What is in a vocabulary file, after checking it; without a file, the one in this program.
    Info {
        /// The file.
        #[arg(value_name = "FILE")]
        file: Option<PathBuf>,
    },
    /// Makes a vocabulary file of one in DBoW2's text form.
    Import {
        /// The text file.
        #[arg(value_name = "DBOW2.txt")]
        text: PathBuf,
        /// The file to write.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
}

#[derive(clap::Args)]
struct Train {
    /// JPEG or PNG files, or folders of them (searched to the bottom, in the order of their names).
    #[arg(value_name = "IMAGES", required = true)]
    images: Vec<PathBuf>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Children of a node.
    #[arg(long, default_value_t = TrainConfig::default().branching)]
    branching: u32,
    /// Levels below the root.
    #[arg(long, default_value_t = TrainConfig::default().depth)]
    depth: u32,
    /// Seed.
    #[arg(long, default_value_t = TrainConfig::default().seed)]
    seed: u64,
    /// Rounds of each clustering, at most.
    #[arg(long, default_value_t = TrainConfig::default().rounds)]
    rounds: u32,
    /// The level whose nodes are kept for matching; without it the first that has at least 64.
    #[arg(long)]
    index_level: Option<u32>,
    /// Features of an image, at most.
    #[arg(long, default_value_t = OrbConfig::default().features)]
    features: usize,
}

/// What is told of a vocabulary.
#[derive(Serialize)]
struct Told {
    file: PathBuf,
    bytes: usize,
    #[serde(flatten)]
    facts: VocabularyFacts,
    /// After training: mean distance of a descriptor to its word's centre, bits.
    #[serde(skip_serializing_if = "Option::is_none")]
    mean_distance: Option<f64>,
}

/// Does what is asked.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    match &a.command {
        Command::Train(a) => train_images(a, output),
        Command::Info { file } => match file {
            Some(path) => {
                let bytes = std::fs::read(path).map_err(|e| unreadable(path, &e))?;
                let cure = "make it again with `cairn vocab train` or `cairn vocab import`";
                let vocabulary = Vocabulary::open(bytes)
                    .map_err(|e| Failure::new(path.display().to_string(), e.to_string(), cure))?;
                tell(path, &vocabulary, None, output)
            }
            None => tell(Path::new("(embedded)"), Vocabulary::embedded(), None, output),
        },
        Command::Import { text, out } => {
            let file = File::open(text).map_err(|e| unreadable(text, &e))?;
            let vocabulary = import_dbow2(BufReader::new(file)).map_err(|e| match e {
                Dbow2Error::Read(e) => unreadable(text, &e),
                e => {
                    let cure =
                        "give a whole text vocabulary as DBoW2 writes it for 32-byte binary descriptors";
                    Failure::new(text.display().to_string(), e.to_string(), cure)
                }
            })?;
            write_bytes_whole(out, vocabulary.bytes())?;
            tell(out, &vocabulary, None, output)
        }
    }
}

fn train_images(a: &Train, output: &Output) -> Result<(), Failure> {
    let files = image_files(&a.images)?;
    let progress = Progress::new(Some(files.len()));
    let mut extractor = OrbExtractor::new(OrbConfig { features: a.features, ..OrbConfig::default() });
    let mut features = Features::default();
    let mut images: Vec<Vec<Descriptor>> = Vec::with_capacity(files.len());
    for (i, file) in files.iter().enumerate() {
        match read_gray(file) {
            Ok(image) => {
                extractor.extract(&image, &mut features);
                images.push(features.descriptors.clone());
            }
            Err(why) => progress.warn(&format!("left out: {why}")),
        }
        progress.step(i + 1);
    }
    drop(progress);
    let config = TrainConfig {
        branching: a.branching,
        depth: a.depth,
        seed: a.seed,
        rounds: a.rounds,
        index_level: a.index_level,
    };
    let trained = train(&images, &config).map_err(|e| {
        let what = format!("{} images", images.len());
        Failure::new(what, e.to_string(), "give more or other images, or other numbers")
    })?;
    write_bytes_whole(&a.out, trained.vocabulary.bytes())?;
    tell(&a.out, &trained.vocabulary, Some(trained.mean_distance), output)
}

/// The files given, and those below the folders given, in the order of their names.
fn image_files(given: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut found = Vec::new();
    for path in given {
        if path.is_dir() {
            gather(path, &mut found)?;
        } else if path.is_file() {
            found.push(path.clone());
        } else {
            let cure = "give image files or folders of them";
            return Err(Failure::new(path.display().to_string(), "there is no such file or folder", cure));
        }
    }
    Ok(found)
}

fn gather(folder: &Path, found: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let entries = std::fs::read_dir(folder).and_then(|all| all.collect::<Result<Vec<_>, _>>());
    let mut entries = entries.map_err(|e| unreadable(folder, &e))?;
    entries.sort_by_key(|e| e.file_name());
    for entry in entries {
        let path = entry.path();
        let is_image = path
            .extension()
            .is_some_and(|e| ["jpg", "jpeg", "png"].iter().any(|known| e.eq_ignore_ascii_case(known)));
        // A link may lead round in a circle: only what lies here itself is followed.
        if entry.file_type().is_ok_and(|t| t.is_dir()) {
            gather(&path, found)?;
        } else if is_image {
            found.push(path);
        }
    }
    Ok(())
}

fn unreadable(path: &Path, e: &std::io::Error) -> Failure {
    Failure::new(path.display().to_string(), e.to_string(), "check that it exists and may be read")
}

fn tell(
    file: &Path,
    vocabulary: &Vocabulary,
    mean_distance: Option<f64>,
    output: &Output,
) -> Result<(), Failure> {
    let facts = *vocabulary.facts();
    let told = Told { file: file.to_path_buf(), bytes: vocabulary.bytes().len(), facts, mean_distance };
    output.result(&told, |t| {
        let f = &t.facts;
        let mut text = format!(
            "{}: {} words in {} nodes, branching {}, depth {}, matched at level {}, {:.2} MB, checksum {:08x}\n",
            t.file.display(),
            f.words,
            f.nodes,
            f.branching,
            f.depth,
            f.index_level,
            t.bytes as f64 / 1e6,
            f.checksum
        );
        if f.images > 0 {
            text += &format!("trained on {} descriptors of {} images, seed {}\n", f.descriptors, f.images, f.seed);
        }
        if let Some(bits) = t.mean_distance {
            text += &format!("mean distance to the word: {bits:.1} bits\n");
        }
        text
    })
}
