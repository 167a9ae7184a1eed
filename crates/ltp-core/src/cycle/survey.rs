//! From how far an orbit attracts, and which other orbits there are; first guesses where no clock gives the period.
//!
//! Starts are scattered around the orbit by an explicit seed, along the coordinates that may be set in its starting mode, to
//! ever larger distances; each is simulated, and where it ends up is compared with the orbits already known.

use super::shoot::{Flow, Orbit};
use super::{LimitCycle, Options, cycle};
use crate::error::{Error, Result};
use crate::model::{Point, System};
use crate::numeric::rng::SplitMix64;
use crate::simulate::Inputs;

/// Periods after which a start has to have arrived.
const PERIODS: usize = 200;
/// Distance from an orbit, relative to its range, at which a start counts as arrived.
const ARRIVED: f64 = 1e-3;
/// Largest distance of a start, in ranges of the orbit.
const REACH: f64 = 2.0;

/// What was found around an orbit.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Number of starts.
    pub probes: usize,
    /// How many of them came back to the orbit.
    pub returned: usize,
    /// Largest distance, in ranges of the orbit, within which every start came back.
    pub radius: f64,
    /// Other orbits, with the number of starts that ended on each.
    pub others: Vec<(LimitCycle, usize)>,
    /// Starts that ended on no periodic orbit, with the reason.
    pub lost: Vec<(Vec<f64>, String)>,
}

/// Sends `probes` starts on their way and says where they ended.
///
/// # Errors
/// As [`cycle`], for options that cannot be.
pub fn survey(system: &dyn System, p: &[f64], orbit: &LimitCycle, probes: usize, seed: u64) -> Result<Survey> {
    let nx = orbit.start.len();
    let column = |i: usize| orbit.trajectory.states.iter().skip(i).step_by(nx).copied();
    let range: Vec<f64> =
        (0..nx).map(|i| column(i).fold(f64::MIN, f64::max) - column(i).fold(f64::MAX, f64::min)).collect();
    let inputs = Inputs::constant(&orbit.inputs);
    let flow = Flow { system, p, inputs: &inputs, steps: 500 };
    let free = settable(&flow, orbit);
    let mut random = SplitMix64::new(seed);
    let mut out = Survey { probes, returned: 0, radius: REACH, others: Vec::new(), lost: Vec::new() };
    for k in 0..probes {
        let distance = REACH * (k + 1) as f64 / probes as f64;
        let direction: Vec<f64> = (0..nx).map(|i| if free[i] { random.normal() } else { 0.0 }).collect();
        let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        let start: Vec<f64> = (0..nx).map(|i| orbit.start[i] + distance * range[i] * direction[i] / length).collect();
        let mut missed = || out.radius = out.radius.min(REACH * k as f64 / probes as f64);
        let end = arrive(&flow, orbit, &start);
        let (x, mode) = match end {
            Ok(end) => end,
            Err(why) => {
                missed();
                out.lost.push((start, why));
                continue;
            }
        };
        if mode == orbit.mode && near(&x, &orbit.start, &range) {
            out.returned += 1;
            continue;
        }
        missed();
        if let Some(known) =
            out.others.iter_mut().find(|(other, _)| mode == other.mode && near(&x, &other.start, &range))
        {
            known.1 += 1;
            continue;
        }
        let options = Options {
            start: Some(x),
            mode: Some(mode),
            period: Some(orbit.period),
            inputs: orbit.inputs.clone(),
            settle: Some(0),
            ..Options::default()
        };
        match cycle(system, p, &options) {
            Ok(mut other) => {
                other.found_from = start;
                out.others.push((other, 1));
            }
            Err(error) => out.lost.push((start, error.to_string())),
        }
    }
    Ok(out)
}

/// Coordinates that may be set in the orbit's starting mode: those that a mode holds still may not.
fn settable(flow: &Flow<'_>, orbit: &LimitCycle) -> Vec<bool> {
    let (nx, nf) = (orbit.start.len(), flow.system.free().len());
    let mut all = vec![0.0; nx + nx * nx + nx * nf];
    let at = Point { t: 0.0, x: &orbit.start, u: &orbit.inputs, p: flow.p };
    flow.system.flow_jacobian(orbit.mode, at, &mut all);
    (0..nx).map(|i| all[i] != 0.0 || all[nx + i * nx..nx + (i + 1) * nx].iter().any(|v| *v != 0.0)).collect()
}

