//! The search over candidates by successive halving: all get a few steps from where the linearised test points, those that
//! may win go on, the last few are fitted as far as the data go and from other starts too, and predict the held-out records.
//!
//! What was set aside is reported with how far it had come, so that nobody takes it for a fit. Every step is a fixed amount of
//! work per candidate, so that the result does not depend on the number of threads.

use std::sync::atomic::{AtomicUsize, Ordering};

use indexmap::IndexMap;
use rayon::prelude::*;

use super::candidates::{Candidate, Place};
use super::fit::Point;
use super::runner::{Aside, ROUGH_LEFT, Runner, SECOND};
use super::screen::{Finding, Screen};
use super::trial::{Attachment, Bench, Trial, finish};
use crate::error::{Error, Result};
use crate::model::System;

/// Candidates that show the others where to begin.
const GIVERS: usize = 3;
/// Candidates that go on after the first steps, and after the second.
const LEADERS: usize = 12;
const FINALISTS: usize = 6;
/// Distance in cost within which a candidate goes on in any case, and the share of the best one's gain.
const NEAR: [(f64, f64); 2] = [(40.0, 0.5), (30.0, 0.1)];
/// Samples from which records count as long: then fewer fits are begun anew.
pub const LONG: f64 = 20_000.0;
/// Share of the cost without an effect below which a candidate has come some way.
const STIRRED: f64 = 0.97;
/// Mean square residual in units of noise below which a candidate explains everything.
const REACHED: f64 = 1.08;

/// What became of all candidates.
pub struct Found {
    /// Fitted as far as the data go.
    pub trials: Vec<Trial>,
    /// The others.
    pub aside: Vec<Aside>,
    /// Linearised gain of every pair worth a look, best first: two effects that are needed together.
    pub pairs: Vec<Pair>,
}

/// Two effects and what they promise together.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Effects with their places.
    pub effects: [Attachment; 2],
    /// Linearised gain of both.
    pub together: f64,
    /// Larger of their single gains.
    pub alone: f64,
}

