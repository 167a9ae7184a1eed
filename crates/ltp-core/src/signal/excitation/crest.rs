//! Lower peaks for the same power: the phases of a multisine by repeated clipping.
//!
//! Clip the signal, keep the phases of what is left, put the amplitudes back, again and again, at a clipping level that
//! rises from half the peak to nearly all of it. The peak falls on the whole but not at every turn: the best phases that were
//! met are kept, so that the crest factor never gets worse.
//!
//! Reference: E. Van der Ouderaa, J. Schoukens, J. Renneboog, *Peak factor minimization using a time-frequency domain
//! swapping algorithm*, IEEE Transactions on Instrumentation and Measurement 37(1) (1988) 145-147.

use crate::numeric::{Complex, fft};

/// Clipping level over peak, at the first and at the last turn.
const LEVELS: (f64, f64) = (0.5, 0.95);
/// Samples per cycle of the highest line, at least.
const OVERSAMPLING: usize = 8;

/// Largest magnitude over rms of the sum of cosines on `lines`, on a grid of one period.
pub(super) fn factor(lines: &[usize], amplitudes: &[f64], phases: &[f64]) -> f64 {
    let x = period(lines, amplitudes, phases);
    peak(&x) / (0.5 * amplitudes.iter().map(|a| a * a).sum::<f64>()).sqrt()
}

/// Phases with a lower peak than `phases`, or as low, after so many turns.
pub(super) fn reduce(lines: &[usize], amplitudes: &[f64], phases: &[f64], turns: usize) -> Vec<f64> {
    let mut phases = phases.to_vec();
    let mut x = period(lines, amplitudes, &phases);
    let (mut lowest, mut best) = (peak(&x), phases.clone());
    for turn in 0..turns {
        let share = turn as f64 / turns as f64;
        let level = (LEVELS.0 + share * (LEVELS.1 - LEVELS.0)) * peak(&x);
        x.iter_mut().for_each(|v| *v = v.clamp(-level, level));
        let spectrum = fft::forward(&x);
        phases = lines.iter().map(|&b| spectrum[b].arg()).collect();
        x = period(lines, amplitudes, &phases);
        if peak(&x) < lowest {
            (lowest, best) = (peak(&x), phases.clone());
        }
    }
    best
}

/// One period of the sum of cosines.
fn period(lines: &[usize], amplitudes: &[f64], phases: &[f64]) -> Vec<f64> {
    let highest = lines.last().copied().unwrap_or(0);
    let n = (OVERSAMPLING * highest).next_power_of_two();
    let mut spectrum = vec![Complex::ZERO; highest + 1];
    for ((&b, &a), &phase) in lines.iter().zip(amplitudes).zip(phases) {
        spectrum[b] = Complex::from_polar(0.5 * a * n as f64, phase);
    }
    fft::inverse(&spectrum, n)
}

fn peak(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most, v| most.max(v.abs()))
}

#[cfg(test)]
mod tests {
    use crate::signal::excitation::{Excitation, Multisine};

    fn random(lines: Vec<usize>, seed: u64) -> Multisine {
        Multisine::random(1.0, lines, None, 1.0, seed).expect("multisine")
    }

    #[test]
    fn one_line_has_the_crest_of_a_sine() {
        // The grid of 24 samples meets the peak within half a step, 7.5 degrees.
        let crest = random(vec![3], 1).crest();
        assert!((2.0_f64.sqrt() * (7.5_f64).to_radians().cos()..=2.0_f64.sqrt()).contains(&crest), "{crest}");
    }

    #[test]
    fn the_crest_is_that_of_the_samples() {
        let signal = random((1..40).collect(), 2);
        // 312 samples per period become 512.
        let peak = signal.samples(1.0 / 512.0, 512).into_iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        assert!((signal.crest() - peak).abs() < 1e-12);
    }

    #[test]
    fn peaks_fall_and_the_power_stays() {
        for seed in 0..5 {
            let before = random((0..100).map(|i| 2 * i + 1).collect(), seed);
            let after = before.clone().with_low_crest(200);
            assert_eq!((after.lines(), after.amplitudes()), (before.lines(), before.amplitudes()));
            // Random phases of 100 lines give 3 to 4; published minima for flat spectra are near 1.5.
            assert!(before.crest() > 2.5 && after.crest() < 2.0, "{} {}", before.crest(), after.crest());
        }
    }

    #[test]
    fn the_crest_never_gets_worse() {
        // Two lines of unlike size leave little to gain, and a single turn may well be a bad one.
        for (seed, turns) in (0..20).zip([0, 1, 2, 5].into_iter().cycle()) {
            let before = random(vec![1, 2, 9, 10], seed);
            let after = before.clone().with_low_crest(turns);
            assert!(after.crest() <= before.crest(), "seed {seed}, {turns} turns");
            assert!(turns > 0 || after == before);
        }
    }
}
