//! Excitations, their design, and how far a prediction is from what was measured.

use ltp_core::error::{Error, Result};
use ltp_core::signal::excitation::{self as core, Excitation};
use ltp_core::signal::metrics;
use numpy::{IntoPyArray, PyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{array, door};

/// An array of float64 on its way to Python.
type Vector<'py> = Bound<'py, PyArray1<f64>>;

/// Samples of an excitation from 0 to `t_end` (both included), `dt` apart.
fn sampled<'py, E: Excitation>(
    py: Python<'py>,
    t_end: Option<f64>,
    dt: f64,
    make: impl FnOnce() -> Result<(E, f64)> + Send,
) -> PyResult<Vector<'py>> {
    let samples = door::short(py, || {
        let (signal, end) = make()?;
        Ok(signal.samples(dt, core::count(t_end.unwrap_or(end), dt)?))
    })?;
    Ok(samples.into_pyarray(py))
}

/// A chirp through a band in rad/s, zero after `duration`.
#[pyfunction]
pub fn chirp<'py>(
    py: Python<'py>,
    amplitude: f64,
    band: (f64, f64),
    duration: f64,
    t_end: Option<f64>,
    dt: f64,
) -> PyResult<Vector<'py>> {
    sampled(py, t_end, dt, || Ok((core::Chirp::new(amplitude, band, duration)?, duration)))
}

/// Repetitions of a chirp at shifted phases of a clock, zero after the last.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "they are the arguments of Python")]
pub fn phase_shifted_chirps<'py>(
    py: Python<'py>,
    amplitude: f64,
    band: (f64, f64),
    duration: f64,
    period: f64,
    repetitions: usize,
    timing: &str,
    t_end: Option<f64>,
    dt: f64,
) -> PyResult<Vector<'py>> {
    sampled(py, t_end, dt, || {
        let timing = named("timing", timing, &[("published", core::Timing::Published), ("even", core::Timing::Even)])?;
        let chirp = core::Chirp::new(amplitude, band, duration)?;
        let chirps = core::PhaseShiftedChirps::new(chirp, period, repetitions, timing)?;
        Ok((chirps, chirps.duration()))
    })
}

/// A sine.
#[pyfunction]
pub fn sine<'py>(
    py: Python<'py>,
    amplitude: f64,
    omega: f64,
    phase: f64,
    t_end: f64,
    dt: f64,
) -> PyResult<Vector<'py>> {
    sampled(py, Some(t_end), dt, || Ok((core::Sine::new(amplitude, omega, phase)?, t_end)))
}

/// A step that is taken back at `end`.
#[pyfunction]
pub fn step<'py>(py: Python<'py>, amplitude: f64, start: f64, end: f64, t_end: f64, dt: f64) -> PyResult<Vector<'py>> {
    sampled(py, Some(t_end), dt, || Ok((core::Step::new(amplitude, start, end)?, t_end)))
}

/// White Gaussian noise (n).
#[pyfunction]
pub fn noise<'py>(py: Python<'py>, n: usize, sd: f64, seed: u64) -> PyResult<Vector<'py>> {
    Ok(door::short(py, || core::noise(n, sd, seed))?.into_pyarray(py))
}

/// The record with noise at a signal-to-noise ratio, and the noise's standard deviation.
#[pyfunction]
pub fn add_noise<'py>(py: Python<'py>, x: &Bound<'py, PyAny>, snr: f64, seed: u64) -> PyResult<(Vector<'py>, f64)> {
    let x = array::vector("x", x)?;
    let noisy = door::short(py, || core::add_noise(&x, snr, seed))?;
    Ok((noisy.values.into_pyarray(py), noisy.sd))
}

/// Lines of a multisine of `cycles` periods in a band in rad/s.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "they are the arguments of Python")]
pub fn multisine_lines(
    py: Python<'_>,
    period: f64,
    cycles: usize,
    band: (f64, f64),
    lines: &str,
    half_pumping: &str,
    count: Option<usize>,
    spread: &str,
) -> PyResult<Vec<usize>> {
    door::short(py, || core::lines::choose(period, cycles, band, &choice(lines, half_pumping, count, spread)?))
}

