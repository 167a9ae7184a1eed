//! Penalised least squares along an axis, solved as a Kalman smoother.
//!
//! The unknowns are `n` complex numbers `x_t` at each of N steps, and [`Smoother`] minimises
//!
//! `sum_rows |y - u^T x_t|^2 + smoothness sum_t |x_(t+1) - 2 x_t + x_(t-1)|^2`
//!
//! with any number of rows at each step. The penalty is the prior of an integrated random walk (level and slope, the slope
//! moved by noise of variance `1/smoothness`) whose start is unknown, and the rows are its observations with unit noise. So
//! one forward pass over 2n x 2n covariances gives gains, at O(n^2) per row instead of the banded factorization's O(n^3), and
//! further passes over vectors give the minimiser for any data, in memory O(N n).
//!
//! * The start is diffuse in effect, not in the arithmetic: the forward pass starts from a finite prior, and conjugate
//!   gradients then find the prior mean that no longer pulls (the minimiser of the sum above, to rounding).
//! * At a checkpoint every few steps the covariance is kept: the minimiser is summed up from there over a few steps only, and
//!   its variances stand there.
//! * A sweep may end at the mirror of the axis ([`End::Mirror`]), which halves it for real systems.
//!
//! References: J. Durbin and S. J. Koopman, *Time Series Analysis by State Space Methods*, 2nd ed., Oxford 2012, sections 4.4
//! to 4.7 (disturbance smoother, covariances) and 5 (diffuse start); P. De Jong, Biometrika 75 (1988) 594-600 (leverages);
//! G. Wahba, *Spline Models for Observational Data*, SIAM 1990, chapters 1 and 4 (spline smoothing, cross-validation).

mod blocks;
mod closing;
mod observations;
mod uncertainty;

use super::Complex;
use crate::error::{Error, Result};
use blocks::{Blocks, Vector, add, inner, padded};
use closing::Closing;
pub use observations::Observations;
use pulp::Arch;
pub use uncertainty::Uncertainty;

/// The prior variance of an unknown against what the walk reaches before data say more than it does, but at most
/// this many of the walk's steps or what it reaches over the whole axis; and against the variance that one row leaves. (Wider
/// priors cost digits, narrower ones passes.)
const WIDE: f64 = 1e5;
const MOST: f64 = 1e5;
const ALONE: f64 = 1e4;
/// Conjugate gradients stop at this relative pull of the prior, or after so many passes.
const PULL: f64 = 1e-8;
const PASSES: usize = 40;

/// What lies beyond the last step.
#[derive(Clone, Debug, PartialEq)]
pub enum End {
    /// Nothing.
    Free,
    /// The same axis again, mirrored at the last step: unknown `i` mirrored is the conjugate of unknown `mirror[i]`, an
    /// involution. Data of the last step count by their real part, as they are their own mirror images.
    Mirror(Vec<usize>),
}

/// The minimiser for one set of data.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Unknowns (steps, n).
    pub values: Vec<Complex>,
    /// `y - u^T x` (rows).
    pub residuals: Vec<Complex>,
    /// Passes over the data that the start took.
    pub passes: usize,
}

/// Gains of the forward pass, to be used for any data.
pub struct Smoother<'a> {
    observations: &'a Observations,
    noise: f64,
    /// Prior variance of each level and of each slope.
    prior: [Vec<f64>; 2],
    /// Of each row: gain of the level, gain of the slope, padded.
    gains: Vec<f64>,
    /// Of each row: variance of its innovation.
    variances: Vec<f64>,
    every: usize,
    checkpoints: Vec<Blocks>,
    closing: Option<(Blocks, Closing)>,
}

