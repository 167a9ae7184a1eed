//! A case from system, difficulty and seed: what is concealed and where, how large, the noise, and what the engineer
//! believes. Every draw follows from the seed; draws that change nothing, leave the machine's regular motion or can be
//! imitated by the nominal parameters are drawn again, deterministically.

use serde::Serialize;

use super::machine::Machine;
use super::palette::{OUTSIDE, Sketch, places};
use super::setups::{Setup, Take};
use super::shown::{IMITATED, Shown, TRAIN, simpler};
use super::trace::Bench;
use super::{Case, Label, Planted};
use crate::error::{Error, Result, nearest};
use crate::model::document::Before;
use crate::model::{Model, zoo};
use crate::numeric::rng::SplitMix64;
use crate::numeric::stats;
use crate::signal::Recording;

/// Change of an output by an effect over the motion: drawn log-uniformly between these.
const CHANGE: (f64, f64) = (0.01, 0.3);
/// The same for the hopper, which stumbles over more.
const CHANGE_HOPPING: (f64, f64) = (0.003, 0.05);
/// Energy over noise variance that must be left after the nominal parameters took their part: with less, no method can
/// tell the effect from chance.
const VISIBLE: f64 = 60.0;
/// An output that an effect hardly moves gets the noise of one that moves this share of the most moved one.
const LEAST: f64 = 0.1;
/// Strength beyond which an effect is no addition to the machine any more, but another machine.
const STRONGEST: f64 = 2.0;
/// The same along records that repeat their input many times.
const REFITS_LONG: usize = 2;
/// Multiple of that energy which one step must leave for a further look at a rival to be idle.
const NEAR: f64 = 1e3;
/// Steps of the refit that tells imitation.
const REFITS: usize = 6;
/// Draws before a combination is given up.
const TRIES: usize = 40;

/// How well the physics is concealed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Difficulty {
    /// Change 40 dB over white noise.
    Open,
    /// Change 20 dB over white noise.
    Noisy,
    /// 20 dB, and the stated parameters were refitted so that the training fit looks good.
    Masked,
    /// Change 0 to 10 dB below the noise, sample by sample, in long records of a repeated input.
    Buried,
    /// Two effects, 40 dB.
    Pair,
    /// Nothing; white noise or AR(1) 0.8, wrong parameters.
    Clean,
    /// A law that is not in the library, 40 dB.
    Outside,
}

impl Difficulty {
    /// All of them, with their names.
    pub const ALL: [(&'static str, Difficulty); 7] = [
        ("open", Self::Open),
        ("noisy", Self::Noisy),
        ("masked", Self::Masked),
        ("buried", Self::Buried),
        ("pair", Self::Pair),
        ("clean", Self::Clean),
        ("outside", Self::Outside),
    ];

    /// By name.
    ///
    /// # Errors
    /// [`Error::UnknownName`].
    pub fn named(name: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|(n, _)| *n == name).map(|(_, d)| d);
        found.ok_or_else(|| Error::UnknownName {
            kind: "difficulty".into(),
            name: name.into(),
            nearest: nearest(name, Self::ALL.into_iter().map(|(n, _)| n)),
            context: "conceal".into(),
        })
    }

    fn decibels(self, random: &mut SplitMix64) -> f64 {
        match self {
            Self::Open | Self::Pair | Self::Outside => 40.0,
            Self::Noisy | Self::Masked => 20.0,
            Self::Buried => -10.0 * random.uniform(),
            Self::Clean => f64::NAN,
        }
    }
}

/// What to draw.
#[derive(Clone, Debug, PartialEq)]
pub struct Draw {
    /// One of [`super::SYSTEMS`].
    pub system: String,
    /// How well it is concealed.
    pub difficulty: Difficulty,
    /// Effect and place, drawn where `None`.
    pub effect: Option<(String, String)>,
    /// Seed.
    pub seed: u64,
}

