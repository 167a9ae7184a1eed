//! The verb `isolability` of the extension: planned records in, one JSON object out.

use std::collections::HashMap;

use ltp_core::diagnose::Control;
use ltp_core::diagnose::isolability::{self as core, Plan, Planned, Signal};
use pyo3::prelude::*;
use pyo3::types::PyMapping;

use crate::error::from_panic;
use crate::model::Model;
use crate::simulate::hold_named;
use crate::{array, door};

/// Which effects the planned records could tell apart, as JSON; `sensors` maps outputs or states to their noise, NaN for
/// `noise` times the motion.
#[pyfunction]
#[pyo3(signature = (model, records, *, t_end, dt, sensors=None, noise=0.01, size=0.05, effects=None, initial_state=None, hold="first-order", threads=0, progress=None))]
#[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
pub fn isolability(
    py: Python<'_>,
    model: &Model,
    records: Vec<Bound<'_, PyMapping>>,
    t_end: f64,
    dt: f64,
    sensors: Option<Vec<(String, f64)>>,
    noise: f64,
    size: f64,
    effects: Option<Vec<String>>,
    initial_state: Option<HashMap<String, f64>>,
    hold: &str,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let mut planned = Vec::new();
    for (k, record) in records.iter().enumerate() {
        let mut one = Planned { name: format!("record {}", k + 1), ..Planned::default() };
        one.initial_state = initial_state.clone().unwrap_or_default().into_iter().collect();
        for (name, value) in record.items()?.extract::<Vec<(String, Bound<'_, PyAny>)>>()? {
            let signal = match value.extract() {
                Ok(expression) => Signal::Expression(expression),
                Err(_) => Signal::Samples(array::vector(&format!("input `{name}`"), &value)?),
            };
            one.inputs.insert(name, signal);
        }
        planned.push(one);
    }
    let hold = door::short(py, || hold_named(hold))?;
    let sensors = sensors.map(|s| s.into_iter().collect());
    let plan = Plan { records: planned, t_end, dt, hold, sensors, noise, size, effects, threads };
    let model = model.core().clone();
    let found = door::long(py, progress, move |outside| {
        let control = Control { cancelled: &outside.interrupted, progress: &*outside.tell };
        core::isolability(&model, &plan, &control)
    })?;
    serde_json::to_string(&found).map_err(|e| from_panic(&e.to_string()))
}
