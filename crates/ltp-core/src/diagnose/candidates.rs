//! Candidates: every effect of the library at every place, added to a fitted hypothesis, with the points from which a fit may
//! begin.
//!
//! A parameter of an effect is an *amplitude* (the action is in proportion to it near its neutral value: a linearised test
//! finds its start), a *shape* (a speed, a width, a time: a grid in units of the motion), or follows from the others.

use indexmap::IndexMap;

use super::experiment::FINEST;
use super::fit::{Point, Prior};
use super::law::evaluate;
use super::sizes::Sizes;
use super::trial::{Made, Trial};
use crate::error::Result;
use crate::model::effects::EffectParameter;
use crate::model::{Effect, Model, System};
use crate::simulate::STEPS_PER_TIME;

/// A shape may leave its grid by these factors.
const BEYOND: (f64, f64) = (1.0 / 200.0, 10.0);
/// What is in units of a force may leave it by these: the missing force, by which it is scaled, is what other parameters have
/// left of it.
const FORCEFUL: (f64, f64) = (1e-5, 1e4);
/// Relative distance of two frequencies below which a fit finds one from the other.
const SAME: f64 = 0.01;
/// Amplitude of a finite probe, in natural sizes.
const PROBE: f64 = 0.2;
/// Shortest time constant, in steps: it is integrated with steps as fine as a run ever takes.
const SHORTEST: f64 = 1.0 / (STEPS_PER_TIME * FINEST);

/// A place and what is known of it.
#[derive(Clone, Debug)]
pub struct Place {
    /// Name.
    pub at: String,
    /// Natural sizes.
    pub sizes: Sizes,
    /// Wavelengths and angular frequencies that stand out in the missing force, the strongest first.
    pub waves: Waves,
}

/// Periods that stand out in a missing force.
#[derive(Clone, Debug, Default)]
pub struct Waves {
    /// Wavelengths over position.
    pub lengths: Vec<f64>,
    /// Angular frequencies over time, rad/s.
    pub omegas: Vec<f64>,
}

impl Waves {
    /// The same with further angular frequencies, where they are not there already.
    pub fn and(mut self, omegas: &[f64]) -> Self {
        let near = |known: &[f64], w: f64| known.iter().any(|o| (o - w).abs() < SAME * w);
        for w in omegas {
            if !near(&self.omegas, *w) {
                self.omegas.push(*w);
            }
        }
        self
    }
}

/// A way in which a candidate's action is first looked at.
#[derive(Clone, Debug)]
pub struct Probe {
    /// Values of the effect's own parameters.
    pub own: Vec<f64>,
    /// Amplitudes among them whose derivatives there are the action; none where the action is the whole difference that `own`
    /// makes.
    pub amplitudes: Vec<usize>,
    /// Amplitude and phase of a wave: `own` is its sine, the same with a phase of a quarter turn its cosine.
    pub wave: Option<(usize, usize)>,
}

/// An effect at a place, attached to a fitted hypothesis.
pub struct Candidate {
    /// The hypothesis, not yet fitted.
    pub made: Made,
    /// Places of its own parameters among the free ones.
    pub own: Vec<usize>,
    /// Ways to look at it.
    pub probes: Vec<Probe>,
    /// Values at which the effect is absent (infinite where it is absent at infinity).
    pub neutral: Vec<f64>,
    /// Which of its own parameters are its size.
    sizes: Vec<bool>,
    /// Whether they are in units of a force.
    pub forceful: bool,
    /// Simpler effect that it contains.
    pub extends: Option<String>,
}

