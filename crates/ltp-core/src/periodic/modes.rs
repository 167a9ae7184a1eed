//! Which eigenvalues of a truncated harmonic state space are copies of Floquet exponents, and which artefacts of its edge.
//!
//! The infinite lift has the eigenvalues `lambda_i + j n w`, each exponent once per harmonic. Truncation keeps `(2N+1) nx`
//! numbers: those whose eigenvectors have died out before the outermost blocks are copies to rounding, those that live there
//! lack what the cut blocks would feed back, by an amount that does not shrink as N grows, since the edge moves with them.
//! So an eigenvalue is held against the exact exponents, each copy is given to one eigenvalue only (the nearest), and it
//! counts as converged when it stands at its copy to five digits of the exponent. The share of its eigenvector in the outermost
//! blocks is reported beside it: a second measure, which knows nothing of Floquet.
//!
//! Reference: J. Zhou, T. Hagiwara, M. Araki, *Spectral characteristics and eigenvalues computation of the harmonic state
//! operators in continuous-time periodic systems*, Syst. Control Lett. 53 (2004).

use super::exponents::nearest_copy;
use super::system::LtpSystem;
use crate::error::Result;
use crate::numeric::Complex;
use crate::numeric::eigen::eigenpairs;

/// Distance to its copy, in shares of the exponent's modulus, up to which an eigenvalue counts as converged: five digits.
pub const CONVERGED: f64 = 1e-5;
/// Share of the pumping frequency that stands in for the modulus of an exponent near zero.
const FLOOR: f64 = 1e-3;

/// One eigenvalue of a truncated lift.
#[derive(Clone, Debug, PartialEq)]
pub struct LiftedMode {
    /// The eigenvalue, 1/s.
    pub value: Complex,
    /// The exponent nearest to it up to multiples of `j w`, as a place in [`LtpSystem::exponents`].
    pub exponent: usize,
    /// Its copy: `exponent + j n w` with this n.
    pub copy: i64,
    /// Distance to that copy, 1/s.
    pub distance: f64,
    /// Share of the eigenvector's squared length in the outermost blocks of both sides, in [0, 1]: `d` on each side, with `d`
    /// the [`LtpSystem::pumping_divisor`], since blocks of different remainder by `d` know nothing of each other.
    pub edge: f64,
    /// Whether it is a copy of that exponent; if not, it is an artefact of the edge.
    pub converged: bool,
}

impl LtpSystem {
    /// Every eigenvalue of the lift with blocks -N..=N, (2N+1) nx of them, largest real part first, held against the exact
    /// Floquet exponents.
    ///
    /// # Errors
    /// As [`LtpSystem::lift`], [`LtpSystem::exponents`] and [`LtpSystem::check_truncation`].
    pub fn lifted_modes(&self, truncation: usize) -> Result<Vec<LiftedMode>> {
        self.check_truncation(truncation)?;
        let (nx, blocks) = (self.size().nx, 2 * truncation + 1);
        let (exponents, rim) = (self.exponents()?, self.pumping_divisor());
        let pairs = eigenpairs(&self.lift(truncation)?, blocks * nx)?;
        let nearest = |value: Complex| {
            let copies = exponents.iter().enumerate().map(|(i, &e)| (i, nearest_copy(value, e, self.period())));
            copies.min_by(|a, b| a.1.1.total_cmp(&b.1.1)).map_or((0, 0, f64::INFINITY), |(i, (n, d))| (i, n, d))
        };
        let mut modes: Vec<LiftedMode> = pairs
            .iter()
            .map(|(value, vector)| {
                let (exponent, copy, distance) = nearest(*value);
                let length =
                    |block: usize| vector[block * nx..(block + 1) * nx].iter().map(|v| v.norm_sqr()).sum::<f64>();
                let edge = (0..blocks).filter(|&k| k.min(blocks - 1 - k) < rim).map(length).sum();
                LiftedMode { value: *value, exponent, copy, distance, edge, converged: false }
            })
            .collect();
        // The nearest eigenvalue has the copy; exponents that coincide have one each, by their own distances.
        let mut claims: Vec<(f64, usize, usize, i64)> = Vec::new();
        for (m, mode) in modes.iter().enumerate() {
            for (i, &exponent) in exponents.iter().enumerate() {
                let (copy, distance) = nearest_copy(mode.value, exponent, self.period());
                if distance <= CONVERGED * exponent.norm().max(FLOOR * self.pumping()) {
                    claims.push((distance, m, i, copy));
                }
            }
        }
        claims.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut taken = std::collections::HashSet::new();
        for (distance, m, exponent, copy) in claims {
            if !modes[m].converged && taken.insert((exponent, copy)) {
                modes[m] = LiftedMode { exponent, copy, distance, converged: true, ..modes[m] };
            }
        }
        Ok(modes)
    }
}
