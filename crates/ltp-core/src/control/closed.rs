//! The closed loop as a system of its own, and its exact exponents: what a design is judged by, whatever it was made by.

use std::f64::consts::TAU;

use super::law::{Law, check_gain};
use super::lifted::{Lifted, smooth};
use super::spectrum::Spectrum;
use crate::error::Result;
use crate::numeric::Complex;
use crate::numeric::fourier_series::FourierSeries;
use crate::numeric::gauss::Gauss;
use crate::periodic::system::NODES;
use crate::periodic::{Entry, LtpSystem, Segment, Size};

/// Angle, rad, that the highest harmonic of a gain may turn by within a segment.
const TURN: f64 = 1.5;

/// Exact Floquet exponents of `A - B K`, principal strip `|Im| <= pi/T`, largest real part first.
///
/// # Errors
/// `Shape` and `OutOfRange` for a gain that does not fit, `Model` for a system with jumps.
pub fn exponents(system: &LtpSystem, gain: &FourierSeries) -> Result<Vec<Complex>> {
    let closed = closed(system, gain)?;
    let mut found: Vec<Complex> = closed.multipliers().iter().map(|m| m.ln() / system.period()).collect();
    found.sort_by(|a, b| b.re.total_cmp(&a.re).then(b.im.total_cmp(&a.im)));
    Ok(found)
}

/// All eigenvalues of the lifted closed loop `A - N - B K_T` with harmonics -truncation..=truncation, largest real part first.
///
/// # Errors
/// As [`exponents`], and `OutOfRange` for a truncation too low.
pub fn lifted_eigenvalues(system: &LtpSystem, gain: &FourierSeries, truncation: usize) -> Result<Vec<Complex>> {
    let Size { nx, nu, .. } = system.size();
    check_gain(gain, nu, nx, system.period())?;
    let trimmed = gain.trimmed(1e-9);
    let harmonics: Vec<usize> = (0..=trimmed.harmonics()).filter(|&h| h == 0 || present(&trimmed, h)).collect();
    let law = Law::new(nu, nx, system.period(), &harmonics)?;
    let mut spectrum = Spectrum::default();
    Lifted::new(system, &law, truncation)?.modes(&law.unknowns_of(gain)?, &mut spectrum)?;
    let mut found: Vec<Complex> = spectrum.modes.iter().map(|m| m.value).collect();
    found.sort_by(|a, b| b.re.total_cmp(&a.re).then(b.im.total_cmp(&a.im)));
    Ok(found)
}

/// True when a harmonic of a gain is more than rounding.
fn present(gain: &FourierSeries, h: usize) -> bool {
    let size = |h: usize| gain.coefficient(h).map_or(0.0, |c| c.iter().fold(0.0_f64, |m, c| m.max(c.norm())));
    let largest = (0..=gain.harmonics()).map(size).fold(0.0, f64::max);
    size(h) > 1e-9 * largest
}

/// `A - B K` with neither inputs nor outputs.
fn closed(system: &LtpSystem, gain: &FourierSeries) -> Result<LtpSystem> {
    smooth(system)?;
    let Size { nx, nu, .. } = system.size();
    check_gain(gain, nu, nx, system.period())?;
    let gauss = Gauss::new(NODES);
    let fastest = gain.trimmed(1e-14).harmonics() as f64 * TAU / system.period();
    let mut segments = Vec::new();
    for whole in system.segments() {
        let parts = (fastest * (whole.end - whole.start) / TURN).ceil().max(1.0) as usize;
        let at = |i: usize| whole.start + (whole.end - whole.start) * i as f64 / parts as f64;
        for i in 0..parts {
            let (start, end) = (at(i), at(i + 1));
            let mut a = Vec::with_capacity(NODES * nx * nx);
            for node in &gauss.nodes {
                let t = start + node * (end - start);
                a.extend(closed_matrix(system, gain, t));
            }
            segments.push(Segment { start, end, a, b: vec![], c: vec![], d: vec![], jumps: vec![] });
        }
    }
    LtpSystem::new(system.period(), system.start(), Size { nx, nu: 0, ny: 0 }, segments)
}

/// `A - B K` (nx, nx) at `t`, s.
fn closed_matrix(system: &LtpSystem, gain: &FourierSeries, t: f64) -> Vec<f64> {
    let Size { nx, nu, .. } = system.size();
    let (mut a, b, k) = (system.matrix(Entry::A, t), system.matrix(Entry::B, t), gain.value(t));
    for r in 0..nx {
        for u in 0..nu {
            for c in 0..nx {
                a[r * nx + c] -= b[r * nu + u] * k[u * nx + c];
            }
        }
    }
    a
}
