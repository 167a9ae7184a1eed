//! Propagation of a linear time-periodic system by collocation on Gauss nodes.
//!
//! On a part of a segment, `x_i = x_s + h sum_j a_ij (A_j x_j + B_j u_j)` is linear in the state at the start and in the
//! inputs at the nodes: both maps are found once and serve every input. The order is `2q` at the end of a part and about `q`
//! at its nodes, so parts are made short enough for the frequencies asked for.

use nalgebra::DMatrix;

use super::system::{Entry, LtpSystem, NODES, Segment, Size};
use crate::numeric::gauss::Gauss;

/// Angle (rad) that the fastest oscillation may turn by in one part: with 12 nodes the error at a node is 1e-13 of it.
const TURN: f64 = 1.6;

/// Maps of one part, row-major.
pub(super) struct Part {
    /// Start of the part, s.
    pub start: f64,
    /// Length, s.
    pub length: f64,
    /// State at the end by state at the start (nx, nx).
    pub end_state: Vec<f64>,
    /// State at the end by inputs at the nodes (nx, q*nu).
    pub end_input: Vec<f64>,
    /// Outputs at the nodes by state at the start (q*ny, nx).
    pub output_state: Vec<f64>,
    /// Outputs at the nodes by inputs at the nodes (q*ny, q*nu).
    pub output_input: Vec<f64>,
    /// Jumps follow this part: the segment's index.
    pub jumps: Option<usize>,
}

/// One period, cut into parts.
pub(super) struct Propagation {
    pub size: Size,
    pub parts: Vec<Part>,
    jump_states: Vec<Option<Vec<f64>>>,
}

impl Propagation {
    /// Parts short enough for signals up to the angular frequency `fastest`, rad/s.
    pub fn new(system: &LtpSystem, fastest: f64) -> Self {
        let gauss = system.gauss();
        let mut parts = Vec::new();
        for (k, segment) in system.segments().iter().enumerate() {
            let length = segment.end - segment.start;
            let own = fastest_rate(system, segment);
            let count = ((own + fastest) * length / TURN).ceil().max(1.0) as usize;
            for i in 0..count {
                let mut part = part(system, gauss, segment, i as f64 / count as f64, length / count as f64);
                part.jumps = (i + 1 == count && !segment.jumps.is_empty()).then_some(k);
                parts.push(part);
            }
        }
        let jump_states = system.segments().iter().map(|s| system.jump_product(s)).collect();
        Self { size: system.size(), parts, jump_states }
    }

    /// Times of all nodes in order, s.
    pub fn times<'a>(&'a self, nodes: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        self.parts.iter().flat_map(move |p| nodes.iter().map(move |n| p.start + n * p.length))
    }

    /// Monodromy matrix (nx, nx).
    pub fn monodromy(&self) -> Vec<f64> {
        let nx = self.size.nx;
        let mut all: Vec<f64> = (0..nx * nx).map(|i| if i % (nx + 1) == 0 { 1.0 } else { 0.0 }).collect();
        for part in &self.parts {
            all = product(&part.end_state, &all, nx, nx);
            if let Some(jump) = part.jumps.and_then(|k| self.jump_states[k].as_ref()) {
                all = product(jump, &all, nx, nx);
            }
        }
        all
    }
}

/// Angle (rad) that the fastest motion of a system may turn by in one period.
pub(super) fn turned(system: &LtpSystem) -> f64 {
    system.segments().iter().map(|s| fastest_rate(system, s) * (s.end - s.start)).sum()
}

/// Bound of the spectral radius of `A` on a segment, rad/s.
fn fastest_rate(system: &LtpSystem, segment: &Segment) -> f64 {
    let nx = system.size().nx;
    (0..NODES).map(|i| rate(&segment.a[i * nx * nx..], nx)).fold(0.0, f64::max)
}

