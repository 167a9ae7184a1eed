//! `Recording`: inputs and outputs of one run on a uniform time grid, with gaps where nothing was measured.
//!
//! The constructor decides everything once: lengths, finite values, increasing time, sampling. A `Recording` that
//! exists has a uniform grid, finite inputs, and outputs that are finite or NaN; NaN is a gap and is left out of
//! every residual. What had to be done to get there (missing samples, jitter) is said in `warnings`, with numbers.

use super::sampling::{self, Placement};
use crate::error::{Error, Result};
use crate::numeric::stats;
use std::ops::Range;

/// Fewest samples that can be called a recording.
pub const MIN_SAMPLES: usize = 8;

/// One run of a system: `n` samples of `nu` inputs and `ny` outputs on a uniform grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    name: String,
    t: Vec<f64>,
    dt: f64,
    inputs: Vec<f64>,
    outputs: Vec<f64>,
    input_names: Vec<String>,
    output_names: Vec<String>,
    warnings: Vec<String>,
}

impl Recording {
    /// A recording from times `t` `(n,)` in s, input columns (`nu` of `(n,)`) and output columns (`ny` of `(n,)`).
    ///
    /// A uniform record is kept to the bit. Missing samples (steps that are whole multiples of the sampling step)
    /// become rows whose outputs are NaN and whose inputs are interpolated; jitter beyond 1e-4 of a step and beyond
    /// the rounding of the written times is resampled onto a uniform grid; times that are a uniform grid but for
    /// their rounding are replaced by that grid. All but the last leave a warning.
    ///
    /// # Errors
    /// `Shape` for unequal lengths, `TooShort` below 8 samples, `DuplicateName`, `NotFinite` for times and inputs
    /// that are not finite and outputs that are infinite, `TimeNotIncreasing`, `LongPause`.
    pub fn new(
        name: &str,
        t: Vec<f64>,
        inputs: Vec<Vec<f64>>,
        outputs: Vec<Vec<f64>>,
        input_names: Vec<String>,
        output_names: Vec<String>,
    ) -> Result<Self> {
        check_names(name, inputs.len(), &input_names, "input")?;
        check_names(name, outputs.len(), &output_names, "output")?;
        check_lengths(name, t.len(), &inputs, &input_names)?;
        check_lengths(name, t.len(), &outputs, &output_names)?;
        if t.len() < MIN_SAMPLES {
            return Err(Error::TooShort { what: format!("recording `{name}`"), needed: MIN_SAMPLES, found: t.len() });
        }
        check_values(name, "t", &t, f64::is_finite)?;
        for (column, values) in input_names.iter().zip(&inputs) {
            check_values(name, column, values, f64::is_finite)?;
        }
        for (column, values) in output_names.iter().zip(&outputs) {
            check_values(name, column, values, |v| !v.is_infinite())?;
        }
        if let Some(row) = (1..t.len()).find(|&i| t[i] <= t[i - 1]) {
            let (previous, found) = (t[row - 1], t[row]);
            return Err(Error::TimeNotIncreasing { recording: name.to_owned(), row, previous, found });
        }
        let grid = sampling::find(name, &t)?;
        let mut warnings = Vec::new();
        let (inputs, outputs) = match &grid.placement {
            Placement::Rows(rows) if rows.len() == grid.t.len() => (inputs, outputs),
            Placement::Rows(rows) => {
                warnings.push(format!(
                    "recording `{name}`: {} of {} samples are missing from the uniform grid of {} s; their outputs are \
                     gaps, their inputs are interpolated linearly",
                    grid.t.len() - rows.len(),
                    grid.t.len(),
                    brief(grid.dt)
                ));
                let placed: Vec<f64> = rows.iter().map(|&row| grid.t[row]).collect();
                let inputs = columns(&inputs, |u| sampling::interpolate(&placed, u, &grid.t, grid.dt, true));
                (inputs, columns(&outputs, |y| spread(y, rows, grid.t.len())))
            }
            Placement::Resample { rms, largest } => {
                warnings.push(format!(
                    "recording `{name}`: sampling jitters (steps deviate by {} s rms, {:.2} %, and by {} s at most, \
                     {:.2} %, of the step {} s); values were interpolated linearly onto a uniform grid of {} samples, \
                     which damps what is near the Nyquist frequency: prefer a hardware clock",
                    brief(*rms),
                    100.0 * rms / grid.dt,
                    brief(*largest),
                    100.0 * largest / grid.dt,
                    brief(grid.dt),
                    grid.t.len()
                ));
                let inputs = columns(&inputs, |u| sampling::interpolate(&t, u, &grid.t, grid.dt, true));
                (inputs, columns(&outputs, |y| sampling::interpolate(&t, y, &grid.t, grid.dt, false)))
            }
        };
        doubts(name, &inputs, &input_names, &outputs, &output_names, &mut warnings);
        let n = grid.t.len();
        Ok(Recording {
            name: name.to_owned(),
            t: grid.t,
            dt: grid.dt,
            inputs: interleave(&inputs, n),
            outputs: interleave(&outputs, n),
            input_names,
            output_names,
            warnings,
        })
    }