/// Adds every effect at every place to a fitted hypothesis. With `thorough`, the best are looked for by every observer while
/// nobody explains the recordings; how many depends on their length, so that the work does not.
///
/// # Errors
/// [`crate::Error::Interrupted`], and what attaching an effect may say.
pub fn search(
    bench: &Bench<'_>,
    base: &Trial,
    jobs: &[(String, Place)],
    share: (f64, f64),
    thorough: bool,
) -> Result<Found> {
    let Some(screen) = Screen::new(bench, base) else {
        return Ok(Found { trials: Vec::new(), aside: Vec::new(), pairs: Vec::new() });
    };
    let done = AtomicUsize::new(0);
    let tell = |label: &str, part: f64| {
        let n = done.fetch_add(1, Ordering::Relaxed) as f64 / (2 * jobs.len() + FINALISTS).max(1) as f64;
        (bench.train.control.progress)(label, share.0 + (share.1 - share.0) * n.min(1.0) * part);
    };
    let step = bench.train.experiments[0].dt / bench.train.substeps as f64;
    let entered: Vec<std::result::Result<Runner, Aside>> = jobs
        .par_iter()
        .map(|(name, place)| {
            bench.train.control.check()?;
            tell(&format!("{name}@{}", place.at), 1.0);
            match Candidate::new(base, name, place, step) {
                Ok(candidate) => Ok(Ok(Runner::new(&screen, candidate))),
                // What a lag leaves depends on the motion, and cannot be delayed.
                Err(Error::Model { .. }) => Ok(Err(Aside::ruled_out(name, &place.at))),
                Err(e) => Err(e),
            }
        })
        .collect::<Result<_>>()?;
    let (mut runners, mut ruled_out) = (Vec::new(), Vec::new());
    for one in entered {
        match one {
            Ok(runner) => runners.push(runner),
            Err(aside) => ruled_out.push(aside),
        }
    }
    let pairs = pairs(&screen, &runners);

    runners.par_iter_mut().try_for_each(|r| r.first(bench, base))?;
    // A richer law goes on from the simpler one that it contains.
    let simple: IndexMap<Attachment, (Point, IndexMap<String, f64>)> =
        runners.iter().filter_map(|r| Some((r.newest(), (r.base_point()?, r.own_parameters())))).collect();
    runners.par_iter_mut().filter(|r| r.candidate.extends.is_some()).try_for_each(|r| r.inherit(bench, &simple))?;

    let samples: f64 = bench.samples();
    let zero = (base.fit.cost, samples);
    let mut alive = best(&runners, zero, NEAR[0], LEADERS);
    chosen(&mut runners, &alive).into_par_iter().try_for_each(|r| {
        tell(&r.candidate.label(), 1.0);
        r.more(bench, SECOND)
    })?;
    let lowest = |runners: &[Runner]| runners.iter().filter_map(Runner::cost).fold(f64::INFINITY, f64::min);
    let explained = |runners: &[Runner]| lowest(runners) < REACHED * samples;
    let unexplained = |runners: &[Runner]| lowest(runners) > ROUGH_LEFT * samples;
    if !explained(&runners) && samples < LONG {
        // Nobody explains all of it yet: there are other points to begin from.
        runners.par_iter_mut().try_for_each(|r| r.spare(bench, base))?;
    }
    if unexplained(&runners) && samples < LONG {
        // Nobody explains much of it: whoever has come any way at all may only be slow.
        let slow: Vec<usize> = (0..runners.len())
            .filter(|i| !alive.contains(i) && runners[*i].cost().is_some_and(|c| c < STIRRED * zero.0))
            .collect();
        chosen(&mut runners, &slow).into_par_iter().try_for_each(|r| r.more(bench, SECOND))?;
    }
    let lost = unexplained(&runners) && samples < LONG;
    hand_on(bench, base, &mut runners, lost)?;
    alive = best(&runners, zero, NEAR[1], FINALISTS);
    let lost = thorough && unexplained(&runners);
    if lost {
        alive = best(&runners, zero, NEAR[0], FINALISTS);
    }
    // The best of them, as many as the length of the recordings allows.
    let mut order: Vec<(usize, f64)> = alive.iter().filter_map(|i| Some((*i, runners[*i].cost()?))).collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    order.truncate(if lost { (2.0 * LONG / samples).ceil() as usize } else { 0 });
    let everywhere: Vec<Attachment> = order.iter().map(|(i, _)| runners[*i].newest()).collect();
    chosen(&mut runners, &alive).into_par_iter().try_for_each(|r| {
        tell(&r.candidate.label(), 1.0);
        let own = r.newest();
        r.last(bench, base, everywhere.contains(&own))
    })?;
    if unexplained(&runners) && samples < LONG {
        elsewhere(bench, base, &mut runners)?;
    }
    alive = best(&runners, zero, NEAR[1], FINALISTS);

    let mut found = Found { trials: Vec::new(), aside: Vec::new(), pairs };
    let (mut last, mut others) = (Vec::new(), Vec::new());
    for (i, r) in runners.into_iter().enumerate() {
        if alive.contains(&i) { last.push(r) } else { others.push(r) }
    }
    found.aside = others.into_iter().map(Runner::aside).chain(ruled_out).collect();
    let trials = last.into_par_iter().map(|r| {
        let Some(fit) = r.fit else { return Ok(None) };
        finish(bench, r.candidate.made, fit, &base.test_x0).map(Some)
    });
    found.trials = trials.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
    Ok(found)
}

/// The runners that go on: those near the best and the first few, with the simpler laws that they contain.
fn best(runners: &[Runner], (zero, samples): (f64, f64), near: (f64, f64), few: usize) -> Vec<usize> {
    let mut order: Vec<(usize, f64)> = runners.iter().enumerate().filter_map(|(i, r)| Some((i, r.cost()?))).collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    let Some(&(_, lowest)) = order.first() else { return Vec::new() };
    // Where the best explains everything, whoever is far from it stays far.
    let share = if lowest < REACHED * samples { 0.0 } else { near.1 };
    let window = near.0 + 0.02 * samples + share * (zero - lowest).max(0.0);
    let mut out: Vec<usize> = order
        .iter()
        .enumerate()
        .filter(|(rank, (_, c))| *rank < few / 3 || (*rank < few && c - lowest <= window))
        .map(|(_, (i, _))| *i)
        .collect();
    for i in out.clone() {
        let (name, at) = runners[i].newest();
        let contained = runners[i].candidate.extends.as_ref();
        let contains = |r: &Runner| r.candidate.extends.as_ref() == Some(&name) && r.newest().1 == at;
        let family = runners
            .iter()
            .enumerate()
            .filter(|(_, r)| contains(r) || contained.is_some_and(|c| r.newest() == (c.clone(), at.clone())));
        out.extend(family.filter(|(_, r)| r.cost().is_some()).map(|(k, _)| k));
    }
    out.sort_unstable();
    out.dedup();
    out
}

