//! Floquet exponents of smooth systems, fast ones included.
//!
//! A high gain makes modes that decay by more than sixteen digits within one period: the monodromy matrix has lost them in
//! its rounding. They are the slow ones of the system run backwards, whose monodromy is `M^{-1}` and knows nothing of the slow
//! ones; each exponent is taken from the matrix in which its multiplier is larger relative to the largest. One between the
//! two that both have lost follows from the sum of all, the mean trace of `A` (Liouville); several such are not numbers.

use crate::error::Result;
use crate::numeric::Complex;
use crate::periodic::{Entry, LtpSystem, Segment, Size};

/// Share of the largest multiplier below which one is rounding.
const LOST: f64 = 1e-13;

/// Exponents, 1/s, largest real part first, imaginary parts within half the pumping frequency.
pub(super) fn exponents(system: &LtpSystem) -> Result<Vec<Complex>> {
    let (forward, backward) = (system.multipliers(), reversed(system)?);
    let backward = backward.multipliers();
    let (n, period) = (forward.len(), system.period());
    let mut found = Vec::new();
    for i in 0..n {
        let (slow, fast) = (forward[i], backward[n - 1 - i]);
        let kept = |m: Complex, all: &[Complex]| m.norm() / all[0].norm();
        let (by_slow, by_fast) = (kept(slow, forward), kept(fast, backward));
        if by_slow.max(by_fast) >= LOST {
            found.push(if by_slow >= by_fast { slow } else { fast.inv() });
        }
    }
    let mut all = of_multipliers(&found, period);
    if all.len() < n {
        let nx = system.size().nx;
        let mean = &system.fourier(Entry::A, 0)[0];
        let trace: f64 = (0..nx).map(|i| mean[i * nx + i].re).sum();
        let rest = trace - all.iter().map(|e| e.re).sum::<f64>();
        let lost = if all.len() + 1 == n { rest } else { f64::NAN };
        all.resize(n, Complex::from(lost));
        all.sort_by(|a, b| b.re.total_cmp(&a.re).then(b.im.total_cmp(&a.im)));
    }
    Ok(all)
}

/// Exponents of multipliers, 1/s, in the same order.
pub(super) fn of_multipliers(multipliers: &[Complex], period: f64) -> Vec<Complex> {
    let exponent = |m: &Complex| Complex::new(m.norm().max(f64::MIN_POSITIVE).ln(), m.arg()) / period;
    let mut all: Vec<Complex> = multipliers.iter().map(exponent).collect();
    all.sort_by(|a, b| b.re.total_cmp(&a.re).then(b.im.total_cmp(&a.im)));
    all
}

/// Largest real part.
pub(super) fn slowest(values: &[Complex]) -> f64 {
    values.iter().fold(f64::NEG_INFINITY, |m, v| m.max(v.re))
}

/// The system run backwards, without inputs and outputs: `A(t)` becomes `-A(-t)`.
fn reversed(system: &LtpSystem) -> Result<LtpSystem> {
    let (nx, period, start) = (system.size().nx, system.period(), system.start());
    let end = start + period;
    let turned = |s: &Segment| Segment {
        start: start + (end - s.end),
        end: start + (end - s.start),
        // Gauss nodes lie evenly about the middle.
        a: s.a.chunks_exact(nx * nx).rev().flatten().map(|v| -v).collect(),
        b: Vec::new(),
        c: Vec::new(),
        d: Vec::new(),
        jumps: Vec::new(),
    };
    let segments = system.segments().iter().rev().map(turned).collect();
    LtpSystem::new(period, start, Size { nx, nu: 0, ny: 0 }, segments)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::periodic::system::NODES;

    #[test]
    fn modes_that_decay_by_a_hundred_digits_are_kept() {
        let rates = [-0.01, -3.0, -40.0, -230.0];
        // Coupled by a constant change of coordinates, so that no row stands alone: x' = S diag S^-1 x with S unit lower.
        let mut a = [0.0; 16];
        for i in 0..4 {
            a[i * 4 + i] = rates[i];
            if i > 0 {
                a[i * 4 + i - 1] = rates[i - 1] - rates[i];
            }
        }
        let segment = |k: usize| Segment {
            start: 0.25 * k as f64,
            end: 0.25 * (k + 1) as f64,
            a: a.repeat(NODES),
            b: vec![],
            c: vec![],
            d: vec![],
            jumps: vec![],
        };
        let size = Size { nx: 4, nu: 0, ny: 0 };
        let system = LtpSystem::new(1.0, 0.0, size, (0..4).map(segment).collect()).expect("a system");
        let found = exponents(&system).expect("exponents");
        for (f, e) in found.iter().zip(rates) {
            assert!((f - e).norm() < 1e-9 * e.abs().max(1.0), "{found:?}");
        }
    }
}
