//! Harmonic transfer functions with one common Floquet denominator and numerators of finite memory.
//!
//! A periodic system with `p` multipliers that are not zero obeys, by Cayley and Hamilton's theorem on its monodromy matrix,
//! `y(t) - a_1 y(t - T) - ... - a_p y(t - p T) = int_0^{p T} g(t, tau) u(t - tau) d tau`, `g` periodic in `t`: its memory beyond
//! `p` periods sits in `p` real numbers. On lines, with `z = e^{-j w T}`, the same at input and output frequency,
//!
//! `D(w) Y(w) = sum_k N_k(w - k wp) U(w - k wp)`, `D = 1 - a_1 z - ... - a_p z^p`, `H_k = N_k / D`,
//!
//! and every `N_k(nu) e^{j nu p T / 2}` is smooth on the scale `1 / (p T)`, however sharp the resonances of `H_k` are. The
//! multipliers are the roots of `z^p - a_1 z^{p-1} - ... - a_p`. A state away from the steady one at the beginning of a record
//! answers to the same denominator with a kernel of its own, no longer than `p` periods: one more numerator on the output axis,
//! whose input is 1, so transients are fitted instead of leaking.
//!
//! The relation is exact for every linear periodic system of finite order, hybrid ones included (states that an impact
//! destroys have multiplier zero and do not count; if a reset is needed to destroy them they may add part of a period to the
//! memory, which the prior allows). It is not right for pure delays longer than the memory and for continua, where the order
//! with the greatest evidence stands for the slowest part; the coherence tells.

mod answer;
mod fit;
mod layout;
mod noise;
mod posterior;
mod rows;

use nalgebra::DMatrix;

use super::Spectra;
use crate::error::{Error, Result};
use crate::numeric::Complex;
use crate::periodic::Htf;
use fit::Fit;

/// Largest order that can be asked for.
const MOST: usize = 12;
/// Harmonics whose rows choose the order.
const SCOUT: usize = 4;
/// The order is still sought while evidence has fallen fewer times than this in a row.
const PATIENCE: usize = 2;

/// Options of the method. What depends on noise is found from the data.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Number of multipliers that are not zero; `None`: the one with the greatest evidence up to `highest_order`.
    pub order: Option<usize>,
    /// Largest order that is tried.
    pub highest_order: usize,
    /// Knot intervals of the numerators per pumping frequency and period of memory.
    pub knots: usize,
    /// Whether records may begin away from the steady state.
    pub transients: bool,
    /// Input frequency up to which numerators are fitted, rad/s, at least the band; `None`: as far as the inputs have power
    /// that matters (the tail of a chirp that jumps), which is more than can be reported.
    pub reach: Option<f64>,
    /// Most iterations.
    pub iterations: usize,
}

impl Default for Options {
    fn default() -> Self {
        Options { order: None, highest_order: 4, knots: 6, transients: true, reach: None, iterations: 15 }
    }
}

/// Harmonic transfer functions with standard deviations and coherence.
///
/// Figures: `order`, `a1`... (coefficients of the denominator), `multiplier1_re`, `multiplier1_im`..., `noise_sd` (per
/// output, in its unit, of a sample), `unknowns`, `determined` (by the data rather than the prior), `equations`,
/// `frequencies`, `reach` (rad/s), `iterations`.
///
/// # Errors
/// `OutOfRange` for options that cannot be, `TooShort` when there are fewer lines than unknown harmonics need, `NoConvergence`.
pub fn identify(spectra: &Spectra, options: &super::Options, own: &Options) -> Result<Htf> {
    check(own)?;
    let band = spectra.band();
    enough(spectra, options.harmonics, own)?;
    let reach = own.reach.unwrap_or_else(|| rows::reach(spectra, band)).max(band);
    let (order, mut warnings) = match own.order {
        Some(order) => (order, Vec::new()),
        None => choose(spectra, options.harmonics, own)?,
    };
    let highest = band + options.harmonics as f64 * spectra.pumping();
    let fit = fit::fit_and_refine(spectra, order, reach, highest, own)?;
    let mut htf = answer::answer(spectra, &fit, options.harmonics, band)?;
    htf.method = format!("common Floquet denominator of order {order} with numerators of finite memory");
    htf.figures = figures(spectra, &fit, &htf, reach);
    warnings.extend(doubts(&htf));
    htf.warnings = spectra.warnings().iter().cloned().chain(warnings).collect();
    Ok(htf)
}

fn check(own: &Options) -> Result<()> {
    let numbers = [
        ("order", own.order.unwrap_or(0), 0, MOST),
        ("highest_order", own.highest_order, 0, MOST),
        ("knots", own.knots, 3, 64),
    ];
    for (what, found, least, most) in numbers {
        if !(least..=most).contains(&found) {
            let expected = format!("a number from {least} to {most}");
            return Err(Error::OutOfRange { what: format!("floquet option {what}"), found: found as f64, expected });
        }
    }
    if let Some(reach) = own.reach
        && !(reach > 0.0 && reach.is_finite())
    {
        let expected = "a positive, finite angular frequency in rad/s".into();
        return Err(Error::OutOfRange { what: "floquet option reach".into(), found: reach, expected });
    }
    Ok(())
}

