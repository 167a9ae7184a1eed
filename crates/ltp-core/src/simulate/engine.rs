//! The engine: fixed steps on a grid, events inside them, ticks between them.
//!
//! After an event the next step ends on the grid again, so that samples stay where they were asked for; steps also end where
//! an input has a sample. The engine owns
//! the state, the mode, which guards are armed and the sensitivities; [`super::simulate`] and the fits of `diagnose` drive
//! it from sample to sample.

use super::inputs::Inputs;
use super::locate::{Crossing, Span, Watch};
use super::saltation::{self, Sizes};
use super::step::{Context, Work};
use super::stop::{Event, Stats, Stop};
use crate::model::{Delay, Point, Schedule, Stepper, System};

/// Events at one instant beyond which the engine calls it chattering.
const CHATTER: usize = 64;
/// Remaining time of a geometric sequence of events below which the engine calls it Zeno, s.
const ZENO: f64 = 1e-9;
/// A guard that crosses slower than this fraction of its mean speed over the step touches rather than crosses.
const GRAZING: f64 = 1e-4;
/// Steps in one mode after which it is worth compiling the whole step.
const WORTHWHILE: u64 = 500;

/// Ticks this close to a grid point, in steps, happen on it: a sampled controller and the time stamps of its recording agree
/// only to their rounding.
const ON_GRID: f64 = 1e-3;

/// Shortest sampling period of a tick, in steps.
const SHORTEST_TICK: f64 = 1e-3;

/// What the engine needs to know before it starts.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Start, s.
    pub t0: f64,
    /// Step, s.
    pub step: f64,
    /// Largest number of steps.
    pub max_steps: u64,
    /// Whether to carry sensitivities.
    pub derivatives: bool,
}

/// A simulation in progress.
pub struct Engine<'a> {
    system: &'a dyn System,
    p: &'a [f64],
    inputs: &'a Inputs,
    settings: Settings,
    sizes: Sizes,
    t: f64,
    x: Vec<f64>,
    s: Vec<f64>,
    mode: usize,
    stepper: Option<&'a Stepper>,
    /// Steps so far in each mode.
    steps_in: Vec<u64>,
    /// Number of the grid point last reached.
    grid: u64,
    first_stage_known: bool,
    recheck: bool,
    watch: Watch,
    work: Work,
    u: Vec<f64>,
    ticks: Vec<(Schedule, u64)>,
    events: Vec<Event>,
    stats: Stats,
    largest: Vec<f64>,
    error: Vec<f64>,
    /// Inputs that are seen late, where there are derivatives by their delays.
    late: Vec<Delay>,
    /// Whether one of them may jump now.
    late_due: bool,
}

impl<'a> Engine<'a> {
    /// An engine at the start, with the inputs as the system sees them ([`Inputs::seen_by`]): the mode settled, guards armed, ticks that are due carried out.
    pub fn new(
        system: &'a dyn System,
        p: &'a [f64],
        inputs: &'a Inputs,
        x0: &[f64],
        mode: usize,
        settings: Settings,
    ) -> Result<Self, Stop> {
        let sizes = Sizes { nx: system.states(), nf: system.free().len(), nu: inputs.channels() };
        let Sizes { nx, nf, nu } = sizes;
        let mut s = vec![0.0; if settings.derivatives { nx * (nx + nf) } else { 0 }];
        for i in 0..nx.min(s.len()) {
            s[i * (nx + nf) + i] = 1.0;
        }
        // A sampling period of next to nothing, as a fit may try, would never end.
        if system.ticks(p).iter().any(|c| c.every.is_nan() || c.every <= SHORTEST_TICK * settings.step) {
            let (time, mode, limit) = (settings.t0, system.mode_name(mode), settings.max_steps);
            return Err(Stop::StepLimit { time, mode, limit });
        }
        let due = |c: &Schedule| ((settings.t0 - c.offset - ON_GRID * settings.step) / c.every).ceil().max(0.0) as u64;
        let ticks = system.ticks(p).into_iter().map(|c| (due(&c), c)).map(|(k, c)| (c, k)).collect();
        let mut engine = Self {
            system,
            p,
            inputs,
            settings,
            sizes,
            t: settings.t0,
            x: x0.to_vec(),
            s,
            mode,
            stepper: None,
            steps_in: Vec::new(),
            grid: 0,
            first_stage_known: false,
            recheck: false,
            watch: Watch::default(),
            work: Work::new(nx, nu, nf, settings.derivatives),
            u: vec![0.0; nu],
            ticks,
            events: Vec::new(),
            stats: Stats::default(),
            largest: vec![0.0; nx],
            error: vec![0.0; nx],
            late: Vec::new(),
            late_due: false,
        };
        if settings.derivatives {
            engine.late = system.delays(p);
            engine.late_due = !engine.late.is_empty();
        }
        engine.enter(mode, true);
        engine.tick_due()?;
        Ok(engine)
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.t
    }
    /// State.
    pub fn state(&self) -> &[f64] {
        &self.x
    }
    /// Mode.
    pub fn mode(&self) -> usize {
        self.mode
    }
    /// Sensitivities of the state: nx rows of d/d(initial state), d/d(free parameters).
    pub fn sensitivities(&self) -> &[f64] {
        &self.s
    }
    /// Events so far.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// All events, at the end.
    pub fn into_events(self) -> Vec<Event> {
        self.events
    }

