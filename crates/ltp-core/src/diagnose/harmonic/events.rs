//! Event times as measurements: when a touchdown or a liftoff happened, from the kink that it leaves in the outputs.
//!
//! The model runs freely along the recording. Around each of its events, what follows differs from what the mode before would
//! have gone on to do by a jump `J(s)`, `s` seconds after the event. An event that really came `delta` later leaves
//! `-delta dJ/ds` in the residual from there on, one whose jump has another size leaves `J`, and everything else is smooth:
//! least squares over all events of one name, with a cubic of their own for each, gives `delta` and its standard deviation.

use serde::Serialize;

use super::super::experiment::Experiment;
use super::super::isolability::{project, span};
use super::super::words::number;
use crate::model::{Compiled, Model, Point, System};
use crate::numeric::stats;
use crate::simulate::{self, Event, Plan, Trajectory};

/// Largest half of the window around an event, in mean distances between events of one name.
const WINDOW: f64 = 0.08;
/// Share of the distance to the next event of any name that a window may take.
const CLEAR: f64 = 0.45;
/// Fewest samples on either side.
const FEWEST: usize = 6;
/// Error over motion beyond which the model's events are not those of the recording.
const ASTRAY: f64 = 0.5;
/// Standard deviation over the mean distance of events beyond which their time is not measured.
const VAGUE: f64 = 0.02;

/// When the events of one name happened in one record, compared with the model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EventTime {
    /// Record.
    pub record: String,
    /// Transition.
    pub name: String,
    /// Mode before.
    pub mode_from: String,
    /// Mode after.
    pub mode_to: String,
    /// Measured minus predicted time, s: negative is early.
    pub residual_s: f64,
    /// One standard deviation, s.
    pub sd_s: f64,
    /// Phase of the predicted event in the cycle, in [0, 1); `None` without a clock.
    pub phase: Option<f64>,
    /// Events that it was measured from.
    pub count: usize,
}

impl EventTime {
    /// Whether it is off by more than so many standard deviations.
    pub fn is_off(&self, by: f64) -> bool {
        self.residual_s.abs() > by * self.sd_s
    }

    /// `touchdown 4 ms early`.
    pub fn sentence(&self) -> String {
        let way = if self.residual_s < 0.0 { "early" } else { "late" };
        format!(
            "{} comes {} ms {way} (sd {} ms, {} events)",
            self.name,
            number(1e3 * self.residual_s.abs()),
            number(1e3 * self.sd_s),
            self.count
        )
    }
}

/// A free run of a system along recordings, for the times of its events.
struct Along<'a> {
    system: &'a Compiled,
    p: &'a [f64],
    e: &'a Experiment,
    run: Trajectory,
    sigma: &'a [f64],
}

/// Event times of all records, measured minus predicted by the model with parameters `p` from the initial states `starts`.
///
/// `sigma` is the noise of each output, `substeps` the steps per sample. Records that the model does not follow leave a warning.
#[allow(clippy::too_many_arguments)] // a free run is described by as many things
pub fn event_times(
    model: &Model,
    system: &Compiled,
    p: &[f64],
    experiments: &[Experiment],
    starts: &[Vec<f64>],
    sigma: &[f64],
    substeps: u64,
    warnings: &mut Vec<String>,
) -> Vec<EventTime> {
    let mut out = Vec::new();
    if model.modes().len() < 2 {
        return out;
    }
    for (e, x0) in experiments.iter().zip(starts) {
        let Ok(plan) = Plan::new(e.dt, e.dt) else { continue };
        let mut plan = plan.from(x0);
        (plan.t0, plan.samples, plan.substeps) = (e.t0, e.len(), substeps);
        let Ok(run) = simulate::simulate(system, p, &e.inputs, &plan) else { continue };
        let along = Along { system, p, e, run, sigma };
        if along.lost() {
            warnings.push(format!(
                "recording `{}`: the model does not follow it closely enough for its events to be compared",
                e.name
            ));
            continue;
        }
        let mut kinds: Vec<(&str, usize, usize)> = Vec::new();
        for event in &along.run.events {
            let kind = (event.name.as_str(), event.mode_before, event.mode_after);
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
        }
        out.extend(kinds.into_iter().filter_map(|kind| along.measured(kind)));
    }
    out
}