impl<'a> Smoother<'a> {
    /// The forward pass for these rows and this penalty.
    ///
    /// # Errors
    /// `OutOfRange` for a smoothness that is not positive or rows that are all zero, `TooShort` for fewer than three steps,
    /// `Shape` for a mirror of another length, `NoConvergence` when the covariance loses its sign.
    pub fn new(observations: &'a Observations, smoothness: f64, end: &End) -> Result<Self> {
        let (n, steps) = (observations.n, observations.steps());
        if !(smoothness > 0.0 && smoothness.is_finite()) {
            let (what, expected) = ("smoothness".into(), "a positive, finite number".into());
            return Err(Error::OutOfRange { what, found: smoothness, expected });
        }
        if steps < 3 {
            return Err(Error::TooShort { what: "the axis to smooth along".into(), needed: 3, found: steps });
        }
        let power = observations.power();
        if !(power > 0.0 && power.is_finite()) {
            let what = "mean square of the observed rows".into();
            return Err(Error::OutOfRange {
                what,
                found: power,
                expected: "more than zero: nothing is excited".into(),
            });
        }
        if let End::Mirror(mirror) = end
            && mirror.len() != n
        {
            let what = "mirror of the unknowns".into();
            return Err(Error::Shape { what, expected: n, found: mirror.len() });
        }
        let noise = 1.0 / smoothness;
        let walked = |reach: f64| noise * reach.powi(3) / 3.0;
        let most = walked(steps as f64).max(MOST * noise);
        let prior = observations.silence(noise, end).into_iter().map(|reach| {
            let level = most.min(WIDE * walked(reach)) + ALONE / power;
            (level, 3.0 * level / (reach * reach))
        });
        let (levels, slopes) = prior.unzip();
        let rows = observations.rows();
        let mut smoother = Self {
            observations,
            noise,
            prior: [levels, slopes],
            gains: Vec::with_capacity(rows * 4 * padded(n)),
            variances: Vec::with_capacity(rows),
            every: 2 * n,
            checkpoints: Vec::new(),
            closing: None,
        };
        smoother.forward(end)?;
        Ok(smoother)
    }

    fn forward(&mut self, end: &End) -> Result<()> {
        let obs = self.observations;
        let (n, last) = (obs.n, obs.steps() - 1);
        let mirrored = matches!(end, End::Mirror(_));
        let mut state = Blocks::diagonal(&self.prior[0], &self.prior[1]);
        let [mut h, mut level, mut slope] = [Vector::zero(n), Vector::zero(n), Vector::zero(n)];
        let mut product = [Vector::zero(n), Vector::zero(n)];
        // whether `level` and `slope` are the covariance times the next row already
        let mut ready = false;
        for t in 0..=last {
            if t % self.every == 0 {
                state.symmetrise();
                self.checkpoints.push(state.clone());
            }
            if t == last && mirrored {
                break;
            }
            // the step to zero frequency is taken without noise: what is known of the second difference there is the mirror's
            let noise = if mirrored && t + 1 == last { 0.0 } else { self.noise };
            let rows = obs.at(t);
            let mut pending = false;
            for r in rows.clone() {
                if !std::mem::take(&mut ready) {
                    h.fill(obs.row(r));
                    state.times_level(&h, &mut level, &mut slope);
                }
                let variance = 1.0 + inner(&h.data, &level.data).re;
                if !(variance >= 1.0 && variance.is_finite()) {
                    return Err(lost(t, variance));
                }
                let gain = 1.0 / variance;
                self.gains.extend(level.data.iter().chain(&slope.data).map(|v| v * gain));
                self.variances.push(variance);
                let root = gain.sqrt();
                level.data.iter_mut().chain(&mut slope.data).for_each(|v| *v *= root);
                pending = r + 1 == rows.end;
                if !pending {
                    state.subtract(&level, &slope);
                }
            }
            if t < last {
                level.data.iter_mut().zip(&slope.data).for_each(|(level, slope)| *level += slope);
                let next = obs.at(t + 1);
                ready = pending && !next.is_empty() && (t + 1) % self.every != 0 && !(mirrored && t + 1 == last);
                if ready {
                    h.fill(obs.row(next.start));
                    let [next_level, next_slope] = &mut product;
                    state.advance_times_level([&level, &slope], noise, &h, [&mut *next_level, &mut *next_slope]);
                    std::mem::swap(&mut level, next_level);
                    std::mem::swap(&mut slope, next_slope);
                } else {
                    state.advance(pending.then_some((&level, &slope)), noise);
                }
            }
        }
        if let End::Mirror(mirror) = end {
            let rows: Vec<Vector> = obs.at(last).map(|r| obs.vector(r)).map(conjugate).collect();
            let closing = Closing::new(&state, mirror, self.noise, &rows)?;
            self.closing = Some((state, closing));
        }
        Ok(())
    }

    fn gain(&self, r: usize) -> (&[f64], &[f64]) {
        let width = 2 * padded(self.observations.n);
        self.gains[2 * r * width..2 * (r + 1) * width].split_at(width)
    }

    /// Steps with gains: all, or all but the mirror's.
    fn open_steps(&self) -> usize {
        self.observations.steps() - usize::from(self.closing.is_some())
    }

