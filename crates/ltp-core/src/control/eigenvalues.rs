//! Eigenvalues of the lifted closed loop in the form of the thesis, `A - N - B K_T` with all blocks truncated.

use super::law::{Law, check_gain};
use super::lifted::Lifted;
use super::spectrum::Spectrum;
use crate::error::Result;
use crate::numeric::Complex;
use crate::numeric::fourier_series::FourierSeries;
use crate::periodic::{LtpSystem, Size};

/// All eigenvalues of the lifted closed loop `A - N - B K_T` with harmonics -truncation..=truncation, largest real part first.
///
/// # Errors
/// `Shape` and `OutOfRange` for a gain that does not fit or a truncation too low, `Model` for a system with jumps.
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
