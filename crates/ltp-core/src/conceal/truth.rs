//! The truth integrator: motions of a [`Machine`] by extrapolation at a tight tolerance, with its own events and its own
//! slip and stick. It shares the expressions of the document with the engine under test, and nothing else: plain
//! evaluator, other method, other step control, other event location.

use super::extrapolation::Extrapolation;
use super::machine::{Machine, Wave};
use super::sensing::{delayed, slack, stops};
use super::slip::{self, Contact};
use crate::error::{Error, Result};
use crate::model::Point;
use crate::model::document::Direction;

/// Relative tolerance per step of the recordings that `conceal` writes.
pub const TOLERANCE: f64 = 1e-10;
/// Events within one sample beyond which they pile up.
const PILE: usize = 400;
/// A state beyond this, in its SI unit, is no motion of a machine any more.
const ESCAPED: f64 = 1e9;
/// Steps from sample to sample, on average, beyond which a motion is given up.
const PATIENCE: usize = 200;

/// What a run needs beyond the machine.
pub struct Run<'a> {
    /// Start of the equations' states; lags start at rest.
    pub x0: &'a [f64],
    /// Samples before time zero that are not recorded, for the motion to settle.
    pub lead: usize,
    /// Samples recorded, the first one at time zero.
    pub samples: usize,
    /// Relative tolerance.
    pub tolerance: f64,
}

/// The next sample of the inputs from the number of the present one and the state: a controller.
pub type Feedback<'a> = &'a mut dyn FnMut(usize, &[f64]) -> Vec<f64>;

/// A motion.
pub struct Motion {
    /// Recorded outputs (samples, ny).
    pub outputs: Vec<f64>,
    /// States of the equations at time zero.
    pub start: Vec<f64>,
}

/// Runs a machine.
///
/// # Errors
/// [`Error::NoConvergence`] when the motion leaves the finite numbers or its events pile up.
pub fn run(machine: &Machine, wave: &mut Wave, run: &Run<'_>, mut feedback: Option<Feedback<'_>>) -> Result<Motion> {
    let ny = machine.sensors.len();
    let dt = wave.dt;
    let mut walker = Walker::new(machine, run, dt);
    walker.enter(wave, &[]);
    let mut late: Vec<Vec<f64>> = vec![Vec::new(); ny];
    let mut y = vec![0.0; ny];
    let mut out = Vec::with_capacity(run.samples * ny);
    let stops = stops(machine, dt);
    let mut play: Vec<Option<f64>> = vec![None; ny];
    let mut start = Vec::new();
    for k in -(run.lead as i64)..run.samples as i64 {
        let begin = k as f64 * dt;
        walker.t = begin;
        walker.measure(wave, &mut y);
        if k == 0 {
            start = walker.z[..machine.nx].to_vec();
        }
        for (j, s) in machine.sensors.iter().enumerate() {
            late[j].push(y[j]);
            slack(&mut play[j], y[j], s.gap);
        }
        if k >= 0 {
            for (j, s) in machine.sensors.iter().enumerate() {
                // `late` holds the start, then alternately a sample and the stop before the next one, where there is a delay.
                let value = if s.delay > 0.0 {
                    delayed(&late[j], s.delay, dt)
                } else if s.gap > 0.0 {
                    play[j].unwrap_or(y[j])
                } else {
                    y[j]
                };
                out.push(s.gain * value + s.bias);
            }
            if let Some(next) = feedback.as_deref_mut() {
                wave.samples.extend(next(k as usize, &walker.z[..machine.nx]));
            }
        }
        if k + 1 == run.samples as i64 {
            break;
        }
        for stop in &stops {
            walker.advance(wave, begin + stop.after)?;
            if !stop.look {
                continue;
            }
            walker.measure(wave, &mut y);
            for (j, s) in machine.sensors.iter().enumerate() {
                if stop.late == Some(j) {
                    late[j].push(y[j]);
                }
                slack(&mut play[j], y[j], s.gap);
            }
        }
    }
    Ok(Motion { outputs: out, start })
}

struct Walker<'a> {
    machine: &'a Machine,
    t: f64,
    z: Vec<f64>,
    mode: usize,
    contacts: Vec<Contact>,
    armed: Vec<bool>,
    /// Sign that makes a watched guard positive before it fires; for guards that fire in either direction.
    sides: Vec<f64>,
    h: f64,
    dt: f64,
    tolerance: f64,
    largest: Vec<f64>,
    table: Extrapolation,
    room: Room,
    fired: usize,
    /// Steps so far, and the times to which it ran.
    steps: usize,
    asked: usize,
}

/// Scratch of one evaluation.
struct Room {
    u: Vec<f64>,
    p: Vec<f64>,
    action: Vec<f64>,
    friction: slip::Friction,
    outputs: Vec<f64>,
    guard: Vec<f64>,
}

