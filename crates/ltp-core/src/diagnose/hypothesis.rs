//! One place at which something unknown acts: a force at a port, or a bias of a sensor or an input, as a random walk.
//!
//! An extended Kalman filter with the exact transitions of the hybrid engine gives the likelihood of that single place, a
//! smoother the course of what acts there, beside everything that it may depend on.

use super::experiment::Experiment;
use super::fit::Ground;
use super::kalman::{Filter, Filtered, Noise, Smoothed};
use super::prepare::{Scene, with_unknown};
use super::result::Force;
use crate::error::Result;
use crate::model::{Backend, Compiled, Model, Point, System};
use crate::numeric::stats;

/// Decades of the walk's intensity are walked in steps of this, from the slowest to the fastest.
const STEP: f64 = 0.75;
const SLOWEST: i32 = -5;
const FASTEST: i32 = 2;
/// Share of the longest record over which a walk of middle intensity comes as far as matters.
const STRIDE: f64 = 0.05;

/// What kind of place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A force at a port.
    Port,
    /// A bias that is added to an input.
    Input,
    /// A bias that is added to an output.
    Output,
}

impl Kind {
    /// As in [`super::result::Location::kind`], and in documents of effects.
    pub fn name(self) -> &'static str {
        match self {
            Self::Port => "port",
            Self::Input => "input",
            Self::Output => "output",
        }
    }
}

/// What all hypotheses share.
#[derive(Clone, Copy)]
pub struct Course<'a> {
    /// The model without anything unknown.
    pub model: &'a Model,
    /// Its parameters.
    pub p: &'a [f64],
    /// Recordings.
    pub ground: Ground<'a>,
    /// Sizes and noise.
    pub scene: &'a Scene,
}

/// Something unknown at one place.
pub struct Hypothesis<'a> {
    course: Course<'a>,
    /// What kind of place.
    pub kind: Kind,
    /// Name of the place.
    pub at: String,
    probe: Model,
    system: Compiled,
    /// Size that would matter, in the place's unit.
    reach: f64,
}

/// The best walk of a hypothesis.
pub struct Walk {
    /// Log-likelihood of the recordings.
    pub likelihood: f64,
    /// Filtered along each of them.
    runs: Vec<Filtered>,
}

impl Course<'_> {
    /// Log-likelihood of the recordings with nothing unknown; `None` where the filter cannot follow them.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn without(&self) -> Result<Option<f64>> {
        let system = self.model.compile_for(Vec::new(), Backend::Native);
        let still = vec![0.0; system.states()];
        let runs = self.filtered(&system, &still, &[])?;
        Ok(runs.map(|runs| runs.iter().map(|f| f.log_likelihood).sum()))
    }

    /// Every recording filtered by a system whose states beyond the model's own begin at zero with deviations `beyond`.
    fn filtered(&self, system: &Compiled, noise: &[f64], beyond: &[f64]) -> Result<Option<Vec<Filtered>>> {
        let Ground { experiments, substeps, control, .. } = self.ground;
        let mut out = Vec::new();
        for (r, e) in experiments.iter().enumerate() {
            control.check()?;
            let mut x0 = self.scene.start[r].clone();
            let mut sd: Vec<f64> = self.scene.state_scale.iter().map(|s| 0.3 * s).collect();
            x0.resize(system.states(), 0.0);
            sd.extend(beyond);
            let filter = Filter {
                system,
                p: self.p,
                experiment: e,
                substeps,
                sigma: &self.scene.sigma,
                start: (&x0, &sd),
                noise: Noise::Diagonal(noise),
                control,
            };
            let Ok(f) = filter.forward() else { return Ok(None) };
            out.push(f);
        }
        Ok(Some(out))
    }
}

impl<'a> Hypothesis<'a> {
    /// A force at a port.
    ///
    /// # Errors
    /// [`crate::Error::UnknownName`] for a port that the model does not have.
    pub fn port(course: Course<'a>, at: &str) -> Result<Self> {
        Self::new(course, Kind::Port, at, None)
    }

    /// A bias of an input.
    ///
    /// # Errors
    /// As [`Hypothesis::port`].
    pub fn input(course: Course<'a>, at: &str) -> Result<Self> {
        Self::new(course, Kind::Input, at, None)
    }

    /// A bias of a sensor; `left` is what the refitted model leaves of it.
    ///
    /// # Errors
    /// As [`Hypothesis::port`].
    pub fn output(course: Course<'a>, at: &str, left: f64) -> Result<Self> {
        Self::new(course, Kind::Output, at, Some(left))
    }

