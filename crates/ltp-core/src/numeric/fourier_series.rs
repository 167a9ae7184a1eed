//! A periodic signal of several rows by its Fourier coefficients: orbits, feedforward and periodic gains are such.
//!
//! `x(t) = c_0 + 2 Re sum_{k=1}^{K} c_k e^{j k w t}` with `w = 2 pi / T`; `c_0` is real. Coefficients of negative harmonics
//! are the conjugates, and are not stored.

use super::{Complex, fft};
use crate::error::{Error, Result};
use std::f64::consts::TAU;

/// A real periodic signal.
#[derive(Clone, Debug, PartialEq)]
pub struct FourierSeries {
    period: f64,
    rows: usize,
    /// (K + 1, rows).
    coefficients: Vec<Complex>,
}

impl FourierSeries {
    /// A signal of `period` (s) from its coefficients `c_0..=c_K`, each of `rows` numbers: (K + 1, rows).
    ///
    /// # Errors
    /// `OutOfRange` for a period that is not positive, `Shape` for a length that is no multiple of `rows`, `NotFinite`.
    pub fn new(period: f64, rows: usize, mut coefficients: Vec<Complex>) -> Result<Self> {
        if !(period > 0.0 && period.is_finite()) {
            let expected = "a positive time in s".into();
            return Err(Error::OutOfRange { what: "period".into(), found: period, expected });
        }
        if rows == 0 || coefficients.is_empty() || !coefficients.len().is_multiple_of(rows) {
            let what = format!("Fourier coefficients of {rows} rows");
            return Err(Error::Shape { what, expected: rows.max(1), found: coefficients.len() });
        }
        if let Some(at) = coefficients.iter().position(|c| !c.is_finite()) {
            let (what, column) = ("Fourier coefficients".into(), format!("harmonic {}", at / rows));
            return Err(Error::NotFinite { what, row: at % rows, column, value: coefficients[at].norm() });
        }
        coefficients[..rows].iter_mut().for_each(|c| c.im = 0.0);
        Ok(Self { period, rows, coefficients })
    }

    /// A constant.
    ///
    /// # Errors
    /// As [`FourierSeries::new`].
    pub fn constant(period: f64, values: &[f64]) -> Result<Self> {
        Self::new(period, values.len(), values.iter().map(|&v| Complex::from(v)).collect())
    }

    /// The trigonometric interpolant of `n` even samples over one period, (n, rows) row-major; an even `n` loses the sine of
    /// its highest harmonic, which samples cannot show.
    ///
    /// # Errors
    /// As [`FourierSeries::new`].
    pub fn from_samples(period: f64, rows: usize, samples: &[f64]) -> Result<Self> {
        if rows == 0 || samples.is_empty() || !samples.len().is_multiple_of(rows) {
            let what = format!("samples of {rows} rows");
            return Err(Error::Shape { what, expected: rows.max(1), found: samples.len() });
        }
        let n = samples.len() / rows;
        let mut coefficients = vec![Complex::new(0.0, 0.0); (n / 2 + 1) * rows];
        for row in 0..rows {
            let column: Vec<f64> = samples.iter().skip(row).step_by(rows).copied().collect();
            for (k, line) in fft::forward(&column).into_iter().enumerate() {
                let shared = if k > 0 && 2 * k == n { 2.0 } else { 1.0 };
                coefficients[k * rows + row] = line / (n as f64 * shared);
            }
        }
        Self::new(period, rows, coefficients)
    }

    /// Period, s.
    pub fn period(&self) -> f64 {
        self.period
    }
    /// Fundamental frequency, rad/s.
    pub fn pumping(&self) -> f64 {
        TAU / self.period
    }
    /// Numbers at each instant.
    pub fn rows(&self) -> usize {
        self.rows
    }
    /// Highest harmonic K that is stored.
    pub fn harmonics(&self) -> usize {
        self.coefficients.len() / self.rows - 1
    }
    /// All coefficients (K + 1, rows).
    pub fn coefficients(&self) -> &[Complex] {
        &self.coefficients
    }
    /// Coefficients (rows) of harmonic `k >= 0`; `None` beyond the highest, where they are zero.
    pub fn coefficient(&self, k: usize) -> Option<&[Complex]> {
        self.coefficients.chunks_exact(self.rows).nth(k)
    }

    /// Values (rows) at `t`, s.
    pub fn at(&self, t: f64, out: &mut [f64]) {
        let angle = TAU * (t / self.period).rem_euclid(1.0);
        for (out, c) in out.iter_mut().zip(&self.coefficients) {
            *out = c.re;
        }
        for (k, coefficients) in self.coefficients.chunks_exact(self.rows).enumerate().skip(1) {
            let (sin, cos) = (k as f64 * angle).sin_cos();
            for (out, c) in out.iter_mut().zip(coefficients) {
                *out += 2.0 * (c.re * cos - c.im * sin);
            }
        }
    }

