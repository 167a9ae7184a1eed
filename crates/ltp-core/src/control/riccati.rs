//! The periodic linear-quadratic regulator: `K(t) = R^{-1} B(t)^T P(t)`, the baseline of every other design.
//!
//! `-P' = A^T P + P A - P B R^{-1} B^T P + Q` with `A + alpha I` for A has one periodic solution that stabilises: the stable
//! subspace of the Hamiltonian monodromy matrix, found by doubling ([`super::redheffer`]). All exponents of the closed loop are
//! then below `-alpha`. The gain is given at even times, as many as its Fourier coefficients need to fall to rounding.
//!
//! References: S. Bittanti, P. Colaneri, *Periodic Systems*, 2009, chapter 13; B. D. O. Anderson, J. B. Moore, *Optimal
//! Control*, 1990, section 3.5 (prescribed degree of stability).

use nalgebra::{DMatrix, SymmetricEigen};

use super::design::unstabilisable;
use super::exact::Exact;
use super::feedback::Feedback;
use super::law::Law;
use super::lifted::smooth;
use super::redheffer::Flow;
use crate::error::{Error, Result};
use crate::numeric::fourier_series::FourierSeries;
use crate::numeric::gauss::Gauss;
use crate::periodic::{Entry, LtpSystem};

/// Collocation nodes of one interval.
const NODES: usize = 6;
/// Fewest and most even times over a period.
const TIMES: (usize, usize) = (64, 1024);
/// Doublings of the horizon: `2^40` periods.
const DOUBLINGS: usize = 40;
/// Coefficients of the gain below this share of the largest are not kept.
const TAIL: f64 = 1e-10;

/// What is weighed: the integral of `x^T Q x + u^T R u`.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Q (nx, nx), row-major, symmetric and positive semidefinite.
    pub states: Vec<f64>,
    /// R (nu, nu), row-major, symmetric and positive definite.
    pub inputs: Vec<f64>,
    /// Prescribed degree of stability alpha, 1/s.
    pub shift: f64,
}

/// The periodic regulator; of its gain only some `harmonics`, when they are given.
///
/// Figures: the largest exact exponent, the residual of the Riccati equation relative to its largest term, the norm of all numbers
/// of the gain, and of a gain with chosen harmonics also the exponent of the whole one.
///
/// # Errors
/// `Shape` and `OutOfRange` for weights that are not symmetric or not (semi)definite, `Model` for a mode not below `-alpha` that
/// no input reaches and for jumps, `NoConvergence` where a mode not below `-alpha` is not seen by Q.
pub fn periodic_lqr(system: &LtpSystem, weights: &Weights, harmonics: Option<&[usize]>) -> Result<Feedback> {
    smooth(system)?;
    let (nx, nu) = (system.size().nx, system.size().nu);
    check_weight("state weights Q", &weights.states, nx, false)?;
    check_weight("input weights R", &weights.inputs, nu, true)?;
    if !(weights.shift >= 0.0 && weights.shift.is_finite()) {
        let expected = "a degree of stability, from 0 on".into();
        return Err(Error::OutOfRange { what: "shift, 1/s".into(), found: weights.shift, expected });
    }
    let law = Law::new(nu, nx, system.period(), harmonics.unwrap_or(&[0]))?;
    for (exponent, reach) in Exact::new(system, &Law { harmonics: vec![0], ..law.clone() }, None)?.reach()? {
        if reach < 1e-9 && exponent.re >= -weights.shift - 1e-9 {
            return Err(unstabilisable(exponent.re, &format!("-{}", weights.shift)));
        }
    }
    let mut times = TIMES.0;
    let (whole, residual) = loop {
        let solved = Riccati::new(system, weights).solve(times)?;
        let trimmed = solved.0.trimmed(TAIL);
        if trimmed.harmonics() <= times / 4 || times >= TIMES.1 {
            break (trimmed, solved.1);
        }
        times *= 2;
    };
    let mut warnings = Vec::new();
    if whole.harmonics() > times / 4 {
        warnings
            .push(format!("the gain has more than {} harmonics: its coefficients do not fall to rounding", times / 4));
    }
    if residual > 1e-6 {
        warnings.push(format!("the Riccati equation is left with a residual of {residual:.1e} of its largest term"));
    }
    let largest = |gain: &FourierSeries| Ok(system.closed(gain)?.exponents()?[0].re);
    let exponent = largest(&whole)?;
    if exponent.is_nan() || exponent >= -weights.shift {
        return Err(Error::NoConvergence {
            method: "periodic-lqr".into(),
            iterations: DOUBLINGS,
            residual: exponent + weights.shift,
            advice:
                "the regulator leaves a mode where it is, because the state weights do not see it: weigh more states"
                    .into(),
        });
    }
    let gain = match harmonics {
        Some(_) => law.series(&law.unknowns_of(&whole)?)?,
        None => whole,
    };
    let mut figures = vec![("exact, 1/s".to_owned(), exponent), ("residual".to_owned(), residual)];
    if harmonics.is_some() {
        let kept = largest(&gain)?;
        figures = vec![("exact, 1/s".into(), kept), ("exact, whole gain, 1/s".into(), exponent), figures[1].clone()];
        if kept >= 0.0 {
            warnings.push(format!(
                "with these harmonics alone the closed loop is not stable: {kept:.4} 1/s against {exponent:.4} of the whole gain"
            ));
        }
    }
    let mut feedback = Feedback { gain, method: "periodic-lqr".into(), figures, warnings };
    let norm = feedback.harmonics().iter().map(|k| k.norm_sqr()).sum::<f64>().sqrt();
    feedback.figures.push(("norm".into(), norm));
    Ok(feedback)
}

