//! The trait that simulation works on. Compiled models implement it, and a Rust user may implement it instead.
//!
//! Matrices are row-major in one slice, value first, so that native code writes them in place:
//!
//! | method | length | content |
//! |---|---|---|
//! | `flow_jacobian` | `nx + nx*nx + nx*nf` | rates, d/dx, d/dp |
//! | `output_jacobian` | `ny + ny*nx + ny*nf` | outputs, d/dx, d/dp |
//! | `guard_jacobian` | `1 + nx + nf + 1 + nu` | guard, d/dx, d/dp, d/dt, d/du |
//! | `input_jacobian` | `nx*nu + ny*nu` | d(rates)/du, d(outputs)/du |
//! | `reset_jacobian` | `nx + nx*nx + nx*nf + nx + nx*nu` | state after, d/dx, d/dp, d/dt, d/du |
//!
//! `nf` counts the *free* parameters, those that derivatives are taken for; `p` always holds all of them.

use super::delay::OperatorKind;
use super::stepper::Stepper;

use crate::error::{Error, Result};

pub use super::document::Direction;
pub use super::tape::Point;

/// A function whose crossing of zero is an event.
#[derive(Clone, Debug, PartialEq)]
pub struct Guard {
    /// Name of the event.
    pub name: String,
    /// Which crossing fires.
    pub direction: Direction,
    /// Dry friction passes from slip to stick and back: never a grazing or Zeno event.
    pub friction: bool,
}

/// A sampled update with its schedule.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// Name.
    pub name: String,
    /// Period, s.
    pub every: f64,
    /// First instant, s.
    pub offset: f64,
}

/// What an input did before its first sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Past {
    /// It was zero.
    Zero,
    /// It had its first value.
    Hold,
    /// It repeated with this period, s.
    Periodic(f64),
}

/// An input that a system sees late as well.
#[derive(Clone, Debug, PartialEq)]
pub struct Delay {
    /// Input.
    pub input: usize,
    /// Delay, s.
    pub delay: f64,
    /// Its derivatives by the free parameters (nf).
    pub slope: Vec<f64>,
    /// What the input did before its first sample.
    pub past: Past,
}

/// Something done to an output after it was computed, along the steps of a simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct Operator {
    /// Output.
    pub output: usize,
    /// What it does.
    pub kind: OperatorKind,
    /// Delay, s, or gap in the unit of the output.
    pub value: f64,
    /// Its derivatives by the free parameters (nf).
    pub slope: Vec<f64>,
}

