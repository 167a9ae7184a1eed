//! The minimiser of [`super::smoother`] by its normal equations: one banded Hermitian system over all steps and unknowns.
//!
//! With rows `u`, `A = sum conj(u) u^T + smoothness D^T D` couples step `t` to `t + 2` at most, so the half-bandwidth is twice
//! the number of unknowns of a step (equations (9) to (12) of the paper). The condition of `A` grows with the fourth power of
//! an unexcited stretch and Cholesky's factor of it loses as many digits, so conjugate gradients with the factor as their
//! preconditioner finish the solution; they need differences of the unknowns, not `A`, and so keep the digits.
//!
//! Reference: Uyanik, Ankarali, Cowan, Saranli, Morgül, Transactions of the Institute of Measurement and Control 38 (2016),
//! doi 10.1177/0142331215583327, section on data-driven identification, after A. Siddiqi, MIT 2001.

use super::Complex;
use super::banded::{BandedFactor, BandedHermitian};
use super::smoother::Observations;
use crate::error::{Error, Result};

/// Added to a matrix that rounding made indefinite, relative to the largest eigenvalue of its penalty, before it is factored.
const RIDGE: f64 = 1e-14;
/// Conjugate gradients stop at this relative residual in the factor's norm, or after so many steps.
const GOAL: f64 = 1e-12;
const STEPS: usize = 40;
/// Rounding may stop them short of the goal by this factor.
const SETTLED: f64 = 1e2;

/// The normal equations of penalised least squares, factored.
pub struct Penalised<'a> {
    observations: &'a Observations,
    smoothness: f64,
    factor: BandedFactor,
}

/// The matrix of the normal equations, on the diagonal `ridge` more.
pub fn normal_matrix(observations: &Observations, smoothness: f64, ridge: f64) -> BandedHermitian {
    let (n, steps) = (observations.unknowns(), observations.steps());
    let mut band = BandedHermitian::new(steps * n, 2 * n);
    let real = |value: f64| Complex::new(value, 0.0);
    for t in 0..steps {
        for r in observations.at(t) {
            for i in 0..n {
                let u = observations.coefficient(r, i);
                (0..=i).for_each(|j| band.add(t * n + i, t * n + j, u.conj() * observations.coefficient(r, j)));
            }
        }
        // squares of the second differences around t - 1, t and t + 1, as far as they exist
        let around = |s: usize| f64::from(u8::from(s >= 2 && s < steps));
        let (before, here, after) = (around(t), around(t + 1), around(t + 2));
        for i in t * n..(t + 1) * n {
            band.add(i, i, real(ridge + smoothness * (before + 4.0 * here + after)));
            if t + 1 < steps {
                band.add(i + n, i, real(-2.0 * smoothness * (here + after)));
            }
            if t + 2 < steps {
                band.add(i + 2 * n, i, real(smoothness * after));
            }
        }
    }
    band
}

impl<'a> Penalised<'a> {
    /// Factors the normal equations.
    ///
    /// # Errors
    /// `OutOfRange` for a smoothness that is not positive, `TooShort` for fewer than three steps, `NoConvergence` when the
    /// data leave the matrix singular.
    pub fn new(observations: &'a Observations, smoothness: f64) -> Result<Self> {
        if !(smoothness > 0.0 && smoothness.is_finite()) {
            let (what, expected) = ("smoothness".into(), "a positive, finite number".into());
            return Err(Error::OutOfRange { what, found: smoothness, expected });
        }
        if observations.steps() < 3 {
            let what = "the axis to smooth along".into();
            return Err(Error::TooShort { what, needed: 3, found: observations.steps() });
        }
        let factor = normal_matrix(observations, smoothness, 0.0)
            .factor()
            .or_else(|_| normal_matrix(observations, smoothness, RIDGE * 16.0 * smoothness).factor())?;
        Ok(Self { observations, smoothness, factor })
    }

