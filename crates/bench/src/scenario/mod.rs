//! Scenarios: what is measured, as a file. An address with conditions and settings, axes along which it varies, tables of the
//! figures, and where in `docs/` these stand.
//!
//! Every text of a scenario may name bindings in braces: the value of each axis, what that value brings along, and what is given for
//! all. `--set NAME=VALUE` chooses values of an axis, or replaces what is given.

mod expand;
mod figure;
mod runner;
mod table;

pub use expand::{Bindings, fill};
pub use runner::{Chosen, Row, judge, run};
pub use table::tables;

use crate::MeasureError;
use crate::error::{file, of};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A scenario.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// What it measures, for the list of scenarios.
    pub about: String,
    /// Bindings of every run that no axis binds.
    #[serde(default)]
    pub given: Bindings,
    /// What varies; each combination is a run. The last one varies fastest.
    #[serde(default)]
    pub axis: Vec<Axis>,
    /// Bindings that alternate with the seed.
    #[serde(default)]
    pub by_seed: BTreeMap<String, BySeed>,
    /// What is run.
    pub run: Run,
    /// What is shown.
    #[serde(default)]
    pub table: Vec<Table>,
    /// What the figures must keep to.
    #[serde(default)]
    pub limit: Vec<Limit>,
}

/// Something that varies.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// Its name, which is bound to the name of each value.
    pub name: String,
    /// Its values.
    #[serde(default)]
    pub values: Vec<Value>,
    /// Instead of these: whole numbers, the first and the last.
    pub numbers: Option<[u64; 2]>,
    /// The values that are run where none are chosen; all of them if there are none here.
    #[serde(default)]
    pub usual: Vec<String>,
}

/// A value of an axis.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// Its name.
    Plain(String),
    /// Its `name`, and other bindings.
    Named(Bindings),
}

/// A binding that alternates with the seed.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BySeed {
    /// The values.
    pub of: Vec<String>,
    /// So many seeds one after the other have the same value.
    #[serde(default = "one")]
    pub every: u64,
}

fn one() -> u64 {
    1
}

/// What is run; see [`crate::source`].
#[derive(Clone, Debug, Deserialize)]
pub struct Run {
    /// The source: a recording below `{data}`, or a simulated walk.
    pub address: String,
    /// The sensors that are used.
    pub sensors: String,
    /// The other keys; the runner lists them.
    #[serde(flatten)]
    pub options: Bindings,
}

/// A table: its columns are a heading and a text that names figures.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// The heading above it.
    #[serde(default)]
    pub title: String,
    /// A row for each combination of these bindings; for each run if there are none.
    #[serde(default)]
    pub by: Vec<String>,
    /// And then for each combination of these.
    #[serde(default)]
    pub also_by: Vec<String>,
    /// The table is left out where no run has this binding, `seeds=drawn`.
    #[serde(default)]
    pub only_with: String,
    /// A row for each part of each run.
    #[serde(default)]
    pub parts: bool,
    /// Headings and texts.
    pub columns: Vec<[String; 2]>,
    /// A text below it, over all runs.
    #[serde(default)]
    pub below: String,
    /// The page that `--write` puts it on, below the root of the checkout: between the comments with the scenario's name.
    pub page: Option<PathBuf>,
}

/// A limit of a figure, and its reason.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limit {
    /// The figure.
    pub figure: String,
    /// It is at most this; empty: there is no such limit.
    #[serde(default)]
    pub most: String,
    /// It is at least this.
    #[serde(default)]
    pub least: String,
    /// Why it is this.
    pub why: String,
}

/// The folder of the scenarios that come with this program.
pub fn folder() -> PathBuf {
    concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios").into()
}

impl Scenario {
    /// Reads the scenario of this name, or of this path.
    ///
    /// # Errors
    /// When there is none, or it is not understood.
    pub fn read(name: &str) -> Result<Self, MeasureError> {
        let path = match name.ends_with(".toml") {
            true => Path::new(name).to_owned(),
            false => folder().join(format!("{name}.toml")),
        };
        let text = std::fs::read_to_string(&path).map_err(file(&path))?;
        toml::from_str(&text).map_err(|e| of(path.display(), e.to_string()))
    }

    /// Names and descriptions of all that come with this program.
    ///
    /// # Errors
    /// When one of them cannot be read.
    pub fn all() -> Result<BTreeMap<String, String>, MeasureError> {
        let folder = folder();
        let entries = folder.read_dir().map_err(file(&folder))?;
        let names = entries.filter_map(|e| Some(e.ok()?.path().file_stem()?.to_str()?.to_owned()));
        names.map(|name| Ok((name.clone(), Self::read(&name)?.about))).collect()
    }
}
