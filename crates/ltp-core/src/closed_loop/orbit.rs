//! The periodic orbit that a closed loop really has, near the reference it was given.

use super::run::shares;
use crate::cycle::{self, cycle};
use crate::error::Result;
use crate::feedforward::Reference;
use crate::linearize::along;
use crate::model::System;
use crate::numeric::{Complex, fourier_series::FourierSeries};

/// Integration steps in one period.
const STEPS: u64 = 1000;

/// A periodic orbit of a closed loop.
#[derive(Clone, Debug)]
pub struct Orbit {
    /// States (nx) over one period.
    pub states: FourierSeries,
    /// Floquet exponents, 1/s, largest real part first; imaginary parts within half the pumping frequency.
    pub exponents: Vec<Complex>,
    /// Largest distance from the reference over one period, per state, as a share of the reference's amplitude.
    pub error: Vec<f64>,
}

impl Orbit {
    /// The orbit of a closed system that a start near the reference leads to: Newton's method at once, and after settling
    /// where that fails.
    pub(super) fn find(system: &dyn System, p: &[f64], reference: &Reference, start: &[f64]) -> Result<Self> {
        let mut options = cycle::Options {
            start: Some(start.to_vec()),
            period: Some(reference.period()),
            settle: Some(0),
            steps: STEPS,
            ..cycle::Options::default()
        };
        let found = cycle(system, p, &options).or_else(|_| {
            options.settle = None;
            cycle(system, p, &options)
        })?;
        let nx = start.len();
        // The last sample is the first one of the next period.
        let samples = &found.trajectory.states[..(found.trajectory.t.len() - 1) * nx];
        let states = FourierSeries::from_samples(reference.period(), nx, samples)?.trimmed(1e-12);
        let mut error = vec![0.0_f64; nx];
        let amplitudes = shares(reference);
        for (i, x) in samples.chunks_exact(nx).enumerate() {
            let wanted = reference.states.value(found.trajectory.t[i]);
            for r in 0..nx {
                error[r] = error[r].max((x[r] - wanted[r]).abs() / amplitudes[r]);
            }
        }
        let exponents = if found.events.is_empty() {
            let rest = FourierSeries::constant(reference.period(), &vec![0.0; system.inputs().max(1)])?;
            along(system, p, found.mode, &states, &rest)?.exponents()?
        } else {
            of_multipliers(&found.multipliers, found.period)
        };
        Ok(Self { states, exponents, error })
    }

    /// Largest real part, 1/s.
    pub fn slowest(&self) -> f64 {
        slowest(&self.exponents)
    }
}

/// Exponents of multipliers, 1/s, largest real part first: through events, where the linear system knows no more.
fn of_multipliers(multipliers: &[Complex], period: f64) -> Vec<Complex> {
    let exponent = |m: &Complex| Complex::new(m.norm().max(f64::MIN_POSITIVE).ln(), m.arg()) / period;
    let mut all: Vec<Complex> = multipliers.iter().map(exponent).collect();
    all.sort_by(|a, b| b.re.total_cmp(&a.re).then(b.im.total_cmp(&a.im)));
    all
}

/// Largest real part.
pub(super) fn slowest(values: &[Complex]) -> f64 {
    values.iter().fold(f64::NEG_INFINITY, |m, v| m.max(v.re))
}
