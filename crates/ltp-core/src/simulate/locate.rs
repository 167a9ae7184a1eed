//! Guards: which are armed, which crossed within a step, and exactly when.
//!
//! A crossing is bracketed on the dense output, bisected there, and polished by repeating the step with the length
//! found until the guard of the *stepped* state is zero: the event time has the order of the integrator, not of its
//! interpolant. A guard at or past zero when its mode is entered is disarmed until it has been on the far side.

use super::step::{Context, Work};
use super::stop::Stats;
use crate::model::{Direction, Point, System};
use crate::numeric::root;

/// Accuracy of event times, s (or the resolution of time where that is coarser).
const TIME: f64 = 1e-13;
/// Events closer than this happen together, s.
const TOGETHER: f64 = 1e-12;

/// The first crossing within a step.
pub(super) struct Crossing {
    /// Guard.
    pub guard: usize,
    /// Length of the step up to it.
    pub length: f64,
    /// Names of guards that cross at the same time, in declared order.
    pub also: Vec<String>,
}

/// Guards of the mode at hand.
#[derive(Default)]
pub(super) struct Watch {
    /// Side on which an armed guard waits; zero when disarmed.
    side: Vec<f64>,
    directions: Vec<Direction>,
    now: Vec<f64>,
    next: Vec<f64>,
    /// Change over the step before.
    change: Vec<f64>,
    u: Vec<f64>,
    middle: Vec<f64>,
    values: Vec<f64>,
}

impl Watch {
    /// Arms the guards of a mode at the state in which it is entered.
    pub fn enter(&mut self, system: &dyn System, mode: usize, at: Point<'_>) {
        let guards = system.guards(mode);
        let n = guards.len();
        self.directions.clear();
        self.directions.extend(guards.iter().map(|g| g.direction));
        for v in [&mut self.now, &mut self.next, &mut self.values] {
            v.resize(n, 0.0);
        }
        self.change.clear();
        self.change.resize(n, f64::INFINITY);
        self.u.resize(at.u.len(), 0.0);
        self.middle.resize(at.x.len(), 0.0);
        system.guard_values(mode, at, &mut self.now);
        let arm = |(g, d): (&f64, &Direction)| if g.abs() <= 1e-15 { 0.0 } else { far_side(*g, *d) };
        self.side = self.now.iter().zip(&self.directions).map(arm).collect();
    }

    /// Whether a guard stands at or past zero at the start of the next step.
    pub fn at_or_past(&self, guard: usize) -> bool {
        let g = self.now[guard];
        match self.directions[guard] {
            Direction::Falling => g <= 1e-9,
            Direction::Rising => g >= -1e-9,
            Direction::Either => g.abs() <= 1e-9,
        }
    }

    /// The first armed guard that a jump of input or state has carried past zero.
    pub fn past(&mut self, c: Context<'_>, t: f64, x: &[f64]) -> Option<usize> {
        if self.side.is_empty() {
            return None;
        }
        c.inputs.eval(c.interval, t, &mut self.u);
        let at = Point { t, x, u: &self.u, p: c.p };
        c.system.guard_values(c.mode, at, &mut self.now);
        let hit = (0..self.side.len()).find(|&k| self.side[k] * self.now[k] < 0.0 && c.system.fires(c.mode, k, at));
        self.arm();
        hit
    }

    /// Accepts the step: its end is the next start.
    pub fn advance(&mut self) {
        for k in 0..self.now.len() {
            self.change[k] = (self.next[k] - self.now[k]).abs();
        }
        std::mem::swap(&mut self.now, &mut self.next);
        self.arm();
    }

    /// Arms disarmed guards that have reached their far side.
    fn arm(&mut self) {
        for k in 0..self.side.len() {
            if self.side[k] == 0.0 && self.now[k] != 0.0 {
                self.side[k] = far_side(self.now[k], self.directions[k]);
            }
        }
    }

