//! Eigenvalues of small real matrices in buffers of their own, and both eigenvectors of the few that are asked for.
//!
//! An optimiser that moves eigenvalues needs all values but the derivative of one or two: `d lambda = y^T dA x / (y^T x)` with
//! the right and left eigenvectors `A x = lambda x`, `y^T A = lambda y^T`. Values come from the Hessenberg form by the shifted
//! QR iteration, vectors from the same form by inverse iteration, order n^2 each. [`super::eigen`] is the tool for everything
//! else; this one is several times faster for orders up to about fifty, since nothing is allocated and no vector is carried
//! along. When the iteration stalls, that tool is asked for the values.
//!
//! References: J. H. Wilkinson, *The Algebraic Eigenvalue Problem*, 1965; B. T. Smith et al., *EISPACK guide*, 1976 (`hqr`).

use super::Complex;
use crate::error::Result;

/// Iterations for one eigenvalue before the slower tool is asked.
const PATIENCE: usize = 30;

/// Buffers for matrices of one order; the Hessenberg form and eigenvalues of the last one.
#[derive(Clone, Debug, Default)]
pub struct Eigenpairs {
    n: usize,
    /// Hessenberg form (n, n); below the first subdiagonal, zeros.
    form: Vec<f64>,
    /// Reflectors: row k holds the vector of step k (unit length), zero before k + 1.
    reflectors: Vec<f64>,
    work: Vec<f64>,
    values: Vec<Complex>,
}

/// The vectors of one eigenvalue: `A x = lambda x`, `y^T A = lambda y^T` (without conjugation).
#[derive(Clone, Debug, Default)]
pub struct Pair {
    /// Right eigenvector (n).
    pub right: Vec<Complex>,
    /// Left eigenvector (n).
    pub left: Vec<Complex>,
}

impl Eigenpairs {
    /// All eigenvalues of a real matrix (n, n), row-major, in no particular order, conjugate pairs side by side.
    ///
    /// # Errors
    /// `NoConvergence` for entries that are not finite.
    pub fn values(&mut self, a: &[f64], n: usize) -> Result<&[Complex]> {
        self.n = n;
        self.form.clear();
        self.form.extend_from_slice(&a[..n * n]);
        self.reduce();
        self.work.clear();
        self.work.extend_from_slice(&self.form);
        self.values.clear();
        self.values.resize(n, Complex::new(0.0, 0.0));
        if !shifted_qr(&mut self.work, n, &mut self.values) {
            self.values = super::eigen::eigenvalues(a, n)?;
        }
        Ok(&self.values)
    }

    /// Both eigenvectors of the eigenvalue `value` of the last matrix, scaled to `y^T x = 1`. Of a multiple eigenvalue, one
    /// pair; `None` for a defective one, whose derivative does not exist.
    pub fn pair(&self, value: Complex) -> Option<Pair> {
        let Pair { right, mut left } = self.vectors(value);
        let dot: Complex = left.iter().zip(&right).map(|(y, x)| y * x).sum();
        if dot.norm().is_nan() || dot.norm() <= 1e-14 {
            return None;
        }
        left.iter_mut().for_each(|y| *y /= dot);
        Some(Pair { right, left })
    }