    /// What it cost so far.
    pub fn stats(&self) -> Stats {
        let ratio = |(e, l): (&f64, &f64)| if *l > 0.0 { e / l } else { 0.0 };
        let error_estimate = self.error.iter().zip(&self.largest).map(ratio).fold(0.0, f64::max);
        Stats { error_estimate, evaluations: self.work.evaluations, ..self.stats }
    }

    /// Inputs at the present time, as they continue, and the channels of late ones behind them.
    pub fn input(&mut self) -> &[f64] {
        let interval = self.inputs.interval(self.t + 1e-6 * self.settings.step);
        self.inputs.eval(interval, self.t, &mut self.u);
        &self.u
    }

    /// Outputs at the present time.
    pub fn output(&mut self, y: &mut [f64]) {
        self.input();
        self.system.output(self.mode, Point { t: self.t, x: &self.x, u: &self.u, p: self.p }, y);
    }

    /// Outputs with derivatives by state and free parameter, laid out as [`System::output_jacobian`].
    pub fn output_jacobian(&mut self, out: &mut [f64]) {
        self.input();
        self.system.output_jacobian(self.mode, Point { t: self.t, x: &self.x, u: &self.u, p: self.p }, out);
    }

    /// Replaces state and sensitivities, as a measurement does: slip or stick is chosen anew.
    pub fn correct(&mut self, x: &[f64], s: &[f64]) {
        self.x.copy_from_slice(x);
        self.s.copy_from_slice(s);
        self.enter(self.mode, true);
    }

    /// Advances to the grid point `target`.
    ///
    /// # Errors
    /// The reason why it could not; the state is the last valid one.
    pub fn advance(&mut self, target: u64) -> Result<(), Stop> {
        let Settings { t0, step, .. } = self.settings;
        let sliver = 1e-9 * step;
        while self.grid < target {
            let end = t0 + (self.grid + 1) as f64 * step;
            let ticks = self.ticks.iter().map(|(c, k)| c.offset + *k as f64 * c.every);
            let inside = ticks.filter(|tick| *tick < end - ON_GRID * step);
            let next = inside.fold(self.inputs.next_knot(self.t + sliver), f64::min);
            if next < end - sliver {
                self.flow_to(next)?;
            } else {
                self.flow_to(end)?;
                self.grid += 1;
            }
            if !self.ticks.is_empty() {
                self.tick_due()?;
            }
            if self.inputs.jumps() {
                self.first_stage_known = false;
                self.recheck = true;
                self.late_due = !self.late.is_empty();
            }
        }
        Ok(())
    }

