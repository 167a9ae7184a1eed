//! Inputs between samples: piecewise polynomials on the sample grid.

use std::borrow::Cow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::late::Late;
use crate::error::{Error, Result};
use crate::model::System;
use crate::numeric::spline::{Cubic, Ends};

/// How an input runs between its samples. The choice matters: it is the caller's to make.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Hold {
    /// Straight lines through the samples.
    #[default]
    FirstOrder,
    /// Constant from each sample to the next, as behind a digital-analogue converter.
    ZeroOrder,
    /// A cubic spline through the samples.
    Cubic,
}

/// Inputs as functions of time.
#[derive(Clone, Debug, PartialEq)]
pub struct Inputs {
    count: usize,
    t0: f64,
    dt: f64,
    hold: Hold,
    /// `[c0, c1, c2, c3]` of powers of the time since the interval's start; interval by interval, input by input.
    pieces: Arc<Vec<[f64; 4]>>,
    /// Channels behind the inputs: late ones, each with its rate.
    late: Vec<Late>,
}

/// A stretch of time in which every input is one polynomial.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    index: usize,
    /// An instant inside it, s; none where only the number of the sample is known.
    inside: Option<f64>,
}

impl From<usize> for Interval {
    fn from(index: usize) -> Self {
        Self { index, inside: None }
    }
}

impl Inputs {
    /// Inputs that never change.
    pub fn constant(values: &[f64]) -> Self {
        let pieces = values.iter().map(|&v| [v, 0.0, 0.0, 0.0]).collect();
        let pieces = Arc::new(pieces);
        Self { count: values.len(), t0: 0.0, dt: f64::INFINITY, hold: Hold::FirstOrder, pieces, late: Vec::new() }
    }

    /// Inputs through samples at `t0 + k*dt`, one column per input; held constant before and after.
    ///
    /// # Errors
    /// [`Error::Shape`] for columns of unequal length, [`Error::TooShort`] below two samples.
    pub fn samples(t0: f64, dt: f64, columns: &[Vec<f64>], hold: Hold) -> Result<Self> {
        let n = columns.first().map_or(0, Vec::len);
        if columns.is_empty() {
            return Ok(Self::constant(&[]));
        }
        if let Some(c) = columns.iter().find(|c| c.len() != n) {
            return Err(Error::Shape { what: "input columns".into(), expected: n, found: c.len() });
        }
        if n < 2 {
            return Err(Error::TooShort { what: "input samples".into(), needed: 2, found: n });
        }
        let per_input = columns.iter().map(|c| pieces(c, dt, hold)).collect::<Result<Vec<_>>>()?;
        let pieces = Arc::new((0..n).flat_map(|i| per_input.iter().map(move |p| p[i])).collect());
        Ok(Self { count: columns.len(), t0, dt, hold, pieces, late: Vec::new() })
    }

