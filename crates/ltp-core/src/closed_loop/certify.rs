//! Every witness on whether a closed loop is stable, called in turn.
//!
//! The lift `A - N` of the loop along the reference (truncated, so its edge lies), the exact Floquet exponents along the
//! reference (which need not be an orbit), the orbit that the nonlinear loop really has with its own exponents, runs from
//! given deviations with the largest ones that come back, and other parameter values. [`Verdict`] weighs them.

use rayon::prelude::*;

use super::close::{check, close};
use super::orbit::{Orbit, slowest};
use super::run::{Loop, Run};
use super::spread::Spread;
use super::verdict::Verdict;
use crate::error::{Error, Result};
use crate::feedforward::Reference;
use crate::linearize::along;
use crate::model::{Compiled, Model, System};
use crate::numeric::eigen::eigenvalues_complex;
use crate::numeric::{Complex, fourier_series::FourierSeries};
use crate::periodic::LtpSystem;

/// Deviations are scaled up to this multiple in search of the largest one that comes back.
const LARGEST: f64 = 64.0;
/// Bisections of that search.
const BISECTIONS: usize = 7;
/// Periods a run lasts at least and at most, where its length is not given.
const PERIODS: (f64, f64) = (10.0, 500.0);
/// Time constants of the slowest exponent that a run lasts, where that is possible.
const CONSTANTS: f64 = 8.0;

/// What to ask.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Truncation N of the lift; 2N is asked as well.
    pub truncation: usize,
    /// Deviations (nx) from the reference to start from.
    pub deviations: Vec<Vec<f64>>,
    /// Numbers of parameters with their relative half ranges, for the worst case.
    pub spread: Vec<(usize, f64)>,
    /// Time that runs last, s; eight time constants of the slowest exponent where `None`, within 10 to 500 periods.
    pub horizon: Option<f64>,
    /// Whether to look for the largest multiple of each deviation that comes back.
    pub tolerated: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { truncation: 5, deviations: Vec::new(), spread: Vec::new(), horizon: None, tolerated: true }
    }
}

/// Eigenvalues of the truncated lift along the reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Lifted {
    /// Truncation.
    pub truncation: usize,
    /// Largest real part of all eigenvalues, 1/s: what the edge of the truncation biases.
    pub all: f64,
    /// Largest real part of those nearest to the exact exponents, 1/s.
    pub central: f64,
    /// Largest distance of these from the exact exponents, relative to the larger of theirs and the pumping frequency.
    pub distance: f64,
}

/// The largest multiple of a deviation that comes back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerated {
    /// Multiple of the deviation given.
    pub multiple: f64,
    /// Whether larger ones were not tried: 64 is the most.
    pub at_least: bool,
}

/// What every witness says of a closed loop.
#[derive(Clone, Debug)]
pub struct Certificate {
    /// Defect of the reference, per state.
    pub defect: Vec<f64>,
    /// Floquet exponents along the reference without feedback, 1/s.
    pub open: Vec<Complex>,
    /// Floquet exponents along the reference with feedback, 1/s: exact, for the linear system.
    pub exponents: Vec<Complex>,
    /// Lifts at N and 2N.
    pub lifted: Vec<Lifted>,
    /// The orbit of the nonlinear closed loop.
    pub orbit: Option<Orbit>,
    /// Why it was not found.
    pub no_orbit: Option<String>,
    /// One run per deviation.
    pub runs: Vec<Run>,
    /// Per deviation, the largest multiple that comes back; empty where not asked for.
    pub tolerated: Vec<Tolerated>,
    /// Other parameter values; `None` where not asked for.
    pub spread: Option<Spread>,
    /// What follows.
    pub verdict: Verdict,
    /// The verdict in a sentence, with numbers.
    pub sentence: String,
    /// What disagrees, or is to be known, each with its reason.
    pub reasons: Vec<String>,
}