    /// The same samples with the step (s) and the warnings they had elsewhere, in another process or before a slice.
    ///
    /// Both were decided when the recording was first made; the samples alone give the step only up to rounding, and
    /// what was done to get there not at all. With them a copy is equal to the bit.
    ///
    /// # Errors
    /// `OutOfRange` when `dt` is not the step of these samples, to within a thousandth.
    pub fn restored(self, dt: f64, warnings: Vec<String>) -> Result<Self> {
        if (dt - self.dt).abs() <= 1e-3 * self.dt {
            return Ok(Recording { dt, warnings, ..self });
        }
        let what = format!("step of the restored recording `{}`", self.name);
        let expected = format!("{} s, as its times say; restore what the recording itself gave", self.dt);
        Err(Error::OutOfRange { what, found: dt, expected })
    }

    /// Name, as printed in messages and reports.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Number of samples `n`, gaps included.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Never true: a recording has at least 8 samples.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Times `(n,)`, s, on a uniform grid.
    pub fn t(&self) -> &[f64] {
        &self.t
    }

    /// Sampling step, s.
    pub fn dt(&self) -> f64 {
        self.dt
    }

    /// Inputs `(n, nu)`, row-major, in the units of the model's inputs; always finite.
    pub fn inputs(&self) -> &[f64] {
        &self.inputs
    }

    /// Outputs `(n, ny)`, row-major; NaN in gaps.
    pub fn outputs(&self) -> &[f64] {
        &self.outputs
    }

    /// Names of the `nu` inputs.
    pub fn input_names(&self) -> &[String] {
        &self.input_names
    }

    /// Names of the `ny` outputs.
    pub fn output_names(&self) -> &[String] {
        &self.output_names
    }

    /// What had to be done to the data, and what looks doubtful about them.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Samples of input `i < nu`, in time order.
    pub fn input(&self, i: usize) -> impl ExactSizeIterator<Item = f64> + '_ {
        column(&self.inputs, self.input_names.len(), i, self.len())
    }

    /// Samples of output `j < ny`, in time order; NaN in gaps.
    pub fn output(&self, j: usize) -> impl ExactSizeIterator<Item = f64> + '_ {
        column(&self.outputs, self.output_names.len(), j, self.len())
    }

    /// Number of samples of output `j` that are not gaps.
    pub fn valid(&self, j: usize) -> usize {
        self.output(j).filter(|y| !y.is_nan()).count()
    }

    /// Runs of rows in which output `j` has no gap, in time order.
    pub fn segments(&self, j: usize) -> Vec<Range<usize>> {
        stats::finite_runs(self.output(j))
    }

    /// Standard deviation of output `j` over its samples, gaps left out; NaN when it has none.
    pub fn output_std(&self, j: usize) -> f64 {
        stats::std(self.output(j))
    }

    /// The samples with `start <= t <= end` (s; a millionth of a step outside still counts). Times are not shifted.
    ///
    /// # Errors
    /// `OutOfRange` when a limit is NaN, `TooShort` when fewer than 8 samples remain.
    pub fn slice(&self, start: f64, end: f64) -> Result<Recording> {
        if start.is_nan() || end.is_nan() {
            let expected = "a time in s; give both limits of the interval".to_owned();
            return Err(Error::OutOfRange { what: "limit of a slice".to_owned(), found: f64::NAN, expected });
        }
        let slack = 1e-6 * self.dt;
        let first = self.t.partition_point(|&t| t < start - slack);
        let last = self.t.partition_point(|&t| t <= end + slack).max(first);
        if last - first < MIN_SAMPLES {
            let (begins, ends) = (self.t[0], self.t[self.len() - 1]);
            let what =
                format!("recording `{}` from {start} s to {end} s (it covers {begins} s to {ends} s)", self.name);
            return Err(Error::TooShort { what, needed: MIN_SAMPLES, found: last - first });
        }
        let (nu, ny) = (self.input_names.len(), self.output_names.len());
        Ok(Recording {
            t: self.t[first..last].to_vec(),
            inputs: self.inputs[first * nu..last * nu].to_vec(),
            outputs: self.outputs[first * ny..last * ny].to_vec(),
            ..self.clone()
        })
    }
}

