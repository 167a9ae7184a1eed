//! Chirps, and their repetitions at shifted phases of the clock of a periodic system.
//!
//! Source: I. Uyanik et al., *Identification of a vertical hopping robot model via harmonic transfer functions*, Transactions
//! of the Institute of Measurement and Control (2015), equations (18) and (19); after A. Siddiqi, *Identification of the
//! harmonic transfer functions of a helicopter rotor*, MIT 2001.

use super::{Excitation, SLACK, check_band, finite, positive};
use crate::error::{Error, Result};

/// A sine whose frequency rises linearly from one end of a band to the other; zero before and after.
///
/// `amplitude sin(low t + (high - low) t^2 / (2 duration))` for `0 <= t < duration`. With 0.1, 0 to 5 Hz and 20 s this is
/// the `0.1 sin(0.25 pi t^2)` of equation (18).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chirp {
    amplitude: f64,
    band: (f64, f64),
    duration: f64,
}

impl Chirp {
    /// A chirp through `band` (rad/s) in `duration` (s).
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a number that is not finite, a duration that is not positive, or a band that does not rise
    /// from zero or above.
    pub fn new(amplitude: f64, band: (f64, f64), duration: f64) -> Result<Self> {
        finite("amplitude", amplitude, "unit of the input")?;
        positive("duration of the chirp", duration, "s")?;
        check_band(band)?;
        Ok(Self { amplitude, band, duration })
    }

    /// Duration, s.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// The sweep at `t` (s), also beyond its ends, where it goes on at the same rate.
    fn sweep(&self, t: f64) -> f64 {
        let (low, high) = self.band;
        self.amplitude * (low * t + (high - low) * t * t / (2.0 * self.duration)).sin()
    }
}

impl Excitation for Chirp {
    fn value(&self, t: f64) -> f64 {
        if t < 0.0 || t >= self.duration * (1.0 - SLACK) { 0.0 } else { self.sweep(t) }
    }
}

/// When the repetitions of a chirp start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timing {
    /// As published: repetition `i` (from 0) occupies the slot `i D <= t < (i+1) D` of the chirp's duration D, and starts `i T/n`
    /// ahead of it, so that its first `i T/n` fall away and it sweeps on to the end of its slot, past the band by
    /// `i T/(n D)` of it. The paper bounds its own time by D below equation (18) and fills the slots in equation (19); filled
    /// slots give the error it prints (3.3 % at 1 Hz), empty ends half of it. The phases of the clock at the starts are
    /// multiples of `D/T - 1/n`, modulo 1; they are not even unless D is a multiple of T.
    #[default]
    Published,
    /// Slots of whole periods (D rounded up), and each repetition `T/n` later in its slot than the one before: phases of
    /// the clock at the starts are 0, 1/n, 2/n, ..., and no chirp is cut.
    Even,
}

/// Repetitions of one chirp, each shifted by a fraction of the period; zero afterwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseShiftedChirps {
    chirp: Chirp,
    period: f64,
    repetitions: usize,
    timing: Timing,
}

impl PhaseShiftedChirps {
    /// `repetitions` of `chirp` for a system of `period` T, s.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] when the period is not positive and finite or not shorter than the chirp, or without a
    /// repetition.
    pub fn new(chirp: Chirp, period: f64, repetitions: usize, timing: Timing) -> Result<Self> {
        positive("period", period, "s")?;
        if period >= chirp.duration {
            let expected = format!("shorter than the chirp, {} s: shifts are fractions of a period", chirp.duration);
            return Err(Error::OutOfRange { what: "period".into(), found: period, expected });
        }
        if repetitions == 0 {
            let expected = "at least 1; the paper takes one for each harmonic transfer function, 21".into();
            return Err(Error::OutOfRange { what: "repetitions".into(), found: 0.0, expected });
        }
        Ok(Self { chirp, period, repetitions, timing })
    }

    /// End of the last slot, s: from here on the input is zero.
    pub fn duration(&self) -> f64 {
        self.repetitions as f64 * self.slot()
    }

    /// Length of a slot, s; even ones hold their chirp and its shift.
    fn slot(&self) -> f64 {
        match self.timing {
            Timing::Published => self.chirp.duration,
            Timing::Even => {
                let last = (self.repetitions - 1) as f64 / self.repetitions as f64;
                ((self.chirp.duration / self.period + last - SLACK).ceil()) * self.period
            }
        }
    }
}