/// Matrix product (rows, inner) (inner, ·), row-major.
pub(super) fn product(left: &[f64], right: &[f64], rows: usize, inner: usize) -> Vec<f64> {
    let columns = right.len() / inner;
    let mut out = vec![0.0; rows * columns];
    for i in 0..rows {
        for k in 0..inner {
            let factor = left[i * inner + k];
            for j in 0..columns {
                out[i * columns + j] += factor * right[k * columns + j];
            }
        }
    }
    out
}

/// A bound of the spectral radius of `A`, tight for oscillators whatever the units of their states: the least over powers of
/// the norm of `A^m`, to the power `1/m`.
pub(super) fn rate(a: &[f64], nx: usize) -> f64 {
    let mut power = a[..nx * nx].to_vec();
    let norm = |m: &[f64]| m.iter().map(|v| v * v).sum::<f64>().sqrt();
    let mut least = norm(&power);
    let mut exponent = 1;
    for _ in 0..5 {
        power = product(&power, &power, nx, nx);
        exponent *= 2;
        let bound = norm(&power).powf(1.0 / f64::from(exponent));
        if !bound.is_finite() {
            break;
        }
        least = least.min(bound);
    }
    least
}

fn part(system: &LtpSystem, gauss: &Gauss, segment: &Segment, theta: f64, h: f64) -> Part {
    let Size { nx, nu, ny } = system.size();
    let whole = segment.end - segment.start;
    let (q, n) = (NODES, NODES * nx);
    let mut m = [vec![], vec![], vec![], vec![]];
    let at_nodes: Vec<[Vec<f64>; 4]> = (0..q)
        .map(|i| {
            for (entry, out) in [Entry::A, Entry::B, Entry::C, Entry::D].into_iter().zip(&mut m) {
                system.at(segment, theta + gauss.nodes[i] * h / whole, entry, out);
            }
            m.clone()
        })
        .collect();
    // (I - h a (x) A) X = 1 (x) x_s + h (a (x) B) U
    let mut left = DMatrix::<f64>::identity(n, n);
    let mut right = DMatrix::<f64>::zeros(n, nx + q * nu);
    for i in 0..q {
        for r in 0..nx {
            right[(i * nx + r, r)] = 1.0;
        }
        for j in 0..q {
            let w = h * gauss.integral[i * q + j];
            let [a, b, ..] = &at_nodes[j];
            for r in 0..nx {
                for c in 0..nx {
                    left[(i * nx + r, j * nx + c)] -= w * a[r * nx + c];
                }
                for c in 0..nu {
                    right[(i * nx + r, nx + j * nu + c)] = w * b[r * nu + c];
                }
            }
        }
    }
    let x =
        left.lu().solve(&right).expect("parts are short against the fastest rate, so the matrix is near the identity");
    let columns = nx + q * nu;
    let mut end = DMatrix::<f64>::zeros(nx, columns);
    let mut out = DMatrix::<f64>::zeros(q * ny, columns);
    for r in 0..nx {
        end[(r, r)] = 1.0;
    }
    for j in 0..q {
        let w = h * gauss.weights[j];
        let [a, b, c, d] = &at_nodes[j];
        for col in 0..columns {
            for k in 0..nx {
                let state = x[(j * nx + k, col)];
                for r in 0..nx {
                    end[(r, col)] += w * a[r * nx + k] * state;
                }
                for r in 0..ny {
                    out[(j * ny + r, col)] += c[r * nx + k] * state;
                }
            }
        }
        for col in 0..nu {
            for r in 0..nx {
                end[(r, nx + j * nu + col)] += w * b[r * nu + col];
            }
            for r in 0..ny {
                out[(j * ny + r, nx + j * nu + col)] += d[r * nu + col];
            }
        }
    }
    let rows = |m: &DMatrix<f64>, from: usize, count: usize| -> Vec<f64> {
        (0..m.nrows()).flat_map(|r| (from..from + count).map(move |c| (r, c))).map(|at| m[at]).collect()
    };
    Part {
        start: segment.start + theta * whole,
        length: h,
        end_state: rows(&end, 0, nx),
        end_input: rows(&end, nx, q * nu),
        output_state: rows(&out, 0, nx),
        output_input: rows(&out, nx, q * nu),
        jumps: None,
    }
}
