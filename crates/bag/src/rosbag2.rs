//! rosbag2 recordings: a folder with `metadata.yaml` and files in SQLite (`.db3`) or MCAP format.
//!
//! If the metadata is missing (it is written when recording ends), the files of the folder are used in the order of
//! their numbers. Source: github.com/ros2/rosbag2, `docs/` and the schema of its SQLite storage.

use crate::error::{BagError, Damage};
use crate::index::{Index, PREFIX, Place};
use crate::sqlite::{Database, Value};
use crate::wire::WireFormat;
use cairn_files::yaml::{self, Node};
use std::path::{Path, PathBuf};

/// The files of a recording, and whether each message is a Zstandard frame.
pub(crate) struct Folder {
    pub files: Vec<PathBuf>,
    pub has_zstd_messages: bool,
    pub notes: Vec<String>,
}

/// Whether a folder contains such a recording.
pub(crate) fn is(folder: &Path) -> bool {
    let metadata = std::fs::read_to_string(folder.join("metadata.yaml"));
    metadata.is_ok_and(|text| text.contains("rosbag2_bagfile_information")) || !listed(folder).is_empty()
}

/// The files of the folder.
pub(crate) fn folder(folder: &Path) -> Result<Folder, BagError> {
    let metadata = folder.join("metadata.yaml");
    let unsupported = |why: String, cure: &str| BagError::Unsupported {
        path: metadata.display().to_string(),
        why,
        cure: cure.into(),
    };
    let mut out = Folder { files: Vec::new(), has_zstd_messages: false, notes: Vec::new() };
    let Ok(text) = std::fs::read_to_string(&metadata) else {
        out.files = listed(folder);
        out.notes.push(format!("{} is missing: all files of the folder are read", metadata.display()));
        return Ok(out);
    };
    let wrong = |(line, why): (usize, String)| unsupported(format!("line {line}: {why}"), "correct the line");
    let root = yaml::parse(&text).map_err(wrong)?;
    let about = root.get("rosbag2_bagfile_information").unwrap_or(&root);
    let value = |key: &str| about.get(key).and_then(Node::text).unwrap_or_default().to_ascii_lowercase();
    let (mode, format) = (value("compression_mode"), value("compression_format"));
    let of_files = mode == "file";
    match mode.as_str() {
        "message" if format == "zstd" => out.has_zstd_messages = true,
        "" | "none" | "file" => {}
        mode => {
            let why = format!("compression of \"{mode}\" by \"{format}\" is not read");
            return Err(unsupported(why, "unpack it with ros2 bag convert"));
        }
    }
    let names = about.get("relative_file_paths").and_then(Node::list).unwrap_or_default();
    for name in names.iter().filter_map(Node::text) {
        // A file that was decompressed has lost its last extension.
        let path = folder.join(name);
        let unpacked = path.with_extension("");
        match path.extension() {
            Some(end) if end == "zstd" && unpacked.is_file() => out.files.push(unpacked),
            Some(end) if end == "zstd" && path.is_file() => {
                let why =
                    format!("{} is compressed as a whole ({mode} mode), which is not read", path.display());
                return Err(unsupported(why, "run zstd -d on each file and leave the result beside it"));
            }
            _ if path.is_file() => out.files.push(path),
            _ => out.notes.push(format!("{} is missing", path.display())),
        }
    }
    if of_files && out.files.is_empty() {
        let why = format!("names files that were compressed by \"{format}\", and none is there decompressed");
        return Err(unsupported(why, "run zstd -d on each file and leave the result beside it"));
    }
    if out.files.is_empty() {
        out.files = listed(folder);
    }
    for file in &out.files {
        let mut log = file.clone().into_os_string();
        log.push("-wal");
        if std::fs::metadata(&log).is_ok_and(|log| log.len() > 0) {
            out.notes.push(format!(
                "{} holds messages that are not read: sqlite3 {} 'PRAGMA wal_checkpoint' puts them into the file",
                Path::new(&log).display(),
                file.display()
            ));
        }
    }
    if out.files.is_empty() {
        return Err(unsupported(
            "names no file that is there".into(),
            "put the .db3 or .mcap files beside it",
        ));
    }
    Ok(out)
}