/// Asks every witness about the loop of `model` under `gain` (nu, nx) around `reference`.
///
/// # Errors
/// What [`close`] says of reference and gain; `Shape` and `OutOfRange` for options that cannot be.
pub fn certify(model: &Model, reference: &Reference, gain: &FourierSeries, options: &Options) -> Result<Certificate> {
    check(model, reference, gain)?;
    let (nx, period) = (model.states().len(), reference.period());
    for deviation in &options.deviations {
        if deviation.len() != nx {
            return Err(Error::Shape { what: "deviation".into(), expected: nx, found: deviation.len() });
        }
    }
    if options.truncation == 0 {
        let expected = "at least 1, the truncation of the lift".into();
        return Err(Error::OutOfRange { what: "truncation".into(), found: 0.0, expected });
    }
    // A constant gain may carry any period.
    let gain = &FourierSeries::new(period, gain.rows(), gain.coefficients().to_vec())?;
    let plant = model.compile_for(Vec::new(), crate::model::Backend::Native);
    let system = close(model, reference, gain)?.compile_for(Vec::new(), crate::model::Backend::Native);
    let p = system.parameters().to_vec();
    let open = along(&plant, &p, plant.initial_mode(), &reference.states, &reference.inputs)?;
    let closed = linear(&system, reference)?;
    let exact = closed.exponents()?;
    let lifted = [options.truncation, 2 * options.truncation];
    let lifted = lifted.into_iter().map(|n| lift(&closed, n, &exact)).collect::<Result<Vec<_>>>()?;
    let start = reference.states.value(0.0);
    let (orbit, no_orbit) = match Orbit::find(&system, &p, reference, &start) {
        Ok(orbit) => (Some(orbit), None),
        Err(error) => (None, Some(error.to_string())),
    };
    let fastest = exact.iter().fold(pumping(period), |m, e| m.max(e.norm()));
    let own = Loop { system: &system, p: &p, reference, gain, orbit: orbit.as_ref().map(|o| &o.states), fastest };
    let rate = orbit.as_ref().map_or_else(|| slowest(&exact), Orbit::slowest).abs();
    let horizon = options.horizon.unwrap_or_else(|| (CONSTANTS / rate).clamp(PERIODS.0 * period, PERIODS.1 * period));
    let runs = options.deviations.par_iter().map(|d| own.run(d, horizon)).collect::<Result<Vec<_>>>()?;
    let tolerated = if options.tolerated && orbit.is_some() {
        runs.par_iter().map(|run| largest(&own, run, horizon)).collect::<Result<Vec<_>>>()?
    } else {
        Vec::new()
    };
    let near = orbit.as_ref().map_or(start, |o| o.states.value(0.0));
    let spread = (!options.spread.is_empty()).then(|| Spread::of(&system, &p, reference, &near, &options.spread));
    let mut out = Certificate {
        defect: reference.defect.clone(),
        open: open.exponents()?,
        exponents: exact,
        lifted,
        orbit,
        no_orbit,
        runs,
        tolerated,
        spread: spread.transpose()?,
        verdict: Verdict::Disagree,
        sentence: String::new(),
        reasons: Vec::new(),
    };
    out.judge(model, pumping(period));
    Ok(out)
}

/// The closed loop along the reference: `A - B K`.
fn linear(system: &Compiled, reference: &Reference) -> Result<LtpSystem> {
    let inputs = FourierSeries::constant(reference.period(), &vec![0.0; system.inputs().max(1)])?;
    along(system, system.parameters(), system.initial_mode(), &reference.states, &inputs)
}

fn pumping(period: f64) -> f64 {
    std::f64::consts::TAU / period
}

/// Eigenvalues of the lift at a truncation, against the exact exponents.
fn lift(system: &LtpSystem, truncation: usize, exact: &[Complex]) -> Result<Lifted> {
    let order = (2 * truncation + 1) * system.size().nx;
    let all = eigenvalues_complex(&system.lift(truncation)?, order)?;
    let mut left = all.clone();
    let omega = pumping(system.period());
    let (mut central, mut distance) = (f64::NEG_INFINITY, 0.0_f64);
    for exponent in exact {
        let off = |v: &Complex| (v - exponent).norm();
        let nearest = (0..left.len()).min_by(|&a, &b| off(&left[a]).total_cmp(&off(&left[b]))).unwrap_or(0);
        let value = left.swap_remove(nearest);
        central = central.max(value.re);
        distance = distance.max(off(&value) / exponent.norm().max(omega));
    }
    Ok(Lifted { truncation, all: slowest(&all), central, distance })
}

/// The largest multiple of a run's deviation that comes back, by bisection.
fn largest(own: &Loop<'_>, run: &Run, horizon: f64) -> Result<Tolerated> {
    let returns = |multiple: f64| -> Result<bool> {
        let scaled: Vec<f64> = run.deviation.iter().map(|d| multiple * d).collect();
        Ok(own.run(&scaled, horizon)?.returns)
    };
    let (mut good, mut bad) = if run.returns {
        let mut good = 1.0;
        loop {
            if good >= LARGEST {
                return Ok(Tolerated { multiple: good, at_least: true });
            }
            if !returns(2.0 * good)? {
                break (good, 2.0 * good);
            }
            good *= 2.0;
        }
    } else {
        let mut bad = 1.0;
        loop {
            if bad < 1.0 / LARGEST {
                return Ok(Tolerated { multiple: 0.0, at_least: false });
            }
            if returns(0.5 * bad)? {
                break (0.5 * bad, bad);
            }
            bad *= 0.5;
        }
    };
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (good + bad);
        if returns(middle)? { good = middle } else { bad = middle }
    }
    Ok(Tolerated { multiple: good, at_least: false })
}
