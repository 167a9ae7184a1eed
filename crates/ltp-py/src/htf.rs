//! The noun `Htf` of the extension.

use std::sync::Arc;

use ltp_core::error::Error;
use ltp_core::numeric::Complex;
use ltp_core::periodic;
use numpy::{PyArray1, PyArray2, PyArray4, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyMapping};

use crate::{array, door};

/// Harmonic transfer functions on a grid of input frequencies.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct Htf {
    core: Arc<periodic::Htf>,
    values: PyOnceLock<Py<PyArray4<Complex>>>,
    sd: PyOnceLock<Py<PyArray4<f64>>>,
    coherence: PyOnceLock<Py<PyArray2<f64>>>,
    omega: PyOnceLock<Py<PyArray1<f64>>>,
}

impl From<periodic::Htf> for Htf {
    fn from(core: periodic::Htf) -> Self {
        let (values, sd) = (PyOnceLock::new(), PyOnceLock::new());
        Self { core: Arc::new(core), values, sd, coherence: PyOnceLock::new(), omega: PyOnceLock::new() }
    }
}

#[pymethods]
impl Htf {
    /// Values (2K+1, n_omega, ny, nu) at the input frequencies `omega` (n_omega,), rad/s, of a system with `period` (s).
    #[new]
    #[pyo3(signature = (values, omega, period, sd, coherence, method, figures, warnings))]
    #[expect(clippy::too_many_arguments, reason = "they are the fields of the noun")]
    fn new(
        py: Python<'_>,
        values: &Bound<'_, PyAny>,
        omega: &Bound<'_, PyAny>,
        period: f64,
        sd: Option<&Bound<'_, PyAny>>,
        coherence: Option<&Bound<'_, PyAny>>,
        method: &str,
        figures: &Bound<'_, PyMapping>,
        warnings: Vec<String>,
    ) -> PyResult<Self> {
        let (values, shape) = array::complex_block("values", values)?;
        let omega = array::vector("omega", omega)?;
        let sd = sd.map(|sd| array::block("sd", sd)).transpose()?;
        let coherence = coherence.map(|coherence| array::rows("coherence", coherence)).transpose()?;
        let figures = array::numbers("figures", figures)?;
        let [rows, width, outputs, inputs] = shape;
        array::same("values: frequencies beside omega", omega.len(), width)?;
        if let Some((_, found)) = &sd {
            for (axis, (&expected, &found)) in shape.iter().zip(found).enumerate() {
                array::same(&format!("sd: axis {axis}, as of values"), expected, found)?;
            }
        }
        if let Some((_, found)) = &coherence {
            array::same("coherence: frequencies beside omega", width, found[0])?;
            array::same("coherence: outputs", outputs, found[1])?;
        }
        let core = door::short(py, || {
            if rows % 2 == 0 {
                let what = "values: rows, harmonics from -K to K".into();
                return Err(Error::OutOfRange { what, found: rows as f64, expected: "an odd number, 2K+1".into() });
            }
            let mut core = periodic::Htf::new(period, rows / 2, omega, (outputs, inputs), values, method)?;
            if let Some((sd, _)) = sd {
                core = core.with_sd(sd)?;
            }
            if let Some((coherence, _)) = coherence {
                core = core.with_coherence(coherence)?;
            }
            (core.figures, core.warnings) = (figures, warnings);
            Ok(core)
        })?;
        Ok(core.into())
    }

    /// Values (2K+1, n_omega, ny, nu), harmonics from -K to K; read-only.
    #[getter]
    fn values(&self, py: Python<'_>) -> PyResult<Py<PyArray4<Complex>>> {
        let make = || Ok::<_, PyErr>(array::freeze(self.core.values().to_pyarray(py).reshape(self.shape())?));
        Ok(self.values.get_or_try_init(py, make)?.clone_ref(py))
    }

