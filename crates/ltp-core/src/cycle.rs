//! Level 4: periodic orbits, through events. The noun is [`LimitCycle`].
//!
//! [`cycle`] closes the orbit a start leads to, or lies near; [`survey()`] asks from how far it attracts, and what else there is.

mod shoot;
mod survey;

use crate::error::{Error, Result};
use crate::model::System;
use crate::model::system::without_past;
use crate::numeric::{Complex, eigen};
use crate::simulate::{Event, Inputs, Plan, Trajectory, simulate};
use shoot::{Arrival, Flow, Found, Lost, Orbit};
pub use survey::{Survey, survey};

/// Samples of the orbit in one period.
const SAMPLES: usize = 500;
/// Iterations of Newton's method.
const ITERATIONS: usize = 40;
/// Closure relative to the size of the orbit at which an orbit counts as found.
const TOLERANCE: f64 = 1e-9;
/// Periods at most that a motion is given to settle.
const PATIENCE: usize = 200;
/// A start that comes back this near to itself after one period is taken as a guess of the orbit itself.
const GUESS: f64 = 0.05;
/// Arcs tried by multiple shooting.
const ARCS: [usize; 3] = [4, 8, 16];

/// How to look for a periodic orbit.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// State from which the orbit is sought; the model's initial state where `None`.
    pub start: Option<Vec<f64>>,
    /// Mode of the start; the model's where `None`.
    pub mode: Option<usize>,
    /// Period, s: the clock's where `None`. For a model without explicit time, a first guess.
    pub period: Option<f64>,
    /// Constant values of the inputs; zero where empty.
    pub inputs: Vec<f64>,
    /// Periods simulated before Newton's method; `None`: none when the start nearly comes back to itself, else 200.
    pub settle: Option<usize>,
    /// Integration steps in one period.
    pub steps: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self { start: None, mode: None, period: None, inputs: Vec::new(), settle: None, steps: 2000 }
    }
}

/// An event of a periodic orbit.
#[derive(Clone, Debug, PartialEq)]
pub struct CycleEvent {
    /// Name of the transition.
    pub name: String,
    /// Time after the start of the period, s.
    pub time: f64,
    /// Time over period, in [0, 1).
    pub phase: f64,
    /// Mode before.
    pub mode_before: usize,
    /// Mode after.
    pub mode_after: usize,
}

/// A periodic orbit.
#[derive(Clone, Debug)]
pub struct LimitCycle {
    /// Period, s.
    pub period: f64,
    /// Whether the period was found (no clock) rather than given.
    pub autonomous: bool,
    /// State at time zero, the clock's.
    pub start: Vec<f64>,
    /// Mode at time zero.
    pub mode: usize,
    /// Constant inputs.
    pub inputs: Vec<f64>,
    /// One period, sampled evenly.
    pub trajectory: Trajectory,
    /// Events in order.
    pub events: Vec<CycleEvent>,
    /// Monodromy matrix (nx, nx) at the start, saltation included.
    pub monodromy: Vec<f64>,
    /// Floquet multipliers, largest magnitude first.
    pub multipliers: Vec<Complex>,
    /// States that no mode of the orbit moves, each with a multiplier of one that says nothing.
    pub held: Vec<usize>,
    /// Whether all other multipliers (but the one of the phase, without a clock) lie inside the unit circle.
    pub stable: bool,
    /// State from which it was found.
    pub found_from: Vec<f64>,
    /// Periods simulated before Newton's method.
    pub settled: usize,
    /// Newton iterations.
    pub iterations: usize,
    /// Largest gap of the closed orbit relative to the size of each state.
    pub residual: f64,
    /// Change of the state at time zero when the integration step is halved, relative to the size of each state.
    pub integration_error: f64,
    /// Doubts, with numbers and advice.
    pub warnings: Vec<String>,
}

