//! Cubic splines: interpolation through samples, and a B-spline basis for laws whose shape is not known.
//!
//! [`Cubic`] is twice continuously differentiable through every sample (the `cubic` hold of an input, so that a delay
//! has a smooth derivative). [`BSplines`] are the uniform cubic bumps; at every point four of them are not zero and
//! they sum to one, so that a force law fitted with them is local, smooth, and linear in its coefficients.
//!
//! Reference: C. de Boor, *A Practical Guide to Splines*, revised edition, chapters IV and IX.

use crate::error::{Error, Result};

/// What an interpolating spline does at its two ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ends {
    /// Second derivative zero.
    Natural,
    /// First derivative as given at the start and at the end.
    Clamped(f64, f64),
}

/// A cubic spline through `n` points.
#[derive(Debug, Clone, PartialEq)]
pub struct Cubic {
    x: Vec<f64>,
    /// Per interval `[y, slope, c2, c3]`: value `y + d (slope + d (c2 + d c3))` at `d = x - x_i`.
    pieces: Vec<[f64; 4]>,
}

impl Cubic {
    /// The spline through `(x_i, y_i)` `(n,)`, `x` strictly increasing, `n >= 2`.
    ///
    /// # Errors
    /// `Shape` for unequal lengths, `TooShort` below two points, `NotFinite`, and `OutOfRange` where `x` does not
    /// increase.
    pub fn new(x: &[f64], y: &[f64], ends: Ends) -> Result<Self> {
        let what = "points of a cubic spline";
        if y.len() != x.len() {
            return Err(Error::Shape { what: what.to_owned(), expected: x.len(), found: y.len() });
        }
        if x.len() < 2 {
            return Err(Error::TooShort { what: what.to_owned(), needed: 2, found: x.len() });
        }
        for (column, values) in [("x", x), ("y", y)] {
            if let Some(row) = values.iter().position(|v| !v.is_finite()) {
                let column = column.to_owned();
                return Err(Error::NotFinite { what: what.to_owned(), row, column, value: values[row] });
            }
        }
        if let Some(row) = (1..x.len()).find(|&i| x[i] <= x[i - 1]) {
            let expected =
                format!("more than {}, the value before; sort the points and remove repeated ones", x[row - 1]);
            return Err(Error::OutOfRange { what: format!("x[{row}] of a cubic spline"), found: x[row], expected });
        }
        let n = x.len();
        let step: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
        let chord: Vec<f64> = y.windows(2).zip(&step).map(|(w, h)| (w[1] - w[0]) / h).collect();
        let bend = second_derivatives(&step, &chord, ends);
        let pieces = (0..n - 1)
            .map(|i| {
                let slope = chord[i] - step[i] * (2.0 * bend[i] + bend[i + 1]) / 6.0;
                [y[i], slope, 0.5 * bend[i], (bend[i + 1] - bend[i]) / (6.0 * step[i])]
            })
            .collect();
        Ok(Cubic { x: x.to_vec(), pieces })
    }

    /// Per interval `i` the coefficients `[c0, c1, c2, c3]` of `c0 + c1 d + c2 d^2 + c3 d^3`, `d = x - x_i`; `n - 1`
    /// of them.
    pub fn pieces(&self) -> &[[f64; 4]] {
        &self.pieces
    }

    /// Value at `x`; outside the points the first or last cubic continues.
    pub fn value(&self, x: f64) -> f64 {
        let (d, [c0, c1, c2, c3]) = self.at(x);
        c0 + d * (c1 + d * (c2 + d * c3))
    }

    /// First derivative at `x`.
    pub fn derivative(&self, x: f64) -> f64 {
        let (d, [_, c1, c2, c3]) = self.at(x);
        c1 + d * (2.0 * c2 + d * 3.0 * c3)
    }

    fn at(&self, x: f64) -> (f64, [f64; 4]) {
        let piece = self.x.partition_point(|&knot| knot <= x).saturating_sub(1).min(self.pieces.len() - 1);
        (x - self.x[piece], self.pieces[piece])
    }
}

