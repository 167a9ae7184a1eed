//! The Floquet decomposition: a periodic change of coordinates in which the system is time-invariant.
//!
//! `Phi(t, t0) = P(t) e^{Abar (t - t0)}` with `P` of period `T` and `P(t0) = I`, hence `e^{Abar T} = Phi(t0 + T, t0)`, and with
//! `x = P z`: `z' = Abar z + P^{-1} B u`, `y = C P z + D u`, `Abar = P^{-1} (A P - P')`; Duyul (2018), equations (2.11) to
//! (2.14). The logarithm is the principal one, so `Abar` and `P` are complex when the monodromy matrix has a negative real
//! eigenvalue (of argument `+pi`); a real pair then exists over `2 T` only. Otherwise both are real.

use super::propagate::Propagation;
use super::system::{LtpSystem, NODES, Segment, Size};
use crate::error::{Error, Result};
use crate::numeric::Complex;
use crate::numeric::gauss::Gauss;
use crate::numeric::matrix_function::{exponential, logarithm};

/// Residual `P(T) - I` above which the decomposition carries a warning.
const DOUBTFUL: f64 = 1e-8;

/// `Phi(t, t0) = P(t) e^{Abar (t - t0)}` of a smooth system.
#[derive(Clone, Debug)]
pub struct Floquet {
    /// Period T of P, s.
    pub period: f64,
    /// t0, s, at which P is the identity.
    pub start: f64,
    /// Exponents (nx), 1/s, as [`LtpSystem::exponents`] gives them: accurate where the eigenvalues of `a_bar` are not.
    pub exponents: Vec<Complex>,
    /// Abar (nx, nx), row-major, 1/s.
    pub a_bar: Vec<Complex>,
    /// Largest entry of `P(t0 + T) - I`: zero but for rounding.
    pub residual: f64,
    /// Doubts, with numbers and advice.
    pub warnings: Vec<String>,
    parts: Vec<Stretch>,
    gauss: Gauss,
}

/// P over one part of the period.
#[derive(Clone, Debug)]
struct Stretch {
    start: f64,
    length: f64,
    /// Transition from the start of the part to its nodes (q, nx, nx).
    nodes: Vec<f64>,
    /// P at the start of the part (nx, nx).
    first: Vec<Complex>,
}

impl LtpSystem {
    /// The Floquet decomposition of a smooth system.
    ///
    /// # Errors
    /// `Model` for a system with jumps, over which no smooth P exists; as [`LtpSystem::exponents`] and
    /// [`logarithm`].
    pub fn floquet(&self) -> Result<Floquet> {
        if let Some(jump) = self.jumps().next() {
            let message = format!(
                "the state jumps (`{}`): P(t) would jump too; `exponents` and `multipliers` are exact",
                jump.name
            );
            return Err(Error::Model { path: "floquet".into(), message });
        }
        let nx = self.size().nx;
        let complex = |m: &[f64]| m.iter().map(|&v| Complex::from(v)).collect::<Vec<_>>();
        let mut a_bar = logarithm(&complex(self.monodromy()), nx)?;
        a_bar.iter_mut().for_each(|v| *v /= self.period());
        let exponents = self.exponents()?;
        let half = std::f64::consts::PI / self.period();
        let real = |e: &Complex| (e.im - half).abs() > 1e-9 * half;
        if exponents.iter().all(real) {
            a_bar.iter_mut().for_each(|v| v.im = 0.0);
        }
        let mut parts = Vec::new();
        let mut now: Vec<Complex> = complex(&identity(nx));
        for part in self.transitions()? {
            let step = scaled(&a_bar, -part.length);
            let end = times(&complex(&part.end), &times(&now, &exponential(&step, nx), nx), nx);
            parts.push(Stretch { start: part.start, length: part.length, nodes: part.nodes, first: now });
            now = end;
        }
        let residual = now.iter().zip(identity(nx)).map(|(p, i)| (p - i).norm()).fold(0.0, f64::max);
        let mut warnings = Vec::new();
        if residual.is_nan() || residual > DOUBTFUL {
            warnings.push(format!(
                "P(T) differs from the identity by {residual:.1e}: exponents from {:.3} to {:.3} 1/s are too far apart for one \
                 monodromy matrix of {} s; the exponents are accurate, Abar and P(t) of the fast modes are not",
                exponents[nx - 1].re,
                exponents[0].re,
                self.period()
            ));
        }
        let (period, start) = (self.period(), self.start());
        Ok(Floquet { period, start, exponents, a_bar, residual, warnings, parts, gauss: self.gauss().clone() })
    }

