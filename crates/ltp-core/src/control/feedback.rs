//! The noun `Feedback`: a periodic gain, how it was found and what it does.

use crate::error::Result;
use crate::numeric::Complex;
use crate::numeric::fourier_series::FourierSeries;

/// State feedback `u = -K(t) x`.
#[derive(Clone, Debug, PartialEq)]
pub struct Feedback {
    /// K(t): rows (nu, nx), row-major, in units of the input per unit of the state.
    pub gain: FourierSeries,
    /// The method it is from.
    pub method: String,
    /// Figures of the design by name, such as the largest real part of the closed loop, 1/s.
    pub figures: Vec<(String, f64)>,
    /// What is doubtful.
    pub warnings: Vec<String>,
}

impl Feedback {
    /// A gain given from outside.
    pub fn given(gain: FourierSeries) -> Self {
        Self { gain, method: "given".into(), figures: Vec::new(), warnings: Vec::new() }
    }

    /// A constant gain (nu, nx), row-major, for a system of `period`, s.
    ///
    /// # Errors
    /// As [`FourierSeries::constant`].
    pub fn constant(period: f64, gain: &[f64]) -> Result<Self> {
        Ok(Self::given(FourierSeries::constant(period, gain)?))
    }

    /// A gain by its complex harmonics `K_h` (h + 1, nu, nx), `K(t) = K_0 + sum_h Re(K_h e^{j h w t})`.
    ///
    /// # Errors
    /// As [`FourierSeries::new`].
    pub fn of_harmonics(period: f64, rows: usize, harmonics: &[Complex]) -> Result<Self> {
        let coefficients = harmonics.iter().enumerate().map(|(i, k)| if i < rows { *k } else { k / 2.0 });
        Ok(Self::given(FourierSeries::new(period, rows, coefficients.collect())?))
    }

    /// Its complex harmonics `K_h` (h + 1, nu, nx).
    pub fn harmonics(&self) -> Vec<Complex> {
        let rows = self.gain.rows();
        let doubled = self.gain.coefficients().iter().enumerate();
        doubled.map(|(i, c)| if i < rows { *c } else { c * 2.0 }).collect()
    }

    /// A figure by its name.
    pub fn figure(&self, name: &str) -> Option<f64> {
        self.figures.iter().find(|f| f.0 == name).map(|f| f.1)
    }
}
