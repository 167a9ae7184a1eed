//! The linearised test: how much of what a fitted hypothesis leaves could each candidate explain, once everything that was
//! fitted has adapted to it.
//!
//! With residuals `r`, derivatives `J` by what was fitted and actions `D` of a candidate, all in units of noise, the
//! projections `r' = (I - QQ')r`, `D' = (I - QQ')D` give the gain `|r'|^2 - min_a |r' + D'a|^2`, the amplitude `a` and the step
//! of everything else. It sets the order and the starts of the fits; it never decides (research: right at the top in two
//! thirds of the cases). A second projection, by the data alone, shows what the fitted parameters imitate.

use nalgebra::{DMatrix, DVector};

use super::candidates::{Candidate, Probe};
use super::experiment::Run;
use super::fit::{Ground, Point, full, linearised, moved};
use super::trial::{Bench, Trial, widened};
use crate::model::{Backend, System};

/// Share of a candidate's action that what was fitted cannot imitate, below which it is another parameter's.
const IMITATED: f64 = 1e-4;
/// Largest multiple of a finite probe that is believed: of forces, which add up, and of anything else.
const LARGEST: f64 = 1000.0;
const FARTHEST: f64 = 4.0;
/// Smallest: where less is promised, or the other sign, a fit begins here.
const LEAST: f64 = 0.03;
/// Ridge on the data alone: parameters that are collinear among themselves must not count as one dimension more.
const RIDGE: f64 = 1e-7;

/// Residuals of a fitted hypothesis and the space of what was fitted.
pub struct Screen<'a> {
    bench: Bench<'a>,
    base: &'a Trial,
    /// Simulated outputs of each train record.
    outputs: Vec<Vec<f64>>,
    /// Rows of the data.
    rows: usize,
    fitted: Projector,
    data_alone: Projector,
    /// `r'`.
    residual: DVector<f64>,
    /// `r` with the deviations from what was known before.
    whole: DVector<f64>,
}

/// The QR decomposition of derivatives with columns of unit norm.
struct Projector {
    q: DMatrix<f64>,
    r: DMatrix<f64>,
    norms: Vec<f64>,
    rows: usize,
}

impl Projector {
    /// `tail` rows are added below: priors, or a ridge.
    fn new(j: &DMatrix<f64>, tail: Option<&DMatrix<f64>>) -> Self {
        let n = j.ncols();
        let extra = tail.map_or(n, DMatrix::nrows);
        let mut all = DMatrix::zeros(j.nrows() + extra, n);
        all.rows_mut(0, j.nrows()).copy_from(j);
        if let Some(t) = tail {
            all.rows_mut(j.nrows(), extra).copy_from(t);
        }
        let norms: Vec<f64> = (0..n).map(|c| all.column(c).norm()).collect();
        for c in 0..n {
            if norms[c] > 0.0 {
                all.column_mut(c).unscale_mut(norms[c]);
            }
            if tail.is_none() {
                all[(j.nrows() + c, c)] = RIDGE;
            }
        }
        let rows = all.nrows();
        let qr = all.qr();
        Self { q: qr.q(), r: qr.r(), norms, rows }
    }

    fn padded(&self, v: &[f64]) -> DVector<f64> {
        let mut out = DVector::zeros(self.rows);
        out.rows_mut(0, v.len()).copy_from_slice(v);
        out
    }

    /// What of `v` is outside the space.
    fn outside(&self, v: &DVector<f64>) -> DVector<f64> {
        // Twice is enough (Kahan; Parlett 1998, section 6.9).
        let once = v - &self.q * self.q.tr_mul(v);
        &once - &self.q * self.q.tr_mul(&once)
    }

    /// The step of the fitted numbers that takes away most of `v`.
    fn step(&self, v: &DVector<f64>) -> Vec<f64> {
        let right = -self.q.tr_mul(v);
        let solved = self.r.solve_upper_triangular(&right);
        let step = solved.unwrap_or_else(|| DVector::zeros(self.norms.len()));
        step.iter().zip(&self.norms).map(|(s, n)| if *n > 0.0 { s / n } else { 0.0 }).collect()
    }
}

/// What the test found of one candidate in one of its probes.
pub struct Finding {
    /// Decrease of the sum of squares that it promises.
    pub gain: f64,
    /// Point from which to fit.
    pub start: Point,
    /// Projected actions, for pairs.
    pub actions: Vec<DVector<f64>>,
    /// Whether what was fitted can do the same.
    pub imitated: bool,
}