/// Those that have come far show the others where to begin: the same effect at another place goes on from the leader's numbers,
/// and everybody else from where the leaders have put what was fitted before, or, where all are `lost`, from what was stated.
///
/// # Errors
/// [`crate::Error::Interrupted`].
fn hand_on(bench: &Bench<'_>, base: &Trial, runners: &mut [Runner], lost: bool) -> Result<()> {
    let (stirred, states) = (STIRRED * base.fit.cost, base.made.system.states());
    let leaders: Vec<_> = leaders(runners).into_iter().filter(|(_, c, _)| *c < stirred).collect();
    runners.par_iter_mut().filter(|r| !r.imitated).try_for_each(|r| {
        let (name, at) = r.newest();
        for ((effect, place), _, point) in &leaders {
            bench.train.control.check()?;
            if *effect == name && *place != at {
                r.from(bench, r.candidate.clamped(point));
            }
        }
        let cost = r.cost().unwrap_or(f64::INFINITY);
        let ahead = leaders.iter().filter(|(_, c, _)| cost < stirred && cost > c + NEAR[0].0);
        let mut bases: Vec<Point> = ahead.map(|(_, _, point)| r.cut(point, states)).collect();
        bases.extend(lost.then(|| base.as_stated(bench)));
        if let Some(start) = r.best_beside(bench, &bases, states) {
            bench.train.control.check()?;
            r.from(bench, start);
        }
        Ok(())
    })
}

/// Those that have come furthest.
fn leaders(runners: &[Runner]) -> Vec<(Attachment, f64, Point)> {
    let mut order: Vec<(usize, f64)> = runners.iter().enumerate().filter_map(|(i, r)| Some((i, r.cost()?))).collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    let first = order.into_iter().take(GIVERS);
    first.filter_map(|(i, c)| Some((runners[i].newest(), c, runners[i].fit.as_ref()?.point.clone()))).collect()
}

/// What was fitted to the end shows the same effect at other places its numbers once more.
///
/// # Errors
/// [`crate::Error::Interrupted`].
fn elsewhere(bench: &Bench<'_>, base: &Trial, runners: &mut [Runner]) -> Result<()> {
    let leaders = leaders(runners);
    runners.par_iter_mut().filter(|r| !r.imitated).try_for_each(|r| {
        let (name, at) = r.newest();
        let same = leaders.iter().filter(|((effect, place), ..)| *effect == name && *place != at);
        for (_, _, point) in same {
            let own = r.candidate.clamped(point).theta[r.candidate.own[0]..].to_vec();
            r.tied(bench, base, &own)?;
        }
        Ok(())
    })
}

fn chosen<'r>(runners: &'r mut [Runner], which: &[usize]) -> Vec<&'r mut Runner> {
    runners.iter_mut().enumerate().filter(|(i, _)| which.contains(i)).map(|(_, r)| r).collect()
}

/// Pairs of candidates at the best of their looks, by what they promise together beyond the better one.
fn pairs(screen: &Screen<'_>, runners: &[Runner]) -> Vec<Pair> {
    let top: Vec<(&Runner, &Finding)> = runners
        .iter()
        .filter(|r| !r.imitated && r.candidate.extends.is_none())
        .filter_map(|r| r.best_finding().map(|f| (r, f)))
        .collect();
    let mut out = Vec::new();
    for (i, (a, fa)) in top.iter().enumerate() {
        for (b, fb) in &top[i + 1..] {
            let actions: Vec<_> = fa.actions.iter().chain(&fb.actions).collect();
            let together = screen.together(&actions);
            out.push(Pair { effects: [a.newest(), b.newest()], together, alone: fa.gain.max(fb.gain) });
        }
    }
    out.sort_by(|a, b| b.together.total_cmp(&a.together));
    out
}
