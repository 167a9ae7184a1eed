//! The verb `linearize` and the noun `LtpSystem` of the extension.

use std::sync::Arc;

use ltp_core::linearize as core;
use ltp_core::model::System;
use ltp_core::numeric::Complex;
use ltp_core::periodic::{self, system::Entry};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::cycle::LimitCycle;
use crate::htf::Htf;
use crate::interrupt::Interruptible;
use crate::model::Model;
use crate::{array, door};

/// A linear time-periodic system with jumps.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct LtpSystem {
    core: Arc<periodic::LtpSystem>,
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

impl LtpSystem {
    /// The system of the core.
    pub fn core(&self) -> &Arc<periodic::LtpSystem> {
        &self.core
    }
}

#[pymethods]
impl LtpSystem {
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