/// Finds the periodic orbit that `options.start` leads to or lies near.
///
/// # Errors
/// `Shape`, `OutOfRange` for options that cannot be; `NoConvergence` when no periodic orbit is found, with the reason.
pub fn cycle(system: &dyn System, p: &[f64], options: &Options) -> Result<LimitCycle> {
    let (inputs, start, mode) = checked(system, p, options)?;
    let flow = Flow { system, p, inputs: &inputs, steps: options.steps };
    let clock = options.period.or_else(|| system.period(p));
    let autonomous = is_autonomous(&flow, &start, mode, clock.unwrap_or(1.0));
    if let Some(found) = clock.filter(|t| !(*t > 0.0 && t.is_finite())) {
        return Err(Error::OutOfRange { what: "period".into(), found, expected: "a positive time in s".into() });
    }
    let (mut guess, mut settled) = if autonomous {
        survey::first_return(&flow, &start, mode, clock, options.settle)?
    } else {
        let Some(period) = clock else {
            return Err(Error::Model {
                path: "cycle".into(),
                message: "the model depends on time but has no [clock]; give the period of its forcing".into(),
            });
        };
        settled_guess(&flow, period, &start, mode, options.settle)
    };
    let mut scale = sizes(&flow, &guess);
    let mut found = closed(&flow, &guess, &scale);
    if let (Err(_), false, 0, None) = (&found, autonomous, settled, options.settle) {
        // It seemed near enough to begin at once, and a step fell beside it: a foot is not quite on the ground.
        (guess, settled) = settled_guess(&flow, guess.period, &start, mode, Some(PATIENCE));
        scale = sizes(&flow, &guess);
        found = closed(&flow, &guess, &scale);
    }
    let found = found.map_err(|lost| not_found(&lost, settled))?;
    describe(&flow, found, &scale, start, settled)
}

/// The orbit that closes near a guess, by single or else by multiple shooting; the reason of the former where neither does.
fn closed(flow: &Flow<'_>, guess: &Orbit, scale: &[f64]) -> std::result::Result<Found, Lost> {
    shoot::newton(flow, guess.clone(), scale, ITERATIONS, TOLERANCE)
        .or_else(|single| multiple(flow, guess, scale).map_err(|_| single))
}

fn checked(system: &dyn System, p: &[f64], options: &Options) -> Result<(Inputs, Vec<f64>, usize)> {
    let shape = |what: &str, expected: usize, found: usize| {
        if expected == found { Ok(()) } else { Err(Error::Shape { what: what.into(), expected, found }) }
    };
    shape("parameters", system.parameters().len(), p.len())?;
    without_past(system, p, "cycle")?;
    let inputs = if options.inputs.is_empty() { vec![0.0; system.inputs()] } else { options.inputs.clone() };
    shape("constant inputs", system.inputs(), inputs.len())?;
    let start = options.start.clone().unwrap_or_else(|| system.initial_state());
    shape("start", system.states(), start.len())?;
    for (what, values) in [("start", &start), ("constant inputs", &inputs)] {
        if let Some(row) = values.iter().position(|v| !v.is_finite()) {
            return Err(Error::NotFinite { what: what.into(), row, column: what.into(), value: values[row] });
        }
    }
    if options.steps < 10 {
        let expected = "at least 10 integration steps in a period; 2000 is the default".into();
        return Err(Error::OutOfRange { what: "steps".into(), found: options.steps as f64, expected });
    }
    Ok((Inputs::constant(&inputs), start, options.mode.unwrap_or_else(|| system.initial_mode())))
}

/// Whether nothing at the start depends on time: asked at times that no period relates.
fn is_autonomous(flow: &Flow<'_>, x: &[f64], mode: usize, period: f64) -> bool {
    let now = flow.rates(0.0, x, mode);
    let times = [0.137, 0.291, 0.618, 1.771].map(|s| s * period);
    flow.system.period(flow.p).is_none() && times.iter().all(|&t| flow.rates(t, x, mode) == now)
}

