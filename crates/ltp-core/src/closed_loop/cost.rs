//! The design objective of those who simulate: errors of the nonlinear closed loop, Duyul 2018, eqs (4.4) and (4.6).
//!
//! `J = sum_i w_i sqrt(int (z_i - z_ref,i)^2 dt) + s sum_i w'_i sqrt(int_steady (z_i - z_ref,i)^2 dt)`. The gain enters the
//! model as parameters, so that it is compiled once and every evaluation is one simulation.

use rayon::prelude::*;
use std::fmt::Write;

use super::close::{acted, check, series};
use super::run::shares;
use crate::error::{Error, Result};
use crate::feedforward::Reference;
use crate::model::document::Parameter;
use crate::model::{Backend, Compiled, Model, System};
use crate::numeric::{Complex, fourier_series::FourierSeries};
use crate::simulate::Inputs;
use crate::simulate::engine::{Engine, Settings};

/// An error of this many amplitudes ends a simulation: its cost is infinite.
const LOST: f64 = 1e3;

/// What is simulated, and how its errors are weighed.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    /// Deviation (nx) from the reference at the start.
    pub deviation: Vec<f64>,
    /// Weight (nx) of the root of each state's integrated squared error over the whole time.
    pub weights: Vec<f64>,
    /// Weight (nx) of the same from `steady_from` on; zero where empty.
    pub steady_weights: Vec<f64>,
    /// Where the steady state begins, s.
    pub steady_from: f64,
    /// Time simulated, s.
    pub t_end: f64,
    /// Integration step, s, and that of the integral.
    pub dt: f64,
    /// Harmonics of the gain, of the reference's frequency; 0 is the mean.
    pub harmonics: Vec<usize>,
}

/// A cost by simulation, ready to be evaluated.
pub struct SimulationCost {
    system: Compiled,
    nominal: Vec<f64>,
    /// Numbers of the gain's parameters.
    gain: Vec<usize>,
    start: Vec<f64>,
    /// Reference (n, nx) at the samples.
    wanted: Vec<f64>,
    amplitudes: Vec<f64>,
    task: Task,
    period: f64,
    /// Numbers in one harmonic, nu nx.
    entries: usize,
}

impl SimulationCost {
    /// Compiles the loop of `model` around `reference` for gains of the task's harmonics.
    ///
    /// # Errors
    /// `Shape` and `OutOfRange` for a task that cannot be, and what the model says of its parameters.
    pub fn new(model: &Model, reference: &Reference, task: Task) -> Result<Self> {
        let (nx, nu) = (model.states().len(), model.inputs().len());
        let period = reference.period();
        let everywhere = FourierSeries::constant(period, &vec![1.0; nu * nx])?;
        check(model, reference, &everywhere)?;
        for (what, found) in [
            ("deviation", task.deviation.len()),
            ("weights", task.weights.len()),
            ("steady weights", if task.steady_weights.is_empty() { nx } else { task.steady_weights.len() }),
        ] {
            if found != nx {
                return Err(Error::Shape { what: what.into(), expected: nx, found });
            }
        }
        if !(task.dt > 0.0 && task.t_end >= task.dt && task.t_end / task.dt < 1e8) {
            let expected = format!("a positive step no longer than t_end = {} s", task.t_end);
            return Err(Error::OutOfRange { what: "dt".into(), found: task.dt, expected });
        }
        if task.harmonics.is_empty() {
            let expected = "at least one harmonic of the gain; 0 is the mean".into();
            return Err(Error::OutOfRange { what: "harmonics".into(), found: 0.0, expected });
        }
        let (closed, names) = with_parameters(model, reference, &everywhere, &task.harmonics)?;
        let gain = names.iter().map(|name| closed.parameter(name)).collect::<Result<Vec<_>>>()?;
        let system = closed.compile_for(gain.clone(), Backend::Native);
        let n = (task.t_end / task.dt).round() as usize + 1;
        let wanted = (0..n).flat_map(|i| reference.states.value(i as f64 * task.dt)).collect();
        let start = reference.states.value(0.0).iter().zip(&task.deviation).map(|(z, d)| z + d).collect();
        let (nominal, amplitudes) = (system.parameters().to_vec(), shares(reference));
        Ok(Self { system, nominal, gain, start, wanted, amplitudes, task, period, entries: nu * nx })
    }

    /// Numbers in a gain: per harmonic (nu, nx), of those above zero first the real and then the imaginary part, with
    /// `K(t) = K_0 + Re sum_k K_k e^{j k w t}`.
    pub fn len(&self) -> usize {
        self.gain.len()
    }

    /// Never: a gain has entries.
    pub fn is_empty(&self) -> bool {
        self.gain.is_empty()
    }

    /// Costs of gains (n, [`SimulationCost::len`]), evaluated side by side.
    pub fn evaluate_all(&self, gains: &[f64]) -> Vec<f64> {
        gains.par_chunks_exact(self.len().max(1)).map(|gain| self.evaluate(gain)).collect()
    }

    /// A gain (nu, nx) as a periodic signal, from its numbers.
    ///
    /// # Errors
    /// `Shape` for another number of them, `NotFinite`.
    pub fn gain(&self, numbers: &[f64]) -> Result<FourierSeries> {
        if numbers.len() != self.len() {
            return Err(Error::Shape { what: "numbers in a gain".into(), expected: self.len(), found: numbers.len() });
        }
        let most = self.task.harmonics.iter().copied().max().unwrap_or(0);
        let mut lines = vec![Complex::new(0.0, 0.0); (most + 1) * self.entries];
        let mut rest = numbers;
        let mut take = || {
            let (part, after) = rest.split_at(self.entries);
            rest = after;
            part
        };
        for &k in &self.task.harmonics {
            let (re, im) = (take(), if k > 0 { Some(take()) } else { None });
            for i in 0..self.entries {
                // K_0 + Re K_k e^{jkwt}: the coefficient of a series is half of K_k.
                lines[k * self.entries + i] += im.map_or(Complex::from(re[i]), |im| 0.5 * Complex::new(re[i], im[i]));
            }
        }
        FourierSeries::new(self.period, self.entries, lines)
    }

