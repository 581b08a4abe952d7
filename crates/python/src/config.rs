//! The configuration of all stages, from a dictionary or TOML.

use crate::errors::{ConfigError, raise};
use cairn::SensorMode;
use cairn::engine::{Sensors, UnknownSensors};
use pyo3::exceptions::{PyOSError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use std::path::PathBuf;
use toml::{Table, Value};

/// The configuration of all stages. Entries that are not given keep their defaults, which need no tuning.
///
/// Args:
///     entries: Nested dictionaries, as in `Config.default_toml()`; or its text.
///
/// Raises:
///     ConfigError: For unknown names and numbers out of range.
///
/// >>> cairn.Config({"front_end": {"orb": {"features": 800}}}).to_dict()["front_end"]["orb"]["features"]
/// 800
/// >>> cairn.Config({"tracker": {"min_inliers": 0}})
/// Traceback (most recent call last):
/// ...
/// cairn.ConfigError: tracker.min_inliers is 0, it must lie between 6 and 10000
#[pyclass(frozen, module = "cairn", eq)]
#[derive(Clone, PartialEq)]
pub struct Config {
    pub inner: cairn::Config,
}

/// What a configuration can be made of.
#[derive(FromPyObject)]
enum Entries<'py> {
    Text(String),
    Nested(Bound<'py, PyDict>),
}

#[pymethods]
impl Config {
    #[new]
    #[pyo3(signature = (entries=None))]
    fn new(entries: Option<Entries<'_>>) -> PyResult<Self> {
        let inner = match entries {
            None => cairn::Config::default(),
            Some(Entries::Text(text)) => cairn::Config::from_toml(&text).map_err(raise)?,
            Some(Entries::Nested(nested)) => {
                let table = table(&nested, 0)?;
                let text = toml::to_string(&table).map_err(|e| ConfigError::new_err(e.to_string()))?;
                // A dictionary has no lines.
                cairn::Config::from_toml(&text).map_err(|e| ConfigError::new_err(e.why))?
            }
        };
        Ok(Self { inner })
    }

    /// Reads a TOML file.
    ///
    /// Raises:
    ///     OSError: When it cannot be read.
    ///     ConfigError: For invalid TOML, unknown names and numbers out of range; the message has the line.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let text = std::fs::read_to_string(&path)
            .map_err(|e| PyOSError::new_err(format!("{}: {e}", path.display())))?;
        Ok(Self { inner: cairn::Config::from_toml(&text).map_err(raise)? })
    }

    /// Every entry with its default and a comment, as TOML.
    #[staticmethod]
    fn default_toml() -> String {
        cairn::Config::default_toml()
    }

    /// The configuration as TOML.
    fn to_toml(&self) -> PyResult<String> {
        toml::to_string(&self.inner).map_err(|e| ConfigError::new_err(e.to_string()))
    }

    /// The configuration as nested dictionaries.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let table = Table::try_from(&self.inner).map_err(|e| ConfigError::new_err(e.to_string()))?;
        dictionary(py, &table)
    }

    fn __repr__(&self) -> &'static str {
        if self.inner == cairn::Config::default() { "Config()" } else { "Config(...)" }
    }

    fn __getnewargs__(&self) -> PyResult<(String,)> {
        Ok((self.to_toml()?,))
    }
}

/// A deeper nesting is not a configuration, and a dictionary may contain itself.
const DEPTH: usize = 8;

fn table(dictionary: &Bound<'_, PyDict>, depth: usize) -> PyResult<Table> {
    if depth > DEPTH {
        return Err(ConfigError::new_err("the dictionaries are nested too deeply"));
    }
    let entry = |(key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        let key: String =
            key.extract().map_err(|_| PyTypeError::new_err("config: a name is not a string"))?;
        let value = entry(&key, &value, depth)?;
        Ok((key, value))
    };
    dictionary.iter().map(entry).collect()
}

fn entry(key: &str, value: &Bound<'_, PyAny>, depth: usize) -> PyResult<Value> {
    let items = |values: Vec<Bound<'_, PyAny>>| -> PyResult<Value> {
        if depth > DEPTH {
            return Err(ConfigError::new_err("the lists are nested too deeply"));
        }
        values.iter().map(|v| entry(key, v, depth + 1)).collect::<PyResult<Vec<_>>>().map(Value::Array)
    };
    if value.is_instance_of::<PyBool>() {
        return Ok(Value::Boolean(value.extract()?));
    }
    if value.is_instance_of::<PyInt>() {
        let whole =
            value.extract().map_err(|_| ConfigError::new_err(format!("{key}: {value} is too large")))?;
        return Ok(Value::Integer(whole));
    }
    if value.is_instance_of::<PyFloat>() {
        return Ok(Value::Float(value.extract()?));
    }
    if value.is_instance_of::<PyString>() {
        return Ok(Value::String(value.extract()?));
    }
    if let Ok(nested) = value.cast::<PyDict>() {
        return Ok(Value::Table(table(nested, depth + 1)?));
    }
    if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        return items(value.extract()?);
    }
    let kind = value.get_type().name()?;
    Err(PyTypeError::new_err(format!(
        "config: {key} is of type {kind}; numbers, strings, lists and dictionaries are known"
    )))
}

fn dictionary<'py>(py: Python<'py>, table: &Table) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    for (key, value) in table {
        out.set_item(key, object(py, value)?)?;
    }
    Ok(out)
}

fn object<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Boolean(v) => PyBool::new(py, *v).to_owned().into_any(),
        Value::Integer(v) => v.into_pyobject(py)?.into_any(),
        Value::Float(v) => PyFloat::new(py, *v).into_any(),
        Value::Table(v) => dictionary(py, v)?.into_any(),
        Value::Array(v) => {
            let items: PyResult<Vec<_>> = v.iter().map(|v| object(py, v)).collect();
            PyList::new(py, items?)?.into_any()
        }
        other => other.to_string().into_pyobject(py)?.into_any(),
    })
}

/// The sensors of a name: the cameras, and whether the IMU is used.
pub fn sensors(name: &str, rig: &cairn::Rig) -> PyResult<(SensorMode, bool)> {
    let sensors: Sensors = name.parse().map_err(|e: UnknownSensors| PyValueError::new_err(e.to_string()))?;
    if sensors.has_imu() && rig.imu.is_none() {
        return Err(crate::errors::RigError::new_err(format!("sensor {name:?}: the rig has no IMU")));
    }
    Ok((sensors.mode(), sensors.has_imu()))
}
