//! Level 5: the linear time-periodic system of a model around its periodic orbit, through events.
//!
//! Between events the orbit is found anew by collocation on Gauss nodes (order 24, so to rounding), and the derivatives of
//! flow and outputs are taken at the nodes. At an event with guard `g`, reset `R` and rates `f-`, `f+`, the event moves by
//! `dt = -(g_x dx + g_u du) / (g_x f- + g_t)`, hence
//! `S = R_x - (R_x f- + R_t - f+) g_x / (g_x f- + g_t)` and `E = R_u - (R_x f- + R_t - f+) g_u / (g_x f- + g_t)`.
//! A sampled update happens at its time whatever the state does: `S = R_x`, `E = R_u`.
//!
//! [`along()`] does without an orbit: along any reference, where there are no events.
//!
//! The engine's monodromy, integrated step by step with its own sensitivities, is the second route: it shares neither the
//! integration nor the saltation with this one.

mod along;

use nalgebra::{DMatrix, DVector};

pub use along::along;

use crate::cycle::{CycleEvent, LimitCycle};
use crate::error::{Error, Result};
use crate::model::system::without_past;
use crate::model::{Point, System};
use crate::numeric::gauss::Gauss;
use crate::periodic::Jump;
use crate::periodic::system::{LtpSystem, NODES, Segment, Size};

/// Legendre coefficients beyond which a stretch of the orbit counts as not resolved.
const RESOLVED: f64 = 1e-11;
/// Smallest stretch, in periods.
const SMALLEST: f64 = 1e-7;
/// Newton iterations of the collocation equations.
const ITERATIONS: usize = 30;

/// Linearizes a system around a periodic orbit, from its constant inputs to its outputs.
///
/// # Errors
/// `Shape` when orbit and system do not belong together; `Model` when an event of the orbit cannot be found in the system or
/// the schedule of a sampled update does not fit into the period; `NoConvergence` when the orbit is not resolved.
pub fn linearize(system: &dyn System, p: &[f64], cycle: &LimitCycle) -> Result<LtpSystem> {
    let size = Size { nx: system.states(), nu: system.inputs(), ny: system.outputs() };
    without_past(system, p, "linearize")?;
    if cycle.start.len() != size.nx {
        return Err(Error::Shape { what: "states of the orbit".into(), expected: size.nx, found: cycle.start.len() });
    }
    let local = Local { system, p, u: &cycle.inputs, size, gauss: Gauss::new(NODES), period: cycle.period };
    let mut segments: Vec<Segment> = Vec::new();
    let (mut t, mut x, mut mode) = (0.0, cycle.start.clone(), cycle.mode);
    let mut stops = happenings(system, p, cycle)?.into_iter().peekable();
    loop {
        let end = stops.peek().map_or(cycle.period, |s| s.time()).min(cycle.period);
        if end - t > 1e-12 * cycle.period {
            x = local.stretch(t, end, &x, mode, &mut segments)?;
            t = end;
        }
        let Some(stop) = stops.next() else { break };
        let (jump, after) = match &stop {
            Happening::Event(event) => local.event(event, &x, &mut mode)?,
            Happening::Tick(time, tick) => local.tick(*time, *tick, &x, mode),
        };
        match segments.last_mut() {
            Some(segment) => segment.jumps.push(jump),
            None => {
                let message =
                    format!("`{}` happens at the very start of the period; start the cycle elsewhere", jump.name);
                return Err(Error::Model { path: "linearize".into(), message });
            }
        }
        x = after;
    }
    LtpSystem::new(cycle.period, 0.0, size, segments)
}

/// Something that happens at an instant of the period.
enum Happening<'a> {
    Event(&'a CycleEvent),
    Tick(f64, usize),
}

impl Happening<'_> {
    fn time(&self) -> f64 {
        match self {
            Self::Event(event) => event.time,
            Self::Tick(time, _) => *time,
        }
    }
}

/// Events and sampled updates of one period in the order in which they happen.
fn happenings<'a>(system: &dyn System, p: &[f64], cycle: &'a LimitCycle) -> Result<Vec<Happening<'a>>> {
    let mut all: Vec<Happening<'a>> = cycle.events.iter().map(Happening::Event).collect();
    for (tick, schedule) in system.ticks(p).into_iter().enumerate() {
        let count = cycle.period / schedule.every;
        if (count - count.round()).abs() > 1e-9 * count.max(1.0) {
            let message = format!(
                "`{}` happens every {} s, which does not divide the period {} s: the motion is not periodic with it",
                schedule.name, schedule.every, cycle.period
            );
            return Err(Error::Model { path: "linearize".into(), message });
        }
        let first = schedule.offset.rem_euclid(schedule.every);
        // A tick at the start of the period belongs to its end: the start is the state after it.
        let first = if first <= 1e-12 * cycle.period { schedule.every } else { first };
        all.extend((0..count.round() as usize).map(|k| Happening::Tick(first + k as f64 * schedule.every, tick)));
    }
    all.sort_by(|a, b| a.time().total_cmp(&b.time()));
    Ok(all)
}

