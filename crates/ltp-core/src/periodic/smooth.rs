//! Smooth systems from functions of time and from Fourier series, cut into segments that their nodes resolve.
//!
//! A stretch of the period is halved until the two highest Legendre coefficients of every entry, and its interpolant at the
//! middle, are within rounding of what the function says there.

use super::system::{Entry, Jump, LtpSystem, NODES, Segment, Size};
use crate::error::{Error, Result};
use crate::numeric::fourier_series::FourierSeries;
use crate::numeric::gauss::Gauss;

/// Unresolved part of an entry, relative to its largest value of the period, that counts as rounding.
const RESOLVED: f64 = 1e-11;
/// Entries this much smaller than the largest of their matrix are measured against this share of it: they may be rounding.
const FLOOR: f64 = 1e-4;
/// Difference between `t` and `t + T`, in the same measure, that a periodic function may have by rounding.
const PERIODIC: f64 = 1e-9;
/// Stretches to begin with: narrow features must not slip between the nodes.
const FIRST: usize = 8;
/// Times a stretch of the beginning may be halved.
const HALVINGS: usize = 14;
/// Matrices in the order in which values are kept.
const ENTRIES: [Entry; 4] = [Entry::A, Entry::B, Entry::C, Entry::D];

/// Values of A, B, C and D at one time.
pub(super) type Values = [Vec<f64>; 4];

impl LtpSystem {
    /// A smooth system of `period` (s) from a function that gives each matrix at time `t` (s), row-major.
    ///
    /// # Errors
    /// As [`LtpSystem::try_smooth`].
    pub fn smooth(period: f64, size: Size, matrices: impl Fn(f64, Entry) -> Vec<f64>) -> Result<Self> {
        Self::try_smooth(period, size, |t, entry| Ok(matrices(t, entry)))
    }

    /// As [`LtpSystem::smooth`], from a function that may fail.
    ///
    /// # Errors
    /// `OutOfRange` for a period that is not positive or no states, `Shape` and `NotFinite` for what the function gives,
    /// `Model` for a function that is not periodic or not smooth, naming the entry; whatever the function itself says.
    pub fn try_smooth(
        period: f64,
        size: Size,
        mut matrices: impl FnMut(f64, Entry) -> Result<Vec<f64>>,
    ) -> Result<Self> {
        if !(period > 0.0 && period.is_finite()) {
            let expected = "a positive time in s".into();
            return Err(Error::OutOfRange { what: "period".into(), found: period, expected });
        }
        if size.nx == 0 {
            let expected = "at least one state: A has to be a square matrix".into();
            return Err(Error::OutOfRange { what: "number of states".into(), found: 0.0, expected });
        }
        let mut at = |t: f64| -> Result<Values> {
            let mut values = Values::default();
            for (entry, out) in ENTRIES.into_iter().zip(&mut values) {
                *out = matrices(t, entry)?;
                check(entry, t, size, out)?;
            }
            Ok(values)
        };
        let mut scales = Scales::new(size);
        for i in 0..FIRST * NODES {
            scales.include(&at((i as f64 + 0.5) / (FIRST * NODES) as f64 * period)?);
        }
        for fraction in [0.0, 0.137, 0.291, 0.463, 0.618, 0.782, 0.929] {
            let (now, later) = (at(fraction * period)?, at((fraction + 1.0) * period)?);
            if let Some((what, difference)) = scales.worst(&now, &later).filter(|(_, d)| *d > PERIODIC) {
                let message = format!(
                    "{what} is not periodic: at t = {:.6} s and one period of {period} s later it differs by \
                     {difference:.1e} of its size; give the period of the slowest part, or a function that repeats",
                    fraction * period
                );
                return Err(Error::Model { path: "LtpSystem".into(), message });
            }
        }
        let mut segments = Vec::new();
        let gauss = Gauss::new(NODES);
        for k in 0..FIRST {
            let (start, end) = (k as f64 * period / FIRST as f64, (k + 1) as f64 * period / FIRST as f64);
            cut(&gauss, &scales, (start, end), HALVINGS, &mut at, &mut segments)?;
        }
        Self::new(period, 0.0, size, segments)
    }

    /// A smooth system from the Fourier series of its matrices, row-major: `a` of nx*nx rows, `b` of nx*nu, `c` of ny*nx, `d`
    /// of ny*nu; what is not given is zero. The period is that of `a`.
    ///
    /// # Errors
    /// `Shape` for rows that do not fit `size`, `OutOfRange` for a period that is not that of `a`.
    pub fn from_series(
        size: Size,
        a: &FourierSeries,
        b: Option<&FourierSeries>,
        c: Option<&FourierSeries>,
        d: Option<&FourierSeries>,
    ) -> Result<Self> {
        let all = [Some(a), b, c, d];
        for (entry, series) in ENTRIES.into_iter().zip(all) {
            let Some(series) = series else { continue };
            if series.rows() != entry.len(size) {
                let what = format!("Fourier series of {entry:?}: rows");
                return Err(Error::Shape { what, expected: entry.len(size), found: series.rows() });
            }
            if (series.period() / a.period() - 1.0).abs() > 1e-12 {
                let (what, found) = (format!("period of {entry:?}"), series.period());
                return Err(Error::OutOfRange { what, found, expected: format!("{} s, that of A", a.period()) });
            }
        }
        Self::smooth(a.period(), size, |t, entry| match all[entry as usize] {
            Some(series) => series.value(t),
            None => vec![0.0; entry.len(size)],
        })
    }

