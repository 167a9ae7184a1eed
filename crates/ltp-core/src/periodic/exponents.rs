//! Floquet exponents, accurate for the fastest decaying modes as well.
//!
//! Eigenvalues of the monodromy matrix carry an error of rounding relative to the largest: after a decay by 1e-16 nothing is
//! left of a mode. Here an orthonormal basis is carried through the period and made orthonormal again after each part; the
//! triangular factors keep every rate, as in the computation of Lyapunov exponents (L. Dieci, R. D. Russell, E. S. Van Vleck,
//! SIAM J. Numer. Anal. 34, 1997), and modes of one decade are found together from their own block.

use nalgebra::DMatrix;
use std::f64::consts::{PI, TAU};

use super::propagate::Propagation;
use super::system::LtpSystem;
use crate::error::{Error, Result};
use crate::numeric::Complex;
use crate::numeric::eigen::eigenvalues;
use crate::numeric::rng::SplitMix64;

/// Periods after which neighbouring blocks are apart to rounding: each period a factor ten at least.
const PERIODS: usize = 18;
/// Decay per period, natural logarithm of a decade, that separates two blocks.
const APART: f64 = std::f64::consts::LN_10;
/// Cosine below which the basis after a period is orthogonal to what it should not contain.
const INVARIANT: f64 = 1e-9;
/// An imaginary part this small beside a negative real multiplier is rounding.
const REAL: f64 = 1e-9;

impl LtpSystem {
    /// Floquet exponents (nx), 1/s, largest real part first: `ln(multiplier) / T` with `|Im| <= pi / T`; a negative real
    /// multiplier has `Im = +pi / T`. Of a pair the one with positive imaginary part comes first.
    ///
    /// # Errors
    /// `Model` when a jump is singular: a state that is forgotten within a period has no exponent. `NoConvergence` when
    /// eigenvalues fail.
    pub fn exponents(&self) -> Result<Vec<Complex>> {
        let nx = self.size().nx;
        let steps = self.steps();
        // Any basis does that no invariant subspace contains a part of.
        let mut rng = SplitMix64::new(1);
        let mut q = DMatrix::<f64>::from_fn(nx, nx, |_, _| rng.normal()).qr().q();
        for _ in 0..PERIODS {
            steps.iter().for_each(|step| q = (step * &q).qr().q());
        }
        // One more period, with the triangular factors kept: M Q = Q_end R_m ... R_1.
        let start = q.clone();
        let mut factors = Vec::with_capacity(steps.len());
        for step in &steps {
            let qr = (step * &q).qr();
            factors.push(qr.r());
            q = qr.q();
        }
        let rates: Vec<f64> = (0..nx).map(|i| factors.iter().map(|r| r[(i, i)].abs().ln()).sum()).collect();
        if let Some(jump) = rates.iter().any(|r| !r.is_finite()).then(|| self.jumps().next()) {
            let name = jump.map_or("an event", |j| j.name.as_str());
            let message = format!(
                "the monodromy matrix is singular (`{name}` forgets a state): a multiplier of zero has no exponent; use \
                 `multipliers`"
            );
            return Err(Error::Model { path: "exponents".into(), message });
        }
        let turn = start.transpose() * &q;
        let mut found = Vec::with_capacity(nx);
        let mut first = 0;
        while first < nx {
            let mut last = first + 1;
            // What follows belongs to the block when it is faster by less than a decade, and when the block does not span an
            // invariant subspace: the two rates of a complex pair differ as the basis happens to stand in its plane.
            let tied = |i: usize, j: usize| rates[i] - rates[j] < APART || turn[(j, i)].abs() > INVARIANT;
            while let Some(next) = (last..nx).rfind(|&j| (first..last).any(|i| tied(i, j))) {
                last = next + 1;
            }
            found.extend(block(&factors, &turn, &rates, first, last)?);
            first = last;
        }
        let mut exponents: Vec<Complex> = found.into_iter().map(|e| e / self.period()).collect();
        let size = |v: f64| (v * self.period() * 1e12).round();
        exponents.sort_by(|a, b| size(b.re).total_cmp(&size(a.re)).then(b.im.total_cmp(&a.im)));
        Ok(exponents)
    }

    /// Transition matrices of one period in order, jumps included; their product is the monodromy matrix.
    fn steps(&self) -> Vec<DMatrix<f64>> {
        let nx = self.size().nx;
        let matrix = |rows: &[f64]| DMatrix::from_row_slice(nx, nx, rows);
        let mut steps = Vec::new();
        for part in Propagation::new(self, 0.0).parts {
            steps.push(matrix(&part.end_state));
            let jumps = part.jumps.and_then(|k| self.jump_product(&self.segments()[k]));
            steps.extend(jumps.as_deref().map(matrix));
        }
        steps
    }
}

