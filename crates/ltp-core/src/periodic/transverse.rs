//! Transverse linearization: the dynamics across an orbit, without the phase along it.
//!
//! With the unit tangent `tau` of the orbit and an orthonormal frame `Z(t)` of what stands across it, `xi = Z^T x` obeys
//! `xi' = Z^T (A Z - Z') xi + Z^T B u`. The frame is carried by parallel transport, `Z' = (tau' tau^T - tau tau'^T) Z`, which
//! brings it back turned by the holonomy `H = exp(L)`; the turn is spread over the period, `Z(t) exp(-L t / T)`, so that the
//! frame is periodic, and then `A_perp = Z^T A Z + L / T`. A closed curve has an orientable normal bundle, so `L` is real.
//! The exponents of the transverse system are those of the orbit but for the phase.
//!
//! References: J. K. Hale, *Ordinary Differential Equations*, 1980, section VI.1; A. Shiriaev, L. Freidovich, S. Gusev, IEEE
//! Trans. Automat. Control 55 (2010); R. L. Bishop, Amer. Math. Monthly 82 (1975) (parallel frames).

use nalgebra::{DMatrix, DVector, Schur};

use super::smooth::Values;
use super::system::{Entry, LtpSystem, NODES, Size};
use crate::error::{Error, Result};
use crate::numeric::Complex;
use crate::numeric::fourier_series::FourierSeries;
use crate::numeric::gauss::Gauss;
use crate::numeric::matrix_function::exponential;

/// Distance of a multiplier from one up to which it is taken for the phase of an orbit without a clock.
const PHASE: f64 = 1e-6;
/// Share of the largest coefficient below which harmonics of the frame are rounding.
const ROUNDING: f64 = 1e-13;
/// Samples a period, at most, for tangent and frame.
const SAMPLES: usize = 4096;
/// Share of the tangent's rate that may be left across the orbit before it is said.
const DEFECT: f64 = 1e-6;

/// A system across an orbit, with the frame that leads there.
#[derive(Clone, Debug)]
pub struct Transverse {
    /// `xi' = A_perp xi + B_perp u`, `y = C Z xi + D u`: one state less.
    pub system: LtpSystem,
    /// Z(t), (nx, nx - 1) row-major, with orthonormal columns.
    pub frame: FourierSeries,
    /// The tangent (nx) that was used: given, or of the phase mode, with length one at the start.
    pub tangent: FourierSeries,
    /// Largest part of `q' - A q` across the orbit, relative to the largest rate of the tangent `q`: zero for the derivative of
    /// an orbit without a clock.
    pub defect: f64,
    /// Doubts, with numbers and advice.
    pub warnings: Vec<String>,
}

