//! Which lines of a multisine are excited, so that what comes out can be told apart.
//!
//! A multisine that repeats after `n` periods of a periodic system has its lines at `b w_p / n`, `b = 1, 2, ...`. The system
//! answers line `b` at all `b + k n`, and a real input holds `-b` as well. So two lines meet somewhere in the output when
//! their residues modulo `n` agree up to sign, and a line meets itself when `2 b` is a multiple of `n`, that is on
//! multiples of half the pumping frequency. [`Kind::Distinct`] leaves both out: every output line then has one source, and
//! `H_k(j w_b) = Y(b + k n) / U(b)` for every harmonic `k`.
//!
//! Odd lines of an even `n` have odd answers; what stands on even lines is distortion of even order, and noise.

use std::f64::consts::TAU;

use super::{SLACK, check_band, positive};
use crate::error::{Error, Result};

/// The grid from which lines are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Odd lines whose residues differ up to sign: at most a quarter of the number of periods.
    #[default]
    Distinct,
    /// Odd lines.
    Odd,
    /// All lines.
    Full,
}

/// What is done with multiples of half the pumping frequency, where a line's own mirror image answers at the same places.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HalfPumping {
    /// They are left out.
    #[default]
    Avoid,
    /// Only they are taken, to see what they do.
    On,
    /// They are lines like any other.
    Any,
}

/// How a smaller number of lines is spread over the band.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Spread {
    /// Evenly in frequency.
    #[default]
    Uniform,
    /// Evenly in its logarithm.
    Log,
}

/// Which lines are excited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// The grid.
    pub kind: Kind,
    /// Multiples of half the pumping frequency.
    pub half_pumping: HalfPumping,
    /// How many lines; `None` for all that there are.
    pub count: Option<usize>,
    /// Where they stand when there are fewer than there could be.
    pub spread: Spread,
}

/// Lines of a multisine of `cycles` periods T = `period` (s) in `band` (rad/s, both ends included), increasing.
///
/// Line `b` stands at `2 pi b / (cycles period)` rad/s; zero is none.
///
/// # Errors
/// [`Error::OutOfRange`] for a period or a band that cannot be, for distinct lines of an odd number of cycles (answers to odd
/// lines would not be odd), when no line is left, or when fewer are there than wanted.
pub fn choose(period: f64, cycles: usize, band: (f64, f64), choice: &Choice) -> Result<Vec<usize>> {
    positive("period", period, "s")?;
    check_band(band)?;
    if choice.kind == Kind::Distinct && !(cycles >= 4 && cycles.is_multiple_of(2)) {
        let expected =
            "an even number of periods from 4 on for distinct odd lines; add or take one, or choose full lines";
        return Err(Error::OutOfRange { what: "cycles".into(), found: cycles as f64, expected: expected.into() });
    }
    let all = period * cycles as f64 / TAU;
    let ends = ((band.0 * all * (1.0 - SLACK)).ceil().max(1.0), (band.1 * all * (1.0 + SLACK)).floor());
    let range = ends.0 as usize..=ends.1 as usize;
    let mirrored = |b: usize| (2 * b).is_multiple_of(cycles);
    let mut lines: Vec<usize> = match choice.kind {
        Kind::Distinct => distinct(cycles, *range.start(), *range.end()),
        Kind::Odd => range.filter(|b| b % 2 == 1).collect(),
        Kind::Full => range.collect(),
    };
    lines.retain(|&b| match choice.half_pumping {
        HalfPumping::Avoid => !mirrored(b),
        HalfPumping::On => mirrored(b),
        HalfPumping::Any => true,
    });
    let wanted = choice.count.unwrap_or(lines.len()).max(1);
    if lines.len() < wanted {
        let what = format!("lines in the band from {} to {} rad/s", band.0, band.1);
        let (found, spacing) = (lines.len() as f64, 1.0 / all);
        let expected = format!(
            "at least {wanted}; they are chosen from a grid of {spacing:.4} rad/s: widen the band, take more cycles than \
             {cycles}, or choose more kinds of lines"
        );
        return Err(Error::OutOfRange { what, found, expected });
    }
    Ok(thin(&lines, wanted, choice.spread))
}

