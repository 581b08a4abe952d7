//! `cairn vocab`: trains and inspects vocabularies of visual words, and imports those of DBoW2.

use crate::failure::Failure;
use crate::output::Output;
use crate::outputs::Outputs;
use crate::progress::Progress;
use cairn_files::MIB;
use cairn_sources::read_gray;
use cairn_vision::bow::{Dbow2Error, TrainConfig, Vocabulary, VocabularyFacts, import_dbow2, train};
use cairn_vision::{Descriptor, Features, OrbConfig, OrbExtractor};
use serde::Serialize;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Trains, inspects and imports vocabularies of visual words (used for place recognition).
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Trains a vocabulary on images; the same images and seed give the same file.
    Train(Train),
    /// Checks a vocabulary file and shows what is in it; without a file, the built-in vocabulary.
    Info {
        /// The vocabulary file.
        #[arg(value_name = "FILE")]
        file: Option<PathBuf>,
    },
    /// Converts a vocabulary in DBoW2's text format.
    Import {
        /// The text file.
        #[arg(value_name = "DBOW2.txt")]
        text: PathBuf,
        /// The file to write.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Replace the file if it exists.
        #[arg(long)]
        overwrite: bool,
    },
}

#[derive(clap::Args)]
struct Train {
    /// JPEG or PNG files, or folders of them (searched recursively, in order of their names).
    #[arg(value_name = "IMAGES", required = true)]
    images: Vec<PathBuf>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace the file if it exists.
    #[arg(long)]
    overwrite: bool,
    /// Children per node.
    #[arg(long, default_value_t = TrainConfig::default().branching)]
    branching: u32,
    /// Levels below the root.
    #[arg(long, default_value_t = TrainConfig::default().depth)]
    depth: u32,
    /// Seed of the clustering.
    #[arg(long, default_value_t = TrainConfig::default().seed)]
    seed: u64,
    /// Largest number of iterations of each clustering.
    #[arg(long, default_value_t = TrainConfig::default().rounds)]
    rounds: u32,
    /// The level whose nodes are indexed for matching; by default the first with at least 64 nodes.
    #[arg(long)]
    index_level: Option<u32>,
    /// Largest number of features per image.
    #[arg(long, default_value_t = OrbConfig::default().features)]
    features: usize,
}

/// Summary of a vocabulary.
#[derive(Serialize)]
struct Summary {
    file: PathBuf,
    bytes: usize,
    #[serde(flatten)]
    facts: VocabularyFacts,
    /// After training: mean distance of a descriptor to the centre of its word, bits.
    #[serde(skip_serializing_if = "Option::is_none")]
    mean_distance: Option<f64>,
}

/// Runs the subcommand.
///
/// # Errors
/// When a file cannot be read or written, is damaged, or training is impossible with these images.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    match &a.command {
        Command::Train(a) => train_images(a, output),
        Command::Info { file } => match file {
            Some(path) => {
                let bytes = cairn_files::read(path, 1024 * MIB).map_err(|e| unreadable(path, &e))?;
                let cure = "create it again with `cairn vocab train` or `cairn vocab import`";
                let vocabulary = Vocabulary::open(bytes)
                    .map_err(|e| Failure::new(path.display().to_string(), e.to_string(), cure))?;
                print_summary(path, &vocabulary, None, output)
            }
            None => print_summary(Path::new("(embedded)"), Vocabulary::embedded(), None, output),
        },
        Command::Import { text, out, overwrite } => {
            let outputs = Outputs::new(*overwrite)
                .input("the text", Some(text))
                .output("--out", Some(out))
                .checked()?;
            let file = cairn_files::open(text, 4096 * MIB).map_err(|e| unreadable(text, &e))?;
            let vocabulary = import_dbow2(BufReader::new(file)).map_err(|e| match e {
                Dbow2Error::Read(e) => unreadable(text, &e),
                e => {
                    let cure =
                        "give a complete text vocabulary as DBoW2 writes it for 32-byte binary descriptors";
                    Failure::new(text.display().to_string(), e.to_string(), cure)
                }
            })?;
            outputs.write("--out", || Ok(vocabulary.bytes().to_vec()))?;
            print_summary(out, &vocabulary, None, output)
        }
    }
}

fn train_images(a: &Train, output: &Output) -> Result<(), Failure> {
    let outputs = Outputs::new(a.overwrite);
    let outputs = a.images.iter().fold(outputs, |outputs, path| outputs.input("an image", Some(path)));
    let outputs = outputs.output("--out", Some(&a.out)).checked()?;
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
            Err(why) => progress.warn(&format!("skipped: {why}")),
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
        Failure::new(what, e.to_string(), "give more or different images, or other parameters")
    })?;
    outputs.write("--out", || Ok(trained.vocabulary.bytes().to_vec()))?;
    print_summary(&a.out, &trained.vocabulary, Some(trained.mean_distance), output)
}

/// The given files and those below the given folders, in order of their names.
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
        // Symbolic links to folders are not followed: they may form a cycle.
        if entry.file_type().is_ok_and(|t| t.is_dir()) {
            gather(&path, found)?;
        } else if is_image {
            found.push(path);
        }
    }
    Ok(())
}

fn unreadable(path: &Path, e: &std::io::Error) -> Failure {
    Failure::new(path.display().to_string(), e.to_string(), "check that it exists and is readable")
}

fn print_summary(
    file: &Path,
    vocabulary: &Vocabulary,
    mean_distance: Option<f64>,
    output: &Output,
) -> Result<(), Failure> {
    let facts = *vocabulary.facts();
    let summary = Summary { file: file.to_path_buf(), bytes: vocabulary.bytes().len(), facts, mean_distance };
    output.result(&summary, |t| {
        let f = &t.facts;
        let mut text = format!(
            "{}: {} words in {} nodes, branching {}, depth {}, indexed at level {}, {:.2} MB, checksum {:08x}\n",
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
            text += &format!("mean distance to the word centre: {bits:.1} bits\n");
        }
        text
    })
}