impl LtpSystem {
    /// The system across its orbit, with `tangent` (nx) the derivative of the orbit by time; without one, the tangent is the
    /// mode of the Floquet multiplier one, which an orbit without a clock has.
    ///
    /// # Errors
    /// `Model` for a system with jumps, or without a tangent and without a multiplier one; `Shape` and `OutOfRange` for a
    /// tangent with other rows or another period, or that vanishes somewhere; `NoConvergence` when it takes more than 1024
    /// harmonics.
    pub fn transverse(&self, tangent: Option<&FourierSeries>) -> Result<Transverse> {
        let nx = self.size().nx;
        if let Some(jump) = self.jumps().next() {
            let message =
                format!("the state jumps (`{}`): a smooth frame cannot follow; cut the orbit there", jump.name);
            return Err(Error::Model { path: "transverse".into(), message });
        }
        if nx < 2 {
            let expected = "at least two: nothing stands across an orbit of one state".into();
            return Err(Error::OutOfRange { what: "number of states".into(), found: nx as f64, expected });
        }
        let tangent = match tangent {
            Some(given) if given.rows() != nx => {
                return Err(Error::Shape { what: "rows of the tangent".into(), expected: nx, found: given.rows() });
            }
            Some(given) if (given.period() / self.period() - 1.0).abs() > 1e-9 => {
                let (what, expected) = ("period of the tangent".into(), format!("{} s, the system's", self.period()));
                return Err(Error::OutOfRange { what, found: given.period(), expected });
            }
            Some(given) => given.clone(),
            None => self.phase_mode()?,
        };
        let slope = tangent.derivative();
        let largest = tangent.samples(64).chunks(nx).map(norm).fold(0.0, f64::max);
        let smallest = tangent.samples(256).chunks(nx).map(norm).fold(f64::INFINITY, f64::min);
        if smallest <= 1e-6 * largest {
            let expected = format!(
                "well above zero (its largest is {largest:.3e}): where the orbit stands still nothing stands across it; \
                 scale the states or choose another tangent"
            );
            return Err(Error::OutOfRange { what: "smallest length of the tangent".into(), found: smallest, expected });
        }
        let unit = |t: f64| -> (DVector<f64>, DVector<f64>) {
            let (q, r) = (DVector::from_vec(tangent.value(t)), DVector::from_vec(slope.value(t)));
            let length = q.norm();
            let tau = q / length;
            let turn = (&r - &tau * tau.dot(&r)) / length;
            (tau, turn)
        };
        let carried = Self::smooth(self.period(), Size { nx, nu: 0, ny: 0 }, |t, entry| match entry {
            Entry::A => {
                let (tau, turn) = unit(t);
                rows(&(&turn * tau.transpose() - &tau * turn.transpose()))
            }
            _ => vec![],
        })?;
        let flow = Flow::new(&carried)?;
        let first = across(&unit(0.0).0);
        let turned = first.transpose() * &flow.whole * &first;
        let turn = rotation_logarithm(turned).ok_or_else(|| Error::NoConvergence {
            method: "logarithm of the holonomy".into(),
            iterations: 100 * nx,
            residual: f64::NAN,
            advice: "check that the tangent is finite and turns smoothly".into(),
        })?;
        let period = self.period();
        let spread = |t: f64| -> DMatrix<f64> {
            let back: Vec<Complex> = (&turn * (-t / period)).transpose().iter().map(|&v| Complex::from(v)).collect();
            DMatrix::from_row_iterator(nx - 1, nx - 1, exponential(&back, nx - 1).into_iter().map(|v| v.re))
        };
        let frame = series(period, nx * (nx - 1), |t| rows(&(flow.at(t) * &first * spread(t))))?;

        let Size { nu, ny, .. } = self.size();
        let rate = rows(&(&turn / period));
        let z = |t: f64| DMatrix::from_row_slice(nx, nx - 1, &frame.value(t));
        let system = self.rebuilt(
            Size { nx: nx - 1, nu, ny },
            |_| vec![],
            |t, [a, b, c, d]| -> Values {
                let z = z(t);
                let whole = |m: &[f64], height: usize, width: usize| DMatrix::from_row_slice(height, width, m);
                let mut own = rows(&(z.transpose() * whole(&a, nx, nx) * &z));
                own.iter_mut().zip(&rate).for_each(|(o, r)| *o += r);
                [own, rows(&(z.transpose() * whole(&b, nx, nu))), rows(&(whole(&c, ny, nx) * &z)), d]
            },
        )?;
        let (mut defect, mut fastest) = (0.0_f64, 0.0_f64);
        for i in 0..64 {
            let t = period * f64::from(i) / 64.0;
            let (q, r) = (DVector::from_vec(tangent.value(t)), DVector::from_vec(slope.value(t)));
            let left = &r - DMatrix::from_row_slice(nx, nx, &self.matrix(Entry::A, t)) * q;
            defect = defect.max((z(t).transpose() * left).norm());
            fastest = fastest.max(r.norm());
        }
        defect /= fastest.max(f64::MIN_POSITIVE);
        let mut warnings = Vec::new();
        if defect > DEFECT {
            warnings.push(format!(
                "the tangent is no motion of the system: {defect:.1e} of its rate points across the orbit. Either a clock \
                 drives the orbit (an input that depends on time has to follow the phase instead), or it is not the \
                 derivative of the orbit that A belongs to"
            ));
        }
        Ok(Transverse { system, frame, tangent, defect, warnings })
    }