/// The guess for a known period, and the periods simulated to get there.
fn settled_guess(flow: &Flow<'_>, period: f64, x: &[f64], mode: usize, settle: Option<usize>) -> (Orbit, usize) {
    let guess = |x: &[f64], mode| Orbit { t0: 0.0, period, free: false, starts: vec![x.to_vec()], modes: vec![mode] };
    let near = |x: &[f64], mode: usize, closure: f64| {
        flow.go(0.0, period, 1.0, x, mode, false).is_ok_and(|end| {
            let (mut gap, mut size) = (0.0_f64, 0.0_f64);
            for (a, b) in end.x.iter().zip(x) {
                gap = gap.max((a - b).abs());
                size = size.max(a.abs().max(b.abs()));
            }
            end.mode == mode && gap <= closure * size
        })
    };
    let most = settle.unwrap_or_else(|| if near(x, mode, GUESS) { 0 } else { PATIENCE });
    let (mut at, mut in_mode) = (x.to_vec(), mode);
    for done in 0..most {
        match flow.go(0.0, period, 1.0, &at, in_mode, false) {
            Ok(Arrival { x, mode, .. }) => (at, in_mode) = (x, mode),
            // A motion that ends cannot settle; what lies at its start may still be an orbit.
            Err(_) => return (guess(x, mode), 0),
        }
        if settle.is_none() && done % 20 == 19 && near(&at, in_mode, 1e-6) {
            return (guess(&at, in_mode), done + 1);
        }
    }
    (guess(&at, in_mode), most)
}

/// Sizes of the states along the guess, none of them zero.
fn sizes(flow: &Flow<'_>, guess: &Orbit) -> Vec<f64> {
    let mut sizes: Vec<f64> = guess.starts[0].iter().map(|v| v.abs()).collect();
    let (mut x, mut mode) = (guess.starts[0].clone(), guess.modes[0]);
    let arc = guess.period / 16.0;
    for j in 0..16 {
        let Ok(end) = flow.go(guess.t0 + j as f64 * arc, arc, 1.0 / 16.0, &x, mode, false) else { break };
        (x, mode) = (end.x, end.mode);
        for (s, v) in sizes.iter_mut().zip(&x) {
            *s = s.max(v.abs());
        }
    }
    let largest = sizes.iter().copied().fold(0.0, f64::max);
    let least = if largest > 0.0 { 1e-6 * largest } else { 1.0 };
    sizes.into_iter().map(|s| s.max(least)).collect()
}

/// Multiple shooting: first from arcs of the guess's own motion, whose gap is spread over all of them; where that motion runs
/// away, from arcs that all stand still at the guess.
fn multiple(flow: &Flow<'_>, guess: &Orbit, scale: &[f64]) -> std::result::Result<Found, Lost> {
    let mut last = Lost { iterations: 0, residual: f64::INFINITY, why: "no arcs".into() };
    for arcs in ARCS {
        let still =
            Orbit { starts: vec![guess.starts[0].clone(); arcs], modes: vec![guess.modes[0]; arcs], ..guess.clone() };
        for start in moving(flow, guess, arcs).into_iter().chain([still]) {
            match shoot::newton(flow, start, scale, ITERATIONS, TOLERANCE) {
                Ok(found) => return Ok(found),
                Err(lost) => last = lost,
            }
        }
    }
    Err(last)
}

/// Arcs along the motion from the guess; `None` where it ends within the period.
fn moving(flow: &Flow<'_>, guess: &Orbit, arcs: usize) -> Option<Orbit> {
    let span = guess.period / arcs as f64;
    let (mut starts, mut modes) = (vec![guess.starts[0].clone()], vec![guess.modes[0]]);
    for j in 0..arcs {
        let t = guess.t0 + j as f64 * span;
        let end = flow.go(t, span, 1.0 / arcs as f64, &starts[j], modes[j], false).ok()?;
        starts.push(end.x);
        modes.push(end.mode);
    }
    let end = starts.pop()?;
    modes.pop();
    let gap: Vec<f64> = end.iter().zip(&guess.starts[0]).map(|(a, b)| b - a).collect();
    for (j, start) in starts.iter_mut().enumerate() {
        start.iter_mut().zip(&gap).for_each(|(x, g)| *x += g * j as f64 / arcs as f64);
    }
    Some(Orbit { starts, modes, ..guess.clone() })
}

