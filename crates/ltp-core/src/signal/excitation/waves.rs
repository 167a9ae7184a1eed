//! Single sines and steps: the inputs on which predictions are tested.

use super::{Excitation, finite};
use crate::error::{Error, Result};

/// `amplitude sin(omega t + phase)`, from t = 0 on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sine {
    amplitude: f64,
    omega: f64,
    phase: f64,
}

impl Sine {
    /// A sine of `omega` rad/s and `phase` rad at t = 0.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a number that is not finite, or a negative frequency.
    pub fn new(amplitude: f64, omega: f64, phase: f64) -> Result<Self> {
        finite("amplitude", amplitude, "unit of the input")?;
        finite("phase", phase, "rad")?;
        if !(omega.is_finite() && omega >= 0.0) {
            let expected = "a finite angular frequency from zero upwards, in rad/s".into();
            return Err(Error::OutOfRange { what: "omega".into(), found: omega, expected });
        }
        Ok(Self { amplitude, omega, phase })
    }
}

impl Excitation for Sine {
    fn value(&self, t: f64) -> f64 {
        self.amplitude * (self.omega * t + self.phase).sin()
    }
}

/// `amplitude` for `start <= t < end`, zero before and after: a step, or a pulse when `end` is finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    amplitude: f64,
    start: f64,
    end: f64,
}

impl Step {
    /// A step at `start` that is taken back at `end`, s; infinity for never.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a number that is not finite, or an end that is not after the start.
    pub fn new(amplitude: f64, start: f64, end: f64) -> Result<Self> {
        finite("amplitude", amplitude, "unit of the input")?;
        finite("start of the step", start, "s")?;
        if end.is_nan() || end <= start {
            let expected = format!("after its start, {start} s");
            return Err(Error::OutOfRange { what: "end of the step".into(), found: end, expected });
        }
        Ok(Self { amplitude, start, end })
    }
}

impl Excitation for Step {
    fn value(&self, t: f64) -> f64 {
        if t >= self.start && t < self.end { self.amplitude } else { 0.0 }
    }

    /// Edges within a billionth of a sample from a sample stand on it.
    fn samples(&self, dt: f64, n: usize) -> Vec<f64> {
        (0..n).map(|i| self.value((i as f64 + super::SLACK) * dt)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn a_sine_starts_at_its_phase() {
        let sine = Sine::new(2.0, 3.0, FRAC_PI_2).expect("sine");
        for (i, value) in sine.samples(0.1, 50).into_iter().enumerate() {
            assert!((value - 2.0 * (0.3 * i as f64).cos()).abs() < 1e-13, "sample {i}");
        }
    }

    #[test]
    fn a_pulse_has_its_edges_on_the_grid() {
        // 0.1 + 0.2 is more than 0.3 in binary: the edges are still those of samples 3 and 7.
        let pulse = Step::new(0.5, 0.1 + 0.2, 0.7).expect("pulse");
        assert_eq!(pulse.samples(0.1, 9), [0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5, 0.0, 0.0]);
        assert_eq!(Step::new(1.0, 0.0, f64::INFINITY).expect("step").samples(1.0, 3), [1.0; 3]);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        assert!(Sine::new(f64::NAN, 1.0, 0.0).is_err());
        assert!(Sine::new(1.0, -1.0, 0.0).is_err());
        assert!(Sine::new(1.0, 1.0, f64::INFINITY).is_err());
        assert!(Step::new(1.0, 1.0, 1.0).is_err());
        assert!(Step::new(1.0, 0.0, f64::NAN).is_err());
    }
}
