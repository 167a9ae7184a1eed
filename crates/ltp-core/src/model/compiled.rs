//! A model ready to run: one set of programs per combined mode, compiled when the mode is first entered.

use std::sync::OnceLock;

use super::assemble::Assembly;
use super::delay::{DelayEquation, PastEquation};
use super::document::Direction;
use super::friction::{Contact, Forces, Product, forces};
use super::graph::{Graph, Id, Symbol};
use super::program::{Backend, Program};
use super::slopes::{all_slopes, along_flow, past_programs, slopes};
use super::stepper::Stepper;
use super::system::{Delay, Guard, Operator, Past, Point, Schedule, System};

/// Speed below which a dry element counts as at rest when a state is set from outside, in units of its port.
const REST: f64 = 1e-13;

/// A compiled model.
pub struct Compiled {
    assembly: Assembly,
    product: Product,
    values: Vec<f64>,
    free: Vec<usize>,
    /// Inputs, and with the channels of late ones behind them.
    inputs: usize,
    channels: usize,
    /// Delays of late inputs with their derivatives, then periods of their pasts (zero where there are none).
    late: Program,
    operators: Program,
    backend: Backend,
    modes: Vec<OnceLock<ModeValues>>,
    jacobians: Vec<OnceLock<ModeJacobians>>,
    input_jacobians: Vec<OnceLock<Program>>,
    event_jacobians: Vec<OnceLock<EventJacobians>>,
    steppers: Vec<OnceLock<Option<Stepper>>>,
    ticks: Vec<Vec<Program>>,
    tick_jacobians: Vec<Vec<Program>>,
    schedule: Program,
}

/// Programs that give values in one mode.
struct ModeValues {
    flow: Program,
    output: Program,
    guard: Program,
    /// Rates of the guards along the flow; the inputs are followed by their own rates.
    guard_rate: Program,
    guards: Vec<Guard>,
    kind: Vec<Kind>,
    when: Vec<Option<Program>>,
    reset: Vec<Program>,
    /// `phi`, level, velocity of every dry element.
    dry: Program,
}

/// Programs that give derivatives in one mode.
struct ModeJacobians {
    flow: Program,
    output: Program,
}

/// Programs that give derivatives of the events of one mode: evaluated once per event, so not worth machine code.
struct EventJacobians {
    guard: Vec<Program>,
    reset: Vec<Program>,
}

/// What a guard of a combined mode is.
#[derive(Clone, Copy)]
enum Kind {
    /// An event of the document.
    Event(usize),
    /// A slipping element comes to rest.
    Rest(usize),
    /// A sticking element breaks away.
    Break(usize, Contact),
}

/// A guard with its value, its additional condition and the state after it.
type GuardExpressions = (Guard, Kind, Id, Option<Id>, Vec<Id>);

/// Expressions of one combined mode.
struct Expressions {
    graph: Graph,
    flow: Vec<Id>,
    output: Vec<Id>,
    dry: Forces,
    guards: Vec<GuardExpressions>,
}

impl Compiled {
    /// Makes programs for an assembly; `free` are the parameters that derivatives are taken for.
    pub fn new(assembly: Assembly, product: Product, inputs: usize, free: Vec<usize>, backend: Backend) -> Self {
        let values: Vec<f64> = assembly.parameters.iter().map(|p| p.value).collect();
        let channels = inputs + 2 * assembly.delays.len();
        let (late, operators) = past_programs(&assembly, &free);
        let schedule: Vec<Id> = assembly.ticks.iter().flat_map(|t| [t.every, t.offset]).collect();
        let schedule = Program::plain(&assembly.graph, &schedule);
        let mut graph = assembly.graph.clone();
        let (mut ticks, mut tick_jacobians) = (Vec::new(), Vec::new());
        for t in &assembly.ticks {
            let value: Vec<&[Id]> = t.update.iter().map(Vec::as_slice).collect();
            ticks.push(Program::compile(&graph, &value, backend));
            let full: Vec<Vec<Id>> =
                t.update.iter().map(|u| all_slopes(&mut graph, u, u.len(), &free, channels)).collect();
            let full: Vec<&[Id]> = full.iter().map(Vec::as_slice).collect();
            tick_jacobians.push(Program::compile(&graph, &full, backend));
        }
        let n = product.count();
        Self {
            assembly,
            product,
            values,
            free,
            inputs,
            channels,
            late,
            operators,
            backend,
            modes: (0..n).map(|_| OnceLock::new()).collect(),
            jacobians: (0..n).map(|_| OnceLock::new()).collect(),
            input_jacobians: (0..n).map(|_| OnceLock::new()).collect(),
            event_jacobians: (0..n).map(|_| OnceLock::new()).collect(),
            steppers: (0..n).map(|_| OnceLock::new()).collect(),
            ticks,
            tick_jacobians,
            schedule,
        }
    }

