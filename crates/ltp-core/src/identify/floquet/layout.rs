//! Where every unknown of the Floquet model stands: splines on one grid of knots for all harmonics, ordered by output
//! frequency.
//!
//! The pumping frequency is a whole number of knot intervals, so the numerator of harmonic `k` at input frequency `nu` and the
//! row of output frequency `nu + k wp` fall into the same place of their intervals. A spline is named by its number `q` on the
//! *output* axis (bump `q` of [`crate::numeric::quartic`]); over one interval of output frequencies all harmonics then share
//! the same five numbers, and splines whose numbers differ by more than four never meet. Four numbers make a block of a
//! block tridiagonal system. The splines of negative frequencies are the mirror images `(k, q) -> (-k, 3 - q)` of the others.

use std::ops::RangeInclusive;

use crate::numeric::quartic::BUMPS;

/// Numbers of splines per block.
pub(super) const BLOCK: usize = BUMPS - 1;
/// Differences of this order hold the prior together.
const DIFFERENCE: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];

/// What an unknown multiplies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channel {
    /// Harmonic `k` of input `i`.
    Harmonic { k: i64, input: usize },
    /// What the state at the beginning of a record left behind.
    Transient { record: usize },
}

/// A place in the folded system: block, and row in it.
pub(super) type Place = (usize, usize);

/// Knots, unknowns and their order.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    /// Pumping frequency, rad/s.
    pub pumping: f64,
    /// Knot intervals per pumping frequency.
    pub knots: i64,
    /// Intervals of input frequencies on either side of zero.
    pub reach: i64,
    /// Intervals of output frequencies from zero upwards.
    pub cells: i64,
    /// Number of inputs.
    pub inputs: usize,
    /// Number of records whose beginnings are unknown.
    pub transients: usize,
    /// Middle of the memory of the numerators, s.
    pub delay: f64,
    /// Weight of the squared fourth differences against the squared coefficients.
    stiffness: f64,
    /// Per spline number: where its unknowns begin in its block.
    offsets: Vec<usize>,
    sizes: Vec<usize>,
}

impl Layout {
    /// The unknowns for numerators of `memory` (s) that reach over `reach` intervals of input frequency, seen by outputs on
    /// `cells` intervals.
    pub fn new(pumping: f64, knots: usize, memory: f64, reach: usize, cells: usize, channels: (usize, usize)) -> Self {
        let (inputs, transients) = channels;
        // Outside +-memory/2 around its middle a kernel is taken to fall as the eighth power of the lag: fourth differences
        // of the coefficients weigh as much as the coefficients at the edge.
        let phase = 0.25 * memory * pumping / knots as f64;
        let stiffness = (2.0 * phase.sin()).powi(-8);
        let mut layout = Layout {
            pumping,
            knots: knots as i64,
            reach: reach as i64,
            cells: cells as i64,
            inputs,
            transients,
            delay: 0.5 * memory,
            stiffness,
            offsets: Vec::new(),
            sizes: Vec::new(),
        };
        for q in 0..layout.cells + BLOCK as i64 {
            if (q as usize).is_multiple_of(BLOCK) {
                layout.sizes.push(0);
            }
            let block = layout.sizes.len() - 1;
            layout.offsets.push(layout.sizes[block]);
            layout.sizes[block] += layout.harmonics_of_spline(q).count() * inputs + transients;
        }
        layout
    }

    /// Width of an interval, rad/s.
    pub fn width(&self) -> f64 {
        self.pumping / self.knots as f64
    }

    /// Sizes of the blocks.
    pub fn sizes(&self) -> &[usize] {
        &self.sizes
    }

    /// Number of unknowns, those of negative frequencies included.
    pub fn unknowns(&self) -> usize {
        2 * self.sizes.iter().sum::<usize>() - self.sizes[0]
    }

    /// Largest harmonic that any row sees.
    pub fn highest(&self) -> i64 {
        *self.harmonics_of_spline(self.cells + BLOCK as i64 - 1).end()
    }

    /// Harmonics that have a spline of number `q`.
    fn harmonics_of_spline(&self, q: i64) -> RangeInclusive<i64> {
        -(self.reach + BLOCK as i64 - 1 - q).div_euclid(self.knots)..=(q + self.reach).div_euclid(self.knots)
    }

    /// Channels over the interval `cell >= 0` of output frequencies.
    pub fn channels_of_cell(&self, cell: i64) -> Vec<Channel> {
        let harmonics = -(self.reach - 1 - cell).div_euclid(self.knots)..=(cell + self.reach).div_euclid(self.knots);
        let pairs = harmonics.flat_map(|k| (0..self.inputs).map(move |input| Channel::Harmonic { k, input }));
        pairs.chain((0..self.transients).map(|record| Channel::Transient { record })).collect()
    }

    /// All channels.
    pub fn channels(&self) -> Vec<Channel> {
        let highest = self.highest();
        let pairs =
            (-highest..=highest).flat_map(|k| (0..self.inputs).map(move |input| Channel::Harmonic { k, input }));
        pairs.chain((0..self.transients).map(|record| Channel::Transient { record })).collect()
    }

    /// Number of groups of unknowns that share a scale.
    pub fn groups(&self) -> usize {
        (self.highest() as usize + 1) * self.inputs + self.transients
    }

    /// Group of a channel: both signs of a harmonic share one.
    pub fn group(&self, channel: Channel) -> usize {
        match channel {
            Channel::Harmonic { k, input } => k.unsigned_abs() as usize * self.inputs + input,
            Channel::Transient { record } => (self.highest() as usize + 1) * self.inputs + record,
        }
    }

