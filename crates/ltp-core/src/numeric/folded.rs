//! Hermitian block tridiagonal systems that are their own mirror image, folded in the middle: Cholesky, solutions, and the
//! blocks of the inverse.
//!
//! Least squares in the frequency domain with the lines of both signs gives a matrix `A` whose lower half, from the middle
//! block 0 outwards, is the mirrored conjugate of its upper half. Only blocks `0, 1, 2, ...` are stored: elimination runs from
//! the outermost block inwards, block 0 takes what arrives from one side and its mirror image from the other, and half the
//! work is saved. `mirror` says which unknown of block 0 is the image of which.
//!
//! The blocks of the inverse on the diagonal and beside it, which is all that variances and traces need, follow from the
//! same factors outwards (K. Takahashi, J. Fagan and M.-S. Chen, PICA proceedings 1973, 63-69).

use super::Complex;
use crate::error::{Error, Result};
use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{Mat, Side};

/// A Hermitian positive definite matrix by its blocks from the middle outwards.
#[derive(Clone, Debug)]
pub struct Folded {
    /// Diagonal blocks `(n_i, n_i)`, the middle one first; the lower triangles count.
    pub diagonal: Vec<Mat<Complex>>,
    /// `beside[i]` `(n_{i+1}, n_i)`: rows of block `i + 1`, columns of block `i`.
    pub beside: Vec<Mat<Complex>>,
}

/// The factors of a [`Folded`] matrix.
#[derive(Clone, Debug)]
pub struct Factors {
    cholesky: Vec<Llt<Complex>>,
    /// `reduced[i]`: the block `beside[i]`, with the inverse of what is left of diagonal block `i + 1` before it.
    reduced: Vec<Mat<Complex>>,
    mirror: Vec<usize>,
}

impl Folded {
    /// Zeros, with blocks of these sizes from the middle outwards.
    pub fn zeros(sizes: &[usize]) -> Self {
        let diagonal = sizes.iter().map(|&n| Mat::zeros(n, n)).collect();
        let beside = sizes.windows(2).map(|w| Mat::zeros(w[1], w[0])).collect();
        Folded { diagonal, beside }
    }

    /// Factors of the whole matrix, both halves; `mirror[i]` is the image of unknown `i` of block 0.
    ///
    /// # Errors
    /// `NoConvergence` when the matrix is not positive definite to rounding.
    pub fn factor(&self, mirror: &[usize]) -> Result<Factors> {
        let last = self.diagonal.len() - 1;
        let mut cholesky = Vec::with_capacity(last + 1);
        let mut reduced = Vec::with_capacity(last);
        let mut left = self.diagonal[last].clone();
        for i in (0..=last).rev() {
            let factor = Llt::new(left.as_ref(), Side::Lower).map_err(|_| Error::NoConvergence {
                method: "Cholesky's factorisation of a folded block tridiagonal matrix".into(),
                iterations: last - i,
                residual: f64::NAN,
                advice:
                    "the data leave combinations of the unknowns open: fewer harmonics, a narrower band or a longer \
                         record"
                        .into(),
            })?;
            if i > 0 {
                let solved = factor.solve(&self.beside[i - 1]);
                let arrives = self.beside[i - 1].adjoint() * &solved;
                left = &self.diagonal[i - 1] - &arrives;
                if i == 1 {
                    let image = |r: usize, c: usize| arrives[(mirror[r], mirror[c])].conj();
                    left -= Mat::from_fn(left.nrows(), left.ncols(), image);
                }
                reduced.push(solved);
            }
            cholesky.push(factor);
        }
        cholesky.reverse();
        reduced.reverse();
        Ok(Factors { cholesky, reduced, mirror: mirror.to_vec() })
    }
}

impl Factors {
    /// Logarithm of the determinant of the whole matrix, both halves.
    pub fn log_determinant(&self) -> f64 {
        let of = |factor: &Llt<Complex>| {
            let l = factor.L();
            (0..l.nrows()).map(|i| 2.0 * l[(i, i)].re.ln()).sum::<f64>()
        };
        of(&self.cholesky[0]) + 2.0 * self.cholesky[1..].iter().map(of).sum::<f64>()
    }

    /// Solutions for right-hand sides `(n_i, columns)` that are their own mirror image, block by block from the middle.
    pub fn solve(&self, rhs: &[Mat<Complex>]) -> Vec<Mat<Complex>> {
        let last = rhs.len() - 1;
        let mut x = rhs.to_vec();
        for i in (1..=last).rev() {
            let arrives = self.reduced[i - 1].adjoint() * &x[i];
            if i == 1 {
                let image = |r: usize, c: usize| arrives[(self.mirror[r], c)].conj();
                x[0] -= Mat::from_fn(arrives.nrows(), arrives.ncols(), image);
            }
            x[i - 1] -= arrives;
            x[i] = self.cholesky[i].solve(&x[i]);
        }
        x[0] = self.cholesky[0].solve(&x[0]);
        for i in 1..=last {
            let correction = &self.reduced[i - 1] * &x[i - 1];
            x[i] -= correction;
        }
        x
    }

