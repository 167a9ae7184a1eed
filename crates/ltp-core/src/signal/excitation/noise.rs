//! White Gaussian noise of a stated size, and records spoiled by it at a stated signal-to-noise ratio.

use super::positive;
use crate::error::{Error, Result};
use crate::numeric::rng::SplitMix64;
use crate::numeric::stats;

/// A record with noise on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Noisy {
    /// The samples.
    pub values: Vec<f64>,
    /// Standard deviation of the noise that was added, in the unit of the record.
    pub sd: f64,
}

/// White Gaussian noise (n) with zero mean and standard deviation `sd`; the same seed gives the same bits.
///
/// # Errors
/// [`Error::OutOfRange`] for a standard deviation that is negative or not finite.
pub fn noise(n: usize, sd: f64, seed: u64) -> Result<Vec<f64>> {
    if !(sd.is_finite() && sd >= 0.0) {
        let expected = "a finite number from zero upwards, in the unit of the signal; correct it".into();
        return Err(Error::OutOfRange { what: "sd".into(), found: sd, expected });
    }
    let mut random = SplitMix64::new(seed);
    Ok((0..n).map(|_| sd * random.normal()).collect())
}

/// `x` with white Gaussian noise such that `snr = (rms(x) / sd)^2`; gaps (NaN) stay gaps.
///
/// The standard deviation is exact, the noise is drawn: its own rms scatters by `1 / sqrt(2 n)`. The ratio counts the noise up
/// to half the sampling frequency `fs`; in a band B of the signal it is about `fs / (2 B)` times better, so a ratio says
/// nothing without its sampling frequency. Source: Uyanik et al. 2015, equations (21) and (22), and the definition of SNR that
/// follows them.
///
/// # Errors
/// [`Error::OutOfRange`] for a ratio that is not positive and finite, or a record that is zero, empty or infinite.
pub fn add_noise(x: &[f64], snr: f64, seed: u64) -> Result<Noisy> {
    positive("snr", snr, "mean square of the signal over that of the noise, not decibels")?;
    let rms = stats::rms(x.iter().copied());
    if !(rms > 0.0 && rms.is_finite()) {
        let expected =
            "a positive, finite number: noise is sized by it; give a record that is neither empty, zero nor \
                        infinite"
                .into();
        return Err(Error::OutOfRange { what: "rms of the signal".into(), found: rms, expected });
    }
    let sd = rms / snr.sqrt();
    let values = x.iter().zip(noise(x.len(), sd, seed)?).map(|(x, e)| x + e).collect();
    Ok(Noisy { values, sd })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ratio_is_the_one_asked_for() {
        let n = 40_000;
        let x: Vec<f64> = (0..n).map(|i| 3.0 * (0.37 * f64::from(i)).sin()).collect();
        let noisy = add_noise(&x, 12.5, 7).expect("noise");
        let added: Vec<f64> = noisy.values.iter().zip(&x).map(|(y, x)| y - x).collect();
        let rms = |v: &[f64]| stats::rms(v.iter().copied());
        assert!(((rms(&x) / noisy.sd).powi(2) - 12.5).abs() < 1e-12);
        // Four standard errors: 1/sqrt(2n) of the rms, 1/sqrt(n) of the mean and of the correlation of neighbours.
        let error = 4.0 / f64::from(n).sqrt();
        assert!((rms(&added) / noisy.sd - 1.0).abs() < error / 2.0_f64.sqrt());
        assert!((stats::mean(added.iter().copied()) / noisy.sd).abs() < error);
        let neighbours = stats::mean(added.windows(2).map(|w| w[0] * w[1])) / noisy.sd.powi(2);
        assert!(neighbours.abs() < error, "{neighbours}");
    }

    #[test]
    fn a_seed_is_a_record() {
        assert_eq!(noise(50, 1.0, 3), noise(50, 1.0, 3));
        assert_ne!(noise(50, 1.0, 3), noise(50, 1.0, 4));
    }

    #[test]
    fn gaps_stay_gaps_and_do_not_count() {
        let noisy = add_noise(&[2.0, f64::NAN, -2.0], 4.0, 1).expect("noise");
        assert_eq!(noisy.sd, 1.0);
        assert!(noisy.values[1].is_nan() && noisy.values[0].is_finite());
    }

    #[test]
    fn no_noise_is_sized_by_nothing() {
        for (x, snr) in [(&[1.0][..], 0.0), (&[1.0], f64::INFINITY), (&[0.0; 3], 2.0), (&[], 2.0), (&[f64::NAN], 2.0)] {
            assert!(matches!(add_noise(x, snr, 0), Err(Error::OutOfRange { .. })), "{x:?} {snr}");
        }
        assert!(noise(3, -1.0, 0).is_err() && noise(3, f64::NAN, 0).is_err());
        assert_eq!(noise(2, 0.0, 0), Ok(vec![0.0; 2]));
    }
}
