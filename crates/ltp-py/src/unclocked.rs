//! Phase from events and the cycle average, as the extension shows them.

use ltp_core::identify::orbit;
use ltp_core::identify::phase::{self as core, Events, Options};
use numpy::{IntoPyArray, PyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::recording::Recording;
use crate::{array, door};

/// A cycle: times of its events (s), its run, and why it is not used, in a word.
type Cycle = (Vec<f64>, usize, Option<&'static str>);

/// The cycles of an unclocked recording.
#[pyclass(frozen, module = "ltp._ltp")]
pub struct Phase {
    core: core::Phase,
}

#[pymethods]
impl Phase {
    /// Every cycle as (times of its events, run, trouble or None).
    #[getter]
    fn cycles(&self) -> Vec<Cycle> {
        let cycle = |c: &core::Cycle| (c.times.clone(), c.run, c.trouble.as_ref().map(core::Trouble::word));
        self.core.cycles().iter().map(cycle).collect()
    }

    /// Phases of the events of a cycle, from 0 to 1.
    #[getter]
    fn marks(&self) -> Vec<f64> {
        self.core.marks().to_vec()
    }

    /// Median duration of the good cycles, s.
    #[getter]
    fn period(&self) -> f64 {
        self.core.period()
    }

    /// What was left out, with numbers.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.core.warnings.clone()
    }

    /// Phase at times (n,), s; NaN outside the good cycles.
    fn at<'py>(&self, py: Python<'py>, t: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let t = array::vector("t", t)?;
        let phase = door::short(py, || Ok(t.iter().map(|t| self.core.at(*t).unwrap_or(f64::NAN)).collect::<Vec<_>>()))?;
        Ok(phase.into_pyarray(py))
    }
}

impl Phase {
    /// The phase that the core knows.
    pub fn core(&self) -> &core::Phase {
        &self.core
    }
}

/// Times (s) and kinds (0 rising, 1 falling) of the switches of a channel.
#[pyfunction]
#[pyo3(signature = (recording, channel, level=None))]
pub fn switch_events(
    py: Python<'_>,
    recording: &Recording,
    channel: &str,
    level: Option<f64>,
) -> PyResult<(Py<PyArray1<f64>>, Vec<usize>)> {
    let events = door::short(py, || Events::from_switch(recording.core(), channel, level))?;
    Ok((events.times().to_pyarray(py).unbind(), events.kinds().to_vec()))
}

/// Phase of a recording from events at `times` (s) of `kinds`, those of kind `start` beginning a cycle.
#[pyfunction]
#[pyo3(signature = (recording, times, kinds, *, start=0, joins=Vec::new(), tolerance=0.25))]
pub fn phase_from_events(
    py: Python<'_>,
    recording: &Recording,
    times: &Bound<'_, PyAny>,
    kinds: Vec<usize>,
    start: usize,
    joins: Vec<f64>,
    tolerance: f64,
) -> PyResult<Phase> {
    let times = array::vector("times", times)?;
    let options = Options { start, joins, tolerance };
    let core = door::short(py, || {
        let events = Events::new(times, kinds)?;
        core::phase_from_events(recording.core(), &events, &options)
    })?;
    Ok(Phase { core })
}

/// The mean cycle and its bands: arrays (m, c) by name, and how many cycles and groups are behind them.
#[pyfunction]
#[pyo3(signature = (recording, phase, channels, points=100))]
pub fn cycle_average<'py>(
    py: Python<'py>,
    recording: &Recording,
    phase: &Phase,
    channels: Vec<String>,
    points: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let average = door::short(py, || orbit::cycle_average(recording.core(), phase.core(), &channels, points))?;
    let dict = PyDict::new(py);
    dict.set_item("phase", average.phase.into_pyarray(py))?;
    for (name, values) in [
        ("mean", average.mean),
        ("spread", average.spread),
        ("within", average.within),
        ("standard_error", average.standard_error),
    ] {
        dict.set_item(name, array::matrix(py, values, points, channels.len())?)?;
    }
    dict.set_item("cycles", average.cycles)?;
    dict.set_item("groups", average.groups)?;
    Ok(dict)
}