    /// Both eigenvectors by inverse iteration, each scaled to a largest entry near one.
    pub fn vectors(&self, value: Complex) -> Pair {
        let n = self.n;
        let size = self.form.iter().fold(0.0_f64, |m, v| m.max(v.abs())).max(f64::MIN_POSITIVE);
        let mut shifted: Vec<Complex> = self.form.iter().map(|&v| Complex::from(v)).collect();
        (0..n).for_each(|i| shifted[i * n + i] -= value);
        // LU of a Hessenberg matrix: one row interchange and one elimination per column.
        let mut swapped = vec![false; n];
        let mut factor = vec![Complex::new(0.0, 0.0); n];
        for k in 0..n {
            if k + 1 < n && shifted[(k + 1) * n + k].norm_sqr() > shifted[k * n + k].norm_sqr() {
                swapped[k] = true;
                for j in k..n {
                    shifted.swap(k * n + j, (k + 1) * n + j);
                }
            }
            if shifted[k * n + k].norm() < f64::EPSILON * size {
                shifted[k * n + k] = Complex::from(f64::EPSILON * size);
            }
            if k + 1 < n {
                let ratio = shifted[(k + 1) * n + k] / shifted[k * n + k];
                factor[k] = ratio;
                for j in k + 1..n {
                    let above = shifted[k * n + j];
                    shifted[(k + 1) * n + j] -= ratio * above;
                }
            }
        }
        let mut right = vec![Complex::from(1.0); n];
        let mut left = right.clone();
        for _ in 0..2 {
            for k in 0..n.saturating_sub(1) {
                if swapped[k] {
                    right.swap(k, k + 1);
                }
                let above = right[k];
                right[k + 1] -= factor[k] * above;
            }
            for k in (0..n).rev() {
                let sum: Complex = (k + 1..n).map(|j| shifted[k * n + j] * right[j]).sum();
                right[k] = (right[k] - sum) / shifted[k * n + k];
            }
            for k in 0..n {
                let own = left[k] / shifted[k * n + k];
                left[k] = own;
                for j in k + 1..n {
                    left[j] -= shifted[k * n + j] * own;
                }
            }
            for k in (0..n.saturating_sub(1)).rev() {
                let below = left[k + 1];
                left[k] -= factor[k] * below;
                if swapped[k] {
                    left.swap(k, k + 1);
                }
            }
            normalise(&mut right);
            normalise(&mut left);
        }
        self.turn_back(&mut right);
        self.turn_back(&mut left);
        Pair { right, left }
    }

    /// Householder reduction to Hessenberg form.
    fn reduce(&mut self) {
        let n = self.n;
        self.reflectors.clear();
        self.reflectors.resize(n * n, 0.0);
        let mut row = vec![0.0; n];
        for k in 0..n.saturating_sub(2) {
            let tail: f64 = (k + 2..n).map(|i| self.form[i * n + k].powi(2)).sum();
            if tail == 0.0 {
                continue;
            }
            let first = self.form[(k + 1) * n + k];
            let norm = (first * first + tail).sqrt();
            let head = first + norm.copysign(first);
            let scale = 1.0 / (head * head + tail).sqrt();
            let v = &mut self.reflectors[k * n..(k + 1) * n];
            v[k + 1] = head * scale;
            for i in k + 2..n {
                v[i] = self.form[i * n + k] * scale;
            }
            // from the left: rows k+1.., all columns from k on
            row[k..].fill(0.0);
            for i in k + 1..n {
                let weight = 2.0 * v[i];
                let line = &self.form[i * n..(i + 1) * n];
                row[k..].iter_mut().zip(&line[k..]).for_each(|(r, a)| *r += weight * a);
            }
            for i in k + 1..n {
                let weight = v[i];
                let line = &mut self.form[i * n..(i + 1) * n];
                line[k..].iter_mut().zip(&row[k..]).for_each(|(a, r)| *a -= weight * r);
            }
            for i in k + 2..n {
                self.form[i * n + k] = 0.0;
            }
            // from the right: all rows, columns k+1..
            for line in self.form.chunks_exact_mut(n) {
                let dot: f64 = line[k + 1..].iter().zip(&v[k + 1..]).map(|(a, v)| a * v).sum();
                line[k + 1..].iter_mut().zip(&v[k + 1..]).for_each(|(a, v)| *a -= 2.0 * dot * v);
            }
        }
    }

    /// From the coordinates of the Hessenberg form to those of the matrix.
    fn turn_back(&self, x: &mut [Complex]) {
        for v in self.reflectors.chunks_exact(self.n).rev() {
            let dot: Complex = x.iter().zip(v).map(|(x, v)| x * *v).sum();
            x.iter_mut().zip(v).for_each(|(x, v)| *x -= dot * (2.0 * v));
        }
    }
}

fn normalise(x: &mut [Complex]) {
    let largest = x.iter().fold(0.0_f64, |m, v| m.max(v.norm_sqr())).sqrt();
    if largest > 0.0 {
        x.iter_mut().for_each(|v| *v /= largest);
    }
}

