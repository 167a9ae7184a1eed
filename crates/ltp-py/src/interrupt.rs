//! A system that can be stopped from outside: the simulation of any model, made to end when Ctrl-C was heard.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ltp_core::model::{Delay, Guard, Operator, Point, Schedule, Stepper, System};

/// A system as it is, until `flag` is set; then its rates are not numbers, and the simulation ends within one step.
pub struct Interruptible<S> {
    system: Arc<S>,
    flag: Arc<AtomicBool>,
}

impl<S: System> Interruptible<S> {
    /// The system, listening to `flag`.
    pub fn new(system: Arc<S>, flag: Arc<AtomicBool>) -> Self {
        Self { system, flag }
    }
}

impl<S: System> System for Interruptible<S> {
    #[inline]
    fn flow(&self, mode: usize, at: Point<'_>, rates: &mut [f64]) {
        if self.flag.load(Ordering::Relaxed) {
            rates.fill(f64::NAN);
        } else {
            self.system.flow(mode, at, rates);
        }
    }

    fn stepper(&self, mode: usize) -> Option<&Stepper> {
        // withdrawn once the flag is set: the next step asks `flow`
        if self.flag.load(Ordering::Relaxed) { None } else { self.system.stepper(mode) }
    }

    // Everything else is the system's own; methods with a default are passed on as well, or it would hide the system's.
    fn states(&self) -> usize {
        self.system.states()
    }
    fn inputs(&self) -> usize {
        self.system.inputs()
    }
    fn outputs(&self) -> usize {
        self.system.outputs()
    }
    fn delays(&self, p: &[f64]) -> Vec<Delay> {
        self.system.delays(p)
    }
    fn shortest_time(&self, p: &[f64]) -> f64 {
        self.system.shortest_time(p)
    }
    fn operators(&self, p: &[f64]) -> Vec<Operator> {
        self.system.operators(p)
    }
    fn parameters(&self) -> &[f64] {
        self.system.parameters()
    }
    fn free(&self) -> &[usize] {
        self.system.free()
    }
    fn initial_state(&self) -> Vec<f64> {
        self.system.initial_state()
    }
    fn state_name(&self, state: usize) -> String {
        self.system.state_name(state)
    }
    fn initial_mode(&self) -> usize {
        self.system.initial_mode()
    }
    fn mode_name(&self, mode: usize) -> String {
        self.system.mode_name(mode)
    }
    fn flow_jacobian(&self, mode: usize, at: Point<'_>, out: &mut [f64]) {
        self.system.flow_jacobian(mode, at, out);
    }
    fn output(&self, mode: usize, at: Point<'_>, y: &mut [f64]) {
        self.system.output(mode, at, y);
    }
    fn output_jacobian(&self, mode: usize, at: Point<'_>, out: &mut [f64]) {
        self.system.output_jacobian(mode, at, out);
    }
    fn input_jacobian(&self, mode: usize, at: Point<'_>, out: &mut [f64]) {
        self.system.input_jacobian(mode, at, out);
    }
    fn period(&self, p: &[f64]) -> Option<f64> {
        self.system.period(p)
    }
    fn guards(&self, mode: usize) -> &[Guard] {
        self.system.guards(mode)
    }
    fn guard_values(&self, mode: usize, at: Point<'_>, out: &mut [f64]) {
        self.system.guard_values(mode, at, out);
    }
    fn guard_rates(&self, mode: usize, at: Point<'_>, u_rate: &[f64], out: &mut [f64]) {
        self.system.guard_rates(mode, at, u_rate, out);
    }
    fn guard_jacobian(&self, mode: usize, guard: usize, at: Point<'_>, out: &mut [f64]) {
        self.system.guard_jacobian(mode, guard, at, out);
    }
    fn fires(&self, mode: usize, guard: usize, at: Point<'_>) -> bool {
        self.system.fires(mode, guard, at)
    }
    fn reset(&self, mode: usize, guard: usize, at: Point<'_>, after: &mut [f64]) {
        self.system.reset(mode, guard, at, after);
    }
    fn reset_jacobian(&self, mode: usize, guard: usize, at: Point<'_>, out: &mut [f64]) {
        self.system.reset_jacobian(mode, guard, at, out);
    }
    fn target(&self, mode: usize, guard: usize, at: Point<'_>) -> usize {
        self.system.target(mode, guard, at)
    }
    fn settle(&self, mode: usize, at: Point<'_>) -> usize {
        self.system.settle(mode, at)
    }
    fn ticks(&self, p: &[f64]) -> Vec<Schedule> {
        self.system.ticks(p)
    }
    fn tick(&self, mode: usize, tick: usize, at: Point<'_>, after: &mut [f64]) {
        self.system.tick(mode, tick, at, after);
    }
    fn tick_jacobian(&self, mode: usize, tick: usize, at: Point<'_>, out: &mut [f64]) {
        self.system.tick_jacobian(mode, tick, at, out);
    }
}