    /// Late inputs that jump now. One that does would do so later if its delay grew: the flow before it lasts longer, that
    /// after it, in the mode that the jump leads to, begins later. Here the first half; a jump at a sample counts behind it.
    fn late_before(&mut self, c: Context<'_>) -> Vec<usize> {
        let Sizes { nx, nf, nu } = self.sizes;
        let own = nu - 2 * self.late.len();
        let (mut before, mut after, mut flow) = (vec![0.0; nu], vec![0.0; nu], vec![0.0; nx]);
        self.inputs.eval(self.inputs.interval(self.t - 1e-6 * self.settings.step), self.t, &mut before);
        self.inputs.eval(c.interval, self.t, &mut after);
        let jumps = |k: &usize| before[own + 2 * k] != after[own + 2 * k];
        let jumping: Vec<usize> = (0..self.late.len()).filter(jumps).collect();
        for &k in &jumping {
            let now = std::mem::replace(&mut after[own + 2 * k], before[own + 2 * k]);
            let at = Point { t: self.t, x: &self.x, u: &after, p: self.p };
            // At the very start the mode was chosen for what comes after the jump.
            let start = self.stats.steps == 0 && self.stats.events == 0;
            let mode = if start { self.system.settle(self.mode, at) } else { self.mode };
            self.system.flow(mode, at, &mut flow);
            after[own + 2 * k] = now;
            add_outer(1.0, &flow, &self.late[k].slope, nx + nf, &mut self.s);
        }
        jumping
    }

    /// The second half of [`Self::late_before`].
    fn late_after(&mut self, c: Context<'_>, jumping: &[usize]) {
        let Sizes { nx, nf, nu } = self.sizes;
        let (mut u, mut flow) = (vec![0.0; nu], vec![0.0; nx]);
        self.inputs.eval(c.interval, self.t, &mut u);
        self.system.flow(self.mode, Point { t: self.t, x: &self.x, u: &u, p: self.p }, &mut flow);
        for &k in jumping {
            add_outer(-1.0, &flow, &self.late[k].slope, nx + nf, &mut self.s);
        }
    }

    /// Flows to a time through any events before it.
    #[inline]
    fn flow_to(&mut self, end: f64) -> Result<(), Stop> {
        let mut at_one_instant = 0;
        while end - self.t > 1e-14 * self.t.abs().max(self.settings.step) {
            if self.stats.steps >= self.settings.max_steps {
                let (time, mode, limit) = (self.t, self.name(), self.settings.max_steps);
                return Err(Stop::StepLimit { time, mode, limit });
            }
            let before = self.t;
            self.step_to(end)?;
            at_one_instant = if self.t - before > 1e-13 * self.t.abs().max(1e-3) { 0 } else { at_one_instant + 1 };
            if at_one_instant > CHATTER {
                let event = self.events.last().map_or(String::new(), |e| e.name.clone());
                return Err(Stop::Chattering { time: self.t, mode: self.name(), event });
            }
        }
        self.t = end;
        Ok(())
    }

    /// One step towards `end`, or to the first event before it.
    #[inline]
    fn step_to(&mut self, end: f64) -> Result<(), Stop> {
        let h = end - self.t;
        let c = self.context(self.t + 0.5 * h);
        let jumping = if std::mem::take(&mut self.late_due) { self.late_before(c) } else { Vec::new() };
        if std::mem::take(&mut self.recheck)
            && let Some(guard) = self.watch.past(c, self.t, &self.x)
        {
            self.fire(c, guard, None)?;
            if !jumping.is_empty() {
                self.late_after(c, &jumping);
            }
            return Ok(());
        }
        if !jumping.is_empty() {
            self.late_after(c, &jumping);
        }
        let derivatives = self.settings.derivatives;
        self.work.step(c, self.t, h, &self.x, self.first_stage_known, derivatives);
        if let Some(state) = self.work.end().iter().position(|v| !v.is_finite()) {
            return Err(Stop::Escape { time: self.t, mode: self.name(), state: self.system.state_name(state) });
        }
        let span = Span { t: self.t, h, x0: &self.x };
        let Some(crossing) = self.watch.crossing(c, &mut self.work, span, &mut self.stats) else {
            self.accept(h, end);
            if derivatives {
                self.work.shift_jacobians();
            }
            self.first_stage_known = true;
            self.watch.advance();
            return Ok(());
        };
        let length = crossing.length;
        self.work.step(c, self.t, length, &self.x, true, derivatives);
        self.accept(length, if length == h { end } else { self.t + length });
        self.fire(c, crossing.guard, Some(&crossing))
    }

    /// Books a step of length `h`: time, error, sensitivities. The stages are in `work`.
    #[inline]
    fn accept(&mut self, h: f64, to: f64) {
        self.t = to;
        self.stats.steps += 1;
        if self.settings.derivatives {
            self.work.sensitivities(h, &mut self.s);
        }
        self.work.accept(&mut self.x, &mut self.largest, &mut self.error);
        self.steps_in[self.mode] += 1;
        // Asked for anew from time to time, so that a system may withdraw it and be heard again.
        if self.steps_in[self.mode].is_multiple_of(WORTHWHILE) && !self.settings.derivatives {
            self.stepper = self.system.stepper(self.mode);
        }
    }

