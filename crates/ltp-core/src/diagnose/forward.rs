//! From the nominal model to what explains the recordings: effects are added one at a time while each is accepted on its own
//! evidence, two at once where neither is needed without the other, and every earlier one is taken out again for trial.

use rayon::prelude::*;

use super::candidates::Place;
use super::fit::{FINE, Ground, Point, stage};
use super::judge::{self, EXPLAINED, Evidence, Halves, Ranking};
use super::places::beside;
use super::prepare::Scene;
use super::runner::Aside;
use super::search::{Found, LONG, Pair, search};
use super::seen::doubt;
use super::trial::{Attachment, Bench, Made, Trial, finish, label};
use crate::error::Result;
use crate::model::System;

/// Effects at most.
const MOST: usize = 3;
/// Shares of the nominal structural error, and of what is left of it, that a further effect must remove, unless nothing is left
/// to explain with it: one that polishes is as likely to be another law's.
const WORTHWHILE: f64 = 0.02;
const HALF: f64 = 0.5;
/// Share of the nominal structural error below which even that is a trifle: an input between its samples, not physics.
const TRIFLE: f64 = 1e-5;
/// Energy over that of the fit before it up to which the last fit stands.
const AS_GOOD: f64 = 1.1;
/// How much finer the steps of the last fit are.
const FINER: u64 = 2;
/// Other first effects that are followed where the best one leads nowhere.
const OTHERS: usize = 3;
/// Pairs that are tried where no single effect is accepted.
const PAIRS: usize = 8;

/// One round of the search: what was added to the hypothesis so far, and what else was tried.
pub struct Round {
    /// Hypothesis to which candidates were added.
    pub onto: Vec<Attachment>,
    /// All candidates of the round that were fitted to the end.
    pub trials: Vec<Trial>,
    /// The others.
    pub aside: Vec<Aside>,
    /// Their ranking.
    pub ranking: Ranking,
    /// The best, if it was accepted.
    pub accepted: Option<usize>,
    /// What spoke for the best.
    pub evidence: Option<Evidence>,
    /// What the recordings cannot tell from the accepted one.
    pub near: Vec<usize>,
}

/// What the search came to.
pub struct Explained {
    /// The nominal model.
    pub nominal: Trial,
    /// Rounds in order.
    pub rounds: Vec<Round>,
    /// The last hypothesis after pruning; `None` where it is the accepted trial of the last round.
    pub pruned: Option<Trial>,
    /// Gain of each effect's share, in the order of the last hypothesis.
    pub shares: Vec<f64>,
}

impl Explained {
    /// The hypothesis that was accepted last, the nominal model where none was.
    pub fn last(&self) -> &Trial {
        if let Some(t) = &self.pruned {
            return t;
        }
        let accepted = self.rounds.iter().rev().find_map(|r| r.accepted.map(|i| &r.trials[i]));
        accepted.unwrap_or(&self.nominal)
    }

    /// Whether any effect was accepted.
    pub fn found(&self) -> bool {
        !self.last().made.effects.is_empty()
    }
}

