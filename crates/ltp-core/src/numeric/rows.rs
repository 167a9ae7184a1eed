//! `RowQr`: least squares whose rows arrive one at a time, in memory that does not grow with their number.
//!
//! A tall problem `min |A x + b|` is reduced to its triangle while the rows stream by: rows gather in a block, and a
//! full block is folded into the triangle by Householder reflections that touch only one row of the triangle each.
//! Normal equations are never formed, so the condition number is not squared. The order of operations depends on the
//! order of the rows only: same rows, same bits.
//!
//! Reference: G. H. Golub and C. F. Van Loan, *Matrix Computations*, 4th ed., section 5.2 and 6.5.3 (appending rows);
//! C. L. Lawson and R. J. Hanson, *Solving Least Squares Problems*, chapter 27 (sequential accumulation of rows).

use nalgebra::{DMatrix, DVector};

/// Rows gathered before a reduction; 64 keeps a block of 30 columns in the first-level cache.
const BLOCK: usize = 64;

/// Triangle of a tall least-squares problem `sum over rows of (rhs + row . x)^2`, built row by row.
///
/// The right-hand side is carried as a last column, so that the corner of the triangle is the root of the residual
/// sum of squares.
#[derive(Debug, Clone)]
pub struct RowQr {
    unknowns: usize,
    /// Upper triangle with the right-hand side as last column, row-major, `(k+1) x (k+1)`.
    triangle: Vec<f64>,
    /// Rows waiting for reduction, column-major: `block[c * BLOCK + r]`.
    block: Vec<f64>,
    waiting: usize,
    rows: usize,
}

impl RowQr {
    /// An empty problem with `unknowns` columns.
    pub fn new(unknowns: usize) -> Self {
        let width = unknowns + 1;
        RowQr { unknowns, triangle: vec![0.0; width * width], block: vec![0.0; width * BLOCK], waiting: 0, rows: 0 }
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.unknowns
    }

    /// Number of rows pushed so far (merged rows included).
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Forgets every row and keeps the memory.
    pub fn clear(&mut self) {
        self.triangle.fill(0.0);
        self.waiting = 0;
        self.rows = 0;
    }

    /// Appends the term `(rhs + row . x)^2`; `row` has one entry per unknown.
    pub fn push(&mut self, row: &[f64], rhs: f64) {
        debug_assert_eq!(row.len(), self.unknowns, "a row needs one entry per unknown");
        let at = self.waiting;
        for (column, &value) in row.iter().enumerate() {
            self.block[column * BLOCK + at] = value;
        }
        self.block[self.unknowns * BLOCK + at] = rhs;
        self.waiting += 1;
        self.rows += 1;
        if self.waiting == BLOCK {
            self.reduce();
        }
    }

    /// Appends all rows of `other`, as if they had been pushed here.
    pub fn merge(&mut self, other: &RowQr) {
        debug_assert_eq!(self.unknowns, other.unknowns, "merged problems share their unknowns");
        let (k, width) = (self.unknowns, self.unknowns + 1);
        let rows = self.rows + other.rows;
        for row in other.triangle.chunks_exact(width) {
            self.push(&row[..k], row[k]);
        }
        let mut row = vec![0.0; width];
        for r in 0..other.waiting {
            for (column, value) in row.iter_mut().enumerate() {
                *value = other.block[column * BLOCK + r];
            }
            self.push(&row[..k], row[k]);
        }
        self.rows = rows;
    }

    /// Upper triangular `R` `(k, k)` with `R'R = A'A`; the signs of its rows are free.
    pub fn r(&mut self) -> DMatrix<f64> {
        self.reduce();
        let width = self.unknowns + 1;
        DMatrix::from_fn(self.unknowns, self.unknowns, |i, j| self.triangle[i * width + j])
    }

    /// Transformed right-hand side `(k,)`: `R' rhs` is the gradient `A'b` at `x = 0`.
    pub fn rhs(&mut self) -> DVector<f64> {
        self.reduce();
        let width = self.unknowns + 1;
        DVector::from_fn(self.unknowns, |i, _| self.triangle[i * width + self.unknowns])
    }

    /// Sum of squares left at the minimum: `min |A x + b|^2` (for `R` of full rank).
    pub fn residual_sum_squares(&mut self) -> f64 {
        self.reduce();
        let corner = self.triangle.last().copied().unwrap_or(0.0);
        corner * corner
    }