/// Refuses when the lines are fewer than the numbers that describe the harmonics.
fn enough(spectra: &Spectra, harmonics: usize, own: &Options) -> Result<()> {
    let highest = spectra.band() + harmonics as f64 * spectra.pumping();
    let lines: f64 = spectra.records().iter().map(|r| highest / r.spacing()).sum();
    // A kernel of memory p T has 2 F p T complex numbers in the band -F..F; half of them are images.
    let memory = own.order.unwrap_or(1).max(1) as f64 * spectra.period();
    let band = spectra.band() / std::f64::consts::TAU;
    let unknowns = (2 * harmonics + 1) as f64 * band * memory * spectra.inputs() as f64;
    if lines < unknowns {
        let samples: usize = spectra.records().iter().map(|r| r.samples()).sum();
        let what = format!(
            "{} harmonics of {} inputs up to {band:.3} Hz have at least {unknowns:.0} unknowns, the records have {lines:.0} \
             lines up to {:.3} Hz",
            2 * harmonics + 1,
            spectra.inputs(),
            highest / std::f64::consts::TAU
        );
        return Err(Error::TooShort {
            what,
            needed: (samples as f64 * unknowns / lines).ceil() as usize,
            found: samples,
        });
    }
    Ok(())
}

/// The order with the greatest evidence in the rows of the first few harmonics.
fn choose(spectra: &Spectra, harmonics: usize, own: &Options) -> Result<(usize, Vec<String>)> {
    let reach = spectra.band() + spectra.window();
    let highest = spectra.band() + harmonics.min(SCOUT) as f64 * spectra.pumping();
    let (mut best, mut fallen) = ((0, f64::NEG_INFINITY), 0);
    for order in 0..=own.highest_order {
        let evidence = fit::fit(spectra, order, reach, highest, own)?.evidence();
        if evidence > best.1 {
            (best, fallen) = ((order, evidence), 0);
        } else {
            fallen += 1;
        }
        if fallen >= PATIENCE {
            break;
        }
    }
    let mut warnings = Vec::new();
    if best.0 == own.highest_order && best.0 > 0 {
        warnings.push(format!(
            "{} multipliers, the most that were tried, have the greatest evidence; there may be more: raise highest_order",
            best.0
        ));
    }
    Ok((best.0, warnings))
}

/// Roots of `z^p - a_1 z^{p-1} - ... - a_p`, the largest first.
fn multipliers(a: &[f64]) -> Vec<Complex> {
    if a.is_empty() {
        return Vec::new();
    }
    let companion =
        DMatrix::from_fn(a.len(), a.len(), |r, c| if r == 0 { a[c] } else { f64::from(u8::from(r == c + 1)) });
    let mut roots: Vec<Complex> = companion.complex_eigenvalues().iter().map(|l| Complex::new(l.re, l.im)).collect();
    roots.sort_by(|x, y| y.norm().total_cmp(&x.norm()).then(y.im.total_cmp(&x.im)));
    roots
}

fn figures(spectra: &Spectra, fit: &Fit, htf: &Htf, reach: f64) -> Vec<(String, f64)> {
    let mut figures = vec![("order".to_owned(), fit.a.len() as f64)];
    for (i, &a) in fit.a.iter().enumerate() {
        figures.push((format!("a{}", i + 1), a));
    }
    for (i, root) in multipliers(&fit.a).iter().enumerate() {
        figures.push((format!("multiplier{}_re", i + 1), root.re));
        figures.push((format!("multiplier{}_im", i + 1), root.im));
    }
    for (y, output) in fit.outputs.iter().enumerate() {
        let name = if y == 0 { "noise_sd".to_owned() } else { format!("noise_sd_{}", spectra.output_names()[y]) };
        let levels = output.setting.levels.iter().flatten();
        let count = levels.clone().count().max(1) as f64;
        figures.push((name, (levels.sum::<f64>() / count).sqrt()));
    }
    let equations: usize = fit.cells.iter().map(|cell| cell.rows.len()).sum();
    let determined: f64 = fit.outputs.iter().map(|output| output.determined).sum();
    figures.extend([
        ("unknowns".to_owned(), (fit.layout.unknowns() * fit.outputs.len() + fit.a.len()) as f64),
        ("determined".to_owned(), determined),
        ("equations".to_owned(), (2 * equations * fit.outputs.len()) as f64),
        ("frequencies".to_owned(), htf.omega().len() as f64),
        ("reach".to_owned(), reach),
        ("iterations".to_owned(), fit.iterations as f64),
    ]);
    figures
}

/// Harmonics that are smaller than their own uncertainty.
fn doubts(htf: &Htf) -> Vec<String> {
    let Some(sd) = htf.sd() else { return Vec::new() };
    let per_harmonic = sd.len() / (2 * htf.harmonics() + 1);
    let size = |k: i64| {
        let start = htf.index(k, 0, 0, 0);
        let range = start..start + per_harmonic;
        let power: f64 = htf.values()[range.clone()].iter().map(Complex::norm_sqr).sum();
        (power, sd[range].iter().map(|s| s * s).sum::<f64>())
    };
    let lost = |k: i64| {
        let ((power, variance), (mirrored, other)) = (size(k), size(-k));
        power + mirrored <= variance + other
    };
    let highest = htf.harmonics() as i64;
    let Some(first) = (0..=highest).rev().take_while(|&k| lost(k)).last() else { return Vec::new() };
    vec![format!(
        "harmonics {first} to {highest} are no larger than their standard deviations: the data do not show them; ask for \
         {} harmonics, or record longer or with more power",
        first - 1
    )]
}

#[cfg(test)]
#[path = "floquet_tests.rs"]
mod tests;