    /// The minimiser (steps, n) for data `y` (rows), and the steps of conjugate gradients that it took.
    ///
    /// # Errors
    /// `Shape`, `NoConvergence` when the factor was no help.
    pub fn solve(&self, y: &[Complex]) -> Result<(Vec<Complex>, usize)> {
        let obs = self.observations;
        if y.len() != obs.rows() {
            return Err(Error::Shape { what: "data to fit".into(), expected: obs.rows(), found: y.len() });
        }
        let mut x = vec![Complex::new(0.0, 0.0); obs.steps() * obs.unknowns()];
        let mut rest = self.pull(&x, Some(y));
        let mut direction = rest.clone();
        self.factor.solve(&mut direction)?;
        let mut size = dot(&rest, &direction);
        let goal = size * GOAL * GOAL;
        let mut steps = 0;
        while size > goal && steps < STEPS {
            let curved = self.pull(&direction, None);
            let along = -dot(&direction, &curved);
            if along <= 0.0 || along.is_nan() {
                break;
            }
            let step = size / along;
            x.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
            rest.iter_mut().zip(&curved).for_each(|(r, c)| *r += step * c);
            let mut next = rest.clone();
            self.factor.solve(&mut next)?;
            let grown = dot(&rest, &next);
            direction.iter_mut().zip(&next).for_each(|(d, z)| *d = z + *d * (grown / size));
            size = grown;
            steps += 1;
        }
        if size > SETTLED * SETTLED * goal {
            return Err(Error::NoConvergence {
                method: "conjugate gradients behind the banded factorization".into(),
                iterations: steps,
                residual: GOAL * (size / goal).sqrt(),
                advice: "rounding left too little of the factor: use the smoother, or less smoothness".into(),
            });
        }
        Ok((x, steps))
    }

    /// `U^H (y - U x) - smoothness D^T D x`; without data, as if they were zero.
    fn pull(&self, x: &[Complex], y: Option<&[Complex]>) -> Vec<Complex> {
        let (obs, n) = (self.observations, self.observations.unknowns());
        let mut out = vec![Complex::new(0.0, 0.0); x.len()];
        for (t, (x, out)) in x.chunks_exact(n).zip(out.chunks_exact_mut(n)).enumerate() {
            for r in obs.at(t) {
                let fitted: Complex = x.iter().enumerate().map(|(i, x)| obs.coefficient(r, i) * x).sum();
                let rest = y.map_or(Complex::new(0.0, 0.0), |y| y[r]) - fitted;
                out.iter_mut().enumerate().for_each(|(i, out)| *out += obs.coefficient(r, i).conj() * rest);
            }
        }
        for i in 2 * n..x.len() {
            let bend = self.smoothness * ((x[i] - x[i - n]) - (x[i - n] - x[i - 2 * n]));
            out[i] -= bend;
            out[i - n] += 2.0 * bend;
            out[i - 2 * n] -= bend;
        }
        out
    }
}

fn dot(a: &[Complex], b: &[Complex]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.re * b.re + a.im * b.im).sum()
}

#[cfg(test)]
mod tests {
    use super::super::smoother::{End, Smoother};
    use super::*;
    use crate::numeric::rng::SplitMix64;

    #[test]
    fn normal_equations_and_smoother_find_one_minimiser() {
        let mut random = SplitMix64::new(6);
        let mut normal = || Complex::new(random.normal(), random.normal());
        for (n, steps) in [(1, 9), (3, 60), (5, 200)] {
            let mut observations = Observations::new(n);
            for t in 0..steps {
                // the middle third is seen by its first unknown only
                let one = t > steps / 3 && t < 2 * steps / 3;
                let row: Vec<Complex> = (0..n).map(|i| if one && i > 0 { 0.0 * normal() } else { normal() }).collect();
                observations.step([&row[..]]);
            }
            let y: Vec<Complex> = (0..steps).map(|_| normal()).collect();
            for smoothness in [1e-4, 1.0, 1e6] {
                let smooth =
                    Smoother::new(&observations, smoothness, &End::Free).expect("good").solve(&y).expect("good");
                let (x, _) = Penalised::new(&observations, smoothness).expect("good").solve(&y).expect("good");
                let scale = x.iter().map(|v| v.norm()).fold(0.0, f64::max);
                for (i, (a, b)) in x.iter().zip(&smooth.values).enumerate() {
                    assert!((a - b).norm() < 1e-8 * scale, "{n}, {steps}, {smoothness}: {i}: {a} {b}");
                }
            }
        }
    }
}
