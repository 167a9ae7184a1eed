//! An input looked at earlier: its own piecewise polynomials, moved in time.

use super::inputs::Inputs;
use crate::model::{Delay, Past};

/// One late input.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Late {
    input: usize,
    delay: f64,
    past: Past,
}

impl Late {
    pub fn new(delay: &Delay) -> Self {
        Self { input: delay.input, delay: delay.delay, past: delay.past }
    }

    /// How far a time before the record is moved into it, where the input repeated.
    fn shift(&self, inputs: &Inputs, s: f64) -> f64 {
        match self.past {
            Past::Periodic(period) if s < inputs.start() => ((inputs.start() - s) / period).ceil() * period,
            _ => 0.0,
        }
    }

    /// Value, rate and its rate at `t`, by the polynomial that holds the instant `inside`.
    pub fn eval(&self, inputs: &Inputs, inside: f64, t: f64) -> [f64; 3] {
        let s = inside - self.delay;
        let shift = self.shift(inputs, s);
        let (c, from) = inputs.piece(self.input, s + shift);
        if s < inputs.start() {
            match self.past {
                Past::Zero => return [0.0; 3],
                Past::Hold => return [inputs.piece(self.input, inputs.start()).0[0], 0.0, 0.0],
                Past::Periodic(_) => {}
            }
        }
        let s = t - self.delay + shift - from;
        [
            c[0] + s * (c[1] + s * (c[2] + s * c[3])),
            c[1] + s * (2.0 * c[2] + s * 3.0 * c[3]),
            2.0 * c[2] + s * 6.0 * c[3],
        ]
    }

    /// The first instant after `t` where its polynomial changes.
    pub fn next_knot(&self, inputs: &Inputs, t: f64) -> f64 {
        let (s, start) = (t - self.delay, inputs.start());
        if s >= start {
            return inputs.next_sample(s) + self.delay;
        }
        let shift = self.shift(inputs, s);
        let inside = match self.past {
            Past::Periodic(period) => inputs.next_sample(s + shift).min(start + period) - shift,
            _ => start,
        };
        inside.min(start) + self.delay
    }
}
