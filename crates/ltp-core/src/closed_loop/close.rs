//! The closed loop as an ordinary model: `u = u_ref(t) - K(t) (z - z_ref(t))` in the place of its inputs.
//!
//! What depends on time alone, `u_ref + K z_ref`, is multiplied out to one Fourier series per input, so that the loop costs
//! few sines and cosines.

use crate::error::{Error, Result};
use crate::feedforward::Reference;
use crate::model::Model;
use crate::numeric::{Complex, fourier_series::FourierSeries};
use std::fmt::Write;

/// Harmonics below this share of the largest of their row are rounding.
const ROUNDING: f64 = 1e-14;

/// The model whose inputs follow the reference under the gain (nu, nx), row-major: `u = u_ref - K (z - z_ref)`.
///
/// An input on which neither the gain nor the reference acts stays an input. The others become outputs named `input NAME`.
///
/// # Errors
/// `Shape` for a gain or reference that does not fit the model, `OutOfRange` for two periods.
pub fn close(model: &Model, reference: &Reference, gain: &FourierSeries) -> Result<Model> {
    check(model, reference, gain)?;
    let (nx, states) = (model.states().len(), model.states());
    let free = ahead(reference, gain)?.trimmed(ROUNDING);
    let gain = gain.trimmed(ROUNDING);
    let expressions: Vec<(String, String)> = acted(model, reference, &gain)
        .into_iter()
        .map(|(input, name)| {
            let mut text = series(&free, input);
            for (c, state) in states.iter().enumerate() {
                let factor = series(&gain, input * nx + c);
                if factor != "0.0" {
                    let _ = write!(text, " - ({factor})*{state}");
                }
            }
            (name, text)
        })
        .collect();
    let expressions: Vec<(&str, &str)> = expressions.iter().map(|(n, e)| (n.as_str(), e.as_str())).collect();
    model.with_input_expressions(&expressions)
}

/// Refuses a reference or gain that does not fit the model.
pub(super) fn check(model: &Model, reference: &Reference, gain: &FourierSeries) -> Result<()> {
    let (nx, nu) = (model.states().len(), model.inputs().len());
    for (what, expected, found) in [
        ("states of the reference", nx, reference.states.rows()),
        ("inputs of the reference", nu, reference.inputs.rows()),
        ("entries of the gain (inputs by states)", nu * nx, gain.rows()),
    ] {
        if expected != found {
            return Err(Error::Shape { what: what.into(), expected, found });
        }
    }
    let period = reference.period();
    if gain.harmonics() > 0 && (gain.period() - period).abs() > 1e-9 * period {
        let expected = format!("{period} s, that of the reference");
        return Err(Error::OutOfRange { what: "period of the gain".into(), found: gain.period(), expected });
    }
    Ok(())
}

/// Number and name of each input that the feedback or the reference moves.
pub(super) fn acted(model: &Model, reference: &Reference, gain: &FourierSeries) -> Vec<(usize, String)> {
    let nx = model.states().len();
    let zero = |series: &FourierSeries, row: usize| {
        series.coefficients().iter().skip(row).step_by(series.rows()).all(|c| c.norm() == 0.0)
    };
    let moved = |input: &usize| !zero(&reference.inputs, *input) || (0..nx).any(|c| !zero(gain, input * nx + c));
    let names = model.inputs();
    (0..names.len()).filter(moved).map(|input| (input, names[input].to_owned())).collect()
}

/// `u_ref + K z_ref` (nu).
fn ahead(reference: &Reference, gain: &FourierSeries) -> Result<FourierSeries> {
    let (nx, nu) = (reference.states.rows(), reference.inputs.rows());
    let states = reference.states.trimmed(ROUNDING);
    let most = (gain.harmonics() + states.harmonics()).max(reference.inputs.harmonics());
    let last = states.harmonics() as isize;
    let mut out = Vec::with_capacity((most + 1) * nu);
    for k in 0..=most as isize {
        for input in 0..nu {
            let mut sum = line(&reference.inputs, input, k);
            for m in -last..=last {
                sum += (0..nx).map(|c| line(gain, input * nx + c, k - m) * line(&states, c, m)).sum::<Complex>();
            }
            out.push(sum);
        }
    }
    FourierSeries::new(reference.period(), nu, out)
}

/// One Fourier coefficient, of any harmonic.
pub(super) fn line(series: &FourierSeries, row: usize, k: isize) -> Complex {
    let c = series.coefficient(k.unsigned_abs()).map_or(Complex::new(0.0, 0.0), |c| c[row]);
    if k < 0 { c.conj() } else { c }
}

/// One row as an expression of `t`; harmonics of rounding are left out.
pub(super) fn series(series: &FourierSeries, row: usize) -> String {
    let rows = series.rows();
    let largest = series.coefficients().iter().skip(row).step_by(rows).map(|c| c.norm()).fold(0.0, f64::max);
    let mut text = format!("{:?}", line(series, row, 0).re + 0.0);
    for k in 1..=series.harmonics() {
        let c = 2.0 * line(series, row, k as isize);
        let omega = k as f64 * series.pumping();
        for (factor, function) in [(c.re, "cos"), (-c.im, "sin")] {
            if factor.abs() > ROUNDING * largest {
                let _ = write!(text, " + ({factor:?})*{function}({omega:?}*t)");
            }
        }
    }
    text
}
