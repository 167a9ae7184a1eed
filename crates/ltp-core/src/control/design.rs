//! Design by harmonic balance: the gain that moves the slowest mode furthest to the left, under constraints.
//!
//! The objective is the largest real part of the lifted closed loop `A - N - B K_T`, or of its exact Floquet exponents: over
//! the system and all its variants, whose worst case it then is. It has kinks where modes meet, and several valleys; so a
//! population looks around, descents that know kinks start from its best members, and shaken copies of the best one are
//! descended until the evaluations are spent. Without a limit on the gain there is often no minimum: the gain runs off.
//!
//! Reference: A. D. Duyul, M.Sc. thesis, METU 2018, section 3.3.3, equations (3.13) to (3.18) and Algorithm 1. In (3.17) the last
//! constraint is read as `min Re < -15`; as printed (`max`) nothing fulfils it.

use rayon::prelude::*;

use super::constraint::{Constraint, Damping, Quadratic};
use super::exact::{Exact, STEPS};
use super::feedback::Feedback;
use super::law::Law;
use super::lifted::Lifted;
use super::spectrum::{Objective, Spectrum};
use crate::error::{Error, Result};
use crate::numeric::fourier_series::FourierSeries;
use crate::numeric::minimise::nonsmooth::{self, descend};
use crate::numeric::minimise::{Best, Evaluation, Problem, evolution, swarm};
use crate::numeric::rng::SplitMix64;
use crate::periodic::LtpSystem;

/// What is measured of a closed loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// Eigenvalues of the lift: all of them, or the one copy of each exponent in its middle.
    Lifted {
        /// Harmonics on each side.
        truncation: usize,
        /// Over all eigenvalues, edges included, as published.
        all: bool,
    },
    /// Floquet exponents.
    Exact,
}

/// How the minimum is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Search {
    /// Differential evolution, descents, shaken descents.
    Global,
    /// Algorithm 1 of the thesis.
    Swarm,
    /// One descent from the start.
    Local,
}

/// What a design is to be.
#[derive(Clone, Debug)]
pub struct Options {
    /// The objective.
    pub measure: Measure,
    /// Harmonics of the gain: `[0]` a constant one.
    pub harmonics: Vec<usize>,
    /// Largest norm of the gain: root of the sum of squares of all numbers of `K_0` and of `K_h` in `K_0 + Re(K_h e^{jhwt})`.
    pub limit: Option<f64>,
    /// All real parts are above minus this, 1/s: (3.16) has 50.
    pub fastest: Option<f64>,
    /// Some real part is below minus this, 1/s: (3.17) has 15.
    pub slowest: Option<f64>,
    /// Bounds on quadratic forms of the constant part: (3.17), (3.18).
    pub quadratic: Vec<Quadratic>,
    /// Bound on how central modes swing.
    pub damping: Option<Damping>,
    /// A gain to begin with.
    pub start: Option<FourierSeries>,
    /// How to look.
    pub search: Search,
    /// Seed of all that is drawn.
    pub seed: u64,
    /// Evaluations; 10 000 for each unknown when none is given, 40 000 at least.
    pub budget: Option<usize>,
}

impl Default for Options {
    /// A constant gain on all eigenvalues of the lift with N = 2, without constraints.
    fn default() -> Self {
        Self {
            measure: Measure::Lifted { truncation: 2, all: true },
            harmonics: vec![0],
            limit: None,
            fastest: None,
            slowest: None,
            quadratic: Vec::new(),
            damping: None,
            start: None,
            search: Search::Global,
            seed: 0,
            budget: None,
        }
    }
}

/// Standard deviation of the first gains when no limit says how large they may be, as in Algorithm 1.
const SCALE: f64 = 1000.0;
/// Relative difference between the sampled exponent of the result and that of the collocation that is let pass.
const RESOLVED: f64 = 1e-3;
/// Most samples over a period.
const MOST_STEPS: usize = 8 * STEPS;
/// Reach, relative, below which an input does not move a mode.
const UNREACHED: f64 = 1e-9;

