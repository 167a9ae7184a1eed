//! Where the mismatch acts: at which single place something unknown explains best what the refitted model leaves.
//!
//! Places are the ports, and as pseudo-ports every sensor and every input. On what it depends there is told by `dependence`,
//! when it acts by `occasions`.

use super::dependence;
use super::hypothesis::{self, Course, Hypothesis, Kind, Walk};
use super::occasions;
use super::prepare::Scene;
use super::result::{Force, Location};
use super::trial::{Bench, Trial};
use rayon::prelude::*;

use crate::error::Result;

/// Gain in log-likelihood by which a sensor or an input must beat the best port: a deviance of ten, which is decisive for
/// names too. An input that drives one port is the same hypothesis as a force there, and the port is the place that a law of
/// physics can be read at.
const CLEARLY: f64 = 5.0;

/// Probability of chance up to which a dependence counts as one.
const LAWFUL: f64 = 0.05;

/// A port with the force that the model misses there, along each train experiment.
pub type PortForces = (String, Vec<Force>);

/// A located mismatch.
pub struct Located {
    /// Public description.
    pub location: Location,
    /// Gain in log-likelihood over nothing unknown.
    pub gain: f64,
    /// The force, or what a sensor or an input is off by, along each train experiment.
    pub forces: Vec<Force>,
}

/// The force that the nominal equations miss at a port when their parameters are `p`, labelled with units.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn missing(bench: &Bench<'_>, scene: &Scene, p: &[f64], port: &str) -> Result<Vec<Force>> {
    let course = Course { model: bench.model, p, ground: bench.train, scene };
    let force = Hypothesis::port(course, port)?;
    force.walk()?.map_or(Ok(Vec::new()), |walk| force.smoothed(&walk))
}

/// What a single place came to.
struct Tried<'a> {
    hypothesis: Hypothesis<'a>,
    /// Log-likelihood.
    likelihood: f64,
    /// Of a sensor or an input, which is smoothed only where it wins.
    walk: Option<Walk>,
    /// Of a port.
    forces: Vec<Force>,
}

/// Every place in turn: the force that the refitted model misses at each port, and the place of any kind at which something
/// unknown explains best what is left.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn everywhere(
    bench: &Bench<'_>,
    scene: &Scene,
    nominal: &Trial,
    seed: u64,
    warnings: &mut Vec<String>,
) -> Result<(Vec<PortForces>, Option<Located>)> {
    let (model, ground) = (bench.model, bench.train);
    let p = nominal.parameters();
    let course = Course { model, p: &p, ground, scene };
    let left = hypothesis::left(ground.experiments, &nominal.residuals.train, ground.sigma);
    let ports = model.ports().into_iter().map(|at| (Kind::Port, at, 0.0));
    let outputs = model.outputs().into_iter().zip(left).map(|(at, left)| (Kind::Output, at, left));
    let inputs = model.inputs().into_iter().map(|at| (Kind::Input, at, 0.0));
    let places: Vec<(Kind, &str, f64)> =
        ports.chain(outputs).chain(inputs).filter(|(.., left)| left.is_finite()).collect();
    let one = |&(kind, at, left): &(Kind, &str, f64)| -> Result<Option<Tried<'_>>> {
        ground.control.check()?;
        let hypothesis = match kind {
            Kind::Port => Hypothesis::port(course, at)?,
            Kind::Output => Hypothesis::output(course, at, left)?,
            Kind::Input => Hypothesis::input(course, at)?,
        };
        let Some(walk) = hypothesis.walk()? else { return Ok(None) };
        let likelihood = walk.likelihood;
        let forces = if kind == Kind::Port { hypothesis.smoothed(&walk)? } else { Vec::new() };
        Ok(Some(Tried { hypothesis, likelihood, walk: (kind != Kind::Port).then_some(walk), forces }))
    };
    let (without, tried) =
        rayon::join(|| course.without(), || places.par_iter().map(one).collect::<Result<Vec<Option<Tried<'_>>>>>());
    let (without, tried) = (without?, tried?);
    let (mut all, mut port, mut other) = (Vec::new(), None::<Tried<'_>>, None::<Tried<'_>>);
    for ((kind, at, _), tried) in places.iter().zip(tried) {
        let Some(tried) = tried.filter(|_| without.is_some()) else {
            if *kind == Kind::Port {
                warnings.push(format!("port `{at}`: no force there can be estimated from these recordings"));
            }
            continue;
        };
        if *kind == Kind::Port {
            all.push(((*at).to_string(), tried.forces.clone()));
        }
        let best = if *kind == Kind::Port { &mut port } else { &mut other };
        if best.as_ref().is_none_or(|b| tried.likelihood > b.likelihood) {
            *best = Some(tried);
        }
    }
    let Some(without) = without else { return Ok((all, None)) };
    let mut found = None;
    for tried in in_order(port, other) {
        let forces = match &tried.walk {
            Some(walk) => tried.hypothesis.smoothed(walk)?,
            None => tried.forces,
        };
        let (variable, p_value) = dependence::depends_on(&forces, seed);
        let place = (tried.hypothesis.kind, tried.hypothesis.at, tried.likelihood - without);
        // What wanders at a sensor after no law can be anything: a port where it has one is the better place.
        let lawful = variable != dependence::NOTHING && p_value <= LAWFUL;
        if found.is_none() || lawful {
            found = Some((place, forces, variable, p_value));
        }
        if lawful {
            break;
        }
    }
    let Some(((kind, at, gain), forces, variable, p_value)) = found else { return Ok((all, None)) };
    let repeats = dependence::repeats(&forces, &variable);
    let location = Location {
        kind: kind.name().into(),
        at,
        mode: occasions::mode(&forces),
        variable,
        repeats,
        phases: occasions::phases(&forces),
        p_value,
        margin: gain,
        sentence: String::new(),
    };
    Ok((all, Some(Located { location, gain, forces })))
}

/// The best port alone, unless something else is clearly better: then that first.
fn in_order<'a>(port: Option<Tried<'a>>, other: Option<Tried<'a>>) -> Vec<Tried<'a>> {
    match (port, other) {
        (Some(port), Some(other)) if other.likelihood > port.likelihood + CLEARLY => vec![other, port],
        (Some(port), _) => vec![port],
        (None, other) => other.into_iter().collect(),
    }
}
