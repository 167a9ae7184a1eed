//! The noun `Htf`: harmonic transfer functions of a real linear time-periodic system, and what they predict.
//!
//! An input `u = e^{j w t}` gives `y = sum_k H_k(j w) e^{j (w + k w_p) t}` with `w_p = 2 pi / T`: values are stored at the
//! *input* frequency. The papers' `G_k` stands at the output frequency, `G_k(j w) = H_k(j (w - k w_p))`. A real system
//! obeys `H_{-k}(-j w) = conj H_k(j w)`, so frequencies from zero upwards, with harmonics of both signs, say everything.
//!
//! References: N. M. Wereley, *Analysis and Control of Linear Periodically Time Varying Systems*, MIT 1991; E. Möllerstedt
//! and B. Bernhardsson, IEEE Control Systems Magazine 20(4) (2000) 70-81; Uyanik et al. 2015, equations (5) to (7).

use std::f64::consts::TAU;

use crate::error::{Error, Result};
use crate::numeric::Complex;

/// Harmonic transfer functions on a grid of input frequencies.
///
/// Arrays are row-major; `values` and `sd` have the shape (2K+1, n_omega, ny, nu), harmonics from -K to K.
#[derive(Clone, Debug, PartialEq)]
pub struct Htf {
    period: f64,
    harmonics: usize,
    omega: Vec<f64>,
    outputs: usize,
    inputs: usize,
    values: Vec<Complex>,
    sd: Option<Vec<f64>>,
    coherence: Option<Vec<f64>>,
    /// How the values were found, in words.
    pub method: String,
    /// Named figures of the estimation: smoothness, poles, noise, seconds.
    pub figures: Vec<(String, f64)>,
    /// What is doubtful, with numbers and advice.
    pub warnings: Vec<String>,
}

impl Htf {
    /// Harmonic transfer functions with `period` T (s), harmonics -K..=K, at input frequencies `omega` (rad/s, from zero
    /// upwards, increasing), for `(ny, nu)` = `size`.
    ///
    /// # Errors
    /// `OutOfRange` for a period or frequencies that cannot be, `Shape` when `values` does not have
    /// `(2K+1) * n_omega * ny * nu` entries, `NotFinite`.
    pub fn new(
        period: f64,
        harmonics: usize,
        omega: Vec<f64>,
        size: (usize, usize),
        values: Vec<Complex>,
        method: &str,
    ) -> Result<Self> {
        if !(period > 0.0 && period.is_finite()) {
            let expected = "a positive, finite time in s".into();
            return Err(Error::OutOfRange { what: "period".into(), found: period, expected });
        }
        if let Some(i) = (0..omega.len()).find(|&i| !(omega[i].is_finite() && omega[i] >= 0.0)) {
            let expected = "a finite angular frequency from zero upwards, in rad/s".into();
            return Err(Error::OutOfRange { what: format!("omega[{i}]"), found: omega[i], expected });
        }
        if let Some(i) = (1..omega.len()).find(|&i| omega[i] <= omega[i - 1]) {
            let expected = format!("more than omega[{}] = {}; sort the frequencies", i - 1, omega[i - 1]);
            return Err(Error::OutOfRange { what: format!("omega[{i}]"), found: omega[i], expected });
        }
        let (outputs, inputs) = size;
        let expected = (2 * harmonics + 1) * omega.len() * outputs * inputs;
        if values.len() != expected || expected == 0 {
            let what = "values of the harmonic transfer functions, (2K+1)*n_omega*ny*nu".into();
            return Err(Error::Shape { what, expected, found: values.len() });
        }
        if let Some(row) = values.iter().position(|v| !v.is_finite()) {
            let (what, column) = ("harmonic transfer functions".into(), "values".into());
            return Err(Error::NotFinite { what, row, column, value: values[row].norm() });
        }
        let (sd, coherence, method) = (None, None, method.to_owned());
        let (figures, warnings) = (Vec::new(), Vec::new());
        Ok(Self { period, harmonics, omega, outputs, inputs, values, sd, coherence, method, figures, warnings })
    }

    /// With standard deviations: `sd^2 = E |estimate - truth|^2` of each complex value, shape as `values`.
    ///
    /// # Errors
    /// `Shape`.
    pub fn with_sd(mut self, sd: Vec<f64>) -> Result<Self> {
        if sd.len() != self.values.len() {
            let what = "standard deviations of the harmonic transfer functions".into();
            return Err(Error::Shape { what, expected: self.values.len(), found: sd.len() });
        }
        self.sd = Some(sd);
        Ok(self)
    }

    /// With the coherence (n_omega, ny): the fraction of the output's power near that output frequency which the estimate
    /// explains.
    ///
    /// # Errors
    /// `Shape`.
    pub fn with_coherence(mut self, coherence: Vec<f64>) -> Result<Self> {
        let expected = self.omega.len() * self.outputs;
        if coherence.len() != expected {
            return Err(Error::Shape { what: "coherence, n_omega*ny".into(), expected, found: coherence.len() });
        }
        self.coherence = Some(coherence);
        Ok(self)
    }

    /// Period T, s.
    pub fn period(&self) -> f64 {
        self.period
    }
    /// Pumping frequency 2 pi / T, rad/s.
    pub fn pumping(&self) -> f64 {
        TAU / self.period
    }
    /// Largest harmonic K; the papers' `n_h` is `2K+1`.
    pub fn harmonics(&self) -> usize {
        self.harmonics
    }
    /// Input frequencies (n_omega), rad/s.
    pub fn omega(&self) -> &[f64] {
        &self.omega
    }
    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }
    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }
    /// Values (2K+1, n_omega, ny, nu).
    pub fn values(&self) -> &[Complex] {
        &self.values
    }
    /// Standard deviations, shape as the values; `None` for an exact one.
    pub fn sd(&self) -> Option<&[f64]> {
        self.sd.as_deref()
    }
    /// Coherence (n_omega, ny).
    pub fn coherence(&self) -> Option<&[f64]> {
        self.coherence.as_deref()
    }

    /// Index into `values` of harmonic `k`, frequency `i`, output `y`, input `u`.
    pub fn index(&self, k: i64, i: usize, y: usize, u: usize) -> usize {
        let row = (k + self.harmonics as i64) as usize;
        ((row * self.omega.len() + i) * self.outputs + y) * self.inputs + u
    }

    /// Value of harmonic `k` at the grid frequency `i`, from input `u` to output `y`.
    pub fn value(&self, k: i64, i: usize, y: usize, u: usize) -> Complex {
        self.values[self.index(k, i, y, u)]
    }
}