impl<'a> Walker<'a> {
    fn new(machine: &'a Machine, run: &Run<'_>, dt: f64) -> Self {
        let mut z = run.x0.to_vec();
        z.resize(machine.nz, 0.0);
        // States that an effect brings along start as its document says.
        let own = run.x0.len()..machine.nx;
        z[own.clone()].copy_from_slice(&machine.initial[own]);
        let elements = machine.modes[0].elements;
        Self {
            machine,
            t: -(run.lead as f64) * dt,
            largest: z.iter().map(|v| v.abs()).collect(),
            table: Extrapolation::new(z.len()),
            z,
            mode: machine.initial_mode,
            contacts: vec![Contact::Stick; elements],
            armed: Vec::new(),
            sides: Vec::new(),
            h: dt,
            dt,
            tolerance: run.tolerance,
            room: Room {
                u: vec![0.0; machine.inputs()],
                p: Vec::new(),
                action: vec![0.0; elements * machine.nx],
                friction: slip::Friction::new(elements),
                outputs: vec![0.0; machine.sensors.len()],
                guard: vec![0.0; 1 + elements],
            },
            fired: 0,
            steps: 0,
            asked: 0,
        }
    }

    /// What the equations measure now, before the sensors; lags included.
    fn measure(&mut self, wave: &Wave, y: &mut [f64]) {
        let m = self.machine;
        m.parameters(self.t, &mut self.room.p);
        m.drive(wave, self.t, &self.z, &self.room.p, &mut self.room.u, None);
        let at = Point { t: self.t, x: &self.z[..m.nx], u: &self.room.u, p: &self.room.p };
        m.modes[self.mode].output.eval(at, y);
        for (y, s) in y.iter_mut().zip(&m.sensors) {
            if let Some((_, k)) = s.lag {
                *y = self.z[k];
            }
        }
    }

    /// A mode begins, or its slip and stick are in question: settles friction and arms the guards.
    fn enter(&mut self, wave: &Wave, at_zero: &[usize]) {
        let m = self.machine;
        let z = self.z.clone();
        load(m, wave, self.mode, self.t, &z, &mut self.room);
        self.room.friction.settle(&mut self.contacts, at_zero);
        self.arm(wave);
        self.h = self.dt * 1e-3;
    }

    fn arm(&mut self, wave: &Wave) {
        let z = self.z.clone();
        let raw = self.raw_guards(wave, self.t, &z);
        self.sides = raw.iter().map(|(g, d)| if *d == Direction::Either && *g < 0.0 { -1.0 } else { 1.0 }).collect();
        self.armed = raw.iter().zip(&self.sides).map(|((g, _), s)| s * g > 0.0).collect();
    }

    /// Guards of the mode, then of friction; positive before they fire, but for those of either direction.
    fn raw_guards(&mut self, wave: &Wave, t: f64, z: &[f64]) -> Vec<(f64, Direction)> {
        let m = self.machine;
        load(m, wave, self.mode, t, z, &mut self.room);
        self.room.friction.solve(&self.contacts);
        let r = &mut self.room;
        let mut out = Vec::new();
        for e in m.events.iter().filter(|e| e.from == self.mode) {
            e.guard.eval(Point { t, x: &z[..m.nx], u: &r.u, p: &r.p }, &mut r.guard);
            let g = r.friction.affine(&r.guard);
            out.push((if e.direction == Direction::Rising { -g } else { g }, e.direction));
        }
        for (i, c) in self.contacts.iter().enumerate() {
            out.push((r.friction.margin(i, *c), Direction::Falling));
        }
        out
    }

    fn guards(&mut self, wave: &Wave, t: f64, z: &[f64]) -> Vec<f64> {
        let raw = self.raw_guards(wave, t, z);
        raw.iter().zip(&self.sides).map(|((g, _), s)| g * s).collect()
    }

    /// One step of at most `h` under the present contacts; the step taken and the state after it.
    fn step(&mut self, wave: &Wave, h: f64, out: &mut [f64]) -> (f64, usize) {
        let (m, mode, contacts) = (self.machine, self.mode, &self.contacts);
        let room = &mut self.room;
        let flow = &mut |t: f64, z: &[f64], f: &mut [f64]| rates(m, wave, mode, contacts, t, z, room, f);
        let mut rate = vec![0.0; m.nz];
        flow(self.t, &self.z, &mut rate);
        let scale: Vec<f64> = self.largest.iter().map(|l| self.tolerance * (l + 1e-4)).collect();
        let mut h = h;
        loop {
            let took = self.table.step(flow, (self.t, h), (&self.z, &rate), &scale, out);
            match took {
                Some(columns) => return (h, columns),
                // A corner or a jump of a law: below this the error of a rough step no longer matters.
                None if h < 1e-9 * self.dt => return (h, 8),
                None => h *= 0.4,
            }
        }
    }

