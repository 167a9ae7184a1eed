//! The law of an effect as a function of position and velocity: for the picture with its band.

use indexmap::IndexMap;

use super::result::{Force, Law};
use crate::error::Result;
use crate::model::document::{Definition, Input, Parameter, State};
use crate::model::{Backend, Compiled, Document, Library, Model, Point, System};
use crate::numeric::stats;

/// Values of an effect's law, with its own parameters as the free ones.
pub struct LawFunction {
    system: Compiled,
    names: Vec<String>,
}

impl LawFunction {
    /// The law of an effect; `None` for one with states of its own.
    ///
    /// # Errors
    /// [`crate::Error::UnknownName`] for an effect that does not exist.
    pub fn new(library: &Library, effect: &str) -> Result<Option<Self>> {
        let e = library.get(effect)?;
        if !e.states.is_empty() {
            return Ok(None);
        }
        let text = match (&e.law, &e.dry) {
            (Some(law), _) => law.clone(),
            (None, Some(dry)) => format!("-({dry})*sign(velocity)"),
            (None, None) => return Ok(None),
        };
        let parameter = |v: f64| Parameter { value: v, sd: Some(1.0), ..Parameter::default() };
        let document = Document {
            name: effect.to_string(),
            states: IndexMap::from([("rest_".to_string(), State { value: 0.0, unit: None })]),
            inputs: ["position", "velocity"].map(|n| (n.to_string(), Input::default())).into_iter().collect(),
            parameters: e.parameters.keys().map(|n| (n.clone(), parameter(0.0))).collect(),
            flow: IndexMap::from([("rest_".to_string(), "0".to_string())]),
            outputs: IndexMap::from([("force_".to_string(), Definition::Plain(text))]),
            ..Document::default()
        };
        // A law that needs more of its port than position and velocity (its acceleration, its stiffness) has no such table.
        let Ok(model) = Model::new(document, Library::shipped()?, effect) else { return Ok(None) };
        let names = e.parameters.keys().cloned().collect();
        Ok(Some(Self { system: model.compile_for((0..e.parameters.len()).collect(), Backend::Native), names }))
    }

    /// Force and its derivatives by the parameters.
    pub fn eval(&self, position: f64, velocity: f64, p: &[f64]) -> (f64, Vec<f64>) {
        let mut out = vec![0.0; 2 + self.names.len()];
        let at = Point { t: 0.0, x: &[0.0], u: &[position, velocity], p };
        self.system.output_jacobian(0, at, &mut out);
        (out[0], out[2..].to_vec())
    }

    /// The law over the range of the recordings with one-sigma band from the covariance of its parameters.
    pub fn table(&self, forces: &[Force], p: &[f64], sd: &[f64], units: &[String; 3]) -> Law {
        let speedy = self.depends_on_velocity(forces, p);
        let of = |f: &Force| if speedy { f.velocity.clone() } else { f.position.clone() };
        let values: Vec<f64> = forces.iter().flat_map(of).collect();
        let (low, high) = (stats::quantile(&values, 0.002), stats::quantile(&values, 0.998));
        let other = if speedy { stats::median(&positions(forces)) } else { 1e-3 * high.abs().max(1e-12) };
        let n = 241;
        let mut law = Law {
            at: forces.first().map_or(String::new(), |f| f.at.clone()),
            variable: if speedy { "velocity" } else { "position" }.into(),
            unit: units[0].clone(),
            variable_unit: units[if speedy { 2 } else { 1 }].clone(),
            grid: (0..n).map(|i| low + (high - low) * i as f64 / (n - 1) as f64).collect(),
            force: Vec::new(),
            sd: Vec::new(),
        };
        for &x in &law.grid {
            let (q, v) = if speedy { (other, x) } else { (x, other) };
            let (f, d) = self.eval(q, v, p);
            law.force.push(f);
            law.sd.push(d.iter().zip(sd).map(|(d, s)| (d * s).powi(2)).sum::<f64>().sqrt());
        }
        law
    }

    fn depends_on_velocity(&self, forces: &[Force], p: &[f64]) -> bool {
        let Some(f) = forces.iter().find(|f| !f.t.is_empty()) else { return true };
        let v = stats::rms(f.velocity.iter().copied()).max(1e-12);
        let q = stats::rms(f.position.iter().copied()).max(1e-12);
        let by_velocity = (self.eval(q, v, p).0 - self.eval(q, -v, p).0).abs();
        let by_position = (self.eval(q, v, p).0 - self.eval(-q, v, p).0).abs();
        by_velocity >= by_position
    }
}

fn positions(forces: &[Force]) -> Vec<f64> {
    forces.iter().flat_map(|f| f.position.iter().copied()).collect()
}

/// Value of an expression of known numbers: where the library says how a starting value follows from the others.
///
/// # Errors
/// [`crate::Error::Expression`].
pub fn evaluate(text: &str, known: &IndexMap<&str, f64>, library: &Library) -> Result<f64> {
    let rest = "rest_".to_string();
    let document = Document {
        name: "start".into(),
        states: IndexMap::from([(rest.clone(), State { value: 0.0, unit: None })]),
        parameters: known
            .iter()
            .map(|(n, v)| ((*n).to_string(), Parameter { value: *v, ..Parameter::default() }))
            .collect(),
        flow: IndexMap::from([(rest, "0".to_string())]),
        outputs: IndexMap::from([("value_".to_string(), Definition::Plain(text.to_string()))]),
        ..Document::default()
    };
    let system = Model::new(document, library.clone(), "starting value")?.compile_for(Vec::new(), Backend::Plain);
    let mut out = [0.0];
    system.output(0, Point { t: 0.0, x: &[0.0], u: &[], p: system.parameters() }, &mut out);
    Ok(out[0])
}