    /// The inputs as a system sees them under given parameters: with those that it sees late behind them.
    pub fn seen_by(&self, system: &dyn System, p: &[f64]) -> Cow<'_, Self> {
        let delays = system.delays(p);
        if delays.is_empty() {
            return Cow::Borrowed(self);
        }
        Cow::Owned(Self { late: delays.iter().map(Late::new).collect(), ..self.clone() })
    }

    /// Number of inputs.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Number of values: inputs, then late inputs, each with its rate.
    pub fn channels(&self) -> usize {
        self.count + 2 * self.late.len()
    }

    /// Whether inputs may jump at the ends of intervals.
    pub fn jumps(&self) -> bool {
        self.hold == Hold::ZeroOrder && self.dt.is_finite() || !self.late.is_empty()
    }

    /// The first instant after a time where a polynomial changes; infinite where there is none.
    #[inline]
    pub fn next_knot(&self, t: f64) -> f64 {
        let own = self.next_sample(t);
        if self.late.is_empty() {
            return own;
        }
        self.late.iter().map(|l| l.next_knot(self, t)).fold(own, f64::min)
    }

    /// The first sample instant after a time.
    #[inline]
    pub(super) fn next_sample(&self, t: f64) -> f64 {
        if !self.dt.is_finite() {
            return f64::INFINITY;
        }
        let k = ((t - self.t0) / self.dt).floor().max(-1.0) + 1.0;
        if k as usize * self.count < self.pieces.len() { self.t0 + k * self.dt } else { f64::INFINITY }
    }

    /// The interval that holds a time in its interior.
    #[inline]
    pub fn interval(&self, t: f64) -> Interval {
        Interval { index: self.index(t), inside: Some(t) }
    }

    #[inline]
    fn index(&self, t: f64) -> usize {
        if !self.dt.is_finite() {
            return 0;
        }
        let last = self.pieces.len() / self.count - 1;
        (((t - self.t0) / self.dt).floor().max(0.0) as usize).min(last)
    }

    /// First sample instant, s.
    pub(super) fn start(&self) -> f64 {
        self.t0
    }

    /// The piece of an input at a time, and the instant from which its polynomial counts.
    pub(super) fn piece(&self, input: usize, t: f64) -> ([f64; 4], f64) {
        let index = self.index(t);
        let from = if self.dt.is_finite() { self.t0 + index as f64 * self.dt } else { self.t0 };
        (self.pieces[index * self.count + input], from)
    }

    /// Values at a time, by the polynomials of an interval.
    #[inline]
    pub fn eval(&self, interval: impl Into<Interval>, t: f64, out: &mut [f64]) {
        let interval = interval.into();
        let s = self.since(interval.index, t);
        let pieces = &self.pieces[interval.index * self.count..(interval.index + 1) * self.count];
        for (o, c) in out.iter_mut().zip(pieces) {
            *o = c[0] + s * (c[1] + s * (c[2] + s * c[3]));
        }
        for (late, out) in self.late.iter().zip(out.get_mut(self.count..).unwrap_or_default().chunks_exact_mut(2)) {
            let [value, rate, _] = late.eval(self, interval.inside.unwrap_or(t), t);
            out.copy_from_slice(&[value, rate]);
        }
    }

    /// Rates at a time, by the polynomials of an interval.
    pub fn rate(&self, interval: impl Into<Interval>, t: f64, out: &mut [f64]) {
        let interval = interval.into();
        let s = self.since(interval.index, t);
        let pieces = &self.pieces[interval.index * self.count..(interval.index + 1) * self.count];
        for (o, c) in out.iter_mut().zip(pieces) {
            *o = c[1] + s * (2.0 * c[2] + s * 3.0 * c[3]);
        }
        for (late, out) in self.late.iter().zip(out.get_mut(self.count..).unwrap_or_default().chunks_exact_mut(2)) {
            let [_, rate, bend] = late.eval(self, interval.inside.unwrap_or(t), t);
            out.copy_from_slice(&[rate, bend]);
        }
    }

    fn since(&self, interval: usize, t: f64) -> f64 {
        if self.dt.is_finite() { t - (self.t0 + interval as f64 * self.dt) } else { 0.0 }
    }
}

/// Polynomial of each interval of one input; the last one is constant.
fn pieces(column: &[f64], dt: f64, hold: Hold) -> Result<Vec<[f64; 4]>> {
    let constant = |v: f64| [v, 0.0, 0.0, 0.0];
    let mut out: Vec<[f64; 4]> = match hold {
        Hold::ZeroOrder => column.iter().map(|&v| constant(v)).collect(),
        Hold::FirstOrder => column.windows(2).map(|w| [w[0], (w[1] - w[0]) / dt, 0.0, 0.0]).collect(),
        Hold::Cubic => {
            let grid: Vec<f64> = (0..column.len()).map(|k| k as f64 * dt).collect();
            Cubic::new(&grid, column, Ends::Natural)?.pieces().to_vec()
        }
    };
    if let (Some(&last), true) = (column.last(), out.len() < column.len()) {
        out.push(constant(last));
    }
    Ok(out)
}
