//! One step of the Floquet fit: coefficients of the numerators and of the denominator from weighted rows and a prior.
//!
//! For given denominator, noise levels and scales the numerators are linear: complex normal equations, block tridiagonal in
//! the order of [`super::layout`]. The coefficients of the denominator enter as a few more columns, solved by their Schur
//! complement (variable projection). Lines of both signs are equations; those below zero are mirror images of those above.

use std::ops::AddAssign;

use faer::Mat;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::layout::Layout;
use super::rows::{Cell, Row};
use crate::error::Result;
use crate::numeric::Complex;
use crate::numeric::folded::{Factors, Folded};
use crate::numeric::quartic::BUMPS;

/// Products of two of the five bumps.
const PRODUCTS: usize = BUMPS * (BUMPS + 1) / 2;

/// Shares by which the diagonal is raised, one after the other, when rounding makes the normal matrix indefinite.
const RAISED: [f64; 6] = [1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8];

/// What the denominator's columns are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Equation error under the denominator of the step before: finds the denominator from nothing.
    SteiglitzMcBride,
    /// Linearised output error: refines it without bias.
    GaussNewton,
}

/// The denominator `1 - a_1 z - ... - a_p z^p` at `z = e^{-j w T}`.
pub(super) fn denominator(a: &[f64], turn: Complex) -> Complex {
    let mut power = Complex::new(1.0, 0.0);
    let mut value = power;
    for &a in a {
        power *= turn;
        value -= a * power;
    }
    value
}

/// What one cell adds: products of its channels with each other and with the columns.
#[derive(Clone, Debug)]
pub(super) struct Local {
    /// Sums over rows of conj(u_a) u_b times products of bumps, for b <= a: (pairs, 15).
    gram: Vec<[Complex; PRODUCTS]>,
    /// (channels * 5, columns).
    right: Vec<Complex>,
    /// (columns, columns), real parts.
    corner: Vec<f64>,
}

/// Index of the product of bumps `i` and `j`.
fn product(i: usize, j: usize) -> usize {
    let (high, low) = (i.max(j), i.min(j));
    high * (high + 1) / 2 + low
}

impl Local {
    /// Sums over the rows of `cell`; `weights` are 1 / variance, `columns` (rows, count) what is explained.
    fn new(cell: &Cell, a: &[f64], weights: &[f64], columns: &[Complex], count: usize) -> Self {
        let zero = Complex::new(0.0, 0.0);
        let channels = cell.channels;
        let mut local = Local {
            gram: vec![[zero; PRODUCTS]; channels * (channels + 1) / 2],
            right: vec![zero; channels * BUMPS * count],
            corner: vec![0.0; count * count],
        };
        let mut live: Vec<(usize, Complex)> = Vec::with_capacity(channels);
        for (r, row) in cell.rows.iter().enumerate() {
            let weight = weights[r] * row.share;
            let column = &columns[r * count..(r + 1) * count];
            for (i, left) in column.iter().enumerate() {
                for (j, right) in column.iter().enumerate() {
                    local.corner[i * count + j] += weight * (left.conj() * right).re;
                }
            }
            let inputs = &cell.inputs[r * channels..(r + 1) * channels];
            live.clear();
            let inverse = 1.0 / denominator(a, row.turn);
            live.extend(inputs.iter().enumerate().filter(|(_, u)| **u != zero).map(|(c, u)| (c, u * inverse)));
            let mut products = [0.0; PRODUCTS];
            for i in 0..BUMPS {
                (0..=i).for_each(|j| products[product(i, j)] = weight * row.bumps[i] * row.bumps[j]);
            }
            for (at, &(c, u)) in live.iter().enumerate() {
                let pairs = &mut local.gram[c * (c + 1) / 2..(c + 1) * (c + 2) / 2];
                for &(other, v) in &live[..=at] {
                    let value = u.conj() * v;
                    pairs[other].iter_mut().zip(&products).for_each(|(sum, p)| *sum += value * p);
                }
                for (i, value) in column.iter().enumerate() {
                    let value = weight * u.conj() * value;
                    for (l, bump) in row.bumps.iter().enumerate() {
                        local.right[(c * BUMPS + l) * count + i] += value * bump;
                    }
                }
            }
        }
        local
    }