    /// The forward pass over these data from this prior mean.
    fn innovations(&self, y: impl Fn(usize) -> Complex, mean: &[Vector; 2]) -> Forward {
        let open = self.open_steps();
        let mut state = mean.clone();
        let mut innovations = Vec::with_capacity(self.observations.rows());
        let mut predicted = Vec::with_capacity(open.div_ceil(self.every));
        Arch::new().dispatch(|| {
            for t in 0..open {
                if t % self.every == 0 {
                    predicted.push(state.clone());
                }
                let [level, slope] = &mut state;
                for r in self.observations.at(t) {
                    let innovation = y(r) - inner(self.observations.row(r), &level.data);
                    let (to_level, to_slope) = self.gain(r);
                    add(&mut level.data, innovation, to_level);
                    add(&mut slope.data, innovation, to_slope);
                    innovations.push(innovation);
                }
                if t + 1 < self.observations.steps() {
                    level.data.iter_mut().zip(&slope.data).for_each(|(level, slope)| *level += slope);
                }
            }
        });
        Forward { innovations, predicted, state }
    }

    /// Backward from `pull` at the end; innovations become residuals; calls `seen` with each step's pull and the slope's pull
    /// on the way into the next step. Returns the pull of the prior.
    fn backward(
        &self,
        mut pull: [Vector; 2],
        innovations: &mut [Complex],
        mut seen: impl FnMut(usize, &[Vector; 2], &[f64]),
    ) -> [Vector; 2] {
        let steps = self.observations.steps();
        let mut ahead = Vector::zero(self.observations.n);
        Arch::new().dispatch(|| {
            for t in (0..self.open_steps()).rev() {
                let [level, slope] = &mut pull;
                if t + 1 < steps {
                    ahead.fill(&slope.data);
                    slope.data.iter_mut().zip(&level.data).for_each(|(slope, level)| *slope += level);
                }
                for r in self.observations.at(t).rev() {
                    let (to_level, to_slope) = self.gain(r);
                    let answered = inner(to_level, &level.data) + inner(to_slope, &slope.data);
                    let residual = innovations[r] / self.variances[r] - answered;
                    add(&mut level.data, residual, self.observations.row(r));
                    innovations[r] = residual;
                }
                seen(t, &pull, &ahead.data);
            }
        });
        pull
    }

    fn end_pull(&self, state: &[Vector; 2], y: impl Fn(usize) -> Complex) -> [Vector; 2] {
        let zero = || Vector::zero(self.observations.n);
        match &self.closing {
            Some((_, closing)) => {
                let rows = self.observations.at(self.observations.steps() - 1);
                closing.pull(&state[0], &state[1], rows.map(y))
            }
            None => [zero(), zero()],
        }
    }

    /// The forward pass from this prior mean, and what the prior pulls then.
    fn prior_pull(&self, y: impl Fn(usize) -> Complex, mean: &[Vector; 2]) -> (Forward, [Vector; 2]) {
        let forward = self.innovations(&y, mean);
        let pull = self.backward(self.end_pull(&forward.state, y), &mut forward.innovations.clone(), |_, _, _| ());
        (forward, pull)
    }

    /// The forward pass from the mean at which the prior no longer pulls, by conjugate gradients, and the passes spent.
    fn diffuse(&self, y: &[Complex]) -> (Forward, usize) {
        let n = self.observations.n;
        let weigh = |r: &[Vector; 2]| {
            let mut out = r.clone();
            for (v, prior) in out.iter_mut().zip(&self.prior) {
                (0..n).for_each(|i| v.set(i, v.get(i) * prior[i]));
            }
            out
        };
        let dot =
            |a: &[Vector; 2], b: &[Vector; 2]| inner(&a[0].data, &b[0].data).re + inner(&a[1].data, &b[1].data).re;
        let (mut forward, mut rest) = self.prior_pull(|r| y[r], &[Vector::zero(n), Vector::zero(n)]);
        let mut direction = weigh(&rest);
        let mut size = dot(&rest, &direction);
        let goal = size * PULL * PULL;
        let mut passes = 1;
        while size > goal && passes < PASSES {
            passes += 1;
            // all is affine in the mean: minus the linear part of the pull is the curvature
            let (moved, curved) = self.prior_pull(|_| Complex::new(0.0, 0.0), &direction);
            let along = -dot(&direction, &curved);
            if along <= 0.0 || along.is_nan() {
                break;
            }
            let step = Complex::new(size / along, 0.0);
            forward.add(step, &moved);
            rest.iter_mut().zip(&curved).for_each(|(rest, curved)| add(&mut rest.data, step, &curved.data));
            let weighed = weigh(&rest);
            let next = dot(&rest, &weighed);
            let turn = Complex::new(next / size, 0.0);
            for (direction, weighed) in direction.iter_mut().zip(weighed) {
                let old = std::mem::replace(direction, weighed);
                add(&mut direction.data, turn, &old.data);
            }
            size = next;
        }
        (forward, passes)
    }

