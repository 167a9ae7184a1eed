//! The true pumping frequency of a smooth system, the system at that frequency, and the bandwidth of its matrices.

use std::f64::consts::TAU;

use super::system::{Entry, LtpSystem, NODES, Segment};
use crate::error::{Error, Result};
use crate::numeric::divisor::gcd;
use crate::numeric::{Complex, fft};

/// Share of the largest coefficient of an entry below which a harmonic is rounding.
const ROUNDING: f64 = 1e-10;
/// Entries this much smaller than the largest of their matrix are measured against this share of it.
const FLOOR: f64 = 1e-4;
/// Share of the largest coefficient of an entry above which a harmonic may not be left out of a lift.
const MATTERS: f64 = 1e-3;
/// Harmonics looked at, at most.
const HIGHEST: usize = 256;

impl LtpSystem {
    /// Pumping frequency `w_p = 2 pi / T`, rad/s.
    pub fn pumping(&self) -> f64 {
        TAU / self.period()
    }

    /// How many times the matrices repeat within the period: only harmonics that are multiples of this number `d` are there,
    /// so that the true period is `T / d`. One for constant matrices, which have no period, and for systems with jumps.
    ///
    /// A harmonic is there when it exceeds 1e-10 of the largest coefficient of its entry.
    pub fn pumping_divisor(&self) -> usize {
        if self.jumps().next().is_some() {
            return 1;
        }
        let all = [Entry::A, Entry::B, Entry::C, Entry::D];
        let found = all.iter().flat_map(|&entry| self.present(entry, ROUNDING)).fold(0, gcd);
        let divisor = found.max(1);
        // Harmonics beyond those looked at would show as a difference one true period later.
        let shift = self.period() / divisor as f64;
        let repeats = |t: f64, entry: Entry| {
            let (now, later) = (self.matrix(entry, t), self.matrix(entry, t + shift));
            let scale = now.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            now.iter().zip(&later).all(|(a, b)| (a - b).abs() <= 1e-8 * scale)
        };
        let times = (0..97).map(|i| self.start() + self.period() * f64::from(i) / 97.0);
        if times.into_iter().all(|t| all.iter().all(|&entry| repeats(t, entry))) { divisor } else { 1 }
    }

    /// The system over its true period `T / d`, with `d` of [`LtpSystem::pumping_divisor`]: its lift at truncation N has the
    /// eigenvalues that the lift of this one at d N keeps in its blocks of multiples of d.
    ///
    /// # Errors
    /// What [`LtpSystem::new`] says.
    pub fn shortened(&self) -> Result<Self> {
        let divisor = self.pumping_divisor();
        if divisor == 1 {
            return Ok(self.clone());
        }
        let period = self.period() / divisor as f64;
        let end = self.start() + period;
        let mut segments = Vec::new();
        for s in self.segments() {
            if s.start >= end - 1e-12 * period {
                break;
            }
            if s.end <= end + 1e-12 * period {
                segments.push(s.clone());
                continue;
            }
            let part = |entry: Entry| -> Vec<f64> {
                let (mut all, mut value) = (Vec::new(), Vec::new());
                for node in self.gauss().nodes.iter().take(NODES) {
                    self.at(s, node * (end - s.start) / (s.end - s.start), entry, &mut value);
                    all.extend_from_slice(&value);
                }
                all
            };
            let [a, b, c, d] = [Entry::A, Entry::B, Entry::C, Entry::D].map(part);
            segments.push(Segment { start: s.start, end, a, b, c, d, jumps: vec![] });
        }
        Self::new(period, self.start(), self.size(), segments)
    }

    /// The highest harmonic of A and B with a coefficient above `share` of the largest of its entry; zero for constants.
    ///
    /// # Errors
    /// `OutOfRange` for a share outside (0, 1), `Model` for a system with jumps, which has no bandwidth.
    pub fn bandwidth(&self, share: f64) -> Result<usize> {
        if !(share > 0.0 && share < 1.0) {
            let expected = "a share of the largest coefficient, between 0 and 1".into();
            return Err(Error::OutOfRange { what: "share".into(), found: share, expected });
        }
        if let Some(jump) = self.jumps().next() {
            let message =
                format!("the state jumps (`{}`): no number of harmonics holds it; use exact Floquet", jump.name);
            return Err(Error::Model { path: "bandwidth".into(), message });
        }
        Ok([Entry::A, Entry::B].iter().flat_map(|&entry| self.present(entry, share)).max().unwrap_or(0))
    }

    /// Whether the lift at truncation N holds what A and B have: harmonics up to 2N fit into its blocks.
    ///
    /// # Errors
    /// `OutOfRange` for a truncation that leaves out a harmonic above 0.1 % of the largest of its entry, saying which suffices;
    /// as [`LtpSystem::bandwidth`].
    pub fn check_truncation(&self, truncation: usize) -> Result<()> {
        let highest = self.bandwidth(MATTERS)?;
        if highest <= 2 * truncation {
            return Ok(());
        }
        let expected = format!(
            "at least {}: harmonic {highest} of A or B exceeds {} % of the largest coefficient of its entry, and blocks \
             -N..N hold harmonics up to 2N",
            highest.div_ceil(2),
            100.0 * MATTERS
        );
        Err(Error::OutOfRange { what: "truncation".into(), found: truncation as f64, expected })
    }

    /// Harmonics k >= 1 of a matrix that exceed `share` of the largest coefficient of their entry.
    fn present(&self, entry: Entry, share: f64) -> Vec<usize> {
        // A segment that is resolved by its nodes holds less than half as many oscillations.
        let highest = (NODES / 2 * self.segments().len()).min(HIGHEST);
        let each = entry.len(self.size());
        if each == 0 {
            return Vec::new();
        }
        let n = (4 * highest).next_power_of_two();
        let at = |i: usize| self.matrix(entry, self.start() + self.period() * i as f64 / n as f64);
        let samples: Vec<f64> = (0..n).flat_map(at).collect();
        let columns = (0..each).map(|k| samples.iter().skip(k).step_by(each).copied().collect::<Vec<_>>());
        let lines: Vec<Vec<Complex>> = columns.map(|column| fft::forward(&column)).collect();
        let sizes: Vec<f64> = lines.iter().map(|l| l.iter().map(|v| v.norm()).fold(0.0, f64::max)).collect();
        let floor = FLOOR * sizes.iter().fold(0.0_f64, |m, v| m.max(*v));
        let there = |k: &usize| lines.iter().zip(&sizes).any(|(l, s)| l[*k].norm() > share * s.max(floor));
        (1..=highest).filter(there).collect()
    }
}