    /// The cost of a gain; infinite where the motion is lost.
    ///
    /// # Panics
    /// For a gain of another length than [`SimulationCost::len`].
    pub fn evaluate(&self, gain: &[f64]) -> f64 {
        self.simulate(gain, None)
    }

    /// The cost of a gain with its gradient, by the sensitivities of the motion; zero where the motion is lost.
    ///
    /// # Panics
    /// As [`SimulationCost::evaluate`].
    pub fn with_gradient(&self, gain: &[f64]) -> (f64, Vec<f64>) {
        let mut gradient = vec![0.0; gain.len()];
        let value = self.simulate(gain, Some(&mut gradient));
        if !value.is_finite() {
            gradient.fill(0.0);
        }
        (value, gradient)
    }

    fn simulate(&self, gain: &[f64], gradient: Option<&mut [f64]>) -> f64 {
        assert_eq!(gain.len(), self.gain.len(), "numbers in a gain");
        let (nx, nf, derivatives) = (self.start.len(), gain.len(), gradient.is_some());
        let mut p = self.nominal.clone();
        self.gain.iter().zip(gain).for_each(|(&number, &value)| p[number] = value);
        let n = self.wanted.len() / nx;
        let inputs = Inputs::constant(&vec![0.0; self.system.inputs()]);
        let settings = Settings { t0: 0.0, step: self.task.dt, max_steps: 10 * n as u64, derivatives };
        let mode = self.system.initial_mode();
        let inputs = inputs.seen_by(&self.system, &p);
        let Ok(mut engine) = Engine::new(&self.system, &p, &inputs, &self.start, mode, settings) else {
            return f64::INFINITY;
        };
        // Squares of all states over the whole time, then over the steady part; and half their slopes.
        let mut squares = vec![0.0; 2 * nx];
        let mut slopes = vec![0.0; if derivatives { 2 * nx * nf } else { 0 }];
        for i in 0..n {
            if engine.advance(i as u64).is_err() {
                return f64::INFINITY;
            }
            // The trapezoidal rule: ends count half.
            let weight = if i == 0 || i + 1 == n { 0.5 * self.task.dt } else { self.task.dt };
            let parts = if i as f64 * self.task.dt >= self.task.steady_from { 2 } else { 1 };
            for r in 0..nx {
                let error = engine.state()[r] - self.wanted[i * nx + r];
                if error.is_nan() || error.abs() >= LOST * self.amplitudes[r] {
                    return f64::INFINITY;
                }
                for part in 0..parts {
                    squares[part * nx + r] += weight * error * error;
                    if derivatives {
                        let row = &engine.sensitivities()[r * (nx + nf) + nx..][..nf];
                        let slope = &mut slopes[(part * nx + r) * nf..][..nf];
                        slope.iter_mut().zip(row).for_each(|(s, d)| *s += weight * error * d);
                    }
                }
            }
        }
        let weights = self.task.weights.iter().chain(&self.task.steady_weights);
        if let Some(gradient) = gradient {
            gradient.fill(0.0);
            for (k, w) in weights.clone().enumerate().filter(|(k, w)| **w != 0.0 && squares[*k] > 0.0) {
                let factor = w / squares[k].sqrt();
                gradient.iter_mut().zip(&slopes[k * nf..][..nf]).for_each(|(g, s)| *g += factor * s);
            }
        }
        weights.zip(&squares).map(|(w, s)| w * s.sqrt()).sum()
    }
}

/// The closed loop with the gain as parameters, and their names.
fn with_parameters(
    model: &Model,
    reference: &Reference,
    everywhere: &FourierSeries,
    harmonics: &[usize],
) -> Result<(Model, Vec<String>)> {
    let states = model.states();
    let inputs = acted(model, reference, everywhere);
    let mut document = model.document().clone();
    let mut names = Vec::new();
    let mut texts: Vec<String> = inputs.iter().map(|(input, _)| series(&reference.inputs, *input)).collect();
    for &k in harmonics {
        let omega = k as f64 * reference.states.pumping();
        let parts: &[(&str, String)] = if k == 0 {
            &[("mean", "1.0".to_owned())]
        } else {
            &[("re", format!("cos({omega:?}*t)")), ("im", format!("(-sin({omega:?}*t))"))]
        };
        for (part, factor) in parts {
            for ((input, _), text) in inputs.iter().zip(&mut texts) {
                for (c, state) in states.iter().enumerate() {
                    let name = format!("gain_{k}_{part}_{input}_{c}");
                    let wanted = series(&reference.states, c);
                    let _ = write!(text, " - {name}*{factor}*({state} - ({wanted}))");
                    document.parameters.insert(name.clone(), Parameter::default());
                    names.push(name);
                }
            }
        }
    }
    let expressions: Vec<(&str, &str)> =
        inputs.iter().zip(&texts).map(|((_, n), e)| (n.as_str(), e.as_str())).collect();
    let model = Model::new(document, model.library().clone(), model.name())?.with_input_expressions(&expressions)?;
    Ok((model, names))
}
