//! Gauss-Legendre nodes, and what collocation on them needs: quadrature, integration up to a node, interpolation.
//!
//! Everything refers to the interval [0, 1]. An implicit Runge-Kutta method with the `integral` matrix has order `2q` at the
//! end of a step (Hairer & Wanner, *Solving Ordinary Differential Equations II*, section IV.5).

/// Gauss-Legendre rule with `q` nodes.
#[derive(Clone, Debug)]
pub struct Gauss {
    /// Nodes (q), increasing, in (0, 1).
    pub nodes: Vec<f64>,
    /// Quadrature weights (q), with sum 1.
    pub weights: Vec<f64>,
    /// `integral[i*q + j]`: integral of the `j`-th Lagrange polynomial from 0 to node `i`.
    pub integral: Vec<f64>,
    barycentric: Vec<f64>,
}

impl Gauss {
    /// The rule with `q >= 1` nodes.
    pub fn new(q: usize) -> Self {
        let (nodes, weights) = rule(q);
        let barycentric =
            (0..q).map(|j| (0..q).filter(|&k| k != j).map(|k| 1.0 / (4.0 * (nodes[j] - nodes[k]))).product()).collect();
        let mut gauss = Self { nodes, weights, integral: vec![0.0; q * q], barycentric };
        // Polynomials of degree q-1 up to a node: q nodes within [0, node] integrate them exactly.
        let mut basis = vec![0.0; q];
        for i in 0..q {
            let end = gauss.nodes[i];
            for m in 0..q {
                gauss.basis(end * gauss.nodes[m], &mut basis);
                for j in 0..q {
                    gauss.integral[i * q + j] += end * gauss.weights[m] * basis[j];
                }
            }
        }
        gauss
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Never: a rule has nodes.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Values of the Lagrange polynomials (q) at `s`, by the barycentric formula.
    pub fn basis(&self, s: f64, out: &mut [f64]) {
        if let Some(hit) = self.nodes.iter().position(|&n| n == s) {
            out.fill(0.0);
            out[hit] = 1.0;
            return;
        }
        let mut sum = 0.0;
        for ((o, w), n) in out.iter_mut().zip(&self.barycentric).zip(&self.nodes) {
            *o = w / (s - n);
            sum += *o;
        }
        for o in out.iter_mut() {
            *o /= sum;
        }
    }

    /// Size of the two highest Legendre coefficients of a function given at the nodes, against its largest value: how far it
    /// is from a polynomial that the nodes resolve.
    pub fn tail(&self, values: &[f64]) -> f64 {
        let q = self.len();
        let largest = values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        if largest == 0.0 || q < 3 {
            return 0.0;
        }
        let coefficient = |degree: usize| {
            let sum: f64 =
                (0..q).map(|i| self.weights[i] * legendre(degree, 2.0 * self.nodes[i] - 1.0).0 * values[i]).sum();
            ((2 * degree + 1) as f64 * sum).abs()
        };
        coefficient(q - 1).max(coefficient(q - 2)) / largest
    }
}

/// Legendre polynomial of a degree, and its derivative.
fn legendre(degree: usize, x: f64) -> (f64, f64) {
    let (mut before, mut now) = (0.0, 1.0);
    for k in 0..degree {
        let next = ((2 * k + 1) as f64 * x * now - k as f64 * before) / (k + 1) as f64;
        (before, now) = (now, next);
    }
    (now, degree as f64 * (x * now - before) / (x * x - 1.0))
}

/// Nodes and weights on [0, 1] by Newton's method from the asymptotic zeros.
fn rule(q: usize) -> (Vec<f64>, Vec<f64>) {
    let pairs = (0..q).rev().map(|i| {
        let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (q as f64 + 0.5)).cos();
        for _ in 0..100 {
            let (p, slope) = legendre(q, x);
            x -= p / slope;
            if (p / slope).abs() < 1e-16 {
                break;
            }
        }
        let slope = legendre(q, x).1;
        (0.5 * (1.0 + x), 1.0 / ((1.0 - x * x) * slope * slope))
    });
    pairs.unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrates_polynomials_of_degree_2q_minus_1() {
        for q in 1..=16 {
            let g = Gauss::new(q);
            for degree in 0..2 * q {
                let sum: f64 = g.nodes.iter().zip(&g.weights).map(|(x, w)| w * x.powi(degree as i32)).sum();
                assert!((sum - 1.0 / (degree + 1) as f64).abs() < 1e-14, "q {q}, degree {degree}: {sum}");
            }
        }
    }

    #[test]
    fn integrates_up_to_a_node_and_interpolates() {
        let g = Gauss::new(9);
        let f = |x: f64| 1.0 - 3.0 * x.powi(5) + x.powi(8);
        let integral = |x: f64| x - 0.5 * x.powi(6) + x.powi(9) / 9.0;
        let values: Vec<f64> = g.nodes.iter().map(|&x| f(x)).collect();
        for i in 0..9 {
            let sum: f64 = (0..9).map(|j| g.integral[i * 9 + j] * values[j]).sum();
            assert!((sum - integral(g.nodes[i])).abs() < 1e-14);
        }
        let mut basis = vec![0.0; 9];
        for s in [0.0, 0.3, g.nodes[4], 1.0] {
            g.basis(s, &mut basis);
            let sum: f64 = basis.iter().zip(&values).map(|(b, v)| b * v).sum();
            assert!((sum - f(s)).abs() < 1e-13, "{s}");
        }
    }

    #[test]
    fn tail_tells_resolved_from_unresolved() {
        let g = Gauss::new(12);
        let at = |f: &dyn Fn(f64) -> f64| g.tail(&g.nodes.iter().map(|&x| f(x)).collect::<Vec<_>>());
        // 21 j_10(1/2) = 1.5e-12: the coefficient of degree 10 in closed form.
        let tail = at(&|x| (0.5 + x).cos());
        assert!(tail > 1e-13 && tail < 2e-12, "{tail}");
        assert!(at(&|x| (40.0 * x).sin()) > 1e-3);
    }
}