/// What was concealed, and how: not for the eyes of the diagnosis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Concealed {
    /// System.
    pub system: String,
    /// Difficulty.
    pub difficulty: Difficulty,
    /// Seed.
    pub seed: u64,
    /// Effects; none in a clean case.
    pub effects: Vec<Planted>,
    /// Change of the most moved output by the effects, over the spread of its motion.
    pub change: f64,
    /// Change over noise of that output, in decibels; none in a clean case.
    pub decibels: Option<f64>,
    /// Energy over noise variance of what the nominal parameters cannot imitate, train records.
    pub visible: f64,
    /// The same effect at other places, as `effect@place`, where it does the same as far as these records can tell.
    pub alike: Vec<String>,
    /// `white` or `ar1`.
    pub noise: String,
    /// Noise of each output, rms.
    pub sigma: Vec<f64>,
    /// Draws that were rejected before this one.
    pub rejected: usize,
}

/// Draws a case.
///
/// # Errors
/// [`Error::UnknownName`] for names, [`Error::NoConvergence`] when no draw leaves a trace.
pub fn draw(what: &Draw) -> Result<(Case, Concealed)> {
    let mut nominal = zoo(&what.system)?;
    if what.difficulty == Difficulty::Outside {
        let mut library = nominal.library().clone();
        for (name, text) in OUTSIDE {
            library.add_toml(name, text)?;
        }
        nominal = Model::new(nominal.document().clone(), library, "")?;
    }
    // Systems and difficulties of one seed share nothing.
    let words = what.system.bytes().chain([b' ', what.difficulty as u8]);
    let mixed = words.fold(what.seed, |s, b| SplitMix64::new(s ^ u64::from(b)).next_u64());
    let mut random = SplitMix64::new(mixed);
    let mut why = String::new();
    for rejected in 0..TRIES {
        // Each try has its own stream, so that a change of one rule does not change what follows.
        let mut own = SplitMix64::new(random.next_u64());
        match attempt(&nominal, what, &mut own) {
            Ok((case, mut concealed)) => {
                concealed.rejected = rejected;
                return Ok((case, concealed));
            }
            Err(e @ (Error::NoConvergence { .. } | Error::Model { .. } | Error::OutOfRange { .. })) => {
                why = e.to_string()
            }
            Err(e) => return Err(e),
        }
    }
    Err(Error::NoConvergence {
        method: format!("drawing a case of `{}`", what.system),
        iterations: TRIES,
        residual: f64::INFINITY,
        advice: format!("the last draw was rejected because: {why}; choose another effect or seed"),
    })
}

fn rejected(advice: &str) -> Error {
    Error::NoConvergence { method: "draw".into(), iterations: 1, residual: f64::NAN, advice: advice.into() }
}