/// The equation at hand.
struct Riccati<'a> {
    system: &'a LtpSystem,
    q: DMatrix<f64>,
    r_inverse: DMatrix<f64>,
    shift: f64,
}

impl<'a> Riccati<'a> {
    fn new(system: &'a LtpSystem, weights: &Weights) -> Self {
        let (nx, nu) = (system.size().nx, system.size().nu);
        let r = DMatrix::from_row_slice(nu, nu, &weights.inputs);
        let r_inverse = r.try_inverse().unwrap_or_else(|| DMatrix::identity(nu, nu));
        Self { system, q: DMatrix::from_row_slice(nx, nx, &weights.states), r_inverse, shift: weights.shift }
    }

    /// A + alpha I and B at `t`, s.
    fn at(&self, t: f64) -> (DMatrix<f64>, DMatrix<f64>) {
        let (nx, nu) = (self.system.size().nx, self.system.size().nu);
        let a = DMatrix::from_row_slice(nx, nx, &self.system.matrix(Entry::A, t));
        let b = DMatrix::from_row_slice(nx, nu, &self.system.matrix(Entry::B, t));
        (a + DMatrix::identity(nx, nx) * self.shift, b)
    }

    /// The gain at `times` even times, as a series, and the relative residual of P.
    fn solve(&self, times: usize) -> Result<(FourierSeries, f64)> {
        let period = self.system.period();
        let gauss = Gauss::new(NODES);
        let stuck = || Error::NoConvergence {
            method: "periodic-lqr".into(),
            iterations: DOUBLINGS,
            residual: f64::NAN,
            advice: "a mode on the border of stability is not seen by the state weights, or the weights are of very \
                     different sizes: weigh more states, or change the shift"
                .into(),
        };
        // even times, and where segments of the system meet
        let mut cuts: Vec<(f64, Option<usize>)> =
            (0..times).map(|i| (period * i as f64 / times as f64, Some(i))).collect();
        for segment in self.system.segments() {
            let at = segment.start.rem_euclid(period);
            if cuts.iter().all(|c| (c.0 - at).abs() > 1e-9 * period && period - at > 1e-9 * period) {
                cuts.push((at, None));
            }
        }
        cuts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut flows = Vec::with_capacity(cuts.len());
        for (i, &(start, _)) in cuts.iter().enumerate() {
            let length = cuts.get(i + 1).map_or(period, |c| c.0) - start;
            let matrices: Vec<_> = gauss.nodes.iter().map(|n| self.hamiltonian(start + n * length)).collect();
            flows.push(Flow::over(&gauss, &matrices, length).ok_or_else(stuck)?);
        }
        let mut whole = flows[0].clone();
        for flow in &flows[1..] {
            whole = whole.then(flow).ok_or_else(stuck)?;
        }
        let nx = self.system.size().nx;
        let mut p = whole.h.clone();
        for doubling in 0.. {
            whole = whole.then(&whole).filter(|w| w.h.iter().all(|v| v.is_finite())).ok_or_else(stuck)?;
            let change = (&whole.h - &p).amax();
            p.copy_from(&whole.h);
            if change <= 1e-14 * p.amax() {
                break;
            }
            if doubling == DOUBLINGS {
                return Err(stuck());
            }
        }
        let (mut solution, mut gain) = (vec![0.0; times * nx * nx], Vec::new());
        for (flow, cut) in flows.iter().zip(&cuts).rev() {
            p = flow.back(&p).ok_or_else(stuck)?;
            if let Some(i) = cut.1 {
                solution[i * nx * nx..(i + 1) * nx * nx].copy_from_slice(p.as_slice());
            }
        }
        for (i, p) in solution.chunks_exact(nx * nx).enumerate() {
            let (_, b) = self.at(period * i as f64 / times as f64);
            let k = &self.r_inverse * b.transpose() * DMatrix::from_column_slice(nx, nx, p);
            gain.extend(k.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<_>>()));
        }
        let gain = FourierSeries::from_samples(period, self.system.size().nu * nx, &gain)?;
        let solution = FourierSeries::from_samples(period, nx * nx, &solution)?.trimmed(TAIL);
        Ok((gain, self.residual(&solution, times)))
    }

    fn hamiltonian(&self, t: f64) -> DMatrix<f64> {
        let (a, b) = self.at(t);
        let nx = a.nrows();
        let mut out = DMatrix::zeros(2 * nx, 2 * nx);
        out.view_mut((0, 0), (nx, nx)).copy_from(&a);
        out.view_mut((0, nx), (nx, nx)).copy_from(&-(&b * &self.r_inverse * b.transpose()));
        out.view_mut((nx, 0), (nx, nx)).copy_from(&-&self.q);
        out.view_mut((nx, nx), (nx, nx)).copy_from(&-a.transpose());
        out
    }

    /// Largest entry that the equation is left with, relative to its largest term.
    fn residual(&self, p: &FourierSeries, times: usize) -> f64 {
        let (nx, slope) = (self.system.size().nx, p.derivative());
        let (mut left, mut size) = (0.0_f64, 0.0_f64);
        for i in 0..times {
            let t = p.period() * (i as f64 + 0.5) / times as f64;
            let (a, b) = self.at(t);
            let matrix = |s: &FourierSeries| DMatrix::from_column_slice(nx, nx, &s.value(t));
            let (value, slope) = (matrix(p), matrix(&slope));
            let pa = &value * &a;
            let quadratic = &value * &b * &self.r_inverse * b.transpose() * &value;
            let sum = &slope + &pa + pa.transpose() - &quadratic + &self.q;
            left = left.max(sum.amax());
            size = [&slope, &pa, &quadratic, &self.q].iter().fold(size, |m, t| m.max(t.amax()));
        }
        left / size.max(f64::MIN_POSITIVE)
    }
}