    /// Whether machine code serves (always, where this machine can compile).
    pub fn is_native(&self) -> bool {
        self.mode(self.initial_mode()).flow.is_native()
    }

    /// A whole state from the model's own part `x` of it: states of effects begin where their documents say that they do, at
    /// time `t` and inputs `u`, under parameters `p`.
    pub fn started(&self, x: &[f64], t: f64, u: &[f64], p: &[f64]) -> Vec<f64> {
        let mut whole = self.assembly.initial.clone();
        whole[..x.len()].copy_from_slice(x);
        for (state, id) in self.assembly.starts.iter().filter(|(state, _)| *state >= x.len()) {
            let mut value = [0.0];
            let at = Point { t, x: &whole, u, p };
            Program::plain(&self.assembly.graph, &[*id]).eval(at, &mut value);
            if value[0].is_finite() {
                whole[*state] = value[0];
            }
        }
        whole
    }

    /// Compiles values and derivatives of the document's modes, every element slipping forward: the cost of loading.
    pub fn warm(&self) {
        for base in 0..self.assembly.modes.len() {
            let mode = self.product.join(base, &vec![Contact::Forward; self.product.elements]);
            self.mode(mode);
            self.jacobian(mode);
            self.event_jacobian(mode);
        }
    }

    fn expressions(&self, mode: usize) -> Expressions {
        let a = &self.assembly;
        let (base, contacts) = self.product.split(mode);
        let active = &self.product.active[base];
        let mut g = a.graph.clone();
        let dry = forces(&mut g, a, base, &contacts, active);
        let put = |g: &mut Graph, ids: &[Id]| {
            g.substitute(ids, |s| if let Symbol::Dry(i) = s { Some(dry.phi[i]) } else { None })
        };
        let mut flow = put(&mut g, &a.modes[base].flow);
        let output = put(&mut g, &a.modes[base].outputs);
        let identity: Vec<Id> = (0..a.states.len()).map(|i| g.leaf(Symbol::State(i))).collect();
        let mut guards = Vec::new();
        for (k, e) in a.events.iter().enumerate().filter(|(_, e)| e.from == base) {
            let guard = put(&mut g, &[e.guard])[0];
            let when = e.when.map(|w| put(&mut g, &[w])[0]);
            let reset = put(&mut g, &e.reset);
            let info = Guard { name: e.name.clone(), direction: e.direction, friction: false };
            guards.push((info, Kind::Event(k), guard, when, reset));
        }
        for (i, c) in contacts.iter().enumerate().filter(|(i, _)| active[*i]) {
            // Where the velocity is a state by itself it rests at zero, not at what rounding left of it.
            let mut reset = identity.clone();
            if let Some(n) = identity.iter().position(|&x| x == dry.velocity[i]) {
                reset[n] = g.constant(0.0);
                if *c == Contact::Stick {
                    flow[n] = reset[n];
                }
            }
            let mut push = |kind, id, direction| {
                let info = Guard { name: a.dry_names[i].clone(), direction, friction: true };
                guards.push((info, kind, id, None, reset.clone()));
            };
            match c {
                Contact::Forward => push(Kind::Rest(i), dry.velocity[i], Direction::Falling),
                Contact::Backward => push(Kind::Rest(i), dry.velocity[i], Direction::Rising),
                Contact::Stick => {
                    // The holding force that reaches +L is overcome by a load that pushes backward, and the reverse.
                    let above = g.sub(dry.level[i], dry.phi[i]);
                    let below = g.add(dry.level[i], dry.phi[i]);
                    push(Kind::Break(i, Contact::Backward), above, Direction::Falling);
                    push(Kind::Break(i, Contact::Forward), below, Direction::Falling);
                }
            }
        }
        Expressions { graph: g, flow, output, dry, guards }
    }

