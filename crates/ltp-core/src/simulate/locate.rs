//! Guards: which are armed, which crossed within a step, and exactly when.
//!
//! A crossing is bracketed on the dense output, bisected there, and polished by repeating the step with the length
//! found until the guard of the *stepped* state is zero: the event time has the order of the integrator, not of its
//! interpolant. A guard at or past zero when its mode is entered is disarmed until it has been on the far side, unless
//! the flow carries it there at once, as a ball that has just bounced.

use super::step::{Context, Work};
use super::stop::Stats;
use crate::model::{Direction, Guard, Point};
use crate::numeric::root;

/// Accuracy of event times, s (or the resolution of time where that is coarser).
const TIME: f64 = 1e-13;
/// Events closer than this happen together, s.
const TOGETHER: f64 = 1e-12;
/// A guard that comes this near to zero without crossing, measured by how far it moved in a quarter step, is a touch.
const TOUCH: f64 = 1e-9;

/// The first crossing within a step.
pub(super) struct Crossing {
    /// Guard.
    pub guard: usize,
    /// Length of the step up to it.
    pub length: f64,
    /// Mean speed at which the guard came to zero; infinite when it only touched.
    pub approach: f64,
    /// Names of guards that cross at the same time, in declared order.
    pub also: Vec<String>,
}

/// What is known of a guard in the mode at hand.
#[derive(Clone, Copy)]
struct Armed {
    direction: Direction,
    friction: bool,
    /// Side on which it waits; zero when disarmed.
    side: f64,
    /// How far past zero still counts as zero: what was left of it by the event that led here.
    floor: f64,
    now: f64,
    next: f64,
    /// Change over the step before.
    change: f64,
    /// Rate at which the flow carries it past zero from the start on; zero where it does not.
    past: f64,
}

impl Armed {
    #[inline]
    fn crossed(&self, value: f64) -> bool {
        self.side * value < -self.floor
    }

    /// Whether it may have gone through zero and back within the step.
    #[inline]
    fn near(&self) -> bool {
        self.side != 0.0 && self.now.abs().min(self.next.abs()) < (self.next - self.now).abs() + self.change
    }

    /// Arms a disarmed guard that has reached its far side.
    fn arm(&mut self) {
        if self.side == 0.0 && self.now != 0.0 {
            let side = self.now.signum();
            self.side = if waits(self.direction) * side >= 0.0 { side } else { 0.0 };
        }
    }
}

/// The step at hand.
#[derive(Clone, Copy)]
pub(super) struct Span<'a> {
    pub t: f64,
    pub h: f64,
    pub x0: &'a [f64],
}

/// Guards of the mode at hand.
#[derive(Default)]
pub(super) struct Watch {
    guards: Vec<Armed>,
    u: Vec<f64>,
    middle: Vec<f64>,
    values: Vec<f64>,
    rates: Vec<f64>,
}

impl Watch {
    /// Arms the guards of a mode at the state in which it is entered.
    pub fn enter(&mut self, c: Context<'_>, guards: &[Guard], at: Point<'_>) {
        self.u.resize(at.u.len(), 0.0);
        self.middle.resize(at.x.len(), 0.0);
        self.values.resize(guards.len(), 0.0);
        self.rates.resize(guards.len(), 0.0);
        self.guards.clear();
        if guards.is_empty() {
            return;
        }
        c.inputs.rate(c.interval, at.t, &mut self.u);
        c.system.guard_values(c.mode, at, &mut self.values);
        c.system.guard_rates(c.mode, at, &self.u, &mut self.rates);
        let resolution = 4.0 * TIME.max(f64::EPSILON * at.t.abs());
        for ((info, &now), &rate) in guards.iter().zip(&self.values).zip(&self.rates) {
            let (direction, friction) = (info.direction, info.friction);
            let mut armed =
                Armed { direction, friction, side: 0.0, floor: 0.0, now, next: now, change: f64::INFINITY, past: 0.0 };
            if now.abs() > 1e-15 + resolution * rate.abs() {
                armed.arm();
            } else {
                armed.floor = 2.0 * now.abs();
                let leaving = if rate == 0.0 { 0.0 } else { rate.signum() };
                armed.side = match waits(direction) {
                    0.0 => leaving,
                    side if leaving == side => side,
                    _ => {
                        armed.past = rate;
                        0.0
                    }
                };
            }
            if friction {
                // Slip begins and stick ends at zero by nature: the allowed side is known, whatever rounding says.
                armed.side = waits(direction);
                armed.floor = if armed.side * now > 0.0 { 0.0 } else { 2.0 * now.abs() };
            }
            self.guards.push(armed);
        }
    }

