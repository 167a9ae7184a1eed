//! What an effect leaves in the recordings once the nominal parameters have absorbed what they can, by the truth
//! integrator's own finite differences. Nothing of it is shared with the fit of a diagnosis.

use super::Planted;
use super::machine::{Machine, Wave};
use super::setups::Setup;
use crate::error::Result;
use crate::model::Model;
use crate::numeric::stats;

/// Freedom of the parameters in a trace, in their stated uncertainties, at each step: wide, so that what can be imitated is.
const WIDE: f64 = 20.0;
/// Freedom in the refit that masks, in stated uncertainties.
const MASK: f64 = 2.0;
/// Change of the outputs, in sigmas, that a unit of a start makes: so large that starts are free.
const LOOSE: f64 = 1e3;
/// Decrease of the energy by a step below which further ones bring nothing.
const SETTLED: f64 = 0.1;
/// Factor by which a positive parameter may change in one step.
const STRIDE: f64 = 3.0;
/// Weights of a step's length that are tried in turn.
const REINS: [f64; 7] = [1.0, 1e2, 1e4, 1e6, 1e8, 1e10, 1e12];
/// Least of them where the way is felt for: what a common scale of masses and gains changes is nothing, and goes nowhere.
const FLAT: f64 = 1e6;
/// Longest step of a parameter where the way is felt for, in units of its freedom; and how many times as many steps that may take.
const FELT: (f64, usize) = (0.25, 3);
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

/// What is believed of the machine: a model, where its records start, and perhaps an effect that is not the concealed one.
#[derive(Clone)]
struct Guess {
    model: Model,
    starts: Vec<Vec<f64>>,
    rival: Option<Planted>,
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
    /// Number of a rival's parameters: the columns after them, in units of their values.
    rival: usize,
    /// Record, state and size of a unit of each further column.
    starts: Vec<(usize, usize, f64)>,
}

impl Linear {
    /// A guess after a step, within the bounds of the parameters.
    fn moved(&self, from: &Guess, step: &[f64]) -> Result<Guess> {
        let mut to = from.clone();
        let infos = from.model.parameters();
        let values: Vec<(&str, f64, Option<f64>)> = self
            .free
            .iter()
            .zip(step)
            .map(|(&i, s)| {
                let p = &infos[i];
                let wanted = p.value + s * WIDE * p.sd.unwrap_or(0.0);
                // Far off a machine may be so stiff that it never gets to the end of a record.
                let near = if p.value > 0.0 { wanted.clamp(p.value / STRIDE, p.value * STRIDE) } else { wanted };
                (p.name.as_str(), near.clamp(p.bounds.0, p.bounds.1), None)
            })
            .collect();
        to.model = from.model.with_parameters(&values)?;
        let step = &step[self.free.len()..];
        // A rival keeps its sign, but for a force that may have either.
        let either = from.rival.as_ref().is_some_and(|r| r.name == "constant_force");
        for ((_, value), s) in to.rival.iter_mut().flat_map(|r| r.parameters.iter_mut()).zip(step) {
            *value *= if either { 1.0 + s } else { (1.0 + s).clamp(0.1, 10.0) };
        }
        for ((r, state, unit), s) in self.starts.iter().zip(&step[self.rival..]) {
            to.starts[*r][*state] += s * unit;
        }
        Ok(to)
    }
}

