//! The noun `Multisine`: a periodic input that is a sum of cosines on known lines.

use std::f64::consts::TAU;

use super::{Excitation, crest, positive};
use crate::error::{Error, Result};
use crate::numeric::Complex;
use crate::numeric::rng::SplitMix64;

/// Samples that share one table of sines and cosines per line.
const BLOCK: usize = 256;

/// `u(t) = sum_b a_b cos(w_b t + phi_b)` with `w_b = 2 pi b / period`, for whole numbers `b >= 1`.
///
/// The complex amplitude of line `b` is `a_b e^{j phi_b}`: a linear time-periodic system with harmonic transfer functions
/// `H_k` answers with `Re sum_b sum_k H_k(j w_b) a_b e^{j phi_b} e^{j (w_b + k w_p) t}`.
#[derive(Clone, Debug, PartialEq)]
pub struct Multisine {
    period: f64,
    lines: Vec<usize>,
    amplitudes: Vec<f64>,
    phases: Vec<f64>,
}

impl Multisine {
    /// A multisine of `period` (s) with increasing `lines`, their `amplitudes` (unit of the input) and `phases` (rad).
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a period, line, amplitude or phase that cannot be; [`Error::Shape`] when the lengths differ
    /// or there is no line.
    pub fn new(period: f64, lines: Vec<usize>, amplitudes: Vec<f64>, phases: Vec<f64>) -> Result<Self> {
        positive("period of the multisine", period, "s")?;
        for (what, found) in [("amplitudes", amplitudes.len()), ("phases", phases.len())] {
            let expected = lines.len().max(1);
            if found != expected {
                return Err(Error::Shape { what: format!("{what} of the multisine, one per line"), expected, found });
            }
        }
        if let Some(i) = (0..lines.len()).find(|&i| lines[i] <= if i == 0 { 0 } else { lines[i - 1] }) {
            let expected = "a whole number from 1 on, more than the line before; sort the lines".into();
            return Err(Error::OutOfRange { what: format!("lines[{i}]"), found: lines[i] as f64, expected });
        }
        for (what, values) in [("amplitudes", &amplitudes), ("phases", &phases)] {
            if let Some(i) = values.iter().position(|v| !v.is_finite()) {
                let expected = "a finite number; correct it".into();
                return Err(Error::OutOfRange { what: format!("{what}[{i}]"), found: values[i], expected });
            }
        }
        Ok(Self { period, lines, amplitudes, phases })
    }

    /// A multisine of random phases, with amplitudes in proportion to `weights` (one per line; none: all alike) and the given
    /// `rms` (unit of the input).
    ///
    /// # Errors
    /// As [`Multisine::new`]; [`Error::OutOfRange`] also for an rms that is not positive and for negative weights, or weights
    /// that are all zero.
    pub fn random(period: f64, lines: Vec<usize>, weights: Option<&[f64]>, rms: f64, seed: u64) -> Result<Self> {
        positive("rms", rms, "unit of the input")?;
        let flat = vec![1.0; lines.len()];
        let weights = weights.unwrap_or(&flat);
        if let Some(i) = weights.iter().position(|w| !(w.is_finite() && *w >= 0.0)) {
            let expected = "a finite weight from zero upwards; correct it".into();
            return Err(Error::OutOfRange { what: format!("weights[{i}]"), found: weights[i], expected });
        }
        let largest = weights.iter().copied().fold(0.0, f64::max);
        if largest == 0.0 && !weights.is_empty() {
            let expected = "a positive weight for some line; correct the weights".into();
            return Err(Error::OutOfRange { what: "largest weight".into(), found: 0.0, expected });
        }
        // By the largest first: squares of tiny or huge weights would leave the range of numbers.
        let squares: f64 = weights.iter().map(|w| (w / largest).powi(2)).sum();
        let scale = rms * (2.0 / squares).sqrt();
        let amplitudes = weights.iter().map(|w| scale * (w / largest)).collect();
        let mut random = SplitMix64::new(seed);
        let phases = lines.iter().map(|_| TAU * random.uniform()).collect();
        Self::new(period, lines, amplitudes, phases)
    }

    /// The same lines and amplitudes with phases that make the peaks lower, see [`crest`].
    pub fn with_low_crest(mut self, iterations: usize) -> Self {
        self.phases = crest::reduce(&self.lines, &self.amplitudes, &self.phases, iterations);
        self
    }

    /// Period after which the signal repeats, s.
    pub fn period(&self) -> f64 {
        self.period
    }
    /// Lines (n_lines): line `b` stands at `b / period` Hz.
    pub fn lines(&self) -> &[usize] {
        &self.lines
    }
    /// Amplitudes (n_lines), in the unit of the input.
    pub fn amplitudes(&self) -> &[f64] {
        &self.amplitudes
    }
    /// Phases (n_lines) of the cosines at t = 0, rad.
    pub fn phases(&self) -> &[f64] {
        &self.phases
    }
    /// Angular frequencies of the lines (n_lines), rad/s.
    pub fn omega(&self) -> Vec<f64> {
        self.lines.iter().map(|&b| TAU * b as f64 / self.period).collect()
    }
    /// Complex amplitudes `a_b e^{j phi_b}` (n_lines).
    pub fn spectrum(&self) -> Vec<Complex> {
        self.amplitudes.iter().zip(&self.phases).map(|(&a, &phase)| Complex::from_polar(a, phase)).collect()
    }
    /// Root mean square over a period, in the unit of the input.
    pub fn rms(&self) -> f64 {
        (0.5 * self.amplitudes.iter().map(|a| a * a).sum::<f64>()).sqrt()
    }
    /// Largest magnitude over rms, on a grid of at least eight samples in a cycle of the highest line; NaN for a signal that
    /// is zero.
    pub fn crest(&self) -> f64 {
        crest::factor(&self.lines, &self.amplitudes, &self.phases)
    }

