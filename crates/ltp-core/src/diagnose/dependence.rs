//! On what a series depends: the variable that explains most of it on left-out blocks, and the chance that it is chance.
//!
//! Each variable is a group of columns: itself, indicators, harmonics or splines. Simple groups come first, and a richer one
//! must explain a good part of what a simpler one leaves.

use std::f64::consts::TAU;

use super::hypothesis::rate;
use super::places::waves;
use super::result::{Estimate, Force};
use crate::numeric::rng::SplitMix64;
use crate::numeric::spline::BSplines;
use crate::numeric::{regression, stats};

/// Draws of the permutation test. The smallest p-value is one over this plus one, times the number of groups: each of them
/// had its chance to look best, and Bonferroni's bound needs no more draws of the others.
const DRAWS: usize = 999;
/// Speed below which a port counts as at rest, relative to its rms speed.
const REST: f64 = 0.05;
/// Pieces of the splines for laws that are smooth over the range of motion, for laws that repeat within it (a cogging
/// motor, a gear), and for drift in time.
const SMOOTH: usize = 8;
const RIPPLED: usize = 40;
const DRIFT: usize = 3;
/// Harmonics of the clock.
const HARMONICS: usize = 4;
/// Events below which the time since one says nothing.
const EVENTS: usize = 8;
/// Blocks that are left out in turn: long against the memory of the motion, short against the time in which it comes back to
/// the same positions and speeds, since a law cannot be judged where it was never seen.
const BLOCKS: usize = 25;
/// Share of what a simpler group leaves that a richer one must explain to be named instead.
const RICHER: f64 = 0.5;
/// Times that a wave must have been seen to be said to repeat.
const REPEATS: f64 = 2.5;
/// Share below which a group explains nothing.
const LEAST: f64 = 0.02;
/// Rates of strange clocks relative to the machine's own, and how close to it, in lines that the records can part.
const RATES: (f64, f64) = (0.5, 2.0);
const APART: f64 = 2.0;
/// What a series depends on that never changes.
pub const CONSTANT: &str = "nothing: it is constant";
/// What is said where no group explains anything.
pub const NOTHING: &str = "nothing it was tested against";
/// Samples kept for the regression.
const KEPT: usize = 2000;

/// Columns of one variable.
struct Group {
    name: String,
    columns: Vec<Vec<f64>>,
    /// Harmonics of a clock: a shift leaves them as good as they are.
    clocked: bool,
}

impl Group {
    fn new(name: impl Into<String>, columns: Vec<Vec<f64>>) -> Self {
        Self { name: name.into(), columns, clocked: false }
    }
}

/// What a series along the records depends on, and the probability that this is chance.
pub fn depends_on(forces: &[Force], seed: u64) -> (String, f64) {
    let thin = Thin::new(forces);
    let w = thin.pick(|f| f.force.clone());
    let v = scaled(&thin.pick(|f| f.velocity.clone()));
    let port = forces.first().is_none_or(|f| f.kind != "output" && f.kind != "input");
    // At rest dry friction takes whatever value holds: those samples say nothing about the law.
    let rests = |v: &f64| port && v.abs() < REST;
    let w: Vec<f64> = w.iter().zip(&v).map(|(w, v)| if rests(v) { f64::NAN } else { *w }).collect();
    // What nominal parameters could still explain.
    let free = forces.first().map_or(0, |f| f.imitable.len());
    let base: Vec<Vec<f64>> = (0..free)
        .map(|c| scaled(&thin.pick(|f| f.imitable[c].clone())))
        .filter(|column| stats::std(column.iter().copied()) > 1e-9)
        .collect();
    let level = stats::mean(w.iter().copied()).abs();
    let doubt = stats::median(&thin.pick(|f| f.sd.clone()));
    if level > stats::std(w.iter().copied()).max(3.0 * doubt) {
        return (CONSTANT.into(), 1.0 / (DRAWS + 1) as f64);
    }
    let groups = groups(&thin, &v);
    let mut base = base.as_slice();
    let mut tried = groups.len();
    let mut best = strongest(&w, base, &groups);
    if best.is_none() && !base.is_empty() {
        // Where nominal parameters could say it all, what the force follows is still worth knowing.
        base = &[];
        tried += groups.len();
        best = strongest(&w, base, &groups);
    }
    let Some(group) = best else { return (NOTHING.into(), 1.0) };
    let p = if group.clocked {
        let strangers = thin.strange_clocks(seed).map(|rate| thin.harmonics(rate));
        regression::stranger_p_value(&w, base, &group.columns, strangers)
    } else {
        regression::shift_p_value(&w, base, &group.columns, DRAWS, seed)
    };
    (group.name.clone(), if p.is_finite() { (p * tried as f64).min(1.0) } else { 1.0 })
}