    fn new(course: Course<'a>, kind: Kind, at: &str, size: Option<f64>) -> Result<Self> {
        let probe = with_unknown(course.model, kind.name(), &[at])?;
        let system = probe.compile_for(Vec::new(), Backend::Native);
        let reach = size.unwrap_or_else(|| reach(&system, course.p, course.ground.experiments, course.scene));
        Ok(Self { course, kind, at: at.to_string(), probe, system, reach })
    }

    /// The walk that explains the recordings best; `None` where the filter cannot follow them. A walk over decades from the
    /// middle is enough: the likelihood is flat around its top.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn walk(&self) -> Result<Option<Walk>> {
        let seconds: f64 = self.course.ground.experiments.iter().map(|e| e.len() as f64 * e.dt).fold(0.0, f64::max);
        let mut best: Option<Walk> = None;
        // A sensor is off slowly, by what is left; a force or a voltage changes faster and can be small.
        let mut at = if self.kind == Kind::Output { -1 } else { -2 };
        let mut tried = Vec::new();
        loop {
            let mut higher = at;
            for n in [at, at - 1, at + 1] {
                if !(SLOWEST..=FASTEST).contains(&n) || tried.contains(&n) {
                    continue;
                }
                tried.push(n);
                let intensity = self.reach * 10f64.powf(STEP * f64::from(n)) / (STRIDE * seconds).sqrt();
                let mut noise = vec![0.0; self.system.states()];
                if let Some(last) = noise.last_mut() {
                    *last = intensity * intensity;
                }
                let Some(runs) = self.course.filtered(&self.system, &noise, &[self.reach])? else { continue };
                let likelihood = runs.iter().map(|f| f.log_likelihood).sum();
                if best.as_ref().is_none_or(|b| likelihood > b.likelihood) {
                    best = Some(Walk { likelihood, runs });
                    higher = n;
                }
            }
            if higher == at {
                return Ok(best);
            }
            at = higher;
        }
    }

    /// The smoothed course of what is unknown along each recording, with units.
    ///
    /// # Errors
    /// None that a model which exists could cause.
    pub fn smoothed(&self, walk: &Walk) -> Result<Vec<Force>> {
        let sensed = self.probe.compile_for(self.course.model.uncertain(), Backend::Native);
        let model = self.course.model;
        let [unit, position, velocity] = match self.kind {
            Kind::Port => model.port_units(&self.at)?,
            Kind::Input | Kind::Output => {
                let unit = model.unit(&self.at)?.to_string();
                let rate = if unit == "1" { "1/s".to_string() } else { format!("{unit}/s") };
                [unit.clone(), unit, rate]
            }
        };
        let one = |(e, f): (&Experiment, &Filtered)| {
            let mut force = self.force(&sensed, e, &f.smooth())?;
            force.unit.clone_from(&unit);
            force.position_unit.clone_from(&position);
            force.velocity_unit.clone_from(&velocity);
            Ok(force)
        };
        self.course.ground.experiments.iter().zip(&walk.runs).map(one).collect()
    }

    /// What is unknown, with what it may depend on and what nominal parameters could imitate.
    fn force(&self, system: &dyn System, e: &Experiment, s: &Smoothed) -> Result<Force> {
        let (nx, ny, p) = (system.states(), system.outputs(), self.course.p);
        let document = self.course.model.document();
        let motion = if self.kind == Kind::Port { Some(self.probe.port_motion(&self.at)?) } else { None };
        let (own_input, own_output) = (document.inputs.get_index_of(&self.at), document.outputs.get_index_of(&self.at));
        let inputs = e.inputs.seen_by(system, p);
        let mut u = vec![0.0; inputs.channels()];
        let mut out = Force {
            kind: self.kind.name().into(),
            record: e.name.clone(),
            at: self.at.clone(),
            input_names: document.inputs.keys().cloned().collect(),
            inputs: vec![Vec::new(); document.inputs.len()],
            ..Force::default()
        };
        let mut pv = [0.0; 2];
        let nf = system.free().len();
        let mut flow = vec![0.0; nx + nx * nx + nx * nf];
        let mut seen = vec![0.0; ny + ny * nx + ny * nf];
        out.imitable = vec![Vec::new(); nf];
        out.period = system.period(p);
        let mut x = vec![0.0; nx];
        for k in 0..e.len() {
            let t = e.t0 + k as f64 * e.dt;
            inputs.eval(inputs.interval(t + 1e-6 * e.dt), t, &mut u);
            out.t.push(t);
            out.force.push(s.x[(k + 1) * nx - 1]);
            out.sd.push(s.sd[(k + 1) * nx - 1]);
            out.inputs.iter_mut().zip(&u).for_each(|(series, u)| series.push(*u));
            // A mode of the document, whether or not its friction sticks.
            let name = system.mode_name(s.mode[k]);
            let name = name.split(", ").next().unwrap_or_default();
            let known = out.modes.iter().position(|m| m == name);
            out.mode.push(known.unwrap_or(out.modes.len()));
            if known.is_none() {
                out.modes.push(name.to_owned());
            }
            out.phase.extend(out.period.map(|period| (t / period).rem_euclid(1.0)));
            // A parameter's change moves the rates; what of that lies along the place's action is the same there. What is
            // unknown itself stays out: with it, the common scale of all forces would be a parameter that explains anything.
            x.copy_from_slice(&s.x[k * nx..(k + 1) * nx]);
            x[nx - 1] = 0.0;
            let at = Point { t, x: &x, u: &u, p };
            if let (Kind::Output, Some(j)) = (self.kind, own_output) {
                system.output_jacobian(s.mode[k], at, &mut seen);
                out.position.push(seen[j]);
                let slopes = &seen[ny + ny * nx + j * nf..ny + ny * nx + (j + 1) * nf];
                out.imitable.iter_mut().zip(slopes).for_each(|(column, slope)| column.push(*slope));
                continue;
            }
            if let Some(motion) = &motion {
                motion.eval(Point { x: &s.x[k * nx..(k + 1) * nx], ..at }, &mut pv);
                out.position.push(pv[0]);
                out.velocity.push(pv[1]);
            } else if let Some(i) = own_input {
                out.position.push(u[i]);
            }
            system.flow_jacobian(s.mode[k], at, &mut flow);
            let action = |i: usize| flow[nx + i * nx + nx - 1];
            let own: f64 = (0..nx).map(|i| action(i).powi(2)).sum();
            for (c, column) in out.imitable.iter_mut().enumerate() {
                let along: f64 = (0..nx).map(|i| action(i) * flow[nx + nx * nx + i * nf + c]).sum();
                column.push(if own > 0.0 { along / own } else { 0.0 });
            }
        }
        if motion.is_none() {
            out.velocity = rate(&out.position, e.dt);
        }
        Ok(out)
    }
}