/// Logarithms of the multipliers of a diagonal block, scaled on the way so that none vanishes.
fn block(
    factors: &[DMatrix<f64>],
    turn: &DMatrix<f64>,
    rates: &[f64],
    first: usize,
    last: usize,
) -> Result<Vec<Complex>> {
    let n = last - first;
    let mean = rates[first..last].iter().sum::<f64>() / n as f64;
    let (mut product, mut log) = (DMatrix::<f64>::identity(n, n), 0.0);
    for r in factors {
        product = r.view((first, first), (n, n)) * product;
        let norm = product.norm();
        product /= norm;
        log += norm.ln();
    }
    product *= (log - mean).exp();
    let own = turn.view((first, first), (n, n)) * product;
    let rows: Vec<f64> = own.transpose().iter().copied().collect();
    let ln = |m: Complex| {
        let negative = m.re < 0.0 && m.im.abs() <= REAL * m.norm();
        Complex::new(m.norm().ln() + mean, if negative { PI } else { m.arg() })
    };
    Ok(eigenvalues(&rows, n)?.into_iter().map(ln).collect())
}

/// Which copy `exponent + j n w` is nearest to `value`, and how far.
pub(super) fn nearest_copy(value: Complex, exponent: Complex, period: f64) -> (i64, f64) {
    let w = TAU / period;
    let n = ((value.im - exponent.im) / w).round();
    (n as i64, (value - exponent - Complex::new(0.0, n * w)).norm())
}

#[cfg(test)]
mod tests {
    use crate::numeric::Complex;
    use crate::periodic::system::Entry;
    use crate::periodic::{LtpSystem, Size};
    use std::f64::consts::{PI, TAU};

    /// `x = P(t) z` with `z' = L z`, `P` a product of plane rotations by `turns * sin` and shears: exponents are those of `L`.
    #[test]
    fn modes_that_decay_by_1e90_in_a_period_keep_their_exponents() {
        let (a, w) = (0.7_f64, TAU);
        let rates = [-0.3, -2.0, -80.0, -205.0];
        // P = exp(S a sin wt) for the skew S of the plane of states 0, 2 and of 1, 3: rotations.
        let system = LtpSystem::smooth(1.0, Size { nx: 4, nu: 0, ny: 0 }, |t, entry| {
            if entry != Entry::A {
                return vec![];
            }
            let (angle, rate) = (a * (w * t).sin(), a * w * (w * t).cos());
            let (s, c) = angle.sin_cos();
            let mut out = vec![0.0; 16];
            for (i, j) in [(0, 2), (1, 3)] {
                let (li, lj) = (rates[i], rates[j]);
                out[i * 4 + i] = li * c * c + lj * s * s;
                out[j * 4 + j] = li * s * s + lj * c * c;
                out[i * 4 + j] = (li - lj) * s * c - rate;
                out[j * 4 + i] = (li - lj) * s * c + rate;
            }
            out
        })
        .expect("system");
        for (found, expected) in system.exponents().expect("exponents").iter().zip(rates) {
            assert!((found - Complex::from(expected)).norm() < 1e-10 * expected.abs().max(1.0), "{found} {expected}");
        }
    }

    #[test]
    fn a_complex_pair_stays_together_however_its_plane_is_sheared() {
        // constant matrices: a slow mode, a pair whose plane is sheared, and a fast mode
        for (shear, turn) in [1.0, 5.0, 30.0, 200.0].into_iter().flat_map(|s| (1..8).map(move |w| (s, f64::from(w)))) {
            let system = LtpSystem::smooth(0.2, Size { nx: 4, nu: 0, ny: 0 }, move |_, entry| match entry {
                Entry::A => vec![
                    -0.6,
                    1.0,
                    0.5,
                    0.2,
                    0.0,
                    -4.7,
                    turn * shear,
                    1.0,
                    0.0,
                    -turn / shear,
                    -4.7,
                    2.0,
                    0.0,
                    0.0,
                    0.0,
                    -17.8,
                ],
                _ => vec![],
            })
            .expect("system");
            let c = Complex::new;
            let expected = [c(-0.6, 0.0), c(-4.7, turn), c(-4.7, -turn), c(-17.8, 0.0)];
            for (found, expected) in system.exponents().expect("exponents").iter().zip(expected) {
                assert!((found - expected).norm() < 1e-9, "{shear}, {turn}: {found} {expected}");
            }
        }
    }

    #[test]
    fn exponents_are_logarithms_of_the_multipliers() {
        let mathieu = |damping: f64, stiffness: f64, depth: f64| {
            LtpSystem::smooth(2.0, Size { nx: 2, nu: 0, ny: 0 }, move |t, entry| match entry {
                Entry::A => vec![0.0, 1.0, -stiffness - depth * (PI * t).cos(), -damping],
                _ => vec![],
            })
            .expect("system")
        };
        for system in [mathieu(0.1, 3.0, 0.4), mathieu(0.05, 2.4, 2.0), mathieu(0.3, -0.2, 0.1)] {
            let exponents = system.exponents().expect("exponents");
            assert!(exponents[0].re >= exponents[1].re - 1e-12);
            let product: Complex = exponents.iter().map(|e| (e * 2.0).exp()).product();
            let determinant: Complex = system.multipliers().iter().product();
            assert!((product - determinant).norm() < 1e-12);
            for m in system.multipliers() {
                assert!(exponents.iter().any(|e| ((e * 2.0).exp() - m).norm() < 1e-12), "{exponents:?} {m}");
            }
            assert!(exponents.iter().all(|e| e.im.abs() <= PI / 2.0 + 1e-12));
        }
    }
}
