//! The verb `linearize` and the noun `LtpSystem` of the extension.

use std::sync::Arc;

use ltp_core::error::Error;
use ltp_core::linearize as core;
use ltp_core::model::System;
use ltp_core::numeric::Complex;
use ltp_core::numeric::fourier_series::FourierSeries;
use ltp_core::periodic::{self, Size, system::Entry};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::cycle::LimitCycle;
use crate::feedforward::Reference;
use crate::htf::Htf;
use crate::interrupt::Interruptible;
use crate::model::Model;
use crate::periodic::{Floquet, Transverse, series};
use crate::{array, door};

/// Real and imaginary part, exponent, copy, distance, edge, converged.
type Mode = (f64, f64, usize, i64, f64, f64, bool);

/// A linear time-periodic system with jumps.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct LtpSystem {
    core: Arc<periodic::LtpSystem>,
}

impl From<periodic::LtpSystem> for LtpSystem {
    fn from(core: periodic::LtpSystem) -> Self {
        Self { core: Arc::new(core) }
    }
}

/// The linear time-periodic system of a model around its periodic orbit.
#[pyfunction]
pub fn linearize(py: Python<'_>, model: &Model, cycle: &LimitCycle) -> PyResult<LtpSystem> {
    let (system, orbit) = (model.compiled(py)?, cycle.core().clone());
    let core = door::long(py, None, move |outside| {
        let parameters = system.parameters().to_vec();
        core::linearize(&Interruptible::new(system, outside.interrupted), &parameters, &orbit)
    })?;
    Ok(LtpSystem { core: Arc::new(core) })
}

/// The linear time-periodic system of a model along a reference that need not be an orbit, in its starting mode.
#[pyfunction]
pub fn linearize_along(py: Python<'_>, model: &Model, reference: &Reference) -> PyResult<LtpSystem> {
    let (system, reference) = (model.compiled(py)?, reference.core().clone());
    let core = door::long(py, None, move |outside| {
        let (parameters, mode) = (system.parameters().to_vec(), system.initial_mode());
        let system = Interruptible::new(system, outside.interrupted);
        core::along(&system, &parameters, mode, &reference.states, &reference.inputs)
    })?;
    Ok(LtpSystem { core: Arc::new(core) })
}

impl LtpSystem {
    /// The system of the core.
    pub fn core(&self) -> &Arc<periodic::LtpSystem> {
        &self.core
    }
}

#[pymethods]
impl LtpSystem {
    /// A smooth system from `matrix(name, t)`, which gives "A", "B", "C" and "D", for (states, inputs, outputs).
    #[staticmethod]
    fn from_functions(
        py: Python<'_>,
        period: f64,
        size: (usize, usize, usize),
        matrix: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (matrix, mut raised) = (matrix.clone().unbind(), None);
        let size = Size { nx: size.0, nu: size.1, ny: size.2 };
        let made = door::short(py, || {
            periodic::LtpSystem::try_smooth(period, size, |t, entry| {
                let value = Python::attach(|py| {
                    let value = matrix.bind(py).call1((format!("{entry:?}"), t))?;
                    Ok(array::rows("matrix", &value)?.0)
                });
                value.map_err(|error| {
                    raised = Some(error);
                    Error::Interrupted
                })
            })
        });
        match raised {
            Some(error) => Err(error),
            None => Ok(made?.into()),
        }
    }

