//! The noun `Trajectory` of the extension.

use std::collections::HashMap;

use ltp_core::model::{self, Compiled, System};
use ltp_core::simulate as core;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyString};
use serde_json::Value;

use crate::array;
use crate::error::from_panic;

/// A simulated run; it ends early where the simulation did.
#[pyclass(frozen, get_all, module = "ltp._ltp")]
pub struct Trajectory {
    /// Time (n,), s.
    t: Py<PyArray1<f64>>,
    /// States (n, nx), those of attached effects last.
    states: Py<PyArray2<f64>>,
    /// Inputs (n, nu).
    inputs: Py<PyArray2<f64>>,
    /// Outputs (n, ny).
    outputs: Py<PyArray2<f64>>,
    /// Name of the mode at each sample, n of them.
    mode: Py<PyList>,
    /// Each event as (name, time, mode before, mode after).
    events: Py<PyList>,
    /// How it ended, as a dict of reason, time, mode and message.
    stop: Py<PyDict>,
    /// What it cost, by name.
    stats: Py<PyDict>,
}

impl Trajectory {
    /// A run of the core. Inputs that were `expressions` ran as further outputs, and return to their places here.
    pub fn new(
        py: Python<'_>,
        run: core::Trajectory,
        system: &Compiled,
        model: &model::Model,
        expressions: &[(String, String)],
    ) -> PyResult<Self> {
        let rows = run.t.len();
        let mut names = HashMap::new();
        let mut name = |mode| names.entry(mode).or_insert_with(|| PyString::new(py, &system.mode_name(mode))).clone();
        let mode = PyList::new(py, run.mode.iter().map(|&mode| name(mode)).collect::<Vec<_>>())?;
        let events = run.events.iter().map(|e| (&e.name, e.time, name(e.mode_before), name(e.mode_after)));
        let events = PyList::new(py, events.collect::<Vec<_>>())?;
        let stop = stop(py, &run, &mode)?;
        let stats = PyDict::new(py);
        for (name, value) in tree(serde_json::to_value(run.stats))?.as_object().into_iter().flatten() {
            stats.set_item(name, number(py, value)?)?;
        }
        let (inputs, outputs) = if expressions.is_empty() {
            let inputs = array::matrix(py, run.inputs, rows, system.inputs())?;
            (inputs, array::matrix(py, run.outputs, rows, system.outputs())?)
        } else {
            let (sampled, measured) = (system.inputs(), model.outputs().len());
            let mut next = 0..sampled;
            let place = |name: &&str| match expressions.iter().position(|(other, _)| other == name) {
                Some(k) => Some(sampled + measured + k),
                None => next.next(),
            };
            let places: Vec<usize> = model.inputs().iter().filter_map(place).collect();
            let measured: Vec<usize> = (sampled..sampled + measured).collect();
            let (left, right) = ((run.inputs.as_slice(), sampled), (run.outputs.as_slice(), system.outputs()));
            (array::pick(py, rows, left, right, &places)?, array::pick(py, rows, left, right, &measured)?)
        };
        Ok(Self {
            t: run.t.into_pyarray(py).unbind(),
            states: array::matrix(py, run.states, rows, system.states())?.unbind(),
            inputs: inputs.unbind(),
            outputs: outputs.unbind(),
            mode: mode.unbind(),
            events: events.unbind(),
            stop: stop.unbind(),
            stats: stats.unbind(),
        })
    }
}

/// How a run ended. One that reached its end has the time and mode of its last sample.
fn stop<'py>(py: Python<'py>, run: &core::Trajectory, mode: &Bound<'py, PyList>) -> PyResult<Bound<'py, PyDict>> {
    let fields = tree(serde_json::to_value(&run.stop))?;
    let stop = PyDict::new(py);
    stop.set_item("reason", fields["reason"].as_str())?;
    stop.set_item("time", fields["time"].as_f64().or(run.t.last().copied()))?;
    match fields["mode"].as_str() {
        Some(mode) => stop.set_item("mode", mode)?,
        None => stop.set_item("mode", mode.iter().last())?,
    }
    stop.set_item("message", run.stop.sentence())?;
    Ok(stop)
}

/// The fields of a small value of the core, which always has them.
fn tree(fields: serde_json::Result<Value>) -> PyResult<Value> {
    fields.map_err(|e| from_panic(&e.to_string()))
}

fn number<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    match value.as_u64() {
        Some(count) => count.into_bound_py_any(py),
        None => value.as_f64().into_bound_py_any(py),
    }
}
