//! Motions by brute force: Strang splitting with tiny steps, the slow and obvious integrator that the truth is held against.
//!
//! Half a step of classical Runge-Kutta for the smooth part, a velocity-level impulse that stops the port or opposes its
//! motion with at most `level * h` (Moreau 1988), half a step again; no event location.

use crate::error::{Error, Result};
use crate::model::friction::Parts;
use crate::model::{Model, Point};
use crate::simulate::Inputs;

/// An output beyond this, in its SI unit, is no motion of a machine any more.
const ESCAPED: f64 = 1e9;
/// Small steps per sample.
const FINE: usize = 200;

/// A motion of a model: outputs (n, ny), row-major, by the independent integrator.
///
/// # Errors
/// [`Error::Model`] for a hybrid model, [`Error::NoConvergence`] when the motion leaves the finite numbers.
pub fn motion(model: &Model, inputs: &Inputs, x0: &[f64], samples: usize, dt: f64) -> Result<Vec<f64>> {
    let parts = model.parts().ok_or_else(|| Error::Model {
        path: model.name().to_string(),
        message: "recordings with concealed physics are made of models with one mode and no events".into(),
    })?;
    let p: Vec<f64> = model.parameters().iter().map(|p| p.value).collect();
    let h = dt / FINE as f64;
    let mut walker = Walker::new(&parts, &p, inputs, x0);
    let mut out = Vec::with_capacity(samples * parts.output.len());
    let mut y = vec![0.0; parts.output.len()];
    for k in 0..samples {
        let t = k as f64 * dt;
        inputs.eval(inputs.interval(t + 1e-6 * dt), t, &mut walker.u);
        parts.output.eval(Point { t, x: &walker.x, u: &walker.u, p: &p }, &mut y);
        out.extend_from_slice(&y);
        for i in 0..FINE {
            walker.step(t + i as f64 * h, h);
        }
    }
    if out.iter().all(|v| v.abs() < ESCAPED) {
        return Ok(out);
    }
    Err(Error::NoConvergence {
        method: format!("motion of `{}`", model.name()),
        iterations: samples,
        residual: f64::INFINITY,
        advice: "the motion leaves the finite numbers; take other inputs or parameters".into(),
    })
}

pub(super) struct Walker<'a> {
    parts: &'a Parts,
    p: &'a [f64],
    inputs: &'a Inputs,
    pub(super) x: Vec<f64>,
    pub(super) u: Vec<f64>,
    k: [Vec<f64>; 4],
    stage: Vec<f64>,
    action: Vec<f64>,
    element: Vec<f64>,
}

impl<'a> Walker<'a> {
    pub(super) fn new(parts: &'a Parts, p: &'a [f64], inputs: &'a Inputs, x0: &[f64]) -> Self {
        let n = x0.len();
        Self {
            parts,
            p,
            inputs,
            x: x0.to_vec(),
            u: vec![0.0; inputs.count()],
            k: std::array::from_fn(|_| vec![0.0; n]),
            stage: vec![0.0; n],
            action: vec![0.0; n * parts.elements],
            element: vec![0.0; 3 * parts.elements],
        }
    }

    fn step(&mut self, t: f64, h: f64) {
        self.smooth(t, 0.5 * h);
        self.impulse(t + 0.5 * h, h);
        self.smooth(t + 0.5 * h, 0.5 * h);
    }

    /// Classical Runge-Kutta of order 4 without dry friction.
    pub(super) fn smooth(&mut self, t: f64, h: f64) {
        let interval = self.inputs.interval(t + 0.5 * h);
        for (i, c) in [0.0, 0.5, 0.5, 1.0].into_iter().enumerate() {
            for n in 0..self.x.len() {
                self.stage[n] = self.x[n] + if i == 0 { 0.0 } else { c * h * self.k[i - 1][n] };
            }
            self.inputs.eval(interval, t + c * h, &mut self.u);
            let at = Point { t: t + c * h, x: &self.stage, u: &self.u, p: self.p };
            self.parts.flow.eval(at, &mut self.k[i]);
        }
        for n in 0..self.x.len() {
            self.x[n] += h / 6.0 * (self.k[0][n] + 2.0 * self.k[1][n] + 2.0 * self.k[2][n] + self.k[3][n]);
        }
    }

    /// Friction over a step, element by element and twice, so that coupled elements see each other.
    fn impulse(&mut self, t: f64, h: f64) {
        let n = self.x.len();
        let mut spent = vec![0.0; self.parts.elements];
        for _ in 0..if self.parts.elements > 1 { 4 } else { 1 } {
            for (i, spent) in spent.iter_mut().enumerate() {
                let at = Point { t, x: &self.x, u: &self.u, p: self.p };
                self.parts.element.eval(at, &mut self.element);
                self.parts.action.eval(at, &mut self.action);
                let [velocity, level, authority] = [0, 1, 2].map(|j| self.element[3 * i + j]);
                let wanted = *spent - velocity / authority;
                let allowed = wanted.clamp(-level * h, level * h);
                let change = allowed - *spent;
                *spent = allowed;
                for k in 0..n {
                    self.x[k] += self.action[i * n + k] * change;
                }
            }
        }
    }
}