    /// Values (rows) at `t`, s.
    pub fn value(&self, t: f64) -> Vec<f64> {
        let mut out = vec![0.0; self.rows];
        self.at(t, &mut out);
        out
    }

    /// Values at `n` even times over one period, (n, rows) row-major.
    pub fn samples(&self, n: usize) -> Vec<f64> {
        (0..n).flat_map(|i| self.value(i as f64 * self.period / n as f64)).collect()
    }

    /// The derivative by time.
    pub fn derivative(&self) -> Self {
        let turn = |i: usize, c: &Complex| Complex::new(0.0, (i / self.rows) as f64 * self.pumping()) * c;
        let coefficients = self.coefficients.iter().enumerate().map(|(i, c)| turn(i, c)).collect();
        Self { coefficients, ..*self }
    }

    /// The signal `x(t + time)`, ahead by `time` (s).
    pub fn ahead(&self, time: f64) -> Self {
        let turn = |i: usize| Complex::from_polar(1.0, (i / self.rows) as f64 * self.pumping() * time);
        let coefficients = self.coefficients.iter().enumerate().map(|(i, c)| turn(i) * c).collect();
        Self { coefficients, ..*self }
    }

    /// Only these rows, in this order.
    pub fn select(&self, rows: &[usize]) -> Self {
        let chosen = self.coefficients.chunks_exact(self.rows).flat_map(|c| rows.iter().map(|&r| c[r]));
        Self { period: self.period, rows: rows.len(), coefficients: chosen.collect() }
    }

    /// Without the harmonics above the last one that matters: larger than `share` of the largest coefficient of its row.
    pub fn trimmed(&self, share: f64) -> Self {
        let largest = |row: usize| self.coefficients.iter().skip(row).step_by(self.rows).map(|c| c.norm());
        let bounds: Vec<f64> = (0..self.rows).map(|row| share * largest(row).fold(0.0, f64::max)).collect();
        let matters = |c: &[Complex]| c.iter().zip(&bounds).any(|(c, bound)| c.norm() > *bound);
        let last = self.coefficients.chunks_exact(self.rows).rposition(matters).unwrap_or(0);
        Self { coefficients: self.coefficients[..(last + 1) * self.rows].to_vec(), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> FourierSeries {
        let c = |re, im| Complex::new(re, im);
        FourierSeries::new(0.7, 2, vec![c(1.0, 0.0), c(-2.0, 0.0), c(0.3, 0.1), c(0.0, 0.5), c(0.0, -0.2), c(0.1, 0.0)])
            .expect("a signal")
    }

    #[test]
    fn samples_give_the_series_back() {
        let series = example();
        for n in [5, 8, 33] {
            let again = FourierSeries::from_samples(0.7, 2, &series.samples(n)).expect("samples").trimmed(1e-14);
            assert_eq!(again.harmonics(), 2);
            for (a, b) in again.coefficients().iter().zip(series.coefficients()) {
                assert!((a - b).norm() < 1e-15, "{n}");
            }
        }
    }

    #[test]
    fn even_samples_are_interpolated_whatever_they_are() {
        let samples = [0.3, -1.0, 2.0, 0.7, 0.1, 5.0];
        let series = FourierSeries::from_samples(2.0, 1, &samples).expect("samples");
        for (a, b) in series.samples(6).iter().zip(&samples) {
            assert!((a - b).abs() < 1e-14);
        }
    }

    #[test]
    fn derivative_and_shift_are_those_of_the_signal() {
        let series = example();
        let (t, h) = (0.23, 1e-5);
        let slope = series.derivative().value(t);
        for row in 0..2 {
            let difference = (series.value(t + h)[row] - series.value(t - h)[row]) / (2.0 * h);
            assert!((difference - slope[row]).abs() < 1e-6 * slope[row].abs());
            assert!((series.ahead(0.11).value(t)[row] - series.value(t + 0.11)[row]).abs() < 1e-14);
        }
        assert_eq!(series.select(&[1]).value(t), [series.value(t)[1]]);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        assert!(FourierSeries::new(0.0, 1, vec![Complex::from(1.0)]).is_err());
        assert!(FourierSeries::new(1.0, 2, vec![Complex::from(1.0)]).is_err());
        assert!(FourierSeries::constant(1.0, &[f64::NAN]).is_err());
        assert!(FourierSeries::from_samples(1.0, 2, &[1.0]).is_err());
    }
}
