//! The verb `control` of the extension: feedback for linear time-periodic systems, and what it is judged by.

use std::sync::Arc;

use ltp_core::control as core;
use ltp_core::control::{Damping, Exact, Law, Lifted, Measure, Options, Quadratic, Search, Spectrum, Weights};
use ltp_core::numeric::Complex;
use numpy::{IntoPyArray, PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

use crate::error::{Failure, InputError};
use crate::linearize::LtpSystem;
use crate::{array, door};

/// State feedback `u = -K(t) x`.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct Feedback {
    core: core::Feedback,
    nx: usize,
}

/// Bounds on a quadratic form of a gain: Q (nx, nx), least, most.
type Form<'py> = (Bound<'py, PyAny>, Option<f64>, Option<f64>);

#[pymethods]
impl Feedback {
    /// A gain from its complex harmonics (h + 1, nu, nx, 1).
    #[staticmethod]
    fn of_harmonics(py: Python<'_>, period: f64, harmonics: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (values, [_, nu, nx, _]) = array::complex_block("harmonics", harmonics)?;
        Ok(Self { core: door::short(py, || core::Feedback::of_harmonics(period, nu * nx, &values))?, nx })
    }

    /// Period, s.
    #[getter]
    fn period(&self) -> f64 {
        self.core.gain.period()
    }

    /// Complex harmonics `K_h` (h + 1, nu, nx).
    #[getter]
    fn harmonics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<Complex>>> {
        let nu = self.core.gain.rows() / self.nx;
        self.core.harmonics().into_pyarray(py).reshape([self.core.gain.harmonics() + 1, nu, self.nx])
    }

    /// K(t) at times (n,), s: (n, nu, nx).
    fn at<'py>(&self, py: Python<'py>, t: &Bound<'_, PyAny>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let times = array::vector("t", t)?;
        let values: Vec<f64> = times.iter().flat_map(|t| self.core.gain.value(*t)).collect();
        values.into_pyarray(py).reshape([times.len(), self.core.gain.rows() / self.nx, self.nx])
    }

    /// How it was found.
    #[getter]
    fn method(&self) -> &str {
        &self.core.method
    }

    /// Figures by name.
    #[getter]
    fn figures(&self) -> Vec<(String, f64)> {
        self.core.figures.clone()
    }

    /// What is doubtful.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.core.warnings.clone()
    }
}

/// The objective by its name: "lifted" or "floquet"; modes "all" or "central".
fn measure(objective: &str, modes: &str, truncation: usize) -> PyResult<Measure> {
    let all = match modes {
        "all" => true,
        "central" => false,
        _ => return Err(unknown("modes", modes, "\"all\" or \"central\"")),
    };
    match objective {
        "lifted" => Ok(Measure::Lifted { truncation, all }),
        "floquet" => Ok(Measure::Exact),
        _ => Err(unknown("objective", objective, "\"lifted\" or \"floquet\"")),
    }
}

fn unknown(argument: &str, found: &str, expected: &str) -> PyErr {
    InputError::new_err(format!("control: {argument} is \"{found}\", expected {expected}; correct it"))
}

/// Design by harmonic balance.
#[pyfunction]
#[pyo3(signature = (lin, variants, *, objective, modes, truncation, harmonics, limit, fastest, slowest, quadratic, damping,
                    imaginary, start, search, seed, budget))]
