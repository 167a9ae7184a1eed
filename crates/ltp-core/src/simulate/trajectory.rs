//! The noun `Trajectory`, and the verb that makes it.

use super::engine::{Engine, Settings};
use super::inputs::Inputs;
use super::sensor::Sensor;
use super::stop::{Event, Stats, Stop};
use crate::error::{Error, Result};
use crate::model::System;

/// Step over the shortest time constant of an effect's states, above which it is cut.
pub const STEPS_PER_TIME: f64 = 2.0;

/// What to simulate.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Start, s.
    pub t0: f64,
    /// Distance of samples, s.
    pub dt: f64,
    /// Number of samples, the start included.
    pub samples: usize,
    /// Steps between two samples.
    pub substeps: u64,
    /// Initial state; the model's where `None`.
    pub initial_state: Option<Vec<f64>>,
    /// Starting mode; the model's where `None`.
    pub initial_mode: Option<usize>,
    /// Largest number of steps.
    pub max_steps: u64,
    /// Whether to carry sensitivities.
    pub derivatives: bool,
}

impl Plan {
    /// Samples every `dt` from zero to `t_end`, one step from sample to sample.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] when `dt` or `t_end` is not positive and finite.
    pub fn new(t_end: f64, dt: f64) -> Result<Self> {
        let positive = |what: &str, found: f64| {
            let expected = "a positive, finite time in s".to_string();
            if found > 0.0 && found.is_finite() {
                Ok(())
            } else {
                Err(Error::OutOfRange { what: what.into(), found, expected })
            }
        };
        positive("dt", dt)?;
        positive("t_end", t_end)?;
        let samples = (t_end / dt + 1e-9).floor() + 1.0;
        if samples > 1e9 {
            let expected = "at most 1e9 samples; take a larger dt or a smaller t_end".into();
            return Err(Error::OutOfRange { what: "t_end/dt".into(), found: samples, expected });
        }
        Ok(Self {
            t0: 0.0,
            dt,
            samples: samples as usize,
            substeps: 1,
            initial_state: None,
            initial_mode: None,
            max_steps: 1_000_000_000,
            derivatives: false,
        })
    }

    /// With steps no longer than `step` seconds.
    #[must_use]
    pub fn with_step(mut self, step: f64) -> Self {
        self.substeps = (self.dt / step - 1e-9).ceil().max(1.0) as u64;
        self
    }

    /// With steps that follow the shortest time constant that effects brought along, such as a lag: a longer one is not
    /// stable.
    #[must_use]
    pub fn suiting(self, system: &dyn System, p: &[f64]) -> Self {
        let longest = STEPS_PER_TIME * system.shortest_time(p);
        if longest < self.dt { self.with_step(longest) } else { self }
    }

    /// With an initial state.
    #[must_use]
    pub fn from(mut self, x0: &[f64]) -> Self {
        self.initial_state = Some(x0.to_vec());
        self
    }

    /// With sensitivities.
    #[must_use]
    pub fn with_derivatives(mut self) -> Self {
        self.derivatives = true;
        self
    }
}

/// A simulated motion. Matrices are row-major, one row per sample; they end early where the simulation did.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// Time (n), s.
    pub t: Vec<f64>,
    /// States (n, nx).
    pub states: Vec<f64>,
    /// Inputs (n, nu).
    pub inputs: Vec<f64>,
    /// Outputs (n, ny).
    pub outputs: Vec<f64>,
    /// Mode (n).
    pub mode: Vec<usize>,
    /// Events in the order in which they happened.
    pub events: Vec<Event>,
    /// How it ended.
    pub stop: Stop,
    /// What it cost.
    pub stats: Stats,
    /// d(state)/d(initial state, free parameters) at each sample (n, nx, nx + nf); empty where not asked for.
    pub sensitivities: Vec<f64>,
}

/// Simulates: Dormand-Prince 5(4) at fixed step, events located on the dense output and polished, the sample grid kept.
///
/// # Errors
/// [`Error::Shape`] when parameters, inputs or the initial state do not fit the system, [`Error::NotFinite`] for a value
/// that is not a number. A simulation that ends early is `Ok` with its reason in [`Trajectory::stop`].
pub fn simulate(system: &dyn System, parameters: &[f64], inputs: &Inputs, plan: &Plan) -> Result<Trajectory> {
    let shape = |what: &str, expected: usize, found: usize| {
        if expected == found { Ok(()) } else { Err(Error::Shape { what: what.into(), expected, found }) }
    };
    shape("parameters", system.parameters().len(), parameters.len())?;
    shape("inputs", system.inputs(), inputs.count())?;
    let x0 = plan.initial_state.clone().unwrap_or_else(|| system.initial_state());
    shape("initial state", system.states(), x0.len())?;
    // A parameter may be infinite: a limit that is never reached.
    let sound = [("initial state", x0.as_slice(), false), ("parameters", parameters, true)];
    for (what, values, endless) in sound {
        if let Some(row) = values.iter().position(|v| v.is_nan() || (v.is_infinite() && !endless)) {
            return Err(Error::NotFinite { what: what.into(), row, column: what.into(), value: values[row] });
        }
    }
    if let Some(s) = system.ticks(parameters).into_iter().find(|s| !(s.every > 0.0 && s.offset.is_finite())) {
        let expected = "a positive period in s".into();
        return Err(Error::OutOfRange { what: format!("ticks[{}].every", s.name), found: s.every, expected });
    }
    let settings = Settings {
        t0: plan.t0,
        step: plan.dt / plan.substeps as f64,
        max_steps: plan.max_steps,
        derivatives: plan.derivatives,
    };
    let mut out = Trajectory {
        t: Vec::new(),
        states: Vec::new(),
        inputs: Vec::new(),
        outputs: Vec::new(),
        mode: Vec::new(),
        events: Vec::new(),
        stop: Stop::Finished,
        stats: Stats::default(),
        sensitivities: Vec::new(),
    };
    let mode = plan.initial_mode.unwrap_or_else(|| system.initial_mode());
    let inputs = inputs.seen_by(system, parameters);
    let started = Engine::new(system, parameters, &inputs, &x0, mode, settings);
    let plain = Settings { derivatives: false, ..settings };
    let sensor = Sensor::new(system, parameters, &inputs, &x0, mode, plain);
    let (mut engine, mut sensor) = match (started, sensor) {
        (Ok(engine), Ok(sensor)) => (engine, sensor),
        (Err(stop), _) | (_, Err(stop)) => {
            out.stop = stop;
            return Ok(out);
        }
    };
    let mut y = vec![0.0; system.outputs()];
    for k in 0..plan.samples {
        if let Err(stop) = sensor.advance(&mut engine, k as u64 * plan.substeps, &mut y, &mut []) {
            out.stop = stop;
            break;
        }
        out.t.push(plan.t0 + k as f64 * plan.dt);
        out.states.extend_from_slice(engine.state());
        out.inputs.extend_from_slice(&engine.input()[..system.inputs()]);
        out.outputs.extend_from_slice(&y);
        out.mode.push(engine.mode());
        out.sensitivities.extend_from_slice(engine.sensitivities());
    }
    out.stats = engine.stats();
    out.events = engine.events().to_vec();
    Ok(out)
}
