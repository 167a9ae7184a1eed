//! Extended Kalman filter and Rauch-Tung-Striebel smoother along an experiment.
//!
//! Each sample interval is one run of the exact engine: its sensitivities are the transition matrix, with the saltation
//! of any event inside. Missing measurements are skipped. (Anderson & Moore 1979; Rauch, Tung & Striebel 1965.)

use nalgebra::{DMatrix, DVector};

use super::experiment::{Control, Experiment};
use crate::model::{Point, System};
use crate::simulate::Stop;
use crate::simulate::engine::{Engine, Settings};

/// What drives the states beyond the model.
pub enum Noise<'a> {
    /// Variance per second added to each state.
    Diagonal(&'a [f64]),
    /// A white force of intensity `q` entering as the columns of the flow's derivative by these states.
    Forces(&'a [(usize, f64)]),
}

/// Set-up of a filter.
pub struct Filter<'a> {
    /// System; derivatives by parameters are not needed.
    pub system: &'a dyn System,
    /// All parameters.
    pub p: &'a [f64],
    /// Recording.
    pub experiment: &'a Experiment,
    /// Steps per sample.
    pub substeps: u64,
    /// Standard deviation of each output's noise.
    pub sigma: &'a [f64],
    /// Initial state and its standard deviations.
    pub start: (&'a [f64], &'a [f64]),
    /// Process noise.
    pub noise: Noise<'a>,
    /// To stop early.
    pub control: &'a Control<'a>,
}

/// What a filter leaves behind.
pub struct Filtered {
    /// Log-likelihood of the innovations.
    pub log_likelihood: f64,
    /// Gains (n, nx, ny), row-major.
    pub gains: Vec<f64>,
    steps: Vec<Memory>,
}

struct Memory {
    predicted: DVector<f64>,
    predicted_cov: DMatrix<f64>,
    filtered: DVector<f64>,
    filtered_cov: DMatrix<f64>,
    mode: usize,
    /// From this sample to the next.
    transition: DMatrix<f64>,
}

/// Smoothed states.
pub struct Smoothed {
    /// Mean (n, nx), row-major.
    pub x: Vec<f64>,
    /// Standard deviation (n, nx).
    pub sd: Vec<f64>,
    /// Mode (n,).
    pub mode: Vec<usize>,
}