impl<'a> Screen<'a> {
    /// Linearises a fitted hypothesis; `None` where its run fails.
    pub fn new(bench: &Bench<'a>, base: &'a Trial) -> Option<Self> {
        let subject = base.made.subject();
        let n = base.made.priors.len() + base.fit.point.x0.iter().map(Vec::len).sum::<usize>();
        let (mut j, mut r, mut tail, mut deviations) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let push = |to: &mut Vec<f64>, by: &mut Vec<f64>, row: &[f64], v: f64| {
            to.extend_from_slice(row);
            by.push(v);
        };
        linearised(
            &subject,
            bench.train,
            &base.fit.point,
            bench.train_start,
            &mut |row, v| push(&mut j, &mut r, row, v),
            &mut |row, v| push(&mut tail, &mut deviations, row, v),
        )?;
        let rows = r.len();
        let j = DMatrix::from_row_slice(rows, n, &j);
        let tail = DMatrix::from_row_slice(deviations.len(), n, &tail);
        let fitted = Projector::new(&j, Some(&tail));
        let data_alone = Projector::new(&j, None);
        r.extend(deviations);
        let whole = DVector::from_vec(r);
        let residual = fitted.outside(&whole);
        let p = base.parameters();
        let outputs = outputs(&base.made.system, &p, bench.train, &base.fit.point.x0)?;
        Some(Self { bench: *bench, base, outputs, rows, fitted, data_alone, residual, whole })
    }

    /// Sum of squares that nothing fitted so far explains.
    pub fn left(&self) -> f64 {
        self.residual.norm_squared()
    }

    /// Looks at a candidate in one way.
    pub fn look(&self, candidate: &Candidate, probe: &Probe) -> Option<Finding> {
        let columns = self.actions(candidate, probe)?;
        let seen: f64 = columns.iter().map(|c| c.norm_squared()).sum();
        if seen == 0.0 || !seen.is_finite() {
            return None;
        }
        let linear = !probe.amplitudes.is_empty();
        let imitated = linear
            && columns.iter().all(|c| {
                let alone = self.data_alone.padded(&c.as_slice()[..self.rows]);
                self.data_alone.outside(&alone).norm() < IMITATED * c.norm()
            });
        let actions: Vec<DVector<f64>> = columns.iter().map(|c| self.fitted.outside(c)).collect();
        let mut a = least_squares(&actions, &self.residual);
        let priors = &self.base.made.priors;
        let mut own = probe.own.clone();
        if let (Some((k, phase)), [s, c]) = (probe.wave, a.as_slice()) {
            (own[k], own[phase]) = (s.hypot(*c), c.atan2(*s));
        } else if linear {
            for (&k, a) in probe.amplitudes.iter().zip(&mut a) {
                let prior = &candidate.made.priors[priors.len() + k];
                let wanted = candidate.neutral[k] + *a;
                own[k] = wanted.clamp(prior.bounds.0, prior.bounds.1);
                *a = own[k] - candidate.neutral[k];
                if *a == 0.0 {
                    // A sign that physics forbids: begin with a little of the one that it allows.
                    let other = if prior.bounds.0 == candidate.neutral[k] { 0.05 } else { -0.05 };
                    own[k] = candidate.neutral[k] + other * prior.scale;
                }
            }
        } else {
            a[0] = a[0].clamp(0.0, if candidate.forceful { LARGEST } else { FARTHEST });
            own = candidate.resized(&probe.own, a[0].max(LEAST));
        }
        let mut after = self.residual.clone();
        let mut all = self.whole.clone();
        for ((c, d), a) in columns.iter().zip(&actions).zip(&a) {
            after.axpy(*a, d, 1.0);
            all.axpy(*a, c, 1.0);
        }
        let gain = self.left() - after.norm_squared();
        let at = &self.base.fit.point;
        let step = self.fitted.step(&all);
        let subject = self.base.made.subject();
        let to = moved(&subject, self.bench.train, at, &step);
        Some(Finding { gain, start: joined(candidate, self.bench.train, &to, &own), actions, imitated })
    }

    /// Actions of a candidate on the train records, in units of noise, with zeros where priors stand.
    fn actions(&self, candidate: &Candidate, probe: &Probe) -> Option<Vec<DVector<f64>>> {
        let at = joined(candidate, self.bench.train, &self.base.fit.point, &probe.own);
        if probe.amplitudes.is_empty() {
            let system = candidate.made.model.compile_for(Vec::new(), Backend::Native);
            let p = full(&candidate.made.system, &at.theta);
            let y = outputs(&system, &p, self.bench.train, &at.x0)?;
            return Some(vec![self.stacked(|r, i| y[r][i] - self.outputs[r][i])]);
        }
        let phases: &[f64] = if probe.wave.is_some() { &[0.0, std::f64::consts::FRAC_PI_2] } else { &[0.0] };
        let mut out = Vec::new();
        for phase in phases {
            let mut own = probe.own.clone();
            if let Some((_, k)) = probe.wave {
                own[k] = *phase;
            }
            let at = joined(candidate, self.bench.train, &self.base.fit.point, &own);
            out.extend(self.derivatives(candidate, &at, &probe.amplitudes)?);
        }
        Some(out)
    }

