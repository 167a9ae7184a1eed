//! The verb `cycle` and the noun `LimitCycle` of the extension.

use std::sync::Arc;

use ltp_core::cycle::{self as core, Options, Survey};
use ltp_core::error::{Error, Result};
use ltp_core::model::{Compiled, System};
use ltp_core::numeric::Complex;
use numpy::{PyArray1, PyArray2, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};

use crate::interrupt::Interruptible;
use crate::model::Model;
use crate::simulate::{initial, unknown};
use crate::trajectory::Trajectory;
use crate::{array, door};

/// A periodic orbit of a model, and what a survey around it found.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct LimitCycle {
    core: core::LimitCycle,
    survey: Option<Survey>,
    model: Py<Model>,
    system: Arc<Compiled>,
}

/// The periodic orbit that a start leads to or lies near; `probes` starts around it say how far it attracts.
#[pyfunction]
#[pyo3(signature = (
    model, *, start=None, mode=None, period=None, inputs=None, settle=None, steps=None, probes=0, seed=0
))]
#[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
pub fn cycle(
    py: Python<'_>,
    model: &Bound<'_, Model>,
    start: Option<&Bound<'_, PyMapping>>,
    mode: Option<&str>,
    period: Option<f64>,
    inputs: Option<&Bound<'_, PyMapping>>,
    settle: Option<usize>,
    steps: Option<u64>,
    probes: usize,
    seed: u64,
) -> PyResult<LimitCycle> {
    let start = start.map(|given| array::numbers("start", given)).transpose()?;
    let inputs = inputs.map_or(Ok(Vec::new()), |given| array::numbers("inputs", given))?;
    let own = model.get();
    let system = own.compiled(py)?;
    let options = door::short(py, || {
        let defaults = Options::default();
        Ok(Options {
            start: start.map(|given| initial(own.core(), &system, "start", &given)).transpose()?,
            mode: mode.map(|mode| own.core().mode(mode)).transpose()?,
            period,
            inputs: constants(own, &inputs)?,
            settle,
            steps: steps.unwrap_or(defaults.steps),
        })
    })?;
    let ready = Arc::clone(&system);
    let (core, survey) = door::long(py, None, move |outside| {
        let parameters = ready.parameters().to_vec();
        let system = Interruptible::new(ready, outside.interrupted);
        let orbit = core::cycle(&system, &parameters, &options)?;
        let around = |probes| core::survey(&system, &parameters, &orbit, probes, seed);
        let survey = (probes > 0).then(|| around(probes)).transpose()?;
        Ok((orbit, survey))
    })?;
    Ok(LimitCycle { core, survey, model: model.clone().unbind(), system })
}

#[pymethods]
impl LimitCycle {
    /// Period, s.
    #[getter]
    fn period(&self) -> f64 {
        self.core.period
    }

    /// Whether the period was found rather than given by a clock.
    #[getter]
    fn autonomous(&self) -> bool {
        self.core.autonomous
    }

    /// State (nx,) at time zero.
    #[getter]
    fn start<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.core.start.to_pyarray(py)
    }

    /// State (nx,) from which it was found.
    #[getter]
    fn found_from<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.core.found_from.to_pyarray(py)
    }

    /// One period, sampled evenly.
    fn trajectory(&self, py: Python<'_>) -> PyResult<Trajectory> {
        Trajectory::new(py, self.core.trajectory.clone(), &self.system, self.model.get().core(), &[])
    }

    /// Each event as (name, time, phase, mode before, mode after).
    #[getter]
    fn events(&self) -> Vec<(String, f64, f64, String, String)> {
        let name = |mode| self.system.mode_name(mode);
        let event = |e: &core::CycleEvent| (e.name.clone(), e.time, e.phase, name(e.mode_before), name(e.mode_after));
        self.core.events.iter().map(event).collect()
    }

    /// Monodromy matrix (nx, nx) at time zero.
    #[getter]
    fn monodromy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let nx = self.core.start.len();
        array::matrix(py, self.core.monodromy.clone(), nx, nx)
    }

    /// Floquet multipliers (nx,), largest magnitude first.
    #[getter]
    fn multipliers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Complex>> {
        self.core.multipliers.to_pyarray(py)
    }

    /// Indices of the states that no mode of the orbit moves.
    #[getter]
    fn held(&self) -> Vec<usize> {
        self.core.held.clone()
    }

    /// Whether small disturbances die out.
    #[getter]
    fn stable(&self) -> bool {
        self.core.stable
    }

    /// How it was found, by name.
    #[getter]
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        dict.set_item("settled", self.core.settled)?;
        dict.set_item("iterations", self.core.iterations)?;
        dict.set_item("residual", self.core.residual)?;
        dict.set_item("integration_error", self.core.integration_error)?;
        Ok(dict)
    }

    /// How many starts were sent, how many came back, and the distance within which all did; None without a survey.
    #[getter]
    fn domain(&self) -> Option<(usize, usize, f64)> {
        self.survey.as_ref().map(|survey| (survey.probes, survey.returned, survey.radius))
    }

    /// Other orbits that the survey ended on, each with the number of starts.
    #[getter]
    fn others(&self, py: Python<'_>) -> Vec<(Self, usize)> {
        let orbit = |core: &core::LimitCycle| {
            let (core, model, system) = (core.clone(), self.model.clone_ref(py), Arc::clone(&self.system));
            Self { core, survey: None, model, system }
        };
        self.survey.iter().flat_map(|survey| &survey.others).map(|(core, starts)| (orbit(core), *starts)).collect()
    }

    /// Starts of the survey that ended on no periodic orbit, each with the reason.
    #[getter]
    fn lost(&self) -> Vec<(Vec<f64>, String)> {
        self.survey.iter().flat_map(|survey| survey.lost.clone()).collect()
    }

    /// What is doubtful, with numbers and advice.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.core.warnings.clone()
    }
}

impl LimitCycle {
    /// The orbit that the core knows.
    pub fn core(&self) -> &core::LimitCycle {
        &self.core
    }
}

/// Constant inputs in the model's order; one that is not given has the default of the document, or is zero.
fn constants(model: &Model, given: &[(String, f64)]) -> Result<Vec<f64>> {
    let inputs = &model.core().document().inputs;
    if let Some((name, _)) = given.iter().find(|(name, _)| !inputs.contains_key(name)) {
        return Err(unknown("input", name, &model.core().inputs(), model.core().name()));
    }
    let value = |name: &String, otherwise: Option<f64>| {
        let found = given.iter().find(|(other, _)| other == name).map(|(_, value)| *value);
        match found.or(otherwise).unwrap_or(0.0) {
            value if value.is_finite() => Ok(value),
            found => {
                let expected = "a finite number; correct it".into();
                Err(Error::OutOfRange { what: format!("constant input `{name}`"), found, expected })
            }
        }
    };
    inputs.iter().map(|(name, input)| value(name, input.value)).collect()
}
