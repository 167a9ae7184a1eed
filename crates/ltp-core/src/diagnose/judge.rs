//! From fitted candidates to a verdict: ranking, nested families, acceptance, and what cannot be told apart.

use super::fit::{FINE, Ground, Point, full, stage};
use super::prepare::Ties;
use super::score::Residuals;
use super::seen::Doubt;
use super::trial::{Attachment, Bench, Trial, starts, widened};
use crate::error::Result;

/// Deviance within which two candidates count as the same answer.
pub const APART: f64 = 10.0;
/// Mean square residual in units of noise up to which nothing is left to explain.
pub const EXPLAINED: f64 = 1.10;
/// Deviance within which chance decides which of two fits better.
const EQUAL: f64 = 2.0;
/// Share of the structural error that a named effect must remove where it was not fitted.
const MATERIAL: f64 = 0.25;
/// Energy beyond noise, as a share of that of the noise, below which no share of it can be measured: an error of 1.1 floors, as
/// near as a floor is known.
const FAINT: f64 = 0.21;
/// A size that is not this many of its own standard deviations from zero is no size.
const SIZED: f64 = 3.0;
/// Smallest excess of a richer law over the simpler one, in units of the simpler one.
const EXCESS: f64 = 0.25;

/// The ranking: index into the trials and score, best first. The nominal model stands among them.
pub struct Ranking {
    /// Index of the trial (`None` for nothing) and its score.
    pub order: Vec<(Option<usize>, f64)>,
}

/// The hypothesis so far stands among those that add an effect to it.
///
/// BIC on the train records plus deviance on the held-out ones, of residuals whitened by one common filter.
pub fn rank<'t>(base: &'t Trial, trials: impl IntoIterator<Item = &'t Trial>) -> Ranking {
    let white = |t: &Trial| t.residuals.deviance(&t.residuals.train) + t.residuals.deviance(&t.residuals.test);
    let runs: Vec<(Option<usize>, &Trial)> = std::iter::once((None, base))
        .chain(trials.into_iter().enumerate().map(|(i, t)| (Some(i), t)))
        .filter(|(_, t)| t.residuals.complete())
        .collect();
    let reference = runs.iter().min_by(|a, b| white(a.1).total_cmp(&white(b.1))).map_or(base, |r| r.1);
    let filters = reference.residuals.filters();
    let mut order: Vec<(Option<usize>, f64)> = runs
        .iter()
        .map(|(i, t)| {
            let r = &t.residuals;
            let samples: f64 = (0..filters.len()).map(|j| r.energy(&r.train, j).1).sum();
            let deviance = r.whitened_deviance(&r.train, &filters) + r.whitened_deviance(&r.test, &filters);
            (*i, deviance + t.unknowns() as f64 * samples.max(2.0).ln())
        })
        .collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    Ranking { order }
}

impl Ranking {
    /// The best effect, after nested families: a richer law must win by [`APART`] and be materially richer.
    pub fn winner(&self, trials: &[Trial]) -> Option<usize> {
        // What has not converged is no fit yet; it is named only where it explains everything, or nothing else is there to name.
        let ready = |i: &usize| trials[*i].fit.converged || trials[*i].left() <= EXPLAINED;
        let first = self.order.iter().filter_map(|(i, _)| *i).find(ready);
        let mut best = first.or_else(|| self.order.iter().find_map(|(i, _)| *i))?;
        // Where chance decides the order, the simplest comes first.
        let as_good = |(i, s): &(Option<usize>, f64)| i.filter(|i| ready(i) && *s - self.score(Some(best)) < EQUAL);
        if let Some(simplest) = self.order.iter().filter_map(as_good).min_by_key(|&i| simplicity(&trials[i])) {
            best = simplest;
        }
        // A name that the recordings do not show gives way to one that fits as well.
        if trials[best].doubt.is_some() {
            let top = self.score(Some(best));
            let shown = |(i, s): &(Option<usize>, f64)| i.filter(|&i| trials[i].doubt.is_none() && s - top < APART);
            best = self.order.iter().find_map(shown).unwrap_or(best);
        }
        while let Some(simple) = self.simpler(trials, best) {
            best = simple;
        }
        Some(best)
    }