/// `.db3` and `.mcap` files sorted by name, with the numbers in the names sorted by value.
fn listed(folder: &Path) -> Vec<PathBuf> {
    let files = std::fs::read_dir(folder).into_iter().flatten().filter_map(|e| Some(e.ok()?.path()));
    let known =
        |path: &PathBuf| path.extension().is_some_and(|e| e == "db3" || e == "mcap") && path.is_file();
    let mut files: Vec<PathBuf> = files.filter(known).collect();
    let number = |path: &PathBuf| {
        let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let digits = stem.len() - stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
        let (name, number) = stem.split_at(stem.len() - digits);
        (name.to_owned(), number.parse::<u64>().unwrap_or(0))
    };
    files.sort_by_key(|path| (number(path), path.clone()));
    files
}

/// The error of a database that is something else.
fn no_recording(path: String, rtabmap: bool) -> BagError {
    let (why, cure) = match rtabmap {
        true => (
            "is a database of RTAB-Map, not a recording of rosbag2",
            "replay it with RTAB-Map's data_player node and record the topics with ros2 bag record; its poses are exported by rtabmap-report --poses, its map by rtabmap-export",
        ),
        false => (
            "has no tables \"topics\" and \"messages\", so it is no recording of rosbag2",
            "give the folder or file that ros2 bag record has written",
        ),
    };
    BagError::Unsupported { path, why: why.into(), cure: cure.into() }
}

/// Fills the index from a database.
pub(crate) fn scan(database: &mut Database, number: u16, index: &mut Index) -> Result<(), BagError> {
    let mut table = |name: &str| database.table(name).map_err(|damage| database.file.damaged(damage));
    let (Some(topics), Some(messages)) = (table("topics")?, table("messages")?) else {
        let rtabmap = table("Node")?.is_some() && table("Link")?.is_some();
        return Err(no_recording(database.file.shown(), rtabmap));
    };
    let missing = |column: &str| BagError::Unsupported {
        path: database.file.shown(),
        why: format!("the column \"{column}\" is missing, so it is no recording of rosbag2"),
        cure: "give the folder or file that ros2 bag record has written".into(),
    };
    let column = |table: &crate::sqlite::Table, name: &str| table.column(name).ok_or_else(|| missing(name));
    let of_topics = [
        column(&topics, "id")?,
        column(&topics, "name")?,
        column(&topics, "type")?,
        column(&topics, "serialization_format")?,
    ];
    let of_messages =
        [column(&messages, "topic_id")?, column(&messages, "timestamp")?, column(&messages, "data")?];
    let mut first = database.rows(topics.root, &mut |row| {
        let values = row.values(8)?;
        let [id, name, kind, format] = of_topics.map(|i| values.get(i).cloned().unwrap_or(Value::Null));
        let id = if let Value::Integer(id) = id { id } else { row.rowid };
        if let (Ok(id), Value::Text(name), Value::Text(kind), Value::Text(format)) =
            (u32::try_from(id), name, kind, format)
        {
            let format = if format == "cdr" { WireFormat::Cdr } else { WireFormat::Other };
            index.connection(number, id, &name, &kind, format);
        }
        Ok(())
    });
    let damage = database.rows(messages.root, &mut |row| {
        let values = row.values(8)?;
        let [id, time, data] = of_messages.map(|i| values.get(i).cloned().unwrap_or(Value::Null));
        let (Value::Integer(id), Value::Integer(log_ns), Value::Blob(at, length)) = (id, time, data) else {
            return Err(Damage::new(0, format!("message {} has no topic, time or data", row.rowid)));
        };
        let prefix = row.bytes(at, length.min(PREFIX))?;
        let (Ok(id), Ok(length)) = (u32::try_from(id), u32::try_from(length)) else { return Ok(()) };
        let place = Place { file: number, chunk: row.page, offset: u64::from(row.cell), length };
        index.message(id, log_ns, &prefix, place);
        Ok(())
    });
    first = first.or(damage);
    if let Some(damage) = first {
        let (file, stated) = (&database.file, database.stated_pages);
        index.notes.push(format!(
            "{}: damaged or cut (byte {}: {}; {stated} pages are stated, it has {} bytes): {} messages could be read",
            file.shown(),
            damage.at,
            damage.why,
            crate::area::Area::end(file),
            index.count()
        ));
    }
    Ok(())
}

/// The data of a message at a place from the index.
pub(crate) fn read(database: &mut Database, place: &Place) -> Result<Vec<u8>, Damage> {
    let mut row = database.row_at(place.chunk, place.offset as u16)?;
    let blob = row.values(8)?.into_iter().find_map(|value| match value {
        Value::Blob(at, length) if length == u64::from(place.length) => Some((at, length)),
        _ => None,
    });
    let (at, length) =
        blob.ok_or_else(|| Damage::new(0, "the message has changed while the file was read"))?;
    row.bytes(at, length)
}