    /// Runs to a time, through events.
    fn advance(&mut self, wave: &Wave, end: f64) -> Result<()> {
        let mut after = vec![0.0; self.machine.nz];
        self.fired = 0;
        self.asked += 1;
        while end - self.t > 1e-12 * self.dt {
            self.steps += 1;
            if self.steps > PATIENCE * (self.asked + 10) {
                return Err(self.lost(
                    "it is so stiff that it takes hundreds of steps from sample to sample; take other parameters",
                ));
            }
            let wanted = self.h.min(end - self.t);
            let (h, columns) = self.step(wave, wanted, &mut after);
            if !after.iter().all(|v| v.abs() < ESCAPED) {
                return Err(self.lost("the motion leaves the finite numbers; take other inputs or parameters"));
            }
            match self.crossing(wave, h, &after) {
                Some(hi) => self.fire(wave, hi)?,
                None => {
                    self.t = if h >= end - self.t { end } else { self.t + h };
                    self.z.copy_from_slice(&after);
                    let z = self.z.clone();
                    for (armed, g) in self.armed_again(wave, &z).into_iter().enumerate() {
                        self.armed[armed] |= g;
                    }
                    for (l, v) in self.largest.iter_mut().zip(&self.z) {
                        *l = l.max(v.abs());
                    }
                    let factor = if columns <= 4 { 2.0 } else { 1.0 };
                    self.h = if h < wanted { h } else { (h * factor).max(self.h.min(h * factor)) };
                    self.h = self.h.min(self.dt);
                }
            }
        }
        self.t = end;
        Ok(())
    }

    fn armed_again(&mut self, wave: &Wave, z: &[f64]) -> Vec<bool> {
        let t = self.t;
        self.guards(wave, t, z).iter().map(|g| *g > 0.0).collect()
    }

    /// The first of four instants of a step by which an armed guard has crossed zero; a cubic through the ends looks
    /// for a crossing and back inside, and an integration confirms it.
    fn crossing(&mut self, wave: &Wave, h: f64, after: &[f64]) -> Option<f64> {
        if self.armed.is_empty() {
            return None;
        }
        let n = self.z.len();
        let (mut f0, mut f1) = (vec![0.0; n], vec![0.0; n]);
        let (m, mode) = (self.machine, self.mode);
        rates(m, wave, mode, &self.contacts, self.t, &self.z, &mut self.room, &mut f0);
        rates(m, wave, mode, &self.contacts, self.t + h, after, &mut self.room, &mut f1);
        let mut middle = vec![0.0; n];
        for part in [0.25, 0.5, 0.75, 1.0] {
            let (s, t) = (part, self.t + part * h);
            for i in 0..n {
                let (a, b, d0, d1) = (self.z[i], after[i], h * f0[i], h * f1[i]);
                middle[i] = a + s * (d0 + s * (3.0 * (b - a) - 2.0 * d0 - d1 + s * (2.0 * (a - b) + d0 + d1)));
            }
            if !self.crossed(wave, t, &middle.clone()) {
                continue;
            }
            if part == 1.0 {
                return Some(h);
            }
            let (took, _) = self.step(wave, part * h, &mut middle);
            if self.crossed(wave, self.t + took, &middle.clone()) {
                return Some(took);
            }
        }
        None
    }

    fn crossed(&mut self, wave: &Wave, t: f64, z: &[f64]) -> bool {
        let guards = self.guards(wave, t, z);
        guards.iter().zip(&self.armed).any(|(g, armed)| *armed && *g <= 0.0)
    }

    /// The smallest armed guard after a step of length `s`, and the state there.
    fn nearest(&mut self, wave: &Wave, s: f64) -> (f64, Vec<f64>) {
        let mut z = self.z.clone();
        let (mut done, start) = (0.0, (self.t, self.z.clone()));
        while s - done > 1e-15 * self.dt {
            let (h, _) = self.step(wave, s - done, &mut z);
            done += h;
            (self.t, self.z) = (start.0 + done, z.clone());
        }
        (self.t, self.z) = start;
        let guards = self.guards(wave, self.t + s, &z);
        let armed = guards.iter().zip(&self.armed).filter(|(_, a)| **a).map(|(g, _)| *g);
        (armed.fold(f64::INFINITY, f64::min), z)
    }