/// A periodic sum of cosines on known lines.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct Multisine(core::Multisine);

#[pymethods]
impl Multisine {
    #[new]
    fn new(
        py: Python<'_>,
        period: f64,
        lines: Vec<usize>,
        amplitudes: &Bound<'_, PyAny>,
        phases: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (amplitudes, phases) = (array::vector("amplitudes", amplitudes)?, array::vector("phases", phases)?);
        Ok(Self(door::short(py, || core::Multisine::new(period, lines, amplitudes, phases))?))
    }

    /// Random phases, made better by so many turns of clipping.
    #[staticmethod]
    fn random(
        py: Python<'_>,
        period: f64,
        lines: Vec<usize>,
        weights: Option<&Bound<'_, PyAny>>,
        rms: f64,
        crest_turns: usize,
        seed: u64,
    ) -> PyResult<Self> {
        let weights = weights.map(|weights| array::vector("weights", weights)).transpose()?;
        let make = move |_| {
            let signal = core::Multisine::random(period, lines, weights.as_deref(), rms, seed)?;
            Ok(signal.with_low_crest(crest_turns))
        };
        Ok(Self(door::long(py, None, make)?))
    }

    #[getter]
    fn period(&self) -> f64 {
        self.0.period()
    }
    #[getter]
    fn lines(&self) -> Vec<usize> {
        self.0.lines().to_vec()
    }
    #[getter]
    fn omega<'py>(&self, py: Python<'py>) -> Vector<'py> {
        self.0.omega().into_pyarray(py)
    }
    #[getter]
    fn amplitudes<'py>(&self, py: Python<'py>) -> Vector<'py> {
        self.0.amplitudes().to_pyarray(py)
    }
    #[getter]
    fn phases<'py>(&self, py: Python<'py>) -> Vector<'py> {
        self.0.phases().to_pyarray(py)
    }
    #[getter]
    fn rms(&self) -> f64 {
        self.0.rms()
    }
    #[getter]
    fn crest(&self, py: Python<'_>) -> PyResult<f64> {
        door::short(py, || Ok(self.0.crest()))
    }

    /// Values from 0 to `t_end` (both included), `dt` apart.
    fn samples<'py>(&self, py: Python<'py>, t_end: f64, dt: f64) -> PyResult<Vector<'py>> {
        Ok(door::short(py, || Ok(self.0.samples(dt, core::count(t_end, dt)?)))?.into_pyarray(py))
    }
}

/// When what happens in an experiment, and on which lines.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct ExperimentPlan(core::Plan);

#[pymethods]
impl ExperimentPlan {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "they are the arguments of Python")]
    fn new(
        py: Python<'_>,
        period: f64,
        band: (f64, f64),
        duration: f64,
        dt: f64,
        repeats: usize,
        settle: Option<usize>,
        lines: &str,
        half_pumping: &str,
        count: Option<usize>,
        spread: &str,
    ) -> PyResult<Self> {
        Ok(Self(door::short(py, || {
            let choice = choice(lines, half_pumping, count, spread)?;
            core::Plan::new(core::Request { period, band, duration, dt, repeats, settle, choice })
        })?))
    }

    #[getter]
    fn settle(&self) -> usize {
        self.0.settle
    }
    #[getter]
    fn cycles(&self) -> usize {
        self.0.cycles
    }
    #[getter]
    fn omega<'py>(&self, py: Python<'py>) -> Vector<'py> {
        self.0.omega().into_pyarray(py)
    }
    /// Seconds before the record begins, and its length.
    #[getter]
    fn times(&self) -> (f64, f64) {
        (self.0.settling(), self.0.record())
    }

    /// The experiment: `multisine`, `noise_sd`, `sd`, `band` and `advice`.
    #[expect(clippy::too_many_arguments, reason = "they are the arguments of Python")]
    fn design<'py>(
        &self,
        py: Python<'py>,
        gain: Option<&Bound<'py, PyAny>>,
        rms: f64,
        power: f64,
        noise_sd: Option<f64>,
        snr: Option<f64>,
        crest_turns: usize,
        seed: u64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let gain = gain.map(|gain| array::vector("gain", gain)).transpose()?;
        let noise = match (noise_sd, snr) {
            (Some(sd), _) => core::Noise::Sd(sd),
            (None, Some(snr)) => core::Noise::Snr(snr),
            (None, None) => core::Noise::Unknown,
        };
        let plan = self.0.clone();
        let shape = core::Shape { rms, power, noise, crest_turns, seed };
        let design = door::long(py, None, move |_| core::design(&plan, gain.as_deref(), &shape))?;
        let dict = PyDict::new(py);
        dict.set_item("band", design.band().into_pyarray(py))?;
        dict.set_item("sd", design.sd.into_pyarray(py))?;
        dict.set_item("noise_sd", design.noise_sd)?;
        dict.set_item("advice", design.advice)?;
        dict.set_item("multisine", Multisine(design.multisine))?;
        Ok(dict)
    }
}

