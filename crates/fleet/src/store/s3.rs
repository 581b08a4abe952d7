//! A store in a bucket of S3, or of a server that speaks its protocol (feature `s3`), by the crate `object_store`.
//!
//! What must be new is put with the condition that there is none of that name, which the server checks. Credentials, region and endpoint come
//! from the environment, as `object_store` reads them (`AWS_...`).

use super::{Listed, Store};
use crate::FleetError;
use bytes::Bytes;
use futures_util::StreamExt;
use object_store::aws::{AmazonS3, AmazonS3Builder};
use object_store::path::Path;
use object_store::{Error, ObjectStore, ObjectStoreExt, PutMode, PutOptions};
use std::future::Future;
use std::ops::Range;
use tokio::runtime::Runtime;

const CURE: &str = "check AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION and, for a server of your own, AWS_ENDPOINT and AWS_ALLOW_HTTP";

pub(super) struct Bucket {
    address: String,
    prefix: Path,
    bucket: AmazonS3,
    runtime: Runtime,
}

impl Bucket {
    pub(super) fn open(address: &str) -> Result<Self, FleetError> {
        let failed = |why: &dyn std::fmt::Display| FleetError::new(address, why, CURE);
        let below = address.strip_prefix("s3://").unwrap_or_default();
        let (bucket, prefix) = below.split_once('/').unwrap_or((below, ""));
        if bucket.is_empty() {
            return Err(FleetError::new(address, "it names no bucket", "give s3://BUCKET/PREFIX"));
        }
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        Ok(Self {
            address: address.trim_end_matches('/').to_owned(),
            prefix: Path::parse(prefix.trim_matches('/')).map_err(|e| failed(&e))?,
            bucket: AmazonS3Builder::from_env().with_bucket_name(bucket).build().map_err(|e| failed(&e))?,
            runtime: runtime.map_err(|e| failed(&e))?,
        })
    }

    fn path(&self, name: &str) -> Result<Path, FleetError> {
        let whole = match (self.prefix.as_ref(), name) {
            ("", name) => name.to_owned(),
            (prefix, "") => prefix.to_owned(),
            (prefix, name) => format!("{prefix}/{name}"),
        };
        Path::parse(whole).map_err(|e| self.failed(name, &e))
    }

    fn failed(&self, name: &str, why: &dyn std::fmt::Display) -> FleetError {
        FleetError::new(format!("{}/{name}", self.address), why, CURE)
    }

    fn wait<T>(&self, name: &str, work: impl Future<Output = Result<T, Error>>) -> Result<T, FleetError> {
        self.runtime.block_on(work).map_err(|e| self.failed(name, &e))
    }

    /// A name of the bucket as one of this store.
    fn below(&self, path: &Path, prefix: &Path) -> String {
        path.prefix_match(prefix)
            .map(|parts| parts.map(|p| p.as_ref().to_owned()).collect::<Vec<_>>().join("/"))
            .unwrap_or_default()
    }
}

impl Store for Bucket {
    fn get(&self, name: &str) -> Result<Option<Vec<u8>>, FleetError> {
        let path = self.path(name)?;
        let got = self.runtime.block_on(async { self.bucket.get(&path).await?.bytes().await });
        match got {
            Ok(bytes) => Ok(Some(bytes.to_vec())),
            Err(Error::NotFound { .. }) => Ok(None),
            Err(e) => Err(self.failed(name, &e)),
        }
    }

    fn get_range(&self, name: &str, range: Range<u64>) -> Result<Vec<u8>, FleetError> {
        let (path, length) = (self.path(name)?, range.end.saturating_sub(range.start));
        if length == 0 {
            return Ok(Vec::new());
        }
        let bytes = self.wait(name, async { self.bucket.get_range(&path, range).await })?;
        match bytes.len() as u64 == length {
            true => Ok(bytes.to_vec()),
            false => Err(self.failed(name, &format!("it ends early: {} bytes of {length}", bytes.len()))),
        }
    }

    fn put_new(&self, name: &str, bytes: &[u8]) -> Result<bool, FleetError> {
        let path = self.path(name)?;
        let options = PutOptions::from(PutMode::Create);
        let payload = Bytes::copy_from_slice(bytes).into();
        match self.runtime.block_on(self.bucket.put_opts(&path, payload, options)) {
            Ok(_) => Ok(true),
            Err(Error::AlreadyExists { .. }) => Ok(false),
            Err(e) => Err(self.failed(name, &e)),
        }
    }

    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), FleetError> {
        let path = self.path(name)?;
        let payload = Bytes::copy_from_slice(bytes).into();
        self.wait(name, async { self.bucket.put(&path, payload).await }).map(drop)
    }

    fn children(&self, prefix: &str) -> Result<Vec<String>, FleetError> {
        let path = self.path(prefix)?;
        let found = self.wait(prefix, async { self.bucket.list_with_delimiter(Some(&path)).await })?;
        let objects = found.objects.iter().map(|o| &o.location);
        let all = found.common_prefixes.iter().chain(objects);
        let mut names: Vec<String> =
            all.map(|p| self.below(p, &path)).filter(|n| !n.starts_with('.')).collect();
        names.sort();
        Ok(names)
    }

    fn list(&self, prefix: &str) -> Result<Vec<Listed>, FleetError> {
        let path = self.path(prefix)?;
        let mut all = Vec::new();
        self.wait(prefix, async {
            let mut objects = self.bucket.list(Some(&path));
            while let Some(object) = objects.next().await {
                let object = object?;
                let name = self.below(&object.location, &path);
                all.push(Listed { name, bytes: object.size, tag: object.e_tag });
            }
            if all.is_empty() {
                // A listing is of what is below; an object of that very name is no part of it.
                let object = self.bucket.head(&path).await?;
                all.push(Listed { name: String::new(), bytes: object.size, tag: object.e_tag });
            }
            Ok(())
        })?;
        all.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(all)
    }

    fn local(&self, _: &str) -> Option<std::path::PathBuf> {
        None
    }
}
