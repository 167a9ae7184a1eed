//! The verb `feedforward` and the noun `Reference` of the extension.

use ltp_core::error::Result;
use ltp_core::feedforward::{self as core, Options, Sinusoid, number};
use ltp_core::model::System;
use ltp_core::numeric::Complex;
use ltp_core::numeric::fourier_series::FourierSeries;
use numpy::{PyArray1, PyArray2, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyMapping;

use crate::interrupt::Interruptible;
use crate::model::Model;
use crate::{array, door};

/// Name of a state, then amplitude, phase (rad) and offset.
type Named = (String, f64, f64, f64);

/// A periodic motion to be followed, with the inputs that go with it.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct Reference {
    core: core::Reference,
}

/// The motion whose one state is a sinusoid (amplitude, phase, offset) of `omega`, rad/s, and the input that makes it.
///
/// `inputs` are constant values of the others; `start` is a state, or a reference, to start from.
#[pyfunction]
#[pyo3(signature = (model, state, sinusoid, omega, *, harmonics, input, inputs, start=None, start_from=None))]
#[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
pub fn feedforward(
    py: Python<'_>,
    model: &Model,
    state: &str,
    sinusoid: (f64, f64, f64),
    omega: f64,
    harmonics: usize,
    input: &str,
    inputs: &Bound<'_, PyMapping>,
    start: Option<&Bound<'_, PyMapping>>,
    start_from: Option<&Reference>,
) -> PyResult<Reference> {
    let inputs = array::numbers("inputs", inputs)?;
    let start = start.map(|given| array::numbers("start", given)).transpose()?;
    let system = model.compiled(py)?;
    let (coordinate, wanted, options) = door::short(py, || {
        let states = names(model);
        let wanted = named(sinusoid).series(omega)?;
        let start = match (&start, start_from) {
            (Some(given), _) => Some(at_rest(&*system, &states, given, wanted.period())?),
            (None, from) => from.map(|reference| reference.core.states.clone()),
        };
        let input = number("input", input, &model.core().inputs())?;
        let options = Options { harmonics, input, inputs: constants(model, &inputs)?, start, mode: None };
        Ok((number("state", state, &states)?, wanted, options))
    })?;
    let core = door::long(py, None, move |outside| {
        let parameters = system.parameters().to_vec();
        let system = Interruptible::new(system, outside.interrupted);
        core::feedforward(&system, &parameters, coordinate, &wanted, &options)
    })?;
    Ok(core.into())
}

#[pymethods]
impl Reference {
    /// Sinusoidal states with the input that explains them best.
    #[staticmethod]
    fn of_sinusoids(
        py: Python<'_>,
        model: &Model,
        omega: f64,
        states: Vec<Named>,
        input: &str,
        inputs: &Bound<'_, PyMapping>,
    ) -> PyResult<Self> {
        let inputs = array::numbers("inputs", inputs)?;
        let core = door::short(py, || {
            let all = names(model);
            let given = states.iter().map(|(name, a, b, c)| Ok((number("state", name, &all)?, named((*a, *b, *c)))));
            let given = given.collect::<Result<Vec<_>>>()?;
            let input = number("input", input, &model.core().inputs())?;
            core::Reference::of_sinusoids(model.core(), omega, &given, input, &constants(model, &inputs)?)
        })?;
        Ok(core.into())
    }

    /// States (K + 1, nx, 1, 1) and inputs (K + 1, nu, 1, 1) by their Fourier coefficients `c_0..c_K`, as they are.
    #[staticmethod]
    fn of_coefficients(
        py: Python<'_>,
        model: &Model,
        period: f64,
        states: &Bound<'_, PyAny>,
        inputs: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (states, inputs) = (series_of(py, "states", period, states)?, series_of(py, "inputs", period, inputs)?);
        let system = model.compiled(py)?;
        let core = door::short(py, || {
            core::Reference::new(&*system, system.parameters(), system.initial_mode(), states, inputs)
        })?;
        Ok(core.into())
    }

