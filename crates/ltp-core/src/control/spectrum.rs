//! The modes of a closed loop, and which of them an objective looks at: the noun that [`Lifted`] and [`Exact`] lead to.

use crate::error::Result;
use crate::numeric::Complex;
use crate::numeric::moving_eigen::Eigenpairs;

use super::exact::Exact;
use super::lifted::Lifted;

/// One eigenvalue of the closed loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Its value, 1/s.
    pub value: Complex,
    /// The matrix it belongs to: lifts fall apart into several.
    pub class: usize,
    /// True for the one copy of each exponent in the middle of the lift; exact exponents are all central.
    pub central: bool,
}

/// Modes of the last gain, with the buffers in which they were found.
#[derive(Clone, Debug, Default)]
pub struct Spectrum {
    /// All modes.
    pub modes: Vec<Mode>,
    /// Eigenvalue buffers, one for each class.
    pub(super) pairs: Vec<Eigenpairs>,
    /// The matrix at hand, and what it is made of.
    pub(super) matrix: Vec<f64>,
    pub(super) gain: Vec<f64>,
}

/// What is minimised.
#[derive(Clone, Debug)]
pub enum Objective {
    /// Eigenvalues of the truncated lift.
    Lifted(Lifted),
    /// Floquet exponents.
    Exact(Exact),
}

impl Objective {
    /// Finds all modes of the gain with unknowns `x`.
    ///
    /// # Errors
    /// `NoConvergence` for a gain that is not finite.
    pub fn modes(&self, x: &[f64], spectrum: &mut Spectrum) -> Result<()> {
        match self {
            Objective::Lifted(lifted) => lifted.modes(x, spectrum),
            Objective::Exact(exact) => exact.modes(x, spectrum),
        }
    }

    /// Derivative of the mode by all unknowns, for the spectrum that [`Objective::modes`] left. False where it does not
    /// exist: at a defective eigenvalue.
    pub fn derivative(&self, mode: &Mode, spectrum: &Spectrum, out: &mut Vec<Complex>) -> bool {
        match self {
            Objective::Lifted(lifted) => lifted.derivative(mode, spectrum, out),
            Objective::Exact(exact) => exact.derivative(mode, spectrum, out),
        }
    }

    /// The largest real part of all modes, or of the central ones, and its gradient when asked for.
    ///
    /// # Errors
    /// As [`Objective::modes`].
    pub fn abscissa(
        &self,
        x: &[f64],
        all: bool,
        spectrum: &mut Spectrum,
        gradient: Option<&mut Vec<f64>>,
    ) -> Result<f64> {
        self.modes(x, spectrum)?;
        let looked_at = spectrum.modes.iter().filter(|m| all || m.central);
        let Some(top) = looked_at.max_by(|a, b| a.value.re.total_cmp(&b.value.re)).copied() else {
            return Ok(f64::NEG_INFINITY);
        };
        if let Some(gradient) = gradient {
            let mut derivative = Vec::new();
            self.derivative(&top, spectrum, &mut derivative);
            gradient.clear();
            gradient.extend(derivative.iter().map(|d| d.re));
        }
        Ok(top.value.re)
    }
}
