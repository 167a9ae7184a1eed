//! One candidate on its way: where its fits begin, the steps they take, and what it is when it is left behind.

use indexmap::IndexMap;

use super::candidates::{Candidate, inherited};
use super::fit::{Effort, FINE, Fitted, Point, cost, homotopy, stage};
use super::screen::{Finding, Screen, joined};
use super::trial::{Attachment, Bench, Trial, descend};
use crate::error::Result;

/// First steps of every candidate.
const FIRST: Effort = Effort { iterations: 5, ftol: 1e-3 };
/// Further steps of those that may win.
pub const SECOND: Effort = Effort { iterations: 12, ftol: 1e-4 };
/// Ways of looking at a candidate that are followed.
const FOLLOWED: usize = 3;
/// Share of the best look's gain that another one must promise to be followed too.
const ALSO: f64 = 0.4;
/// Further ways that are followed while nobody explains the recordings.
const SPARE: usize = 6;
/// Share of the cost that a look must promise for its point to be tried though it is worse than nothing.
const PROMISING: f64 = 0.03;
/// Sizes of an effect that are tried instead of one that makes matters worse.
const SMALLER: [f64; 7] = [0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4];
/// How often a candidate goes on from such a beginning, and the share of its cost that it must fall below to do so.
const PATIENCE: usize = 4;
const FALLING: f64 = 0.9;
/// Mean square residual in units of noise above which finalists are looked for from every start.
pub const ROUGH_LEFT: f64 = 1.3;
/// Relative difference of cost below which two fits ended in the same valley.
const AGREE: f64 = 1e-3;

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
    /// What may not be attached where earlier effects are.
    pub fn ruled_out(name: &str, at: &str) -> Self {
        let effect = (name.to_string(), at.to_string());
        Self { effect, why: Why::RuledOut, cost: None, parameters: IndexMap::new() }
    }
}

/// A candidate on its way.
pub struct Runner {
    /// What is tried.
    pub candidate: Candidate,
    /// Ways of looking at it that are followed.
    findings: Vec<Finding>,
    /// Others, the most promising first.
    spare: Vec<Finding>,
    /// Best fit so far.
    pub fit: Option<Fitted>,
    /// Whether what is fitted already can do the same.
    pub imitated: bool,
}

impl Runner {
    /// Looks at a candidate in all its ways and keeps the most promising.
    pub fn new(screen: &Screen<'_>, candidate: Candidate) -> Self {
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
            order.iter().copied().take(FOLLOWED).filter(|i| findings[*i].gain >= ALSO * promised).collect();
        followed.extend(highest.filter(|i| !findings.is_empty() && !followed.contains(i)));
        let mut all: Vec<Option<Finding>> = findings.into_iter().map(Some).collect();
        let findings = followed.into_iter().filter_map(|i| all[i].take()).collect();
        let spare = order.into_iter().filter_map(|i| all[i].take()).take(SPARE).collect();
        Self { candidate, findings, spare, fit: None, imitated }
    }

    /// The most promising way of looking at it.
    pub fn best_finding(&self) -> Option<&Finding> {
        self.findings.first()
    }

    /// Effect and place.
    pub fn newest(&self) -> Attachment {
        self.candidate.made.effects.last().cloned().unwrap_or_default()
    }

    /// Cost of its best fit so far.
    pub fn cost(&self) -> Option<f64> {
        self.fit.as_ref().map(|f| f.cost)
    }

    /// Where the hypothesis so far stands in this fit, with all states.
    pub fn base_point(&self) -> Option<Point> {
        let f = self.fit.as_ref()?;
        let theta = f.point.theta[..self.candidate.own[0]].to_vec();
        Some(Point { theta, x0: f.point.x0.clone() })
    }

    fn own_values(&self) -> Vec<f64> {
        self.fit.as_ref().map_or(Vec::new(), |f| self.candidate.own.iter().map(|k| f.point.theta[*k]).collect())
    }

