//! Effects attached to a document: where each acts, and the parameters and states it brings along.

use indexmap::IndexMap;

use super::assemble::{ParameterInfo, place};
use super::document::Document;
use super::effects::{Effect, Library, words};
use super::parse::parse;
use super::scope::{DryElement, Names};
use super::units::{Unit, same};
use crate::error::{Error, Result, nearest};

/// Where an effect acts: numbers count in the order of the document.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A port.
    Port(usize),
    /// An input.
    Input(usize),
    /// A signal that an input enters.
    Signal(usize),
    /// An output.
    Output(usize),
    /// A contact.
    Contact(usize),
    /// A parameter.
    Parameter(usize),
}

/// An effect attached to the model.
#[derive(Clone, Debug)]
pub struct AttachedEffect {
    /// Name in the library.
    pub name: String,
    /// Its document.
    pub effect: Effect,
    /// Where it acts.
    pub place: Place,
    /// Parameter index by the effect's own name of it.
    pub parameters: IndexMap<String, usize>,
    /// State index by the effect's own name of it.
    pub states: IndexMap<String, usize>,
}

/// Names in the document at which an effect of this kind could act, in document order.
pub fn candidates<'d>(doc: &'d Document, on: &str) -> Vec<&'d str> {
    fn names<T>(table: &IndexMap<String, T>) -> Vec<&str> {
        table.keys().map(String::as_str).collect()
    }
    match on {
        "port" => names(&doc.ports),
        "input" => {
            let signals = doc.signals.keys().map(String::as_str).filter(|s| input_enters(doc, s));
            names(&doc.inputs).into_iter().chain(signals).collect()
        }
        "output" => names(&doc.outputs),
        "contact" => names(&doc.contacts),
        "parameter" => names(&doc.parameters),
        _ => Vec::new(),
    }
}

/// Whether a signal depends on an input.
pub fn input_enters(doc: &Document, signal: &str) -> bool {
    depends(doc, signal, &doc.inputs.keys().map(String::as_str).collect::<Vec<_>>(), 0)
}

/// Whether a signal depends on a state, so that it is no longer only what drives the model.
pub fn state_enters(doc: &Document, signal: &str) -> bool {
    depends(doc, signal, &doc.states.keys().map(String::as_str).collect::<Vec<_>>(), 0)
}

fn depends(doc: &Document, signal: &str, on: &[&str], depth: usize) -> bool {
    let Some(tree) = doc.signals.get(signal).and_then(|d| parse(d.expression(), "").ok()) else { return false };
    let deeper = |s: &String| depth < 100 && tree.mentions(s) && depends(doc, s, on, depth + 1);
    on.iter().any(|name| tree.mentions(name)) || doc.signals.keys().any(deeper)
}

/// Where an effect that acts on `on` stands when it is attached at `at`.
fn find(doc: &Document, on: &str, at: &str, path: &str) -> Result<Place> {
    let found = match on {
        "port" => doc.ports.get_index_of(at).map(Place::Port),
        "input" => {
            let signal = || doc.signals.get_index_of(at).map(Place::Signal);
            doc.inputs.get_index_of(at).map(Place::Input).or_else(signal)
        }
        "output" => doc.outputs.get_index_of(at).map(Place::Output),
        "contact" => doc.contacts.get_index_of(at).map(Place::Contact),
        _ => doc.parameters.get_index_of(at).map(Place::Parameter),
    };
    found.ok_or_else(|| Error::UnknownName {
        kind: if on == "input" { "input (or signal that an input enters)".into() } else { on.to_string() },
        name: at.to_string(),
        nearest: nearest(at, candidates(doc, on)),
        context: path.to_string(),
    })
}

impl AttachedEffect {
    /// Its parameters that are time constants of its states.
    pub(super) fn relaxations(&self) -> Vec<usize> {
        let parameters = if self.effect.states.is_empty() { None } else { Some(&self.parameters) };
        let is_time = |name: &String| self.effect.parameters.get(name).is_some_and(|p| p.unit == "time");
        parameters.into_iter().flatten().filter(|(name, _)| is_time(name)).map(|(_, i)| *i).collect()
    }
}