/// How far on a series repeats over position or over time, where it follows no other variable: the strongest line of its
/// periodogram, if that one sine explains half of it on left-out blocks.
pub fn repeats(forces: &[Force], variable: &str) -> Option<Estimate> {
    let first = forces.first()?;
    let thin = Thin::new(forces);
    let (x, step, unit) = match variable {
        "position" => {
            (thin.pick(|f| f.position.clone()), *waves(forces, None).lengths.first()?, first.position_unit.clone())
        }
        "time" | NOTHING => (thin.pick(|f| f.t.clone()), TAU / waves(forces, None).omegas.first()?, "s".to_string()),
        _ => return None,
    };
    let seen = (stats::quantile(&x, 0.995) - stats::quantile(&x, 0.005)) / step;
    let wave = |of: fn(f64) -> f64| x.iter().map(|x| of(TAU * x / step)).collect::<Vec<f64>>();
    let share = regression::explained(&thin.pick(|f| f.force.clone()), &[wave(f64::sin), wave(f64::cos)], BLOCKS);
    (seen > REPEATS && share > RICHER).then_some(Estimate { value: step, sd: None, unit })
}

/// The group of columns that explains most of a series beyond a base.
fn strongest<'a>(w: &[f64], base: &[Vec<f64>], groups: &'a [Group]) -> Option<&'a Group> {
    let own = if base.is_empty() { 0.0 } else { regression::explained(w, base, BLOCKS).max(0.0) };
    let mut best: (Option<&Group>, f64) = (None, 0.0);
    for group in groups {
        let mut all = base.to_vec();
        all.extend(group.columns.iter().cloned());
        let share = regression::explained(w, &all, BLOCKS) - own;
        // A later, richer group must explain a good part of what a simpler one leaves.
        let left = if best.0.is_some() { RICHER * (1.0 - own - best.1) } else { 0.0 };
        if share > best.1 + left.max(LEAST) {
            best = (Some(group), share);
        }
    }
    best.0
}

/// Everything that a series is held against, simple before rich.
fn groups(thin: &Thin<'_>, v: &[f64]) -> Vec<Group> {
    let forces = thin.forces;
    let q = scaled(&thin.pick(|f| f.position.clone()));
    let own = forces.first().map_or("", |f| f.kind.as_str());
    let smooth = |x: &[f64]| [vec![x.to_vec()], splines(x, SMOOTH)].concat();
    let mut out = Vec::new();
    if !matches!(own, "output" | "input") {
        out.push(Group::new("sign of velocity", vec![v.iter().map(|v| v.signum()).collect()]));
    }
    out.push(Group::new("mode", thin.modes()));
    match own {
        "output" => {
            out.push(Group::new("the measured value", smooth(&q)));
            out.push(Group::new("rate of the measured value", smooth(v)));
        }
        // An input's own value and rate are among those of all inputs.
        "input" => {}
        _ => {
            let drag: Vec<f64> = v.iter().map(|v| v * v.abs()).collect();
            out.push(Group::new("velocity", [vec![v.to_vec(), drag], splines(v, SMOOTH)].concat()));
            out.push(Group::new("position", smooth(&q)));
            out.push(Group::new("position", splines(&q, RIPPLED)));
        }
    }
    out.push(Group::new("time", splines(&thin.pick(|f| f.t.clone()), DRIFT)));
    let names = forces.first().map_or(&[][..], |f| &f.input_names);
    let dt = forces.iter().find(|f| f.t.len() > 1).map_or(1.0, |f| f.t[1] - f.t[0]);
    for (i, name) in names.iter().enumerate() {
        let u = thin.pick(|f| f.inputs[i].clone());
        if stats::std(u.iter().copied()) > 1e-9 * stats::rms(u.iter().copied()) {
            out.push(Group::new(format!("input `{name}`"), smooth(&scaled(&u))));
            let slope = scaled(&thin.pick(|f| rate(&f.inputs[i], dt)));
            out.push(Group::new(format!("rate of input `{name}`"), smooth(&slope)));
        }
    }
    out.push(Group { clocked: true, ..Group::new("phase of the cycle", thin.harmonics(1.0)) });
    out.push(Group::new("time since the last event", thin.since()));
    out.retain(|g| !g.columns.is_empty());
    out
}

/// The records' series, thinned to what a regression needs.
struct Thin<'a> {
    forces: &'a [Force],
    every: usize,
}

