//! Riccati flows over an interval in the form that composes without losing digits.
//!
//! A flow of the Hamiltonian system `x' = A x - S p`, `p' = -Q x - A^T p` is written as `x_1 = F x_0 - G p_1`, `p_0 = H x_0 +
//! F^T p_1`. Intervals one after the other compose by Redheffer's star product, in which nothing grows that the closed loop
//! does not; composing a period with itself again and again doubles the horizon and leads to the stable subspace of the
//! monodromy matrix, which is never formed: its growing and decaying halves would drown each other.
//!
//! References: R. Redheffer, J. Math. Phys. 39 (1960), 269-286; E. K.-W. Chu et al., Int. J. Control 77 (2004), 767-788
//! (structure-preserving doubling for periodic Riccati equations).

use nalgebra::DMatrix;

use crate::numeric::gauss::Gauss;

/// F, G and H (n, n) of an interval.
#[derive(Clone, Debug)]
pub struct Flow {
    pub f: DMatrix<f64>,
    pub g: DMatrix<f64>,
    pub h: DMatrix<f64>,
}

impl Flow {
    /// From the Hamiltonian matrix (2n, 2n) at the Gauss nodes of an interval of `length`, s, by collocation. `None` for an
    /// interval too long.
    pub fn over(gauss: &Gauss, at_nodes: &[DMatrix<f64>], length: f64) -> Option<Self> {
        let (q, order) = (gauss.len(), at_nodes[0].nrows());
        let mut left = DMatrix::<f64>::identity(q * order, q * order);
        let mut right = DMatrix::<f64>::zeros(q * order, order);
        for i in 0..q {
            for r in 0..order {
                right[(i * order + r, r)] = 1.0;
            }
            for (j, matrix) in at_nodes.iter().enumerate() {
                let weight = length * gauss.integral[i * q + j];
                left.view_mut((i * order, j * order), (order, order)).zip_apply(matrix, |l, m| *l -= weight * m);
            }
        }
        let stages = left.lu().solve(&right)?;
        let mut end = DMatrix::<f64>::identity(order, order);
        for (j, matrix) in at_nodes.iter().enumerate() {
            end += matrix * stages.rows(j * order, order) * (length * gauss.weights[j]);
        }
        let n = order / 2;
        let block = |r: usize, c: usize| end.view((r * n, c * n), (n, n)).into_owned();
        let inverse = block(1, 1).try_inverse()?;
        let h = -&inverse * block(1, 0);
        let g = -block(0, 1) * &inverse;
        Some(Self { f: inverse.transpose(), g: symmetric(g), h: symmetric(h) })
    }

    /// This interval, and then `next`.
    pub fn then(&self, next: &Self) -> Option<Self> {
        let n = self.f.nrows();
        let between = (DMatrix::identity(n, n) + &self.g * &next.h).try_inverse()?;
        let f = &next.f * &between * &self.f;
        let g = &next.g + &next.f * &between * &self.g * next.f.transpose();
        let h = &self.h + self.f.transpose() * &next.h * &between * &self.f;
        Some(Self { f, g: symmetric(g), h: symmetric(h) })
    }

    /// P at the start, from P at the end.
    pub fn back(&self, end: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let n = self.f.nrows();
        let inner = (DMatrix::identity(n, n) + &self.g * end).try_inverse()?;
        Some(symmetric(&self.h + self.f.transpose() * end * inner * &self.f))
    }
}

fn symmetric(m: DMatrix<f64>) -> DMatrix<f64> {
    (&m + m.transpose()) * 0.5
}