/// Second derivatives at the points, from the continuity of the first: a tridiagonal system, solved by elimination
/// (Thomas).
///
/// The system is diagonally dominant, so that no pivoting is needed.
fn second_derivatives(step: &[f64], chord: &[f64], ends: Ends) -> Vec<f64> {
    let n = step.len() + 1;
    let (mut diagonal, mut upper, mut right) = (vec![1.0; n], vec![0.0; n], vec![0.0; n]);
    let mut lower = vec![0.0; n];
    for i in 1..n - 1 {
        (lower[i], diagonal[i], upper[i]) = (step[i - 1], 2.0 * (step[i - 1] + step[i]), step[i]);
        right[i] = 6.0 * (chord[i] - chord[i - 1]);
    }
    if let Ends::Clamped(first, last) = ends {
        (diagonal[0], upper[0], right[0]) = (2.0 * step[0], step[0], 6.0 * (chord[0] - first));
        (lower[n - 1], diagonal[n - 1]) = (step[n - 2], 2.0 * step[n - 2]);
        right[n - 1] = 6.0 * (last - chord[n - 2]);
    }
    for i in 1..n {
        let factor = lower[i] / diagonal[i - 1];
        diagonal[i] -= factor * upper[i - 1];
        right[i] -= factor * right[i - 1];
    }
    right[n - 1] /= diagonal[n - 1];
    for i in (0..n - 1).rev() {
        right[i] = (right[i] - upper[i] * right[i + 1]) / diagonal[i];
    }
    right
}

/// Uniform cubic B-splines over `[lower, upper]`: `pieces + 3` functions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BSplines {
    lower: f64,
    width: f64,
    pieces: usize,
}

impl BSplines {
    /// The basis over `[lower, upper]` cut into `pieces >= 1` equal parts.
    ///
    /// # Errors
    /// `OutOfRange` when the interval is empty or not finite, or when `pieces` is 0.
    pub fn new(lower: f64, upper: f64, pieces: usize) -> Result<Self> {
        if pieces == 0 {
            let expected = "at least 1 piece".to_owned();
            return Err(Error::OutOfRange { what: "pieces of a B-spline basis".to_owned(), found: 0.0, expected });
        }
        let width = (upper - lower) / pieces as f64;
        if !(width.is_finite() && width > 0.0 && lower.is_finite()) {
            let expected = format!("a finite number above the lower end {lower}");
            return Err(Error::OutOfRange { what: "upper end of a B-spline basis".to_owned(), found: upper, expected });
        }
        Ok(BSplines { lower, width, pieces })
    }

    /// Number of basis functions.
    pub fn len(&self) -> usize {
        self.pieces + 3
    }

    /// Never true.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The four functions that are not zero at `x`: index of the first, and their values, which sum to one.
    ///
    /// Outside the interval the values at its nearer end are held.
    pub fn values(&self, x: f64) -> (usize, [f64; 4]) {
        let (first, u, _) = self.place(x);
        let v = 1.0 - u;
        let outer = [v * v * v / 6.0, u * u * u / 6.0];
        let inner = [(4.0 - 3.0 * u * u * (2.0 - u)) / 6.0, (4.0 - 3.0 * v * v * (2.0 - v)) / 6.0];
        (first, [outer[0], inner[0], inner[1], outer[1]])
    }

    /// First derivatives of the same four functions at `x`; zero outside the interval.
    pub fn derivatives(&self, x: f64) -> (usize, [f64; 4]) {
        let (first, u, inside) = self.place(x);
        let scale = if inside { 0.5 / self.width } else { 0.0 };
        let v = 1.0 - u;
        (first, [-v * v * scale, u * (3.0 * u - 4.0) * scale, -v * (3.0 * v - 4.0) * scale, u * u * scale])
    }

    /// All `len()` values at `x`, for a dense row.
    pub fn row(&self, x: f64) -> Vec<f64> {
        let mut row = vec![0.0; self.len()];
        let (first, values) = self.values(x);
        row[first..first + 4].copy_from_slice(&values);
        row
    }