fn check_names(recording: &str, count: usize, names: &[String], kind: &str) -> Result<()> {
    if names.len() != count {
        let what = format!("recording `{recording}`: names of {kind}s for {count} {kind} columns");
        return Err(Error::Shape { what, expected: count, found: names.len() });
    }
    match names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
        Some((_, name)) => {
            let context = format!("recording `{recording}`");
            Err(Error::DuplicateName { kind: kind.to_owned(), name: name.clone(), context })
        }
        None => Ok(()),
    }
}

fn check_lengths(recording: &str, expected: usize, columns: &[Vec<f64>], names: &[String]) -> Result<()> {
    match columns.iter().zip(names).find(|(column, _)| column.len() != expected) {
        Some((column, name)) => {
            let what = format!("recording `{recording}`: column `{name}` beside t");
            Err(Error::Shape { what, expected, found: column.len() })
        }
        None => Ok(()),
    }
}

fn check_values(recording: &str, column: &str, values: &[f64], allowed: impl Fn(f64) -> bool) -> Result<()> {
    match values.iter().enumerate().find(|(_, v)| !allowed(**v)) {
        Some((row, &value)) => {
            let what = format!("recording `{recording}`");
            Err(Error::NotFinite { what, row, column: column.to_owned(), value })
        }
        None => Ok(()),
    }
}

/// Warnings about columns that cannot say much.
fn doubts(
    name: &str,
    inputs: &[Vec<f64>],
    input_names: &[String],
    outputs: &[Vec<f64>],
    output_names: &[String],
    warnings: &mut Vec<String>,
) {
    for (column, values) in input_names.iter().zip(inputs) {
        if values.iter().all(|v| *v == values[0]) {
            warnings.push(format!(
                "recording `{name}`: input `{column}` is {} in every row; if the system was driven, check that the \
                 right column was read",
                values[0]
            ));
        }
    }
    for (column, values) in output_names.iter().zip(outputs) {
        let present: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
        if present.len() < MIN_SAMPLES {
            warnings.push(format!(
                "recording `{name}`: output `{column}` has {} samples that are not gaps of {}; it cannot be fitted",
                present.len(),
                values.len()
            ));
        } else if present.iter().all(|v| *v == present[0]) {
            warnings.push(format!(
                "recording `{name}`: output `{column}` is {} in every row; it says nothing about motion: \
                 check the sensor",
                present[0]
            ));
        }
    }
}

/// Applies `change` to every column.
fn columns(columns: &[Vec<f64>], change: impl Fn(&[f64]) -> Vec<f64>) -> Vec<Vec<f64>> {
    columns.iter().map(|column| change(column)).collect()
}

/// Puts `values[i]` at `rows[i]` of a column of `n` gaps.
fn spread(values: &[f64], rows: &[usize], n: usize) -> Vec<f64> {
    let mut column = vec![f64::NAN; n];
    rows.iter().zip(values).for_each(|(&row, &value)| column[row] = value);
    column
}

/// Columns to one row-major array.
fn interleave(columns: &[Vec<f64>], n: usize) -> Vec<f64> {
    (0..n).flat_map(|row| columns.iter().map(move |column| column[row])).collect()
}

/// Column `j` of a row-major array with `width` columns and `n` rows.
fn column(values: &[f64], width: usize, j: usize, n: usize) -> impl ExactSizeIterator<Item = f64> + '_ {
    assert!(j < width, "column {j} of {width}");
    (0..n).map(move |row| values[row * width + j])
}

/// A number for a message: six significant digits, no trailing noise.
fn brief(value: f64) -> String {
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    if rounded != 0.0 && rounded.abs() < 1e-4 { format!("{rounded:e}") } else { format!("{rounded}") }
}

#[cfg(test)]
#[path = "recording_tests.rs"]
mod tests;
