//! Level 3: harmonic transfer functions from recordings, without any model.
//!
//! [`spectra`] turns recordings into lines on which the clock is a whole number of bins, and refuses what cannot be
//! identified. Three methods read them: [`floquet`] fits numerators of finite memory over one common denominator, whose
//! roots are the Floquet multipliers; [`curvature`] is Siddiqi's least squares with a smoothness penalty; [`lines`] divides
//! line by line where the excitation is periodic. [`rest`] asks what outputs show while the input rests. Nothing here can
//! see a model, so nothing can peek at the truth.
//!
//! Machines without a clock have only their events to tell the time: [`phase`] makes a phase of them, [`orbit`] averages
//! over cycles, [`arx`] estimates a discrete linear time-periodic model and [`held_out`] says what it is worth, and
//! [`section`] estimates the map from one cycle to the next.

pub mod arx;
mod clock;
pub mod curvature;
pub mod floquet;
pub mod held_out;
pub mod lines;
pub mod orbit;
pub mod phase;
pub mod rest;
pub mod section;
pub mod spectra;
#[cfg(test)]
mod testing;

use crate::error::Result;
use crate::periodic::Htf;
use crate::signal::Recording;
pub use spectra::Spectra;

/// What to estimate, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Period T of the system, s.
    pub period: f64,
    /// Largest harmonic K: harmonics -K..=K are estimated.
    pub harmonics: usize,
    /// Largest input frequency of the estimate, rad/s; `None`: as far as the input has power.
    pub band: Option<f64>,
    /// What the outputs hold of the periodic orbit.
    pub orbit: Orbit,
    /// The estimator and its own options.
    pub method: Method,
}

/// What the outputs hold of the periodic orbit around which the system is linear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Orbit {
    /// Outputs are deviations: the orbit was subtracted.
    #[default]
    Deviation,
    /// Outputs contain the orbit, or what is left of it: output lines at multiples of the pumping frequency, and a few on
    /// either side, carry no information and are left out.
    Removed,
}

/// The estimators.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// Common Floquet denominator with numerators of finite memory: for any input.
    Floquet(floquet::Options),
    /// Least squares with a curvature penalty: for any input.
    Curvature(curvature::Options),
    /// Quotients of lines: for periodic inputs.
    Lines(lines::Options),
}

/// Harmonic transfer functions of the system that made `recordings` (of the same inputs and outputs).
///
/// The times of a recording are those of the clock: samples at `t` and `t + T` see the same system.
///
/// # Errors
/// As [`Spectra::new`] for recordings that cannot be used, and as the method says.
pub fn identify(recordings: &[Recording], options: &Options) -> Result<Htf> {
    let spectra = Spectra::new(recordings, options)?;
    let mut htf = match &options.method {
        Method::Floquet(own) => floquet::identify(&spectra, options, own),
        Method::Curvature(own) => curvature::identify(&spectra, options, own),
        Method::Lines(own) => lines::identify(&spectra, options, own),
    }?;
    // An orbit that is still in the outputs is no bias: its lines are left out.
    if options.orbit == Orbit::Deviation {
        let rests = rest::rests(recordings, options.period);
        htf.warnings.extend(rests.iter().filter(|r| r.is_biased()).map(rest::Rest::sentence));
    }
    Ok(htf)
}

#[cfg(test)]
mod planted;