    /// Phase of line `i` at time `t`, rad; whole turns are taken off before they cost digits.
    fn phase_at(&self, i: usize, t: f64) -> f64 {
        TAU * (self.lines[i] as f64 * (t / self.period).fract()).fract() + self.phases[i]
    }
}

impl Excitation for Multisine {
    fn value(&self, t: f64) -> f64 {
        (0..self.lines.len()).map(|i| self.amplitudes[i] * self.phase_at(i, t).cos()).sum()
    }

    /// By blocks: `cos(a + b)` from the phase at the start of the block and a table for the samples in it.
    fn samples(&self, dt: f64, n: usize) -> Vec<f64> {
        let mut samples = vec![0.0; n];
        for (i, &line) in self.lines.iter().enumerate() {
            let turn = line as f64 * dt / self.period;
            let table: [(f64, f64); BLOCK] = std::array::from_fn(|k| (TAU * turn * k as f64).sin_cos());
            for (b, block) in samples.chunks_mut(BLOCK).enumerate() {
                let (sin, cos) = self.phase_at(i, (b * BLOCK) as f64 * dt).sin_cos();
                let (a, c) = (self.amplitudes[i] * cos, self.amplitudes[i] * sin);
                for (sample, (sin, cos)) in block.iter_mut().zip(&table) {
                    *sample += a * cos - c * sin;
                }
            }
        }
        samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::{fft, stats};
    use proptest::prelude::*;

    fn some() -> Multisine {
        Multisine::random(4.0, vec![1, 3, 8, 21], Some(&[1.0, 0.5, 0.0, 2.0]), 0.7, 5).expect("multisine")
    }

    #[test]
    fn samples_are_the_sum_of_cosines() {
        let signal = some();
        // More than one block, and a step that does not divide the period.
        for (i, value) in signal.samples(0.0371, 1000).into_iter().enumerate() {
            let t = 0.0371 * i as f64;
            let lines = signal.omega().into_iter().zip(signal.amplitudes()).zip(signal.phases());
            let sum: f64 = lines.map(|((omega, a), phase)| a * (omega * t + phase).cos()).sum();
            assert!((value - sum).abs() < 1e-12 && (signal.value(t) - sum).abs() < 1e-12, "sample {i}");
        }
    }

    #[test]
    fn the_transform_shows_its_lines_and_nothing_else() {
        let signal = some();
        let x = signal.samples(4.0 / 100.0, 100);
        let (spectrum, lines) = (signal.spectrum(), signal.lines());
        for (k, value) in fft::forward(&x).into_iter().enumerate() {
            let expected = lines.iter().position(|&b| b == k).map_or(Complex::ZERO, |i| spectrum[i]);
            assert!((2.0 * value / 100.0 - expected).norm() < 1e-14, "line {k}");
        }
    }

    #[test]
    fn a_long_record_keeps_its_phase() {
        let signal = some();
        let (dt, n) = (1e-3, 400_000);
        let x = signal.samples(dt, n);
        for i in 0..4000 {
            assert!((x[n - 4000 + i] - x[i]).abs() < 1e-12, "sample {i}");
        }
    }

    proptest! {
        #[test]
        fn rms_is_the_one_asked_for(
            weights in proptest::collection::vec(0.01..1.0_f64, 1..20), rms in 0.01..10.0_f64,
            scale in prop::sample::select(vec![1e-200, 1.0, 1e200]), seed in any::<u64>(),
        ) {
            let weights: Vec<f64> = weights.iter().map(|w| w * scale).collect();
            let lines: Vec<usize> = (1..=weights.len()).collect();
            let signal = Multisine::random(1.0, lines, Some(&weights), rms, seed)?;
            prop_assert!((signal.rms() / rms - 1.0).abs() < 1e-13);
            let x = signal.samples(1.0 / 64.0, 64);
            prop_assert!((stats::rms(x) / rms - 1.0).abs() < 1e-12);
            let ratio = signal.amplitudes()[0] * weights[weights.len() - 1];
            prop_assert!((ratio / (signal.amplitudes()[weights.len() - 1] * weights[0]) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let new = |period, lines: &[usize], a: &[f64]| Multisine::new(period, lines.to_vec(), a.to_vec(), vec![0.0; 2]);
        assert!(new(1.0, &[1, 2], &[1.0; 2]).is_ok());
        assert!(new(0.0, &[1, 2], &[1.0; 2]).is_err());
        assert!(new(1.0, &[0, 2], &[1.0; 2]).is_err());
        assert!(new(1.0, &[2, 2], &[1.0; 2]).is_err());
        assert!(new(1.0, &[1, 2], &[1.0; 3]).is_err());
        assert!(new(1.0, &[1, 2], &[1.0, f64::NAN]).is_err());
        assert!(Multisine::new(1.0, vec![], vec![], vec![]).is_err());
        let random = |weights: &[f64], rms| Multisine::random(1.0, vec![1, 2], Some(weights), rms, 0);
        assert!(random(&[1.0, 0.0], 1.0).is_ok());
        assert!(random(&[0.0, 0.0], 1.0).is_err());
        assert!(random(&[1.0, -1.0], 1.0).is_err());
        assert!(random(&[1.0], 1.0).is_err());
        assert!(random(&[1.0, 1.0], 0.0).is_err());
    }
}