    /// The `x` `(k,)` that minimises `sum (rhs + row . x)^2`; `None` when `R` is exactly singular or not finite.
    pub fn minimiser(&mut self) -> Option<DVector<f64>> {
        self.reduce();
        let (k, width) = (self.unknowns, self.unknowns + 1);
        let mut x = DVector::zeros(k);
        for i in (0..k).rev() {
            let row = &self.triangle[i * width..(i + 1) * width];
            let known: f64 = (i + 1..k).map(|j| row[j] * x[j]).sum();
            x[i] = -(row[k] + known) / row[i];
            if !x[i].is_finite() {
                return None;
            }
        }
        Some(x)
    }

    /// Smallest share, over the columns, of a column's norm that is not in the span of the columns before it.
    ///
    /// Near the rounding error when some column is a combination of others, whatever the columns' units; a
    /// [`minimiser`](Self::minimiser) exists then, and is noise.
    pub fn independence(&mut self) -> f64 {
        let r = self.r();
        (0..self.unknowns).map(|j| r[(j, j)].abs() / r.column(j).norm()).fold(1.0, |a, b| if b >= a { a } else { b })
    }

    /// Folds the waiting rows into the triangle.
    fn reduce(&mut self) {
        let (width, m) = (self.unknowns + 1, self.waiting);
        if m == 0 {
            return;
        }
        self.waiting = 0;
        for j in 0..width {
            // The reflection acts on row j of the triangle and on the block: all rows between are zero in column j.
            let (head, tail) = self.block.split_at_mut((j + 1) * BLOCK);
            let v = &mut head[j * BLOCK..j * BLOCK + m];
            let alpha = self.triangle[j * width + j];
            let below = norm(v);
            if below == 0.0 {
                continue;
            }
            let beta = -alpha.hypot(below).copysign(alpha);
            let tau = (beta - alpha) / beta;
            let pivot = alpha - beta;
            v.iter_mut().for_each(|x| *x /= pivot);
            self.triangle[j * width + j] = beta;
            for c in j + 1..width {
                let column = &mut tail[(c - j - 1) * BLOCK..(c - j - 1) * BLOCK + m];
                let top = &mut self.triangle[j * width + c];
                let shared: f64 = *top + v.iter().zip(column.iter()).map(|(a, b)| a * b).sum::<f64>();
                *top -= tau * shared;
                column.iter_mut().zip(v.iter()).for_each(|(x, a)| *x -= tau * shared * a);
            }
        }
    }
}

