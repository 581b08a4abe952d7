//! Builds of many recordings: tasks as JSON, for `cairn.fleet`, which hands them to workers.

use crate::errors::Error;
use crate::interrupt::on_thread;
use cairn_fleet::{Build, FleetError, Job, Task};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A build under way: the tasks of one step after the other.
#[pyclass(module = "cairn")]
pub struct FleetBuild {
    inner: Build,
}

fn raise(error: FleetError) -> PyErr {
    Error::new_err(error.to_string())
}

fn wrong(error: serde_json::Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}

#[pymethods]
impl FleetBuild {
    #[new]
    fn new(job: &str) -> PyResult<Self> {
        let job: Job = serde_json::from_str(job).map_err(wrong)?;
        Ok(Self { inner: Build::new(job).map_err(raise)? })
    }

    /// Takes the outcomes of the tasks given out last, in their order, and gives those of the next step; none at the end.
    fn next(&mut self, outcomes: Vec<String>) -> PyResult<Vec<String>> {
        let outcomes =
            outcomes.iter().map(|o| serde_json::from_str(o)).collect::<Result<_, _>>().map_err(wrong)?;
        let tasks = self.inner.next(outcomes).map_err(raise)?;
        tasks.iter().map(|task| serde_json::to_string(task).map_err(wrong)).collect()
    }

    /// What came of it so far, as JSON.
    fn report(&self) -> PyResult<String> {
        serde_json::to_string(self.inner.report()).map_err(wrong)
    }
}

/// Does a task, or finds it done; its outcome as JSON.
///
/// Raises:
///     Error: When the store or the recordings cannot be reached, or an object is damaged.
#[pyfunction]
fn fleet_run(py: Python<'_>, job: &str, task: &str) -> PyResult<String> {
    let job: Job = serde_json::from_str(job).map_err(wrong)?;
    let task: Task = serde_json::from_str(task).map_err(wrong)?;
    on_thread(py, move || {
        let outcome = cairn_fleet::run(&job, &task).map_err(raise)?;
        serde_json::to_string(&outcome).map_err(wrong)
    })
}

/// Adds all of it to the module.
pub fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<FleetBuild>()?;
    module.add_function(wrap_pyfunction!(fleet_run, module)?)
}