    /// Guards that stood at zero when the mode was entered and that its flow carries past zero, with their rates.
    pub fn carried_past(&self) -> impl Iterator<Item = (usize, f64)> {
        self.guards.iter().enumerate().filter(|(_, g)| g.past != 0.0).map(|(k, g)| (k, g.past))
    }

    /// Whether a guard stands at or past zero where its mode was entered.
    pub fn at_or_past(&self, guard: usize) -> bool {
        let g = &self.guards[guard];
        match g.direction {
            Direction::Either => g.now.abs() <= 1e-9,
            d => waits(d) * g.now <= 1e-9,
        }
    }

    /// The first armed guard that a jump of input or state has carried past zero.
    pub fn past(&mut self, c: Context<'_>, t: f64, x: &[f64]) -> Option<usize> {
        if self.guards.is_empty() {
            return None;
        }
        c.inputs.eval(c.interval, t, &mut self.u);
        let at = Point { t, x, u: &self.u, p: c.p };
        c.system.guard_values(c.mode, at, &mut self.values);
        for (g, &value) in self.guards.iter_mut().zip(&self.values) {
            g.now = value;
        }
        let hit = (0..self.guards.len()).find(|&k| {
            let g = &self.guards[k];
            g.crossed(g.now) && c.system.fires(c.mode, k, at)
        });
        self.guards.iter_mut().for_each(Armed::arm);
        hit
    }

    /// Accepts the step: its end is the next start.
    #[inline]
    pub fn advance(&mut self) {
        for g in &mut self.guards {
            g.change = (g.next - g.now).abs();
            g.now = g.next;
            if g.side * g.now > g.floor {
                g.floor = 0.0;
            }
            g.arm();
        }
    }

    /// The first crossing within the step whose stages and end are in `work`. Where there is one, `work` is left with the
    /// step up to it.
    #[inline]
    pub fn crossing(&mut self, c: Context<'_>, work: &mut Work, span: Span<'_>, stats: &mut Stats) -> Option<Crossing> {
        let mut suspicious = false;
        for (g, &next) in self.guards.iter_mut().zip(work.guards()) {
            g.next = next;
            suspicious |= g.crossed(next) || g.near();
        }
        if suspicious { self.search(c, work, span, stats) } else { None }
    }

    fn search(&mut self, c: Context<'_>, work: &mut Work, span: Span<'_>, stats: &mut Stats) -> Option<Crossing> {
        let h = span.h;
        work.prepare_dense(h);
        let mut hits: Vec<(usize, f64)> = Vec::new();
        let mut touched: Option<(usize, f64)> = None;
        for k in 0..self.guards.len() {
            let g = self.guards[k];
            if !(g.crossed(g.next) || g.near()) {
                continue;
            }
            let (start, end) = match self.bracket(c, work, k, span, stats) {
                Found::Crossed(start, end) => (start, end),
                Found::Touched(theta) => {
                    if touched.is_none_or(|(_, first)| theta < first) && self.fires_at(c, work, k, span, theta) {
                        touched = Some((k, theta));
                    }
                    continue;
                }
                Found::Nothing => continue,
            };
            let tolerance = (0.1 * TIME / h).max(1e-15);
            let value = |theta| {
                stats.bisections += 1;
                g.side * self.on_dense(c, work, k, span, theta)
            };
            let theta = root::bisect(value, start, end, g.side.abs(), tolerance).after;
            if self.fires_at(c, work, k, span, theta) {
                hits.push((k, theta));
            } else {
                self.guards[k].side = 0.0; // passed without firing: armed again from the far side
            }
        }
        let first = hits.iter().map(|h| h.1).fold(f64::INFINITY, f64::min);
        if let Some((guard, theta)) = touched.filter(|(_, theta)| *theta < first) {
            return Some(Crossing { guard, length: theta * h, approach: f64::INFINITY, also: Vec::new() });
        }
        let together = |theta: f64| (theta - first) * h <= TOGETHER;
        let &(guard, theta) = hits.iter().find(|(_, theta)| together(*theta))?;
        let length = self.polish(c, work, guard, span, theta, stats);
        // Whatever else has crossed at the polished end happens with it: the dense output may order events falsely.
        let declared = c.system.guards(c.mode);
        let also = (0..declared.len())
            .filter(|&k| k != guard && hits.iter().any(|hit| hit.0 == k))
            .filter(|&k| self.guards[k].crossed(work.guards()[k]) || hits.iter().any(|h| h.0 == k && together(h.1)))
            .map(|k| declared[k].name.clone())
            .collect();
        let approach = if length > 0.0 { self.guards[guard].now.abs() / length } else { 0.0 };
        Some(Crossing { guard, length, approach, also })
    }

