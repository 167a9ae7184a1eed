//! Inputs that experiments give to periodic systems: chirps, sines, steps, multisines, noise, and their design.
//!
//! A waveform is an [`Excitation`]: a function of time that is sampled from t = 0. The [`Multisine`] is one that knows its
//! lines; [`lines`] chooses them, [`crest`] lowers its peaks, [`design()`] puts a whole experiment together and predicts what it
//! will tell. [`noise()`] and [`add_noise`] spoil records by a stated amount.

pub mod chirp;
pub mod crest;
pub mod design;
pub mod lines;
pub mod multisine;
pub mod noise;
pub mod waves;

pub use chirp::{Chirp, PhaseShiftedChirps, Timing};
pub use design::{Design, Noise, Plan, Request, Shape, design, settling_periods};
pub use lines::{Choice, HalfPumping, Kind, Spread};
pub use multisine::Multisine;
pub use noise::{Noisy, add_noise, noise};
pub use waves::{Sine, Step};

use crate::error::{Error, Result};

/// Two instants nearer than this fraction of the interval between them are one: 20000 times 0.001 s need not be 20 s in
/// binary.
const SLACK: f64 = 1e-9;

/// An input as a function of time.
pub trait Excitation {
    /// Value at time `t`, s.
    fn value(&self, t: f64) -> f64;

    /// Values (n) at `0, dt, 2 dt, ...`, with `dt` in s.
    fn samples(&self, dt: f64, n: usize) -> Vec<f64> {
        (0..n).map(|i| self.value(i as f64 * dt)).collect()
    }
}

/// Number of samples from 0 to `end`, `dt` apart (both s), with both ends: the grid on which `simulate` takes its inputs.
///
/// # Errors
/// [`Error::OutOfRange`] when a time is not positive and finite, or `end` is shorter than `dt`.
pub fn count(end: f64, dt: f64) -> Result<usize> {
    positive("dt", dt, "s")?;
    positive("end of the samples", end, "s")?;
    let steps = (end / dt + SLACK).floor();
    if steps < 1.0 {
        let expected = format!("at least one step, dt = {dt} s; make dt smaller or the samples last longer");
        return Err(Error::OutOfRange { what: "end of the samples".into(), found: end, expected });
    }
    Ok(steps as usize + 1)
}

/// Refuses a number that is not positive and finite.
fn positive(what: &str, found: f64, unit: &str) -> Result<()> {
    if found > 0.0 && found.is_finite() {
        return Ok(());
    }
    let expected = format!("a positive, finite number ({unit}); correct it");
    Err(Error::OutOfRange { what: what.into(), found, expected })
}

/// Refuses a number that is not finite.
fn finite(what: &str, found: f64, unit: &str) -> Result<()> {
    if found.is_finite() {
        return Ok(());
    }
    let expected = format!("a finite number ({unit}); correct it");
    Err(Error::OutOfRange { what: what.into(), found, expected })
}

/// Refuses a band `(low, high)` in rad/s that is not `0 <= low < high`.
fn check_band((low, high): (f64, f64)) -> Result<()> {
    positive("upper end of the band", high, "rad/s")?;
    if low >= 0.0 && low < high {
        return Ok(());
    }
    let expected = format!("from 0 to below its upper end, {high} rad/s; correct the band (it is in rad/s, not in Hz)");
    Err(Error::OutOfRange { what: "lower end of the band".into(), found: low, expected })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_has_both_ends() {
        assert_eq!(count(0.3, 0.1), Ok(4));
        assert_eq!(count(462.0, 1e-3), Ok(462_001));
        assert_eq!(count(1.05, 0.1), Ok(11));
    }

    #[test]
    fn times_and_bands_that_cannot_be_are_refused() {
        for (end, dt) in [(0.0, 0.1), (1.0, 0.0), (1.0, f64::NAN), (f64::INFINITY, 0.1), (0.05, 0.1)] {
            assert!(matches!(count(end, dt), Err(Error::OutOfRange { .. })), "{end} {dt}");
        }
        for band in [(1.0, 1.0), (-1.0, 1.0), (2.0, 1.0), (0.0, f64::INFINITY), (f64::NAN, 1.0)] {
            assert!(matches!(check_band(band), Err(Error::OutOfRange { .. })), "{band:?}");
        }
        assert_eq!(check_band((0.0, 1.0)), Ok(()));
    }
}
