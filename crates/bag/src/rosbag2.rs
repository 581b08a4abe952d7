//! rosbag2 recordings: a folder with `metadata.yaml` and files in SQLite (`.db3`) or MCAP format.
//!
//! If the metadata is missing (it is written when recording ends), the files of the folder are used in the order of
//! their numbers. Source: github.com/ros2/rosbag2, `docs/` and the schema of its SQLite storage.

use crate::compression::Compression;
use crate::error::{BagError, Damage};
use crate::index::{Index, PREFIX, Place};
use crate::sqlite::{Database, Value};
use crate::wire::WireFormat;
use std::path::{Path, PathBuf};

/// The files of a recording, and how single messages are compressed.
pub(crate) struct Folder {
    pub files: Vec<PathBuf>,
    pub messages: Compression,
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
    let mut out = Folder { files: Vec::new(), messages: Compression::None, notes: Vec::new() };
    let Ok(text) = std::fs::read_to_string(&metadata) else {
        out.files = listed(folder);
        out.notes.push(format!("{} is missing: all files of the folder are read", metadata.display()));
        return Ok(out);
    };
    let value = |key: &str| {
        let line = text.lines().find_map(|l| l.trim().strip_prefix(key)?.strip_prefix(':'));
        line.unwrap_or("").trim().trim_matches(['"', '\'']).to_ascii_lowercase()
    };
    match value("compression_mode").as_str() {
        "message" if value("compression_format") == "zstd" => out.messages = Compression::Zstd,
        "" | "none" => {}
        mode => {
            let why = format!("compression of \"{mode}\" by \"{}\" is not read", value("compression_format"));
            return Err(unsupported(why, "unpack it with ros2 bag convert, or zstd -d on each file"));
        }
    }
    let mut lines = text.lines().skip_while(|l| l.trim() != "relative_file_paths:").skip(1);
    while let Some(name) = lines.next().and_then(|l| l.trim().strip_prefix("- ")) {
        let path = folder.join(name.trim_matches(['"', '\'']));
        match path.is_file() {
            true => out.files.push(path),
            false => out.notes.push(format!("{} is missing", path.display())),
        }
    }
    if out.files.is_empty() {
        out.files = listed(folder);
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

/// Fills the index from a database.
pub(crate) fn scan(database: &mut Database, number: u16, index: &mut Index) -> Result<(), BagError> {
    let mut table = |name: &str| match database.table(name) {
        Ok(Some(table)) => Ok(table),
        Ok(None) => Err(BagError::Unsupported {
            path: database.file.shown(),
            why: format!("has no table \"{name}\", so it is no recording of rosbag2"),
            cure: "give the folder or file that ros2 bag record has written".into(),
        }),
        Err(damage) => Err(database.file.damaged(damage)),
    };
    let (topics, messages) = (table("topics")?, table("messages")?);
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
