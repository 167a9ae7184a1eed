//! What a linear time-periodic system is taken apart into, in the extension: `Floquet` and `Transverse`.

use ltp_core::Result;
use ltp_core::numeric::Complex;
use ltp_core::numeric::fourier_series::FourierSeries;
use ltp_core::periodic;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;

use crate::linearize::LtpSystem;
use crate::{array, door};

/// A periodic signal from its coefficients (K + 1, 1, rows, columns).
pub fn series(period: f64, coefficients: (Vec<Complex>, [usize; 4])) -> Result<FourierSeries> {
    let (values, [_, _, rows, columns]) = coefficients;
    FourierSeries::new(period, rows * columns, values)
}

/// The coefficients of a periodic signal, (K + 1, rows).
fn coefficients<'py>(py: Python<'py>, series: &FourierSeries) -> PyResult<Bound<'py, PyArray2<Complex>>> {
    series.coefficients().to_vec().into_pyarray(py).reshape([series.harmonics() + 1, series.rows()])
}

/// A Floquet decomposition.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct Floquet {
    pub core: periodic::Floquet,
}

#[pymethods]
impl Floquet {
    /// Exponents (nx,), 1/s.
    #[getter]
    fn exponents<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Complex>> {
        self.core.exponents.to_pyarray(py)
    }

    /// Abar (nx, nx), 1/s.
    #[getter]
    fn a_bar<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Complex>>> {
        let nx = self.core.exponents.len();
        self.core.a_bar.clone().into_pyarray(py).reshape([nx, nx])
    }

    /// P(t) (nx, nx).
    fn p<'py>(&self, py: Python<'py>, t: f64) -> PyResult<Bound<'py, PyArray2<Complex>>> {
        let nx = self.core.exponents.len();
        door::short(py, || Ok(self.core.p(t)))?.into_pyarray(py).reshape([nx, nx])
    }

    /// Largest entry of `P(t0 + T) - I`.
    #[getter]
    fn residual(&self) -> f64 {
        self.core.residual
    }

    /// Whether Abar and P are real.
    #[getter]
    fn is_real(&self) -> bool {
        self.core.is_real()
    }

    /// Doubts.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.core.warnings.clone()
    }
}

/// A system across an orbit.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct Transverse {
    pub core: periodic::Transverse,
}

#[pymethods]
impl Transverse {
    /// The transverse system.
    #[getter]
    fn system(&self) -> LtpSystem {
        self.core.system.clone().into()
    }

    /// Fourier coefficients of the frame, (K + 1, nx * (nx - 1)).
    #[getter]
    fn frame<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Complex>>> {
        coefficients(py, &self.core.frame)
    }

    /// Fourier coefficients of the tangent, (K + 1, nx).
    #[getter]
    fn tangent<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Complex>>> {
        coefficients(py, &self.core.tangent)
    }

    /// Share of the tangent's rate that points across the orbit.
    #[getter]
    fn defect(&self) -> f64 {
        self.core.defect
    }

    /// Doubts.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.core.warnings.clone()
    }

    /// Coefficients (K + 1, nu * nx) of the gain on all states, from those (K + 1, 1, nu, nx - 1) of one on the transverse.
    fn gain<'py>(
        &self,
        py: Python<'py>,
        period: f64,
        gain: &Bound<'_, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<Complex>>> {
        let gain = array::complex_block("gain", gain)?;
        let whole = door::short(py, || self.core.gain(&series(period, gain)?))?;
        coefficients(py, &whole)
    }
}
