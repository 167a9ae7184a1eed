//! Inputs between samples: piecewise polynomials on the sample grid.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
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
    pieces: Vec<[f64; 4]>,
}

impl Inputs {
    /// Inputs that never change.
    pub fn constant(values: &[f64]) -> Self {
        let pieces = values.iter().map(|&v| [v, 0.0, 0.0, 0.0]).collect();
        Self { count: values.len(), t0: 0.0, dt: f64::INFINITY, hold: Hold::FirstOrder, pieces }
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
        let pieces = (0..n).flat_map(|i| per_input.iter().map(move |p| p[i])).collect();
        Ok(Self { count: columns.len(), t0, dt, hold, pieces })
    }

    /// Number of inputs.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Whether inputs may jump at samples.
    pub fn jumps(&self) -> bool {
        self.hold == Hold::ZeroOrder && self.dt.is_finite()
    }

    /// The first sample instant after a time, where the polynomial changes; infinite where there is none.
    #[inline]
    pub fn next_knot(&self, t: f64) -> f64 {
        if !self.dt.is_finite() {
            return f64::INFINITY;
        }
        let k = ((t - self.t0) / self.dt).floor().max(-1.0) + 1.0;
        if k as usize * self.count < self.pieces.len() { self.t0 + k * self.dt } else { f64::INFINITY }
    }

    /// The interval that holds a time in its interior.
    #[inline]
    pub fn interval(&self, t: f64) -> usize {
        if !self.dt.is_finite() {
            return 0;
        }
        let last = self.pieces.len() / self.count - 1;
        (((t - self.t0) / self.dt).floor().max(0.0) as usize).min(last)
    }

    /// Values at a time, by the polynomial of an interval.
    #[inline]
    pub fn eval(&self, interval: usize, t: f64, out: &mut [f64]) {
        let s = self.since(interval, t);
        let pieces = &self.pieces[interval * self.count..(interval + 1) * self.count];
        for (o, c) in out.iter_mut().zip(pieces) {
            *o = c[0] + s * (c[1] + s * (c[2] + s * c[3]));
        }
    }

    /// Rates at a time, by the polynomial of an interval.
    pub fn rate(&self, interval: usize, t: f64, out: &mut [f64]) {
        let s = self.since(interval, t);
        let pieces = &self.pieces[interval * self.count..(interval + 1) * self.count];
        for (o, c) in out.iter_mut().zip(pieces) {
            *o = c[1] + s * (2.0 * c[2] + s * 3.0 * c[3]);
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