    /// Transitions over the parts of a period, from the start of each to its nodes and to its end.
    ///
    /// # Errors
    /// What [`LtpSystem::new`] says.
    pub(super) fn transitions(&self) -> Result<Vec<Transition>> {
        let nx = self.size().nx;
        let watch =
            |s: &Segment| Segment { b: vec![], c: identity(nx).repeat(NODES), d: vec![], jumps: vec![], ..s.clone() };
        let size = Size { nx, nu: 0, ny: nx };
        let watched = Self::new(self.period(), self.start(), size, self.segments().iter().map(watch).collect())?;
        let parts = Propagation::new(&watched, 0.0).parts.into_iter();
        Ok(parts
            .map(|p| Transition { start: p.start, length: p.length, nodes: p.output_state, end: p.end_state })
            .collect())
    }
}

/// Transition over one part of the period.
pub(super) struct Transition {
    pub start: f64,
    pub length: f64,
    /// (q, nx, nx).
    pub nodes: Vec<f64>,
    /// (nx, nx).
    pub end: Vec<f64>,
}

impl Floquet {
    /// P(t) (nx, nx), row-major, at `t`, s.
    pub fn p(&self, t: f64) -> Vec<Complex> {
        let nx = self.exponents.len();
        let phase = self.start + (t - self.start).rem_euclid(self.period);
        let k = self.parts.partition_point(|p| p.start <= phase).saturating_sub(1);
        let part = &self.parts[k];
        let theta = (phase - part.start) / part.length;
        let mut basis = [0.0; NODES];
        self.gauss.basis(theta, &mut basis);
        let each = nx * nx;
        let at =
            |i: usize| Complex::from(basis.iter().enumerate().map(|(q, w)| w * part.nodes[q * each + i]).sum::<f64>());
        let transition: Vec<Complex> = (0..each).map(at).collect();
        let back = exponential(&scaled(&self.a_bar, part.start - phase), nx);
        times(&transition, &times(&part.first, &back, nx), nx)
    }

    /// Whether Abar and P(t) are real: no multiplier is a negative real number.
    pub fn is_real(&self) -> bool {
        self.a_bar.iter().all(|v| v.im == 0.0)
    }
}

fn identity(n: usize) -> Vec<f64> {
    (0..n * n).map(|i| if i % (n + 1) == 0 { 1.0 } else { 0.0 }).collect()
}

fn scaled(m: &[Complex], by: f64) -> Vec<Complex> {
    m.iter().map(|v| v * by).collect()
}