    /// Parameters of the effect where it stands.
    pub fn own_parameters(&self) -> IndexMap<String, f64> {
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
    pub fn first(&mut self, bench: &Bench<'_>, base: &Trial) -> Result<()> {
        let fits = self.tried(bench, base, &self.findings)?;
        fits.into_iter().for_each(|f| self.keep(f));
        Ok(())
    }

    /// The same from the points that were not followed at first.
    pub fn spare(&mut self, bench: &Bench<'_>, base: &Trial) -> Result<()> {
        let fits = self.tried(bench, base, &self.spare)?;
        fits.into_iter().for_each(|f| self.keep(f));
        Ok(())
    }

    fn tried(&self, bench: &Bench<'_>, base: &Trial, findings: &[Finding]) -> Result<Vec<Option<Fitted>>> {
        if self.imitated {
            return Ok(Vec::new());
        }
        let subject = self.candidate.made.subject();
        let worth = |point: &Point| cost(&subject, bench.train, point, bench.train_start).unwrap_or(f64::INFINITY);
        let mut fits = Vec::new();
        for finding in findings {
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
        Ok(fits)
    }

    /// Starts of a richer law from the fit of the simpler one.
    pub fn inherit(
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

    /// A point of another candidate without its own numbers and states.
    pub fn cut(&self, point: &Point, states: usize) -> Point {
        let x0 = point.x0.iter().map(|x| x[..states].to_vec()).collect();
        Point { theta: point.theta[..self.candidate.own[0]].to_vec(), x0 }
    }

    /// Where, beside what others made of everything else, this effect does best: as it stands or as the test pointed, from
    /// their starts or from its own.
    pub fn best_beside(&self, bench: &Bench<'_>, bases: &[Point], states: usize) -> Option<Point> {
        let looks = self.findings.iter().chain(&self.spare);
        let seen = looks.map(|f| f.start.theta[self.candidate.own[0]..].to_vec());
        let own: Vec<Vec<f64>> = self.fit.iter().map(|_| self.own_values()).chain(seen).collect();
        let starts = self.fit.as_ref().map(|f| self.cut(&f.point, states).x0);
        let ways = bases.iter().flat_map(|b| {
            let here = starts.iter().map(|x0| Point { x0: x0.clone(), ..b.clone() });
            std::iter::once(b.clone()).chain(here).collect::<Vec<_>>()
        });
        let join = |at: Point| own.iter().map(|v| joined(&self.candidate, bench.train, &at, v)).collect::<Vec<_>>();
        let points: Vec<Point> = ways.flat_map(join).collect();
        let subject = self.candidate.made.subject();
        let worth = |p: &Point| cost(&subject, bench.train, p, bench.train_start).unwrap_or(f64::INFINITY);
        let valued = points.into_iter().map(|p| (worth(&p), p));
        valued.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, p)| p)
    }

    /// A few steps from a point that others found, and some more where they led somewhere.
    pub fn from(&mut self, bench: &Bench<'_>, start: Point) {
        let so_far = self.cost().unwrap_or(f64::INFINITY);
        let fit = stage(&self.candidate.made.subject(), bench.train, &start, bench.train_start, None, FIRST);
        let Some(fit) = fit.filter(|f| f.cost < so_far) else { return };
        let mut last = fit.cost;
        self.keep(Some(fit));
        for _ in 0..PATIENCE {
            let Some(at) = self.fit.as_ref().filter(|f| !f.converged).map(|f| f.point.clone()) else { return };
            let further = stage(&self.candidate.made.subject(), bench.train, &at, bench.train_start, None, SECOND);
            self.keep(further);
            let now = self.cost().unwrap_or(last);
            if now > FALLING * last {
                return;
            }
            last = now;
        }
    }

    /// Further steps from where it stands.
    pub fn more(&mut self, bench: &Bench<'_>, effort: Effort) -> Result<()> {
        bench.train.control.check()?;
        let Some(from) = self.fit.as_ref().map(|f| f.point.clone()) else { return Ok(()) };
        let fit = stage(&self.candidate.made.subject(), bench.train, &from, bench.train_start, None, effort);
        self.keep(fit);
        Ok(())
    }

    /// As far as the data go; and once more from the nominal parameters as stated, tied to the recording at first: what they
    /// had absorbed may keep a fit in the wrong valley. With `everywhere`, by every observer.
    pub fn last(&mut self, bench: &Bench<'_>, base: &Trial, everywhere: bool) -> Result<()> {
        self.more(bench, FINE)?;
        let Some(so_far) = self.fit.clone() else { return Ok(()) };
        let beginning = base.as_stated(bench);
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
            if self.cost().is_some_and(|c| c > ROUGH_LEFT * bench.samples()) {
                let fit = homotopy(&self.candidate.made.subject(), bench.train, &start, bench.train_start, tie);
                self.keep(fit);
            }
        }
        if self.fit.as_ref().is_some_and(|f| !f.converged) {
            self.more(bench, FINE)?;
        }
        Ok(())
    }

    /// From given numbers of its own and the nominal parameters as stated, by every observer.
    pub fn tied(&mut self, bench: &Bench<'_>, base: &Trial, own: &[f64]) -> Result<()> {
        let start = joined(&self.candidate, bench.train, &base.as_stated(bench), own);
        let fit = descend(bench, &self.candidate.made.subject(), &[start], bench.train_ties)?;
        self.keep(fit);
        Ok(())
    }

    /// What is left of it when others are better.
    pub fn aside(self) -> Aside {
        let why = match (&self.fit, self.imitated) {
            (_, true) => Why::Imitated,
            (Some(_), _) => Why::Behind,
            (None, _) => Why::Nothing,
        };
        Aside { effect: self.newest(), why, cost: self.cost(), parameters: self.own_parameters() }
    }
}