    /// Period, s.
    #[getter]
    fn period(&self) -> f64 {
        self.core.period()
    }

    /// Per state, the rms of what the equations leave over, relative to that of its rate.
    #[getter]
    fn defect(&self) -> Vec<f64> {
        self.core.defect.clone()
    }

    /// Half the peak-to-peak range of each state (nx,).
    #[getter]
    fn amplitudes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.core.amplitudes().to_pyarray(py)
    }

    /// Fourier coefficients `c_0..c_K` of the states (K + 1, nx).
    #[getter]
    fn state_coefficients<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Complex>>> {
        coefficients(py, &self.core.states)
    }

    /// Fourier coefficients `c_0..c_K` of the inputs (K + 1, nu).
    #[getter]
    fn input_coefficients<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Complex>>> {
        coefficients(py, &self.core.inputs)
    }

    /// States (n, nx) at the times `t` (n,), s.
    fn states<'py>(&self, py: Python<'py>, t: &Bound<'_, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        values(py, &self.core.states, t)
    }

    /// Inputs (n, nu) at the times `t` (n,), s.
    fn inputs<'py>(&self, py: Python<'py>, t: &Bound<'_, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        values(py, &self.core.inputs, t)
    }

    /// The reference ahead by `time`, s.
    fn ahead(&self, time: f64) -> Self {
        self.core.ahead(time).into()
    }

    /// The reference with an amount added to one state.
    fn shifted(&self, py: Python<'_>, state: usize, amount: f64) -> PyResult<Self> {
        Ok(door::short(py, || self.core.shifted(state, amount))?.into())
    }
}

impl From<core::Reference> for Reference {
    fn from(core: core::Reference) -> Self {
        Self { core }
    }
}

impl Reference {
    /// The reference that the core knows.
    pub fn core(&self) -> &core::Reference {
        &self.core
    }
}

/// A periodic signal from its Fourier coefficients `c_0..c_K` (K + 1, rows, columns, 1), row-major at each harmonic.
pub fn series_of(py: Python<'_>, argument: &str, period: f64, values: &Bound<'_, PyAny>) -> PyResult<FourierSeries> {
    let (values, [_, rows, columns, _]) = array::complex_block(argument, values)?;
    door::short(py, || FourierSeries::new(period, rows * columns, values))
}

fn values<'py>(py: Python<'py>, series: &FourierSeries, t: &Bound<'_, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let t = array::vector("t", t)?;
    let values = py.detach(|| t.iter().flat_map(|&t| series.value(t)).collect());
    array::matrix(py, values, t.len(), series.rows())
}

fn coefficients<'py>(py: Python<'py>, series: &FourierSeries) -> PyResult<Bound<'py, PyArray2<Complex>>> {
    series.coefficients().to_pyarray(py).reshape([series.harmonics() + 1, series.rows()])
}

fn names(model: &Model) -> Vec<&str> {
    model.core().states().iter().map(String::as_str).collect()
}

fn named((amplitude, phase, offset): (f64, f64, f64)) -> Sinusoid {
    Sinusoid { amplitude, phase, offset }
}

/// Constant inputs in the model's order, zero where not given.
fn constants(model: &Model, given: &[(String, f64)]) -> Result<Vec<f64>> {
    let names = model.core().inputs();
    let mut out = vec![0.0; names.len()];
    for (name, value) in given {
        out[number("input", name, &names)?] = *value;
    }
    Ok(out)
}

/// The system's initial state with some values replaced, as a motion at rest.
fn at_rest(system: &dyn System, states: &[&str], given: &[(String, f64)], period: f64) -> Result<FourierSeries> {
    let mut x = system.initial_state();
    for (name, value) in given {
        x[number("state", name, states)?] = *value;
    }
    FourierSeries::constant(period, &x)
}
