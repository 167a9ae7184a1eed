//! The search over candidates by successive halving: all get a few steps from where the linearised test points, those that
//! may win go on, the last few are fitted as far as the data go and from other starts too, and predict the held-out records.
//!
//! What was set aside is reported with how far it had come, so that nobody takes it for a fit. Every step is a fixed amount of
//! work per candidate, so that the result does not depend on the number of threads.

use std::sync::atomic::{AtomicUsize, Ordering};

use indexmap::IndexMap;
use rayon::prelude::*;

use super::candidates::{Candidate, Place, inherited};
use super::fit::{Effort, FINE, Fitted, Point, cost, homotopy, stage};
use super::screen::{Finding, Screen, joined};
use super::trial::{Attachment, Bench, Trial, descend, finish};
use crate::error::{Error, Result};

/// First steps of every candidate.
const FIRST: Effort = Effort { iterations: 5, ftol: 1e-3 };
/// Further steps of those that may win.
const SECOND: Effort = Effort { iterations: 12, ftol: 1e-4 };
/// Ways of looking at a candidate that are followed.
const FOLLOWED: usize = 3;
/// Share of the best look's gain that another one must promise to be followed too.
const ALSO: f64 = 0.4;
/// Share of the cost that a look must promise for its point to be tried though it is worse than nothing.
const PROMISING: f64 = 0.03;
/// Sizes of an effect that are tried instead of one that makes matters worse.
const SMALLER: [f64; 7] = [0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4];
/// Candidates that go on after the first steps, and after the second.
const LEADERS: usize = 12;
const FINALISTS: usize = 6;
/// Distance in cost within which a candidate goes on in any case, and the share of the best one's gain.
const NEAR: [(f64, f64); 2] = [(40.0, 0.5), (30.0, 0.1)];
/// Samples from which records count as long: then fewer fits are begun anew.
const LONG: f64 = 20_000.0;
/// Share of the cost without an effect below which a candidate has come some way.
const STIRRED: f64 = 0.97;
/// Mean square residual in units of noise below which a candidate explains everything.
const REACHED: f64 = 1.08;
/// Mean square residual in units of noise above which finalists are looked for from every start.
const ROUGH_LEFT: f64 = 1.3;
/// Relative difference of cost below which two fits ended in the same valley.
const AGREE: f64 = 1e-3;

/// What became of all candidates.
pub struct Found {
    /// Fitted as far as the data go.
    pub trials: Vec<Trial>,
    /// The others.
    pub aside: Vec<Aside>,
    /// Linearised gain of every pair worth a look, best first: two effects that are needed together.
    pub pairs: Vec<Pair>,
}

/// A candidate that was not fitted to the end.
pub struct Aside {
    /// Effect and place.
    pub effect: Attachment,
    /// Why.
    pub why: Why,
    /// Cost where it was left.
    pub cost: Option<f64>,
    /// Its own parameters there.
    pub parameters: IndexMap<String, f64>,
}

/// Why a candidate was not fitted to the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// What is fitted already can do the same.
    Imitated,
    /// Others fit far better.
    Behind,
    /// It changes nothing along these recordings, or could not be simulated along them.
    Nothing,
    /// What was found before leaves it no place to act on.
    RuledOut,
}

impl Aside {
    fn ruled_out(name: &str, at: &str) -> Self {
        let effect = (name.to_string(), at.to_string());
        Self { effect, why: Why::RuledOut, cost: None, parameters: IndexMap::new() }
    }
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

/// A candidate on its way.
struct Runner {
    candidate: Candidate,
    findings: Vec<Finding>,
    fit: Option<Fitted>,
    imitated: bool,
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