/// Francis' double-shift QR on an upper Hessenberg matrix, eigenvalues only. False when it stalls.
fn shifted_qr(h: &mut [f64], n: usize, values: &mut [Complex]) -> bool {
    let norm: f64 = h.iter().map(|v| v.abs()).sum();
    if !norm.is_finite() {
        return false;
    }
    let mut shift = 0.0;
    let mut left = n;
    while left > 0 {
        let last = left - 1;
        let mut iterations = 0;
        loop {
            let mut l = last;
            while l > 0 {
                let s = h[(l - 1) * n + l - 1].abs() + h[l * n + l].abs();
                let s = if s == 0.0 { norm } else { s };
                if h[l * n + l - 1].abs() <= f64::EPSILON * s {
                    h[l * n + l - 1] = 0.0;
                    break;
                }
                l -= 1;
            }
            let mut x = h[last * n + last];
            if l == last {
                values[last] = Complex::from(x + shift);
                left -= 1;
                break;
            }
            let mut y = h[(last - 1) * n + last - 1];
            let mut w = h[last * n + last - 1] * h[(last - 1) * n + last];
            if l + 1 == last {
                [values[last - 1], values[last]] = two_by_two(x, y, w, shift);
                left -= 2;
                break;
            }
            if iterations == PATIENCE {
                return false;
            }
            if iterations == 10 || iterations == 20 {
                shift += x;
                (0..=last).for_each(|i| h[i * n + i] -= x);
                let s = h[last * n + last - 1].abs() + h[(last - 1) * n + last - 2].abs();
                x = 0.75 * s;
                y = x;
                w = -0.4375 * s * s;
            }
            iterations += 1;
            sweep(h, n, l, last, (x, y, w));
        }
    }
    true
}

/// Eigenvalues of the last two rows: diagonal `y`, `x`, product of the others `w`.
fn two_by_two(x: f64, y: f64, w: f64, shift: f64) -> [Complex; 2] {
    let p = 0.5 * (y - x);
    let q = p * p + w;
    let root = q.abs().sqrt();
    let x = x + shift;
    if q < 0.0 {
        return [Complex::new(x + p, root), Complex::new(x + p, -root)];
    }
    let z = p + root.copysign(p);
    [Complex::from(x + z), Complex::from(if z == 0.0 { x + z } else { x - w / z })]
}