fn not_found(lost: &Lost, settled: usize) -> Error {
    let advice = format!(
        "{}; {settled} periods were simulated first and multiple shooting failed as well. Start nearer to the orbit, let the \
         motion settle longer, or give twice the period if the motion repeats only then",
        lost.why
    );
    Error::NoConvergence { method: "shooting".into(), iterations: lost.iterations, residual: lost.residual, advice }
}

fn describe(flow: &Flow<'_>, found: Found, scale: &[f64], from: Vec<f64>, settled: usize) -> Result<LimitCycle> {
    let Found { orbit, iterations, residual } = found;
    let (x, mode, period) = (&orbit.starts[0], orbit.modes[0], orbit.period);
    let ended = |stop: crate::simulate::Stop| Error::NoConvergence {
        method: "shooting".into(),
        iterations,
        residual,
        advice: format!("the orbit found cannot be simulated: {}", stop.sentence()),
    };
    let once = flow.go(orbit.t0, period, 1.0, x, mode, true).map_err(ended)?;
    let multipliers = eigen::eigenvalues(&once.slope, x.len())?;
    let fine = Flow { steps: 2 * flow.steps, ..*flow };
    let single = Orbit { starts: vec![x.clone()], modes: vec![mode], ..orbit.clone() };
    let mut warnings = Vec::new();
    let integration_error = match shoot::newton(&fine, single, scale, ITERATIONS, TOLERANCE) {
        Ok(f) => f.orbit.starts[0].iter().zip(x).zip(scale).map(|((a, b), s)| (a - b).abs() / s).fold(0.0, f64::max),
        Err(lost) => {
            warnings.push(format!(
                "with half the integration step the orbit is not found again ({}); take more steps",
                lost.why
            ));
            f64::NAN
        }
    };
    if integration_error > 1e-7 {
        warnings.push(format!(
            "halving the integration step moves the orbit by {integration_error:.1e} of its size; ask for more than {} steps \
             in a period",
            flow.steps
        ));
    }
    let phase = |time: f64| ((time - orbit.t0) / period).rem_euclid(1.0);
    let events = once.events.iter().map(|e: &Event| CycleEvent {
        name: e.name.clone(),
        time: e.time - orbit.t0,
        phase: phase(e.time),
        mode_before: e.mode_before,
        mode_after: e.mode_after,
    });
    let nx = x.len();
    let unit = |i: usize| (0..nx).all(|c| once.slope[i * nx + c] == f64::from(u8::from(i == c)));
    let held: Vec<usize> = (0..nx).filter(|&i| unit(i)).collect();
    // Without a clock one more multiplier is one: it moves the orbit along itself.
    let mut neutral = held.len() + usize::from(orbit.free);
    let mut away: Vec<&Complex> = multipliers.iter().collect();
    away.sort_by(|a, b| (*a - 1.0).norm().total_cmp(&(*b - 1.0).norm()));
    neutral = neutral.min(away.len());
    let stable = away[neutral..].iter().all(|m| m.norm() < 1.0);
    let mut plan = Plan::new(period, period / SAMPLES as f64)?.with_step(period / flow.steps as f64).from(x);
    (plan.initial_mode, plan.samples, plan.t0) = (Some(mode), SAMPLES + 1, orbit.t0);
    let mut inputs = vec![0.0; flow.inputs.count()];
    flow.inputs.eval(0, 0.0, &mut inputs);
    Ok(LimitCycle {
        period,
        autonomous: orbit.free,
        start: x.clone(),
        mode,
        trajectory: simulate(flow.system, flow.p, flow.inputs, &plan)?,
        inputs,
        events: events.collect(),
        monodromy: once.slope,
        multipliers,
        held,
        stable,
        found_from: from,
        settled,
        iterations,
        residual,
        integration_error,
        warnings,
    })
}