impl<'a> Thin<'a> {
    fn new(forces: &'a [Force]) -> Self {
        let total: usize = forces.iter().map(|f| f.t.len()).sum();
        Self { forces, every: total.div_ceil(KEPT).max(1) }
    }

    /// A series of every record, one after the other.
    fn pick(&self, of: impl Fn(&Force) -> Vec<f64>) -> Vec<f64> {
        self.forces.iter().flat_map(|f| of(f).into_iter().step_by(self.every)).collect()
    }

    /// Indicators of all modes but the first.
    fn modes(&self) -> Vec<Vec<f64>> {
        let mut names: Vec<&String> = Vec::new();
        for name in self.forces.iter().flat_map(|f| &f.modes) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let of = |f: &Force, name: &String| f.mode.iter().map(|m| f64::from(u8::from(f.modes[*m] == *name))).collect();
        names.iter().skip(1).map(|name| self.pick(|f| of(f, name))).collect()
    }

    /// Harmonics of a clock that goes at a rate relative to the machine's own; none where there is no clock.
    fn harmonics(&self, rate: f64) -> Vec<Vec<f64>> {
        if self.forces.iter().any(|f| f.period.is_none()) {
            return Vec::new();
        }
        let turn = |f: &Force, k: usize, t: f64| TAU * (k as f64) * rate * t / f.period.unwrap_or(1.0);
        let of = |k, wave: fn(f64) -> f64| self.pick(move |f| f.t.iter().map(|t| wave(turn(f, k, *t))).collect());
        (1..=HARMONICS).flat_map(|k| [of(k, f64::sin), of(k, f64::cos)]).collect()
    }

    /// Rates of clocks that have nothing to do with the machine's own.
    fn strange_clocks(&self, seed: u64) -> impl Iterator<Item = f64> {
        let cycles = |f: &Force| f.t.last().map_or(0.0, |t| t - f.t[0]) / f.period.unwrap_or(1.0);
        let longest = self.forces.iter().map(cycles).fold(1.0, f64::max);
        let apart = (APART / longest).min(0.4);
        let mut random = SplitMix64::new(seed);
        let draw = move || RATES.0 * (RATES.1 / RATES.0).powf(random.uniform());
        std::iter::repeat_with(draw).filter(move |rate| (rate - 1.0).abs() > apart).take(DRAWS)
    }

    /// A smooth function of the time since the last change of mode. Before a record's first event there is none, and the
    /// columns are zero.
    fn since(&self) -> Vec<Vec<f64>> {
        let events = |f: &Force| f.mode.windows(2).filter(|m| m[0] != m[1]).count();
        if self.forces.iter().map(events).sum::<usize>() < EVENTS {
            return Vec::new();
        }
        let since = |f: &Force| {
            let mut last = f64::NAN;
            let mut before = f.mode.first();
            let age = |(t, m): (&f64, _)| {
                if before.replace(m) != Some(m) {
                    last = *t;
                }
                t - last
            };
            f.t.iter().zip(&f.mode).map(age).collect()
        };
        splines(&self.pick(since), SMOOTH)
    }
}

fn scaled(x: &[f64]) -> Vec<f64> {
    let s = stats::rms(x.iter().copied()).max(f64::MIN_POSITIVE);
    x.iter().map(|x| x / s).collect()
}