    /// Score of a trial, or of none.
    pub fn score(&self, trial: Option<usize>) -> f64 {
        self.order.iter().find(|(i, _)| *i == trial).map_or(f64::INFINITY, |(_, s)| *s)
    }

    /// The simpler member that should be named instead of a richer one, if it should.
    fn simpler(&self, trials: &[Trial], rich: usize) -> Option<usize> {
        let (name, at) = trials[rich].made.effects.last()?;
        let effect = trials[rich].made.model.library().get(name).ok()?;
        let base = effect.extends.as_ref()?;
        let simple = trials.iter().position(|t| t.made.effects.last().is_some_and(|(e, p)| e == base && p == at))?;
        if !self.score(Some(simple)).is_finite() {
            return None;
        }
        let wins = self.score(Some(simple)) - self.score(Some(rich)) > APART;
        let p = trials[rich].effect_parameters(trials[rich].made.effects.len() - 1);
        // `a - b` of two parameters against `b`.
        let material = effect.excess.as_deref().and_then(|e| e.split_once('-')).is_none_or(|(a, b)| {
            let value = |n: &str| p.get(n.trim()).copied().unwrap_or(0.0);
            value(a) - value(b) >= EXCESS * value(b).abs()
        });
        (!(wins && material)).then_some(simple)
    }

    /// What the recordings cannot tell from the winner. Members of its own family are not another answer, but for a richer
    /// law that fits decisively better without being materially richer: neither name is certain then.
    pub fn ambiguous(&self, trials: &[Trial], winner: usize) -> Vec<usize> {
        let family = |i: usize| -> Option<Attachment> {
            let (name, at) = trials[i].made.effects.last()?;
            let effect = trials[i].made.model.library().get(name).ok()?;
            Some((effect.extends.clone().unwrap_or_else(|| name.clone()), at.clone()))
        };
        let best = self.score(Some(winner));
        let near = self.order.iter().filter_map(|(i, s)| i.filter(|_| *s - best < APART));
        near.filter(|&i| {
            i != winner
                && trials[i].doubt.is_none()
                && (family(i) != family(winner) || best - self.score(Some(i)) > APART)
        })
        .collect()
    }

    /// Distance of each entry to the winner.
    pub fn relative(&self, winner: Option<usize>) -> Vec<(Option<usize>, f64)> {
        let best = winner.map_or(self.order.first().map_or(0.0, |o| o.1), |w| self.score(Some(w)));
        self.order.iter().map(|(i, s)| (*i, s - best)).collect()
    }
}

/// How much an effect's document says: parameters, states and corners.
fn simplicity(t: &Trial) -> usize {
    let newest = t.made.effects.last().and_then(|(name, _)| t.made.model.library().get(name).ok());
    newest.map_or(0, |e| e.parameters.len() + e.states.len() + e.corners.len())
}

/// Why an effect is accepted or not: every test with its number.
#[derive(Clone, Copy, Debug)]
pub struct Evidence {
    /// Gain in white deviance plus penalty on the train records.
    pub gain: f64,
    /// Change of white deviance on the held-out records; negative is better.
    pub held_out: f64,
    /// Gain in deviance of residuals whitened by the candidate's own filter, train and held-out.
    pub whitened: f64,
    /// Share of the structural error removed where nothing but initial states was fitted: on the held-out records, or,
    /// where these are cut from the train records, on the half of the train records that was not fitted.
    pub predicted: f64,
    /// Share of the structural error of the train records removed.
    pub share: f64,
    /// What a gain must exceed.
    pub threshold: f64,
    /// Distance of the least certain added effect from none at all, in standard deviations of its size.
    pub sized: f64,
    /// Whether what is unexplained is so far below the noise, on the train and on the held-out records, that no share of it can
    /// be measured: then the likelihood of records that were not fitted decides.
    pub faint: (bool, bool),
    /// Whether the recordings show what its name says.
    pub shown: bool,
}

