//! Before any experiment: which effects a set-up could tell apart at a given noise, and what would help.
//!
//! The nominal model runs along the planned inputs. Every candidate effect, at a stated size, changes the sampled outputs;
//! what nominal parameters (within their stated uncertainty) and initial states can imitate is projected out of that change.
//! The length of what is left, in units of noise, is how visible the effect is; the square of its distance from what another
//! effect can do, at any size, is the gain in deviance that telling the two apart would bring. The same numbers for
//! variations of the set-up say what would help.
//!
//! `variation` changes set-ups, `sizes` says how large an effect is, `geometry` projects; `rivals` asks the same of two
//! fitted explanations of recordings that there are.
//!
//! Reference for the geometry: S. L. Campbell and R. Nikoukhah, *Auxiliary Signal Design for Failure Detection*, Princeton 2004;
//! M. Basseville, *On-board component fault detection and isolation using the statistical local approach*, Automatica 34 (1998).

mod geometry;
mod plan;
mod rivals;
mod setup;
mod sizes;
mod variation;

pub(super) use geometry::{basis as span, remove as project};
pub use plan::{Plan, Planned, Signal};
pub use rivals::{Rival, Suggestion, separating};

use indexmap::IndexMap;
use rayon::prelude::*;
use serde::Serialize;

use super::experiment::Control;
use super::words::number;
use crate::error::{Error, Result};
use crate::model::{Model, System};
use crate::numeric::stats;
use crate::simulate::{self, Trajectory};
use setup::{Candidate, Records};
use variation::{Start, Variation, variations, widened, with_states_measured};

/// Deviance at which two explanations are told apart, as in the verdict of a diagnosis.
pub const APART: f64 = 10.0;
/// Deviance below which nothing speaks for either.
pub const ALIKE: f64 = 2.0;

/// Cosine of the angle between two changes of the outputs beyond which they are much the same.
const ALIKE_COSINE: f64 = 0.95;

/// Whether two effects can be told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Word {
    /// By more than ten units of deviance.
    Separable,
    /// By two to ten.
    Doubtful,
    /// By less than two.
    Never,
}

impl Word {
    fn of(deviance: f64) -> Self {
        match deviance {
            d if d > APART => Self::Separable,
            d if d > ALIKE => Self::Doubtful,
            _ => Self::Never,
        }
    }
}

/// One effect at one place, at the size it was tried with.
#[derive(Clone, Debug, Serialize)]
pub struct Tried {
    /// Name in the library.
    pub name: String,
    /// Where it acts.
    pub at: String,
    /// Its parameters at the reference size.
    pub parameters: IndexMap<String, Size>,
    /// rms change of the measured outputs, in units of their noise, before anything is refitted.
    pub raw: f64,
    /// Length of the change that nominal parameters and initial states cannot imitate, in units of noise.
    pub visible: f64,
    /// Whether its square exceeds ten: whether it would be seen at all.
    pub detectable: bool,
    /// The nominal parameter that does much the same, where one does.
    pub alike: Option<String>,
}

impl Tried {
    /// `effect@place`.
    pub fn label(&self) -> String {
        format!("{}@{}", self.name, self.at)
    }
}

/// A parameter at its reference size.
#[derive(Clone, Debug, Serialize)]
pub struct Size {
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: String,
}

/// What would tell a pair apart, or show an effect, that the set-up cannot.
#[derive(Clone, Debug, Serialize)]
pub struct Advice {
    /// The two effects, `name@place`; one, where it is not seen at all.
    pub of: Vec<String>,
    /// Deviance with the set-up as planned.
    pub now: f64,
    /// Variations that help, best first.
    pub by: Vec<Help>,
}

/// One variation that helps.
#[derive(Clone, Debug, Serialize)]
pub struct Help {
    /// What to do.
    pub sentence: String,
    /// `amplitude`, `sensor`, `slow`, `bandwidth` or `longer`.
    pub kind: String,
    /// Deviance with it.
    pub deviance: f64,
}