impl Excitation for PhaseShiftedChirps {
    fn value(&self, t: f64) -> f64 {
        let slot = self.slot();
        let i = (t / slot + SLACK).floor();
        if i < 0.0 || i >= self.repetitions as f64 {
            return 0.0;
        }
        let shift = i * self.period / self.repetitions as f64;
        match self.timing {
            Timing::Published => self.chirp.sweep((t - i * slot).max(0.0) + shift),
            Timing::Even => self.chirp.value(t - i * slot - shift),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    const T: f64 = 0.33;

    fn paper(timing: Timing) -> PhaseShiftedChirps {
        let chirp = Chirp::new(0.1, (0.0, TAU * 5.0), 20.0).expect("chirp");
        PhaseShiftedChirps::new(chirp, T, 21, timing).expect("chirps")
    }

    #[test]
    fn the_paper_s_record_sample_by_sample() {
        let record = paper(Timing::Published).samples(1e-3, 462_000);
        for (n, value) in record.iter().enumerate() {
            let (i, t) = (n / 20_000, n as f64 * 1e-3);
            let ti = t - i as f64 * 20.0 + i as f64 * T / 21.0;
            let expected = if i < 21 { 0.1 * (0.25 * PI * ti * ti).sin() } else { 0.0 };
            // The phase, up to 100 pi, carries an error of the time, which is up to 462 s, times 10 pi rad/s.
            assert!((value - expected).abs() < 1e-12, "sample {n}: {value} {expected}");
        }
        // The last chirp has lost its first 20/21 of a period, and goes on for as long at its end.
        assert!((record[400_000] - 0.1 * (0.25 * PI * (20.0 * T / 21.0_f64).powi(2)).sin()).abs() < 1e-14);
        assert!(record[420_000..].iter().all(|&u| u == 0.0) && record[419_990] != 0.0);
    }

    #[test]
    fn published_phases_are_multiples_of_43_of_77() {
        // Repetition i starts (its own time is zero) at 20 i - i T/21.
        let phases: Vec<f64> = (0..21).map(|i| (f64::from(i) * (20.0 - T / 21.0) / T).rem_euclid(1.0)).collect();
        for (i, phase) in phases.iter().enumerate() {
            let expected = ((i * 43) % 77) as f64 / 77.0;
            assert!((phase - expected).abs() < 1e-9, "{i}: {phase} {expected}");
        }
    }

    #[test]
    fn even_repetitions_are_whole_and_start_at_even_phases() {
        let signal = paper(Timing::Even);
        let single = Chirp::new(0.1, (0.0, TAU * 5.0), 20.0).expect("chirp");
        let slot = signal.duration() / 21.0;
        assert!((slot / T - 62.0).abs() < 1e-12, "61 periods are 20.13 s: too short for the latest chirp");
        for i in 0..21 {
            let start = f64::from(i) * (slot + T / 21.0);
            assert!(((start / T) - (start / T).floor() - f64::from(i) / 21.0).abs() < 1e-9);
            for t in [0.0, 0.7, 13.3, 19.999] {
                assert!((signal.value(start + t) - single.value(t)).abs() < 1e-11, "chirp {i} at {t} s");
            }
            assert_eq!(signal.value(start - 1e-3), 0.0);
        }
        assert_eq!(signal.value(signal.duration()), 0.0);
    }

    #[test]
    fn the_sweep_ends_at_the_band_s_upper_end() {
        // Instantaneous frequency by the difference of phases, just before the end.
        let chirp = Chirp::new(1.0, (TAU * 1.0, TAU * 5.0), 20.0).expect("chirp");
        let phase = |t: f64| TAU * (t + 4.0 * t * t / 40.0);
        for t in [0.0, 3.3, 19.99] {
            assert!((chirp.value(t) - phase(t).sin()).abs() < 1e-12);
        }
        assert!(((phase(20.0) - phase(19.9999)) / 1e-4 - TAU * 5.0).abs() < 1e-3);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        assert!(Chirp::new(f64::NAN, (0.0, 1.0), 1.0).is_err());
        assert!(Chirp::new(1.0, (1.0, 1.0), 1.0).is_err());
        assert!(Chirp::new(1.0, (0.0, 1.0), 0.0).is_err());
        let chirp = Chirp::new(1.0, (0.0, 1.0), 1.0).expect("chirp");
        assert!(PhaseShiftedChirps::new(chirp, 1.0, 3, Timing::Even).is_err());
        assert!(PhaseShiftedChirps::new(chirp, 0.0, 3, Timing::Even).is_err());
        assert!(PhaseShiftedChirps::new(chirp, 0.5, 0, Timing::Even).is_err());
    }
}