/// Where a start is after many periods: at the clock's zero, or where it comes nearest to the orbit's start.
fn arrive(flow: &Flow<'_>, orbit: &LimitCycle, start: &[f64]) -> std::result::Result<(Vec<f64>, usize), String> {
    let (mut x, mut mode) = (start.to_vec(), orbit.mode);
    for _ in 0..PERIODS {
        let end = flow.go(0.0, orbit.period, 1.0, &x, mode, false).map_err(|stop| stop.sentence())?;
        (x, mode) = (end.x, end.mode);
    }
    if !orbit.autonomous {
        return Ok((x, mode));
    }
    let distance = |x: &[f64]| x.iter().zip(&orbit.start).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let mut best = (distance(&x), x.clone(), mode);
    let arc = orbit.period / 4000.0;
    for _ in 0..4000 {
        let end = flow.go(0.0, arc, 1.0 / 4000.0, &x, mode, false).map_err(|stop| stop.sentence())?;
        (x, mode) = (end.x, end.mode);
        if distance(&x) < best.0 {
            best = (distance(&x), x.clone(), mode);
        }
    }
    Ok((best.1, best.2))
}

fn near(x: &[f64], other: &[f64], range: &[f64]) -> bool {
    let largest = range.iter().copied().fold(0.0, f64::max);
    x.iter().zip(other).zip(range).all(|((a, b), r)| (a - b).abs() <= ARRIVED * r.max(1e-6 * largest))
}

/// A guess for an orbit of unknown period: settle, then the first return through the section across the flow. Where the
/// caller guesses the period and wants no settling, start and period are taken as they are.
pub(super) fn first_return(
    flow: &Flow<'_>,
    start: &[f64],
    mode: usize,
    guess: Option<f64>,
    settle: Option<usize>,
) -> Result<(Orbit, usize)> {
    if let (Some(period), Some(0)) = (guess, settle) {
        return Ok((Orbit { t0: 0.0, period, free: true, starts: vec![start.to_vec()], modes: vec![mode] }, 0));
    }
    let rates = flow.rates(0.0, start, mode);
    let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    if norm(&rates) == 0.0 {
        let message = "the start is an equilibrium: nothing moves; start elsewhere".into();
        return Err(Error::Model { path: "cycle".into(), message });
    }
    // A time in which the motion goes about as far as it is from the origin, finely cut; a guess of the period says it better.
    let pace = guess.unwrap_or_else(|| (norm(start).max(1e-3) / norm(&rates)).clamp(1e-3, 1e3) * std::f64::consts::TAU);
    let (cut, settled) = (2000, settle.unwrap_or(20));
    let dt = pace / f64::from(cut);
    let ended = |stop: crate::simulate::Stop| Error::NoConvergence {
        method: "shooting".into(),
        iterations: 0,
        residual: f64::INFINITY,
        advice: format!("the motion from the start ends: {}", stop.sentence()),
    };
    let (mut x, mut mode) = (start.to_vec(), mode);
    let local = Flow { steps: 1, ..*flow };
    for _ in 0..settled * cut as usize {
        let end = local.go(0.0, dt, 1.0, &x, mode, false).map_err(ended)?;
        (x, mode) = (end.x, end.mode);
    }
    let (origin, origin_mode) = (x.clone(), mode);
    let across = flow.rates(0.0, &origin, origin_mode);
    let side = |x: &[f64]| x.iter().zip(&origin).zip(&across).map(|((x, o), a)| (x - o) * a).sum::<f64>();
    let gap = |x: &[f64]| norm(&x.iter().zip(&origin).map(|(a, b)| a - b).collect::<Vec<_>>());
    let (mut before, mut farthest) = (0.0, 0.0_f64);
    for k in 1..=100 * cut {
        let end = local.go(0.0, dt, 1.0, &x, mode, false).map_err(ended)?;
        (x, mode) = (end.x, end.mode);
        farthest = farthest.max(gap(&x));
        let now = side(&x);
        if before < 0.0 && now >= 0.0 && mode == origin_mode && gap(&x) < 0.2 * farthest {
            let period = (f64::from(k) - now / (now - before)) * dt;
            let orbit = Orbit { t0: 0.0, period, free: true, starts: vec![origin], modes: vec![origin_mode] };
            return Ok((orbit, settled));
        }
        before = now;
    }
    Err(Error::NoConvergence {
        method: "first return".into(),
        iterations: 0,
        residual: gap(&x) / farthest.max(f64::MIN_POSITIVE),
        advice: format!(
            "within {:.3} s the motion does not come back through the section across its start; give a guess of the period, \
             or a start on the orbit",
            100.0 * pace
        ),
    })
}
