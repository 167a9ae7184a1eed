//! Lines of all records as rows along the output frequency, in the order in which the smoother sweeps: from the top down.

use crate::identify::Spectra;
use crate::numeric::Complex;
use crate::numeric::smoother::Observations;
use std::f64::consts::TAU;

/// Output frequencies go this far beyond the highest that the band reaches, in pumping frequencies.
const MARGIN: f64 = 0.33;

/// Rows of the output equation `Y(w) = sum_k U(w - k w_p) G_k(w)`, inputs scaled to unit power.
pub(super) struct Axis {
    pub(super) harmonics: usize,
    pub(super) inputs: usize,
    /// Distance between output frequencies, rad/s, and their number per pumping frequency.
    pub(super) spacing: f64,
    pub(super) periods: usize,
    /// Number of the highest output frequency.
    pub(super) top: usize,
    /// Of each input: root of its mean power per line within the band.
    pub(super) scale: Vec<f64>,
    /// Number of the record and of the line of each row, from the top down to zero.
    rows: Vec<(usize, usize)>,
    /// First row of each frequency, from the top down, and the number of rows.
    first: Vec<usize>,
    pub(super) warnings: Vec<String>,
}

impl Axis {
    pub(super) fn new(spectra: &Spectra, harmonics: usize) -> Self {
        let records = spectra.records();
        let longest = (0..records.len()).max_by_key(|&r| (records[r].periods(), records.len() - r)).unwrap_or(0);
        let (spacing, periods) = (records[longest].spacing(), records[longest].periods());
        let reach = spectra.band() + (harmonics as f64 + MARGIN) * spectra.pumping();
        let highest = records.iter().map(|r| (r.lines() - 1) as f64 * r.spacing()).fold(0.0, f64::max);
        let top = ((reach.min(highest) / spacing) * (1.0 + 1e-12)) as usize;

        let mut at = vec![Vec::new(); top + 1];
        for (r, record) in records.iter().enumerate() {
            for b in 0..record.lines() {
                let step = (b as f64 * record.spacing() / spacing).round() as usize;
                if step <= top && spectra.informative(record, b as i64) {
                    at[top - step].push((r, b));
                }
            }
        }
        let mut first = vec![0];
        first.extend(at.iter().scan(0, |count, rows| {
            *count += rows.len();
            Some(*count)
        }));
        let mut warnings = Vec::new();
        if records.iter().any(|r| r.periods() != periods) {
            let lengths: Vec<String> = records.iter().map(|r| r.periods().to_string()).collect();
            warnings.push(format!(
                "recordings hold {} periods: lines of the shorter ones are moved by up to {:.2e} Hz to those of the longest; \
                 cut all to one length to avoid it",
                lengths.join(", "),
                0.5 * spacing / TAU
            ));
        }
        let scale = (0..spectra.inputs()).map(|i| in_band(spectra, i)).collect();
        let (inputs, rows) = (spectra.inputs(), at.concat());
        Self { harmonics, inputs, spacing, periods, top, scale, rows, first, warnings }
    }

    /// Unknowns at each frequency: all inputs of harmonic -K, then of the next.
    pub(super) fn unknowns(&self) -> usize {
        (2 * self.harmonics + 1) * self.inputs
    }

    /// For each unknown the one that is its conjugate at the mirrored frequency: the opposite harmonic of the same input.
    pub(super) fn mirror(&self) -> Vec<usize> {
        let last = 2 * self.harmonics;
        (0..self.unknowns()).map(|i| (last - i / self.inputs) * self.inputs + i % self.inputs).collect()
    }

    /// Number of rows of frequencies from zero upwards.
    pub(super) fn rows(&self) -> usize {
        self.rows.len()
    }

    /// Step of the sweep at which each row stands.
    pub(super) fn steps(&self) -> impl Iterator<Item = usize> + '_ {
        (0..=self.top).flat_map(|t| std::iter::repeat_n(t, self.first[t + 1] - self.first[t]))
    }

    /// Rows from the top down to zero, or down to the mirror of the top.
    pub(super) fn observations(&self, spectra: &Spectra, both: bool) -> Observations {
        let mut observations = Observations::new(self.unknowns());
        let mut push = |t: usize, sign: i64| {
            let rows: Vec<Vec<Complex>> =
                self.rows[self.first[t]..self.first[t + 1]].iter().map(|&row| self.row(spectra, row, sign)).collect();
            observations.step(rows.iter().map(|row| &row[..]));
        };
        (0..=self.top).for_each(|t| push(t, 1));
        if both {
            (0..self.top).rev().for_each(|t| push(t, -1));
        }
        observations
    }

    fn row(&self, spectra: &Spectra, (r, b): (usize, usize), sign: i64) -> Vec<Complex> {
        let (record, k) = (&spectra.records()[r], self.harmonics as i64);
        let at = |k: i64| sign * b as i64 - k * record.periods() as i64;
        (-k..=k).flat_map(|k| (0..self.inputs).map(move |i| record.input(i, at(k)) / self.scale[i])).collect()
    }

    /// Lines of output `j`, row by row.
    pub(super) fn data(&self, spectra: &Spectra, j: usize, both: bool) -> Vec<Complex> {
        let line = |&(r, b): &(usize, usize)| spectra.records()[r].output(j, b as i64);
        let mut data: Vec<Complex> = self.rows.iter().map(line).collect();
        if both {
            let below = (0..self.top).rev().flat_map(|t| self.first[t]..self.first[t + 1]);
            let mirrored: Vec<Complex> = below.map(|row| data[row].conj()).collect();
            data.extend(mirrored);
        }
        data
    }
}

/// Root of the mean power per line of input `i` within the band.
fn in_band(spectra: &Spectra, i: usize) -> f64 {
    let (mut power, mut count) = (0.0, 0_usize);
    for record in spectra.records() {
        let lines = ((spectra.band() / record.spacing() * (1.0 + 1e-12)) as usize).min(record.lines() - 1) + 1;
        power += (0..lines).map(|b| record.input(i, b as i64).norm_sqr()).sum::<f64>();
        count += lines;
    }
    (power / count as f64).sqrt()
}
