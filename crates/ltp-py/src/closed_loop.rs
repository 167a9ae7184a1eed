//! The verbs `close`, `certify` and `track` of the extension, and the cost by simulation.

use std::sync::Arc;

use ltp_core::closed_loop::{self as core, Options, Search, Stage, Task};
use ltp_core::error::Result;
use ltp_core::numeric::Complex;
use ltp_core::numeric::fourier_series::FourierSeries;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyMapping};

use crate::feedforward::{Reference, series_of};
use crate::model::Model;
use crate::{array, door};

/// The model whose inputs follow a reference under a gain (K + 1, nu, nx, 1), by its Fourier coefficients `c_0..c_K`.
#[pyfunction]
pub fn close(py: Python<'_>, model: &Model, reference: &Reference, gain: &Bound<'_, PyAny>) -> PyResult<Model> {
    let gain = gain_of(py, reference, gain)?;
    Ok(door::short(py, || core::close(model.core(), reference.core(), &gain))?.into())
}

/// What every witness says of a closed loop, as a dict; `deviations` (n, nx), `spread` half ranges by parameter.
#[pyfunction]
#[pyo3(signature = (model, reference, gain, *, truncation, deviations, spread, horizon, tolerated))]
#[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
pub fn certify<'py>(
    py: Python<'py>,
    model: &Model,
    reference: &Reference,
    gain: &Bound<'py, PyAny>,
    truncation: usize,
    deviations: &Bound<'py, PyAny>,
    spread: &Bound<'py, PyMapping>,
    horizon: Option<f64>,
    tolerated: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let gain = gain_of(py, reference, gain)?;
    let (deviations, [_, width]) = array::rows("deviations", deviations)?;
    let spread = array::numbers("spread", spread)?;
    let options = door::short(py, || {
        let number = |(name, share): &(String, f64)| Ok((model.core().parameter(name)?, *share));
        Ok(Options {
            truncation,
            deviations: deviations.chunks_exact(width.max(1)).map(<[f64]>::to_vec).collect(),
            spread: spread.iter().map(number).collect::<Result<_>>()?,
            horizon,
            tolerated,
        })
    })?;
    let (plant, reference) = (model.core().clone(), reference.core().clone());
    let found = door::long(py, None, move |_| core::certify(&plant, &reference, &gain, &options))?;
    describe(py, &found)
}

/// A motion through stages of (reference, gain, end), as a dict of its samples and of what came of each stage.
#[pyfunction]
pub fn track<'py>(
    py: Python<'py>,
    model: &Model,
    stages: Vec<(Bound<'py, Reference>, Bound<'py, PyAny>, f64)>,
    deviation: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyDict>> {
    let stage = |(reference, gain, until): &(Bound<'py, Reference>, Bound<'py, PyAny>, f64)| {
        let gain = gain_of(py, reference.get(), gain)?;
        Ok(Stage { reference: reference.get().core().clone(), gain, until: *until })
    };
    let stages = stages.iter().map(stage).collect::<PyResult<Vec<_>>>()?;
    let (plant, deviation) = (model.core().clone(), array::vector("deviation", deviation)?);
    let (nx, nu) = (plant.states().len(), plant.inputs().len());
    let found = door::long(py, None, move |_| core::track(&plant, &stages, &deviation))?;
    let (n, dict) = (found.t.len(), PyDict::new(py));
    dict.set_item("t", found.t.into_pyarray(py))?;
    dict.set_item("states", array::matrix(py, found.states, n, nx)?)?;
    dict.set_item("references", array::matrix(py, found.references, n, nx)?)?;
    dict.set_item("inputs", array::matrix(py, found.inputs, n, nu)?)?;
    dict.set_item("ended", found.ended)?;
    let outcome = |stage: &core::track::Outcome| {
        let dict = PyDict::new(py);
        dict.set_item("start", stage.from)?;
        dict.set_item("until", stage.until)?;
        dict.set_item("settled", stage.settled.clone())?;
        dict.set_item("steady", stage.steady.clone())?;
        dict.set_item("feedback", stage.feedback.clone())?;
        PyResult::Ok(dict)
    };
    dict.set_item("stages", PyList::new(py, found.stages.iter().map(outcome).collect::<PyResult<Vec<_>>>()?)?)?;
    Ok(dict)
}

/// A cost by simulation, compiled once.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct SimulationCost {
    core: Arc<core::SimulationCost>,
}