/// One double step on rows and columns `l..=last`.
fn sweep(h: &mut [f64], n: usize, l: usize, last: usize, (x, y, w): (f64, f64, f64)) {
    let (mut p, mut q, mut r);
    let mut m = last - 2;
    loop {
        let z = h[m * n + m];
        let (a, b) = (x - z, y - z);
        p = (a * b - w) / h[(m + 1) * n + m] + h[m * n + m + 1];
        q = h[(m + 1) * n + m + 1] - z - a - b;
        r = h[(m + 2) * n + m + 1];
        let s = p.abs() + q.abs() + r.abs();
        (p, q, r) = (p / s, q / s, r / s);
        if m == l {
            break;
        }
        let u = h[m * n + m - 1].abs() * (q.abs() + r.abs());
        let v = p.abs() * (h[(m - 1) * n + m - 1].abs() + z.abs() + h[(m + 1) * n + m + 1].abs());
        if u <= f64::EPSILON * v {
            break;
        }
        m -= 1;
    }
    for i in m + 2..=last {
        h[i * n + i - 2] = 0.0;
        if i > m + 2 {
            h[i * n + i - 3] = 0.0;
        }
    }
    let mut x = 0.0;
    for k in m..last {
        let three = k + 1 < last;
        if k > m {
            p = h[k * n + k - 1];
            q = h[(k + 1) * n + k - 1];
            r = if three { h[(k + 2) * n + k - 1] } else { 0.0 };
            x = p.abs() + q.abs() + r.abs();
            if x == 0.0 {
                continue;
            }
            (p, q, r) = (p / x, q / x, r / x);
        }
        let s = (p * p + q * q + r * r).sqrt().copysign(p);
        if s == 0.0 {
            continue;
        }
        if k > m {
            h[k * n + k - 1] = -s * x;
        } else if l != m {
            h[k * n + k - 1] = -h[k * n + k - 1];
        }
        p += s;
        let (a, b, c) = (p / s, q / s, r / s);
        q /= p;
        r /= p;
        let (above, below) = h.split_at_mut((k + 1) * n);
        let first = &mut above[k * n..];
        if three {
            let (second, rest) = below.split_at_mut(n);
            for ((f, s), t) in first[k..=last].iter_mut().zip(&mut second[k..=last]).zip(&mut rest[k..=last]) {
                let dot = *f + q * *s + r * *t;
                *f -= dot * a;
                *s -= dot * b;
                *t -= dot * c;
            }
        } else {
            for (f, s) in first[k..=last].iter_mut().zip(&mut below[k..=last]) {
                let dot = *f + q * *s;
                *f -= dot * a;
                *s -= dot * b;
            }
        }
        let end = last.min(k + 3);
        for line in h[l * n..(end + 1) * n].chunks_exact_mut(n) {
            if three {
                let dot = a * line[k] + b * line[k + 1] + c * line[k + 2];
                line[k] -= dot;
                line[k + 1] -= dot * q;
                line[k + 2] -= dot * r;
            } else {
                let dot = a * line[k] + b * line[k + 1];
                line[k] -= dot;
                line[k + 1] -= dot * q;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::eigen::eigenvalues;
    use crate::numeric::rng::SplitMix64;

    fn random(n: usize, seed: u64) -> Vec<f64> {
        let mut random = SplitMix64::new(seed);
        (0..n * n).map(|_| random.normal()).collect()
    }

    #[test]
    fn values_are_those_of_faer() {
        let mut pairs = Eigenpairs::default();
        for n in 1..25 {
            let a = random(n, n as u64);
            let expected = eigenvalues(&a, n).expect("eigenvalues");
            let found = pairs.values(&a, n).expect("eigenvalues").to_vec();
            for value in &expected {
                let nearest = found.iter().map(|f| (f - value).norm()).fold(f64::MAX, f64::min);
                assert!(nearest < 1e-11, "{n}: {value} {nearest}");
            }
            for (k, value) in found.iter().enumerate() {
                assert!(found.iter().any(|f| (f - value.conj()).norm() < 1e-11), "{n}, {k}");
            }
        }
    }

    #[test]
    fn vectors_satisfy_their_equations() {
        let mut pairs = Eigenpairs::default();
        for n in [1, 2, 5, 12, 20] {
            let a = random(n, 7 + n as u64);
            for value in pairs.values(&a, n).expect("eigenvalues").to_vec() {
                let Pair { right, left } = pairs.pair(value).expect("simple eigenvalues");
                for i in 0..n {
                    let ax: Complex = (0..n).map(|j| right[j] * a[i * n + j]).sum();
                    let ya: Complex = (0..n).map(|j| left[j] * a[j * n + i]).sum();
                    let size = left.iter().fold(0.0_f64, |m, v| m.max(v.norm()));
                    assert!((ax - value * right[i]).norm() < 1e-12, "{n}");
                    assert!((ya - value * left[i]).norm() < 1e-12 * size, "{n}");
                }
            }
        }
    }

    #[test]
    fn hard_cases_end() {
        let mut pairs = Eigenpairs::default();
        // a cyclic permutation, on which unshifted double steps stand still
        let cyclic = [0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        assert!(pairs.values(&cyclic, 4).expect("eigenvalues").iter().all(|v| (v.norm() - 1.0).abs() < 1e-14));
        assert!(pairs.values(&[0.0; 9], 3).expect("eigenvalues").iter().all(|v| v.norm() == 0.0));
        assert!(pairs.values(&[f64::NAN; 9], 3).is_err());
        pairs.values(&[1.0, 1.0, 0.0, 1.0], 2).expect("eigenvalues");
        assert!(pairs.pair(Complex::from(1.0)).is_none(), "a defective eigenvalue has no derivative");
    }
}