/// Explains the recordings as far as the library goes.
///
/// # Errors
/// [`crate::Error::Interrupted`], and what attaching an effect may say.
pub fn explain(
    bench: &Bench<'_>,
    scene: &Scene,
    nominal: Trial,
    jobs: &[(String, Place)],
    halves: Option<&Halves>,
    warnings: &mut Vec<String>,
) -> Result<Explained> {
    let mut out = Explained { nominal, rounds: Vec::new(), pruned: None, shares: Vec::new() };
    let original = out.nominal.residuals.structural(&out.nominal.residuals.train);
    for round in 0..MOST {
        let onto = out.last().made.effects.clone();
        let open = beside(bench, scene, out.last(), jobs)?;
        let share = if round == 0 { (0.2, 0.75) } else { (0.75, 0.9) };
        let found = search(bench, out.last(), &open, share, round == 0)?;
        let mut next = judged(bench, out.last(), found, onto, halves, &open)?;
        if next.round.accepted.is_none() && round == 0 {
            let hope = out.last().left() > EXPLAINED;
            if let Some(pair) = if hope { both(bench, out.last(), &open, &next, halves)? } else { None } {
                next.round = pair;
            }
        }
        let (accepted, evidence) = (next.round.accepted, next.round.evidence);
        if let (Some(w), Some(e), None) = (next.winner, evidence, accepted) {
            let t = &next.round.trials[w];
            warnings.extend(e.refusal(&t.label(), t.doubt.as_ref()).filter(|_| round == 0));
        }
        let added = accepted.map(|i| &next.round.trials[i]);
        let worth = added.is_some_and(|t| round == 0 || worthwhile(out.last(), t, evidence, original));
        if !worth {
            next.round.accepted = None;
            if round == 0 {
                out.rounds.push(next.round);
            }
            break;
        }
        out.rounds.push(next.round);
        out.pruned = None;
        // What is left after an effect was taken out again must still stand by itself.
        if let Some(simpler) = pruned(bench, out.last())?
            && judge::weigh(bench, &out.nominal, &simpler, halves, open.len())?.accepted()
        {
            out.pruned = Some(simpler);
        }
        if out.last().left() <= EXPLAINED {
            break;
        }
    }
    if out.found() && out.last().left() > EXPLAINED && bench.samples() < LONG {
        reconsidered(bench, scene, &mut out, jobs, halves)?;
    }
    out.shares = shares(bench, &out)?;
    if out.found()
        && let Some(exact) = polished(bench, out.last())?
    {
        out.pruned = Some(exact);
    }
    Ok(out)
}

/// Whether a further effect matters: it takes away most of what is left, and some of what the nominal model leaves, or it leaves
/// nothing to explain and took away more than a trifle.
fn worthwhile(before: &Trial, with: &Trial, evidence: Option<Evidence>, original: f64) -> bool {
    let energy = |t: &Trial| t.residuals.structural(&t.residuals.train);
    let removed = energy(before) - energy(with);
    let most = evidence.is_some_and(|e| e.share.min(e.predicted) >= HALF);
    (removed > WORTHWHILE * original && most) || (removed > TRIFLE * original && with.left() <= EXPLAINED)
}

/// The effect that explains most by itself may be the wrong half of two: where much is left with it, those that came after it
/// are followed by a step, and one that leads to a decisively better end takes its place.
fn reconsidered(
    bench: &Bench<'_>,
    scene: &Scene,
    out: &mut Explained,
    jobs: &[(String, Place)],
    halves: Option<&Halves>,
) -> Result<()> {
    let Some(first) = out.rounds.first() else { return Ok(()) };
    let original = out.nominal.residuals.structural(&out.nominal.residuals.train);
    let follow = |i: &usize| {
        let t = &first.trials[*i];
        let better = first.ranking.score(Some(*i)) < first.ranking.score(None) - judge::APART;
        first.accepted != Some(*i) && t.made.effects.len() == 1 && t.doubt.is_none() && t.fit.converged && better
    };
    let mut ends: Vec<(usize, Round, usize)> = Vec::new();
    for i in first.ranking.order.iter().filter_map(|(i, _)| *i).filter(follow).take(OTHERS) {
        let base = &first.trials[i];
        let open = beside(bench, scene, base, jobs)?;
        let found = search(bench, base, &open, (0.9, 0.9), false)?;
        let round = judged(bench, base, found, base.made.effects.clone(), halves, &open)?.round;
        if let Some(k) = round.accepted
            && worthwhile(base, &round.trials[k], round.evidence, original)
            && judge::weigh(bench, &out.nominal, &round.trials[k], halves, jobs.len())?.accepted()
        {
            ends.push((i, round, k));
        }
    }
    let ranking = judge::rank(out.last(), ends.iter().map(|(_, round, k)| &round.trials[*k]));
    let Some(best) = ranking.order.first().and_then(|(i, _)| *i) else { return Ok(()) };
    if ranking.score(None) - ranking.score(Some(best)) < judge::APART {
        return Ok(());
    }
    let as_good = |n: &usize| *n != best && ranking.score(Some(*n)) - ranking.score(Some(best)) < judge::APART;
    let near = (0..ends.len()).filter(as_good).map(|n| ends[n].0).collect();
    let (i, second, _) = ends.swap_remove(best);
    out.pruned = None;
    out.rounds.truncate(1);
    let evidence = judge::weigh(bench, &out.nominal, &out.rounds[0].trials[i], halves, jobs.len())?;
    let first = &mut out.rounds[0];
    (first.accepted, first.evidence, first.near) = (Some(i), Some(evidence), near);
    out.rounds.push(second);
    Ok(())
}