/// Checks that a weight (n, n) is finite, symmetric and positive semidefinite, or definite.
pub(super) fn check_weight(what: &str, weight: &[f64], n: usize, definite: bool) -> Result<()> {
    if weight.len() != n * n {
        return Err(Error::Shape { what: format!("{what} ({n}, {n})"), expected: n * n, found: weight.len() });
    }
    if let Some(at) = weight.iter().position(|v| !v.is_finite()) {
        let column = format!("{}", at % n);
        return Err(Error::NotFinite { what: what.into(), row: at / n, column, value: weight[at] });
    }
    let matrix = DMatrix::from_row_slice(n, n, weight);
    let size = matrix.amax();
    let skew = (&matrix - matrix.transpose()).amax();
    if skew > 1e-12 * size {
        let expected = "0: the weight must be symmetric".into();
        return Err(Error::OutOfRange {
            what: format!("{what}: largest difference to its transpose"),
            found: skew,
            expected,
        });
    }
    let least = SymmetricEigen::new(matrix).eigenvalues.min();
    let (bad, expected) = if definite {
        (least <= 1e-14 * size, "a positive number: the weight must be positive definite")
    } else {
        (least < -1e-12 * size, "0 or more: the weight must be positive semidefinite")
    };
    if bad {
        let what = format!("{what}: smallest eigenvalue");
        return Err(Error::OutOfRange { what, found: least, expected: expected.into() });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::testing::{UP, downward, inverted};
    use super::*;

    fn weights(q: [f64; 2], r: f64, shift: f64) -> Weights {
        let mut states = vec![0.0; 16];
        (states[0], states[5]) = (q[0], q[1]);
        Weights { states, inputs: vec![r], shift }
    }

    #[test]
    fn the_table_of_section_8() {
        let (down, orbit, unstable) = (downward(), inverted(UP, UP, 0.1), inverted(UP, UP, 0.105));
        let cases = [
            (&down, [25.0, 1.0], 1e-3, 0.0, -1.38, 5e-3),
            (&down, [25.0, 1.0], 1e-2, 6.0, -11.3, 5e-2),
            (&orbit, [1.0, 1.0], 1e-4, 0.0, -0.673, 2e-3),
            (&orbit, [1.0, 1.0], 1e-5, 0.0, -1.01, 2e-2),
            (&orbit, [1.0, 1.0], 1e-2, 1.0, -2.00, 2e-2),
            (&orbit, [1.0, 1.0], 1e-2, 2.0, -3.83, 1e-2),
            (&unstable, [1.0, 1.0], 1e-4, 0.0, -0.729, 2e-3),
            (&unstable, [1.0, 1.0], 1e-2, 1.0, -2.04, 2e-2),
        ];
        for (system, q, r, shift, expected, tolerance) in cases {
            let found = periodic_lqr(system, &weights(q, r, shift), None).expect("a regulator");
            let (exponent, residual) = (found.figure("exact, 1/s").expect("it"), found.figure("residual").expect("it"));
            assert!((exponent - expected).abs() < tolerance, "{exponent} {expected}");
            assert!(residual < 1e-7 && found.warnings.is_empty(), "{found:?}");
        }
    }

    #[test]
    fn two_harmonics_keep_the_figures() {
        // research section 8: K0 + Re(K2 e^{2jwt}), 12 numbers; the mean alone does not do it
        let cases =
            [(0.1, 1e-4, 0.0, -0.675), (0.1, 1e-5, 0.0, -1.023), (0.1, 1e-2, 1.0, -2.015), (0.105, 1e-2, 1.0, -2.055)];
        for (amplitude, r, shift, expected) in cases {
            let system = inverted(UP, UP, amplitude);
            let found = periodic_lqr(&system, &weights([1.0; 2], r, shift), Some(&[0, 2])).expect("a regulator");
            let exponent = found.figure("exact, 1/s").expect("it");
            assert!((exponent - expected).abs() < 2e-3, "{exponent} {expected}");
            let mean = periodic_lqr(&system, &weights([1.0; 2], r, shift), Some(&[0])).expect("a regulator");
            assert!(mean.figure("exact, 1/s").expect("it") > -0.02);
        }
    }

    #[test]
    fn a_constant_system_has_the_algebraic_solution() {
        // x'' = u, Q = diag(1, 0), R = 1: K = [1, sqrt 2]
        let segment = crate::periodic::Segment {
            start: 0.0,
            end: 2.0,
            a: [0.0, 1.0, 0.0, 0.0].repeat(12),
            b: [0.0, 1.0].repeat(12),
            c: vec![],
            d: vec![],
            jumps: vec![],
        };
        let size = crate::periodic::Size { nx: 2, nu: 1, ny: 0 };
        let system = LtpSystem::new(2.0, 0.0, size, vec![segment.clone()]).expect("a system");
        let weights = Weights { states: vec![1.0, 0.0, 0.0, 0.0], inputs: vec![1.0], shift: 0.0 };
        let found = periodic_lqr(&system, &weights, None).expect("a regulator");
        assert_eq!(found.gain.harmonics(), 0);
        let gain = found.gain.value(0.3);
        assert!((gain[0] - 1.0).abs() < 1e-12 && (gain[1] - 2.0_f64.sqrt()).abs() < 1e-12, "{gain:?}");
        // an input that does not reach the states
        let nothing = crate::periodic::Segment { b: vec![0.0; 24], ..segment };
        let system = LtpSystem::new(2.0, 0.0, size, vec![nothing]).expect("a system");
        let error = periodic_lqr(&system, &weights, None).expect_err("no input").to_string();
        assert!(error.contains("cannot be stabilised"), "{error}");
    }

    #[test]
    fn weights_that_are_none_are_refused() {
        let system = downward();
        let good = weights([1.0, 1.0], 1.0, 0.0);
        let spoil = |change: &dyn Fn(&mut Weights)| {
            let mut bad = good.clone();
            change(&mut bad);
            periodic_lqr(&system, &bad, None).expect_err("bad weights").to_string()
        };
        assert!(spoil(&|w| w.states.truncate(4)).contains("expected 16"));
        assert!(spoil(&|w| w.states[1] = 1.0).contains("symmetric"));
        assert!(spoil(&|w| w.states[0] = -1.0).contains("semidefinite"));
        assert!(spoil(&|w| w.inputs[0] = 0.0).contains("positive definite"));
        assert!(spoil(&|w| w.shift = -1.0).contains("shift"));
        assert!(spoil(&|w| w.states[3] = f64::NAN).contains("row 0"));
    }
}