    /// A smooth system from even samples of its matrices over one period, each (n, 1, rows, columns).
    #[staticmethod]
    fn from_samples(
        py: Python<'_>,
        period: f64,
        size: (usize, usize, usize),
        matrices: [Bound<'_, PyAny>; 4],
    ) -> PyResult<Self> {
        let mut samples = Vec::with_capacity(4);
        for matrix in &matrices {
            samples.push(array::block("samples", matrix)?.0);
        }
        let size = Size { nx: size.0, nu: size.1, ny: size.2 };
        let made = door::short(py, || {
            let rows = [size.nx * size.nx, size.nx * size.nu, size.ny * size.nx, size.ny * size.nu];
            let series = |k: usize| {
                let some = (rows[k] > 0).then(|| FourierSeries::from_samples(period, rows[k], &samples[k]));
                some.transpose()
            };
            let [a, b, c, d] = [series(0)?, series(1)?, series(2)?, series(3)?];
            let missing = || Error::Shape { what: "A: states".into(), expected: 1, found: 0 };
            let a = a.ok_or_else(missing)?;
            periodic::LtpSystem::from_series(size, &a, b.as_ref(), c.as_ref(), d.as_ref())
        });
        Ok(made?.into())
    }

    /// The system under `u = -K(t) x + v`: coefficients (K + 1, 1, nu, nx) of the gain, of its own `period`, s.
    fn closed(&self, py: Python<'_>, period: f64, gain: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (gain, core) = (array::complex_block("gain", gain)?, Arc::clone(&self.core));
        Ok(door::long(py, None, move |_| core.closed(&series(period, gain)?))?.into())
    }

    /// Floquet exponents (nx,), 1/s, largest real part first.
    fn exponents<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<Complex>>> {
        Ok(door::short(py, || self.core.exponents())?.to_pyarray(py))
    }

    /// The Floquet decomposition of a smooth system.
    fn floquet(&self, py: Python<'_>) -> PyResult<Floquet> {
        Ok(Floquet { core: door::short(py, || self.core.floquet())? })
    }

    /// Eigenvalues of the truncated lift: (real and imaginary part, exponent, copy, distance, edge, converged) each.
    fn lifted_modes(&self, py: Python<'_>, truncation: usize) -> PyResult<Vec<Mode>> {
        let core = Arc::clone(&self.core);
        let modes = door::long(py, None, move |_| core.lifted_modes(truncation))?;
        Ok(modes
            .into_iter()
            .map(|m| (m.value.re, m.value.im, m.exponent, m.copy, m.distance, m.edge, m.converged))
            .collect())
    }

    /// How many times the matrices repeat within the period.
    fn pumping_divisor(&self, py: Python<'_>) -> PyResult<usize> {
        door::short(py, || Ok(self.core.pumping_divisor()))
    }

    /// The system over its true period.
    fn shortened(&self, py: Python<'_>) -> PyResult<Self> {
        Ok(door::short(py, || self.core.shortened())?.into())
    }

    /// The highest harmonic of A and B above `share` of the largest coefficient of its entry.
    fn bandwidth(&self, py: Python<'_>, share: f64) -> PyResult<usize> {
        door::short(py, || self.core.bandwidth(share))
    }

    /// Refuses a truncation that leaves out harmonics of A and B.
    fn check_truncation(&self, py: Python<'_>, truncation: usize) -> PyResult<()> {
        door::short(py, || self.core.check_truncation(truncation))
    }

    /// The system across its orbit: coefficients (K + 1, 1, nx, 1) of the tangent, or none for that of the phase mode.
    fn transverse(&self, py: Python<'_>, tangent: Option<&Bound<'_, PyAny>>) -> PyResult<Transverse> {
        let tangent = tangent.map(|t| array::complex_block("tangent", t)).transpose()?;
        let core = Arc::clone(&self.core);
        let made = door::long(py, None, move |_| {
            let tangent = tangent.map(|t| series(core.period(), t)).transpose()?;
            core.transverse(tangent.as_ref())
        })?;
        Ok(Transverse { core: made })
    }

    /// Period T, s.
    #[getter]
    fn period(&self) -> f64 {
        self.core.period()
    }

    /// Numbers of states, inputs and outputs.
    #[getter]
    fn size(&self) -> (usize, usize, usize) {
        let size = self.core.size();
        (size.nx, size.nu, size.ny)
    }

    /// Matrix "A", "B", "C" or "D" at time `t`, s; at a jump, its value just after.
    fn matrix<'py>(&self, py: Python<'py>, name: &str, t: f64) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let size = self.core.size();
        let (entry, rows, width) = match name {
            "A" => (Entry::A, size.nx, size.nx),
            "B" => (Entry::B, size.nx, size.nu),
            "C" => (Entry::C, size.ny, size.nx),
            _ => (Entry::D, size.ny, size.nu),
        };
        array::matrix(py, self.core.matrix(entry, t), rows, width)
    }

    /// Each jump as (name, time, S (nx, nx), E (nx, nu)).
    #[getter]
    fn jumps<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyTuple>>> {
        let size = self.core.size();
        let jump = |jump: &periodic::Jump| {
            let state = array::matrix(py, jump.state.clone(), size.nx, size.nx)?;
            let input = array::matrix(py, jump.input.clone(), size.nx, size.nu)?;
            (jump.name.as_str(), jump.time, state, input).into_pyobject(py)
        };
        self.core.jumps().map(jump).collect()
    }

    /// Monodromy matrix (nx, nx) from time zero, jumps included.
    #[getter]
    fn monodromy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let nx = self.core.size().nx;
        array::matrix(py, self.core.monodromy().to_vec(), nx, nx)
    }

    /// Floquet multipliers (nx,), largest magnitude first.
    #[getter]
    fn multipliers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Complex>> {
        self.core.multipliers().to_pyarray(py)
    }

    /// Outputs (n, ny) from rest at `t0`, s, under inputs (n, nu) every `dt` seconds, straight lines in between.
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        u: &Bound<'_, PyAny>,
        t0: f64,
        dt: f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (u, [rows, width]) = array::rows("u", u)?;
        let core = Arc::clone(&self.core);
        array::same("u: columns, as inputs", core.size().nu, width)?;
        let outputs = door::long(py, None, move |_| core.simulate(&u, t0, dt))?;
        array::matrix(py, outputs, rows, self.core.size().ny)
    }

    /// The system with only these inputs and outputs, by number.
    fn select(&self, py: Python<'_>, inputs: Vec<usize>, outputs: Vec<usize>) -> PyResult<Self> {
        Ok(Self { core: Arc::new(door::short(py, || self.core.select(&inputs, &outputs))?) })
    }

    /// The matrix `A - N` of the harmonic state space, blocks -truncation to truncation.
    fn lift<'py>(&self, py: Python<'py>, truncation: usize) -> PyResult<Bound<'py, PyArray2<Complex>>> {
        let core = Arc::clone(&self.core);
        let order = (2 * truncation + 1) * core.size().nx;
        door::long(py, None, move |_| core.lift(truncation))?.into_pyarray(py).reshape([order, order])
    }

    /// Harmonic transfer functions by the harmonic state space, truncated.
    fn lifted_htf(
        &self,
        py: Python<'_>,
        omega: &Bound<'_, PyAny>,
        harmonics: usize,
        truncation: usize,
    ) -> PyResult<Htf> {
        let (omega, core) = (array::vector("omega", omega)?, Arc::clone(&self.core));
        Ok(door::long(py, None, move |_| core.lifted_htf(&omega, harmonics, truncation))?.into())
    }

    /// Exact harmonic transfer functions, harmonics -K to K at the input frequencies `omega` (n_omega,), rad/s.
    fn htf(&self, py: Python<'_>, omega: &Bound<'_, PyAny>, harmonics: usize) -> PyResult<Htf> {
        let (omega, core) = (array::vector("omega", omega)?, Arc::clone(&self.core));
        Ok(door::long(py, None, move |_| core.htf(&omega, harmonics))?.into())
    }
}
