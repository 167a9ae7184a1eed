//! One step of Dormand-Prince 5(4): stages, solution, error estimate, dense output, and the same step of the
//! sensitivities.
//!
//! Sensitivities obey the variational equation of the *discrete* map: the derivative of the step itself, so that a fit
//! sees the exact gradient of what it simulates.

use super::inputs::{Inputs, Interval};
use crate::model::{Point, Stepper, System};
use crate::numeric::tableau::{A, B, C, D, E, STAGES};

/// What a step evaluates the system at.
#[derive(Clone, Copy)]
pub(super) struct Context<'a> {
    pub system: &'a dyn System,
    /// The step of this mode as one program, once that is worth having.
    pub stepper: Option<&'a Stepper>,
    pub p: &'a [f64],
    pub inputs: &'a Inputs,
    pub mode: usize,
    pub interval: Interval,
}

/// Working memory of a step.
pub(super) struct Work {
    nx: usize,
    nf: usize,
    nu: usize,
    /// Rates of stages 1 to 7, state at the end, its error estimate, guards at the end: what a [`Stepper`] writes, behind
    /// the first stage.
    values: Vec<f64>,
    /// State, rates and length of the step: what a [`Stepper`] reads.
    start: Vec<f64>,
    /// State of the stage at hand.
    x: Vec<f64>,
    /// Inputs at the nodes after the start.
    u: Vec<f64>,
    /// Flow with Jacobians at each stage.
    jacobians: Vec<Vec<f64>>,
    /// Stage derivatives of the sensitivities.
    ks: [Vec<f64>; STAGES],
    stage: Vec<f64>,
    /// Fifth dense output coefficient.
    dense: Vec<f64>,
    /// Evaluations of the flow so far.
    pub evaluations: u64,
}

impl Work {
    pub fn new(nx: usize, nu: usize, nf: usize, derivatives: bool) -> Self {
        let (j, s) = if derivatives { (nx + nx * nx + nx * nf, nx * (nx + nf)) } else { (0, 0) };
        Self {
            nx,
            nf,
            nu,
            values: vec![0.0; (STAGES + 3) * nx],
            start: vec![0.0; 2 * nx + 1],
            x: vec![0.0; nx],
            u: vec![0.0; nu * Stepper::NODES],
            jacobians: vec![vec![0.0; j]; STAGES + 1],
            ks: std::array::from_fn(|_| vec![0.0; s]),
            stage: vec![0.0; s],
            dense: vec![0.0; nx],
            evaluations: 0,
        }
    }

    /// Makes room for the guards of a mode.
    pub fn set_guards(&mut self, count: usize) {
        self.values.resize((STAGES + 3) * self.nx + count, 0.0);
    }

    /// Rates at a stage, counted from 0.
    fn rates(&self, stage: usize) -> &[f64] {
        &self.values[stage * self.nx..(stage + 1) * self.nx]
    }

    /// State at the end of the step.
    #[inline]
    pub fn end(&self) -> &[f64] {
        &self.values[(STAGES + 1) * self.nx..(STAGES + 2) * self.nx]
    }

    /// Guards at the end of the step.
    #[inline]
    pub fn guards(&self) -> &[f64] {
        &self.values[(STAGES + 3) * self.nx..]
    }

    /// A step of length `h` from `(t, x0)`. With `first` the first stage is known from the step before or from a trial of
    /// another length; with `derivatives` the Jacobians of every stage are kept for [`Work::sensitivities`].
    pub fn step(&mut self, c: Context<'_>, t: f64, h: f64, x0: &[f64], first: bool, derivatives: bool) {
        let (nx, nu) = (self.nx, self.nu);
        if !first {
            c.inputs.eval(c.interval, t, &mut self.u[..nu]);
            self.x.copy_from_slice(x0);
            self.evaluate(c, 0, t, 0, derivatives);
            self.start[..nx].copy_from_slice(x0);
            self.start[nx..2 * nx].copy_from_slice(&self.values[..nx]);
        }
        if nu > 0 {
            for (u, node) in self.u.chunks_exact_mut(nu).zip(&C[1..]) {
                c.inputs.eval(c.interval, t + node * h, u);
            }
        }
        if let (Some(stepper), false) = (c.stepper, derivatives) {
            self.start[2 * nx] = h;
            stepper.step(t, &self.start, &self.u, c.p, &mut self.values[nx..]);
            self.evaluations += STAGES as u64;
            return;
        }
        for i in 1..=STAGES {
            let (weights, node) = if i < STAGES { (&A[i][..i], i) } else { (&B[..], STAGES - 1) };
            // The newest stage enters last and alone: what depends on it is short, and so is the wait for it.
            let (newest, older) = weights.split_last().expect("no stage without weights");
            for (n, x0) in x0.iter().enumerate() {
                let before = x0 + h * self.weighted(older, n);
                self.x[n] = before + (h * newest) * self.values[(i - 1) * nx + n];
            }
            self.evaluate(c, i, t + C[node] * h, node - 1, derivatives);
        }
        for n in 0..nx {
            let error = h * self.weighted(&E, n);
            self.values[(STAGES + 1) * nx + n] = self.x[n];
            self.values[(STAGES + 2) * nx + n] = error;
        }
        let guards = &mut self.values[(STAGES + 3) * nx..];
        if !guards.is_empty() {
            let u = &self.u[(Stepper::NODES - 1) * nu..];
            c.system.guard_values(c.mode, Point { t: t + h, x: &self.x, u, p: c.p }, guards);
        }
    }

