//! What a design must keep besides its objective: constraints on the size of the gain and on where modes may be.
//!
//! Each is a number that is at most zero when it is kept, without units, so that they add up: `norm / limit - 1`, and so on.

use super::spectrum::Mode;
use crate::error::{Error, Result};
use crate::numeric::Complex;

/// Bounds on `K_0 Q K_0^T` of the constant part, summed over inputs.
#[derive(Clone, Debug, PartialEq)]
pub struct Quadratic {
    /// Q (nx, nx), row-major, symmetric and positive semidefinite.
    pub weight: Vec<f64>,
    /// Least value.
    pub low: Option<f64>,
    /// Largest value.
    pub high: Option<f64>,
}

/// How much central modes may swing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Damping {
    /// `-Re lambda / |lambda|` is at least this, in (0, 1).
    Ratio(f64),
    /// `|Im lambda|` is at most this, rad/s.
    Imaginary(f64),
}

/// One constraint.
#[derive(Clone, Debug)]
pub(super) enum Constraint {
    /// Root of the sum of squares of all numbers of the gain is at most this.
    Limit(f64),
    /// Smallest real part is above minus this, 1/s.
    Fastest(f64),
    /// Smallest real part is below minus this, 1/s.
    Slowest(f64),
    AtLeast(Vec<f64>, f64),
    AtMost(Vec<f64>, f64),
    Swing(Damping),
}

/// The mode a constraint hangs on and the weights of the real and the imaginary part of its derivative.
pub(super) type Hang = (Mode, f64, f64);

impl Constraint {
    /// Bounds of a quadratic form on the gain.
    pub fn quadratic(bounds: &Quadratic, nx: usize) -> Result<Vec<Self>> {
        super::riccati::check_weight("quadratic: Q", &bounds.weight, nx, false)?;
        let mut found = Vec::new();
        for (bound, low) in [(bounds.low, true), (bounds.high, false)] {
            let Some(bound) = bound else { continue };
            if !(bound > 0.0 && bound.is_finite()) {
                let what = format!("quadratic: {} bound", if low { "lower" } else { "upper" });
                return Err(Error::OutOfRange { what, found: bound, expected: "a positive number, or none".into() });
            }
            let weight = bounds.weight.clone();
            found.push(if low { Constraint::AtLeast(weight, bound) } else { Constraint::AtMost(weight, bound) });
        }
        Ok(found)
    }

    /// Its value, at most zero when it is kept; the gradient by the gain itself is added to `gradient`, and the mode whose
    /// derivative is part of it is given back.
    pub fn at(&self, x: &[f64], rows: (usize, usize), modes: &[Mode], gradient: &mut [f64]) -> (f64, Option<Hang>) {
        let smallest = || modes.iter().min_by(|a, b| a.value.re.total_cmp(&b.value.re)).copied();
        match self {
            Constraint::Limit(limit) => {
                let norm = x.iter().map(|x| x * x).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
                gradient.iter_mut().zip(x).for_each(|(g, x)| *g += x / (norm * limit));
                (norm / limit - 1.0, None)
            }
            Constraint::Fastest(bound) => {
                let Some(mode) = smallest() else { return (0.0, None) };
                (-mode.value.re / bound - 1.0, Some((mode, -1.0 / bound, 0.0)))
            }
            Constraint::Slowest(bound) => {
                let Some(mode) = smallest() else { return (0.0, None) };
                (mode.value.re / bound + 1.0, Some((mode, 1.0 / bound, 0.0)))
            }
            Constraint::AtLeast(weight, bound) => (1.0 - root(weight, *bound, x, rows, -1.0, gradient), None),
            Constraint::AtMost(weight, bound) => (root(weight, *bound, x, rows, 1.0, gradient) - 1.0, None),
            Constraint::Swing(damping) => {
                let value = |m: &&Mode| match damping {
                    Damping::Ratio(ratio) => ratio * m.value.norm() + m.value.re,
                    Damping::Imaginary(bound) => m.value.im.abs() / bound - 1.0,
                };
                let central = modes.iter().filter(|m| m.central);
                let Some(mode) = central.max_by(|a, b| value(a).total_cmp(&value(b))) else { return (0.0, None) };
                let Complex { re, im } = mode.value;
                let size = mode.value.norm().max(f64::MIN_POSITIVE);
                let hang = match damping {
                    Damping::Ratio(ratio) => (*mode, ratio * re / size + 1.0, ratio * im / size),
                    Damping::Imaginary(bound) => (*mode, 0.0, im.signum() / bound),
                };
                (value(&mode), Some(hang))
            }
        }
    }

    /// What it asks for, in words, with the value found.
    pub fn in_words(&self, value: f64) -> (String, f64, String) {
        let of = |what: &str, found: f64, expected: String| (what.to_owned(), found, expected);
        match self {
            Constraint::Limit(limit) => of("norm of the gain", (1.0 + value) * limit, format!("at most {limit}")),
            Constraint::Fastest(b) => of("smallest real part, 1/s", -(1.0 + value) * b, format!("above {}", -b)),
            Constraint::Slowest(b) => of("smallest real part, 1/s", (value - 1.0) * b, format!("below {}", -b)),
            Constraint::AtLeast(_, b) => of("K Q K^T", (1.0 - value).powi(2) * b, format!("at least {b}")),
            Constraint::AtMost(_, b) => of("K Q K^T", (1.0 + value).powi(2) * b, format!("at most {b}")),
            Constraint::Swing(Damping::Ratio(r)) => {
                of("damping: largest ratio |lambda| + Re lambda, 1/s", value, format!("at most 0, for the ratio {r}"))
            }
            Constraint::Swing(Damping::Imaginary(b)) => {
                of("largest imaginary part, rad/s", (1.0 + value) * b, format!("at most {b}"))
            }
        }
    }
}

/// `sqrt(sum_u K_u Q K_u^T / bound)`, its gradient times `sign` added.
fn root(weight: &[f64], bound: f64, x: &[f64], (nu, nx): (usize, usize), sign: f64, gradient: &mut [f64]) -> f64 {
    let turned: Vec<f64> =
        (0..nu * nx).map(|k| (0..nx).map(|c| weight[k % nx * nx + c] * x[k / nx * nx + c]).sum()).collect();
    let form: f64 = turned.iter().zip(x).map(|(a, b)| a * b).sum::<f64>().max(0.0);
    let root = (form / bound).sqrt();
    if root > 0.0 {
        gradient.iter_mut().zip(&turned).for_each(|(g, t)| *g += sign * t / (root * bound));
    }
    root
}
