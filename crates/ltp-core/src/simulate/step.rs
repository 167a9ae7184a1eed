//! One step of Dormand-Prince 5(4): stages, solution, error estimate, dense output, and the same step of the
//! sensitivities.
//!
//! Sensitivities obey the variational equation of the *discrete* map: the derivative of the step itself, so that a fit
//! sees the exact gradient of what it simulates.

use super::inputs::Inputs;
use super::tableau::{A, B, C, D, E, STAGES};
use crate::model::{Point, System};

/// Working memory of a step.
pub(super) struct Work {
    pub nx: usize,
    pub nf: usize,
    /// Stage derivatives, the seventh at the end of the step.
    pub k: Vec<Vec<f64>>,
    /// State of the stage at hand, then of the end of the step.
    pub x: Vec<f64>,
    u: Vec<f64>,
    /// Flow with Jacobians at each stage.
    jacobians: Vec<Vec<f64>>,
    /// Stage derivatives of the sensitivities.
    ks: Vec<Vec<f64>>,
    stage: Vec<f64>,
    /// Fifth dense output coefficient.
    dense: Vec<f64>,
}

/// What a step evaluates the system at.
#[derive(Clone, Copy)]
pub(super) struct Context<'a> {
    pub system: &'a dyn System,
    pub p: &'a [f64],
    pub inputs: &'a Inputs,
    pub mode: usize,
    pub interval: usize,
}

impl Work {
    pub fn new(nx: usize, nu: usize, nf: usize, derivatives: bool) -> Self {
        let ns = nx + nf;
        let (j, s) = if derivatives { (nx + nx * nx + nx * nf, nx * ns) } else { (0, 0) };
        Self {
            nx,
            nf,
            k: vec![vec![0.0; nx]; STAGES + 1],
            x: vec![0.0; nx],
            u: vec![0.0; nu],
            jacobians: vec![vec![0.0; j]; STAGES],
            ks: vec![vec![0.0; s]; STAGES],
            stage: vec![0.0; s],
            dense: vec![0.0; nx],
        }
    }

    /// All stages of a step of length `h` from `x0`; the end state is left in `self.x`. With `first` the first stage is
    /// already known; with `derivatives` the Jacobians of every stage are kept for [`Work::sensitivities`].
    pub fn stages(&mut self, c: Context<'_>, t: f64, h: f64, x0: &[f64], first: bool, derivatives: bool) {
        let nx = self.nx;
        for i in 0..STAGES {
            if i == 0 {
                if first && !derivatives {
                    continue;
                }
                self.x.copy_from_slice(x0);
            } else {
                for n in 0..nx {
                    let mut sum = 0.0;
                    for (a, k) in A[i][..i].iter().zip(&self.k) {
                        sum += a * k[n];
                    }
                    self.x[n] = x0[n] + h * sum;
                }
            }
            let ti = t + C[i] * h;
            c.inputs.eval(c.interval, ti, &mut self.u);
            let at = Point { t: ti, x: &self.x, u: &self.u, p: c.p };
            if derivatives {
                c.system.flow_jacobian(c.mode, at, &mut self.jacobians[i]);
                self.k[i].copy_from_slice(&self.jacobians[i][..nx]);
            } else {
                c.system.flow(c.mode, at, &mut self.k[i]);
            }
        }
        for n in 0..nx {
            let mut sum = 0.0;
            for (b, k) in B.iter().zip(&self.k) {
                sum += b * k[n];
            }
            self.x[n] = x0[n] + h * sum;
        }
    }

    /// Flow at the end of the step: the seventh stage, and the next step's first.
    pub fn last_stage(&mut self, c: Context<'_>, t_end: f64) {
        c.inputs.eval(c.interval, t_end, &mut self.u);
        c.system.flow(c.mode, Point { t: t_end, x: &self.x, u: &self.u, p: c.p }, &mut self.k[STAGES]);
    }

    /// Embedded error estimate of one state.
    pub fn error(&self, n: usize, h: f64) -> f64 {
        h * E.iter().zip(&self.k).map(|(e, k)| e * k[n]).sum::<f64>()
    }

    /// Prepares the dense output; needs the last stage.
    pub fn prepare_dense(&mut self, h: f64) {
        for n in 0..self.nx {
            self.dense[n] = h * D.iter().zip(&self.k).map(|(d, k)| d * k[n]).sum::<f64>();
        }
    }

    /// State at the fraction `theta` of the step.
    pub fn dense(&self, x0: &[f64], h: f64, theta: f64, out: &mut [f64]) {
        let rest = 1.0 - theta;
        for n in 0..self.nx {
            let difference = self.x[n] - x0[n];
            let bend = h * self.k[0][n] - difference;
            let twist = difference - h * self.k[STAGES][n] - bend;
            out[n] = x0[n] + theta * (difference + rest * (bend + theta * (twist + rest * self.dense[n])));
        }
    }

    /// Carries the sensitivities `s` (nx rows of nx + nf) over the step whose stages were evaluated with derivatives.
    pub fn sensitivities(&mut self, h: f64, s: &mut [f64]) {
        let (nx, nf) = (self.nx, self.nf);
        let ns = nx + nf;
        for i in 0..STAGES {
            self.stage.copy_from_slice(s);
            for (a, k) in A[i][..i].iter().zip(&self.ks) {
                if *a != 0.0 {
                    axpy(h * a, k, &mut self.stage);
                }
            }
            let j = &self.jacobians[i];
            let (fx, fp) = (&j[nx..nx + nx * nx], &j[nx + nx * nx..]);
            let k = &mut self.ks[i];
            for r in 0..nx {
                let row = &mut k[r * ns..(r + 1) * ns];
                row[..nx].fill(0.0);
                row[nx..].copy_from_slice(&fp[r * nf..(r + 1) * nf]);
                for c in 0..nx {
                    let a = fx[r * nx + c];
                    if a != 0.0 {
                        axpy(a, &self.stage[c * ns..(c + 1) * ns], row);
                    }
                }
            }
        }
        for (b, k) in B.iter().zip(&self.ks) {
            if *b != 0.0 {
                axpy(h * b, k, s);
            }
        }
    }
}

#[inline]
fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}
