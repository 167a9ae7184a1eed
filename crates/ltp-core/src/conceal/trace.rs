//! What an effect leaves in the recordings once the nominal parameters have absorbed what they can, by the truth
//! integrator's own finite differences. Nothing of it is shared with the fit of a diagnosis.

use super::machine::{Machine, Wave};
use super::setups::Setup;
use crate::error::Result;
use crate::model::Model;
use crate::numeric::stats;

/// Freedom of the parameters in a trace, in their stated uncertainties: wide, so that what can be imitated is.
const WIDE: f64 = 20.0;
/// Freedom in the refit that masks, in stated uncertainties.
const MASK: f64 = 2.0;
/// Change of the outputs, in sigmas, that a unit of a start makes: so large that starts are free.
const LOOSE: f64 = 1e3;
/// Share of the change (rms) which, once a first step has left it, needs no further steps to be told from imitation.
const CLEAR: f64 = 0.3;
/// Steps of the refit that masks.
const STEPS: usize = 3;

/// One record as the nominal model meets it.
pub struct Meeting<'a> {
    /// Input as recorded.
    pub wave: &'a Wave,
    /// What was measured, without noise (samples, ny).
    pub outputs: &'a [f64],
    /// State of the nominal machine at time zero.
    pub start: Vec<f64>,
}

/// A nominal model before records of a machine.
pub struct Bench<'a> {
    /// Experiment.
    pub setup: &'a Setup,
    /// Records.
    pub records: &'a [Meeting<'a>],
    /// Weight of an error of each output: its noise, or a size.
    pub sigma: &'a [f64],
}

/// Residuals at a point, and how they move.
struct Linear {
    /// Residuals in units of sigma, all records after one another.
    base: Vec<f64>,
    /// What a unit of each unknown takes away.
    columns: Vec<Vec<f64>>,
    /// The uncertain parameters: the first columns.
    free: Vec<usize>,
    /// Record, state and size of a unit of each further column.
    starts: Vec<(usize, usize, f64)>,
}

