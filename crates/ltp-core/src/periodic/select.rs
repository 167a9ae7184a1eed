//! Some of the inputs and outputs of a linear time-periodic system.

use super::system::{Jump, LtpSystem, Segment, Size};
use crate::error::{Error, Result};

impl LtpSystem {
    /// The system with only these inputs and outputs, in this order.
    ///
    /// # Errors
    /// `OutOfRange` for an index that is not there.
    pub fn select(&self, inputs: &[usize], outputs: &[usize]) -> Result<Self> {
        let Size { nx, nu, ny } = self.size();
        for (what, chosen, count) in [("input", inputs, nu), ("output", outputs, ny)] {
            if let Some(&index) = chosen.iter().find(|&&index| index >= count) {
                let expected = format!("below {count}, the number of {what}s");
                return Err(Error::OutOfRange { what: what.into(), found: index as f64, expected });
            }
        }
        let states: Vec<usize> = (0..nx).collect();
        let segments = self.segments().iter().map(|s| Segment {
            start: s.start,
            end: s.end,
            a: s.a.clone(),
            b: part(&s.b, (nx, nu), &states, inputs),
            c: part(&s.c, (ny, nx), outputs, &states),
            d: part(&s.d, (ny, nu), outputs, inputs),
            jumps: s.jumps.iter().map(|j| Jump { input: part(&j.input, (nx, nu), &states, inputs), ..j.clone() }).collect(),
        });
        let size = Size { nx, nu: inputs.len(), ny: outputs.len() };
        Self::new(self.period(), self.start(), size, segments.collect())
    }
}

/// Chosen rows and columns of row-major matrices of one size that follow each other.
fn part(values: &[f64], size: (usize, usize), rows: &[usize], columns: &[usize]) -> Vec<f64> {
    let (height, width) = size;
    if height * width == 0 {
        return Vec::new();
    }
    let each = values.chunks(height * width);
    each.flat_map(|m| rows.iter().flat_map(move |&r| columns.iter().map(move |&c| m[r * width + c]))).collect()
}