fn attempt(nominal: &Model, what: &Draw, random: &mut SplitMix64) -> Result<(Case, Concealed)> {
    let difficulty = what.difficulty;
    let setup = Setup::new(&what.system, difficulty == Difficulty::Buried, random)?;
    let ny = nominal.outputs().len();
    let bare = Machine::new(nominal, &[])?;
    let plain: Vec<Take> = (0..setup.records()).map(|r| setup.take(nominal, &bare, r)).collect::<Result<_>>()?;
    let count = match difficulty {
        Difficulty::Clean => 0,
        Difficulty::Pair => 2,
        _ => 1,
    };
    let mut planted: Vec<Planted> = Vec::new();
    let pool = places(nominal, difficulty == Difficulty::Outside)?;
    while planted.len() < count {
        let (name, at) = match (&what.effect, planted.len()) {
            (Some(given), 0) => given.clone(),
            _ => choose(&pool, random)?,
        };
        if planted.iter().any(|p| p.at == at && (p.name == name || !nominal.ports().contains(&at.as_str()))) {
            continue;
        }
        planted.push(sized(&setup, nominal, &plain, &name, &at, random)?);
    }
    if count > 1 {
        // Each of two must be something by itself.
        for one in &planted {
            let shown = Shown::new(&setup, nominal, std::slice::from_ref(one), &plain, TRAIN)?;
            let spread: Vec<f64> = (0..ny).map(|j| shown.change(j, ny, &plain).1).collect();
            if shown.unlike(&setup, nominal, None, &spread, REFITS)?.0 < 10.0 * IMITATED {
                return Err(rejected("the nominal parameters imitate one of the two effects"));
            }
        }
    }
    // Off by many of its own uncertainties: that is what a refit is for, and it is to be said.
    let uncertain = |name: &str| nominal.parameters().iter().any(|p| p.name == name && p.sd.is_some());
    let stated_error = planted.iter().any(|p| p.name == "parameter_error" && uncertain(&p.at));
    if stated_error && difficulty == Difficulty::Masked {
        return Err(rejected("a refit of what is stated takes a wrong parameter away: nothing would be masked"));
    }
    let shown = Shown::new(&setup, nominal, &planted, &plain, setup.records())?;
    let sizes: Vec<(f64, f64)> = (0..ny).map(|j| shown.change(j, ny, &plain)).collect();
    let spread: Vec<f64> = sizes.iter().map(|s| s.1).collect();
    let mut relative: Vec<f64> = sizes.iter().map(|(c, s)| c / s).collect();
    let (mut decibels, mut visible, mut alike) = (None, 0.0, Vec::new());
    let long = setup.repeats.is_some();
    if count > 0 {
        let most = relative.iter().copied().fold(0.0, f64::max);
        let size: Vec<f64> = relative.iter().zip(&spread).map(|(r, s)| r.max(LEAST * most) * s).collect();
        let size = if setup.looped { &spread } else { &size };
        let (share, left, energy) =
            shown.unlike(&setup, nominal, None, size, if long { REFITS_LONG } else { REFITS })?;
        let db = difficulty.decibels(random);
        decibels = Some(db);
        visible = energy * 10f64.powf(db / 10.0);
        if setup.looped {
            // A loop answers an effect by its force, and the free run of an integrator drifts by metres: what counts is the
            // change that parameters and starts cannot take up, at most a twentieth of the motion.
            relative = vec![left.min(0.05); ny];
            visible /= relative[0] * relative[0];
        }
        if planted.len() > 1 {
            // And each must be something beside the other.
            for other in &planted {
                let beyond = shown.unlike(&setup, nominal, Some(other.clone()), size, REFITS)?.2;
                if visible * (beyond / energy) < VISIBLE {
                    return Err(rejected("one of the two effects hides what the other does"));
                }
            }
        }
        // Long records are not asked again: what is the same below the noise of one sample stands in a table.
        if let ([one], false) = (planted.as_slice(), long) {
            let beyond = |rival: Planted, steps: usize| -> Result<f64> {
                Ok(visible * (shown.unlike(&setup, nominal, Some(rival), size, steps)?.2 / energy))
            };
            if let Some(rival) = simpler(one, &setup, nominal)
                && beyond(rival, REFITS)? < VISIBLE
            {
                return Err(rejected("a simpler law does the same as far as these records can tell"));
            }
            for (name, at) in pool.iter().filter(|(name, at)| *name == one.name && *at != one.at) {
                let rival = Planted { at: at.clone(), ..one.clone() };
                let near = beyond(rival.clone(), 1).is_ok_and(|b| b < NEAR * VISIBLE);
                if near && beyond(rival, REFITS)? < VISIBLE {
                    alike.push(format!("{name}@{at}"));
                }
            }
        }
        if !stated_error && share < IMITATED {
            return Err(rejected("the nominal parameters imitate the effect"));
        }
        if !stated_error && visible < VISIBLE {
            return Err(rejected("the effect leaves no trace that could be told from chance"));
        }
    }
    let most = relative.iter().copied().fold(0.0, f64::max);
    let sigma: Vec<f64> = match decibels {
        Some(db) => {
            relative.iter().zip(&spread).map(|(r, s)| r.max(LEAST * most) * s * 10f64.powf(-db / 20.0)).collect()
        }
        // Nothing to compare with: between 0.3 and 3 percent of the motion.
        None => {
            let level = 3e-3 * 10f64.powf(random.uniform());
            spread.iter().map(|s| level * s).collect()
        }
    };
    let meetings = shown.meetings();
    let bench = Bench { setup: &setup, records: &meetings, sigma: &sigma };
    // As an engineer would state them: off by half a sigma or so.
    let mut stated = off(nominal, random)?;
    if difficulty == Difficulty::Masked {
        stated = bench.masked(&stated)?;
    }
    if let Some(period) = setup.repeats {
        // What an engineer who repeats an input knows and says: it did so before the record too.
        let mut document = stated.document().clone();
        for input in document.inputs.values_mut() {
            input.before = Some(Before::Periodic { periodic: format!("{period}") });
        }
        stated = Model::new(document, stated.library().clone(), "")?;
    }
    let coloured = difficulty == Difficulty::Clean && what.seed % 2 == 1;
    let mut records = Vec::new();
    for (r, name) in ["train A", "train B", "held out"].into_iter().enumerate() {
        records.push(record(&setup, nominal, &shown.takes[r], name, &sigma, coloured, random)?);
    }
    let test = records.split_off(TRAIN);
    let concealed = Concealed {
        system: what.system.clone(),
        difficulty,
        seed: what.seed,
        change: if count > 0 { most } else { 0.0 },
        decibels,
        visible,
        alike,
        noise: if coloured { "ar1".into() } else { "white".into() },
        sigma,
        rejected: 0,
        effects: planted,
    };
    Ok((Case { label: concealed.label(), model: stated, train: records, test }, concealed))
}