    /// Standard deviations, shape as the values, or None; read-only.
    #[getter]
    fn sd(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray4<f64>>>> {
        let Some(sd) = self.core.sd() else { return Ok(None) };
        let make = || Ok::<_, PyErr>(array::freeze(sd.to_pyarray(py).reshape(self.shape())?));
        Ok(Some(self.sd.get_or_try_init(py, make)?.clone_ref(py)))
    }

    /// Coherence (n_omega, ny), or None; read-only.
    #[getter]
    fn coherence(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray2<f64>>>> {
        let Some(coherence) = self.core.coherence() else { return Ok(None) };
        let [_, rows, width, _] = self.shape();
        let make = || array::matrix(py, coherence.to_vec(), rows, width).map(array::freeze);
        Ok(Some(self.coherence.get_or_try_init(py, make)?.clone_ref(py)))
    }

    /// Input frequencies (n_omega,), rad/s; read-only.
    #[getter]
    fn omega(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        self.omega.get_or_init(py, || array::freeze(self.core.omega().to_pyarray(py))).clone_ref(py)
    }

    /// `H_k` (n,) at any frequencies `omega` (n,), rad/s, of both signs; zero beyond the grid.
    fn at<'py>(
        &self,
        py: Python<'py>,
        k: i64,
        omega: &Bound<'_, PyAny>,
        output: usize,
        input: usize,
    ) -> PyResult<Bound<'py, PyArray1<Complex>>> {
        let omega = array::vector("omega", omega)?;
        let values = door::short(py, || {
            self.signals(output, input)?;
            Ok(omega.iter().map(|&omega| self.core.at(k, omega, output, input)).collect::<Vec<_>>())
        })?;
        Ok(values.to_pyarray(py))
    }

    /// Outputs (n, ny) at times `t` (n,), s, settled under `amplitude * cos(omega t + phase)` on one input.
    fn steady_state<'py>(
        &self,
        py: Python<'py>,
        omega: f64,
        amplitude: f64,
        phase: f64,
        input: usize,
        t: &Bound<'_, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let t = array::vector("t", t)?;
        let outputs = door::short(py, || {
            self.signals(0, input)?;
            Ok(self.core.steady_state(omega, amplitude, phase, input, &t))
        })?;
        array::matrix(py, outputs, t.len(), self.core.outputs())
    }

    /// Outputs (n, ny) under an input (n, nu) that is zero before and after, with what is doubtful about them.
    fn predict<'py>(
        &self,
        py: Python<'py>,
        u: &Bound<'_, PyAny>,
        t0: f64,
        dt: f64,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Vec<String>)> {
        let (u, [rows, width]) = array::rows("u", u)?;
        let core = Arc::clone(&self.core);
        array::same("u: columns, as inputs", core.inputs(), width)?;
        let found = door::long(py, None, move |_| core.predict(&u, t0, dt))?;
        Ok((array::matrix(py, found.outputs, rows, self.core.outputs())?, found.warnings))
    }

    /// Period T, s.
    #[getter]
    fn period(&self) -> f64 {
        self.core.period()
    }

    /// How the values were found, in words.
    #[getter]
    fn method(&self) -> &str {
        &self.core.method
    }

    /// Named figures of the estimation.
    #[getter]
    fn figures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        self.core.figures.iter().try_for_each(|(name, value)| dict.set_item(name, value))?;
        Ok(dict)
    }

    /// What is doubtful, with numbers and advice.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.core.warnings.clone()
    }
}

impl Htf {
    /// The harmonic transfer functions that the core knows.
    pub fn core(&self) -> &periodic::Htf {
        &self.core
    }

    /// Refuses an output or input that is not there.
    fn signals(&self, output: usize, input: usize) -> ltp_core::Result<()> {
        let counts = [("output", output, self.core.outputs()), ("input", input, self.core.inputs())];
        match counts.into_iter().find(|(_, index, count)| index >= count) {
            None => Ok(()),
            Some((what, index, count)) => {
                let expected = format!("at most {}; they are counted from 0", count - 1);
                Err(Error::OutOfRange { what: what.into(), found: index as f64, expected })
            }
        }
    }

    fn shape(&self) -> [usize; 4] {
        let core = &self.core;
        [2 * core.harmonics() + 1, core.omega().len(), core.outputs(), core.inputs()]
    }
}