    /// Evaluates at a point. Where only the inputs are given, late ones are taken as they are now.
    #[inline]
    fn seen<R>(&self, at: Point<'_>, f: impl FnOnce(Point<'_>) -> R) -> R {
        if at.u.len() >= self.channels {
            return f(at);
        }
        let mut u = at.u.to_vec();
        u.extend(self.assembly.delays.iter().flat_map(|d| [at.u[d.input], 0.0]));
        f(Point { u: &u, ..at })
    }

    fn mode(&self, mode: usize) -> &ModeValues {
        self.modes[mode].get_or_init(|| {
            let mut e = self.expressions(mode);
            let guard: Vec<Id> = e.guards.iter().map(|g| g.2).collect();
            let rate = along_flow(&mut e.graph, &guard, &e.flow, self.channels);
            let mut programs =
                Program::compile(&e.graph, &[&e.flow, &e.output, &guard, &rate], self.backend).into_iter();
            let mut next = || programs.next().expect("as many programs as groups");
            let dry: Vec<Id> = e.dry.phi.iter().chain(&e.dry.level).chain(&e.dry.velocity).copied().collect();
            ModeValues {
                flow: next(),
                output: next(),
                guard: next(),
                guard_rate: next(),
                when: e.guards.iter().map(|g| g.3.map(|w| Program::plain(&e.graph, &[w]))).collect(),
                reset: e.guards.iter().map(|g| Program::plain(&e.graph, &g.4)).collect(),
                dry: Program::plain(&e.graph, &dry),
                kind: e.guards.iter().map(|g| g.1).collect(),
                guards: e.guards.into_iter().map(|g| g.0).collect(),
            }
        })
    }

    fn jacobian(&self, mode: usize) -> &ModeJacobians {
        self.jacobians[mode].get_or_init(|| {
            let mut e = self.expressions(mode);
            let flow = slopes(&mut e.graph, &e.flow, self.states(), &self.free);
            let output = slopes(&mut e.graph, &e.output, self.states(), &self.free);
            let mut programs = Program::compile(&e.graph, &[&flow, &output], self.backend).into_iter();
            let mut next = || programs.next().expect("as many programs as groups");
            ModeJacobians { flow: next(), output: next() }
        })
    }

    /// Derivatives by the inputs: asked for once per node of a linearization, so not worth machine code.
    fn by_inputs(&self, mode: usize) -> &Program {
        self.input_jacobians[mode].get_or_init(|| {
            let mut e = self.expressions(mode);
            let rows = [e.flow.as_slice(), e.output.as_slice()].concat();
            let by: Vec<Vec<Id>> = (0..self.inputs).map(|j| e.graph.derivative(&rows, Symbol::Input(j))).collect();
            let all: Vec<Id> = (0..rows.len()).flat_map(|i| by.iter().map(move |c| c[i])).collect();
            Program::plain(&e.graph, &all)
        })
    }

    fn event_jacobian(&self, mode: usize) -> &EventJacobians {
        self.event_jacobians[mode].get_or_init(|| {
            let mut e = self.expressions(mode);
            let (mut guard, mut reset) = (Vec::new(), Vec::new());
            for g in &e.guards {
                let all = |e: &mut Graph, ids: &[Id]| all_slopes(e, ids, self.states(), &self.free, self.channels);
                let (of_guard, of_reset) = (all(&mut e.graph, &[g.2]), all(&mut e.graph, &g.4));
                guard.push(Program::plain(&e.graph, &of_guard));
                reset.push(Program::plain(&e.graph, &of_reset));
            }
            EventJacobians { guard, reset }
        })
    }

    /// Chooses slip or stick for every element at a state: those at rest try to hold, the others follow their velocity.
    fn choose(&self, base: usize, at: Point<'_>) -> Vec<Contact> {
        let n = self.product.elements;
        let mut contacts = vec![Contact::Forward; n];
        let mut dry = vec![0.0; 3 * n];
        self.mode(self.product.join(base, &contacts)).dry.eval(at, &mut dry);
        for (i, c) in contacts.iter_mut().enumerate().filter(|(i, _)| self.product.active[base][*i]) {
            let v = dry[2 * n + i];
            *c = if v.abs() <= REST {
                Contact::Stick
            } else if v > 0.0 {
                Contact::Forward
            } else {
                Contact::Backward
            };
        }
        contacts
    }

    /// The combined mode, after every holding element that is overcome has let go.
    fn release(&self, base: usize, mut contacts: Vec<Contact>, at: Point<'_>) -> usize {
        let n = self.product.elements;
        let mut dry = vec![0.0; 3 * n];
        while contacts.contains(&Contact::Stick) {
            self.mode(self.product.join(base, &contacts)).dry.eval(at, &mut dry);
            let excess = |i: &usize| dry[*i].abs() - dry[n + *i];
            let held = (0..n).filter(|&i| contacts[i] == Contact::Stick && excess(&i) > 0.0);
            // The one that is overcome most goes first: it may relieve the others.
            let Some(i) = held.max_by(|a, b| excess(a).total_cmp(&excess(b))) else { break };
            contacts[i] = if dry[i] > 0.0 { Contact::Backward } else { Contact::Forward };
        }
        self.product.join(base, &contacts)
    }
}