/// A hypothesis fitted once more with steps half as long, from where it stood: an error of the engine that is far below the
/// noise is still the same at every sample, and thousands of samples tell a tenth of a noise from none.
fn polished(bench: &Bench<'_>, t: &Trial) -> Result<Option<Trial>> {
    let substeps = FINER * bench.train.substeps;
    let fine = Ground { substeps, ..bench.train };
    let made = t.made.copy();
    let fit = stage(&made.subject(), fine, &t.fit.point, bench.train_start, None, FINE);
    let exact = fit.map(|f| finish(bench, made, f, &t.test_x0)).transpose()?;
    // Run like all others; a fit that the engine's error held together is told as it was.
    let energy = |t: &Trial| {
        let all = |records: &[Vec<f64>]| records.iter().flatten().filter(|v| v.is_finite()).map(|v| v * v).sum::<f64>();
        (all(&t.residuals.train), all(&t.residuals.test))
    };
    let before = energy(t);
    Ok(exact.filter(|e| {
        let (train, test) = energy(e);
        e.residuals.complete() && train <= AS_GOOD * before.0 && test <= AS_GOOD * before.1
    }))
}

/// A round with the candidate that came out best.
struct Judged {
    round: Round,
    winner: Option<usize>,
    pairs: Vec<Pair>,
}

fn judged(
    bench: &Bench<'_>,
    base: &Trial,
    found: Found,
    onto: Vec<Attachment>,
    halves: Option<&Halves>,
    jobs: &[(String, Place)],
) -> Result<Judged> {
    let Found { mut trials, aside, pairs } = found;
    trials.par_iter_mut().try_for_each(|t| {
        t.doubt = doubt(bench, t, onto.len(), jobs)?;
        Ok(())
    })?;
    let ranking = judge::rank(base, &trials);
    let winner = ranking.winner(&trials);
    let evidence = match winner {
        Some(w) => Some(judge::weigh(bench, base, &trials[w], halves, jobs.len())?),
        None => None,
    };
    let accepted = winner.filter(|_| evidence.is_some_and(|e| e.accepted()));
    let near = accepted.map_or(Vec::new(), |w| ranking.ambiguous(&trials, w));
    Ok(Judged { round: Round { onto, trials, aside, ranking, accepted, evidence, near }, winner, pairs })
}

/// Two effects at once: the pairs that promise most beyond their better half, fitted one on top of the other.
fn both(
    bench: &Bench<'_>,
    base: &Trial,
    jobs: &[(String, Place)],
    single: &Judged,
    halves: Option<&Halves>,
) -> Result<Option<Round>> {
    let mut hopeful: Vec<&Pair> =
        single.pairs.iter().filter(|p| p.together - p.alone > 0.1 * p.together && p.together > judge::APART).collect();
    hopeful.truncate(PAIRS);
    let job = |a: &Attachment| jobs.iter().find(|(n, p)| *n == a.0 && p.at == a.1).cloned();
    let fitted: Vec<Vec<Trial>> = hopeful
        .par_iter()
        .map(|pair| -> Result<Vec<Trial>> {
            let [Some(first), Some(second)] = [job(&pair.effects[0]), job(&pair.effects[1])] else {
                return Ok(Vec::new());
            };
            let one = search(bench, base, &[first], (0.75, 0.75), false)?;
            let Some(a) = one.trials.into_iter().next() else { return Ok(Vec::new()) };
            Ok(search(bench, &a, &[second], (0.75, 0.75), false)?.trials)
        })
        .collect::<Result<_>>()?;
    let mut trials: Vec<Trial> = fitted.into_iter().flatten().collect();
    for t in &mut trials {
        t.doubt = doubt(bench, t, base.made.effects.len(), jobs)?;
    }
    if trials.is_empty() {
        return Ok(None);
    }
    let ranking = judge::rank(base, &trials);
    let Some(best) = ranking.order.iter().find_map(|(i, _)| *i) else { return Ok(None) };
    let evidence = judge::weigh(bench, base, &trials[best], halves, jobs.len() * jobs.len() / 2)?;
    if !evidence.accepted() {
        return Ok(None);
    }
    let near = ranking.ambiguous(&trials, best);
    let onto = base.made.effects.clone();
    Ok(Some(Round { onto, trials, aside: Vec::new(), ranking, accepted: Some(best), evidence: Some(evidence), near }))
}

