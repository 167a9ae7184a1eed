//! The rows that a smoother sees, in the form in which its passes read them.

use super::End;
use super::blocks::{Vector, padded};
use crate::numeric::Complex;

/// Fewest steps that count as the silence of an unknown.
const SHORT: usize = 10;

/// Rows of the observations, step by step.
#[derive(Clone)]
pub struct Observations {
    pub(super) n: usize,
    /// First row of each step, and the number of rows.
    first: Vec<usize>,
    /// Real parts, then imaginary parts, of each row's conjugate; padded.
    rows: Vec<f64>,
    power: f64,
}

impl Observations {
    /// No steps yet, of `n` unknowns each.
    pub fn new(n: usize) -> Self {
        Self { n, first: vec![0], rows: Vec::new(), power: 0.0 }
    }

    /// Makes room for so many further rows at once: growing step by step copies all of them several times.
    pub fn reserve(&mut self, rows: usize) {
        self.rows.reserve(rows * 2 * padded(self.n));
        self.first.reserve(rows);
    }

    /// Adds a step with these rows (each of `n` coefficients `u` of `y = u^T x`); a step without rows is a gap.
    pub fn step<'a>(&mut self, rows: impl IntoIterator<Item = &'a [Complex]>) {
        let stride = padded(self.n);
        for row in rows {
            debug_assert_eq!(row.len(), self.n);
            let at = self.rows.len();
            self.rows.resize(at + 2 * stride, 0.0);
            for (i, u) in row.iter().enumerate() {
                self.rows[at + i] = u.re;
                self.rows[at + stride + i] = -u.im;
                self.power += u.norm_sqr();
            }
        }
        self.first.push(self.rows.len() / (2 * stride));
    }

    /// Number of unknowns at each step.
    pub fn unknowns(&self) -> usize {
        self.n
    }
    /// Number of steps.
    pub fn steps(&self) -> usize {
        self.first.len() - 1
    }
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.first[self.steps()]
    }
    /// Mean over the rows of `|u|^2`.
    pub fn power(&self) -> f64 {
        self.power / self.rows().max(1) as f64
    }

    /// Rows of step `t`.
    pub fn at(&self, t: usize) -> std::ops::Range<usize> {
        self.first[t]..self.first[t + 1]
    }

    /// Coefficient of unknown `i` in row `r`.
    pub fn coefficient(&self, r: usize, i: usize) -> Complex {
        let row = self.row(r);
        Complex::new(row[i], -row[row.len() / 2 + i])
    }

    pub(super) fn row(&self, r: usize) -> &[f64] {
        let width = 2 * padded(self.n);
        &self.rows[r * width..(r + 1) * width]
    }

    pub(super) fn vector(&self, r: usize) -> Vector {
        Vector { stride: padded(self.n), data: self.row(r).to_vec() }
    }

    /// For each unknown the number of steps until its rows say more about it than a walk with steps of variance `noise`.
    pub(super) fn silence(&self, noise: f64, end: &End) -> Vec<f64> {
        let (n, steps) = (self.n, self.steps());
        let mut said = vec![0.0; n];
        let mut reach = vec![0.0; n];
        let mut listen = |step: usize, t: usize, unknown: &dyn Fn(usize) -> usize| {
            let far = (step + SHORT) as f64;
            let walked = noise * far.powi(3) / 3.0;
            for r in self.at(t) {
                for i in (0..n).filter(|&i| reach[i] == 0.0) {
                    said[i] += self.coefficient(r, unknown(i)).norm_sqr();
                }
            }
            for (reach, said) in reach.iter_mut().zip(&said) {
                if *reach == 0.0 && said * walked >= 1.0 {
                    *reach = far;
                }
            }
        };
        (0..steps).for_each(|t| listen(t, t, &|i| i));
        if let End::Mirror(mirror) = end {
            (1..steps).for_each(|t| listen(steps - 1 + t, steps - 1 - t, &|i| mirror[i]));
        }
        let most = if matches!(end, End::Mirror(_)) { 2 * steps } else { steps };
        reach.into_iter().map(|reach| if reach > 0.0 { reach } else { (most + SHORT) as f64 }).collect()
    }
}