impl Candidate {
    /// Attaches an effect to a fitted hypothesis.
    ///
    /// # Errors
    /// What [`Model::attach`] says.
    pub fn new(base: &Trial, name: &str, place: &Place, step: f64) -> Result<Self> {
        let model = base.made.model.attach(name, &place.at, &[])?;
        let effect = model.library().get(name)?.clone();
        let system = model.compile();
        let first = base.made.priors.len();
        let own: Vec<usize> = (first..system.free().len()).collect();
        let mut priors = base.made.priors.clone();
        priors.extend(effect.parameters.iter().map(|(_, p)| prior(&effect, p, place, step)));
        let mut extra = base.made.extra.clone();
        extra.extend(effect.states.values().map(|s| place.sizes.of(&s.unit)));
        let mut effects = base.made.effects.clone();
        effects.push((name.to_string(), place.at.clone()));
        let probes = probes(&effect, place, &model)?;
        debug_assert_eq!(system.states(), base.made.system.states() + effect.states.len());
        let made = Made { effects, model, system, priors, extra };
        let neutral = effect.parameters.values().map(|p| p.neutral).collect();
        let (sizes, extends) = (sizes(&effect), effect.extends.clone());
        let forceful = effect.parameters.values().zip(&sizes).any(|(p, size)| *size && p.scale.contains("force"));
        Ok(Self { made, own, probes, neutral, sizes, forceful, extends })
    }

    /// Own parameters with the size of the effect multiplied, from where it is absent: its amplitudes, or else what it has that
    /// vanishes (the width of a gap, a delay).
    pub fn resized(&self, own: &[f64], by: f64) -> Vec<f64> {
        let scaled = |(k, v): (usize, &f64)| {
            let bounds = self.made.priors[self.own[k]].bounds;
            let wanted = if self.sizes[k] { self.neutral[k] + by * (v - self.neutral[k]) } else { *v };
            wanted.clamp(bounds.0, bounds.1)
        };
        own.iter().enumerate().map(scaled).collect()
    }

    /// A point of the same effect at another place, within the bounds that this place sets.
    pub fn clamped(&self, point: &Point) -> Point {
        let bounded = |(v, prior): (&f64, &Prior)| v.clamp(prior.bounds.0, prior.bounds.1);
        let theta = point.theta.iter().zip(&self.made.priors).map(bounded).collect();
        Point { theta, x0: point.x0.clone() }
    }

    /// `effect@place` of the newest effect.
    pub fn label(&self) -> String {
        self.made.effects.last().map_or(String::new(), |(e, p)| format!("{e}@{p}"))
    }
}

/// Which parameters of an effect are its size: those in units of a force (a flexible part keeps its frequency when its mass,
/// stiffness and damping grow together), or else what is not a shape, or, where all are shapes, what can vanish. An effect that
/// is absent at infinity has none.
fn sizes(effect: &Effect) -> Vec<bool> {
    let of =
        |which: &dyn Fn(&EffectParameter) -> bool| -> Vec<bool> { effect.parameters.values().map(which).collect() };
    let shape = |p: &EffectParameter| !p.shape.is_empty() || p.value.is_some();
    if !effect.parameters.values().all(|p| p.neutral.is_finite()) {
        return of(&|_| false);
    }
    let tests: [&dyn Fn(&EffectParameter) -> bool; 3] = [&|p| p.scale.contains("force"), &|p| !shape(p), &|_| true];
    tests.into_iter().map(of).find(|found| found.contains(&true)).unwrap_or_default()
}

/// What is known of a parameter of an effect at a place.
fn prior(effect: &Effect, p: &EffectParameter, place: &Place, step: f64) -> Prior {
    let scale = place.sizes.of(&p.scale);
    let bounds = (p.min.unwrap_or(f64::NEG_INFINITY), p.max.unwrap_or(f64::INFINITY));
    let unknown = Prior { mean: scale, sd: f64::INFINITY, bounds, scale, log: false };
    if let (Some(value), Some(sd)) = (p.value, p.sd) {
        return Prior { mean: value, sd, scale: sd, ..unknown };
    }
    let positive = bounds.0 >= 0.0 && p.shape.iter().all(|s| *s > 0.0);
    if p.shape.is_empty() || !positive {
        return unknown;
    }
    let reach = |f: fn(f64, f64) -> f64, from: f64| p.shape.iter().copied().fold(from, f);
    let shortest = if !effect.states.is_empty() && p.scale == "time" { SHORTEST * step } else { 0.0 };
    let beyond = if p.scale.contains("force") { FORCEFUL } else { BEYOND };
    let low = (beyond.0 * scale * reach(f64::min, f64::INFINITY)).max(bounds.0).max(shortest);
    let high = (beyond.1 * scale * reach(f64::max, 0.0)).min(bounds.1).max(2.0 * low);
    Prior { bounds: (low, high), log: true, ..unknown }
}