/// Which effects a set-up could tell apart.
#[derive(Clone, Debug, Serialize)]
pub struct Isolability {
    /// Name of the model.
    pub model_name: String,
    /// Noise of each measured output, one standard deviation, in its unit.
    pub sensors: IndexMap<String, Size>,
    /// Share of the natural size at which effects were tried.
    pub size: f64,
    /// The effects.
    pub effects: Vec<Tried>,
    /// Gain in deviance (m, m) expected when the effect of the row is true and that of the column is fitted instead, at any
    /// size, beside nominal parameters and initial states.
    pub matrix: Vec<Vec<f64>>,
    /// Gain in deviance (m, m) by which the two are told apart: the smaller of both directions, or the larger where one law
    /// contains the other, since the simpler one is then preferred.
    pub separation: Vec<Vec<f64>>,
    /// `separation` in a word.
    pub words: Vec<Vec<Word>>,
    /// What would help where the set-up does not.
    pub advice: Vec<Advice>,
    /// The whole in a sentence.
    pub sentence: String,
    /// What to keep in mind.
    pub warnings: Vec<String>,
}

/// Which effects of the library the planned records could tell apart.
///
/// # Errors
/// [`Error::UnknownName`] and [`Error::OutOfRange`] of what the plan names, [`Error::Data`] when an output does not move along
/// it, [`Error::NoConvergence`] when the model cannot be simulated along it, [`Error::Interrupted`].
pub fn isolability(model: &Model, plan: &Plan, control: &Control<'_>) -> Result<Isolability> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(plan.threads).build();
    match pool {
        Ok(pool) => pool.install(|| work(model, plan, control)),
        Err(_) => work(model, plan, control),
    }
}

fn work(model: &Model, plan: &Plan, control: &Control<'_>) -> Result<Isolability> {
    (control.progress)("planning the records", 0.0);
    let mut warnings = Vec::new();
    let (wide, extra) = with_states_measured(model)?;
    let system = wide.compile();
    let records = widened(&plan.records(model)?, system.outputs());
    let runs: Vec<Trajectory> = records.iter().map(|r| run(&system, r)).collect::<Result<_>>()?;
    let spread: Vec<f64> = (0..system.outputs()).map(|j| motion(&runs, j, system.outputs())).collect();
    let sensors = plan.sensors(&wide, &extra, &spread)?;
    let sigma: Vec<f64> = sensors.iter().map(|s| s.unwrap_or(f64::INFINITY)).collect();
    let varied = variations(&records, system.period(system.parameters()).is_some())?;
    let all: Vec<&Start> = records.iter().chain(varied.iter().flat_map(|v| v.added.iter().chain(&v.instead))).collect();
    let substeps = setup::substeps(&system, &records, &sigma, control)?;
    (control.progress)("running the nominal model", 0.05);
    let records_of = Records::new(&wide, &system, &all, substeps, control)?;

    let jobs = plan.jobs(model)?;
    let done = std::sync::atomic::AtomicUsize::new(0);
    let tried: Vec<Option<Candidate>> = jobs
        .par_iter()
        .map(|(name, place)| {
            control.check()?;
            let n = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            (control.progress)(&format!("{name}@{place}"), 0.1 + 0.7 * n as f64 / jobs.len().max(1) as f64);
            let effect = model.library().get(name)?;
            let sizes = sizes::at(&wide, effect, place, &runs)?;
            setup::candidate(
                &wide,
                name,
                place,
                &sizes::reference(&wide, effect, &sizes, plan.size)?,
                &records_of,
                control,
            )
        })
        .collect::<Result<_>>()?;
    for ((name, place), c) in jobs.iter().zip(&tried) {
        if c.is_none() {
            warnings.push(format!(
                "`{name}` at `{place}` cannot be simulated at this size along the planned records; left out"
            ));
        }
    }
    let candidates: Vec<Candidate> = tried.into_iter().flatten().collect();
    (control.progress)("comparing", 0.85);
    let base: Vec<usize> = (0..records.len()).collect();
    let now = records_of.compare(&candidates, &base, &sigma);
    let nested: Vec<Vec<bool>> = nested(model, &candidates);
    let separation = symmetric(&now.matrix, &nested);
    let words = separation.iter().map(|row| row.iter().map(|d| Word::of(*d)).collect()).collect();
    let names: Vec<String> = system.free().iter().map(|&i| wide.parameters()[i].name.clone()).collect();
    let effects: Vec<Tried> = candidates
        .iter()
        .enumerate()
        .map(|(k, c)| Tried {
            name: c.effect.clone(),
            at: c.at.clone(),
            parameters: c.parameters.clone(),
            raw: now.raw[k],
            visible: now.own[k].sqrt(),
            detectable: now.own[k] > APART,
            alike: now.alike[k].filter(|(_, cosine)| *cosine > ALIKE_COSINE).map(|(i, _)| names[i].clone()),
        })
        .collect();
    let helps = setups(&wide, &records, &varied, &sensors, &spread, &extra)
        .into_par_iter()
        .map(|s| {
            control.check()?;
            let c = records_of.compare(&candidates, &s.records, &s.sigma);
            Ok(Helped { setup: s, separation: symmetric(&c.matrix, &nested), own: c.own })
        })
        .collect::<Result<Vec<_>>>()?;
    let advice = advise(&effects, &now.own, &separation, &helps);
    let measured = wide.outputs().into_iter().zip(&sensors).filter_map(|(name, sd)| Some((name.to_string(), (*sd)?)));
    let sensors = measured
        .map(|(name, value)| {
            let unit = wide.unit(&name).unwrap_or("1").to_string();
            (name, Size { value, unit })
        })
        .collect();
    let mut out = Isolability {
        model_name: model.name().to_string(),
        sensors,
        size: plan.size,
        effects,
        matrix: now.matrix,
        separation,
        words,
        advice,
        sentence: String::new(),
        warnings,
    };
    out.sentence = sentence(&out);
    (control.progress)("done", 1.0);
    Ok(out)
}

