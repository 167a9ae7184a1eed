//! The form of a gain, and its numbers as unknowns: `K(t) = K_0 + sum_h Re(K_h e^{j h w t})` over chosen harmonics.
//!
//! Unknowns stand in terms of `nu nx` numbers each, row-major (nu, nx): for harmonic 0 one term, for every other harmonic the
//! real part and then the imaginary part of `K_h`.

use crate::error::{Error, Result};
use crate::numeric::Complex;
use crate::numeric::fourier_series::FourierSeries;

/// Which harmonics a gain has.
#[derive(Clone, Debug, PartialEq)]
pub struct Law {
    /// Inputs.
    pub nu: usize,
    /// States.
    pub nx: usize,
    /// Period of the gain, s.
    pub period: f64,
    /// Harmonics, increasing.
    pub harmonics: Vec<usize>,
}

/// A term: its harmonic, and what it is multiplied by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wave {
    /// 1.
    One,
    /// `cos h w t`.
    Cos(usize),
    /// `-sin h w t`.
    MinusSin(usize),
}

impl Wave {
    /// Its value at the angle `w t`, rad.
    pub fn at(self, angle: f64) -> f64 {
        match self {
            Wave::One => 1.0,
            Wave::Cos(h) => (h as f64 * angle).cos(),
            Wave::MinusSin(h) => -(h as f64 * angle).sin(),
        }
    }

    /// Its Fourier coefficient of harmonic `k`.
    pub fn coefficient(self, k: usize) -> Complex {
        match self {
            Wave::One if k == 0 => Complex::new(1.0, 0.0),
            Wave::Cos(h) if k == h => Complex::new(0.5, 0.0),
            Wave::MinusSin(h) if k == h => Complex::new(0.0, 0.5),
            _ => Complex::new(0.0, 0.0),
        }
    }
}

impl Law {
    /// A gain (nu, nx) of `period` (s) with these harmonics.
    ///
    /// # Errors
    /// `OutOfRange` for harmonics that are none or repeated, and for a system without inputs or states.
    pub fn new(nu: usize, nx: usize, period: f64, harmonics: &[usize]) -> Result<Self> {
        for (what, count) in [("inputs", nu), ("states", nx)] {
            if count == 0 {
                let (what, expected) =
                    (format!("{what} of the system"), "at least one: feedback goes from one to the other");
                return Err(Error::OutOfRange { what, found: 0.0, expected: expected.into() });
            }
        }
        let mut harmonics = harmonics.to_vec();
        harmonics.sort_unstable();
        if harmonics.is_empty() || harmonics.windows(2).any(|w| w[0] == w[1]) {
            let expected = "each harmonic once, 0 for the constant part, such as [0] or [0, 2]".into();
            return Err(Error::OutOfRange {
                what: "harmonics of the gain: count".into(),
                found: harmonics.len() as f64,
                expected,
            });
        }
        Ok(Self { nu, nx, period, harmonics })
    }

    /// Terms in the order of the unknowns.
    pub fn terms(&self) -> Vec<Wave> {
        let of_one = |&h: &usize| if h == 0 { vec![Wave::One] } else { vec![Wave::Cos(h), Wave::MinusSin(h)] };
        self.harmonics.iter().flat_map(of_one).collect()
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.terms().len() * self.nu * self.nx
    }

    /// The gain, rows (nu, nx) row-major, of the unknowns `x`.
    ///
    /// # Errors
    /// `NotFinite`.
    pub fn series(&self, x: &[f64]) -> Result<FourierSeries> {
        let rows = self.nu * self.nx;
        let last = self.harmonics.last().copied().unwrap_or(0);
        let mut coefficients = vec![Complex::new(0.0, 0.0); (last + 1) * rows];
        for (wave, values) in self.terms().into_iter().zip(x.chunks_exact(rows)) {
            let (h, unit) = match wave {
                Wave::One => (0, Complex::new(1.0, 0.0)),
                Wave::Cos(h) => (h, Complex::new(0.5, 0.0)),
                Wave::MinusSin(h) => (h, Complex::new(0.0, 0.5)),
            };
            for (c, v) in coefficients[h * rows..(h + 1) * rows].iter_mut().zip(values) {
                *c += unit * v;
            }
        }
        FourierSeries::new(self.period, rows, coefficients)
    }

    /// The unknowns of a gain; harmonics that this law has not are dropped.
    ///
    /// # Errors
    /// `Shape` for a gain of other rows, `OutOfRange` for one of another period.
    pub fn unknowns_of(&self, gain: &FourierSeries) -> Result<Vec<f64>> {
        check_gain(gain, self.nu, self.nx, self.period)?;
        let zero = vec![Complex::new(0.0, 0.0); self.nu * self.nx];
        let of_one = |&h: &usize| {
            let c = gain.coefficient(h).unwrap_or(&zero);
            let parts = [c.iter().map(|c| c.re).collect::<Vec<_>>(), c.iter().map(|c| c.im).collect()];
            if h == 0 { parts[0].clone() } else { parts.concat().iter().map(|v| 2.0 * v).collect() }
        };
        Ok(self.harmonics.iter().flat_map(of_one).collect())
    }
}

/// Checks that `gain` fits `nu` inputs, `nx` states and `period` (s).
///
/// # Errors
/// `Shape`, `OutOfRange`.
pub fn check_gain(gain: &FourierSeries, nu: usize, nx: usize, period: f64) -> Result<()> {
    if gain.rows() != nu * nx {
        let what = format!("gain, (nu, nx) = ({nu}, {nx}) row-major");
        return Err(Error::Shape { what, expected: nu * nx, found: gain.rows() });
    }
    if (gain.period() - period).abs() > 1e-9 * period {
        let expected = format!("{period} s, the period of the system");
        return Err(Error::OutOfRange { what: "period of the gain, s".into(), found: gain.period(), expected });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknowns_and_series_are_each_other() {
        let law = Law::new(1, 2, 0.5, &[2, 0]).expect("a law");
        assert_eq!(law.unknowns(), 6);
        let x = [1.0, -2.0, 0.3, 0.5, 0.7, -0.1];
        let series = law.series(&x).expect("a gain");
        assert_eq!(law.unknowns_of(&series).expect("unknowns"), x);
        let t = 0.13;
        let sum: Vec<f64> = (0..2)
            .map(|s| law.terms().iter().enumerate().map(|(k, w)| w.at(series.pumping() * t) * x[2 * k + s]).sum())
            .collect();
        for (a, b) in series.value(t).iter().zip(&sum) {
            assert!((a - b).abs() < 1e-14);
        }
        assert!(Law::new(1, 2, 0.5, &[]).is_err() && Law::new(1, 2, 0.5, &[0, 0]).is_err());
        assert!(law.unknowns_of(&FourierSeries::constant(0.5, &[1.0; 3]).expect("a series")).is_err());
        assert!(law.unknowns_of(&FourierSeries::constant(0.6, &[1.0; 2]).expect("a series")).is_err());
    }
}