    /// Place of spline `q >= 0` of a channel; `None` where it has none.
    pub fn place(&self, channel: Channel, q: i64) -> Option<Place> {
        if !(0..self.offsets.len() as i64).contains(&q) {
            return None;
        }
        let harmonics = self.harmonics_of_spline(q);
        let within = match channel {
            Channel::Harmonic { k, input } if harmonics.contains(&k) => {
                (k - harmonics.start()) as usize * self.inputs + input
            }
            Channel::Harmonic { .. } => return None,
            Channel::Transient { record } => harmonics.count() * self.inputs + record,
        };
        Some((q as usize / BLOCK, self.offsets[q as usize] + within))
    }

    /// Image of every unknown of the middle block.
    pub fn mirror(&self) -> Vec<usize> {
        let mut mirror = vec![0; self.sizes[0]];
        for channel in self.channels() {
            let image = match channel {
                Channel::Harmonic { k, input } => Channel::Harmonic { k: -k, input },
                transient @ Channel::Transient { .. } => transient,
            };
            for q in 0..BLOCK as i64 {
                let other = BLOCK as i64 - 1 - q;
                if let (Some((0, from)), Some((0, to))) = (self.place(channel, q), self.place(image, other)) {
                    mirror[from] = to;
                }
            }
        }
        mirror
    }

    /// Spline numbers of a channel, negative frequencies included.
    fn chain(&self, channel: Channel) -> (i64, i64) {
        let (first, last) = (-self.cells, self.cells + BLOCK as i64 - 1);
        match channel {
            Channel::Harmonic { k, .. } => {
                let middle = k * self.knots;
                ((middle - self.reach).max(first), (middle + self.reach + BLOCK as i64 - 1).min(last))
            }
            Channel::Transient { .. } => (first, last),
        }
    }

    /// Number of unknowns of every group, negative frequencies included.
    pub fn counts(&self) -> Vec<f64> {
        let mut counts = vec![0.0; self.groups()];
        for channel in self.channels() {
            let (first, last) = self.chain(channel);
            counts[self.group(channel)] += (last - first + 1).max(0) as f64;
        }
        counts
    }

    /// Visits the entries `(group, row, column, value)` of the precision that ties the coefficients of each channel together,
    /// for unit scale: the identity plus weighted squared fourth differences. Places of the stored half only, both triangles.
    pub fn precision(&self, mut visit: impl FnMut(usize, Place, Place, f64)) {
        for channel in self.channels() {
            let (group, (first, last)) = (self.group(channel), self.chain(channel));
            for q in first.max(0)..=last {
                let Some(row) = self.place(channel, q) else { continue };
                for other in (q - BLOCK as i64).max(first).max(0)..=(q + BLOCK as i64).min(last) {
                    let Some(column) = self.place(channel, other) else { continue };
                    let windows = q.max(other) - BLOCK as i64..=q.min(other);
                    let inside = windows.filter(|&s| s >= first && s + BLOCK as i64 <= last);
                    let squared: f64 =
                        inside.map(|s| DIFFERENCE[(q - s) as usize] * DIFFERENCE[(other - s) as usize]).sum();
                    visit(group, row, column, f64::from(u8::from(q == other)) + self.stiffness * squared);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout() -> Layout {
        Layout::new(6.0, 3, 2.0, 5, 11, (2, 1))
    }

    #[test]
    fn every_unknown_has_one_place() {
        let layout = layout();
        let mut seen: Vec<Vec<bool>> = layout.sizes().iter().map(|&n| vec![false; n]).collect();
        for channel in layout.channels() {
            for (block, row) in (0..20).filter_map(|q| layout.place(channel, q)) {
                assert!(!std::mem::replace(&mut seen[block][row], true));
            }
        }
        assert!(seen.iter().flatten().all(|&s| s));
        let counted: f64 = layout.counts().iter().sum();
        assert_eq!(counted as usize, layout.unknowns());
    }

    #[test]
    fn cells_find_all_their_splines() {
        let layout = layout();
        for cell in 0..layout.cells {
            for channel in layout.channels_of_cell(cell) {
                assert!((cell..cell + BUMPS as i64).all(|q| layout.place(channel, q).is_some()), "{channel:?} {cell}");
            }
        }
    }

    #[test]
    fn mirror_is_its_own_inverse() {
        let mirror = layout().mirror();
        assert!((0..mirror.len()).all(|i| mirror[mirror[i]] == i));
        assert!((0..mirror.len()).any(|i| mirror[i] != i));
    }

    #[test]
    fn precision_spares_cubics_and_is_its_own_image() {
        let layout = layout();
        let channel = Channel::Harmonic { k: 1, input: 1 };
        let mut found = 0;
        // Fourth differences of a cubic vanish: what is left is the identity.
        let cubic = |q: i64| 1.0 + 0.3 * q as f64 - 0.02 * (q * q * q) as f64;
        let q_of = |place: Place| (0..20).find(|&q| layout.place(channel, q) == Some(place));
        let mut product = vec![0.0; 20];
        layout.precision(|_, row, column, value| {
            if let (Some(q), Some(other)) = (q_of(row), q_of(column)) {
                product[q as usize] += value * cubic(other);
                found += 1;
            }
        });
        assert!(found > 30);
        // Splines 4 and 5 see their whole neighbourhood; 0 to 3 have neighbours of negative number that are not stored.
        for q in 4..=5 {
            assert!((product[q] - cubic(q as i64)).abs() < 1e-9 * layout.stiffness, "{q}: {product:?}");
        }
    }
}
