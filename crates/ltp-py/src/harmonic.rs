//! The verb `harmonic_map` of the extension: a model and recordings in, one JSON object out.

use ltp_core::diagnose::Control;
use ltp_core::diagnose::harmonic::{self as core, Options};
use pyo3::prelude::*;

use crate::door;
use crate::error::from_panic;
use crate::model::Model;
use crate::recording::Recording;
use crate::simulate::hold_named;

/// Where in harmonics and frequency recordings differ from a model with a clock, as JSON; `band` in rad/s.
#[pyfunction]
#[pyo3(signature = (model, recordings, *, harmonics=3, band=None, hold="first-order", progress=None))]
pub fn harmonic_map(
    py: Python<'_>,
    model: &Model,
    recordings: Vec<PyRef<'_, Recording>>,
    harmonics: usize,
    band: Option<f64>,
    hold: &str,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let options = Options { harmonics, band, hold: door::short(py, || hold_named(hold))? };
    let recordings: Vec<_> = recordings.iter().map(|r| r.core().clone()).collect();
    let model = model.core().clone();
    let found = door::long(py, progress, move |outside| {
        let control = Control { cancelled: &outside.interrupted, progress: &*outside.tell };
        core::harmonic_map(&model, &recordings, &options, &control)
    })?;
    serde_json::to_string(&found).map_err(|e| from_panic(&e.to_string()))
}