/// Odd lines in `low..=high`, one of each class of residues modulo `n` up to sign, spread over the whole range.
///
/// A class has a member in each stretch of `n/2` lines; neighbouring classes take theirs from the stretches in turn. Turns go
/// in the order of van der Corput (0, 1/2, 1/4, 3/4, ... of the band), so that a round that ends early has been everywhere.
fn distinct(n: usize, low: usize, high: usize) -> Vec<usize> {
    let mut turn = 0;
    let mut lines: Vec<usize> = Vec::new();
    for residue in (1..n.div_ceil(2)).step_by(2) {
        let members = (0..=high / n).flat_map(|m| [m * n + residue, (m + 1) * n - residue]);
        let members: Vec<usize> = members.filter(|b| (low..=high).contains(b)).collect();
        if !members.is_empty() {
            lines.push(members[scattered(turn % members.len(), members.len())]);
            turn += 1;
        }
    }
    lines.sort_unstable();
    lines
}

/// Number `turn` of `0..count` in the order of van der Corput: by their binary digits read backwards.
fn scattered(turn: usize, count: usize) -> usize {
    let bits = count.next_power_of_two().trailing_zeros();
    let reversed = |i: usize| (0..bits).fold(0, |sum, bit| sum | (i >> bit & 1) << (bits - 1 - bit));
    (0..1_usize << bits).map(reversed).filter(|&i| i < count).nth(turn).unwrap_or(0)
}