/// A smooth function of a series: its cubic B-splines between the one-percent quantiles, the first left out because a
/// constant is always part of a regression; zero in gaps, none where the series does not vary.
fn splines(x: &[f64], pieces: usize) -> Vec<Vec<f64>> {
    let (low, high) = (stats::quantile(x, 0.01), stats::quantile(x, 0.99));
    let Ok(basis) = BSplines::new(low, high, pieces) else { return Vec::new() };
    let row = |x: &f64| if x.is_finite() { basis.row(x.clamp(low, high)) } else { vec![0.0; basis.len()] };
    let rows: Vec<Vec<f64>> = x.iter().map(row).collect();
    (1..basis.len()).map(|j| rows.iter().map(|r| r[j]).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sum of sines with irregular frequencies: nothing comes back to where it was.
    fn smooth(t: &[f64], speed: f64, seed: u64) -> Vec<f64> {
        let mut random = SplitMix64::new(seed);
        let parts: Vec<(f64, f64)> =
            (0..8).map(|_| (speed * (0.3 + random.uniform()), 6.3 * random.uniform())).collect();
        t.iter().map(|t| parts.iter().map(|(w, p)| (w * t + p).sin()).sum()).collect()
    }

    /// A record of 40 s of a hopping machine with a clock of 0.7 s and an input, none of which knows of the others; its
    /// missing force is `of(sample)` and noise.
    fn record(seed: u64, noise: f64, of: impl Fn(&Force, usize) -> f64) -> Vec<Force> {
        let mut random = SplitMix64::new(seed);
        let t: Vec<f64> = (0..8000).map(|k| 0.005 * f64::from(k)).collect();
        let mut f = Force {
            kind: "port".into(),
            position: smooth(&t, 4.0, seed + 1),
            velocity: smooth(&t, 4.0, seed + 2),
            inputs: vec![smooth(&t, 6.0, seed + 3)],
            input_names: vec!["u".into()],
            modes: vec!["flight".into(), "stance".into()],
            period: Some(0.7),
            phase: t.iter().map(|t| (t / 0.7).fract()).collect(),
            sd: vec![noise; t.len()],
            ..Force::default()
        };
        // Steps of irregular length.
        let (mut mode, mut left) = (0, 0.0);
        for _ in &t {
            if left <= 0.0 {
                (mode, left) = (1 - mode, 0.3 + 0.5 * random.uniform());
            }
            f.mode.push(mode);
            left -= 0.005;
        }
        f.t = t;
        f.force = (0..f.t.len()).map(|k| of(&f, k) + noise * random.normal()).collect();
        vec![f]
    }

    /// Seconds since the mode of a sample began.
    fn since(f: &Force, k: usize) -> f64 {
        let begin = (1..=k).rev().find(|&i| f.mode[i] != f.mode[i - 1]);
        begin.map_or(0.0, |b| f.t[k] - f.t[b])
    }

    #[test]
    fn each_variable_is_told_from_all_others() {
        type Of = fn(&Force, usize) -> f64;
        let cases: [(&str, Of); 10] = [
            ("sign of velocity", |f, k| -f.velocity[k].signum()),
            ("velocity", |f, k| -f.velocity[k].powi(3)),
            ("position", |f, k| f.position[k].powi(2)),
            ("mode", |f, k| if f.mode[k] == 1 { 1.0 } else { 0.0 }),
            ("phase of the cycle", |f, k| (TAU * f.phase[k]).sin() + (2.0 * TAU * f.phase[k] + 1.0).cos()),
            ("time since the last event", |f, k| (-since(f, k) / 0.1).exp()),
            ("input `u`", |f, k| 0.2 * f.inputs[0][k].powi(3)),
            ("rate of input `u`", |f, k| {
                let last = f.t.len() - 1;
                let (a, b) = (k.saturating_sub(1), (k + 1).min(last));
                (f.inputs[0][b] - f.inputs[0][a]) / (f.t[b] - f.t[a])
            }),
            ("time", |f, k| f.t[k] / 20.0 - 1.0),
            (CONSTANT, |_, _| 3.0),
        ];
        for (name, of) in cases {
            let (variable, p) = depends_on(&record(3, 0.2, of), 1);
            assert_eq!(variable, name);
            assert!(p <= 0.02, "{name}: p = {p}");
        }
    }

    #[test]
    fn a_force_that_follows_none_of_them_is_seldom_said_to() {
        // Forces as smooth as the motion, and strangers to it. The p-value of the best of ten must not be that of one.
        let strange = |seed: u64| {
            let wild = smooth(&(0..8000).map(|k| 0.005 * f64::from(k)).collect::<Vec<_>>(), 5.0, 1000 + seed);
            depends_on(&record(10 * seed, 0.1, |_, k| wild[k]), seed).1
        };
        let said = (0..40).filter(|seed| strange(*seed) <= 0.05).count();
        assert!(said <= 4, "{said} of 40 strangers passed for causes");
    }

    #[test]
    fn what_repeats_says_how_far_on() {
        let gear = record(7, 0.1, |f, k| (TAU * f.position[k] / 0.9).sin());
        assert_eq!(depends_on(&gear, 1).0, "position");
        let step = repeats(&gear, "position").unwrap();
        assert!((step.value - 0.9).abs() < 0.05, "{step:?}");
        let hum = record(8, 0.1, |f, k| (TAU * f.t[k] / 0.31).sin());
        let step = repeats(&hum, &depends_on(&hum, 1).0).unwrap();
        assert!((step.value - 0.31).abs() < 0.01 && step.unit == "s", "{step:?}");
        // A spring repeats nothing.
        assert_eq!(repeats(&record(9, 0.1, |f, k| -f.position[k]), "position"), None);
    }

    #[test]
    fn a_sensor_is_off_by_what_it_measures() {
        let mut forces = record(5, 0.02, |f, k| 0.3 * f.position[k]);
        forces[0].kind = "output".into();
        let (variable, p) = depends_on(&forces, 1);
        assert_eq!(variable, "the measured value");
        assert!(p <= 0.02);
    }
}
