//! Periodic systems with closed forms, and signals, for the tests of this directory.
//!
//! `y = m(t) h * (n(t) u)`: a time-invariant filter between two periodic gains. Its harmonic transfer functions are
//! `H_k(s) = sum_j m_{k-j} h(s + j jwp) n_j`, its multipliers `e^{pole T}`, and its steady response to a record that repeats
//! comes from two Fourier transforms, exactly.

use std::f64::consts::TAU;

use crate::numeric::rng::SplitMix64;
use crate::numeric::{Complex, fft};
use crate::periodic::Htf;
use crate::signal::Recording;

/// A gain `1 + depth cos(wp t + phase)`.
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    pub depth: f64,
    pub phase: f64,
}

impl Gain {
    fn at(self, angle: f64) -> f64 {
        1.0 + self.depth * (angle + self.phase).cos()
    }

    fn coefficient(self, k: i64) -> Complex {
        match k {
            0 => Complex::new(1.0, 0.0),
            1 | -1 => Complex::from_polar(0.5 * self.depth, k as f64 * self.phase),
            _ => Complex::new(0.0, 0.0),
        }
    }
}

/// `m(t) h * (n(t) u)` with `h` a sum of modes `gain / (s^2 + 2 damping omega s + omega^2)`, or of lags where `damping` is
/// infinite: `gain / (s + omega)`.
#[derive(Clone, Debug)]
pub struct Sandwich {
    pub period: f64,
    pub before: Gain,
    pub after: Gain,
    /// (gain, omega, damping).
    pub modes: Vec<(f64, f64, f64)>,
}

/// One resonance between gains: two multipliers.
pub fn resonant() -> Sandwich {
    let (before, after) = (Gain { depth: 0.6, phase: 0.4 }, Gain { depth: 0.8, phase: -1.1 });
    Sandwich { period: 0.5, before, after, modes: vec![(40.0, 7.0, 0.08)] }
}

impl Sandwich {
    fn filter(&self, s: Complex) -> Complex {
        let mode = |&(gain, omega, damping): &(f64, f64, f64)| {
            if damping.is_infinite() {
                gain / (s + omega)
            } else {
                gain / (s * s + 2.0 * damping * omega * s + omega * omega)
            }
        };
        self.modes.iter().map(mode).sum()
    }

    /// Harmonic transfer function `k` at `omega`, of either sign.
    pub fn htf(&self, k: i64, omega: f64) -> Complex {
        let at = |j: i64| self.filter(Complex::new(0.0, omega + j as f64 * TAU / self.period));
        (-1..=1).map(|j| self.after.coefficient(k - j) * at(j) * self.before.coefficient(j)).sum()
    }

    /// Multipliers that are not zero, those of a pair once (with positive imaginary part).
    pub fn multipliers(&self) -> Vec<Complex> {
        let of = |&(_, omega, damping): &(f64, f64, f64)| {
            let pole = if damping.is_infinite() {
                Complex::new(-omega, 0.0)
            } else {
                omega * Complex::new(-damping, (1.0 - damping * damping).sqrt())
            };
            let multiplier = (pole * self.period).exp();
            Complex::new(multiplier.re, multiplier.im.abs())
        };
        self.modes.iter().map(of).collect()
    }

    /// Steady response to a `u` that repeats, sampled at `t0 + i dt`.
    pub fn respond(&self, u: &[f64], t0: f64, dt: f64) -> Vec<f64> {
        let n = u.len();
        let angle = |i: usize| TAU * ((t0 + i as f64 * dt) / self.period).fract();
        let driven: Vec<f64> = u.iter().enumerate().map(|(i, u)| u * self.before.at(angle(i))).collect();
        let mut lines = fft::forward(&driven);
        for (b, line) in lines.iter_mut().enumerate() {
            *line *= self.filter(Complex::new(0.0, TAU * b as f64 / (n as f64 * dt)));
        }
        fft::inverse(&lines, n).iter().enumerate().map(|(i, x)| x * self.after.at(angle(i))).collect()
    }

    /// What an initial state leaves: every mode rings with amplitude `size`.
    pub fn ring(&self, size: f64, t0: f64, dt: f64, n: usize) -> Vec<f64> {
        let at = |i: usize| {
            let t = i as f64 * dt;
            let mode = |&(_, omega, damping): &(f64, f64, f64)| {
                if damping.is_infinite() {
                    (-omega * t).exp()
                } else {
                    (-damping * omega * t).exp() * (omega * (1.0 - damping * damping).sqrt() * t).cos()
                }
            };
            size * self.after.at(TAU * (t0 + t) / self.period) * self.modes.iter().map(mode).sum::<f64>()
        };
        (0..n).map(at).collect()
    }

    /// Relative error of an estimate over its harmonics and frequencies up to `band`.
    pub fn error(&self, htf: &Htf, band: f64) -> f64 {
        let (mut wrong, mut right) = (0.0, 0.0);
        let highest = htf.harmonics() as i64;
        for (i, &omega) in htf.omega().iter().enumerate().filter(|(_, w)| **w <= band) {
            for k in -highest..=highest {
                let truth = self.htf(k, omega);
                wrong += (htf.value(k, i, 0, 0) - truth).norm_sqr();
                right += truth.norm_sqr();
            }
        }
        (wrong / right).sqrt()
    }

    /// Share of values within the 95 % disc of the truth.
    pub fn coverage(&self, htf: &Htf) -> f64 {
        let sd = htf.sd().expect("an estimate has standard deviations");
        let highest = htf.harmonics() as i64;
        let (mut inside, mut all) = (0.0, 0.0);
        for (i, &omega) in htf.omega().iter().enumerate() {
            for k in -highest..=highest {
                let distance = (htf.value(k, i, 0, 0) - self.htf(k, omega)).norm();
                // chi-square with two degrees of freedom: 5.9915 at 95 %, and sd holds both parts.
                inside += f64::from(u8::from(distance <= (5.9915_f64 / 2.0).sqrt() * sd[htf.index(k, i, 0, 0)]));
                all += 1.0;
            }
        }
        inside / all
    }
}

/// Random-phase multisine on `lines` of a record of `n` samples, with rms 1.
pub fn multisine(n: usize, lines: &[usize], seed: u64) -> Vec<f64> {
    let mut random = SplitMix64::new(seed);
    let mut spectrum = vec![Complex::new(0.0, 0.0); n / 2 + 1];
    let size = n as f64 / (2.0 * lines.len() as f64).sqrt();
    lines.iter().for_each(|&b| spectrum[b] = Complex::from_polar(size, TAU * random.uniform()));
    fft::inverse(&spectrum, n)
}

/// White noise of standard deviation `sd` added.
pub fn noisy(x: &[f64], sd: f64, seed: u64) -> Vec<f64> {
    let mut random = SplitMix64::new(seed);
    x.iter().map(|x| x + sd * random.normal()).collect()
}

/// A recording of one input and one output that begins at `t0`.
pub fn recording(u: Vec<f64>, y: Vec<f64>, t0: f64, dt: f64) -> Recording {
    let t = (0..u.len()).map(|i| t0 + i as f64 * dt).collect();
    Recording::new("run", t, vec![u], vec![y], vec!["u".into()], vec!["y".into()]).expect("a recording")
}