impl Evidence {
    /// Whether the effect is real, predicts, and matters, its size is told from zero, and it is shown.
    pub fn accepted(&self) -> bool {
        self.explains() && self.sized >= SIZED && self.shown
    }

    /// Whether it is real, predicts, and matters: all that can be asked of a law in many coefficients that share its size.
    pub fn explains(&self) -> bool {
        let (train, test) = self.faint;
        self.gain > self.threshold
            && self.held_out < if test { -self.threshold } else { 0.0 }
            && self.whitened > self.threshold
            && (test || self.predicted >= MATERIAL)
            && (train || self.share >= MATERIAL)
    }

    /// What speaks for an effect that was not accepted, and what against it; `None` where little speaks for it.
    pub fn refusal(&self, label: &str, doubt: Option<&Doubt>) -> Option<String> {
        let percent = |v: f64| format!("{:.0} %", 100.0 * v);
        let number = super::words::number;
        let tests = [
            (self.held_out >= 0.0, "it predicts the held-out records worse than the model without it".to_string()),
            (
                self.faint.1 && self.held_out < 0.0 && self.held_out >= -self.threshold,
                format!(
                    "on the held-out records, which hold hardly more than noise, it gains {} units, not {}",
                    number(-self.held_out),
                    number(self.threshold)
                ),
            ),
            (
                !self.faint.1 && self.predicted < MATERIAL,
                format!(
                    "where it had to predict it removes {} of the error beyond noise, not {}",
                    percent(self.predicted),
                    percent(MATERIAL)
                ),
            ),
            (
                !self.faint.0 && self.share < MATERIAL,
                format!(
                    "it removes {} of that error where it was fitted, not {}",
                    percent(self.share),
                    percent(MATERIAL)
                ),
            ),
            (
                self.whitened <= self.threshold,
                format!(
                    "with coloured noise allowed for it gains {} units, not {}",
                    number(self.whitened),
                    number(self.threshold)
                ),
            ),
            (self.sized < SIZED, "its size is not told from zero".to_string()),
            (!self.shown, doubt.map_or(String::new(), Doubt::words)),
        ];
        let against: Vec<String> = tests.into_iter().filter(|(fails, _)| *fails).map(|(_, text)| text).collect();
        (self.gain > self.threshold && self.share >= 0.1 && !against.is_empty()).then(|| {
            format!(
                "`{label}` fits the train records better (by {} units) but was not accepted: {}; record longer, or a second run, \
                 to decide",
                number(self.gain),
                against.join("; ")
            )
        })
    }
}

/// Weighs a candidate against the nominal model.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn weigh(
    bench: &Bench<'_>,
    nominal: &Trial,
    trial: &Trial,
    halves: Option<&Halves>,
    library: usize,
) -> Result<Evidence> {
    let (a, b) = (&nominal.residuals, &trial.residuals);
    let samples: f64 = (0..bench.train.sigma.len()).map(|j| a.energy(&a.train, j).1).sum();
    let added = (trial.fit.point.theta.len() - nominal.fit.point.theta.len()) as f64;
    let filters = b.filters();
    let whitened = |r: &Residuals| r.whitened_deviance(&r.train, &filters) + r.whitened_deviance(&r.test, &filters);
    Ok(Evidence {
        gain: a.deviance(&a.train) - b.deviance(&b.train) - added * samples.max(2.0).ln(),
        held_out: b.deviance(&b.test) - a.deviance(&a.test),
        whitened: whitened(a) - whitened(b),
        predicted: match halves {
            Some(h) => crossed(bench, nominal, trial, h)?,
            None => removed(&[(a, &a.test)], &[(b, &b.test)]),
        },
        share: removed(&[(a, &a.train)], &[(b, &b.train)]),
        threshold: 12.0 + 2.0 * (library.max(1) as f64).ln(),
        sized: sized(trial, nominal.made.effects.len())?,
        faint: (faint(a, &a.train), halves.is_none() && faint(a, &a.test)),
        shown: trial.doubt.is_none(),
    })
}