    /// Piece, place in it from 0 to 1, and whether `x` is inside the interval.
    fn place(&self, x: f64) -> (usize, f64, bool) {
        let s = (x - self.lower) / self.width;
        let held = s.clamp(0.0, self.pieces as f64);
        let piece = (held as usize).min(self.pieces - 1);
        (piece, held - piece as f64, s == held)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn clamped_spline_reproduces_cubics() {
        let f = |x: f64| 1.0 - 2.0 * x + 0.5 * x * x + 0.3 * x * x * x;
        let d = |x: f64| -2.0 + x + 0.9 * x * x;
        let x = [-1.0, 0.0, 0.3, 1.5, 2.0];
        let spline = Cubic::new(&x, &x.map(f), Ends::Clamped(d(-1.0), d(2.0))).expect("points");
        for i in 0..60 {
            let at = -1.2 + 0.06 * f64::from(i);
            assert!((spline.value(at) - f(at)).abs() < 1e-12 && (spline.derivative(at) - d(at)).abs() < 1e-11);
        }
    }

    #[test]
    fn interpolation_error_falls_with_the_fourth_power() {
        let error = |n: usize| {
            let h = std::f64::consts::PI / n as f64;
            let x: Vec<f64> = (0..=n).map(|i| i as f64 * h).collect();
            // The sine has no curvature at 0 and pi: natural ends are its own.
            let y: Vec<f64> = x.iter().map(|x| x.sin()).collect();
            let spline = Cubic::new(&x, &y, Ends::Natural).expect("points");
            (0..1000).map(|i| f64::from(i) * 0.00314).map(|x| (spline.value(x) - x.sin()).abs()).fold(0.0, f64::max)
        };
        let slope = (error(20) / error(40)).log2();
        assert!((slope - 4.0).abs() < 0.1, "slope {slope}");
    }

    #[test]
    fn bad_points_are_named() {
        let natural = |x: &[f64], y: &[f64]| Cubic::new(x, y, Ends::Natural).expect_err("bad points");
        assert!(matches!(natural(&[0.0, 1.0], &[0.0]), Error::Shape { expected: 2, found: 1, .. }));
        assert!(matches!(natural(&[0.0], &[0.0]), Error::TooShort { found: 1, .. }));
        assert!(matches!(natural(&[0.0, 1.0], &[0.0, f64::NAN]), Error::NotFinite { row: 1, .. }));
        assert!(matches!(natural(&[0.0, 1.0, 1.0], &[0.0; 3]), Error::OutOfRange { found: 1.0, .. }));
        assert!(BSplines::new(1.0, 1.0, 4).is_err() && BSplines::new(0.0, 1.0, 0).is_err());
    }

    #[test]
    fn two_points_give_a_line() {
        let line = Cubic::new(&[1.0, 3.0], &[2.0, 6.0], Ends::Natural).expect("two points");
        assert_eq!((line.value(2.0), line.derivative(5.0)), (4.0, 2.0));
    }

    proptest! {
        #[test]
        fn natural_spline_meets_points_and_joins_smoothly(y in proptest::collection::vec(-5.0..5.0_f64, 3..30)) {
            let x: Vec<f64> = (0..y.len()).map(|i| i as f64 + 0.3 * (i as f64).sin()).collect();
            let spline = Cubic::new(&x, &y, Ends::Natural).expect("points");
            for (i, (x, y)) in x.iter().zip(&y).enumerate().skip(1).take(x.len() - 2) {
                prop_assert!((spline.value(*x) - y).abs() < 1e-10);
                let ([_, _, c2, c3], h) = (spline.pieces()[i - 1], x - spline.x[i - 1]);
                prop_assert!((c2 + 3.0 * c3 * h - spline.pieces()[i][2]).abs() < 1e-8);
                prop_assert!((spline.derivative(x - 1e-9) - spline.derivative(*x)).abs() < 1e-5);
            }
        }

        #[test]
        fn basis_sums_to_one_reproduces_lines_and_differentiates(x in -1.0..4.0_f64, pieces in 1_usize..12) {
            let basis = BSplines::new(-1.0, 4.0, pieces).expect("interval");
            let row = basis.row(x);
            prop_assert_eq!(row.len(), pieces + 3);
            prop_assert!(row.iter().all(|v| *v >= -1e-15));
            prop_assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            // Coefficients at the knot averages (Greville points) give back the line itself.
            let h = 5.0 / pieces as f64;
            let line: f64 = row.iter().enumerate().map(|(i, v)| v * (-1.0 + (i as f64 - 1.0) * h)).sum();
            prop_assert!((line - x).abs() < 1e-12 * (1.0 + h));
            let (first, slopes) = basis.derivatives(x);
            let slope: f64 = slopes.iter().enumerate().map(|(i, v)| v * ((first + i) as f64 - 1.0) * h).sum();
            prop_assert!((slope - 1.0).abs() < 1e-12 * (1.0 + h));
            let (ahead, behind) = (basis.row(x + 1e-6), basis.row(x - 1e-6));
            for i in 0..4 {
                let difference = (ahead[first + i] - behind[first + i]) / 2e-6;
                let at_an_end = !(-0.99999..3.99999).contains(&x);
                prop_assert!(at_an_end || (difference - slopes[i]).abs() < 1e-4 / h);
            }
        }

        #[test]
        fn basis_is_held_outside(x in 4.0..100.0_f64) {
            let basis = BSplines::new(-1.0, 4.0, 5).expect("interval");
            prop_assert_eq!(basis.values(x), basis.values(4.0));
            prop_assert_eq!(basis.derivatives(x + 1e-3).1, [0.0; 4]);
        }
    }
}
