//! The noun `Feedback`: a periodic gain, how it was found and what it does.

use crate::error::Result;
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

    /// A figure by its name.
    pub fn figure(&self, name: &str) -> Option<f64> {
        self.figures.iter().find(|f| f.0 == name).map(|f| f.1)
    }
}