    /// The minimiser for these data (rows).
    ///
    /// # Errors
    /// `Shape`.
    pub fn solve(&self, y: &[Complex]) -> Result<Estimate> {
        let obs = self.observations;
        if y.len() != obs.rows() {
            return Err(Error::Shape { what: "data of the smoother".into(), expected: obs.rows(), found: y.len() });
        }
        let (n, steps, open) = (obs.n, obs.steps(), self.open_steps());
        let (Forward { innovations: mut work, predicted, state }, passes) = self.diffuse(y);
        let pull = self.end_pull(&state, |r| y[r]);
        let mut values = vec![Complex::new(0.0, 0.0); steps * n];
        let width = 2 * padded(n);
        let mut ahead = vec![0.0; self.every * width];
        if let Some((covariance, _)) = &self.closing {
            let [level, _] = moved(covariance, &state, &pull);
            (0..n).for_each(|i| values[open * n + i] = level.get(i));
        }
        self.backward(pull, &mut work, |t, pull, slope| {
            let at = t % self.every;
            ahead[at * width..(at + 1) * width].copy_from_slice(slope);
            if at > 0 {
                return;
            }
            let index = t / self.every;
            let [mut level, mut slope] = moved(&self.checkpoints[index], &predicted[index], pull);
            for (step, ahead) in ahead.chunks_exact(width).enumerate().take(open - t) {
                (0..n).for_each(|i| values[(t + step) * n + i] = level.get(i));
                add(&mut level.data, Complex::new(1.0, 0.0), &slope.data);
                add(&mut slope.data, Complex::new(self.noise, 0.0), ahead);
            }
        });
        if self.closing.is_some() {
            for r in obs.at(open) {
                let fitted: Complex = (0..n).map(|i| obs.vector(r).get(i).conj() * values[open * n + i]).sum();
                work.push(y[r] - fitted);
            }
        }
        Ok(Estimate { values, residuals: work, passes })
    }

    /// Sum over the rows of the logarithm of the innovations' variances (with the finite prior of the forward pass).
    pub fn log_determinant(&self) -> f64 {
        self.variances.iter().map(|v| v.ln()).sum()
    }

    /// Variances of all levels and of all slopes at the first step, before any row, with which the covariances begin.
    pub fn prior(&self) -> [&[f64]; 2] {
        [&self.prior[0], &self.prior[1]]
    }

    /// Bytes held between passes.
    pub fn bytes(&self) -> usize {
        let checkpoints: usize = self.checkpoints.iter().map(Blocks::bytes).sum();
        8 * (self.gains.capacity() + self.variances.capacity()) + checkpoints
    }
}

/// What a forward pass over vectors gives: affine in the data and in the prior mean.
struct Forward {
    /// Of each row with a gain.
    innovations: Vec<Complex>,
    /// Level and slope before the rows of each checkpoint.
    predicted: Vec<[Vector; 2]>,
    /// Level and slope at the end.
    state: [Vector; 2],
}

impl Forward {
    /// `self += factor other`.
    fn add(&mut self, factor: Complex, other: &Self) {
        self.innovations.iter_mut().zip(&other.innovations).for_each(|(a, b)| *a += factor * b);
        let pairs = self.predicted.iter_mut().zip(&other.predicted).chain([(&mut self.state, &other.state)]);
        pairs.for_each(|(a, b)| a.iter_mut().zip(b).for_each(|(a, b)| add(&mut a.data, factor, &b.data)));
    }
}

/// `state + P pull`.
fn moved(covariance: &Blocks, state: &[Vector; 2], pull: &[Vector; 2]) -> [Vector; 2] {
    let mut out = state.clone();
    let [mut level, mut slope] = state.clone();
    covariance.times(&pull[0], &pull[1], &mut level, &mut slope);
    add(&mut out[0].data, Complex::new(1.0, 0.0), &level.data);
    add(&mut out[1].data, Complex::new(1.0, 0.0), &slope.data);
    out
}

fn conjugate(mut row: Vector) -> Vector {
    let stride = row.stride;
    row.data[stride..].iter_mut().for_each(|v| *v = -*v);
    row
}

fn lost(step: usize, variance: f64) -> Error {
    Error::NoConvergence {
        method: format!("the smoother's forward pass (step {step}: predicted variance {variance:e})"),
        iterations: step,
        residual: variance,
        advice: "the covariance lost its sign: raise the smoothness or use the banded solver".into(),
    }
}

#[cfg(test)]
#[path = "smoother_tests.rs"]
mod tests;
