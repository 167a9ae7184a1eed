//! The section map of the extension.

use ltp_core::identify::section::{self as core, Coordinate, Intercept, Options};
use numpy::{Complex64, IntoPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::recording::Recording;
use crate::unclocked::Phase;
use crate::{array, door};

/// Estimates the map of the section at a phase; `coordinates` are (channel, whether its rate is meant).
#[pyfunction]
#[pyo3(signature = (recording, phase, at, coordinates, *, window=5, per_run=false, draws=1000, seed=0))]
#[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
pub fn identify_map<'py>(
    py: Python<'py>,
    recording: &Recording,
    phase: &Phase,
    at: f64,
    coordinates: Vec<(String, bool)>,
    window: usize,
    per_run: bool,
    draws: usize,
    seed: u64,
) -> PyResult<Bound<'py, PyDict>> {
    let coordinates: Vec<_> = coordinates.into_iter().map(|(channel, rate)| Coordinate { channel, rate }).collect();
    let width = coordinates.len();
    let intercept = if per_run { Intercept::PerRun } else { Intercept::Common };
    let options = Options { phase: at, coordinates, window, intercept, draws, seed };
    let (recording, phase) = (recording.core().clone(), phase.core().clone());
    let map = door::long(py, None, move |_| core::identify_map(&recording, &phase, &options))?;
    let dict = PyDict::new(py);
    dict.set_item("claims", map.claims())?;
    dict.set_item("states", array::matrix(py, map.states.clone(), map.states.len() / width, width)?)?;
    dict.set_item("matrix", array::matrix(py, map.matrix, width, width)?)?;
    dict.set_item("matrix_sd", array::matrix(py, map.matrix_sd, width, width)?)?;
    let multipliers: Vec<Complex64> = map.multipliers.iter().map(|m| Complex64::new(m.re, m.im)).collect();
    dict.set_item("multipliers", multipliers.into_pyarray(py))?;
    dict.set_item("magnitude", map.magnitude)?;
    dict.set_item("pairs", map.pairs)?;
    dict.set_item("groups", map.groups)?;
    let ratio = |r: ltp_core::identify::held_out::Ratio| (r.value, r.interval.0, r.interval.1);
    dict.set_item("against_mean", ratio(map.against_mean))?;
    dict.set_item("against_previous", ratio(map.against_previous))?;
    dict.set_item("warnings", map.warnings)?;
    Ok(dict)
}