impl Filter<'_> {
    /// Filters forward.
    ///
    /// # Errors
    /// The reason why the system could not be followed.
    pub fn forward(&self) -> Result<Filtered, Stop> {
        let e = self.experiment;
        let (n, nx, ny) = (self.system.states(), self.system.states(), e.outputs());
        let nf = self.system.free().len();
        let ns = nx + nf;
        let step = e.dt / self.substeps as f64;
        let max_steps = 100 * (e.len() as u64 + 10) * self.substeps;
        let settings = Settings { t0: e.t0, step, max_steps, derivatives: true };
        let mode = self.system.initial_mode();
        let inputs = e.inputs.seen_by(self.system, self.p);
        let mut engine = Engine::new(self.system, self.p, &inputs, self.start.0, mode, settings)?;
        let mut identity = vec![0.0; nx * ns];
        for i in 0..nx {
            identity[i * ns + i] = 1.0;
        }
        let mut cov = DMatrix::from_diagonal(&DVector::from_iterator(n, self.start.1.iter().map(|s| s * s)));
        let mut out = Filtered { log_likelihood: 0.0, gains: vec![0.0; e.len() * nx * ny], steps: Vec::new() };
        let mut jacobian = vec![0.0; ny + ny * nx + ny * nf];
        let mut flow = vec![0.0; nx + nx * nx + nx * nf];
        for k in 0..e.len() {
            if k > 0 {
                let p_before = cov;
                // The noise enters where the interval starts.
                let u = engine.input().to_vec();
                let at = Point { t: engine.time(), x: engine.state(), u: &u, p: self.p };
                let mut q = DMatrix::zeros(nx, nx);
                match self.noise {
                    Noise::Diagonal(v) => q.set_diagonal(&DVector::from_iterator(n, v.iter().map(|v| v * e.dt))),
                    Noise::Forces(columns) => {
                        self.system.flow_jacobian(engine.mode(), at, &mut flow);
                        for &(c, intensity) in columns {
                            let b = DVector::from_iterator(nx, (0..nx).map(|i| flow[nx + i * nx + c] * intensity));
                            q += &b * b.transpose() * e.dt;
                        }
                    }
                }
                engine.advance(k as u64 * self.substeps)?;
                let f = DMatrix::from_fn(nx, nx, |i, j| engine.sensitivities()[i * ns + j]);
                cov = &f * p_before * f.transpose() + q;
                if let Some(m) = out.steps.last_mut() {
                    m.transition = f;
                }
            } else {
                engine.advance(0)?;
            }
            let predicted = DVector::from_column_slice(engine.state());
            let predicted_cov = cov.clone();
            engine.output_jacobian(&mut jacobian);
            let mut x = predicted.clone();
            // Outputs are taken one at a time: their noise is independent, and a gap is just one fewer.
            for j in 0..ny {
                let row = DVector::from_column_slice(&jacobian[ny + j * nx..ny + (j + 1) * nx]);
                // The prediction follows the state that earlier outputs of this sample have corrected.
                let error = e.y[k * ny + j] - jacobian[j] - row.dot(&(&x - &predicted));
                if !error.is_finite() {
                    continue;
                }
                let pc = &cov * &row;
                let variance = row.dot(&pc) + self.sigma[j] * self.sigma[j];
                let gain = pc / variance;
                x.axpy(error, &gain, 1.0);
                // Joseph form keeps the covariance positive.
                let keep = DMatrix::identity(nx, nx) - &gain * row.transpose();
                cov = &keep * &cov * keep.transpose() + &gain * gain.transpose() * (self.sigma[j] * self.sigma[j]);
                out.log_likelihood -= 0.5 * (error * error / variance + variance.ln());
                for i in 0..nx {
                    out.gains[k * nx * ny + i * ny + j] = gain[i];
                }
            }
            if x.iter().any(|v| !v.is_finite()) {
                return Err(Stop::Escape { time: engine.time(), mode: String::new(), state: String::new() });
            }
            engine.correct(x.as_slice(), &identity);
            out.steps.push(Memory {
                predicted,
                predicted_cov,
                filtered: x,
                filtered_cov: cov.clone(),
                mode: engine.mode(),
                transition: DMatrix::identity(nx, nx),
            });
            if k % 256 == 0 && self.control.check().is_err() {
                return Err(Stop::StepLimit { time: engine.time(), mode: "interrupted".into(), limit: k as u64 });
            }
        }
        Ok(out)
    }
}

impl Filtered {
    /// Smooths backward.
    pub fn smooth(&self) -> Smoothed {
        let n = self.steps.len();
        let nx = self.steps.first().map_or(0, |m| m.filtered.len());
        let mode = self.steps.iter().map(|m| m.mode).collect();
        let mut out = Smoothed { x: vec![0.0; n * nx], sd: vec![0.0; n * nx], mode };
        let Some(last) = self.steps.last() else { return out };
        let (mut x, mut cov) = (last.filtered.clone(), last.filtered_cov.clone());
        for k in (0..n).rev() {
            if k + 1 < n {
                let (m, next) = (&self.steps[k], &self.steps[k + 1]);
                if let Some(gain) = gain(m, &next.predicted_cov) {
                    x = &m.filtered + &gain * (&x - &next.predicted);
                    cov = &m.filtered_cov + &gain * (&cov - &next.predicted_cov) * gain.transpose();
                } else {
                    (x, cov) = (m.filtered.clone(), m.filtered_cov.clone());
                }
            }
            for i in 0..nx {
                out.x[k * nx + i] = x[i];
                out.sd[k * nx + i] = cov[(i, i)].max(0.0).sqrt();
            }
        }
        out
    }
}

/// `P F' (P_next)^-1`, with states scaled to unit variance first: they may differ by many orders of magnitude, and a
/// controller's memory or a held state may have no variance at all.
fn gain(m: &Memory, next: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale: DVector<f64> = next.diagonal().map(|v| if v > 0.0 { v.sqrt() } else { 1.0 });
    let n = scale.len();
    let mut scaled = DMatrix::from_fn(n, n, |i, j| next[(i, j)] / (scale[i] * scale[j]));
    for i in 0..n {
        scaled[(i, i)] += 1e-12;
    }
    let inverse = scaled.cholesky()?.inverse();
    let inverse = DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] / (scale[i] * scale[j]));
    Some(&m.filtered_cov * m.transition.transpose() * inverse)
}