/// Euclidean norm; rescaled when the squares would overflow or vanish.
fn norm(v: &[f64]) -> f64 {
    let plain: f64 = v.iter().map(|x| x * x).sum();
    if plain > 1e-280 && plain < 1e280 {
        return plain.sqrt();
    }
    let largest = v.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return if plain.is_nan() { f64::NAN } else { largest };
    }
    largest * v.iter().map(|x| (x / largest).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pushed(a: &DMatrix<f64>, b: &DVector<f64>) -> RowQr {
        let mut qr = RowQr::new(a.ncols());
        for i in 0..a.nrows() {
            qr.push(&a.row(i).iter().copied().collect::<Vec<_>>(), b[i]);
        }
        qr
    }

    /// Entries that look irregular and are the same everywhere.
    fn entry(i: usize, j: usize) -> f64 {
        ((i * 37 + j * 101) as f64 * 0.7).sin() + 0.3 * ((i + 3 * j) as f64).cos()
    }

    #[test]
    fn triangle_agrees_with_dense_qr() {
        for rows in [5, 63, 64, 65, 300] {
            let a = DMatrix::from_fn(rows, 5, entry);
            let b = DVector::from_fn(rows, |i, _| entry(i, 77));
            let mut qr = pushed(&a, &b);
            let oracle = a.clone().qr();
            let dense = oracle.r();
            let r = qr.r();
            for i in 0..5 {
                let sign = (r[(i, i)] * dense[(i, i)]).signum();
                for j in i..5 {
                    assert!((r[(i, j)] - sign * dense[(i, j)]).abs() < 1e-12 * dense.norm(), "row {i} column {j}");
                }
            }
            let x = qr.minimiser().expect("full rank");
            let gradient = a.transpose() * (&a * &x + &b);
            assert!(gradient.norm() < 1e-12 * a.norm() * b.norm());
            let left = (&a * &x + &b).norm_squared();
            assert!((qr.residual_sum_squares() - left).abs() < 1e-12 * b.norm_squared());
        }
    }

    #[test]
    fn ill_conditioned_columns_keep_their_digits() {
        // Condition 1e9: normal equations would be singular in double precision, the triangle is not.
        let rows = 400;
        let a = DMatrix::from_fn(rows, 2, |i, j| if j == 0 { 1.0 } else { 1.0 + 1e-9 * entry(i, 1) });
        let truth = DVector::from_vec(vec![2.0, -1.0]);
        let b = -(&a * &truth);
        let x = pushed(&a, &b).minimiser().expect("full rank");
        assert!((x - truth).norm() < 1e-5);
    }

    #[test]
    fn merge_is_the_same_as_pushing_all() {
        let a = DMatrix::from_fn(150, 4, entry);
        let b = DVector::from_fn(150, |i, _| entry(i, 9));
        let mut whole = pushed(&a, &b);
        let mut first = pushed(&a.rows(0, 70).into_owned(), &b.rows(0, 70).into_owned());
        let second = pushed(&a.rows(70, 80).into_owned(), &b.rows(70, 80).into_owned());
        first.merge(&second);
        assert_eq!(first.rows(), 150);
        let (x, y) = (whole.minimiser().expect("rank"), first.minimiser().expect("rank"));
        assert!((x - y).norm() < 1e-12);
        assert!((whole.residual_sum_squares() - first.residual_sum_squares()).abs() < 1e-11);
    }

    #[test]
    fn same_rows_same_bits_and_clear_forgets() {
        let a = DMatrix::from_fn(130, 3, entry);
        let b = DVector::from_fn(130, |i, _| entry(i, 5));
        let mut used = pushed(&DMatrix::from_element(130, 3, 0.5), &b);
        used.clear();
        for i in 0..130 {
            used.push(&[a[(i, 0)], a[(i, 1)], a[(i, 2)]], b[i]);
        }
        assert_eq!(used.r(), pushed(&a, &b).r());
    }

    #[test]
    fn singular_column_has_no_minimiser_and_extreme_sizes_survive() {
        let mut qr = RowQr::new(2);
        qr.push(&[1.0, 0.0], 1.0);
        qr.push(&[2.0, 0.0], 1.0);
        assert!(qr.minimiser().is_none());
        let mut large = RowQr::new(1);
        large.push(&[3e200], -3e200);
        large.push(&[4e200], -4e200);
        assert!((large.minimiser().expect("finite")[0] - 1.0).abs() < 1e-14);
    }

    #[test]
    fn dependence_is_seen_in_any_units() {
        let columns = |share: f64| {
            DMatrix::from_fn(90, 3, |i, j| match j {
                0 => 1e6 * entry(i, 0),
                1 => 1e-6 * entry(i, 1),
                _ => entry(i, 0) - 3.0 * entry(i, 1) + share * entry(i, 2),
            })
        };
        let b = DVector::from_fn(90, |i, _| entry(i, 9));
        assert!(pushed(&columns(0.0), &b).independence() < 1e-14);
        let share = pushed(&columns(1e-6), &b).independence();
        assert!((1e-8..1e-6).contains(&share), "{share}");
        assert!(pushed(&DMatrix::zeros(90, 3), &b).independence().is_nan());
    }

    proptest! {
        #[test]
        fn gram_matrix_is_kept(values in proptest::collection::vec(-10.0..10.0_f64, 12..600)) {
            let rows = values.len() / 3;
            let a = DMatrix::from_row_slice(rows, 2, &values[..rows * 2]);
            let b = DVector::from_column_slice(&values[rows * 2..rows * 3]);
            let mut qr = pushed(&a, &b);
            let (r, q) = (qr.r(), qr.rhs());
            let size = 1.0 + a.norm_squared() + b.norm_squared();
            prop_assert!((r.transpose() * &r - a.transpose() * &a).norm() < 1e-12 * size);
            prop_assert!((r.transpose() * &q - a.transpose() * &b).norm() < 1e-12 * size);
            prop_assert!((q.norm_squared() + qr.residual_sum_squares() - b.norm_squared()).abs() < 1e-12 * size);
        }
    }
}