impl Names {
    /// Numbers the parameters and states of the attached effects.
    pub(super) fn attach(&mut self, doc: &Document, library: &Library, source: &str) -> Result<()> {
        for (k, attached) in doc.effects.iter().enumerate() {
            let label = format!("{}@{}", attached.name, attached.at);
            let path = place(source, &format!("effects[{label}]"));
            let effect = library.get(&attached.name)?;
            let at = find(doc, &effect.on, &attached.at, &path)?;
            if doc.effects[..k].iter().any(|o| o.name == attached.name && o.at == attached.at) {
                let message = format!("this effect is attached twice to one {}", effect.on);
                return Err(Error::Model { path, message });
            }
            if let Some(unknown) = attached.parameters.keys().find(|p| !effect.parameters.contains_key(*p)) {
                return Err(Error::UnknownName {
                    kind: "parameter".into(),
                    name: unknown.clone(),
                    nearest: nearest(unknown, effect.parameters.keys().map(String::as_str)),
                    context: path,
                });
            }
            let mut entry = AttachedEffect {
                name: attached.name.clone(),
                effect: effect.clone(),
                place: at,
                parameters: IndexMap::new(),
                states: IndexMap::new(),
            };
            for (name, p) in &effect.parameters {
                let given = attached.parameters.get(name);
                let unit = place_unit(&p.unit, doc, at, &path)?.to_string();
                let (low, high) = (p.min.unwrap_or(f64::NEG_INFINITY), p.max.unwrap_or(f64::INFINITY));
                // A limit may be infinite where that is where the effect is absent.
                let sound = |v: f64| (v.is_finite() || v == p.neutral) && v >= low && v <= high;
                if let Some(v) = given.map(|g| g.value).filter(|v| !sound(*v)) {
                    let message = format!("`{name}` = {v} is not within {low} .. {high} {unit}");
                    return Err(Error::Model { path, message });
                }
                entry.parameters.insert(name.clone(), self.parameters.len());
                self.parameters.push(ParameterInfo {
                    name: format!("{label}.{name}"),
                    value: given.map_or(p.default_value(), |g| g.value),
                    sd: given.and_then(|g| g.sd).or(p.sd),
                    unit: Some(unit),
                    bounds: (low, high),
                    effect: Some(k),
                });
            }
            for (name, s) in &effect.states {
                entry.states.insert(name.clone(), self.states.len());
                self.states.push(format!("{label}.{name}"));
                self.initial.push(s.value);
            }
            if let (Some(_), Place::Port(port)) = (&effect.dry, at) {
                self.dry.push(DryElement { name: label, port });
            }
            self.effects.push(entry);
        }
        Ok(())
    }
}

/// Unit of an effect's quantity, given in words of its place: a product of `force`, `position`, `velocity`, `input`,
/// `output`, `value` and `time`.
pub fn place_unit(text: &str, doc: &Document, at: Place, path: &str) -> Result<Unit> {
    let mut result = Unit::one();
    for (word, power) in words(text) {
        result = result.times(&word_unit(word, doc, at, path)?, power);
    }
    Ok(result)
}

fn word_unit(word: &str, doc: &Document, at: Place, path: &str) -> Result<Unit> {
    let read = |text: Option<&str>| text.map_or(Ok(Unit::one()), |t| Unit::parse(t, path));
    let second = Unit::parse("s", path)?;
    if word == "time" {
        return Ok(second);
    }
    let state = |expression: &str| doc.states.get(expression.trim()).and_then(|s| s.unit.as_deref());
    let contact_port = |c: usize| doc.contacts[c].port.as_ref().and_then(|p| doc.ports.get(p));
    match (word, at) {
        ("force", Place::Port(j)) => read(doc.ports[j].unit.as_deref()),
        ("force", Place::Contact(c)) => read(contact_port(c).and_then(|p| p.unit.as_deref())),
        ("velocity", Place::Port(j)) => velocity(state(&doc.ports[j].velocity), doc.ports[j].unit.as_deref(), path),
        ("velocity", Place::Contact(c)) => {
            velocity(state(&doc.contacts[c].rate), contact_port(c).and_then(|p| p.unit.as_deref()), path)
        }
        ("position", Place::Port(_) | Place::Contact(_)) => {
            Ok(word_unit("velocity", doc, at, path)?.times(&second, 1.0))
        }
        ("input", Place::Input(i)) => read(doc.inputs[i].unit.as_deref()),
        ("input", Place::Signal(i)) => read(doc.signals[i].unit()),
        ("output", Place::Output(i)) => read(doc.outputs[i].unit().or_else(|| state(doc.outputs[i].expression()))),
        ("value", Place::Parameter(i)) => read(doc.parameters[i].unit.as_deref()),
        _ => Ok(Unit::one()),
    }
}

/// Unit of a velocity: the declared one, or the one whose product with the force is a power.
fn velocity(declared: Option<&str>, force: Option<&str>, path: &str) -> Result<Unit> {
    if let Some(text) = declared {
        return Unit::parse(text, path);
    }
    let force = force.map_or(Ok(Unit::one()), |t| Unit::parse(t, path))?;
    let newton = Unit::parse("N", path)?;
    Unit::parse(if same(&force.dimensions(), &newton.dimensions()) { "m/s" } else { "rad/s" }, path)
}