    /// A system with other matrices and jumps, made from those of this one at each time, over segments that resolve them.
    pub(super) fn rebuilt(
        &self,
        size: Size,
        jumps: impl Fn(&Segment) -> Vec<Jump>,
        matrices: impl Fn(f64, Values) -> Values,
    ) -> Result<Self> {
        let at = |s: &Segment, t: f64| -> Values {
            let theta = (t - s.start) / (s.end - s.start);
            let mut own = Values::default();
            for (entry, out) in ENTRIES.into_iter().zip(&mut own) {
                self.at(s, theta, entry, out);
            }
            matrices(t, own)
        };
        let mut scales = Scales::new(size);
        for s in self.segments() {
            for node in &self.gauss().nodes {
                scales.include(&at(s, s.start + node * (s.end - s.start)));
            }
        }
        let mut segments = Vec::new();
        for s in self.segments() {
            cut(self.gauss(), &scales, (s.start, s.end), HALVINGS, &mut |t| Ok(at(s, t)), &mut segments)?;
            if let Some(last) = segments.last_mut() {
                last.jumps = jumps(s);
            }
        }
        Self::new(self.period(), self.start(), size, segments)
    }
}

impl Entry {
    /// Numbers in a matrix of this kind.
    pub(super) fn len(self, size: Size) -> usize {
        let Size { nx, nu, ny } = size;
        match self {
            Self::A => nx * nx,
            Self::B => nx * nu,
            Self::C => ny * nx,
            Self::D => ny * nu,
        }
    }
}

/// What each entry is measured against.
struct Scales {
    size: Size,
    largest: Values,
}

impl Scales {
    fn new(size: Size) -> Self {
        Self { size, largest: ENTRIES.map(|entry| vec![0.0; entry.len(size)]) }
    }

    fn include(&mut self, values: &Values) {
        for (largest, values) in self.largest.iter_mut().zip(values) {
            largest.iter_mut().zip(values).for_each(|(l, v)| *l = l.max(v.abs()));
        }
    }

    /// Scale of an entry; zero when its matrix is.
    fn of(&self, entry: usize, k: usize) -> f64 {
        let matrix = self.largest[entry].iter().fold(0.0_f64, |m, v| m.max(*v));
        self.largest[entry][k].max(FLOOR * matrix)
    }

    /// The entry with the largest difference, relative to its scale, by name.
    fn worst(&self, left: &Values, right: &Values) -> Option<(String, f64)> {
        let each = |m: usize| {
            (0..left[m].len()).map(move |k| {
                let difference = (left[m][k] - right[m][k]).abs();
                (m, k, if difference == 0.0 { 0.0 } else { difference / self.of(m, k) })
            })
        };
        (0..4).flat_map(each).max_by(|a, b| a.2.total_cmp(&b.2)).map(|(m, k, d)| (self.name(m, k), d))
    }

    fn name(&self, entry: usize, k: usize) -> String {
        let width = if matches!(ENTRIES[entry], Entry::A | Entry::C) { self.size.nx } else { self.size.nu };
        format!("{:?}[{}, {}]", ENTRIES[entry], k / width, k % width)
    }
}

/// Segments from `start` to `end` that resolve the matrices, halved as often as it takes.
fn cut(
    gauss: &Gauss,
    scales: &Scales,
    (start, end): (f64, f64),
    halvings: usize,
    at: &mut dyn FnMut(f64) -> Result<Values>,
    out: &mut Vec<Segment>,
) -> Result<()> {
    let nodes: Vec<Values> = gauss.nodes.iter().map(|n| at(start + n * (end - start))).collect::<Result<_>>()?;
    let all = |m: usize| -> Vec<f64> { nodes.iter().flat_map(|v| v[m].iter().copied()).collect() };
    let matrices = [0, 1, 2, 3].map(all);
    let middle = 0.5 * (start + end);
    let mut basis = [0.0; NODES];
    gauss.basis(0.5, &mut basis);
    let interpolate = |m: usize| -> Vec<f64> {
        (0..nodes[0][m].len()).map(|k| basis.iter().zip(&nodes).map(|(w, v)| w * v[m][k]).sum()).collect()
    };
    let mut worst = scales.worst(&[0, 1, 2, 3].map(interpolate), &at(middle)?).unwrap_or_default();
    for (m, values) in matrices.iter().enumerate() {
        let each = nodes[0][m].len();
        for k in 0..each {
            let own: Vec<f64> = values.iter().skip(k).step_by(each).copied().collect();
            let largest = own.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            let tail = if largest == 0.0 { 0.0 } else { gauss.tail(&own) * largest / scales.of(m, k) };
            if tail > worst.1 {
                worst = (scales.name(m, k), tail);
            }
        }
    }
    if worst.1 <= RESOLVED {
        let [a, b, c, d] = matrices;
        out.push(Segment { start, end, a, b, c, d, jumps: vec![] });
        return Ok(());
    }
    if halvings == 0 {
        let message = format!(
            "{} is not smooth near t = {middle:.9} s ({:.0e} of its size is not resolved there): a kink or a step has no \
             place inside a smooth system; build the system from segments with `LtpSystem::new`, or smooth the function",
            worst.0, worst.1
        );
        return Err(Error::Model { path: "LtpSystem".into(), message });
    }
    cut(gauss, scales, (start, middle), halvings - 1, at, out)?;
    cut(gauss, scales, (middle, end), halvings - 1, at, out)
}