#[expect(clippy::too_many_arguments)]
pub fn harmonic_balance(
    py: Python<'_>,
    lin: &LtpSystem,
    variants: Vec<PyRef<'_, LtpSystem>>,
    objective: &str,
    modes: &str,
    truncation: usize,
    harmonics: Vec<usize>,
    limit: Option<f64>,
    fastest: Option<f64>,
    slowest: Option<f64>,
    quadratic: Vec<Form<'_>>,
    damping: Option<f64>,
    imaginary: Option<f64>,
    start: Option<PyRef<'_, Feedback>>,
    search: &str,
    seed: u64,
    budget: Option<usize>,
) -> PyResult<Feedback> {
    let form = |(weight, low, high): Form<'_>| {
        let (weight, _) = array::rows("quadratic: Q", &weight)?;
        Ok(Quadratic { weight, low, high })
    };
    let search = match search {
        "global" => Search::Global,
        "swarm" => Search::Swarm,
        "local" => Search::Local,
        _ => return Err(unknown("search", search, "\"global\", \"swarm\" or \"local\"")),
    };
    let options = Options {
        measure: measure(objective, modes, truncation)?,
        harmonics,
        limit,
        fastest,
        slowest,
        quadratic: quadratic.into_iter().map(form).collect::<PyResult<_>>()?,
        damping: damping.map(Damping::Ratio).or(imaginary.map(Damping::Imaginary)),
        start: start.map(|s| s.core.gain.clone()),
        search,
        seed,
        budget,
    };
    let system = Arc::clone(lin.core());
    let variants: Vec<_> = variants.iter().map(|v| v.core().as_ref().clone()).collect();
    let nx = system.size().nx;
    let core = door::long(py, None, move |_| core::harmonic_balance(&system, &variants, &options))?;
    Ok(Feedback { core, nx })
}

/// The periodic linear-quadratic regulator.
#[pyfunction]
pub fn periodic_lqr(
    py: Python<'_>,
    lin: &LtpSystem,
    states: &Bound<'_, PyAny>,
    inputs: &Bound<'_, PyAny>,
    shift: f64,
    harmonics: Option<Vec<usize>>,
) -> PyResult<Feedback> {
    let ((states, _), (inputs, _)) = (array::rows("state_weights", states)?, array::rows("input_weights", inputs)?);
    let (system, weights) = (Arc::clone(lin.core()), Weights { states, inputs, shift });
    let nx = system.size().nx;
    let core = door::long(py, None, move |_| core::periodic_lqr(&system, &weights, harmonics.as_deref()))?;
    Ok(Feedback { core, nx })
}

/// Eigenvalues of the lifted closed loop ((2 N + 1) nx,), largest real part first.
#[pyfunction]
pub fn closed_loop_eigenvalues<'py>(
    py: Python<'py>,
    lin: &LtpSystem,
    gain: &Feedback,
    truncation: usize,
) -> PyResult<Bound<'py, PyArray1<Complex>>> {
    Ok(door::short(py, || core::lifted_eigenvalues(lin.core(), &gain.core.gain, truncation))?.into_pyarray(py))
}

/// What a design minimises, to be evaluated by others.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct Objective {
    core: core::Objective,
    all: bool,
    unknowns: usize,
}

#[pymethods]
impl Objective {
    #[new]
    fn new(
        py: Python<'_>,
        lin: &LtpSystem,
        objective: &str,
        modes: &str,
        truncation: usize,
        harmonics: Vec<usize>,
    ) -> PyResult<Self> {
        let measure = measure(objective, modes, truncation)?;
        let system = lin.core();
        let size = system.size();
        let law = Law::new(size.nu, size.nx, system.period(), &harmonics).map_err(Failure::from)?;
        let core = door::short(py, || match measure {
            Measure::Lifted { truncation, .. } => Lifted::new(system, &law, truncation).map(core::Objective::Lifted),
            Measure::Exact => Exact::new(system, &law, None).map(core::Objective::Exact),
        })?;
        let all = measure != Measure::Lifted { truncation, all: false };
        Ok(Self { core, all, unknowns: law.unknowns() })
    }

    /// Number of unknowns.
    #[getter]
    fn unknowns(&self) -> usize {
        self.unknowns
    }

    /// Largest real part at the unknowns `x` (n,), 1/s, and its gradient (n,).
    fn at<'py>(&self, py: Python<'py>, x: &Bound<'_, PyAny>) -> PyResult<(f64, Bound<'py, PyArray1<f64>>)> {
        let x = array::vector("x", x)?;
        array::same("x: unknowns", self.unknowns, x.len())?;
        let mut gradient = Vec::new();
        let work = &mut Spectrum::default();
        let value = door::short(py, || self.core.abscissa(&x, self.all, work, Some(&mut gradient)))?;
        Ok((value, gradient.into_pyarray(py)))
    }
}
