//! A recording bound to a model: inputs and outputs in the model's order, and its free run with derivatives.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::{Error, Result, nearest};
use crate::model::{Model, System};
use crate::signal::Recording;
use crate::simulate::engine::{Engine, Settings};
use crate::simulate::sensor::Sensor;
use crate::simulate::{Event, Hold, Inputs, STEPS_PER_TIME, Stop};

/// Asks long work to stop, and tells how far it is.
pub struct Control<'a> {
    /// Set from another thread to end the work.
    pub cancelled: &'a AtomicBool,
    /// Called with the stage and the fraction done.
    pub progress: &'a (dyn Fn(&str, f64) + Sync),
}

impl Control<'_> {
    /// [`Error::Interrupted`] once cancelled.
    ///
    /// # Errors
    /// When cancelled.
    pub fn check(&self) -> Result<()> {
        if self.cancelled.load(Ordering::Relaxed) { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// A recording in the model's terms.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// Name of the recording.
    pub name: String,
    /// Time of the first sample, s.
    pub t0: f64,
    /// Distance of samples, s.
    pub dt: f64,
    /// Outputs (n, ny), row-major; NaN where nothing was measured.
    pub y: Vec<f64>,
    /// Inputs.
    pub inputs: Inputs,
    ny: usize,
}

impl Experiment {
    /// Finds the model's inputs and outputs in a recording by name.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for an input that the recording lacks and that has no default, or when it has none of the
    /// outputs.
    pub fn new(model: &Model, recording: &Recording, hold: Hold) -> Result<Self> {
        let n = recording.len();
        let missing = |kind: &str, name: &str, names: &[String]| Error::UnknownName {
            kind: kind.into(),
            name: name.into(),
            nearest: nearest(name, names),
            context: format!("recording `{}`", recording.name()),
        };
        let mut columns = Vec::new();
        for (name, input) in &model.document().inputs {
            match recording.input_names().iter().position(|r| r == name) {
                Some(i) => columns.push(recording.input(i).collect()),
                None => match input.value {
                    Some(v) => columns.push(vec![v; n]),
                    None => return Err(missing("input", name, recording.input_names())),
                },
            }
        }
        let outputs = model.outputs();
        let place: Vec<Option<usize>> =
            outputs.iter().map(|o| recording.output_names().iter().position(|r| r == o)).collect();
        if place.iter().all(Option::is_none) {
            return Err(missing("output", outputs[0], recording.output_names()));
        }
        let ny = outputs.len();
        let width = recording.output_names().len();
        let mut y = vec![f64::NAN; n * ny];
        for (j, p) in place.iter().enumerate() {
            for (k, row) in recording.outputs().chunks(width).enumerate() {
                if let Some(p) = p {
                    y[k * ny + j] = row[*p];
                }
            }
        }
        let t0 = recording.t()[0];
        let inputs = Inputs::samples(t0, recording.dt(), &columns, hold)?;
        Ok(Self { name: recording.name().to_string(), t0, dt: recording.dt(), y, inputs, ny })
    }

    /// A record that is planned, not measured: `n` samples of `ny` outputs, all gaps.
    pub fn planned(name: &str, (t0, dt): (f64, f64), n: usize, ny: usize, inputs: Inputs) -> Self {
        Self { name: name.to_string(), t0, dt, y: vec![f64::NAN; n * ny], inputs, ny }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.y.len() / self.ny
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.y.is_empty()
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.ny
    }

    /// One output.
    pub fn output(&self, j: usize) -> impl Iterator<Item = f64> + '_ {
        self.y.iter().skip(j).step_by(self.ny).copied()
    }

    /// Samples `from..to` as an experiment of their own.
    #[must_use]
    pub fn part(&self, from: usize, to: usize) -> Self {
        Self { t0: self.t0 + from as f64 * self.dt, y: self.y[from * self.ny..to * self.ny].to_vec(), ..self.clone() }
    }
}

/// Corrections that tie a run to its recording: after each sample `x += scale * K e` with `K` (n, states of the nominal model, ny).
#[derive(Clone, Copy)]
pub struct Observer<'a> {
    /// Gains of every sample, row-major.
    pub gains: &'a [f64],
}