impl System for Compiled {
    fn states(&self) -> usize {
        self.assembly.states.len()
    }
    fn inputs(&self) -> usize {
        self.inputs
    }
    fn outputs(&self) -> usize {
        self.assembly.modes[0].outputs.len()
    }
    fn parameters(&self) -> &[f64] {
        &self.values
    }
    fn free(&self) -> &[usize] {
        &self.free
    }
    fn initial_state(&self) -> Vec<f64> {
        self.assembly.initial.clone()
    }
    fn state_name(&self, state: usize) -> String {
        self.assembly.states[state].clone()
    }
    fn initial_mode(&self) -> usize {
        self.product.join(self.assembly.initial_mode, &vec![Contact::Forward; self.product.elements])
    }
    fn mode_name(&self, mode: usize) -> String {
        let (base, contacts) = self.product.split(mode);
        let mut name = self.assembly.modes[base].name.clone();
        for (i, c) in contacts.iter().enumerate().filter(|(i, _)| self.product.active[base][*i]) {
            let what = match c {
                Contact::Forward => "slips forward",
                Contact::Backward => "slips backward",
                Contact::Stick => "sticks",
            };
            name.push_str(&format!(", {} {what}", self.assembly.dry_names[i]));
        }
        name
    }
    fn shortest_time(&self, p: &[f64]) -> f64 {
        self.assembly.relaxations.iter().map(|&i| p[i]).filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min)
    }
    fn delays(&self, p: &[f64]) -> Vec<Delay> {
        let (n, width) = (self.assembly.delays.len(), 1 + self.free.len());
        let mut v = vec![0.0; self.late.len()];
        self.late.eval(Point { t: 0.0, x: &[], u: &[], p }, &mut v);
        let past = |past, period| match past {
            PastEquation::Zero => Past::Zero,
            PastEquation::Hold => Past::Hold,
            PastEquation::Periodic(_) => Past::Periodic(period),
        };
        let delay = |(k, d): (usize, &DelayEquation)| Delay {
            input: d.input,
            delay: v[k * width],
            slope: v[k * width + 1..(k + 1) * width].to_vec(),
            past: past(d.past, v[n * width + k]),
        };
        self.assembly.delays.iter().enumerate().map(delay).collect()
    }
    fn operators(&self, p: &[f64]) -> Vec<Operator> {
        let mut v = vec![0.0; self.operators.len()];
        self.operators.eval(Point { t: 0.0, x: &[], u: &[], p }, &mut v);
        let rows = self.assembly.operators.iter().zip(v.chunks(1 + self.free.len()));
        rows.map(|(o, v)| Operator { output: o.output, kind: o.kind, value: v[0], slope: v[1..].to_vec() }).collect()
    }
    #[inline]
    fn flow(&self, mode: usize, at: Point<'_>, rates: &mut [f64]) {
        self.seen(at, |at| self.mode(mode).flow.eval(at, rates));
    }
    fn flow_jacobian(&self, mode: usize, at: Point<'_>, out: &mut [f64]) {
        self.seen(at, |at| self.jacobian(mode).flow.eval(at, out));
    }
    fn output(&self, mode: usize, at: Point<'_>, y: &mut [f64]) {
        self.seen(at, |at| self.mode(mode).output.eval(at, y));
    }
    fn output_jacobian(&self, mode: usize, at: Point<'_>, out: &mut [f64]) {
        self.seen(at, |at| self.jacobian(mode).output.eval(at, out));
    }
    fn input_jacobian(&self, mode: usize, at: Point<'_>, out: &mut [f64]) {
        self.seen(at, |at| self.by_inputs(mode).eval(at, out));
    }
    fn period(&self, p: &[f64]) -> Option<f64> {
        let period = Program::plain(&self.assembly.graph, &[self.assembly.period?]);
        let mut value = [0.0];
        period.eval(Point { t: 0.0, x: &[], u: &[], p }, &mut value);
        Some(value[0])
    }
    fn guards(&self, mode: usize) -> &[Guard] {
        &self.mode(mode).guards
    }
    #[inline]
    fn guard_values(&self, mode: usize, at: Point<'_>, out: &mut [f64]) {
        self.seen(at, |at| self.mode(mode).guard.eval(at, out));
    }
    fn guard_rates(&self, mode: usize, at: Point<'_>, u_rate: &[f64], out: &mut [f64]) {
        if u_rate.is_empty() {
            return self.mode(mode).guard_rate.eval(at, out);
        }
        self.seen(at, |at| {
            let mut u = [at.u, u_rate].concat();
            u.resize(2 * self.channels, 0.0);
            self.mode(mode).guard_rate.eval(Point { u: &u, ..at }, out);
        });
    }
    fn stepper(&self, mode: usize) -> Option<&Stepper> {
        self.steppers[mode]
            .get_or_init(|| {
                let mut e = self.expressions(mode);
                let guards: Vec<Id> = e.guards.iter().map(|g| g.2).collect();
                Stepper::compile(&mut e.graph, &e.flow, &guards, self.channels, self.backend)
            })
            .as_ref()
    }
    fn guard_jacobian(&self, mode: usize, guard: usize, at: Point<'_>, out: &mut [f64]) {
        self.event_jacobian(mode).guard[guard].eval(at, out);
    }
    fn fires(&self, mode: usize, guard: usize, at: Point<'_>) -> bool {
        self.mode(mode).when[guard].as_ref().is_none_or(|w| {
            let mut holds = [0.0];
            w.eval(at, &mut holds);
            holds[0] != 0.0
        })
    }
    fn reset(&self, mode: usize, guard: usize, at: Point<'_>, after: &mut [f64]) {
        self.mode(mode).reset[guard].eval(at, after);
    }
    fn reset_jacobian(&self, mode: usize, guard: usize, at: Point<'_>, out: &mut [f64]) {
        self.event_jacobian(mode).reset[guard].eval(at, out);
    }
    fn target(&self, mode: usize, guard: usize, at: Point<'_>) -> usize {
        let (base, mut contacts) = self.product.split(mode);
        match self.mode(mode).kind[guard] {
            Kind::Event(k) => return self.settle(self.product.join(self.assembly.events[k].to, &contacts), at),
            Kind::Rest(i) => contacts[i] = Contact::Stick,
            Kind::Break(i, to) => contacts[i] = to,
        }
        self.release(base, contacts, at)
    }
    fn settle(&self, mode: usize, at: Point<'_>) -> usize {
        if self.product.elements == 0 {
            return mode;
        }
        let (base, _) = self.product.split(mode);
        self.seen(at, |at| self.release(base, self.choose(base, at), at))
    }
    fn ticks(&self, p: &[f64]) -> Vec<Schedule> {
        let mut v = vec![0.0; self.schedule.len()];
        self.schedule.eval(Point { t: 0.0, x: &[], u: &[], p }, &mut v);
        let named = self.assembly.ticks.iter().zip(v.chunks(2));
        named.map(|(t, v)| Schedule { name: t.name.clone(), every: v[0], offset: v[1] }).collect()
    }
    fn tick(&self, mode: usize, tick: usize, at: Point<'_>, after: &mut [f64]) {
        self.ticks[tick][self.product.split(mode).0].eval(at, after);
    }
    fn tick_jacobian(&self, mode: usize, tick: usize, at: Point<'_>, out: &mut [f64]) {
        self.tick_jacobians[tick][self.product.split(mode).0].eval(at, out);
    }
}
