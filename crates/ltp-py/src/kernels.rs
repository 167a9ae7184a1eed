//! The two routes to the minimiser of penalised least squares, laid open so that benchmarks and tests can weigh them
//! against other solvers on one system. `identify` is how they are used.
//!
//! Both ends of the band are eliminated at once on two threads (RAYON_NUM_THREADS says how many there are); the smoother
//! needs one.

use ltp_core::numeric::Complex;
use ltp_core::numeric::banded::{BandedFactor, BandedHermitian};
use ltp_core::numeric::penalised::normal_matrix;
use ltp_core::numeric::smoother::{End, Observations, Smoother};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use std::sync::{Mutex, OnceLock};

use crate::door;
use crate::error::InputError;

type Rows<'py> = Bound<'py, PyArray2<Complex>>;
type Column<'py> = Bound<'py, PyArray1<Complex>>;

/// Rows `u` of `y = u^T x`, one for each step.
fn observations(rows: &Rows<'_>) -> Observations {
    let view = rows.readonly();
    let view = view.as_array();
    let mut observations = Observations::new(view.ncols());
    observations.reserve(view.nrows());
    let mut row = Vec::new();
    for u in view.rows() {
        row.clear();
        row.extend(u);
        observations.step([&row[..]]);
    }
    observations
}

/// The minimiser by the Kalman smoother, on one thread.
///
/// With `mirrored`, rows run from the top of the axis down to zero, unknowns are harmonics -K..=K, and beyond zero follows
/// the mirror image of a real system.
#[pyfunction]
pub fn smooth<'py>(
    py: Python<'py>,
    rows: &Rows<'py>,
    y: &Column<'py>,
    smoothness: f64,
    mirrored: bool,
) -> PyResult<Column<'py>> {
    let (observations, y) = (observations(rows), y.readonly().as_array().to_vec());
    let end = if mirrored { End::Mirror((0..observations.unknowns()).rev().collect()) } else { End::Free };
    let work = || Ok(Smoother::new(&observations, smoothness, &end)?.solve(&y)?.values);
    Ok(door::short(py, work)?.into_pyarray(py))
}

/// The normal equations as one banded Hermitian system, factored in its own place.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct NormalBand {
    band: Mutex<Option<BandedHermitian>>,
    factor: OnceLock<BandedFactor>,
    #[pyo3(get)]
    bytes: usize,
}

#[pymethods]
impl NormalBand {
    #[new]
    fn new(rows: &Rows<'_>, smoothness: f64) -> Self {
        let band = normal_matrix(&observations(rows), smoothness, 0.0);
        let bytes = band.bytes();
        Self { band: Mutex::new(Some(band)), factor: OnceLock::new(), bytes }
    }

    /// Factors, once.
    fn factor(&self, py: Python<'_>) -> PyResult<()> {
        let band = self.band.lock().ok().and_then(|mut band| band.take());
        let Some(band) = band else { return Err(InputError::new_err("the band has been factored before")) };
        let factor = door::short(py, || band.factor())?;
        // taken out of the mutex: no second factor can stand here
        let _ = self.factor.set(factor);
        Ok(())
    }

    /// Solves for one right hand side.
    fn solve<'py>(&self, py: Python<'py>, b: &Column<'py>) -> PyResult<Column<'py>> {
        let mut b = b.readonly().as_array().to_vec();
        let Some(factor) = self.factor.get() else { return Err(InputError::new_err("factor the band first")) };
        let solved = door::short(py, move || {
            factor.solve(&mut b)?;
            Ok(b)
        });
        Ok(solved?.into_pyarray(py))
    }
}