/// The gain that minimises the largest real part over `system` and its `variants`, under the constraints of `options`.
///
/// # Errors
/// `Model` for a mode that does not decay and that no input reaches, or for jumps; `OutOfRange` for constraints that cannot be
/// kept (which one, and how near the search came), for a truncation too low, for options out of their range; `Shape` for
/// variants or a start of other lengths.
pub fn harmonic_balance(system: &LtpSystem, variants: &[LtpSystem], options: &Options) -> Result<Feedback> {
    let mut steps = STEPS;
    loop {
        let design = Design::new(system, variants, options, steps)?;
        let best = design.search(options)?;
        // A minimum may lie where the samples no longer resolve the closed loop: then with twice as many.
        let resolved = options.measure != Measure::Exact || {
            let gain = design.law.series(&best.x)?;
            let largest = |system: &LtpSystem| Ok(system.closed(&gain)?.exponents()?[0].re);
            let all = std::iter::once(system).chain(variants).map(largest).collect::<Result<Vec<f64>>>()?;
            let exact = all.into_iter().fold(f64::NEG_INFINITY, f64::max);
            (exact - best.value).abs() <= RESOLVED * exact.abs().max(0.01)
        };
        if resolved || steps >= MOST_STEPS {
            return design.feedback(system, variants, options, best);
        }
        steps *= 2;
    }
}

fn local(budget: usize, x: &[f64]) -> nonsmooth::Options {
    let norm = x.iter().map(|x| x * x).sum::<f64>().sqrt();
    nonsmooth::Options { budget, step: 0.02 * norm + 0.1, penalty: 10.0 }
}

fn everywhere(design: &Design, scale: &[f64], start: Option<Vec<f64>>, seed: u64, budget: usize) -> Best {
    const TOGETHER: usize = 8;
    let members = (10 * scale.len()).clamp(24, 80);
    let begin: Vec<Vec<f64>> = start.into_iter().collect();
    let share = budget * 2 / 5;
    let population = evolution::evolve(design, scale, &begin, &evolution::Options { budget: share, members, seed });
    let mut best = evolution::best(&population, share);
    let mut random = SplitMix64::new(seed ^ 0x5eed);
    let round = |starts: Vec<Vec<f64>>, each: usize, best: Best| {
        let found: Vec<Best> = starts.into_par_iter().map(|x| descend(design, &x, &local(each, &x))).collect();
        found.into_iter().fold(best, Best::or)
    };
    let mut starts: Vec<Vec<f64>> = population.iter().step_by(members / TOGETHER).map(|m| m.0.clone()).collect();
    starts.extend(begin);
    // gains whose numbers are of very different sizes, which a population rarely holds
    let mut sized = |s: &f64| s * (2.0 * random.uniform() - 1.0).signum() * 10.0_f64.powf(-4.0 * random.uniform());
    starts.extend((0..TOGETHER).map(|_| scale.iter().map(&mut sized).collect::<Vec<_>>()));
    best = round(starts, budget * 3 / 10 / (2 * TOGETHER), best);
    let mut size = 0.3;
    while best.evaluations < budget {
        let norm = best.x.iter().map(|x| x * x).sum::<f64>().sqrt() / (best.x.len() as f64).sqrt();
        // half of them each number by its own size, half all by the same
        let mut shake =
            |x: &f64, k: usize| x + size * random.normal() * if k.is_multiple_of(2) { x.abs() } else { norm };
        let starts: Vec<Vec<f64>> = (0..TOGETHER).map(|k| best.x.iter().map(|x| shake(x, k)).collect()).collect();
        let before = (best.value, best.evaluations);
        best = round(starts, (budget / 50).max(200), best);
        size = if best.value < before.0 - 1e-6 * before.0.abs() { 0.3 } else { (0.6 * size).max(0.003) };
        if best.evaluations == before.1 {
            break;
        }
    }
    best
}

struct Design {
    law: Law,
    objectives: Vec<Objective>,
    constraints: Vec<Constraint>,
    all: bool,
}