    /// The periodic motion of the Floquet multiplier one.
    fn phase_mode(&self) -> Result<FourierSeries> {
        let nx = self.size().nx;
        let one = Complex::new(1.0, 0.0);
        let nearest = self.multipliers().iter().min_by(|a, b| (*a - one).norm().total_cmp(&(*b - one).norm()));
        let multiplier = nearest.copied().unwrap_or_default();
        if (multiplier - one).norm() > PHASE || multiplier.im != 0.0 {
            let message = format!(
                "no Floquet multiplier is one (the nearest is {:.9} {:+.9}j): the orbit has a clock, and so no phase of its \
                 own; give the tangent, the derivative of the orbit",
                multiplier.re, multiplier.im
            );
            return Err(Error::Model { path: "transverse".into(), message });
        }
        let matrix = DMatrix::from_row_slice(nx, nx, self.monodromy()) - DMatrix::identity(nx, nx) * multiplier.re;
        let vectors = matrix.svd(false, true).v_t.unwrap_or_else(|| DMatrix::identity(nx, nx));
        // Singular values come largest first: the last row spans what the matrix does not move.
        let start = vectors.row(nx - 1).transpose();
        let flow = Flow::new(self)?;
        let decay = multiplier.re.ln() / self.period();
        // Times of a Fourier series count from zero, not from the start of the system.
        series(self.period(), nx, |t| {
            let since = (t - self.start()).rem_euclid(self.period());
            (flow.at(t) * &start * (-decay * since).exp()).iter().copied().collect()
        })
    }
}

impl Transverse {
    /// The gain on all states that a gain on the transverse ones stands for: `K(t) = K_perp(t) Z(t)^T`, from (nu, nx - 1) to
    /// (nu, nx), row-major. It leaves the phase alone.
    ///
    /// # Errors
    /// `Shape` for a gain with another number of columns, `OutOfRange` for another period.
    pub fn gain(&self, transverse: &FourierSeries) -> Result<FourierSeries> {
        let (narrow, nu) = (self.system.size().nx, self.system.size().nu);
        if transverse.rows() != nu * narrow {
            let what = format!("gain, ({nu} inputs, {narrow} transverse states) row-major");
            return Err(Error::Shape { what, expected: nu * narrow, found: transverse.rows() });
        }
        let period = self.frame.period();
        if transverse.harmonics() > 0 && (transverse.period() / period - 1.0).abs() > 1e-9 {
            let (what, found) = ("period of the gain".into(), transverse.period());
            return Err(Error::OutOfRange { what, found, expected: format!("{period} s, that of the orbit") });
        }
        let n = 2 * (transverse.harmonics() + self.frame.harmonics()) + 1;
        let mut samples = Vec::with_capacity(n * nu * (narrow + 1));
        for i in 0..n {
            let t = period * i as f64 / n as f64;
            let k = DMatrix::from_row_slice(nu, narrow, &transverse.value(t));
            samples.extend(rows(&(k * DMatrix::from_row_slice(narrow + 1, narrow, &self.frame.value(t)).transpose())));
        }
        FourierSeries::from_samples(period, nu * (narrow + 1), &samples)
    }
}

/// Transition from the start of the period to any time within it.
struct Flow {
    period: f64,
    start: f64,
    gauss: Gauss,
    /// Start and length of a part, transition to its start, and from there to its nodes.
    parts: Vec<(f64, f64, DMatrix<f64>, Vec<DMatrix<f64>>)>,
    whole: DMatrix<f64>,
}

impl Flow {
    fn new(system: &LtpSystem) -> Result<Self> {
        let nx = system.size().nx;
        let matrix = |m: &[f64]| DMatrix::from_row_slice(nx, nx, m);
        let mut whole = DMatrix::<f64>::identity(nx, nx);
        let mut parts = Vec::new();
        for part in system.transitions()? {
            let nodes = part.nodes.chunks(nx * nx).map(matrix).collect();
            let end = matrix(&part.end) * &whole;
            parts.push((part.start, part.length, whole, nodes));
            whole = end;
        }
        Ok(Self { period: system.period(), start: system.start(), gauss: system.gauss().clone(), parts, whole })
    }

    fn at(&self, t: f64) -> DMatrix<f64> {
        let phase = self.start + (t - self.start).rem_euclid(self.period);
        let k = self.parts.partition_point(|p| p.0 <= phase).saturating_sub(1);
        let (start, length, before, nodes) = &self.parts[k];
        let mut basis = [0.0; NODES];
        self.gauss.basis((phase - start) / length, &mut basis);
        let mut sum = DMatrix::<f64>::zeros(before.nrows(), before.nrows());
        basis.iter().zip(nodes).for_each(|(w, m)| sum += m * *w);
        sum * before
    }
}