fn check(entry: Entry, t: f64, size: Size, values: &[f64]) -> Result<()> {
    if values.len() != entry.len(size) {
        let what = format!("{entry:?} at t = {t} s, {} states, {} inputs, {} outputs", size.nx, size.nu, size.ny);
        return Err(Error::Shape { what, expected: entry.len(size), found: values.len() });
    }
    match values.iter().position(|v| !v.is_finite()) {
        Some(row) => {
            let (what, column) = (format!("{entry:?} at t = {t} s"), "row-major entries".into());
            Err(Error::NotFinite { what, row, column, value: values[row] })
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const SIZE: Size = Size { nx: 2, nu: 1, ny: 1 };

    fn matrices(t: f64, entry: Entry) -> Vec<f64> {
        let w = TAU / 0.7;
        match entry {
            Entry::A => vec![0.0, 1.0, -3.0 + 0.5 * (5.0 * w * t).cos(), 1e-17 * (1e5 * t).sin()],
            Entry::B => vec![0.0, (w * t).sin().exp()],
            Entry::C => vec![1.0, 0.0],
            Entry::D => vec![0.0],
        }
    }

    #[test]
    fn functions_are_resolved_everywhere() {
        let system = LtpSystem::smooth(0.7, SIZE, matrices).expect("smooth");
        for i in 0..200 {
            let t = 0.7 * (f64::from(i) / 200.0).powi(2);
            for entry in [Entry::A, Entry::B] {
                for (found, expected) in system.matrix(entry, t).iter().zip(matrices(t, entry)) {
                    assert!((found - expected).abs() < 1e-10, "{entry:?} at {t}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn series_and_functions_are_one_system() {
        let series = |entry: Entry, n: usize| {
            let samples: Vec<f64> = (0..n).flat_map(|i| matrices(0.7 * i as f64 / n as f64, entry)).collect();
            FourierSeries::from_samples(0.7, entry.len(SIZE), &samples).expect("series")
        };
        let (a, b, c) = (series(Entry::A, 16), series(Entry::B, 41), series(Entry::C, 1));
        let of_series = LtpSystem::from_series(SIZE, &a, Some(&b), Some(&c), None).expect("series");
        let of_functions = LtpSystem::smooth(0.7, SIZE, matrices).expect("functions");
        for (x, y) in of_series.monodromy().iter().zip(of_functions.monodromy()) {
            assert!((x - y).abs() < 1e-11, "{x} {y}");
        }
        assert!(LtpSystem::from_series(SIZE, &a, Some(&c), Some(&c), Some(&c)).is_err());
        let longer = FourierSeries::constant(0.8, &[1.0, 0.0]).expect("constant");
        assert!(LtpSystem::from_series(SIZE, &a, Some(&longer), None, None).is_err());
    }

    #[test]
    fn what_is_not_periodic_smooth_finite_or_of_the_right_shape_is_refused() {
        let of = |f: &dyn Fn(f64) -> f64| {
            let made = LtpSystem::smooth(0.7, SIZE, |t, entry| match entry {
                Entry::A => vec![0.0, 1.0, f(t), 0.0],
                _ => matrices(t, entry),
            });
            made.map(|_| ()).expect_err("refused").to_string()
        };
        assert!(of(&|t| t.cos()).contains("A[1, 0] is not periodic"), "{}", of(&|t| t.cos()));
        let kinked = of(&|t| (TAU * t / 0.7 + 0.3).sin().abs() + 1.0);
        assert!(kinked.contains("A[1, 0] is not smooth near"), "{kinked}");
        assert!(of(&|_| f64::NAN).contains("A at t"));
        let short = LtpSystem::smooth(0.7, SIZE, |_, _| vec![1.0]).expect_err("shape");
        assert!(matches!(short, Error::Shape { expected: 4, found: 1, .. }), "{short}");
        assert!(LtpSystem::smooth(-1.0, SIZE, matrices).is_err());
        assert!(LtpSystem::smooth(1.0, Size { nx: 0, nu: 0, ny: 0 }, |_, _| vec![]).is_err());
    }
}