impl Design {
    fn new(system: &LtpSystem, variants: &[LtpSystem], options: &Options, steps: usize) -> Result<Self> {
        let size = system.size();
        let law = Law::new(size.nu, size.nx, system.period(), &options.harmonics)?;
        let exact = Exact::new(system, &law, None)?;
        for (exponent, reach) in exact.reach()? {
            if reach < UNREACHED && exponent.re >= -1e-9 {
                return Err(unstabilisable(exponent.re, "0"));
            }
        }
        for (k, variant) in variants.iter().enumerate() {
            if (variant.period() - system.period()).abs() > 1e-9 * system.period() {
                let expected = format!("{} s, that of the system; variants share its clock", system.period());
                let what = format!("period of variant {k} (the first is 0), s");
                return Err(Error::OutOfRange { what, found: variant.period(), expected });
            }
        }
        let one = |system: &LtpSystem| match options.measure {
            Measure::Lifted { truncation, .. } => Lifted::new(system, &law, truncation).map(Objective::Lifted),
            Measure::Exact => Exact::new(system, &law, Some(steps)).map(Objective::Exact),
        };
        let objectives = std::iter::once(system).chain(variants).map(one).collect::<Result<_>>()?;
        let mut constraints = Vec::new();
        let mut positive = |what: &str, value: Option<f64>, make: fn(f64) -> Constraint| -> Result<()> {
            let Some(value) = value else { return Ok(()) };
            if !(value > 0.0 && value.is_finite()) {
                let expected = "a positive number, or none".into();
                return Err(Error::OutOfRange { what: what.into(), found: value, expected });
            }
            constraints.push(make(value));
            Ok(())
        };
        positive("limit", options.limit, Constraint::Limit)?;
        positive("fastest, 1/s", options.fastest, Constraint::Fastest)?;
        positive("slowest, 1/s", options.slowest, Constraint::Slowest)?;
        match options.damping {
            Some(Damping::Ratio(ratio)) if ratio.is_nan() || ratio >= 1.0 => {
                let expected = "a damping ratio in (0, 1)".into();
                return Err(Error::OutOfRange { what: "damping".into(), found: ratio, expected });
            }
            Some(Damping::Ratio(ratio)) => {
                positive("damping", Some(ratio), |r| Constraint::Swing(Damping::Ratio(r)))?;
            }
            Some(Damping::Imaginary(bound)) => {
                positive("imaginary, rad/s", Some(bound), |b| Constraint::Swing(Damping::Imaginary(b)))?;
            }
            None => {}
        }
        if !options.quadratic.is_empty() && !options.harmonics.contains(&0) {
            let first = law.harmonics[0] as f64;
            let expected = "0 among them, since bounds on quadratic forms are on the constant part".into();
            return Err(Error::OutOfRange { what: "harmonics of the gain: first".into(), found: first, expected });
        }
        for bounds in &options.quadratic {
            constraints.extend(Constraint::quadratic(bounds, size.nx)?);
        }
        let all = !matches!(options.measure, Measure::Lifted { all: false, .. });
        Ok(Self { law, objectives, constraints, all })
    }

    fn search(&self, options: &Options) -> Result<Best> {
        let n = self.law.unknowns();
        let scale = vec![options.limit.unwrap_or(SCALE); n];
        let start = options.start.as_ref().map(|g| self.law.unknowns_of(g)).transpose()?;
        let budget = options.budget.unwrap_or((10_000 * n).max(40_000));
        Ok(match options.search {
            Search::Local => descend(self, &start.unwrap_or_else(|| vec![0.0; n]), &local(budget, &[])),
            Search::Swarm => {
                let options = swarm::Options { budget, particles: 10, rounds: 1000, seed: options.seed, descent: 300 };
                swarm::swarm(self, &scale, &options)
            }
            Search::Global => everywhere(self, &scale, start, options.seed, budget),
        })
    }