impl Bench<'_> {
    fn residuals(&self, model: &Model, starts: &[Vec<f64>]) -> Result<Vec<f64>> {
        let machine = Machine::new(model, &[])?;
        let ny = self.sigma.len();
        let mut out = Vec::new();
        for (record, x0) in self.records.iter().zip(starts) {
            let y = self.setup.replay(&machine, record.wave, x0)?.outputs;
            out.extend(record.outputs.iter().zip(&y).enumerate().map(|(k, (a, b))| (a - b) / self.sigma[k % ny]));
        }
        Ok(out)
    }

    /// Slopes by uncertain parameters (in units of `freedom` stated uncertainties) and by starts, which are free.
    fn linear(&self, model: &Model, x0: &[Vec<f64>], freedom: f64) -> Result<Linear> {
        let base = self.residuals(model, x0)?;
        let free: Vec<usize> =
            model.parameters().iter().enumerate().filter(|(_, p)| p.sd.is_some()).map(|(i, _)| i).collect();
        let (mut columns, mut starts) = (Vec::new(), Vec::new());
        for &i in &free {
            let p = &model.parameters()[i];
            let step = 1e-3 * p.sd.unwrap_or(0.0);
            let moved = self.residuals(&model.with_parameters(&[(&p.name, p.value + step, None)])?, x0)?;
            let unit = freedom * p.sd.unwrap_or(0.0) / step;
            columns.push(base.iter().zip(&moved).map(|(a, b)| (a - b) * unit).collect());
        }
        for (r, state) in (0..x0.len()).flat_map(|r| (0..x0[r].len()).map(move |s| (r, s))) {
            let step = 1e-6;
            let mut shifted = x0.to_vec();
            shifted[r][state] += step;
            let Ok(moved) = self.residuals(model, &shifted) else { continue };
            let column: Vec<f64> = base.iter().zip(&moved).map(|(a, b)| (a - b) / step).collect();
            let size = stats::rms(column.iter().copied());
            // A state that is held at its start (a toe on the ground) has no slope.
            if size > 0.0 && size.is_finite() {
                let unit = LOOSE / size;
                columns.push(column.iter().map(|v| v * unit).collect());
                starts.push((r, state, unit));
            }
        }
        Ok(Linear { base, columns, free, starts })
    }

    /// Sum of squares of the residual, in units of sigma, that the uncertain parameters and the starts do not remove in
    /// `steps` Gauss-Newton steps, the last one taken to first order; and the whole sum of squares.
    ///
    /// # Errors
    /// When the nominal machine does not run along the records.
    pub fn left(&self, model: &Model, steps: usize) -> Result<(f64, f64)> {
        let mut x0: Vec<Vec<f64>> = self.records.iter().map(|r| r.start.clone()).collect();
        let mut now = model.clone();
        let (mut whole, mut least) = (0.0, f64::INFINITY);
        for round in 0..steps {
            let Ok(linear) = self.linear(&now, &x0, WIDE) else { break };
            let energy = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>();
            if round == 0 {
                whole = energy(&linear.base);
            }
            let step = ridge_of(&linear.columns, &linear.base, 1.0);
            let taken = |k: usize| linear.columns.iter().zip(&step).map(|(c, s)| c[k] * s).sum::<f64>();
            let rest: Vec<f64> = linear.base.iter().enumerate().map(|(k, v)| v - taken(k)).collect();
            least = least.min(energy(&rest));
            if least > CLEAR * CLEAR * whole {
                break;
            }
            let mut values = Vec::new();
            for (&i, s) in linear.free.iter().zip(&step) {
                let p = &now.parameters()[i];
                let wanted = p.value + s * WIDE * p.sd.unwrap_or(0.0);
                values.push((p.name.clone(), wanted.clamp(p.bounds.0, p.bounds.1)));
            }
            for ((r, state, unit), s) in linear.starts.iter().zip(&step[linear.free.len()..]) {
                x0[*r][*state] += s * unit;
            }
            let values: Vec<(&str, f64, Option<f64>)> = values.iter().map(|(n, v)| (n.as_str(), *v, None)).collect();
            now = now.with_parameters(&values)?;
        }
        if least.is_finite() {
            return Ok((least, whole));
        }
        Err(crate::error::Error::NoConvergence {
            method: "trace of an effect".into(),
            iterations: steps,
            residual: least,
            advice: "the nominal machine does not run along these records; take a smaller effect".into(),
        })
    }

    /// The model with its uncertain parameters refitted to the records, within a few of their stated uncertainties.
    ///
    /// # Errors
    /// As [`Bench::left`].
    pub fn masked(&self, model: &Model) -> Result<Model> {
        let stated: Vec<(f64, f64)> = model.parameters().iter().map(|p| (p.value, p.sd.unwrap_or(0.0))).collect();
        let x0: Vec<Vec<f64>> = self.records.iter().map(|r| r.start.clone()).collect();
        let mut now = model.clone();
        for _ in 0..STEPS {
            let Linear { mut base, mut columns, free, .. } = self.linear(&now, &x0, MASK)?;
            // The prior is about what was stated, not about the last step.
            for (c, &i) in free.iter().enumerate() {
                base.push((stated[i].0 - now.parameters()[i].value) / (MASK * stated[i].1));
                for (k, column) in columns.iter_mut().enumerate() {
                    column.push(if k == c { 1.0 } else { 0.0 });
                }
            }
            let step = ridge_of(&columns, &base, 1e-9);
            let values: Vec<(String, f64)> = free
                .iter()
                .zip(&step)
                .map(|(&i, s)| {
                    let p = &now.parameters()[i];
                    let (mean, sd) = stated[i];
                    let wanted = p.value + s * MASK * sd;
                    (p.name.clone(), wanted.clamp(mean - 4.0 * sd, mean + 4.0 * sd).clamp(p.bounds.0, p.bounds.1))
                })
                .collect();
            let values: Vec<(&str, f64, Option<f64>)> = values.iter().map(|(n, v)| (n.as_str(), *v, None)).collect();
            now = now.with_parameters(&values)?;
        }
        Ok(now)
    }
}

/// Least squares with a ridge of `weight` by the normal equations, with Cholesky's method.
fn ridge_of(columns: &[Vec<f64>], base: &[f64], weight: f64) -> Vec<f64> {
    let n = columns.len();
    let mut a = vec![vec![0.0; n]; n];
    let mut b = vec![0.0; n];
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    for i in 0..n {
        for j in 0..=i {
            a[i][j] = dot(&columns[i], &columns[j]);
        }
        a[i][i] += weight + 1e-12 * a[i][i];
        b[i] = dot(&columns[i], base);
    }
    for i in 0..n {
        for j in 0..=i {
            let sum = a[i][j] - (0..j).map(|k| a[i][k] * a[j][k]).sum::<f64>();
            a[i][j] = if i == j { sum.max(f64::MIN_POSITIVE).sqrt() } else { sum / a[j][j] };
        }
    }
    for i in 0..n {
        b[i] = (b[i] - (0..i).map(|k| a[i][k] * b[k]).sum::<f64>()) / a[i][i];
    }
    for i in (0..n).rev() {
        b[i] = (b[i] - (i + 1..n).map(|k| a[k][i] * b[k]).sum::<f64>()) / a[i][i];
    }
    b
}