    /// Rates of a stage at the state in `self.x`, with the inputs in one of the slots of `self.u`.
    fn evaluate(&mut self, c: Context<'_>, stage: usize, t: f64, slot: usize, derivatives: bool) {
        let nx = self.nx;
        let at = Point { t, x: &self.x, u: &self.u[slot * self.nu..(slot + 1) * self.nu], p: c.p };
        let rates = &mut self.values[stage * nx..(stage + 1) * nx];
        if derivatives {
            c.system.flow_jacobian(c.mode, at, &mut self.jacobians[stage]);
            rates.copy_from_slice(&self.jacobians[stage][..nx]);
        } else {
            c.system.flow(c.mode, at, rates);
        }
        self.evaluations += 1;
    }

    #[inline]
    fn weighted(&self, weights: &[f64], n: usize) -> f64 {
        let mut sum = 0.0;
        for (w, k) in weights.iter().zip(self.values.chunks_exact(self.nx)) {
            sum += w * k[n];
        }
        sum
    }

    /// Accepts the step: its end becomes the state `x`, its last stage the first one of the next step. `largest` and `error`
    /// keep the largest sizes of states and of error estimates. One loop does all: four short copies cost more than a step.
    #[inline]
    pub fn accept(&mut self, x: &mut [f64], largest: &mut [f64], error: &mut [f64]) {
        let nx = x.len();
        let (largest, error) = (&mut largest[..nx], &mut error[..nx]);
        let (stages, ends) = self.values.split_at_mut(STAGES * nx);
        let first = &mut stages[..nx];
        let (last, end, errors) = (&ends[..nx], &ends[nx..2 * nx], &ends[2 * nx..3 * nx]);
        let (start_x, start_k) = self.start[..2 * nx].split_at_mut(nx);
        for n in 0..nx {
            x[n] = end[n];
            start_x[n] = end[n];
            start_k[n] = last[n];
            first[n] = last[n];
            largest[n] = largest[n].max(end[n].abs());
            error[n] = error[n].max(errors[n].abs());
        }
    }

    /// Makes the Jacobians of the last stage those of the next step's first.
    pub fn shift_jacobians(&mut self) {
        self.jacobians.swap(0, STAGES);
    }

    /// Prepares the dense output.
    pub fn prepare_dense(&mut self, h: f64) {
        for n in 0..self.nx {
            self.dense[n] = h * self.weighted(&D, n);
        }
    }

    /// State at the fraction `theta` of the step.
    pub fn dense(&self, x0: &[f64], h: f64, theta: f64, out: &mut [f64]) {
        let rest = 1.0 - theta;
        let (first, last, end) = (self.rates(0), self.rates(STAGES), self.end());
        for n in 0..self.nx {
            let difference = end[n] - x0[n];
            let bend = h * first[n] - difference;
            let twist = difference - h * last[n] - bend;
            out[n] = x0[n] + theta * (difference + rest * (bend + theta * (twist + rest * self.dense[n])));
        }
    }

    /// Carries the sensitivities `s` (nx rows of nx + nf) over the step whose stages were evaluated with derivatives.
    pub fn sensitivities(&mut self, h: f64, s: &mut [f64]) {
        let (nx, nf) = (self.nx, self.nf);
        let ns = nx + nf;
        for i in 0..STAGES {
            let (ks, rest) = self.ks.split_at_mut(i);
            combine(h, &A[i][..i], ks, s, &mut self.stage);
            let (fx, fp) = self.jacobians[i][nx..].split_at(nx * nx);
            for (r, row) in rest[0].chunks_exact_mut(ns).enumerate() {
                row[..nx].fill(0.0);
                row[nx..].copy_from_slice(&fp[r * nf..(r + 1) * nf]);
                for (a, stage) in fx[r * nx..(r + 1) * nx].iter().zip(self.stage.chunks_exact(ns)) {
                    if *a != 0.0 {
                        add(*a, stage, row);
                    }
                }
            }
        }
        self.stage.copy_from_slice(s);
        combine(h, &B, &self.ks, &self.stage, s);
    }
}

/// `out = s + h sum_j weights[j] k[j]`, in one pass over the memory.
fn combine(h: f64, weights: &[f64], k: &[Vec<f64>], s: &[f64], out: &mut [f64]) {
    fn pass<const N: usize>(h: f64, weights: &[f64], k: &[Vec<f64>], s: &[f64], out: &mut [f64]) {
        let n = out.len();
        let w: [f64; N] = std::array::from_fn(|j| h * weights[j]);
        let k: [&[f64]; N] = std::array::from_fn(|j| &k[j][..n]);
        for (i, (o, s)) in out.iter_mut().zip(s).enumerate() {
            let mut sum = *s;
            for j in 0..N {
                sum += w[j] * k[j][i];
            }
            *o = sum;
        }
    }
    match weights.len() {
        0 => out.copy_from_slice(s),
        1 => pass::<1>(h, weights, k, s, out),
        2 => pass::<2>(h, weights, k, s, out),
        3 => pass::<3>(h, weights, k, s, out),
        4 => pass::<4>(h, weights, k, s, out),
        5 => pass::<5>(h, weights, k, s, out),
        _ => pass::<6>(h, weights, k, s, out),
    }
}

#[inline]
fn add(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}