struct Local<'a> {
    system: &'a dyn System,
    p: &'a [f64],
    u: &'a [f64],
    size: Size,
    gauss: Gauss,
    period: f64,
}

impl Local<'_> {
    fn at<'b>(&'b self, t: f64, x: &'b [f64]) -> Point<'b> {
        Point { t, x, u: self.u, p: self.p }
    }

    /// Rates and their derivatives by state.
    fn slope(&self, mode: usize, t: f64, x: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let nx = self.size.nx;
        let mut all = vec![0.0; nx + nx * nx + nx * self.system.free().len()];
        self.system.flow_jacobian(mode, self.at(t, x), &mut all);
        all.truncate(nx + nx * nx);
        let a = all.split_off(nx);
        (all, a)
    }

    /// Segments from `start` to `end` in one mode, as long as the nodes resolve the orbit; the state at the end.
    fn stretch(&self, start: f64, end: f64, x: &[f64], mode: usize, out: &mut Vec<Segment>) -> Result<Vec<f64>> {
        let (mut t, mut x) = (start, x.to_vec());
        let mut h = (end - start).min(self.period / 32.0);
        while end - t > 1e-13 * self.period {
            // Two nearly equal steps rather than one and a sliver.
            let left = end - t;
            let step = if left <= h {
                left
            } else if left < 2.0 * h {
                0.5 * left
            } else {
                h
            };
            match self.collocate(t, step, &x, mode) {
                Some((segment, after, worst)) if worst <= RESOLVED => {
                    t = if step == left { end } else { t + step };
                    out.push(Segment { end: t, ..segment });
                    x = after;
                    if worst < 1e-3 * RESOLVED {
                        h = (1.5 * step).min(self.period / 8.0);
                    }
                }
                _ if step > SMALLEST * self.period => h = 0.5 * step,
                _ => {
                    return Err(Error::NoConvergence {
                        method: "collocation of the orbit".into(),
                        iterations: ITERATIONS,
                        residual: f64::NAN,
                        advice: format!(
                            "in mode `{}` at t = {t:.9} s the orbit is not smooth: a kink inside a mode (abs, sign, min, max, \
                             a table) has to become an event of its own",
                            self.system.mode_name(mode)
                        ),
                    });
                }
            }
        }
        Ok(x)
    }

    /// One segment: the state at its end, and the largest unresolved part of orbit or derivatives.
    fn collocate(&self, t: f64, h: f64, x0: &[f64], mode: usize) -> Option<(Segment, Vec<f64>, f64)> {
        let Size { nx, nu, ny } = self.size;
        let (q, g) = (NODES, &self.gauss);
        let time = |i: usize| t + g.nodes[i] * h;
        let mut x: Vec<Vec<f64>> = vec![x0.to_vec(); q];
        let mut size: Vec<f64> = x0.iter().map(|v| v.abs()).collect();
        let mut nodes: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
        let mut before = f64::INFINITY;
        for iteration in 0..ITERATIONS {
            nodes = (0..q).map(|i| self.slope(mode, time(i), &x[i])).collect();
            let mut matrix = DMatrix::<f64>::identity(q * nx, q * nx);
            let mut right = DVector::<f64>::zeros(q * nx);
            for i in 0..q {
                for r in 0..nx {
                    right[i * nx + r] = x0[r] - x[i][r];
                    size[r] = size[r].max(x[i][r].abs());
                }
                for j in 0..q {
                    let w = h * g.integral[i * q + j];
                    for r in 0..nx {
                        right[i * nx + r] += w * nodes[j].0[r];
                        for c in 0..nx {
                            matrix[(i * nx + r, j * nx + c)] -= w * nodes[j].1[r * nx + c];
                        }
                    }
                }
            }
            let step = matrix.lu().solve(&right)?;
            let mut change = 0.0_f64;
            for i in 0..q {
                for r in 0..nx {
                    x[i][r] += step[i * nx + r];
                    change = change.max(step[i * nx + r].abs() / size[r].max(1e-9));
                }
            }
            if !change.is_finite() {
                return None;
            }
            // Newton's method has ended when its steps are rounding and grow no smaller.
            if change < 1e-9 && change >= 0.5 * before || change == 0.0 {
                break;
            }
            if iteration + 1 == ITERATIONS {
                return None;
            }
            before = change;
        }
        let mut segment = Segment { start: t, end: t + h, a: vec![], b: vec![], c: vec![], d: vec![], jumps: vec![] };
        let nf = self.system.free().len();
        for i in 0..q {
            nodes[i] = self.slope(mode, time(i), &x[i]);
            segment.a.extend_from_slice(&nodes[i].1);
            let mut by_input = vec![0.0; (nx + ny) * nu];
            self.system.input_jacobian(mode, self.at(time(i), &x[i]), &mut by_input);
            segment.b.extend_from_slice(&by_input[..nx * nu]);
            segment.d.extend_from_slice(&by_input[nx * nu..]);
            let mut outputs = vec![0.0; ny + ny * nx + ny * nf];
            self.system.output_jacobian(mode, self.at(time(i), &x[i]), &mut outputs);
            segment.c.extend_from_slice(&outputs[ny..ny + ny * nx]);
        }
        let end = (0..nx).map(|r| x0[r] + h * (0..q).map(|j| g.weights[j] * nodes[j].0[r]).sum::<f64>()).collect();
        let worst_of = |block: &[f64], each: usize| {
            (0..each)
                .map(|k| g.tail(&block.iter().skip(k).step_by(each).copied().collect::<Vec<_>>()))
                .fold(0.0, f64::max)
        };
        let orbit: Vec<f64> = x.concat();
        let worst = [(&orbit, nx), (&segment.a, nx * nx), (&segment.b, nx * nu), (&segment.c, ny * nx)]
            .into_iter()
            .map(|(block, each)| worst_of(block, each))
            .fold(0.0, f64::max);
        Some((segment, end, worst))
    }

    /// The jump of an event, and the state after it; `mode` moves on.
    fn event(&self, event: &CycleEvent, x: &[f64], mode: &mut usize) -> Result<(Jump, Vec<f64>)> {
        let Size { nx, nu, .. } = self.size;
        let nf = self.system.free().len();
        let at = self.at(event.time, x);
        let guards = self.system.guards(*mode);
        let mut values = vec![0.0; guards.len()];
        self.system.guard_values(*mode, at, &mut values);
        // Slip has two guards of one name to leave stick by: the one that is at zero fired.
        let fired = (0..guards.len())
            .filter(|&k| guards[k].name == event.name)
            .min_by(|&a, &b| values[a].abs().total_cmp(&values[b].abs()));
        let Some(k) = fired.filter(|_| *mode == event.mode_before) else {
            let message = format!("mode `{}` has no event `{}`", self.system.mode_name(*mode), event.name);
            return Err(Error::Model { path: "linearize".into(), message });
        };
        let mut g = vec![0.0; 2 + nx + nf + nu];
        self.system.guard_jacobian(*mode, k, at, &mut g);
        let mut reset = vec![0.0; 2 * nx + nx * nx + nx * nf + nx * nu];
        self.system.reset_jacobian(*mode, k, at, &mut reset);
        let after = reset[..nx].to_vec();
        let (mut f_before, mut f_after) = (vec![0.0; nx], vec![0.0; nx]);
        self.system.flow(*mode, at, &mut f_before);
        self.system.flow(event.mode_after, self.at(event.time, &after), &mut f_after);
        let (gx, gt, gu) = (&g[1..1 + nx], g[1 + nx + nf], &g[2 + nx + nf..]);
        let rate = gx.iter().zip(&f_before).map(|(a, b)| a * b).sum::<f64>() + gt;
        if rate == 0.0 {
            let message =
                format!("`{}` is touched, not crossed, on the orbit (grazing): no linearization exists", event.name);
            return Err(Error::Model { path: "linearize".into(), message });
        }
        let (mut state, mut input) = split(&reset, nx, nf, nu);
        let by_time = &reset[nx + nx * nx + nx * nf..2 * nx + nx * nx + nx * nf];
        for r in 0..nx {
            let carried: f64 = (0..nx).map(|c| reset[nx + r * nx + c] * f_before[c]).sum();
            let difference = (carried + by_time[r] - f_after[r]) / rate;
            for c in 0..nx {
                state[r * nx + c] -= difference * gx[c];
            }
            for c in 0..nu {
                input[r * nu + c] -= difference * gu[c];
            }
        }
        *mode = event.mode_after;
        Ok((Jump { name: event.name.clone(), time: event.time, state, input }, after))
    }

    /// The jump of a sampled update, and the state after it.
    fn tick(&self, time: f64, tick: usize, x: &[f64], mode: usize) -> (Jump, Vec<f64>) {
        let Size { nx, nu, .. } = self.size;
        let nf = self.system.free().len();
        let mut reset = vec![0.0; 2 * nx + nx * nx + nx * nf + nx * nu];
        self.system.tick_jacobian(mode, tick, self.at(time, x), &mut reset);
        let (state, input) = split(&reset, nx, nf, nu);
        let name = self.system.ticks(self.p)[tick].name.clone();
        (Jump { name, time, state, input }, reset[..nx].to_vec())
    }
}

/// Derivatives of a reset by state and by input.
fn split(reset: &[f64], nx: usize, nf: usize, nu: usize) -> (Vec<f64>, Vec<f64>) {
    let last = 2 * nx + nx * nx + nx * nf;
    (reset[nx..nx + nx * nx].to_vec(), reset[last..last + nx * nu].to_vec())
}