impl Concealed {
    /// The first effect as the label of a case.
    fn label(&self) -> Label {
        let none = Planted { name: "nothing".into(), at: String::new(), parameters: Vec::new() };
        let first = self.effects.first().cloned().unwrap_or(none);
        Label { effect: first.name, at: first.at, parameters: first.parameters, seed: self.seed }
    }
}

/// An effect, each as likely as the others, then a place for it.
fn choose(pool: &[(String, String)], random: &mut SplitMix64) -> Result<(String, String)> {
    let mut names: Vec<&String> = pool.iter().map(|(n, _)| n).collect();
    names.dedup();
    if names.is_empty() {
        return Err(rejected("there is no effect to conceal"));
    }
    let name = names[random.below(names.len())];
    let here: Vec<&(String, String)> = pool.iter().filter(|(n, _)| n == name).collect();
    Ok(here[random.below(here.len())].clone())
}

/// An effect whose change of the first record is as large as drawn: the secant rule in logarithms.
fn sized(
    setup: &Setup,
    nominal: &Model,
    plain: &[Take],
    name: &str,
    at: &str,
    random: &mut SplitMix64,
) -> Result<Planted> {
    let sketch = Sketch::new(nominal, setup, name, at, random)?;
    let (low, high) = if what_hops(setup) { CHANGE_HOPPING } else { CHANGE };
    let target = low * (high / low).powf(random.uniform());
    if !sketch.adjustable() {
        return Ok(sketch.at_strength(1.0));
    }
    let ny = nominal.outputs().len();
    let spread: Vec<f64> =
        (0..ny).map(|j| stats::std(plain[0].motion.outputs.iter().skip(j).step_by(ny).copied())).collect();
    let change = |s: f64| -> Result<f64> {
        let planted = sketch.at_strength(s);
        if planted.parameters.iter().any(|(_, v)| !v.is_finite()) {
            return Err(rejected("the machine does not move there"));
        }
        let shown = Shown::new(setup, nominal, &[planted], plain, 1)?;
        if setup.looped {
            return Ok(shown.unlike(setup, nominal, None, &spread, 1)?.1);
        }
        let each = (0..ny).map(|j| shown.change(j, ny, plain));
        Ok(each.map(|(c, s)| c / s).fold(0.0, f64::max))
    };
    let (mut s, mut best): (f64, Option<(f64, f64)>) = (0.05, None);
    let mut ceiling = 30.0f64;
    for _ in 0..10 {
        let found = match change(s) {
            Ok(c) if c.is_finite() && c < 10.0 => c,
            // Too much for the machine: less.
            Ok(_) | Err(Error::NoConvergence { .. }) => {
                ceiling = ceiling.min(s);
                s *= 0.3;
                continue;
            }
            Err(e) => return Err(e),
        };
        let off = |c: f64| (c / target).ln().abs();
        if best.is_none_or(|(_, c)| off(found) < off(c)) {
            best = Some((s, found));
        }
        if off(found) < 0.1 || found == 0.0 && s > 5.0 {
            break;
        }
        let factor = if found > 0.0 { (target / found).clamp(0.1, 10.0) } else { 5.0 };
        let next = s * factor;
        s = if next >= ceiling { (s * ceiling).sqrt() } else { next };
    }
    match best {
        Some((s, found)) if found > 0.3 * low && found < 1.5 * high && s < STRONGEST => Ok(sketch.at_strength(s)),
        _ => Err(rejected("the effect cannot be made as large as was drawn")),
    }
}