    /// Visits the entries `(first unknown, second unknown, value)` of the cell's normal matrix, both triangles; unknowns are
    /// numbered (channel, bump).
    fn entries(&self, channels: usize, mut visit: impl FnMut(usize, usize, Complex)) {
        for c in 0..channels {
            for other in 0..=c {
                let sums = &self.gram[c * (c + 1) / 2 + other];
                for (l, m) in (0..BUMPS).flat_map(|l| (0..BUMPS).map(move |m| (l, m))) {
                    let value = sums[product(l, m)];
                    visit(c * BUMPS + l, other * BUMPS + m, value);
                    if c != other {
                        visit(other * BUMPS + m, c * BUMPS + l, value.conj());
                    }
                }
            }
        }
    }
}

/// What is known after the data of one output, for given denominator, noise and scales.
#[derive(Clone, Debug)]
pub(super) struct Posterior {
    /// Solutions for each column, block by block: the first for the output, the others for the denominator's columns.
    pub solutions: Vec<Mat<Complex>>,
    /// Covariance of the coefficients, near the diagonal.
    pub covariance: Folded,
    /// Reduced normal matrix of the columns (both signs of frequency counted).
    pub reduced: DMatrix<f64>,
    /// Per cell: leverage of its rows, the number of values they spend on the coefficients.
    pub leverage: Vec<f64>,
    /// Logarithm of the determinant of the precision of the coefficients.
    pub log_determinant: f64,
}

/// The data of one output in one step.
pub(super) struct Data<'a> {
    pub layout: &'a Layout,
    pub cells: &'a [Cell],
    /// Per cell, per row.
    pub weights: &'a [Vec<f64>],
    /// Per cell, (rows, 1 + order).
    pub columns: &'a [Vec<Complex>],
    /// Per group: prior variance of the coefficients.
    pub scales: &'a [f64],
    pub denominator: &'a [f64],
}

/// The prior precision of all coefficients.
pub(super) fn prior(layout: &Layout, scales: &[f64]) -> Folded {
    let mut matrix = Folded::zeros(layout.sizes());
    layout.precision(|group, row, column, value| add(&mut matrix, row, column, Complex::from(value / scales[group])));
    matrix
}

fn add(matrix: &mut Folded, row: (usize, usize), column: (usize, usize), value: Complex) {
    if row.0 == column.0 {
        matrix.diagonal[row.0][(row.1, column.1)] += value;
    } else if row.0 == column.0 + 1 {
        matrix.beside[column.0][(row.1, column.1)] += value;
    }
}

/// Factors, with the diagonal raised by what rounding may have taken from it when records without noise leave combinations
/// of the unknowns to the prior.
fn factor(matrix: &mut Folded, mirror: &[usize]) -> Result<Factors> {
    for raised in RAISED {
        if let Ok(factors) = matrix.factor(mirror) {
            return Ok(factors);
        }
        for block in &mut matrix.diagonal {
            (0..block.nrows()).for_each(|i| block[(i, i)] *= 1.0 + raised);
        }
    }
    matrix.factor(mirror)
}

/// Coefficients, covariance and reduced system.
///
/// # Errors
/// `NoConvergence` when the normal matrix is not positive definite to rounding.
pub(super) fn posterior(data: &Data) -> Result<Posterior> {
    let (layout, count) = (data.layout, 1 + data.denominator.len());
    let local: Vec<Local> = (0..data.cells.len())
        .into_par_iter()
        .map(|i| Local::new(&data.cells[i], data.denominator, &data.weights[i], &data.columns[i], count))
        .collect();
    let mut matrix = Folded::zeros(layout.sizes());
    let mut right: Vec<Mat<Complex>> = layout.sizes().iter().map(|&n| Mat::zeros(n, count)).collect();
    let mut corner = DMatrix::zeros(count, count);
    for (cell, local) in data.cells.iter().zip(&local) {
        local.entries(cell.channels, |i, j, value| add(&mut matrix, cell.places[i], cell.places[j], value));
        for (&(block, row), values) in cell.places.iter().zip(local.right.chunks_exact(count)) {
            values.iter().enumerate().for_each(|(c, value)| right[block][(row, c)].add_assign(value));
        }
        // Both signs of frequency: twice the real part.
        corner += 2.0 * DMatrix::from_row_slice(count, count, &local.corner);
    }
    let mirror = layout.mirror();
    let image = matrix.diagonal[0].clone();
    matrix.diagonal[0] += Mat::from_fn(mirror.len(), mirror.len(), |r, c| image[(mirror[r], mirror[c])].conj());
    let image = right[0].clone();
    right[0] += Mat::from_fn(mirror.len(), count, |r, c| image[(mirror[r], c)].conj());
    layout.precision(|group, row, column, value| {
        add(&mut matrix, row, column, Complex::from(value / data.scales[group]))
    });

    let factors = factor(&mut matrix, &mirror)?;
    let solutions = factors.solve(&right);
    let mut reduced = corner;
    for (i, (right, solution)) in right.iter().zip(&solutions).enumerate() {
        let explained = right.adjoint() * solution;
        let twice = if i == 0 { 1.0 } else { 2.0 };
        reduced -= DMatrix::from_fn(count, count, |r, c| twice * explained[(r, c)].re);
    }
    let covariance = factors.inverse();
    let leverage = data
        .cells
        .iter()
        .zip(&local)
        .map(|(cell, local)| {
            let mut sum = 0.0;
            local.entries(cell.channels, |i, j, value| {
                sum += (value * entry(&covariance, cell.places[j], cell.places[i])).re;
            });
            sum
        })
        .collect();
    Ok(Posterior { solutions, covariance, reduced, leverage, log_determinant: factors.log_determinant() })
}