fn run(system: &dyn System, start: &Start) -> Result<Trajectory> {
    let e = &start.experiment;
    let mut plan = simulate::Plan::new(e.dt, e.dt)?.from(&start.x0);
    (plan.t0, plan.samples) = (e.t0, e.len());
    let run = simulate::simulate(system, system.parameters(), &e.inputs, &plan)?;
    if run.stop.is_finished() {
        return Ok(run);
    }
    Err(Error::NoConvergence {
        method: format!("simulation of the model along `{}`", e.name),
        iterations: run.t.len(),
        residual: f64::INFINITY,
        advice: run.stop.sentence(),
    })
}

/// Spread of an output over the runs.
fn motion(runs: &[Trajectory], j: usize, ny: usize) -> f64 {
    stats::std(runs.iter().flat_map(|r| r.outputs.iter().skip(j).step_by(ny).copied()))
}

/// Which pairs are nested: one law contains the other.
fn nested(model: &Model, candidates: &[Candidate]) -> Vec<Vec<bool>> {
    let base = |c: &Candidate| model.library().get(&c.effect).ok().and_then(|e| e.extends.clone());
    let within = |a: &Candidate, b: &Candidate| a.at == b.at && base(b).as_deref() == Some(a.effect.as_str());
    candidates.iter().map(|a| candidates.iter().map(|b| within(a, b) || within(b, a)).collect()).collect()
}

fn symmetric(matrix: &[Vec<f64>], nested: &[Vec<bool>]) -> Vec<Vec<f64>> {
    let m = matrix.len();
    let of = |i: usize, j: usize| {
        let (a, b) = (matrix[i][j], matrix[j][i]);
        if nested[i][j] { a.max(b) } else { a.min(b) }
    };
    (0..m).map(|i| (0..m).map(|j| of(i, j)).collect()).collect()
}

/// A varied set-up: which records, measured how well.
struct Setup {
    kind: &'static str,
    sentence: String,
    records: Vec<usize>,
    sigma: Vec<f64>,
}

/// What a varied set-up shows.
struct Helped {
    setup: Setup,
    separation: Vec<Vec<f64>>,
    own: Vec<f64>,
}