/// Called for each sample with its number, the outputs and their derivatives.
pub type Each<'a> = dyn FnMut(usize, &[f64], &[f64]) + 'a;

/// A run of a system along an experiment.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// What runs.
    pub system: &'a dyn System,
    /// All parameters.
    pub p: &'a [f64],
    /// Initial state.
    pub x0: &'a [f64],
    /// What was recorded.
    pub experiment: &'a Experiment,
    /// Steps per sample.
    pub substeps: u64,
    /// Observer; free run where `None`.
    pub observer: Option<Observer<'a>>,
    /// To stop early.
    pub control: &'a Control<'a>,
}

/// Most parts into which a step is cut for the sake of a short time constant.
pub const FINEST: f64 = 8.0;

/// Into how many parts a step is cut: those of the model itself suit it, a lag that an effect brings along may be shorter.
fn finer(system: &dyn System, p: &[f64], step: f64) -> u64 {
    (step / (STEPS_PER_TIME * system.shortest_time(p))).ceil().clamp(1.0, FINEST) as u64
}

impl Run<'_> {
    /// Runs along the samples and calls `each(sample, outputs, derivatives)`; the derivatives `(ny, nx + nf)` by initial
    /// state and free parameter are empty where not asked for. Returns the events on the way.
    ///
    /// # Errors
    /// The reason why the run ended early.
    pub fn go(&self, derivatives: bool, each: &mut Each<'_>) -> std::result::Result<Vec<Event>, Stop> {
        let Run { system, p, x0, experiment: e, observer, control, .. } = *self;
        let substeps = self.substeps * finer(system, p, e.dt / self.substeps as f64);
        let (nx, nf, ny) = (system.states(), system.free().len(), e.ny);
        let ns = nx + nf;
        let step = e.dt / substeps as f64;
        let settings = Settings { t0: e.t0, step, max_steps: 100 * (e.len() as u64 + 10) * substeps, derivatives };
        let inputs = e.inputs.seen_by(system, p);
        let mut engine = Engine::new(system, p, &inputs, x0, system.initial_mode(), settings)?;
        let mut sensor = Sensor::new(system, p, &inputs, x0, system.initial_mode(), settings)?;
        let mut y = vec![0.0; ny];
        let mut dy = vec![0.0; if derivatives { ny * ns } else { 0 }];
        let (mut x, mut s) = (vec![0.0; nx], vec![0.0; if derivatives { nx * ns } else { 0 }]);
        for k in 0..e.len() {
            if k % 256 == 0 && control.cancelled.load(Ordering::Relaxed) {
                return Err(Stop::StepLimit { time: engine.time(), mode: "interrupted".into(), limit: k as u64 });
            }
            sensor.advance(&mut engine, k as u64 * substeps, &mut y, &mut dy)?;
            each(k, &y, &dy);
            let Some(o) = observer else { continue };
            // States that effects brought along are not corrected: the observer was made without them.
            let known = o.gains.len() / (e.len() * ny);
            let gain = &o.gains[k * known * ny..(k + 1) * known * ny];
            x.copy_from_slice(engine.state());
            s.copy_from_slice(engine.sensitivities());
            for j in 0..ny {
                let error = e.y[k * ny + j] - y[j];
                if !error.is_finite() {
                    continue;
                }
                for i in 0..known {
                    let g = gain[i * ny + j];
                    x[i] += g * error;
                    if derivatives {
                        for c in 0..ns {
                            s[i * ns + c] -= g * dy[j * ns + c];
                        }
                    }
                }
            }
            engine.correct(&x, &s);
        }
        Ok(engine.into_events())
    }

    /// Outputs (n, ny) of the run; `None` where it ended early or left the finite numbers.
    pub fn outputs(&self) -> Option<Vec<f64>> {
        let mut out = Vec::with_capacity(self.experiment.y.len());
        self.go(false, &mut |_, y, _| out.extend_from_slice(y)).ok()?;
        out.iter().all(|v| v.is_finite()).then_some(out)
    }
}
