//! The last step of a sweep over half the frequency axis: at zero frequency the other half begins as the mirror image.
//!
//! With `J` exchanging the mirrored unknowns and conjugating, a real system has `x(-f) = J x(f)`. At the end of the sweep the
//! state is the level `x_0` and the slope `e = x_0 - x_1`; what is known beyond is that `x_0 = J x_0` exactly, that the second
//! difference at zero, `x_1 - 2 x_0 + J x_1 = -(e + J e)`, is penalised by half (the sum over both halves is twice the sum
//! over one, and zero is counted once), and so are the rows at zero. These are real, not complex, linear conditions.

use super::blocks::{Blocks, Vector};
use crate::error::{Error, Result};
use crate::numeric::Complex;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Which part of a complex level or slope a condition speaks of.
#[derive(Clone, Copy)]
enum Part {
    Re,
    Im,
}

/// The conditions at zero frequency, weighed against what the sweep knows there.
pub(super) struct Closing {
    n: usize,
    /// Conditions over (Re level, Re slope, Im level, Im slope).
    conditions: DMatrix<f64>,
    /// Of conditions times covariance times conditions plus noise, scaled to a unit diagonal.
    factor: Cholesky<f64, Dyn>,
    scale: DVector<f64>,
    rows: usize,
}

impl Closing {
    /// From the covariance of (level, slope) predicted at zero, the mirror (unknown `i` mirrors `mirror[i]`), the variance of
    /// the walk's steps, and the rows observed at zero frequency.
    ///
    /// # Errors
    /// `NoConvergence` when the covariance is no longer one.
    pub(super) fn new(state: &Blocks, mirror: &[usize], noise: f64, rows: &[Vector]) -> Result<Self> {
        let n = mirror.len();
        let column =
            |kind: usize, i: usize, part: Part| kind * n + i + if matches!(part, Part::Im) { 2 * n } else { 0 };
        let mut conditions = Vec::new();
        let mut variances = Vec::new();
        for (i, row) in rows.iter().enumerate() {
            let entries = (0..n).flat_map(|j| {
                let u = row.get(j);
                [(column(0, j, Part::Re), u.re), (column(0, j, Part::Im), -u.im)]
            });
            debug_assert_eq!(i, conditions.len());
            conditions.push(entries.collect::<Vec<_>>());
            variances.push(2.0);
        }
        for i in 0..n {
            let j = mirror[i];
            let (re, im) = (|k, i| column(k, i, Part::Re), |k, i| column(k, i, Part::Im));
            if i == j {
                conditions.push(vec![(im(0, i), 1.0)]);
                conditions.push(vec![(re(1, i), 2.0)]);
                variances.extend([0.0, 2.0 * noise]);
            } else if i < j {
                conditions.push(vec![(re(0, i), 1.0), (re(0, j), -1.0)]);
                conditions.push(vec![(im(0, i), 1.0), (im(0, j), 1.0)]);
                conditions.push(vec![(re(1, i), 1.0), (re(1, j), 1.0)]);
                conditions.push(vec![(im(1, i), 1.0), (im(1, j), -1.0)]);
                variances.extend([0.0, 0.0, noise, noise]);
            }
        }
        let mut matrix = DMatrix::zeros(conditions.len(), 4 * n);
        for (i, entries) in conditions.iter().enumerate() {
            entries.iter().for_each(|&(j, value)| matrix[(i, j)] += value);
        }
        let mut weighed: DMatrix<f64> = &matrix * real(n, state) * matrix.transpose();
        (0..weighed.nrows()).for_each(|i| weighed[(i, i)] += variances[i]);
        let scale = weighed.diagonal().map(|v| 1.0 / v.sqrt());
        let scaled = DMatrix::from_fn(scale.len(), scale.len(), |i, j| weighed[(i, j)] * scale[i] * scale[j]);
        let factor = Cholesky::new(scaled).ok_or_else(|| Error::NoConvergence {
            method: "the smoother's mirror condition at zero frequency".into(),
            iterations: 1,
            residual: f64::NAN,
            advice: "the covariance lost its sign there: raise the smoothness or use the banded solver".into(),
        })?;
        Ok(Self { n, conditions: matrix, factor, scale, rows: rows.len() })
    }

    /// `S^-1 b` for the weighed conditions `S`.
    fn solve(&self, b: DVector<f64>) -> DVector<f64> {
        self.factor.solve(&b.component_mul(&self.scale)).component_mul(&self.scale)
    }

    /// What the conditions pull the predicted (level, slope) by, and `S^-1` of their misfits, for the data at zero frequency.
    pub(super) fn pull(&self, level: &Vector, slope: &Vector, y: impl Iterator<Item = Complex>) -> [Vector; 2] {
        let n = self.n;
        let state = DVector::from_fn(4 * n, |i, _| {
            let value = if (i / n).is_multiple_of(2) { level.get(i % n) } else { slope.get(i % n) };
            if i < 2 * n { value.re } else { value.im }
        });
        let mut misfit = -(&self.conditions * state);
        y.enumerate().take(self.rows).for_each(|(i, y)| misfit[i] += y.re);
        let pull = self.conditions.tr_mul(&self.solve(misfit));
        let mut out = [Vector::zero(n), Vector::zero(n)];
        for (half, vector) in out.iter_mut().enumerate() {
            (0..n).for_each(|i| vector.set(i, Complex::new(pull[half * n + i], pull[(2 + half) * n + i])));
        }
        out
    }

    /// The circular part of the information that the conditions add, and of each row the share of its residual that noise in
    /// it leaves (one minus its leverage).
    pub(super) fn information(&self) -> (Blocks, Vec<f64>) {
        let (n, count) = (self.n, self.conditions.nrows());
        let mut solved = self.conditions.clone();
        for mut column in solved.column_iter_mut() {
            let x = self.solve(column.clone_owned());
            column.copy_from(&x);
        }
        let omega = self.conditions.tr_mul(&solved);
        let mut blocks = Blocks::zero(n);
        for p in 0..2 * n {
            for q in p..2 * n {
                let re = 0.5 * (omega[(p, q)] + omega[(2 * n + p, 2 * n + q)]);
                let im = 0.5 * (omega[(2 * n + p, q)] - omega[(p, 2 * n + q)]);
                blocks.add_pair((p / n, p % n), (q / n, q % n), Complex::new(re, if p == q { 0.0 } else { im }));
            }
        }
        let left = |i: usize| {
            let unit = DVector::from_fn(count, |j, _| f64::from(u8::from(i == j)));
            2.0 * self.solve(unit)[i]
        };
        (blocks, (0..self.rows).map(left).collect())
    }
}

/// The covariance over (Re level, Re slope, Im level, Im slope).
fn real(n: usize, state: &Blocks) -> DMatrix<f64> {
    DMatrix::from_fn(4 * n, 4 * n, |p, q| {
        let (i, j) = (p % (2 * n), q % (2 * n));
        let value = state.get((i / n, i % n), (j / n, j % n));
        match (p < 2 * n, q < 2 * n) {
            (true, true) | (false, false) => value.re,
            (false, true) => value.im,
            (true, false) => -value.im,
        }
    })
}