/// Entry of a Hermitian folded matrix, within neighbouring blocks.
pub(super) fn entry(matrix: &Folded, row: (usize, usize), column: (usize, usize)) -> Complex {
    if row.0 == column.0 {
        matrix.diagonal[row.0][(row.1, column.1)]
    } else if row.0 == column.0 + 1 {
        matrix.beside[column.0][(row.1, column.1)]
    } else {
        matrix.beside[row.0][(column.1, row.1)].conj()
    }
}

/// The change of the denominator's coefficients that a reduced system asks for (of one output, or of several added), and
/// its precision matrix.
pub(super) fn denominator_change(reduced: &DMatrix<f64>) -> (Vec<f64>, DMatrix<f64>) {
    let order = reduced.nrows() - 1;
    let precision = reduced.view((1, 1), (order, order)).into_owned();
    let right = DVector::from_fn(order, |i, _| reduced[(i + 1, 0)]);
    let solved = precision.clone().cholesky().map_or_else(|| DVector::zeros(order), |factor| factor.solve(&right));
    (solved.as_slice().to_vec(), precision)
}

impl Posterior {
    /// Coefficients of the numerators when the denominator's coefficients move by `change`.
    pub fn coefficients(&self, change: &[f64]) -> Vec<Vec<Complex>> {
        let of_block = |block: &Mat<Complex>| {
            let value = |r: usize| {
                let moved: Complex = change.iter().enumerate().map(|(i, &d)| block[(r, i + 1)] * d).sum();
                block[(r, 0)] - moved
            };
            (0..block.nrows()).map(value).collect()
        };
        self.solutions.iter().map(of_block).collect()
    }

    /// Per group: coefficients measured by the prior's precision at unit scale, and how many the data determine.
    pub fn sizes(&self, layout: &Layout, coefficients: &[Vec<Complex>], scales: &[f64]) -> Vec<(f64, f64)> {
        let mut sums = vec![(0.0, 0.0); layout.groups()];
        layout.precision(|group, row, column, value| {
            let twice = if row.0 == 0 && column.0 == 0 { 1.0 } else { 2.0 };
            let product = coefficients[row.0][row.1].conj() * coefficients[column.0][column.1];
            sums[group].0 += twice * value * product.re;
            sums[group].1 += twice * value * entry(&self.covariance, column, row).re;
        });
        let counts = layout.counts();
        sums.iter().enumerate().map(|(g, &(size, trace))| (size, counts[g] - trace / scales[g])).collect()
    }
}

/// The outputs that coefficients predict, and the variance that noise of the inputs adds to them, per cell and row.
pub(super) fn predict(cells: &[Cell], a: &[f64], coefficients: &[Vec<Complex>]) -> (Vec<Vec<Complex>>, Vec<Vec<f64>>) {
    let of_row = |cell: &Cell, r: usize, row: &Row| {
        let range = r * cell.channels..(r + 1) * cell.channels;
        let (mut sum, mut variance) = (Complex::new(0.0, 0.0), 0.0);
        for (c, (&u, &doubt)) in cell.inputs[range.clone()].iter().zip(&cell.doubts[range]).enumerate() {
            if u != Complex::new(0.0, 0.0) {
                let places = &cell.places[c * BUMPS..(c + 1) * BUMPS];
                let numerator: Complex =
                    places.iter().zip(&row.bumps).map(|(&(block, at), &bump)| coefficients[block][at] * bump).sum();
                sum += u * numerator;
                variance += doubt * numerator.norm_sqr();
            }
        }
        let inverse = 1.0 / denominator(a, row.turn);
        (sum * inverse, variance * inverse.norm_sqr())
    };
    let of_cell = |cell: &Cell| cell.rows.iter().enumerate().map(|(r, row)| of_row(cell, r, row)).unzip();
    cells.par_iter().map(of_cell).unzip()
}