fn times(left: &[Complex], right: &[Complex], n: usize) -> Vec<Complex> {
    let at = |i: usize| (0..n).map(|k| left[i / n * n + k] * right[k * n + i % n]).sum();
    (0..n * n).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::periodic::Entry;
    use crate::periodic::cart_pendulum_tests::inverted;
    use std::f64::consts::TAU;

    const T: f64 = 0.8;

    /// `P(t)` with `P(0) = I`: a rotation by `turns` whole turns per period on top of a swing, times a shear.
    fn known(t: f64, turns: f64) -> ([f64; 4], [f64; 4]) {
        let w = TAU / T;
        let (angle, rate) = (turns * w * t + 0.4 * (w * t).sin(), turns * w + 0.4 * w * (w * t).cos());
        let (shear, slope) = (0.3 * (1.0 - (2.0 * w * t).cos()), 0.6 * w * (2.0 * w * t).sin());
        let (s, c) = angle.sin_cos();
        let p = [c, shear * c - s, s, shear * s + c];
        let q = [-s * rate, slope * c - shear * s * rate - c * rate, c * rate, slope * s + shear * c * rate - s * rate];
        (p, q)
    }

    /// `A = (P' + P L) P^{-1}`.
    fn made(turns: f64, l: [f64; 4]) -> LtpSystem {
        LtpSystem::smooth(T, Size { nx: 2, nu: 0, ny: 0 }, move |t, entry| {
            if entry != Entry::A {
                return vec![];
            }
            let (p, q) = known(t, turns);
            let det = p[0] * p[3] - p[1] * p[2];
            let inverse = [p[3] / det, -p[1] / det, -p[2] / det, p[0] / det];
            let real = |a: &[f64], b: &[f64]| {
                [
                    a[0] * b[0] + a[1] * b[2],
                    a[0] * b[1] + a[1] * b[3],
                    a[2] * b[0] + a[3] * b[2],
                    a[2] * b[1] + a[3] * b[3],
                ]
            };
            let pl = real(&p, &l);
            let sum = [q[0] + pl[0], q[1] + pl[1], q[2] + pl[2], q[3] + pl[3]];
            real(&sum, &inverse).to_vec()
        })
        .expect("system")
    }

    fn differential(system: &LtpSystem, floquet: &Floquet) -> f64 {
        let n = system.size().nx;
        let mut worst = 0.0_f64;
        for i in 0..23 {
            let (t, h) = (system.period() * (f64::from(i) + 0.4) / 23.0, 2e-4 * system.period());
            let p = |k: f64| floquet.p(t + k * h);
            let (a, b, c, d) = (p(-2.0), p(-1.0), p(1.0), p(2.0));
            let matrix: Vec<Complex> = system.matrix(Entry::A, t).into_iter().map(Complex::from).collect();
            let (left, right) = (times(&matrix, &p(0.0), n), times(&p(0.0), &floquet.a_bar, n));
            for k in 0..n * n {
                let slope = (a[k] - 8.0 * b[k] + 8.0 * c[k] - d[k]) / (12.0 * h);
                worst = worst.max((slope - left[k] + right[k]).norm());
            }
        }
        worst
    }

    #[test]
    fn a_known_decomposition_is_found() {
        let l = [-0.5, 2.0, -2.0, -0.7];
        let system = made(0.0, l);
        let floquet = system.floquet().expect("floquet");
        assert!(floquet.is_real() && floquet.residual < 1e-12 && floquet.warnings.is_empty(), "{}", floquet.residual);
        for (found, expected) in floquet.a_bar.iter().zip(l) {
            assert!((found - expected).norm() < 1e-10, "{found} {expected}");
        }
        for t in [0.0, 0.1, 0.33, 0.8, 1.47, -0.2] {
            for (found, expected) in floquet.p(t).iter().zip(known(t, 0.0).0) {
                assert!((found - expected).norm() < 1e-10, "{t}: {found} {expected}");
            }
        }
        assert!(differential(&system, &floquet) < 1e-7, "{}", differential(&system, &floquet));
    }

    #[test]
    fn half_a_turn_per_period_makes_negative_multipliers_and_a_complex_p() {
        // Rotation by half a turn is -I after one period: with L = diag(-0.5, -0.7) the multipliers are negative.
        let system = made(0.5, [-0.5, 0.0, 0.0, -0.7]);
        let floquet = system.floquet().expect("floquet");
        assert!(!floquet.is_real() && floquet.residual < 1e-12);
        for (found, expected) in floquet.exponents.iter().zip([-0.5, -0.7]) {
            assert!((found - Complex::new(expected, TAU / T / 2.0)).norm() < 1e-10, "{found}");
        }
        assert!(differential(&system, &floquet) < 1e-7);
        for (now, later) in floquet.p(0.3).iter().zip(floquet.p(0.3 + T)) {
            assert!((now - later).norm() < 1e-12);
        }
    }

    #[test]
    fn the_cart_pendulum_has_the_slow_exponent_of_the_study() {
        let system = inverted(0.1);
        let floquet = system.floquet().expect("floquet");
        assert!(floquet.residual < 1e-10 && floquet.is_real(), "{}", floquet.residual);
        assert!(floquet.exponents[0].norm() < 1e-8, "{:?}", floquet.exponents);
        assert!((floquet.exponents[1].re + 0.0065).abs() < 5e-5, "{:?}", floquet.exponents);
    }
}