fn what_hops(setup: &Setup) -> bool {
    setup.model == "hopper"
}

/// The model as an engineer would state it: parameters off by about half their stated uncertainty.
pub(super) fn off(nominal: &Model, random: &mut SplitMix64) -> Result<Model> {
    let values: Vec<(String, f64)> = nominal
        .parameters()
        .iter()
        .filter_map(|p| {
            let v = p.value + 0.5 * p.sd? * random.normal().clamp(-2.0, 2.0);
            Some((p.name.clone(), v.clamp(p.bounds.0, p.bounds.1)))
        })
        .collect();
    let values: Vec<(&str, f64, Option<f64>)> = values.iter().map(|(n, v)| (n.as_str(), *v, None)).collect();
    nominal.with_parameters(&values)
}

/// What a logger writes.
fn record(
    setup: &Setup,
    model: &Model,
    take: &Take,
    name: &str,
    sigma: &[f64],
    coloured: bool,
    random: &mut SplitMix64,
) -> Result<Recording> {
    let t: Vec<f64> = (0..setup.samples).map(|k| k as f64 * setup.dt).collect();
    let nu = take.wave.count;
    let inputs =
        (0..nu).map(|i| take.wave.samples.iter().skip(i).step_by(nu).take(setup.samples).copied().collect()).collect();
    let ny = sigma.len();
    let pole = if coloured { 0.8f64 } else { 0.0 };
    let outputs = (0..ny)
        .map(|j| {
            // Stationary from the first sample, with the stated rms.
            let mut e = random.normal();
            take.motion
                .outputs
                .iter()
                .skip(j)
                .step_by(ny)
                .map(|y| {
                    let noisy = y + sigma[j] * e;
                    e = pole * e + (1.0 - pole * pole).sqrt() * random.normal();
                    noisy
                })
                .collect()
        })
        .collect();
    let own = |names: Vec<&str>| names.into_iter().map(String::from).collect();
    Recording::new(name, t, inputs, outputs, own(model.inputs()), own(model.outputs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_draws_the_same_case() {
        let what = Draw { system: "cart_pendulum".into(), difficulty: Difficulty::Open, effect: None, seed: 7 };
        let ((a, la), (b, lb)) = (draw(&what).unwrap(), draw(&what).unwrap());
        assert_eq!(la, lb);
        assert_eq!(a.train[0].outputs(), b.train[0].outputs());
        let other = draw(&Draw { seed: 8, ..what }).unwrap();
        assert_ne!(other.0.train[0].outputs(), a.train[0].outputs());
    }
}