/// Periods for a transient to vanish, from the largest magnitude of the multipliers.
#[pyfunction]
pub fn settling_periods(py: Python<'_>, multiplier: f64) -> PyResult<usize> {
    door::short(py, || core::settling_periods(multiplier))
}

/// Percent of the measured rms (n) that the prediction (n) misses.
#[pyfunction]
pub fn e_rms(py: Python<'_>, measured: &Bound<'_, PyAny>, predicted: &Bound<'_, PyAny>) -> PyResult<f64> {
    compare(py, measured, predicted, |y, f| metrics::e_rms(y.iter().copied(), f.iter().copied()))
}

/// Rms of what the prediction (n) misses.
#[pyfunction]
pub fn rms_error(py: Python<'_>, measured: &Bound<'_, PyAny>, predicted: &Bound<'_, PyAny>) -> PyResult<f64> {
    compare(py, measured, predicted, |y, f| metrics::rms_error(y.iter().copied(), f.iter().copied()))
}

/// Rms of what the prediction (n) misses, over the standard deviation of the measured signal (n).
#[pyfunction]
pub fn relative_rms(py: Python<'_>, measured: &Bound<'_, PyAny>, predicted: &Bound<'_, PyAny>) -> PyResult<f64> {
    compare(py, measured, predicted, |y, f| metrics::relative_rms(y.iter().copied(), f.iter().copied()))
}

fn compare(
    py: Python<'_>,
    measured: &Bound<'_, PyAny>,
    predicted: &Bound<'_, PyAny>,
    metric: impl FnOnce(&[f64], &[f64]) -> f64 + Send,
) -> PyResult<f64> {
    let (measured, predicted) = (array::vector("measured", measured)?, array::vector("predicted", predicted)?);
    door::short(py, || {
        if measured.len() != predicted.len() {
            let (expected, found) = (measured.len(), predicted.len());
            return Err(Error::Shape { what: "predicted, as many as measured".into(), expected, found });
        }
        Ok(metric(&measured, &predicted))
    })
}

/// Which lines, by the names of their kinds.
fn choice(lines: &str, half_pumping: &str, count: Option<usize>, spread: &str) -> Result<core::Choice> {
    use core::{Choice, HalfPumping, Kind, Spread};
    Ok(Choice {
        kind: named("lines", lines, &[("distinct", Kind::Distinct), ("odd", Kind::Odd), ("full", Kind::Full)])?,
        half_pumping: named(
            "half_pumping",
            half_pumping,
            &[("avoid", HalfPumping::Avoid), ("on", HalfPumping::On), ("any", HalfPumping::Any)],
        )?,
        count,
        spread: named("spread", spread, &[("uniform", Spread::Uniform), ("log", Spread::Log)])?,
    })
}

/// The value that goes by this name.
fn named<T: Copy>(option: &str, name: &str, known: &[(&str, T)]) -> Result<T> {
    known.iter().find(|(other, _)| *other == name).map(|(_, value)| *value).ok_or_else(|| Error::UnknownName {
        kind: "choice".into(),
        name: name.into(),
        nearest: known.iter().map(|(name, _)| (*name).to_owned()).collect(),
        context: option.into(),
    })
}