fn setups(
    model: &Model,
    records: &[Start],
    varied: &[Variation],
    sensors: &[Option<f64>],
    spread: &[f64],
    extra: &[String],
) -> Vec<Setup> {
    let base: Vec<usize> = (0..records.len()).collect();
    let sigma: Vec<f64> = sensors.iter().map(|s| s.unwrap_or(f64::INFINITY)).collect();
    let mut out = Vec::new();
    let mut next = records.len();
    for v in varied {
        let (added, instead) = (v.added.len(), v.instead.len());
        let own: Vec<usize> = (next..next + added + instead).collect();
        next += added + instead;
        let records = if instead > 0 { own } else { [base.clone(), own].concat() };
        out.push(Setup { kind: v.kind, sentence: v.sentence.clone(), records, sigma: sigma.clone() });
    }
    // A further sensor is as good, relative to what it sees, as the ones there are.
    let relative: Vec<f64> = sensors.iter().zip(spread).filter_map(|(s, m)| Some((*s)? / m)).collect();
    let relative = stats::median(&relative);
    for (j, name) in model.outputs().iter().enumerate() {
        if sensors[j].is_some() || spread[j].is_nan() || spread[j] == 0.0 {
            continue;
        }
        let sd = relative * spread[j];
        let mut sigma = sigma.clone();
        sigma[j] = sd;
        let unit = model.unit(name).unwrap_or("1");
        let what = if extra.iter().any(|e| e == name) { "state" } else { "output" };
        let sentence = format!("a sensor for the {what} `{name}` (noise {})", super::words::quantity(sd, unit));
        out.push(Setup { kind: "sensor", sentence, records: base.clone(), sigma });
    }
    out
}

/// For every effect that is not seen and every pair that is not told apart: the variations that lead beyond ten units.
fn advise(effects: &[Tried], own: &[f64], separation: &[Vec<f64>], helps: &[Helped]) -> Vec<Advice> {
    let ranked = |now: f64, of: &dyn Fn(&Helped) -> f64| {
        let mut by: Vec<Help> = helps
            .iter()
            .map(|h| Help { sentence: h.setup.sentence.clone(), kind: h.setup.kind.into(), deviance: of(h) })
            .filter(|h| h.deviance > APART && h.deviance > now + ALIKE)
            .collect();
        by.sort_by(|a, b| b.deviance.total_cmp(&a.deviance));
        by
    };
    let mut out = Vec::new();
    for (i, e) in effects.iter().enumerate().filter(|(_, e)| !e.detectable) {
        out.push(Advice { of: vec![e.label()], now: own[i], by: ranked(own[i], &|h| h.own[i]) });
    }
    for i in 0..effects.len() {
        for j in 0..i {
            let now = separation[i][j];
            // What is not seen cannot be told from anything; that is said above.
            if now <= APART && effects[i].detectable && effects[j].detectable {
                let of = vec![effects[j].label(), effects[i].label()];
                out.push(Advice { of, now, by: ranked(now, &|h| h.separation[i][j]) });
            }
        }
    }
    out
}

fn sentence(d: &Isolability) -> String {
    let m = d.effects.len();
    let seen = d.effects.iter().filter(|e| e.detectable).count();
    let pairs: Vec<(usize, usize)> = (0..m).flat_map(|i| (0..i).map(move |j| (i, j))).collect();
    let both = |(i, j): &&(usize, usize)| d.effects[*i].detectable && d.effects[*j].detectable;
    let visible = pairs.iter().filter(both).count();
    let apart = pairs.iter().filter(both).filter(|(i, j)| d.words[*i][*j] == Word::Separable).count();
    let helpless = d.advice.iter().filter(|a| a.by.is_empty()).count();
    let mut best: IndexMap<&str, usize> = IndexMap::new();
    for help in d.advice.iter().flat_map(|a| &a.by) {
        *best.entry(help.sentence.as_str()).or_default() += 1;
    }
    let most = best.iter().max_by_key(|(_, n)| **n);
    let help = match (d.advice.len(), most) {
        (0, _) => String::new(),
        (n, Some((s, k))) => {
            format!("; {s} would settle {k} of the {n} open questions, {helpless} stay open whatever was tried")
        }
        (n, None) => format!("; none of the variations that were tried settles any of the {n} open questions"),
    };
    format!(
        "At {} % of the natural sizes {seen} of {m} effects would be seen, and {apart} of {visible} pairs of these told apart{help}.",
        number(100.0 * d.size)
    )
}