/// A hybrid dynamical system with exact derivatives.
pub trait System: Send + Sync {
    /// Number of states.
    fn states(&self) -> usize;
    /// Number of inputs.
    fn inputs(&self) -> usize;
    /// Number of outputs.
    fn outputs(&self) -> usize;
    /// Inputs that the system sees late, under given parameters: each adds two channels behind the inputs, its value and its
    /// rate, in [`Point::u`] and in derivatives by the inputs of guards, resets and ticks.
    fn delays(&self, _p: &[f64]) -> Vec<Delay> {
        Vec::new()
    }
    /// Shortest time constant of the states that effects brought along, such as a lag: a step much longer than it is not stable.
    fn shortest_time(&self, _p: &[f64]) -> f64 {
        f64::INFINITY
    }
    /// What is done to the outputs after they were computed, in this order, under given parameters.
    fn operators(&self, _p: &[f64]) -> Vec<Operator> {
        Vec::new()
    }
    /// Nominal values of all parameters.
    fn parameters(&self) -> &[f64];
    /// Indices of the parameters that derivatives are taken for.
    fn free(&self) -> &[usize];
    /// Initial state.
    fn initial_state(&self) -> Vec<f64>;
    /// Name of a state, for messages.
    fn state_name(&self, state: usize) -> String {
        format!("number {state}")
    }
    /// Starting mode, before [`System::settle`].
    fn initial_mode(&self) -> usize {
        0
    }
    /// Name of a mode.
    fn mode_name(&self, mode: usize) -> String {
        format!("mode {mode}")
    }
    /// Rates of the states.
    fn flow(&self, mode: usize, at: Point<'_>, rates: &mut [f64]);
    /// Rates with derivatives; central differences where not written out.
    fn flow_jacobian(&self, mode: usize, at: Point<'_>, out: &mut [f64]) {
        difference(self.states(), at, self.free(), out, &mut |at, v| self.flow(mode, at, v));
    }
    /// Measured quantities.
    fn output(&self, mode: usize, at: Point<'_>, y: &mut [f64]);
    /// Measured quantities with derivatives; central differences where not written out.
    fn output_jacobian(&self, mode: usize, at: Point<'_>, out: &mut [f64]) {
        difference(self.outputs(), at, self.free(), out, &mut |at, v| self.output(mode, at, v));
    }
    /// Derivatives of rates and outputs by the inputs; central differences where not written out.
    fn input_jacobian(&self, mode: usize, at: Point<'_>, out: &mut [f64]) {
        let (nx, ny, nu) = (self.states(), self.outputs(), self.inputs());
        let (mut high, mut low) = (vec![0.0; nx + ny], vec![0.0; nx + ny]);
        let mut u = at.u.to_vec();
        for j in 0..nu {
            let h = f64::EPSILON.cbrt() * at.u[j].abs().max(1.0);
            for (shift, out) in [(h, &mut high), (-h, &mut low)] {
                u[j] = at.u[j] + shift;
                let (rates, outputs) = out.split_at_mut(nx);
                self.flow(mode, Point { u: &u, ..at }, rates);
                self.output(mode, Point { u: &u, ..at }, outputs);
            }
            u[j] = at.u[j];
            for i in 0..nx + ny {
                out[i * nu + j] = (high[i] - low[i]) / (2.0 * h);
            }
        }
    }
    /// Guards watched in a mode, in the order in which simultaneous ones fire.
    fn guards(&self, _mode: usize) -> &[Guard] {
        &[]
    }
    /// Values of the guards of a mode.
    fn guard_values(&self, _mode: usize, _at: Point<'_>, _out: &mut [f64]) {}
    /// Rates of the guards of a mode along its flow, `u_rate` being the rates of the inputs; a central difference where
    /// not written out.
    fn guard_rates(&self, mode: usize, at: Point<'_>, u_rate: &[f64], out: &mut [f64]) {
        let mut flow = vec![0.0; at.x.len()];
        self.flow(mode, at, &mut flow);
        let mut low = vec![0.0; out.len()];
        let fastest = flow.iter().zip(at.x).map(|(f, x)| f.abs() / x.abs().max(1e-3)).fold(1.0, f64::max);
        let h = f64::EPSILON.cbrt() / fastest;
        let shifted = |s: f64, out: &mut [f64]| {
            let moved = |v: &[f64], r: &[f64]| -> Vec<f64> { v.iter().zip(r).map(|(v, r)| v + s * r).collect() };
            let (x, u) = (moved(at.x, &flow), moved(at.u, u_rate));
            self.guard_values(mode, Point { t: at.t + s, x: &x, u: &u, p: at.p }, out);
        };
        shifted(h, out);
        shifted(-h, &mut low);
        for (o, l) in out.iter_mut().zip(low) {
            *o = (*o - l) / (2.0 * h);
        }
    }
    /// One guard with its derivatives; central differences where not written out.
    fn guard_jacobian(&self, mode: usize, guard: usize, at: Point<'_>, out: &mut [f64]) {
        let mut all = vec![0.0; self.guards(mode).len()];
        full_difference(1, at, self.free(), out, &mut |at, v| {
            self.guard_values(mode, at, &mut all);
            v[0] = all[guard];
        });
    }
    /// A whole step of the integrator as one program, where the system has one; `None` leaves it to [`System::flow`].
    fn stepper(&self, _mode: usize) -> Option<&Stepper> {
        None
    }
    /// Whether an event fires at a crossing: its additional condition.
    fn fires(&self, _mode: usize, _guard: usize, _at: Point<'_>) -> bool {
        true
    }
    /// State after an event, from the state before.
    fn reset(&self, _mode: usize, _guard: usize, at: Point<'_>, after: &mut [f64]) {
        after.copy_from_slice(at.x);
    }
    /// State after an event with its derivatives; central differences where not written out.
    fn reset_jacobian(&self, mode: usize, guard: usize, at: Point<'_>, out: &mut [f64]) {
        full_difference(at.x.len(), at, self.free(), out, &mut |at, v| self.reset(mode, guard, at, v));
    }
    /// Mode after an event; `at` holds the state after it.
    fn target(&self, mode: usize, _guard: usize, _at: Point<'_>) -> usize {
        mode
    }
    /// The mode that fits a state set from outside: slip or stick of dry friction.
    fn settle(&self, mode: usize, _at: Point<'_>) -> usize {
        mode
    }
    /// Period of the clock under given parameters, s; `None` without a clock.
    fn period(&self, _p: &[f64]) -> Option<f64> {
        None
    }
    /// Sampled updates with their schedules under given parameters.
    fn ticks(&self, _p: &[f64]) -> Vec<Schedule> {
        Vec::new()
    }
    /// State after a sampled update.
    fn tick(&self, _mode: usize, _tick: usize, at: Point<'_>, after: &mut [f64]) {
        after.copy_from_slice(at.x);
    }
    /// State after a sampled update with its derivatives, laid out as for `reset_jacobian`; central differences where not
    /// written out.
    fn tick_jacobian(&self, mode: usize, tick: usize, at: Point<'_>, out: &mut [f64]) {
        full_difference(at.x.len(), at, self.free(), out, &mut |at, v| self.tick(mode, tick, at, v));
    }
}

/// Refuses a system that needs its past, for a method that knows only its present.
///
/// # Errors
/// [`Error::Model`] naming what it has and what to do.
pub fn without_past(system: &dyn System, p: &[f64], method: &str) -> Result<()> {
    let what = match (system.delays(p).is_empty(), system.operators(p).is_empty()) {
        (true, true) => return Ok(()),
        (false, _) => "a delayed input",
        (true, false) => "a delay or play at an output",
    };
    Err(Error::Model {
        path: method.into(),
        message: format!(
            "the model has {what}, so that its state does not determine how it goes on; leave that effect out, or attach a \
             lag instead, which has a state of its own"
        ),
    })
}

/// Central differences in the layout of [`System::reset_jacobian`]: as [`difference`], then d/dt and d/du.
fn full_difference(
    rows: usize,
    at: Point<'_>,
    free: &[usize],
    out: &mut [f64],
    f: &mut dyn FnMut(Point<'_>, &mut [f64]),
) {
    let nu = at.u.len();
    let (first, last) = out.split_at_mut(rows * (1 + at.x.len() + free.len()));
    difference(rows, at, free, first, f);
    let (by_time, by_input) = last.split_at_mut(rows);
    let (mut high, mut low) = (vec![0.0; rows], vec![0.0; rows]);
    let h = f64::EPSILON.cbrt() * at.t.abs().max(1e-3);
    f(Point { t: at.t + h, ..at }, &mut high);
    f(Point { t: at.t - h, ..at }, &mut low);
    for i in 0..rows {
        by_time[i] = (high[i] - low[i]) / (2.0 * h);
    }
    let mut u = at.u.to_vec();
    for j in 0..nu {
        let h = f64::EPSILON.cbrt() * at.u[j].abs().max(1e-3);
        u[j] = at.u[j] + h;
        f(Point { u: &u, ..at }, &mut high);
        u[j] = at.u[j] - h;
        f(Point { u: &u, ..at }, &mut low);
        u[j] = at.u[j];
        for i in 0..rows {
            by_input[i * nu + j] = (high[i] - low[i]) / (2.0 * h);
        }
    }
}

/// Central differences in the layout of [`System::flow_jacobian`]: `rows` values, d/dx, d/dp of the free parameters.
fn difference(rows: usize, at: Point<'_>, free: &[usize], out: &mut [f64], f: &mut dyn FnMut(Point<'_>, &mut [f64])) {
    let (nx, nf) = (at.x.len(), free.len());
    f(at, &mut out[..rows]);
    let (mut high, mut low) = (vec![0.0; rows], vec![0.0; rows]);
    let (mut x, mut p) = (at.x.to_vec(), at.p.to_vec());
    let step = |v: f64| f64::EPSILON.cbrt() * v.abs().max(1e-3);
    for j in 0..nx {
        let h = step(at.x[j]);
        x[j] = at.x[j] + h;
        f(Point { x: &x, ..at }, &mut high);
        x[j] = at.x[j] - h;
        f(Point { x: &x, ..at }, &mut low);
        x[j] = at.x[j];
        for i in 0..rows {
            out[rows + i * nx + j] = (high[i] - low[i]) / (2.0 * h);
        }
    }
    for (j, &k) in free.iter().enumerate() {
        let h = step(at.p[k]);
        p[k] = at.p[k] + h;
        f(Point { p: &p, ..at }, &mut high);
        p[k] = at.p[k] - h;
        f(Point { p: &p, ..at }, &mut low);
        p[k] = at.p[k];
        for i in 0..rows {
            out[rows + rows * nx + i * nf + j] = (high[i] - low[i]) / (2.0 * h);
        }
    }
}