    /// The first crossing within the step of length `h` whose stages and end are in `work`.
    pub fn crossing(
        &mut self,
        c: Context<'_>,
        work: &mut Work,
        t: f64,
        h: f64,
        x0: &[f64],
        stats: &mut Stats,
    ) -> Option<Crossing> {
        if self.side.is_empty() {
            return None;
        }
        c.inputs.eval(c.interval, t + h, &mut self.u);
        c.system.guard_values(c.mode, Point { t: t + h, x: &work.x, u: &self.u, p: c.p }, &mut self.next);
        let n = self.side.len();
        let near = |k: usize| {
            let (a, b) = (self.now[k], self.next[k]);
            self.side[k] != 0.0 && a.abs().min(b.abs()) < (b - a).abs() + self.change[k]
        };
        let crossed = |k: usize| self.side[k] * self.next[k] < 0.0;
        if !(0..n).any(|k| crossed(k) || near(k)) {
            return None;
        }
        let suspects: Vec<(usize, bool)> = (0..n).filter(|&k| crossed(k) || near(k)).map(|k| (k, crossed(k))).collect();
        work.prepare_dense(h);
        let mut hits: Vec<(usize, f64)> = Vec::new();
        for (k, crossed) in suspects {
            let inner = [0.25, 0.5, 0.75].into_iter().find(|&theta| {
                stats.bisections += 1;
                self.side[k] * self.on_dense(c, work, k, t, h, x0, theta) < 0.0
            });
            let Some(end) = inner.or(crossed.then_some(1.0)) else { continue };
            let start = (end - 0.25f64).max(0.0);
            let tolerance = (0.1 * TIME / h).max(1e-15);
            let side = self.side[k];
            let theta = root::bisect(
                |theta| {
                    stats.bisections += 1;
                    side * self.on_dense(c, work, k, t, h, x0, theta)
                },
                start,
                end,
                side,
                tolerance,
            )
            .after;
            let (x, u) = (&self.middle, &self.u);
            if c.system.fires(c.mode, k, Point { t: t + theta * h, x, u, p: c.p }) {
                hits.push((k, theta));
            } else {
                self.side[k] = 0.0; // passed without firing: armed again from the far side
            }
        }
        let first = hits.iter().map(|h| h.1).fold(f64::INFINITY, f64::min);
        let together = |theta: f64| (theta - first) * h <= TOGETHER;
        let &(guard, theta) = hits.iter().find(|(_, theta)| together(*theta))?;
        let length = self.polish(c, work, guard, t, h, x0, theta, stats);
        let guards = c.system.guards(c.mode);
        let others = hits.iter().filter(|(k, theta)| *k != guard && together(*theta));
        let also = others.map(|(k, _)| guards[*k].name.clone()).collect();
        Some(Crossing { guard, length, also })
    }

    /// A guard on the dense output; leaves the state there in `self.middle`.
    #[allow(clippy::too_many_arguments)]
    fn on_dense(&mut self, c: Context<'_>, work: &Work, k: usize, t: f64, h: f64, x0: &[f64], theta: f64) -> f64 {
        work.dense(x0, h, theta, &mut self.middle);
        let time = t + theta * h;
        c.inputs.eval(c.interval, time, &mut self.u);
        c.system.guard_values(c.mode, Point { t: time, x: &self.middle, u: &self.u, p: c.p }, &mut self.values);
        self.values[k]
    }

    /// Repeats the step with other lengths until the guard of its end is zero (secant, safeguarded by the bisected value).
    #[allow(clippy::too_many_arguments)]
    fn polish(
        &mut self,
        c: Context<'_>,
        work: &mut Work,
        k: usize,
        t: f64,
        h: f64,
        x0: &[f64],
        theta: f64,
        stats: &mut Stats,
    ) -> f64 {
        let mut stepped = |w: &mut Work, length: f64| {
            w.stages(c, t, length, x0, false, false);
            c.inputs.eval(c.interval, t + length, &mut self.u);
            c.system.guard_values(c.mode, Point { t: t + length, x: &w.x, u: &self.u, p: c.p }, &mut self.values);
            stats.polishes += 1;
            self.values[k]
        };
        let resolution = TIME.max(2.0 * f64::EPSILON * t.abs());
        let (mut a, mut b) = ((theta * h - 1e-3 * h).max(0.0), theta * h);
        let mut ga = if a == 0.0 { self.now[k] } else { stepped(work, a) };
        let mut gb = stepped(work, b);
        for _ in 0..6 {
            if gb == 0.0 || gb == ga {
                break;
            }
            let next = (b - gb * (b - a) / (gb - ga)).clamp(0.0, h);
            if (next - b).abs() <= resolution {
                return next;
            }
            (a, ga, b) = (b, gb, next);
            gb = stepped(work, b);
        }
        b
    }
}

/// The side on which a guard of this value waits for its crossing; zero when it stands on the near side.
fn far_side(g: f64, direction: Direction) -> f64 {
    match direction {
        Direction::Falling if g > 0.0 => 1.0,
        Direction::Rising if g < 0.0 => -1.0,
        Direction::Either => g.signum(),
        _ => 0.0,
    }
}