    fn context(&self, middle: f64) -> Context<'a> {
        let interval = self.inputs.interval(middle);
        let Self { system, stepper, p, inputs, mode, .. } = *self;
        Context { system, stepper, p, inputs, mode, interval }
    }

    fn name(&self) -> String {
        self.system.mode_name(self.mode)
    }

    /// Carries out an event at the present time, and the ones that fall together with it. There is no `crossing` where the
    /// event time is fixed by a jump of the input or a tick.
    fn fire(&mut self, c: Context<'_>, guard: usize, crossing: Option<&Crossing>) -> Result<(), Stop> {
        let info = self.system.guards(self.mode)[guard].clone();
        self.jump(c, guard, crossing.map(|c| c.approach))?;
        self.zeno(&info.name, info.friction)?;
        for name in crossing.map_or(&[][..], |c| &c.also) {
            let next = self.system.guards(self.mode).iter().position(|g| g.name == *name);
            let Some(next) = next.filter(|&k| self.watch.at_or_past(k)) else { continue };
            self.jump(Context { mode: self.mode, ..c }, next, Some(0.0))?;
        }
        Ok(())
    }

    /// Reset, mode change and saltation of one guard; `approach` is the mean speed at which it came to zero, where its
    /// time follows the state.
    fn jump(&mut self, c: Context<'_>, guard: usize, approach: Option<f64>) -> Result<(), Stop> {
        let (before, t) = (self.mode, self.t);
        let info = self.system.guards(before)[guard].clone();
        let Sizes { nx, nf, nu } = self.sizes;
        let (mut u, mut u_rate) = (vec![0.0; nu], vec![0.0; nu]);
        self.inputs.eval(c.interval, t, &mut u);
        self.inputs.rate(c.interval, t, &mut u_rate);
        let at = Point { t, x: &self.x, u: &u, p: self.p };
        let mut rates = vec![0.0; self.system.guards(before).len()];
        self.system.guard_rates(before, at, &u_rate, &mut rates);
        let rate = rates[guard];
        if approach.is_some_and(|a| !info.friction && a > 0.0 && rate.abs() <= GRAZING * a) {
            return Err(Stop::Grazing { time: t, mode: self.name(), event: info.name });
        }
        let mut after = vec![0.0; nx];
        self.system.reset(before, guard, at, &mut after);
        if let Some(state) = after.iter().position(|v| !v.is_finite()) {
            return Err(Stop::Escape { time: t, mode: self.name(), state: self.system.state_name(state) });
        }
        let to = self.system.target(before, guard, Point { x: &after, ..at });
        if self.settings.derivatives {
            let mut g = vec![0.0; 2 + nx + nf + nu];
            let (mut f_before, mut f_after) = (vec![0.0; nx], vec![0.0; nx]);
            let mut reset = vec![0.0; 2 * nx + nx * nx + nx * nf + nx * nu];
            self.system.guard_jacobian(before, guard, at, &mut g);
            self.system.reset_jacobian(before, guard, at, &mut reset);
            self.system.flow(before, at, &mut f_before);
            self.system.flow(to, Point { x: &after, ..at }, &mut f_after);
            let g = (approach.is_some() && rate != 0.0).then_some(g.as_slice());
            saltation::apply(self.sizes, g, &reset, &f_before, &f_after, &u_rate, &mut self.s);
        }
        let x_before = std::mem::replace(&mut self.x, after);
        self.stats.events += 1;
        self.enter(to, false);
        self.events.push(Event { name: info.name, time: t, mode_before: before, mode_after: to });
        self.sliding(before, Point { t, x: &x_before, u: &u, p: self.p }, &u_rate)
    }

    /// Whether the flows of the mode left and of the mode entered push against each other, so that the motion would pass
    /// from one to the other without end.
    fn sliding(&self, before: usize, at: Point<'_>, u_rate: &[f64]) -> Result<(), Stop> {
        let Sizes { nx, nf, nu } = self.sizes;
        let here = Point { x: &self.x, ..at };
        for (k, rate) in self.watch.carried_past() {
            if before == self.mode || self.system.target(self.mode, k, here) != before {
                continue;
            }
            let (mut g, mut flow) = (vec![0.0; 2 + nx + nf + nu], vec![0.0; nx]);
            self.system.guard_jacobian(self.mode, k, here, &mut g);
            self.system.flow(before, at, &mut flow);
            if saltation::guard_rate(self.sizes, &g, &flow, u_rate) * rate < 0.0 {
                let event = self.system.guards(self.mode)[k].name.clone();
                return Err(Stop::Chattering { time: self.t, mode: self.name(), event });
            }
        }
        Ok(())
    }

    /// Enters a mode: guards are armed anew, slip or stick chosen where asked.
    fn enter(&mut self, mode: usize, settle: bool) {
        self.input();
        let at = Point { t: self.t, x: &self.x, u: &self.u, p: self.p };
        self.mode = if settle { self.system.settle(mode, at) } else { mode };
        self.first_stage_known = false;
        if self.steps_in.len() <= self.mode {
            self.steps_in.resize(self.mode + 1, 0);
        }
        let worthwhile = self.steps_in[self.mode] >= WORTHWHILE && !self.settings.derivatives;
        self.stepper = if worthwhile { self.system.stepper(self.mode) } else { None };
        let c = self.context(self.t + 1e-6 * self.settings.step);
        let guards = self.system.guards(self.mode);
        self.work.set_guards(guards.len());
        self.watch.enter(c, guards, at);
    }

    /// Carries out the ticks that are due now.
    fn tick_due(&mut self) -> Result<(), Stop> {
        let mut any = false;
        for i in 0..self.ticks.len() {
            let (every, offset) = (self.ticks[i].0.every, self.ticks[i].0.offset);
            if offset + self.ticks[i].1 as f64 * every > self.t + ON_GRID * self.settings.step {
                continue;
            }
            self.ticks[i].1 += 1;
            self.stats.ticks += 1;
            any = true;
            self.input();
            let Sizes { nx, nf, nu } = self.sizes;
            let at = Point { t: self.t, x: &self.x, u: &self.u, p: self.p };
            let mut after = vec![0.0; nx];
            self.system.tick(self.mode, i, at, &mut after);
            if let Some(state) = after.iter().position(|v| !v.is_finite()) {
                return Err(Stop::Escape { time: self.t, mode: self.name(), state: self.system.state_name(state) });
            }
            if self.settings.derivatives {
                let mut reset = vec![0.0; 2 * nx + nx * nx + nx * nf + nx * nu];
                self.system.tick_jacobian(self.mode, i, at, &mut reset);
                let still = vec![0.0; nx.max(nu)];
                saltation::apply(self.sizes, None, &reset, &still[..nx], &still[..nx], &still[..nu], &mut self.s);
            }
            self.x = after;
        }
        if any {
            self.first_stage_known = false;
            self.recheck = true;
        }
        Ok(())
    }

    /// Whether events accumulate: intervals that shrink geometrically and leave no time.
    fn zeno(&mut self, name: &str, friction: bool) -> Result<(), Stop> {
        let before_last = self.events.len().checked_sub(2).map(|k| self.events[k].time);
        if friction || before_last.is_none_or(|last| self.t - last > 1e4 * ZENO) {
            return Ok(());
        }
        let times: Vec<f64> =
            self.events.iter().rev().take(60).filter(|e| e.name == name).take(6).map(|e| e.time).collect();
        if times.len() < 6 {
            return Ok(());
        }
        let gaps: Vec<f64> = times.windows(2).map(|w| w[0] - w[1]).collect();
        let ratio = gaps[0] / gaps[1];
        if gaps.windows(2).all(|w| w[0] < w[1]) && ratio < 1.0 {
            let rest = gaps[0] * ratio / (1.0 - ratio);
            if rest < ZENO {
                let (time, mode) = (self.t, self.name());
                return Err(Stop::Zeno { time, accumulation: time + rest, mode, event: name.to_string() });
            }
        }
        Ok(())
    }
}

/// `s[.., last columns] += sign * flow * slope`, with `ns` columns.
fn add_outer(sign: f64, flow: &[f64], slope: &[f64], ns: usize, s: &mut [f64]) {
    for (row, f) in s.chunks_exact_mut(ns).zip(flow) {
        for (s, by) in row[ns - slope.len()..].iter_mut().zip(slope) {
            *s += sign * f * by;
        }
    }
}
