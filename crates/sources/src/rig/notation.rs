//! A calibration as a document, whatever it is written in: YAML, JSON, OpenCV's XML, ROS's `ost.txt`.

use super::document::Document;
use super::{ost, xml};
use cairn_sensor::SourceError;
use std::path::Path;

/// The document of a text; `None` where neither the name nor the text is of a known notation.
pub fn document(path: &Path, text: &str) -> Result<Option<Document>, SourceError> {
    let name = path.to_string_lossy().to_ascii_lowercase();
    if ost::is(text) {
        Ok(Some(Document { path: path.to_owned(), root: ost::root(text) }))
    } else if xml::is(text) {
        xml::document(path, text).map(Some)
    } else if [".yaml", ".yml", ".json"].iter().any(|end| name.ends_with(end)) {
        Ok(Some(Document::parse(path, text)?.parameters()))
    } else {
        Ok(None)
    }
}
