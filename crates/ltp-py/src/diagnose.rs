//! The verb `diagnose` and the noun `Diagnosis` of the extension.

use ltp_core::diagnose::result::{Force, Law, RecordTrace};
use ltp_core::diagnose::{self as core, Control, Options};
use numpy::ToPyArray;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::error::from_panic;
use crate::model::Model;
use crate::recording::Recording;
use crate::simulate::hold_named;
use crate::{array, door};

/// What was found, as JSON, and the series behind the pictures.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct Diagnosis {
    core: core::Diagnosis,
}

/// Compares a model with recordings; `progress` is called with what is being done and the finished fraction.
#[pyfunction]
#[pyo3(signature = (model, train, test, *, candidates=None, hold="first-order", seed=0, threads=0, progress=None))]
#[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
pub fn diagnose(
    py: Python<'_>,
    model: &Model,
    train: Vec<PyRef<'_, Recording>>,
    test: Vec<PyRef<'_, Recording>>,
    candidates: Option<Vec<String>>,
    hold: &str,
    seed: u64,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Diagnosis> {
    let options = Options { candidates, hold: door::short(py, || hold_named(hold))?, seed, threads };
    let owned = |records: &[PyRef<'_, Recording>]| records.iter().map(|r| r.core().clone()).collect::<Vec<_>>();
    let (model, train, test) = (model.core().clone(), owned(&train), owned(&test));
    let core = door::long(py, progress, move |outside| {
        let control = Control { cancelled: &outside.interrupted, progress: &*outside.tell };
        core::diagnose(&model, &train, &test, &options, &control)
    })?;
    Ok(Diagnosis { core })
}

#[pymethods]
impl Diagnosis {
    /// The diagnosis as one JSON object.
    fn json(&self) -> PyResult<String> {
        serde_json::to_string(&self.core).map_err(|e| from_panic(&e.to_string()))
    }

    /// The series behind the pictures: `records`, `force` and `law`, as arrays.
    fn traces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let traces = &self.core.traces;
        let dict = PyDict::new(py);
        let records = traces.records.iter().map(|record| of_record(py, record)).collect::<PyResult<Vec<_>>>()?;
        let force = traces.force.iter().map(|force| of_force(py, force)).collect::<PyResult<Vec<_>>>()?;
        dict.set_item("records", PyList::new(py, records)?)?;
        dict.set_item("force", PyList::new(py, force)?)?;
        dict.set_item("law", traces.law.as_ref().map(|law| of_law(py, law)).transpose()?)?;
        Ok(dict)
    }
}

/// Outputs of one record; a run that there is not is NaN throughout.
fn of_record<'py>(py: Python<'py>, record: &RecordTrace) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("name", &record.name)?;
    dict.set_item("role", if record.test { "test" } else { "train" })?;
    dict.set_item("t", record.t.to_pyarray(py))?;
    dict.set_item("output_names", &record.output_names)?;
    let (rows, width) = (record.t.len(), record.output_names.len());
    let runs = [
        ("measured", &record.measured),
        ("nominal", &record.nominal),
        ("before", &record.before),
        ("after", &record.after),
    ];
    for (name, values) in runs {
        let values = if values.is_empty() { vec![f64::NAN; rows * width] } else { values.clone() };
        dict.set_item(name, array::matrix(py, values, rows, width)?)?;
    }
    Ok(dict)
}

fn of_force<'py>(py: Python<'py>, force: &Force) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let words = [
        ("kind", &force.kind),
        ("record", &force.record),
        ("at", &force.at),
        ("unit", &force.unit),
        ("position_unit", &force.position_unit),
        ("velocity_unit", &force.velocity_unit),
    ];
    let series = [
        ("t", &force.t),
        ("position", &force.position),
        ("velocity", &force.velocity),
        ("force", &force.force),
        ("sd", &force.sd),
        ("phase", &force.phase),
    ];
    words.iter().try_for_each(|(name, word)| dict.set_item(name, word))?;
    series.iter().try_for_each(|(name, values)| dict.set_item(name, values.to_pyarray(py)))?;
    dict.set_item("modes", &force.modes)?;
    dict.set_item("mode", force.mode.iter().map(|m| *m as u32).collect::<Vec<_>>().to_pyarray(py))?;
    Ok(dict)
}

fn of_law<'py>(py: Python<'py>, law: &Law) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let words =
        [("at", &law.at), ("variable", &law.variable), ("unit", &law.unit), ("variable_unit", &law.variable_unit)];
    let series = [("grid", &law.grid), ("force", &law.force), ("sd", &law.sd)];
    words.iter().try_for_each(|(name, word)| dict.set_item(name, word))?;
    series.iter().try_for_each(|(name, values)| dict.set_item(name, values.to_pyarray(py)))?;
    Ok(dict)
}
