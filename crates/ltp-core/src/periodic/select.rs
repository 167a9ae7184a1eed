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
            jumps: s
                .jumps
                .iter()
                .map(|j| Jump { input: part(&j.input, (nx, nu), &states, inputs), ..j.clone() })
                .collect(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::periodic::Entry;
    use crate::periodic::system::NODES;

    /// A mass on a spring, kicked at the end of its period, with two inputs and two outputs.
    fn system() -> LtpSystem {
        let each = |matrix: &[f64]| matrix.repeat(NODES);
        let jump =
            Jump { name: "kick".into(), time: 1.0, state: vec![1.0, 0.0, 0.0, 0.5], input: vec![0.1, 0.2, 0.3, 0.4] };
        let segment = Segment {
            start: 0.0,
            end: 1.0,
            a: each(&[0.0, 1.0, -4.0, -0.4]),
            b: each(&[1.0, 2.0, 3.0, 4.0]),
            c: each(&[5.0, 6.0, 7.0, 8.0]),
            d: each(&[9.0, 10.0, 11.0, 12.0]),
            jumps: vec![jump],
        };
        LtpSystem::new(1.0, 0.0, Size { nx: 2, nu: 2, ny: 2 }, vec![segment]).expect("system")
    }

    #[test]
    fn transfer_functions_of_the_part_are_those_of_the_whole() {
        let whole = system().htf(&[0.0, 1.3], 2).expect("whole");
        let part = system().select(&[1], &[1, 0]).expect("selected").htf(&[0.0, 1.3], 2).expect("part");
        for k in -2..=2 {
            for i in 0..2 {
                for (y, from) in [1, 0].into_iter().enumerate() {
                    assert_eq!(
                        part.value(k, i, y, 0),
                        whole.value(k, i, from, 1),
                        "k {k}, frequency {i}, output {from}"
                    );
                }
            }
        }
    }

    #[test]
    fn rows_and_columns_are_the_chosen_ones() {
        let part = system().select(&[1], &[0]).expect("selected");
        let found = [Entry::B, Entry::C, Entry::D].map(|entry| part.matrix(entry, 0.5));
        let expected = [vec![2.0, 4.0], vec![5.0, 6.0], vec![10.0]];
        for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert_eq!(part.jumps().next().map(|j| j.input.clone()), Some(vec![0.2, 0.4]));
        assert!(system().select(&[2], &[0]).is_err());
    }
}