/// Whether records hold hardly more than noise.
fn faint(r: &Residuals, records: &[Vec<f64>]) -> bool {
    let samples: f64 = records.iter().flatten().filter(|v| v.is_finite()).count() as f64;
    r.structural(records) < FAINT * samples
}

/// How far the added effects' sizes are from where they would be absent, in standard deviations: the least of them counts. A
/// phase or a wavelength is well determined also of a force that is not there.
fn sized(t: &Trial, before: usize) -> Result<f64> {
    let sd = t.sds();
    let mut least = f64::INFINITY;
    for (k, (name, _)) in t.made.effects.iter().enumerate().skip(before) {
        let effect = t.made.model.library().get(name)?;
        let is_size = |own: &str| {
            effect.parameters.get(own).is_some_and(|p| p.shape.is_empty() && p.value.is_none() && p.neutral.is_finite())
        };
        let own = t.own(k);
        let any = own.iter().any(|(_, n)| is_size(n));
        let far = own.iter().filter(|(_, n)| !any || is_size(n)).map(|(i, n)| {
            let absent = effect.parameters.get(n).map_or(0.0, |p| p.neutral);
            let absent = if absent.is_finite() { absent } else { 0.0 };
            if sd[*i] > 0.0 { (t.fit.point.theta[*i] - absent).abs() / sd[*i] } else { 0.0 }
        });
        least = least.min(far.fold(0.0, f64::max));
    }
    Ok(if least.is_finite() { least } else { 0.0 })
}

/// Share of structural error removed between two sets of residuals.
pub fn removed(before: &[(&Residuals, &[Vec<f64>])], after: &[(&Residuals, &[Vec<f64>])]) -> f64 {
    let total = |set: &[(&Residuals, &[Vec<f64>])]| set.iter().map(|(r, records)| r.structural(records)).sum::<f64>();
    let (e0, e1) = (total(before), total(after));
    if e0 > 0.0 { ((e0 - e1) / e0).clamp(-9.0, 1.0) } else { 0.0 }
}

/// Halves of the train records with observers for the second start.
pub struct Halves {
    /// First and second halves of all train records.
    pub parts: [Vec<super::experiment::Experiment>; 2],
    /// Starting states of each half.
    pub start: [Vec<Vec<f64>>; 2],
    /// Observers of each half.
    pub ties: [Ties; 2],
}

/// Two-fold prediction inside the train records: fit one half, predict the other, and compare with the nominal model. An
/// effect that is an accident of one record moves when the record is cut; physics does not.
fn crossed(bench: &Bench<'_>, nominal: &Trial, trial: &Trial, halves: &Halves) -> Result<f64> {
    let mut energy = [0.0; 2];
    for (which, t) in [nominal, trial].into_iter().enumerate() {
        for fold in 0..2 {
            bench.train.control.check()?;
            let other = 1 - fold;
            let fitted = Ground { experiments: &halves.parts[fold], ..bench.train };
            let predicted = Ground { experiments: &halves.parts[other], ..bench.train };
            let subject = t.made.subject();
            let from_here = |theta: &[f64], ground: Ground<'_>, half: usize| {
                let p = full(&t.made.system, theta);
                let near = widened(&t.made.system, &p, ground.experiments, &halves.start[half]);
                starts(&t.made.model, &t.made.extra, &p, ground, &near, &halves.ties[half], None)
            };
            let x0 = from_here(&t.fit.point.theta, fitted, fold);
            let from = Point { theta: t.fit.point.theta.clone(), x0 };
            let theta = stage(&subject, fitted, &from, &halves.start[fold], None, FINE)
                .map_or(t.fit.point.theta.clone(), |f| f.point.theta);
            let x0 = from_here(&theta, predicted, other);
            let p = full(&t.made.system, &theta);
            let r =
                Residuals::of(&t.made.system, &p, (predicted, &x0), (Ground { experiments: &[], ..predicted }, &[]));
            energy[which] += if r.complete() { r.structural(&r.train) } else { f64::INFINITY };
        }
    }
    Ok(if energy[0] > 0.0 && energy[1].is_finite() { (energy[0] - energy[1]) / energy[0] } else { 0.0 })
}