/// `count` of the increasing `lines`, as near to an even spread from the first to the last as they allow.
fn thin(lines: &[usize], count: usize, spread: Spread) -> Vec<usize> {
    let (first, last) = (lines[0] as f64, lines[lines.len() - 1] as f64);
    let mut next = 0;
    let mut chosen = Vec::with_capacity(count);
    for i in 0..count {
        let share = if count > 1 { i as f64 / (count - 1) as f64 } else { 0.5 };
        let target = match spread {
            Spread::Uniform => first + share * (last - first),
            Spread::Log => first * (last / first).powf(share),
        };
        let above = lines.partition_point(|&b| (b as f64) < target).min(lines.len() - 1);
        let below = above.saturating_sub(1);
        let nearest = if target - lines[below] as f64 <= lines[above] as f64 - target { below } else { above };
        // Every line is taken once, and enough are left for those that follow.
        let place = nearest.max(next).min(lines.len() - (count - i));
        chosen.push(lines[place]);
        next = place + 1;
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashSet;

    /// Lines of one period of 1 s; the band in lines.
    fn lines(cycles: usize, low: usize, high: usize, choice: Choice) -> Result<Vec<usize>> {
        let omega = |b: usize| TAU * b as f64 / cycles as f64;
        choose(1.0, cycles, (omega(low), omega(high)), &choice)
    }

    fn kind(kind: Kind) -> Choice {
        Choice { kind, ..Choice::default() }
    }

    proptest! {
        #[test]
        fn every_output_line_of_distinct_lines_has_one_source(
            half in 2..200_usize, low in 0..300_usize, width in 2..1500_usize,
        ) {
            let n = 2 * half;
            let Ok(lines) = lines(n, low, low + width, kind(Kind::Distinct)) else {
                // Only when each odd line of the band is an odd multiple of n/2.
                let left = (low.max(1)..=low + width).filter(|b| b % 2 == 1 && 2 * b % n != 0).count();
                prop_assert_eq!(left, 0);
                return Ok(());
            };
            // The slow way: list where each line, and its mirror image, is answered.
            let mut answered = HashSet::new();
            for &b in &lines {
                prop_assert!(b % 2 == 1 && b >= low.max(1) && b <= low + width);
                for k in -5..=5_i64 {
                    prop_assert!(answered.insert(b as i64 + k * n as i64));
                    prop_assert!(answered.insert(-(b as i64) + k * n as i64));
                }
            }
            // None was forgotten: each class of residues that the band has gives a line.
            let classes: HashSet<usize> = (low.max(1)..=low + width)
                .filter(|b| b % 2 == 1 && 2 * b % n != 0)
                .map(|b| (b % n).min(n - b % n))
                .collect();
            prop_assert_eq!(lines.len(), classes.len());
            // They reach over the band: within a stretch every class has its turn in `2 turns` lines; a fold of stretches
            // and the place where the band's end changes the number of turns can each lose a turn. (With less than four
            // rounds of turns there are too few lines to say so.)
            let turns = width / half + 2;
            for pair in lines.windows(2) {
                let gap = pair[1] - pair[0];
                prop_assert!(lines.len() < 4 * turns || gap <= 6 * turns, "{} turns, {:?}", turns, lines);
            }
        }

        #[test]
        fn fewer_lines_are_a_spread_subset(count in 1..40_usize, log in any::<bool>()) {
            let all = lines(400, 1, 700, kind(Kind::Distinct))?;
            let spread = if log { Spread::Log } else { Spread::Uniform };
            let some = lines(400, 1, 700, Choice { count: Some(count), spread, ..Choice::default() })?;
            prop_assert_eq!(some.len(), count);
            prop_assert!(some.windows(2).all(|w| w[0] < w[1]));
            prop_assert!(some.iter().all(|b| all.contains(b)));
            if count > 1 {
                prop_assert!(some[0] == all[0] && some[count - 1] == all[all.len() - 1]);
            }
        }
    }

    #[test]
    fn turns_are_scattered() {
        let order = |count| (0..count).map(|turn| scattered(turn, count)).collect::<Vec<_>>();
        assert_eq!(order(1), [0]);
        assert_eq!(order(3), [0, 2, 1]);
        assert_eq!(order(8), [0, 4, 2, 6, 1, 5, 3, 7]);
    }

    #[test]
    fn the_hopper_s_lines() {
        // 1272 periods of 0.33 s, 0 to 5 Hz: a line for each of 1272/4 classes.
        let found = choose(0.33, 1272, (0.0, TAU * 5.0), &Choice::default()).expect("lines");
        assert_eq!(found.len(), 318);
        assert_eq!((found[0], found[317]), (1, 2097));
        // 5 Hz stands at 2098.8; the even line below it belongs to nobody.
        assert_eq!(choose(0.33, 1272, (0.0, TAU * 5.0), &kind(Kind::Odd)).expect("lines").len(), 1049);
    }

    #[test]
    fn log_spread_is_even_in_octaves() {
        let choice = Choice { kind: Kind::Full, count: Some(9), spread: Spread::Log, ..Choice::default() };
        assert_eq!(lines(10_001, 16, 4096, choice), Ok(vec![16, 32, 64, 128, 256, 512, 1024, 2048, 4096]));
    }

    #[test]
    fn half_the_pumping_frequency_is_avoided_or_sought() {
        let half = |half_pumping| Choice { kind: Kind::Full, half_pumping, ..Choice::default() };
        assert_eq!(lines(6, 1, 10, half(HalfPumping::Avoid)), Ok(vec![1, 2, 4, 5, 7, 8, 10]));
        assert_eq!(lines(6, 1, 10, half(HalfPumping::On)), Ok(vec![3, 6, 9]));
        assert_eq!(lines(6, 1, 4, half(HalfPumping::Any)), Ok(vec![1, 2, 3, 4]));
        // Of an odd number of cycles, only whole multiples of the pumping frequency are lines.
        assert_eq!(lines(5, 1, 10, half(HalfPumping::On)), Ok(vec![5, 10]));
    }

    #[test]
    fn band_ends_on_a_line_include_it() {
        for n in [3, 7, 49, 1300] {
            let found = lines(n, 3, 11, Choice { half_pumping: HalfPumping::Any, ..kind(Kind::Full) });
            assert_eq!(found, Ok((3..=11).collect()), "{n} cycles");
        }
    }

    #[test]
    fn what_cannot_be_chosen_is_said() {
        let odd = lines(7, 1, 20, Choice::default()).expect_err("odd cycles");
        assert!(odd.to_string().contains("cycles = 7"), "{odd}");
        let none = lines(400, 2, 2 + 1, Choice { half_pumping: HalfPumping::On, ..Choice::default() });
        assert!(none.expect_err("no line").to_string().contains("at least 1"));
        let few = lines(400, 1, 9, Choice { count: Some(6), ..Choice::default() }).expect_err("few");
        assert!(few.to_string().contains("at least 6"), "{few}");
        assert!(choose(0.0, 4, (0.0, 1.0), &Choice::default()).is_err());
        assert!(choose(1.0, 4, (2.0, 1.0), &Choice::default()).is_err());
    }
}