/// A function of period `period` as a Fourier series, with as many harmonics as it has.
fn series(period: f64, rows: usize, at: impl Fn(f64) -> Vec<f64>) -> Result<FourierSeries> {
    let mut n = 32;
    loop {
        let samples: Vec<f64> = (0..n).flat_map(|i| at(period * i as f64 / n as f64)).collect();
        let whole = FourierSeries::from_samples(period, rows, &samples)?;
        let largest = whole.coefficients().iter().map(|c| c.norm()).fold(0.0, f64::max);
        let matters = |c: &[Complex]| c.iter().any(|c| c.norm() > ROUNDING * largest);
        let last = whole.coefficients().chunks(rows).rposition(matters).unwrap_or(0);
        if last <= n / 4 {
            return FourierSeries::new(period, rows, whole.coefficients()[..(last + 1) * rows].to_vec());
        }
        n *= 2;
        if n > SAMPLES {
            return Err(Error::NoConvergence {
                method: "Fourier series of the moving frame".into(),
                iterations: SAMPLES,
                residual: whole.coefficients()[last * rows..].iter().map(|c| c.norm()).fold(0.0, f64::max) / largest,
                advice:
                    "the orbit turns too sharply (relaxation oscillation): scale the states so that none of them makes \
                         the tangent swing round in an instant"
                        .into(),
            });
        }
    }
}

/// An orthonormal frame (n, n - 1) across a unit vector: the columns of the reflection that turns it into an axis.
fn across(tau: &DVector<f64>) -> DMatrix<f64> {
    let n = tau.len();
    let axis = tau.iamax();
    let mut mirror = tau.clone();
    mirror[axis] += tau[axis].signum();
    let reflection = DMatrix::identity(n, n) - &mirror * mirror.transpose() * (2.0 / mirror.norm_squared());
    let columns: Vec<DVector<f64>> = (0..n).filter(|&k| k != axis).map(|k| reflection.column(k).into_owned()).collect();
    DMatrix::from_columns(&columns)
}

/// The real skew logarithm of a rotation: planes turn by at most pi, and pairs of eigenvalues -1 make such planes.
fn rotation_logarithm(rotation: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = rotation.nrows();
    let (q, t) = Schur::try_new(rotation, f64::EPSILON, 100 * n)?.unpack();
    let mut log = DMatrix::<f64>::zeros(n, n);
    let mut half_turns = Vec::new();
    let mut i = 0;
    while i < n {
        if i + 1 < n && t[(i + 1, i)].abs() > 1e-9 {
            let angle = (t[(i + 1, i)] - t[(i, i + 1)]).atan2(t[(i, i)] + t[(i + 1, i + 1)]);
            (log[(i + 1, i)], log[(i, i + 1)]) = (angle, -angle);
            i += 2;
        } else {
            if t[(i, i)] < 0.0 {
                half_turns.push(i);
            }
            i += 1;
        }
    }
    for pair in half_turns.chunks_exact(2) {
        (log[(pair[1], pair[0])], log[(pair[0], pair[1])]) = (std::f64::consts::PI, -std::f64::consts::PI);
    }
    Some(&q * log * q.transpose())
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn rows(m: &DMatrix<f64>) -> Vec<f64> {
    m.transpose().iter().copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_have_a_real_skew_logarithm_also_by_half_a_turn() {
        let (s, c) = 2.0_f64.sin_cos();
        let turned = DMatrix::from_row_slice(3, 3, &[c, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, c]);
        let half = DMatrix::from_diagonal(&DVector::from_vec(vec![-1.0, 1.0, -1.0, 1.0]));
        for rotation in [turned, half, DMatrix::identity(2, 2)] {
            let n = rotation.nrows();
            let log = rotation_logarithm(rotation.clone()).expect("logarithm");
            assert!((&log + log.transpose()).norm() < 1e-14);
            let complex: Vec<Complex> = rows(&log).into_iter().map(Complex::from).collect();
            let back: Vec<f64> = exponential(&complex, n).iter().map(|v| v.re).collect();
            assert!((DMatrix::from_row_slice(n, n, &back) - rotation).norm() < 1e-13);
        }
    }
}