    fn feedback(&self, system: &LtpSystem, variants: &[LtpSystem], options: &Options, best: Best) -> Result<Feedback> {
        let mut evaluation = Evaluation::default();
        self.evaluate(&best.x, false, &mut evaluation);
        let worst = (0..self.constraints.len()).max_by(|&a, &b| {
            let value = |k: usize| evaluation.constraints[k];
            value(a).total_cmp(&value(b))
        });
        if let Some(worst) = worst.filter(|&k| evaluation.constraints[k].is_nan() || evaluation.constraints[k] > 1e-9) {
            let (what, found, expected) = self.constraints[worst].in_words(evaluation.constraints[worst]);
            let expected = format!(
                "{expected}; no gain that keeps all constraints was found in {} evaluations, and this one is violated most \
                 where the others are nearest to be kept: relax it, allow more harmonics, or give more budget",
                best.evaluations
            );
            return Err(Error::OutOfRange { what: format!("constraints: {what}"), found, expected });
        }
        let gain = self.law.series(&best.x)?;
        let mut figures = vec![
            ("objective, 1/s".to_owned(), best.value),
            ("norm".to_owned(), best.x.iter().map(|x| x * x).sum::<f64>().sqrt()),
            ("evaluations".to_owned(), best.evaluations as f64),
        ];
        let mut spectrum = Spectrum::default();
        if matches!(options.measure, Measure::Lifted { .. }) {
            for (name, all) in [("lifted, all, 1/s", true), ("lifted, central, 1/s", false)] {
                figures.push((name.into(), self.objectives[0].abscissa(&best.x, all, &mut spectrum, None)?));
            }
        }
        let largest = |system: &LtpSystem| Ok(system.closed(&gain)?.exponents()?[0].re);
        let exact = largest(system)?;
        figures.push(("exact, 1/s".into(), exact));
        if !variants.is_empty() {
            let all = variants.iter().map(largest).collect::<Result<Vec<f64>>>()?;
            figures.push(("exact, worst variant, 1/s".into(), all.into_iter().fold(exact, f64::max)));
        }
        let mut warnings = Vec::new();
        if options.limit.is_none() {
            warnings.push(format!(
                "no limit on the norm of the gain ({:.4e} found): the objective often falls on and on as gains grow, so \
                 this one depends on the budget; give `limit`, from the input that is available",
                figures[1].1
            ));
        }
        if (best.value - exact).abs() > 0.05 * exact.abs().max(0.1) && variants.is_empty() {
            let reason = match options.measure {
                Measure::Lifted { .. } => {
                    "the truncated lift is biased at its edges; take its central modes, a higher truncation or the exact \
                     objective"
                }
                Measure::Exact => {
                    "modes that meet or that decay within a few samples are not resolved; lower the limit on the gain"
                }
            };
            let value = best.value;
            warnings
                .push(format!("the objective is {value:.4} 1/s, but the largest exact exponent {exact:.4}: {reason}"));
        }
        if exact >= 0.0 {
            warnings.push(format!("the closed loop is not stable: largest exact exponent {exact:.4} 1/s"));
        }
        let method = match options.measure {
            Measure::Lifted { truncation, .. } => format!("harmonic balance, truncated at {truncation} harmonics"),
            Measure::Exact => "harmonic balance, exact exponents".into(),
        };
        Ok(Feedback { gain, method, figures, warnings })
    }
}

impl Problem for Design {
    fn unknowns(&self) -> usize {
        self.law.unknowns()
    }

    fn evaluate(&self, x: &[f64], gradients: bool, out: &mut Evaluation) {
        let (n, m) = (x.len(), self.constraints.len());
        out.value = f64::NEG_INFINITY;
        out.gradient.resize(n, 0.0);
        out.constraints.resize(m, 0.0);
        out.constraint_gradients.clear();
        out.constraint_gradients.resize(m * n, 0.0);
        let (mut spectrum, mut derivative) = (Spectrum::default(), Vec::new());
        for (k, objective) in self.objectives.iter().enumerate() {
            if objective.modes(x, &mut spectrum).is_err() {
                out.value = f64::NAN;
                return;
            }
            let looked_at = spectrum.modes.iter().filter(|m| self.all || m.central);
            let Some(top) = looked_at.max_by(|a, b| a.value.re.total_cmp(&b.value.re)) else { continue };
            if top.value.re > out.value {
                out.value = top.value.re;
                if gradients {
                    objective.derivative(top, &spectrum, &mut derivative);
                    out.gradient.iter_mut().zip(&derivative).for_each(|(g, d)| *g = d.re);
                }
            }
            if k > 0 {
                continue;
            }
            for (k, constraint) in self.constraints.iter().enumerate() {
                let row = &mut out.constraint_gradients[k * n..(k + 1) * n];
                let (value, hang) = constraint.at(x, (self.law.nu, self.law.nx), &spectrum.modes, row);
                out.constraints[k] = value;
                if let Some((mode, real, imaginary)) = hang.filter(|_| gradients && value > 0.0) {
                    objective.derivative(&mode, &spectrum, &mut derivative);
                    row.iter_mut().zip(&derivative).for_each(|(g, d)| *g += real * d.re + imaginary * d.im);
                }
            }
        }
    }
}

/// A mode that stays and that no input reaches.
pub(super) fn unstabilisable(exponent: f64, bound: &str) -> Error {
    let message = format!(
        "the pair (A, B) cannot be stabilised: no input reaches the mode with exponent {exponent:.6} 1/s, which is not \
         below {bound}; add an input, or leave the state out"
    );
    Error::Model { path: "control".into(), message }
}