    let samples: f64 = screen_samples(bench);
    let zero = (base.fit.cost, samples);
    let mut alive = best(&runners, zero, NEAR[0], LEADERS);
    chosen(&mut runners, &alive).into_par_iter().try_for_each(|r| {
        tell(&r.candidate.label(), 1.0);
        r.more(bench, SECOND)
    })?;
    let unexplained = |runners: &[Runner]| {
        runners.iter().filter_map(Runner::cost).fold(f64::INFINITY, f64::min) > ROUGH_LEFT * samples
    };
    if unexplained(&runners) && samples < LONG {
        // Nobody explains it yet: whoever has come any way at all may only be slow.
        let slow: Vec<usize> = (0..runners.len())
            .filter(|i| !alive.contains(i) && runners[*i].cost().is_some_and(|c| c < STIRRED * zero.0))
            .collect();
        chosen(&mut runners, &slow).into_par_iter().try_for_each(|r| r.more(bench, SECOND))?;
    }
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

/// Number of measured samples.
fn screen_samples(bench: &Bench<'_>) -> f64 {
    bench.train.experiments.iter().map(|e| e.y.iter().filter(|v| v.is_finite()).count() as f64).sum()
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

fn chosen<'r>(runners: &'r mut [Runner], which: &[usize]) -> Vec<&'r mut Runner> {
    runners.iter_mut().enumerate().filter(|(i, _)| which.contains(i)).map(|(_, r)| r).collect()
}

/// Pairs of candidates at the best of their looks, by what they promise together beyond the better one.
fn pairs(screen: &Screen<'_>, runners: &[Runner]) -> Vec<Pair> {
    let top: Vec<(&Runner, &Finding)> = runners
        .iter()
        .filter(|r| !r.imitated && r.candidate.extends.is_none())
        .filter_map(|r| r.findings.first().map(|f| (r, f)))
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

impl Runner {
    fn new(screen: &Screen<'_>, candidate: Candidate) -> Self {
        let mut findings: Vec<Finding> = Vec::new();
        if candidate.extends.is_none() {
            findings = candidate.probes.iter().filter_map(|p| screen.look(&candidate, p)).collect();
        }
        let imitated = !findings.is_empty() && findings.iter().all(|f| f.imitated);
        // The wave that stands highest in the missing force is followed whatever the linearised test makes of it.
        let highest = candidate.probes.first().filter(|p| p.wave.is_some()).map(|_| 0);
        let mut order: Vec<usize> = (0..findings.len()).collect();
        order.sort_by(|a, b| findings[*b].gain.total_cmp(&findings[*a].gain));
        let promised = order.first().map_or(0.0, |i| findings[*i].gain);
        let mut followed: Vec<usize> =
            order.into_iter().take(FOLLOWED).filter(|i| findings[*i].gain >= ALSO * promised).collect();
        followed.extend(highest.filter(|i| !findings.is_empty() && !followed.contains(i)));
        let mut all: Vec<Option<Finding>> = findings.into_iter().map(Some).collect();
        let findings = followed.into_iter().filter_map(|i| all[i].take()).collect();
        Self { candidate, findings, fit: None, imitated }
    }

    fn newest(&self) -> Attachment {
        self.candidate.made.effects.last().cloned().unwrap_or_default()
    }

    fn cost(&self) -> Option<f64> {
        self.fit.as_ref().map(|f| f.cost)
    }

    /// Where the hypothesis so far stands in this fit, with all states.
    fn base_point(&self) -> Option<Point> {
        let f = self.fit.as_ref()?;
        let theta = f.point.theta[..self.candidate.own[0]].to_vec();
        Some(Point { theta, x0: f.point.x0.clone() })
    }

    fn own_values(&self) -> Vec<f64> {
        self.fit.as_ref().map_or(Vec::new(), |f| self.candidate.own.iter().map(|k| f.point.theta[*k]).collect())
    }

    fn own_parameters(&self) -> IndexMap<String, f64> {
        let names = self.candidate.made.own(self.candidate.made.effects.len() - 1);
        names.into_iter().map(|(_, n)| n).zip(self.own_values()).collect()
    }

    fn keep(&mut self, fit: Option<Fitted>) {
        if let Some(f) = fit.filter(|f| self.fit.as_ref().is_none_or(|b| f.cost < b.cost)) {
            self.fit = Some(f);
        }
    }

    /// A few steps from each of the points to which the test points. Where such a point is worse than nothing at all, the step
    /// of everything else went too far, which a few steps put right, or the size did: a friction that holds everything has no
    /// slope. So it is tried from there if much is promised, and from a smaller size.
    fn first(&mut self, bench: &Bench<'_>, base: &Trial) -> Result<()> {
        if self.imitated {
            return Ok(());
        }
        let subject = self.candidate.made.subject();
        let worth = |point: &Point| cost(&subject, bench.train, point, bench.train_start).unwrap_or(f64::INFINITY);
        let mut fits = Vec::new();
        for finding in &self.findings {
            bench.train.control.check()?;
            let mut start = (worth(&finding.start), finding.start.clone());
            let own = &finding.start.theta[self.candidate.own[0]..];
            let promising = finding.gain > PROMISING * base.fit.cost;
            let astray = |c: f64| promising && c > base.fit.cost && c.is_finite();
            if astray(start.0) {
                fits.push(stage(&subject, bench.train, &start.1, bench.train_start, None, FIRST));
            }
            for (k, size) in SMALLER.into_iter().enumerate() {
                if start.0 <= base.fit.cost {
                    break;
                }
                let smaller = joined(&self.candidate, bench.train, &base.fit.point, &self.candidate.resized(own, size));
                let c = worth(&smaller);
                if k == 0 && astray(c) {
                    fits.push(stage(&subject, bench.train, &smaller, bench.train_start, None, FIRST));
                }
                if c < start.0 {
                    start = (c, smaller);
                }
            }
            fits.push(stage(&subject, bench.train, &start.1, bench.train_start, None, FIRST));
        }
        for fit in fits {
            self.keep(fit);
        }
        Ok(())
    }

    /// Starts of a richer law from the fit of the simpler one.
    fn inherit(
        &mut self,
        bench: &Bench<'_>,
        simple: &IndexMap<Attachment, (Point, IndexMap<String, f64>)>,
    ) -> Result<()> {
        let key = (self.candidate.extends.clone().unwrap_or_default(), self.newest().1);
        let Some((at, own)) = simple.get(&key) else { return Ok(()) };
        let mut starts: Vec<(f64, Point)> = Vec::new();
        for own in inherited(&self.candidate, own)? {
            bench.train.control.check()?;
            let point = joined(&self.candidate, bench.train, at, &own);
            if let Some(c) = cost(&self.candidate.made.subject(), bench.train, &point, bench.train_start) {
                starts.push((c, point));
            }
        }
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, start) in starts.into_iter().take(FOLLOWED) {
            let fit = stage(&self.candidate.made.subject(), bench.train, &start, bench.train_start, None, FIRST);
            self.keep(fit);
        }
        Ok(())
    }

    fn more(&mut self, bench: &Bench<'_>, effort: Effort) -> Result<()> {
        bench.train.control.check()?;
        let Some(from) = self.fit.as_ref().map(|f| f.point.clone()) else { return Ok(()) };
        let fit = stage(&self.candidate.made.subject(), bench.train, &from, bench.train_start, None, effort);
        self.keep(fit);
        Ok(())
    }

    /// As far as the data go; and once more from the nominal parameters as stated, tied to the recording at first: what they
    /// had absorbed may keep a fit in the wrong valley. With `everywhere`, by every observer.
    fn last(&mut self, bench: &Bench<'_>, base: &Trial, everywhere: bool) -> Result<()> {
        self.more(bench, FINE)?;
        let Some(so_far) = self.fit.clone() else { return Ok(()) };
        let stated: Vec<f64> = base
            .made
            .priors
            .iter()
            .zip(&base.fit.point.theta)
            .map(|(p, v)| if p.sd.is_finite() { p.mean } else { *v })
            .collect();
        let beginning = Point { theta: stated, x0: bench.train_start.to_vec() };
        let start = joined(&self.candidate, bench.train, &beginning, &self.own_values());
        let subject = self.candidate.made.subject();
        let tie = bench.train_ties.get(bench.train_ties.len() / 2).map_or(&[][..], Vec::as_slice);
        if everywhere {
            let fit = descend(bench, &subject, &[start], bench.train_ties)?;
            self.keep(fit);
        } else {
            bench.train.control.check()?;
            let tied = homotopy(&subject, bench.train, &start, bench.train_start, tie);
            let agree = tied.as_ref().is_some_and(|t| (t.cost - so_far.cost).abs() <= AGREE * so_far.cost);
            self.keep(tied);
            if agree && so_far.converged {
                return Ok(());
            }
        }
        // The free fits may have lost what the test had seen: once more from there, tied.
        let seen =
            |f: &Finding| joined(&self.candidate, bench.train, &beginning, &f.start.theta[self.candidate.own[0]..]);
        for start in self.findings.iter().map(seen).collect::<Vec<_>>() {
            bench.train.control.check()?;
            if self.cost().is_some_and(|c| c > ROUGH_LEFT * screen_samples(bench)) {
                let fit = homotopy(&self.candidate.made.subject(), bench.train, &start, bench.train_start, tie);
                self.keep(fit);
            }
        }
        if self.fit.as_ref().is_some_and(|f| !f.converged) {
            self.more(bench, FINE)?;
        }
        Ok(())
    }

    fn aside(self) -> Aside {
        let why = match (&self.fit, self.imitated) {
            (_, true) => Why::Imitated,
            (Some(_), _) => Why::Behind,
            (None, _) => Why::Nothing,
        };
        Aside { effect: self.newest(), why, cost: self.cost(), parameters: self.own_parameters() }
    }
}