impl Bench<'_> {
    fn residuals(&self, guess: &Guess) -> Result<Vec<f64>> {
        let machine = Machine::new(&guess.model, guess.rival.as_slice())?;
        let ny = self.sigma.len();
        let late = guess.rival.as_ref().filter(|r| r.name.ends_with("_delay")).map_or(0.0, |r| r.parameters[0].1);
        let mut out = Vec::new();
        for (record, x0) in self.records.iter().zip(&guess.starts) {
            let y = self.setup.replay(&machine, record.wave, x0)?.outputs;
            // What a late sensor shows at first happened before the record, where nobody looked.
            let unseen = (late / self.setup.dt).ceil() as usize * ny;
            let rest = record.outputs.iter().zip(&y).enumerate();
            out.extend(rest.map(|(k, (a, b))| if k < unseen { 0.0 } else { (a - b) / self.sigma[k % ny] }));
        }
        Ok(out)
    }

    /// Slopes by uncertain parameters (in units of `freedom` stated uncertainties), by those of a rival, and by starts, which
    /// are free.
    fn linear(&self, guess: &Guess, freedom: f64) -> Result<Linear> {
        let base = self.residuals(guess)?;
        let slope = |moved: &Guess, step: f64| -> Result<Vec<f64>> {
            Ok(base.iter().zip(&self.residuals(moved)?).map(|(a, b)| (a - b) / step).collect())
        };
        let infos = guess.model.parameters();
        let free: Vec<usize> = infos.iter().enumerate().filter(|(_, p)| p.sd.is_some()).map(|(i, _)| i).collect();
        let (mut columns, mut starts) = (Vec::new(), Vec::new());
        for &i in &free {
            let p = &infos[i];
            let step = 1e-3 * p.sd.unwrap_or(0.0);
            let model = guess.model.with_parameters(&[(&p.name, p.value + step, None)])?;
            let column = slope(&Guess { model, ..guess.clone() }, step)?;
            columns.push(column.iter().map(|v| v * freedom * p.sd.unwrap_or(0.0)).collect());
        }
        let rival = guess.rival.as_ref().map_or(0, |r| r.parameters.len());
        for k in 0..rival {
            let mut moved = guess.clone();
            let Some((_, value)) = moved.rival.as_mut().and_then(|r| r.parameters.get_mut(k)) else { continue };
            let unit = value.abs().max(f64::MIN_POSITIVE);
            *value += 1e-4 * unit;
            columns.push(slope(&moved, 1e-4)?);
        }
        for (r, state) in (0..guess.starts.len()).flat_map(|r| (0..guess.starts[r].len()).map(move |s| (r, s))) {
            let step = 1e-6;
            let mut shifted = guess.clone();
            shifted.starts[r][state] += step;
            let Ok(column) = slope(&shifted, step) else { continue };
            let size = stats::rms(column.iter().copied());
            // A state that is held at its start (a toe on the ground) has no slope.
            if size > 0.0 && size.is_finite() {
                let unit = LOOSE / size;
                columns.push(column.iter().map(|v| v * unit).collect());
                starts.push((r, state, unit));
            }
        }
        Ok(Linear { base, columns, free, rival, starts })
    }

    /// Sum of squares of the residual, in units of sigma, that the uncertain parameters and the starts do not remove in
    /// `steps` Gauss-Newton steps, the last one taken to first order; and the whole sum of squares. With a `rival`, its
    /// parameters are fitted too. Where long steps do not get to the bottom, short ones may: a long one can land beyond a
    /// resonance, from where no way leads back. `enough` is the share of the whole below which nobody asks further.
    ///
    /// # Errors
    /// When the nominal machine does not run along the records.
    pub fn left(&self, model: &Model, rival: Option<Planted>, steps: usize, enough: f64) -> Result<(f64, f64)> {
        let (mut least, whole) = self.descent(model, rival.clone(), steps, f64::INFINITY);
        if steps > 1 && rival.is_none() && least > enough * whole {
            least = least.min(self.descent(model, None, FELT.1 * steps, FELT.0).0);
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

    /// As [`Bench::left`], with parameters that go no further than `stride` at a step; infinite where nothing runs.
    fn descent(&self, model: &Model, rival: Option<Planted>, steps: usize, stride: f64) -> (f64, f64) {
        let starts = self.records.iter().map(|r| r.start.clone()).collect();
        let mut now = Guess { model: model.clone(), starts, rival };
        let (mut whole, mut least) = (0.0, f64::INFINITY);
        let energy = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>();
        for round in 0..steps {
            let Ok(linear) = self.linear(&now, WIDE) else { break };
            let here = energy(&linear.base);
            if round == 0 {
                whole = here;
            }
            let step = ridge_of(&linear.columns, &linear.base, 1.0);
            let taken = |k: usize| linear.columns.iter().zip(&step).map(|(c, s)| c[k] * s).sum::<f64>();
            let rest: Vec<f64> = linear.base.iter().enumerate().map(|(k, v)| v - taken(k)).collect();
            least = least.min(energy(&rest));
            if round + 1 == steps || energy(&rest) > (1.0 - SETTLED) * here {
                break;
            }
            // A change of a tenth of a mass is far from linear along a record, and a scale that masses and gains share is flat:
            // a step that makes matters worse is taken again with shorter reins (Levenberg).
            let next = REINS.iter().filter(|w| stride.is_infinite() || **w >= FLAT).find_map(|&weight| {
                let mut step = ridge_of(&linear.columns, &linear.base, weight);
                let longest = step[..linear.free.len()].iter().fold(0.0f64, |m, s| m.max(s.abs()));
                if longest > stride {
                    step.iter_mut().for_each(|s| *s *= stride / longest);
                }
                let to = linear.moved(&now, &step).ok()?;
                let there = energy(&self.residuals(&to).ok()?);
                (there < here).then_some((to, there))
            });
            let Some((to, there)) = next else { break };
            least = least.min(there);
            now = to;
        }
        (least, whole)
    }

    /// The model with its uncertain parameters refitted to the records, within a few of their stated uncertainties.
    ///
    /// # Errors
    /// As [`Bench::left`].
    pub fn masked(&self, model: &Model) -> Result<Model> {
        let stated: Vec<(f64, f64)> = model.parameters().iter().map(|p| (p.value, p.sd.unwrap_or(0.0))).collect();
        let starts: Vec<Vec<f64>> = self.records.iter().map(|r| r.start.clone()).collect();
        let mut now = model.clone();
        for _ in 0..STEPS {
            let guess = Guess { model: now.clone(), starts: starts.clone(), rival: None };
            let Linear { mut base, mut columns, free, .. } = self.linear(&guess, MASK)?;
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
