//! The periodic ARX model of the extension, and its score on held-out groups.

use ltp_core::identify::{arx as core, held_out};
use numpy::{PyArray2, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::recording::Recording;
use crate::unclocked::Phase;
use crate::{array, door};

/// A discrete linear time-periodic model with coefficients over phase.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct PeriodicArx {
    core: core::PeriodicArx,
}

/// Estimates a periodic ARX model; `lags` are those of outputs and inputs, in spacings of `spacing` samples.
#[pyfunction]
#[pyo3(signature = (
    recording, phase, inputs, outputs, *, lags=(3, 3), spacing=1, harmonics=2, offset=8, draws=200, seed=0
))]
#[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
pub fn identify_arx(
    py: Python<'_>,
    recording: &Recording,
    phase: &Phase,
    inputs: Vec<String>,
    outputs: Vec<String>,
    lags: (usize, usize),
    spacing: usize,
    harmonics: usize,
    offset: usize,
    draws: usize,
    seed: u64,
) -> PyResult<PeriodicArx> {
    let (output_lags, input_lags) = lags;
    let options = core::Options { inputs, outputs, output_lags, input_lags, spacing, harmonics, offset, draws, seed };
    let (recording, phase) = (recording.core().clone(), phase.core().clone());
    let core = door::long(py, None, move |_| core::identify_arx(&recording, &phase, &options))?;
    Ok(PeriodicArx { core })
}

#[pymethods]
impl PeriodicArx {
    /// Standard deviation of the one-step errors, by output.
    #[getter]
    fn noise_sd(&self) -> Vec<f64> {
        self.core.noise_sd.clone()
    }

    /// Rows fitted, and unknowns per output.
    #[getter]
    fn size(&self) -> (usize, usize) {
        self.core.size
    }

    /// Groups of cycles behind the uncertainty.
    #[getter]
    fn groups(&self) -> usize {
        self.core.groups
    }

    /// What is doubtful, with numbers and advice.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.core.warnings.clone()
    }

    /// Free run (n, ny) through the good segments of a recording; NaN elsewhere.
    fn predict<'py>(
        &self,
        py: Python<'py>,
        recording: &Recording,
        phase: &Phase,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let values = door::short(py, || self.core.predict(recording.core(), phase.core()))?;
        array::matrix(py, values, recording.core().len(), self.core.options.outputs.len())
    }

    /// Time (m,), deviations (m, ny) after a unit step of an input at a phase, and their standard deviations.
    fn step_response<'py>(
        &self,
        py: Python<'py>,
        input: &str,
        phase: f64,
        duration: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let step = door::short(py, || self.core.step_response(input, phase, duration))?;
        let (rows, width) = (step.t.len(), self.core.options.outputs.len());
        let dict = PyDict::new(py);
        dict.set_item("t", step.t.to_pyarray(py))?;
        dict.set_item("values", array::matrix(py, step.values, rows, width)?)?;
        dict.set_item("sd", array::matrix(py, step.sd, rows, width)?)?;
        Ok(dict)
    }

    /// The score of the same options with one group of cycles after the other left out.
    fn held_out(&self, py: Python<'_>, recording: &Recording, phase: &Phase) -> PyResult<HeldOut> {
        let (recording, phase, options) = (recording.core().clone(), phase.core().clone(), self.core.options.clone());
        let core = door::long(py, None, move |_| held_out::held_out(&recording, &phase, &options))?;
        Ok(HeldOut { core })
    }
}

/// Errors on held-out groups, segment by segment.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct HeldOut {
    core: held_out::HeldOut,
}

#[pymethods]
impl HeldOut {
    /// Group of each scored segment.
    #[getter]
    fn group(&self) -> Vec<usize> {
        self.core.group.clone()
    }

    /// Free runs (n, ny) of the models that did not see them; NaN elsewhere.
    #[getter]
    fn prediction<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let width = self.core.outputs.len();
        array::matrix(py, self.core.prediction.clone(), self.core.prediction.len() / width, width)
    }

    /// Root mean square errors by output: of the model, of the mean orbit, of the cycle before.
    #[getter]
    fn rms(&self) -> [Vec<f64>; 3] {
        [&self.core.model, &self.core.orbit, &self.core.previous]
            .map(|errors| (0..self.core.outputs.len()).map(|j| self.core.rms(errors, j)).collect())
    }

    /// The same by output and group.
    #[getter]
    fn rms_by_group(&self) -> [Vec<Vec<f64>>; 3] {
        [&self.core.model, &self.core.orbit, &self.core.previous]
            .map(|errors| (0..self.core.outputs.len()).map(|j| self.core.rms_by_group(errors, j)).collect())
    }

    /// rms over that of a rival ("orbit", "previous") or of another score's model, with its 95 % interval, by output.
    #[pyo3(signature = (rival, *, draws=2000, seed=0))]
    fn ratio(&self, rival: &Bound<'_, PyAny>, draws: usize, seed: u64) -> PyResult<Vec<(f64, f64, f64)>> {
        let other = rival.cast::<HeldOut>().ok();
        let word = rival.extract::<String>().unwrap_or_default();
        let errors = match (&other, word.as_str()) {
            (Some(score), _) => &score.get().core.model,
            (None, "orbit") => &self.core.orbit,
            (None, "previous") => &self.core.previous,
            _ => {
                let text = format!("rival is {rival}, expected \"orbit\", \"previous\" or another score; correct it");
                return Err(crate::error::InputError::new_err(text));
            }
        };
        let one = |j| door::short(rival.py(), || self.core.ratio(errors, j, draws, seed));
        let ratios = (0..self.core.outputs.len()).map(one).collect::<PyResult<Vec<_>>>()?;
        Ok(ratios.into_iter().map(|r| (r.value, r.interval.0, r.interval.1)).collect())
    }
}