#[pymethods]
impl SimulationCost {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
    fn new(
        py: Python<'_>,
        model: &Model,
        reference: &Reference,
        deviation: Vec<f64>,
        weights: Vec<f64>,
        steady_weights: Vec<f64>,
        steady_from: f64,
        t_end: f64,
        dt: f64,
        harmonics: Vec<usize>,
    ) -> PyResult<Self> {
        let task = Task { deviation, weights, steady_weights, steady_from, t_end, dt, harmonics };
        let core = door::short(py, || core::SimulationCost::new(model.core(), reference.core(), task))?;
        Ok(Self { core: Arc::new(core) })
    }

    /// Numbers in a gain.
    fn __len__(&self) -> usize {
        self.core.len()
    }

    /// Costs (n,) of gains (n, numbers), infinite where the motion is lost; evaluated side by side.
    fn evaluate<'py>(&self, py: Python<'py>, gains: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (gains, [_, width]) = array::rows("gains", gains)?;
        array::same("numbers in a gain", self.core.len(), width)?;
        let core = Arc::clone(&self.core);
        Ok(door::long(py, None, move |_| Ok(core.evaluate_all(&gains)))?.into_pyarray(py))
    }

    /// The gain of least cost that a particle swarm finds, as Fourier coefficients (K + 1, nu nx), and its figures by name.
    #[pyo3(signature = (*, limit, particles, rounds, descent, budget, seed))]
    #[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
    fn design<'py>(
        &self,
        py: Python<'py>,
        limit: f64,
        particles: usize,
        rounds: usize,
        descent: usize,
        budget: usize,
        seed: u64,
    ) -> PyResult<Design<'py>> {
        let (core, search) = (Arc::clone(&self.core), Search { limit, particles, rounds, descent, budget, seed });
        let found = door::long(py, None, move |_| core::design_by_simulation(&core, &search))?;
        let lines = found.gain.coefficients().to_pyarray(py);
        Ok((lines.reshape([found.gain.harmonics() + 1, found.gain.rows()])?, found.figures))
    }
}

/// Fourier coefficients of a gain, and figures by name.
type Design<'py> = (Bound<'py, PyArray2<Complex>>, Vec<(String, f64)>);

/// The gain of a reference's period.
fn gain_of(py: Python<'_>, reference: &Reference, gain: &Bound<'_, PyAny>) -> PyResult<FourierSeries> {
    series_of(py, "gain", reference.core().period(), gain)
}

fn describe<'py>(py: Python<'py>, found: &core::Certificate) -> PyResult<Bound<'py, PyDict>> {
    let numbers = |values: &[Complex]| values.to_pyarray(py);
    let dict = PyDict::new(py);
    dict.set_item("verdict", found.verdict.to_string())?;
    dict.set_item("sentence", &found.sentence)?;
    dict.set_item("reasons", &found.reasons)?;
    dict.set_item("defect", &found.defect)?;
    dict.set_item("open", numbers(&found.open))?;
    dict.set_item("exponents", numbers(&found.exponents))?;
    let lifted = found.lifted.iter().map(|l| (l.truncation, l.all, l.central, l.distance));
    dict.set_item("lifted", lifted.collect::<Vec<_>>())?;
    dict.set_item("no_orbit", &found.no_orbit)?;
    let orbit = |orbit: &core::Orbit| {
        let lines = orbit.states.coefficients().to_pyarray(py);
        let lines = lines.reshape([orbit.states.harmonics() + 1, orbit.states.rows()])?;
        PyResult::Ok((numbers(&orbit.exponents), orbit.error.clone(), lines))
    };
    dict.set_item("orbit", found.orbit.as_ref().map(orbit).transpose()?)?;
    let runs = PyList::empty(py);
    for (k, run) in found.runs.iter().enumerate() {
        let dict = PyDict::new(py);
        dict.set_item("deviation", run.deviation.clone())?;
        dict.set_item("horizon", run.horizon)?;
        dict.set_item("settled", run.settled.clone())?;
        dict.set_item("steady", run.steady.clone())?;
        dict.set_item("feedback", run.feedback.clone())?;
        dict.set_item("growth", run.growth)?;
        dict.set_item("returns", run.returns)?;
        dict.set_item("ended", run.ended.clone())?;
        let tolerated = found.tolerated.get(k);
        dict.set_item("tolerated", tolerated.map(|t| t.multiple))?;
        dict.set_item("at_least", tolerated.is_some_and(|t| t.at_least))?;
        runs.append(dict)?;
    }
    dict.set_item("runs", runs)?;
    let cases = |spread: &core::Spread| {
        let case = |c: &core::Case| (c.changes.clone(), c.slowest, c.error.clone());
        spread.cases.iter().map(case).collect::<Vec<_>>()
    };
    dict.set_item("spread", found.spread.as_ref().map(cases))?;
    Ok(dict)
}
