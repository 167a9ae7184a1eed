//! The noun `Recording` of the extension.

use ltp_core::signal;
use numpy::{PyArray1, PyArray2, ToPyArray};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::{array, door};

/// Samples of one experiment on a uniform time grid; NaN in an output is a gap.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct Recording {
    core: signal::Recording,
    t: PyOnceLock<Py<PyArray1<f64>>>,
    inputs: PyOnceLock<Py<PyArray2<f64>>>,
    outputs: PyOnceLock<Py<PyArray2<f64>>>,
}

impl From<signal::Recording> for Recording {
    fn from(core: signal::Recording) -> Self {
        Self { core, t: PyOnceLock::new(), inputs: PyOnceLock::new(), outputs: PyOnceLock::new() }
    }
}

#[pymethods]
impl Recording {
    #[new]
    fn new(
        py: Python<'_>,
        name: &str,
        t: &Bound<'_, PyAny>,
        inputs: &Bound<'_, PyAny>,
        outputs: &Bound<'_, PyAny>,
        input_names: Vec<String>,
        output_names: Vec<String>,
    ) -> PyResult<Self> {
        let t = array::vector("t", t)?;
        let (inputs, outputs) = (array::columns("inputs", inputs)?, array::columns("outputs", outputs)?);
        let core = door::short(py, || signal::Recording::new(name, t, inputs, outputs, input_names, output_names))?;
        Ok(core.into())
    }

    /// What reports call the recording.
    #[getter]
    fn name(&self) -> &str {
        self.core.name()
    }

    /// Time of the samples (n,), s; read-only.
    #[getter]
    fn t(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        self.t.get_or_init(py, || array::freeze(self.core.t().to_pyarray(py))).clone_ref(py)
    }

    /// Inputs (n, nu) in the model's units; read-only.
    #[getter]
    fn inputs(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        self.matrix(py, &self.inputs, self.core.inputs(), self.core.input_names().len())
    }

    /// Outputs (n, ny) in the model's units, NaN in gaps; read-only.
    #[getter]
    fn outputs(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        self.matrix(py, &self.outputs, self.core.outputs(), self.core.output_names().len())
    }

    /// Sampling period, s.
    #[getter]
    fn dt(&self) -> f64 {
        self.core.dt()
    }

    /// What is doubtful about the recording, with numbers and advice.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.core.warnings().to_vec()
    }

    /// Names of the columns of `inputs`.
    #[getter]
    fn input_names(&self) -> Vec<String> {
        self.core.input_names().to_vec()
    }

    /// Names of the columns of `outputs`.
    #[getter]
    fn output_names(&self) -> Vec<String> {
        self.core.output_names().to_vec()
    }

    /// The same samples with the step and warnings they had in another process.
    fn restored(&self, py: Python<'_>, dt: f64, warnings: Vec<String>) -> PyResult<Self> {
        Ok(door::short(py, || self.core.clone().restored(dt, warnings))?.into())
    }

    /// The samples with `start <= t <= end` (s), times kept.
    fn slice(&self, py: Python<'_>, start: f64, end: f64) -> PyResult<Self> {
        Ok(door::short(py, || self.core.slice(start, end))?.into())
    }
}

impl Recording {
    /// The recording that the core knows.
    pub fn core(&self) -> &signal::Recording {
        &self.core
    }

    fn matrix(
        &self,
        py: Python<'_>,
        cell: &PyOnceLock<Py<PyArray2<f64>>>,
        values: &[f64],
        width: usize,
    ) -> PyResult<Py<PyArray2<f64>>> {
        let make = || array::matrix(py, values.to_vec(), self.core.len(), width).map(array::freeze);
        Ok(cell.get_or_try_init(py, make)?.clone_ref(py))
    }
}