    /// Brackets the first crossing of a guard: quarter points, then the lowest point between them.
    fn bracket(&mut self, c: Context<'_>, work: &Work, k: usize, span: Span<'_>, stats: &mut Stats) -> Found {
        let g = self.guards[k];
        let mut values = [g.side * g.now, 0.0, 0.0, 0.0, g.side * g.next];
        for (i, value) in values.iter_mut().enumerate().skip(1) {
            if i < 4 {
                stats.bisections += 1;
                *value = g.side * self.on_dense(c, work, k, span, 0.25 * i as f64);
            }
            if *value < -g.floor {
                return Found::Crossed(0.25 * (i - 1) as f64, 0.25 * i as f64);
            }
        }
        let Some(i) = (1..4).find(|&i| values[i] < values[i - 1] && values[i] < values[i + 1]) else {
            return Found::Nothing;
        };
        let (before, at, after) = (values[i - 1], values[i], values[i + 1]);
        let theta = 0.25 * (i as f64 + 0.5 * (before - after) / (before - 2.0 * at + after));
        stats.bisections += 1;
        let lowest = g.side * self.on_dense(c, work, k, span, theta);
        if lowest < -g.floor {
            Found::Crossed(0.25 * (i - 1) as f64, theta)
        } else if !g.friction && lowest <= TOUCH * before.max(after) {
            Found::Touched(theta)
        } else {
            Found::Nothing
        }
    }

    fn fires_at(&mut self, c: Context<'_>, work: &Work, k: usize, span: Span<'_>, theta: f64) -> bool {
        self.on_dense(c, work, k, span, theta);
        c.system.fires(c.mode, k, Point { t: span.t + theta * span.h, x: &self.middle, u: &self.u, p: c.p })
    }

    /// A guard on the dense output; leaves the state there in `self.middle`.
    fn on_dense(&mut self, c: Context<'_>, work: &Work, k: usize, span: Span<'_>, theta: f64) -> f64 {
        work.dense(span.x0, span.h, theta, &mut self.middle);
        let time = span.t + theta * span.h;
        c.inputs.eval(c.interval, time, &mut self.u);
        c.system.guard_values(c.mode, Point { t: time, x: &self.middle, u: &self.u, p: c.p }, &mut self.values);
        self.values[k]
    }

    /// Repeats the step with other lengths until the guard of its end is zero (secant, safeguarded by the bisected value).
    fn polish(
        &mut self,
        c: Context<'_>,
        work: &mut Work,
        k: usize,
        span: Span<'_>,
        theta: f64,
        stats: &mut Stats,
    ) -> f64 {
        let Span { t, h, x0 } = span;
        let mut stepped = |length: f64| {
            work.step(c, t, length, x0, true, false);
            stats.polishes += 1;
            work.guards()[k]
        };
        let resolution = TIME.max(2.0 * f64::EPSILON * t.abs());
        // Close enough that the chord does not reach back to an event at the start of the step.
        let (mut a, mut b) = (0.999 * theta * h, theta * h);
        let mut ga = stepped(a);
        let mut gb = stepped(b);
        for _ in 0..6 {
            if gb == 0.0 || gb == ga {
                break;
            }
            let next = (b - gb * (b - a) / (gb - ga)).clamp(0.0, h);
            let close = (next - b).abs() <= resolution;
            (a, ga, b) = (b, gb, next);
            gb = stepped(b);
            if close {
                break;
            }
        }
        b
    }
}

/// What a search for a crossing within a step found, in fractions of the step.
enum Found {
    Nothing,
    Crossed(f64, f64),
    Touched(f64),
}

/// The side on which a guard of this direction waits; zero where both will do.
fn waits(direction: Direction) -> f64 {
    match direction {
        Direction::Falling => 1.0,
        Direction::Rising => -1.0,
        Direction::Either => 0.0,
    }
}