    /// Locates the first crossing in a step of length `hi` (Illinois rule) and passes through it.
    fn fire(&mut self, wave: &Wave, hi: f64) -> Result<()> {
        let (mut a, mut b) = (0.0, hi);
        let (mut ga, _) = self.nearest(wave, 0.0);
        let (mut gb, mut zb) = self.nearest(wave, b);
        let mut side = 0;
        for round in 0..100 {
            if b - a <= 4.0 * f64::EPSILON * self.t.abs().max(self.dt) || gb == 0.0 {
                break;
            }
            let cut = if round % 4 == 3 { 0.5 * (a + b) } else { b - gb * (b - a) / (gb - ga) };
            let c = if cut > a && cut < b { cut } else { 0.5 * (a + b) };
            let (gc, zc) = self.nearest(wave, c);
            if gc > 0.0 {
                (a, ga) = (c, gc);
                if side == 1 {
                    gb *= 0.5;
                }
                side = 1;
            } else {
                (b, gb, zb) = (c, gc, zc);
                if side == -1 {
                    ga *= 0.5;
                }
                side = -1;
            }
        }
        self.t += b;
        self.z = zb;
        self.fired += 1;
        if self.fired > PILE {
            return Err(self.lost("its events pile up within one sample; take other inputs or parameters"));
        }
        let z = self.z.clone();
        let guards = self.guards(wave, self.t, &z);
        let first = (0..guards.len()).find(|&i| self.armed[i] && guards[i] <= 0.0);
        let Some(first) = first else {
            self.h = self.dt * 1e-3;
            return Ok(());
        };
        self.pass(wave, first);
        Ok(())
    }

    /// Passes through an event: of the document, or of friction.
    fn pass(&mut self, wave: &Wave, index: usize) {
        let m = self.machine;
        let watched: Vec<_> = m.events.iter().filter(|e| e.from == self.mode).collect();
        let Some(event) = watched.get(index) else {
            let i = index - watched.len();
            match self.contacts[i] {
                Contact::Stick => {
                    self.contacts[i] =
                        if self.room.friction.force(i) > 0.0 { Contact::Backward } else { Contact::Forward };
                    self.arm(wave);
                    self.h = self.dt * 1e-3;
                }
                _ => self.enter(wave, &[i]),
            }
            return;
        };
        let r = &mut self.room;
        if let Some(when) = &event.when {
            let mut value = vec![0.0; r.guard.len()];
            when.eval(Point { t: self.t, x: &self.z[..m.nx], u: &r.u, p: &r.p }, &mut value);
            if r.friction.affine(&value) == 0.0 {
                self.armed[index] = false;
                return;
            }
        }
        let mut reset = vec![0.0; m.nx];
        event.reset.eval(Point { t: self.t, x: &self.z[..m.nx], u: &r.u, p: &r.p }, &mut reset);
        self.z[..m.nx].copy_from_slice(&reset);
        self.mode = event.to;
        self.enter(wave, &[]);
    }

    fn lost(&self, advice: &str) -> Error {
        Error::NoConvergence {
            method: format!("motion of `{}` at t = {:.4} s", self.machine.name(), self.t),
            iterations: self.fired,
            residual: f64::INFINITY,
            advice: advice.into(),
        }
    }
}

/// Inputs, parameters and friction data at a point.
fn load(m: &Machine, wave: &Wave, mode: usize, t: f64, z: &[f64], room: &mut Room) {
    m.parameters(t, &mut room.p);
    m.drive(wave, t, z, &room.p, &mut room.u, None);
    let at = Point { t, x: &z[..m.nx], u: &room.u, p: &room.p };
    room.friction.load(&m.modes[mode], at);
}

#[expect(clippy::too_many_arguments, reason = "the equations see all of it, and the borrow is split")]
fn rates(
    m: &Machine,
    wave: &Wave,
    mode: usize,
    contacts: &[Contact],
    t: f64,
    z: &[f64],
    room: &mut Room,
    out: &mut [f64],
) {
    let parts = &m.modes[mode];
    m.parameters(t, &mut room.p);
    m.drive(wave, t, z, &room.p, &mut room.u, Some(out));
    let at = Point { t, x: &z[..m.nx], u: &room.u, p: &room.p };
    parts.flow.eval(at, &mut out[..m.nx]);
    if parts.elements > 0 {
        room.friction.load(parts, at);
        room.friction.solve(contacts);
        parts.action.eval(at, &mut room.action);
        for i in 0..parts.elements {
            let force = room.friction.force(i);
            for k in 0..m.nx {
                out[k] += room.action[i * m.nx + k] * force;
            }
        }
    }
    if m.sensors.iter().any(|s| s.lag.is_some()) {
        parts.output.eval(at, &mut room.outputs);
        for (s, y) in m.sensors.iter().zip(&room.outputs) {
            if let Some((tau, k)) = s.lag {
                out[k] = (y - z[k]) / tau;
            }
        }
    }
}