    /// Derivatives of the outputs by some of a candidate's own parameters.
    fn derivatives(&self, candidate: &Candidate, at: &Point, which: &[usize]) -> Option<Vec<DVector<f64>>> {
        let made = &candidate.made;
        let free: Vec<usize> = which.iter().map(|k| made.system.free()[candidate.own[*k]]).collect();
        let system = made.model.compile_for(free, Backend::Native);
        let p = full(&made.system, &at.theta);
        let (nx, ny, nf) = (system.states(), system.outputs(), which.len());
        let mut dy: Vec<Vec<Vec<f64>>> = vec![Vec::new(); nf];
        let Ground { experiments, substeps, control, .. } = self.bench.train;
        for (experiment, x0) in experiments.iter().zip(&at.x0) {
            let run = Run { system: &system, p: &p, x0, experiment, substeps, observer: None, control };
            let mut all: Vec<Vec<f64>> = vec![Vec::with_capacity(experiment.y.len()); nf];
            run.go(true, &mut |_, _, d| {
                for (f, to) in all.iter_mut().enumerate() {
                    to.extend((0..ny).map(|j| d[j * (nx + nf) + nx + f]));
                }
            })
            .ok()?;
            for (to, from) in dy.iter_mut().zip(all) {
                to.push(from);
            }
        }
        Some(dy.iter().map(|d| self.stacked(|r, i| d[r][i])).collect())
    }

    /// Values of all measured samples in units of noise.
    fn stacked(&self, value: impl Fn(usize, usize) -> f64) -> DVector<f64> {
        let Ground { experiments, sigma, .. } = self.bench.train;
        let mut out = Vec::with_capacity(self.whole.len());
        for (r, e) in experiments.iter().enumerate() {
            let seen = e.y.iter().enumerate().filter(|(_, y)| !y.is_nan());
            out.extend(seen.map(|(i, _)| value(r, i) / sigma[i % sigma.len()]));
        }
        out.resize(self.whole.len(), 0.0);
        DVector::from_vec(out)
    }

    /// What several projected actions explain together.
    pub fn together(&self, actions: &[&DVector<f64>]) -> f64 {
        let owned: Vec<DVector<f64>> = actions.iter().map(|a| (*a).clone()).collect();
        let a = least_squares(&owned, &self.residual);
        let mut after = self.residual.clone();
        for (c, a) in owned.iter().zip(&a) {
            after.axpy(*a, c, 1.0);
        }
        self.left() - after.norm_squared()
    }
}

/// A point of a fitted hypothesis with values of a candidate's own parameters, and its own states at their start.
pub fn joined(candidate: &Candidate, ground: Ground<'_>, at: &Point, own: &[f64]) -> Point {
    let system = &candidate.made.system;
    let theta = [at.theta.as_slice(), own].concat();
    let x0 = widened(system, &full(system, &theta), ground.experiments, &at.x0);
    Point { theta, x0 }
}

/// The amplitudes that take away most of a residual.
fn least_squares(columns: &[DVector<f64>], residual: &DVector<f64>) -> Vec<f64> {
    let n = columns.len();
    let norms: Vec<f64> = columns.iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
    let gram = DMatrix::from_fn(n, n, |i, j| {
        columns[i].dot(&columns[j]) / (norms[i] * norms[j]) + if i == j { 1e-12 } else { 0.0 }
    });
    let right = DVector::from_fn(n, |i, _| -columns[i].dot(residual) / norms[i]);
    let a = gram.cholesky().map_or_else(|| DVector::zeros(n), |c| c.solve(&right));
    a.iter().zip(&norms).map(|(a, n)| a / n).collect()
}

/// Outputs of every record; `None` where a run fails.
fn outputs(system: &dyn System, p: &[f64], ground: Ground<'_>, x0: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
    let one = |(experiment, x0)| {
        let Ground { substeps, control, .. } = ground;
        Run { system, p, x0, experiment, substeps, observer: None, control }.outputs()
    };
    ground.experiments.iter().zip(x0.iter().map(Vec::as_slice)).map(one).collect()
}