/// Rate of a sampled series: central differences, one-sided at its ends.
pub fn rate(x: &[f64], dt: f64) -> Vec<f64> {
    let last = x.len().saturating_sub(1);
    let at = |k: usize| {
        let (before, after) = (k.saturating_sub(1), (k + 1).min(last));
        if after > before { (x[after] - x[before]) / ((after - before) as f64 * dt) } else { 0.0 }
    };
    (0..x.len()).map(at).collect()
}

/// Sizes that a sensor's bias may have: what the refitted model leaves of each output, and no less than its noise. `NaN` for
/// one that was never measured.
pub fn left(train: &[Experiment], residuals: &[Vec<f64>], sigma: &[f64]) -> Vec<f64> {
    let ny = sigma.len();
    let of = |j: usize| {
        let measured = train.iter().any(|e| e.output(j).any(f64::is_finite));
        let rms =
            stats::rms(residuals.iter().flat_map(|r| r.iter().skip(j).step_by(ny).copied()).filter(|v| v.is_finite()));
        if measured { sigma[j] * if rms.is_finite() { rms.max(1.0) } else { 1.0 } } else { f64::NAN }
    };
    (0..ny).map(of).collect()
}

/// Size of what the last state stands for that would matter: what moves a state by its size at the motion's speed.
fn reach(system: &dyn System, p: &[f64], train: &[Experiment], scene: &Scene) -> f64 {
    let nx = system.states();
    let mut x = scene.start[0].clone();
    x.resize(nx, 0.0);
    let inputs = train[0].inputs.seen_by(system, p);
    let mut u = vec![0.0; inputs.channels()];
    inputs.eval(0, train[0].t0, &mut u);
    let mut flow = vec![0.0; nx + nx * nx];
    let at = Point { t: train[0].t0, x: &x, u: &u, p };
    let mode = system.settle(system.initial_mode(), at);
    system.flow_jacobian(mode, at, &mut flow);
    let of = |i: usize| {
        let b = flow[nx + i * nx + nx - 1].abs();
        if b > 0.0 { scene.state_scale[i] * scene.speed / b } else { f64::INFINITY }
    };
    let r = (0..nx - 1).map(of).fold(f64::INFINITY, f64::min);
    if r.is_finite() { r } else { 1.0 }
}
