//! A store of objects by name: a folder, or a bucket of S3. Names are made by this crate only: letters, digits, `-`, `.` and `/`.
//!
//! Objects are written whole or not at all. What is named after its content or after what it was made from is written once
//! ([`Store::put_new`]): two workers that do the same step at once both succeed, and the first one's object stays.

mod folder;
#[cfg(feature = "s3")]
mod s3;

use crate::FleetError;
use std::ops::Range;

/// An object of a listing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Its name, relative to what was listed.
    pub name: String,
    /// Its length.
    pub bytes: u64,
    /// What changes when its content does, where the store tells that without reading it.
    pub tag: Option<String>,
}

/// A store of objects.
pub trait Store: Send + Sync {
    /// An object; `None` where there is none.
    ///
    /// # Errors
    /// When the store cannot be read.
    fn get(&self, name: &str) -> Result<Option<Vec<u8>>, FleetError>;

    /// A part of an object that exists.
    ///
    /// # Errors
    /// When it cannot be read, or is shorter.
    fn get_range(&self, name: &str, range: Range<u64>) -> Result<Vec<u8>, FleetError>;

    /// Writes an object unless it exists; whether it was written.
    ///
    /// # Errors
    /// When it cannot be written.
    fn put_new(&self, name: &str, bytes: &[u8]) -> Result<bool, FleetError>;

    /// Writes an object in place of what there was.
    ///
    /// # Errors
    /// When it cannot be written.
    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), FleetError>;

    /// Names of what is directly below a prefix, folders and objects, sorted.
    ///
    /// # Errors
    /// When the store cannot be read.
    fn children(&self, prefix: &str) -> Result<Vec<String>, FleetError>;

    /// All objects below a prefix, or the object of that very name (then with an empty name), sorted.
    ///
    /// # Errors
    /// When the store cannot be read.
    fn list(&self, prefix: &str) -> Result<Vec<Listed>, FleetError>;

    /// Where an object or what is below a prefix is on this machine, if the store is a folder of it.
    fn local(&self, name: &str) -> Option<std::path::PathBuf>;
}

/// Opens a store: a folder (`file://FOLDER` or its path), which is made when something is written, or `s3://BUCKET/PREFIX`.
///
/// # Errors
/// When the address is of another kind, or S3 is not in this build or not reached as the environment says (`AWS_ACCESS_KEY_ID`,
/// `AWS_SECRET_ACCESS_KEY`, `AWS_REGION`, `AWS_ENDPOINT`, and what else the crate `object_store` reads).
pub fn open(address: &str) -> Result<Box<dyn Store>, FleetError> {
    match address.split_once("://") {
        None => Ok(Box::new(folder::Folder::new(address))),
        Some(("file", path)) => Ok(Box::new(folder::Folder::new(path))),
        #[cfg(feature = "s3")]
        Some(("s3", _)) => Ok(Box::new(s3::Bucket::open(address)?)),
        #[cfg(not(feature = "s3"))]
        Some(("s3", _)) => Err(FleetError::new(
            address,
            "this build has no S3",
            "build it with S3: cargo build --release -p cairn-cli --features s3, and the Python package with --features module,s3",
        )),
        Some((other, _)) => Err(FleetError::new(
            address,
            format!("stores of the kind {other}:// are not known"),
            "give a folder or s3://BUCKET/PREFIX",
        )),
    }
}