    /// The inverse on the diagonal blocks and beside them.
    pub fn inverse(&self) -> Folded {
        let mut diagonal = vec![self.cholesky[0].inverse()];
        let mut beside = Vec::with_capacity(self.reduced.len());
        for (i, reduced) in self.reduced.iter().enumerate() {
            let next = reduced * &diagonal[i];
            let mut block = self.cholesky[i + 1].inverse();
            block += &next * reduced.adjoint();
            diagonal.push(block);
            beside.push(-next);
        }
        Folded { diagonal, beside }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::rng::SplitMix64;

    /// A folded matrix, its mirror, and the dense matrix it stands for (mirrored blocks first).
    fn example() -> (Folded, Vec<usize>, Mat<Complex>) {
        let (sizes, mirror) = (vec![4, 3, 2], vec![3, 2, 1, 0]);
        let mut random = SplitMix64::new(11);
        let mut draw = || Complex::new(random.normal(), random.normal());
        let mut folded = Folded::zeros(&sizes);
        for (i, &n) in sizes.iter().enumerate() {
            let raw = Mat::from_fn(n, n, |_, _| draw());
            folded.diagonal[i] =
                &raw * raw.adjoint() + Mat::from_fn(n, n, |r, c| Complex::from(f64::from(u8::from(r == c)) * 9.0));
        }
        let middle = folded.diagonal[0].clone();
        folded.diagonal[0] += Mat::from_fn(4, 4, |r, c| middle[(mirror[r], mirror[c])].conj());
        folded.beside = (0..2).map(|i| Mat::from_fn(sizes[i + 1], sizes[i], |_, _| draw())).collect();
        // Dense order: block 2 mirrored, block 1 mirrored, middle, block 1, block 2.
        let mut dense = Mat::<Complex>::zeros(14, 14);
        let start = [[5, 9, 12], [5, 2, 0]];
        for (side, start) in start.iter().enumerate() {
            let seen = |v: Complex| if side == 0 { v } else { v.conj() };
            for i in 0..3 {
                for (r, c) in
                    (0..sizes[i]).flat_map(|r| (0..sizes[i]).map(move |c| (r, c))).filter(|_| i > 0 || side == 0)
                {
                    dense[(start[i] + r, start[i] + c)] = seen(folded.diagonal[i][(r, c)]);
                }
            }
            for i in 0..2 {
                for (r, c) in (0..sizes[i + 1]).flat_map(|r| (0..sizes[i]).map(move |c| (r, c))) {
                    let column = if side == 1 && i == 0 { mirror[c] } else { c };
                    let value = seen(folded.beside[i][(r, c)]);
                    dense[(start[i + 1] + r, start[i] + column)] = value;
                    dense[(start[i] + column, start[i + 1] + r)] = value.conj();
                }
            }
        }
        (folded, mirror, dense)
    }

    #[test]
    fn everything_agrees_with_the_dense_matrix() {
        let (folded, mirror, dense) = example();
        let factors = folded.factor(&mirror).expect("positive definite");
        let whole = Llt::new(dense.as_ref(), Side::Lower).expect("positive definite");
        let log: f64 = (0..14).map(|i| 2.0 * whole.L()[(i, i)].re.ln()).sum();
        assert!((factors.log_determinant() - log).abs() < 1e-12 * log.abs());

        let inverse = whole.inverse();
        let found = factors.inverse();
        let start = [5, 9, 12];
        for i in 0..3 {
            let n = folded.diagonal[i].nrows();
            for (r, c) in (0..n).flat_map(|r| (0..n).map(move |c| (r, c))) {
                assert!((found.diagonal[i][(r, c)] - inverse[(start[i] + r, start[i] + c)]).norm() < 1e-13);
            }
        }
        for i in 0..2 {
            let block = &found.beside[i];
            for (r, c) in (0..block.nrows()).flat_map(|r| (0..block.ncols()).map(move |c| (r, c))) {
                assert!((block[(r, c)] - inverse[(start[i + 1] + r, start[i] + c)]).norm() < 1e-13);
            }
        }

        let mut random = SplitMix64::new(12);
        let mut rhs: Vec<Mat<Complex>> = [4, 3, 2]
            .iter()
            .map(|&n| Mat::from_fn(n, 2, |_, _| Complex::new(random.normal(), random.normal())))
            .collect();
        let middle = rhs[0].clone();
        rhs[0] += Mat::from_fn(4, 2, |r, c| middle[(mirror[r], c)].conj());
        let mut all = Mat::<Complex>::zeros(14, 2);
        for c in 0..2 {
            (0..4).for_each(|r| all[(5 + r, c)] = rhs[0][(r, c)]);
            (0..3).for_each(|r| (all[(9 + r, c)], all[(2 + r, c)]) = (rhs[1][(r, c)], rhs[1][(r, c)].conj()));
            (0..2).for_each(|r| (all[(12 + r, c)], all[(r, c)]) = (rhs[2][(r, c)], rhs[2][(r, c)].conj()));
        }
        let expected = whole.solve(&all);
        let solved = factors.solve(&rhs);
        for (i, &start) in start.iter().enumerate() {
            for (r, c) in (0..solved[i].nrows()).flat_map(|r| (0..2).map(move |c| (r, c))) {
                assert!((solved[i][(r, c)] - expected[(start + r, c)]).norm() < 1e-13);
            }
        }
    }

    #[test]
    fn an_indefinite_matrix_is_an_error() {
        let (mut folded, mirror, _) = example();
        folded.diagonal[1][(0, 0)] = Complex::from(-1.0);
        assert!(matches!(folded.factor(&mirror), Err(Error::NoConvergence { .. })));
    }
}
