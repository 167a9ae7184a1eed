//! The verb `identify` of the extension. It sees recordings and nothing else.

use ltp_core::error::{Error, Result, nearest};
use ltp_core::identify::curvature::{self, Solver};
use ltp_core::identify::{self as core, Method, Options, Orbit, floquet};
use pyo3::prelude::*;

use crate::door;
use crate::htf::Htf;
use crate::recording::Recording;

/// Harmonic transfer functions of the system that made the recordings, harmonics -K to K.
///
/// `band` and `reach` are in rad/s; options of a method that is not used must be left out.
#[pyfunction]
#[pyo3(signature = (
    recordings, *, period, harmonics, method="floquet", band=None, orbit="deviation", order=None, reach=None,
    transients=None, smoothness=None, solver=None
))]
#[expect(clippy::too_many_arguments, reason = "they are the keyword arguments of Python")]
pub fn identify(
    py: Python<'_>,
    recordings: Vec<PyRef<'_, Recording>>,
    period: f64,
    harmonics: usize,
    method: &str,
    band: Option<f64>,
    orbit: &str,
    order: Option<usize>,
    reach: Option<f64>,
    transients: Option<bool>,
    smoothness: Option<f64>,
    solver: Option<&str>,
) -> PyResult<Htf> {
    let given = [
        ("order", order.is_some()),
        ("reach", reach.is_some()),
        ("transients", transients.is_some()),
        ("smoothness", smoothness.is_some()),
        ("solver", solver.is_some()),
    ];
    let options = door::short(py, || {
        let orbit = match orbit {
            "deviation" => Orbit::Deviation,
            "removed" => Orbit::Removed,
            other => return Err(unknown("orbit", other, &["deviation", "removed"])),
        };
        let method = match method {
            "floquet" => {
                let defaults = floquet::Options::default();
                let transients = transients.unwrap_or(defaults.transients);
                Method::Floquet(floquet::Options { order, reach, transients, ..defaults })
            }
            "curvature" => {
                let solver = match solver {
                    None | Some("smoother") => Solver::Smoother,
                    Some("banded") => Solver::Banded,
                    Some(other) => return Err(unknown("solver", other, &["smoother", "banded"])),
                };
                Method::Curvature(curvature::Options { smoothness, solver })
            }
            "lines" => Method::Lines(core::lines::Options::default()),
            other => return Err(unknown("method", other, &["floquet", "curvature", "lines"])),
        };
        own(&method, &given)?;
        Ok(Options { period, harmonics, band, orbit, method })
    })?;
    let recordings: Vec<_> = recordings.iter().map(|recording| recording.core().clone()).collect();
    Ok(door::long(py, None, move |_| core::identify(&recordings, &options))?.into())
}

/// Recording, output, bias, its sd, rms of the periodic part, rms of the output, periods.
type Rest = (String, String, f64, f64, f64, f64, usize);

/// What every output shows where the input rests.
#[pyfunction]
pub fn rests(py: Python<'_>, recordings: Vec<PyRef<'_, Recording>>, period: f64) -> PyResult<Vec<Rest>> {
    let recordings: Vec<_> = recordings.iter().map(|recording| recording.core().clone()).collect();
    let found = door::long(py, None, move |_| Ok(core::rest::rests(&recordings, period)))?;
    let tuple = |r: core::rest::Rest| (r.recording, r.output, r.bias, r.bias_sd, r.periodic, r.rms, r.periods);
    Ok(found.into_iter().map(tuple).collect())
}

/// Refuses what was given and belongs to another method.
fn own(method: &Method, given: &[(&str, bool)]) -> Result<()> {
    let (name, known): (_, &[&str]) = match method {
        Method::Floquet(_) => ("floquet", &["order", "reach", "transients"]),
        Method::Curvature(_) => ("curvature", &["smoothness", "solver"]),
        Method::Lines(_) => ("lines", &[]),
    };
    match given.iter().find(|(option, there)| *there && !known.contains(option)) {
        None => Ok(()),
        Some((option, _)) => Err(unknown(&format!("option of the method `{name}`"), option, known)),
    }
}

fn unknown(kind: &str, name: &str, known: &[&str]) -> Error {
    let near = nearest(name, known.iter().copied());
    let nearest = if near.is_empty() { known.iter().map(|&name| name.into()).collect() } else { near };
    Error::UnknownName { kind: kind.into(), name: name.into(), nearest, context: "identify".into() }
}