impl Along<'_> {
    fn lost(&self) -> bool {
        let ny = self.e.outputs();
        self.run.t.len() < self.e.len()
            || (0..ny).any(|j| {
                let error = stats::rms(self.residual(j));
                error > ASTRAY * stats::std(self.e.output(j))
            })
    }

    fn residual(&self, j: usize) -> impl Iterator<Item = f64> + '_ {
        let ny = self.e.outputs();
        self.e.output(j).zip(self.run.outputs.iter().skip(j).step_by(ny)).map(|(m, y)| m - y)
    }

    /// The time of one kind of event.
    fn measured(&self, (name, from, to): (&str, usize, usize)) -> Option<EventTime> {
        let is = |e: &&Event| e.name == name && e.mode_before == from && e.mode_after == to;
        let events: Vec<&Event> = self.run.events.iter().filter(is).collect();
        let guard = self.system.guards(from).iter().position(|g| g.name == name && !g.friction)?;
        let span_of_all = events.last()?.time - events.first()?.time;
        let distance =
            if events.len() > 1 { span_of_all / (events.len() - 1) as f64 } else { self.e.len() as f64 * self.e.dt };
        let others: Vec<f64> = self.run.events.iter().map(|e| e.time).collect();
        let ny = self.e.outputs();
        let (mut residual, mut by_delay, mut by_size) = (Vec::new(), Vec::new(), vec![Vec::new(); ny]);
        let (mut single, mut rows, mut count) = (Vec::new(), 0, 0);
        for event in &events {
            let near =
                others.iter().map(|t| (t - event.time).abs()).filter(|d| *d > 1e-9).fold(f64::INFINITY, f64::min);
            let width = (WINDOW * distance).max((FEWEST as f64 + 1.0) * self.e.dt).min(CLEAR * near);
            let first = ((event.time - width - self.e.t0) / self.e.dt).ceil().max(0.0) as usize;
            let last = ((event.time + width - self.e.t0) / self.e.dt).floor() as usize;
            let split = ((event.time - self.e.t0) / self.e.dt).ceil() as usize;
            if last >= self.e.len() || split < first + FEWEST || last + 1 < split + FEWEST {
                continue;
            }
            let times: Vec<f64> = (first..=last).map(|k| self.e.t0 + k as f64 * self.e.dt - event.time).collect();
            let Some(jump) = self.jump(event, guard, &times) else { continue };
            let powers: Vec<Vec<f64>> = (0..4).map(|n| times.iter().map(|s| (s / width).powi(n)).collect()).collect();
            let smooth = span(&powers);
            let (mut own_r, mut own_d): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
            for j in 0..ny {
                let pick = |v: &[f64]| -> Vec<f64> { v.iter().map(|v| v / self.sigma[j]).collect() };
                let all: Vec<f64> = self.residual(j).skip(first).take(times.len()).collect();
                if all.iter().any(|v| !v.is_finite()) {
                    continue;
                }
                let mut columns = [pick(&all), pick(&jump.rate[j]), pick(&jump.size[j])];
                columns.iter_mut().for_each(|c| project(&smooth, c));
                let [r, d, s] = columns;
                rows += r.len() - 4;
                for (k, column) in by_size.iter_mut().enumerate() {
                    column.extend(if k == j { s.clone() } else { vec![0.0; r.len()] });
                }
                own_r.extend(&r);
                own_d.extend(&d);
            }
            let power: f64 = own_d.iter().map(|d| d * d).sum();
            if power > 0.0 {
                single.push(-own_d.iter().zip(&own_r).map(|(d, r)| d * r).sum::<f64>() / power);
            }
            residual.extend(own_r);
            by_delay.extend(own_d);
            count += 1;
        }
        let sizes = span(&by_size);
        project(&sizes, &mut residual);
        project(&sizes, &mut by_delay);
        let power: f64 = by_delay.iter().map(|d| d * d).sum();
        if rows <= 2 + ny || power <= 0.0 {
            return None;
        }
        let delay = -by_delay.iter().zip(&residual).map(|(d, r)| d * r).sum::<f64>() / power;
        let left: f64 = residual.iter().zip(&by_delay).map(|(r, d)| (r + delay * d).powi(2)).sum();
        let white = (left / (rows - 1 - ny) as f64).max(1.0).sqrt() / power.sqrt();
        // Events scatter by more than the noise of the sensor where the machine is not quite periodic.
        let scatter =
            if single.len() > 3 { stats::std(single.iter().copied()) / (single.len() as f64).sqrt() } else { 0.0 };
        let sd = white.max(scatter);
        let clock = self.system.period(self.p);
        (sd < VAGUE * distance).then(|| EventTime {
            record: self.e.name.clone(),
            name: name.to_string(),
            mode_from: self.system.mode_name(from),
            mode_to: self.system.mode_name(to),
            residual_s: delay,
            sd_s: sd,
            phase: clock.map(|t| phase(&events, t)),
            count,
        })
    }

    /// What the mode after an event does beyond what the mode before would have gone on to do, at times relative to it.
    fn jump(&self, event: &Event, guard: usize, times: &[f64]) -> Option<Jump> {
        let k = ((event.time - self.e.t0) / self.e.dt).floor() as usize;
        let nx = self.system.states();
        let at = self.e.t0 + k as f64 * self.e.dt;
        if *self.run.mode.get(k)? != event.mode_before {
            return None;
        }
        let x = self.flowed(event.mode_before, at, &self.run.states[k * nx..(k + 1) * nx], event.time - at);
        let mut after = vec![0.0; nx];
        let u = self.input(event.time);
        self.system.reset(event.mode_before, guard, Point { t: event.time, x: &x, u: &u, p: self.p }, &mut after);
        let ny = self.e.outputs();
        let mut jump = Jump { size: vec![Vec::new(); ny], rate: vec![Vec::new(); ny] };
        let h = 1e-3 * self.e.dt;
        let difference = |s: f64| -> Vec<f64> {
            let [a, b] = [(event.mode_after, &after), (event.mode_before, &x)].map(|(mode, x)| {
                let x = self.flowed(mode, event.time, x, s);
                let u = self.input(event.time + s);
                let mut y = vec![0.0; ny];
                self.system.output(mode, Point { t: event.time + s, x: &x, u: &u, p: self.p }, &mut y);
                y
            });
            a.iter().zip(b).map(|(a, b)| a - b).collect()
        };
        for s in times {
            let (size, rate) = if *s < 0.0 {
                (vec![0.0; ny], vec![0.0; ny])
            } else {
                let (now, next) = (difference(*s), difference(s + h));
                let rate = now.iter().zip(&next).map(|(a, b)| (b - a) / h).collect();
                (now, rate)
            };
            for j in 0..ny {
                jump.size[j].push(size[j]);
                jump.rate[j].push(rate[j]);
            }
        }
        jump.size.iter().chain(&jump.rate).flatten().all(|v| v.is_finite()).then_some(jump)
    }

    fn input(&self, t: f64) -> Vec<f64> {
        let mut u = vec![0.0; self.system.inputs()];
        self.e.inputs.eval(self.e.inputs.interval(t), t, &mut u);
        u
    }

    /// The state after `s` seconds in one mode, whatever its guards say: classical Runge-Kutta steps of half a sample.
    fn flowed(&self, mode: usize, t: f64, x: &[f64], s: f64) -> Vec<f64> {
        let steps = (2.0 * s / self.e.dt).ceil().max(1.0);
        let h = s / steps;
        let mut x = x.to_vec();
        let mut at = t;
        let slope = |t: f64, x: &[f64]| {
            let mut rates = vec![0.0; x.len()];
            self.system.flow(mode, Point { t, x, u: &self.input(t), p: self.p }, &mut rates);
            rates
        };
        let moved = |x: &[f64], k: &[f64], h: f64| -> Vec<f64> { x.iter().zip(k).map(|(x, k)| x + h * k).collect() };
        for _ in 0..steps as usize {
            let a = slope(at, &x);
            let b = slope(at + 0.5 * h, &moved(&x, &a, 0.5 * h));
            let c = slope(at + 0.5 * h, &moved(&x, &b, 0.5 * h));
            let d = slope(at + h, &moved(&x, &c, h));
            for i in 0..x.len() {
                x[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
            }
            at += h;
        }
        x
    }
}

/// A jump and its rate at the samples of a window, output by output.
struct Jump {
    size: Vec<Vec<f64>>,
    rate: Vec<Vec<f64>>,
}

/// Mean phase of events in a cycle of `period`, on the circle.
fn phase(events: &[&Event], period: f64) -> f64 {
    let (s, c) = events.iter().fold((0.0, 0.0), |(s, c), e| {
        let angle = std::f64::consts::TAU * e.time / period;
        (s + angle.sin(), c + angle.cos())
    });
    (s.atan2(c) / std::f64::consts::TAU).rem_euclid(1.0)
}