/// The hypothesis without one of its earlier effects, where the recordings do not miss it.
fn pruned(bench: &Bench<'_>, full_set: &Trial) -> Result<Option<Trial>> {
    let n = full_set.made.effects.len();
    for k in 0..n.saturating_sub(1) {
        let Some(less) = without(bench, full_set, k)? else { continue };
        let pair = [less];
        let ranking = judge::rank(full_set, &pair);
        if ranking.score(Some(0)) - ranking.score(None) < judge::APART {
            let [less] = pair;
            return Ok(Some(less));
        }
    }
    Ok(None)
}

/// A hypothesis refitted without its `k`-th effect, from where it stood.
fn without(bench: &Bench<'_>, t: &Trial, k: usize) -> Result<Option<Trial>> {
    let mut document = t.made.model.document().clone();
    let first = document.effects.len() - t.made.effects.len();
    document.effects.remove(first + k);
    let model = crate::model::Model::new(document, t.made.model.library().clone(), "")?;
    let gone: Vec<usize> = t.made.own(k).into_iter().map(|(i, _)| i).collect();
    let system = model.compile();
    let keep = |i: &usize| !gone.contains(i);
    let all: Vec<usize> = (0..t.made.priors.len()).filter(keep).collect();
    let mut effects = t.made.effects.clone();
    effects.remove(k);
    // States of effects stand behind the model's own, in the order of the effects.
    let library = t.made.model.library();
    let count = |name: &str| library.get(name).map_or(0, |e| e.states.len());
    let before: usize = t.made.effects[..k].iter().map(|(name, _)| count(name)).sum();
    let lost = before..before + count(&t.made.effects[k].0);
    let first = t.made.system.states() - t.made.extra.len();
    let kept = |x: &Vec<f64>| -> Vec<f64> {
        x.iter().enumerate().filter(|(i, _)| *i < first || !lost.contains(&(i - first))).map(|(_, v)| *v).collect()
    };
    let extra = t.made.extra.iter().enumerate().filter(|(i, _)| !lost.contains(i)).map(|(_, v)| *v).collect();
    let made = Made { effects, model, system, priors: all.iter().map(|i| t.made.priors[*i]).collect(), extra };
    let x0 = t.fit.point.x0.iter().map(kept).collect();
    let from = Point { theta: all.iter().map(|i| t.fit.point.theta[*i]).collect(), x0 };
    let near: Vec<Vec<f64>> = t.test_x0.iter().map(kept).collect();
    let fit = stage(&made.subject(), bench.train, &from, bench.train_start, None, FINE);
    fit.map(|f| finish(bench, made, f, &near)).transpose()
}

/// Share of the nominal structural error that each effect of the last hypothesis removes: what returns when it is set to
/// nothing and everything else stays.
fn shares(bench: &Bench<'_>, e: &Explained) -> Result<Vec<f64>> {
    let last = e.last();
    let energy = |t: &Trial| t.residuals.structural(&t.residuals.train);
    let (all, none) = (energy(last), energy(&e.nominal));
    let n = last.made.effects.len();
    if n <= 1 {
        return Ok(vec![if none > 0.0 { ((none - all) / none).clamp(-9.0, 1.0) } else { 0.0 }; n]);
    }
    let each = (0..n).map(|k| {
        let less = without(bench, last, k)?;
        Ok(less.map_or(0.0, |l| if none > 0.0 { ((energy(&l) - all) / none).clamp(-9.0, 9.0) } else { 0.0 }))
    });
    each.collect()
}

/// What stands for a hypothesis in a message.
pub fn spoken(effects: &[Attachment]) -> String {
    label(effects)
}