/// The grid of shapes, with the amplitudes that a test has to find.
fn probes(effect: &Effect, place: &Place, model: &Model) -> Result<Vec<Probe>> {
    let names: Vec<&String> = effect.parameters.keys().collect();
    let index = |name: &str| names.iter().position(|n| *n == name);
    let wave = match (index("amplitude"), index("phase")) {
        (Some(a), Some(p)) => Some((a, p)),
        _ => None,
    };
    let mut grid: Vec<Vec<f64>> = vec![Vec::new()];
    let mut amplitudes = Vec::new();
    for (k, (name, p)) in effect.parameters.iter().enumerate() {
        let scale = place.sizes.of(&p.scale);
        let values: Vec<f64> = match name.as_str() {
            "phase" if wave.is_some() => vec![0.0],
            "wavelength" if !place.waves.lengths.is_empty() => place.waves.lengths.clone(),
            "omega" if !place.waves.omegas.is_empty() => place.waves.omegas.clone(),
            _ if !p.shape.is_empty() => p.shape.iter().map(|s| s * scale).collect(),
            _ if p.start.is_some() => vec![f64::NAN],
            _ if p.value.is_some() && p.sd.is_some() => vec![p.value.unwrap_or(0.0)],
            _ => {
                amplitudes.push(k);
                vec![p.neutral]
            }
        };
        grid = grid.iter().flat_map(|g| values.iter().map(move |v| [g.as_slice(), &[*v]].concat())).collect();
    }
    // Where other parameters follow from an amplitude, or the law has a kink at zero size, the action is seen at a finite size.
    let follows = effect.parameters.values().any(|p| p.start.is_some());
    for own in &mut grid {
        if follows {
            for &k in &amplitudes {
                let p = effect.parameters.get_index(k).map(|(_, p)| p);
                own[k] = p.map_or(0.0, |p| p.neutral + PROBE * place.sizes.of(&p.scale));
            }
        }
        fill(effect, own, model)?;
    }
    let amplitudes = if follows { Vec::new() } else { amplitudes };
    Ok(grid.into_iter().map(|own| Probe { own, amplitudes: amplitudes.clone(), wave }).collect())
}

/// Parameters that follow from the others.
fn fill(effect: &Effect, own: &mut [f64], model: &Model) -> Result<()> {
    for (k, (_, p)) in effect.parameters.iter().enumerate() {
        if let (true, Some(text)) = (own[k].is_nan(), &p.start) {
            let known: IndexMap<&str, f64> = effect
                .parameters
                .keys()
                .map(String::as_str)
                .zip(own.iter().copied())
                .filter(|(_, v)| !v.is_nan())
                .collect();
            own[k] = evaluate(text, &known, model.library())?;
        }
    }
    Ok(())
}

/// Starting values of a richer effect's parameters from those of the simpler one that it contains: one point per shape.
///
/// # Errors
/// [`crate::Error::Expression`] in a starting value of the library.
pub fn inherited(candidate: &Candidate, simple: &IndexMap<String, f64>) -> Result<Vec<Vec<f64>>> {
    let model = &candidate.made.model;
    let Some((name, _)) = candidate.made.effects.last() else { return Ok(Vec::new()) };
    let effect = model.library().get(name)?;
    let mut points = Vec::new();
    for probe in &candidate.probes {
        let mut own = probe.own.clone();
        for (k, (name, p)) in effect.parameters.iter().enumerate() {
            match simple.get(name) {
                Some(v) => own[k] = *v,
                None if p.start.is_some() => own[k] = f64::NAN,
                None => {}
            }
        }
        fill(effect, &mut own, model)?;
        points.push(own);
    }
    Ok(points)
}
