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

impl Bench<'_> {
    /// Residuals of a model in units of sigma, all records after one another; `shift` moves the starts.
    fn residuals(&self, model: &Model, shift: Option<(usize, usize, f64)>) -> Result<Vec<f64>> {
        let machine = Machine::new(model, &[])?;
        let ny = self.sigma.len();
        let mut out = Vec::new();
        for (r, record) in self.records.iter().enumerate() {
            let mut x0 = record.start.clone();
            if let Some((at, state, by)) = shift
                && at == r
            {
                x0[state] += by;
            }
            let y = self.setup.replay(&machine, record.wave, &x0)?.outputs;
            out.extend(record.outputs.iter().zip(&y).enumerate().map(|(k, (a, b))| (a - b) / self.sigma[k % ny]));
        }
        Ok(out)
    }

    /// Residual and its slopes by uncertain parameters (in units of `freedom` stated uncertainties) and starts.
    fn linear(&self, model: &Model, freedom: f64) -> Result<(Vec<f64>, Vec<Vec<f64>>, Vec<usize>)> {
        let base = self.residuals(model, None)?;
        let mut columns = Vec::new();
        let free: Vec<usize> =
            model.parameters().iter().enumerate().filter(|(_, p)| p.sd.is_some()).map(|(i, _)| i).collect();
        for &i in &free {
            let p = &model.parameters()[i];
            let step = 1e-3 * p.sd.unwrap_or(0.0);
            let moved = self.residuals(&model.with_parameters(&[(&p.name, p.value + step, None)])?, None)?;
            let unit = freedom * p.sd.unwrap_or(0.0) / step;
            columns.push(base.iter().zip(&moved).map(|(a, b)| (a - b) * unit).collect());
        }
        let per_record = base.len() / self.records.len();
        for (r, record) in self.records.iter().enumerate() {
            for state in 0..record.start.len() {
                let step = 1e-6;
                // A state that is held at its start (a toe on the ground) has no slope of its own.
                let Ok(moved) = self.residuals(model, Some((r, state, step))) else { continue };
                let column: Vec<f64> = base.iter().zip(&moved).map(|(a, b)| (a - b) / step).collect();
                let size = stats::rms(column.iter().copied());
                let jumps = column.iter().any(|v| !v.is_finite());
                if size > 0.0 && !jumps && column[r * per_record..].iter().any(|v| *v != 0.0) {
                    // In units that move the outputs by their weight: starts are free.
                    columns.push(column.iter().map(|v| 1e3 * v / size).collect());
                }
            }
        }
        Ok((base, columns, free))
    }

    /// Sum of squares of the residual, in units of sigma, that no choice of parameters and starts removes, to first order;
    /// and the whole sum of squares.
    ///
    /// # Errors
    /// When the nominal machine does not run along the records.
    pub fn left(&self, model: &Model) -> Result<(f64, f64)> {
        let (base, columns, _) = self.linear(model, WIDE)?;
        let whole = base.iter().map(|v| v * v).sum();
        let step = ridge(&columns, &base);
        let rest =
            base.iter().enumerate().map(|(k, v)| v - columns.iter().zip(&step).map(|(c, s)| c[k] * s).sum::<f64>());
        Ok((rest.map(|v| v * v).sum(), whole))
    }

    /// The model with its uncertain parameters refitted to the records, within a few of their stated uncertainties.
    ///
    /// # Errors
    /// As [`Bench::left`].
    pub fn masked(&self, model: &Model) -> Result<Model> {
        let stated: Vec<(f64, f64)> = model.parameters().iter().map(|p| (p.value, p.sd.unwrap_or(0.0))).collect();
        let mut now = model.clone();
        for _ in 0..STEPS {
            let (base, mut columns, free) = self.linear(&now, MASK)?;
            // The prior is about what was stated, not about the last step.
            let mut base = base;
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

fn ridge(columns: &[Vec<f64>], base: &[f64]) -> Vec<f64> {
    ridge_of(columns, base, 1.0)
}

/// Least squares with unit (times `weight`) ridge by the normal equations, scaled, with Cholesky's method.
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
