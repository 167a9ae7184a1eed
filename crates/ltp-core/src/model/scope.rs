//! Names and what they mean: the table of a document's quantities and the resolution of expressions in one mode.

use std::collections::HashMap;

use indexmap::IndexMap;

use super::assemble::{ParameterInfo, acts_in, check_name, place};
use super::document::Document;
use super::effects::Library;
use super::graph::{Graph, Id, Symbol};
use super::parse::{Ast, error_at, parse, suggestion};
use super::units::Unit;
use crate::error::{Error, Result, nearest};

/// An effect attached to the model.
#[derive(Clone, Debug)]
pub struct AttachedEffect {
    /// Name in the library.
    pub name: String,
    /// Port.
    pub port: usize,
    /// Parameter index by the effect's own name of it.
    pub parameters: IndexMap<String, usize>,
    /// State index by the effect's own name of it.
    pub states: IndexMap<String, usize>,
}

/// A dry friction element.
#[derive(Clone, Debug)]
pub struct DryElement {
    /// `effect@port`.
    pub name: String,
    /// Port.
    pub port: usize,
}

/// Every quantity of a document, numbered.
#[derive(Clone, Debug, Default)]
pub struct Names {
    /// States, the document's first.
    pub states: Vec<String>,
    /// Initial values of the states.
    pub initial: Vec<f64>,
    /// Parameters, the document's first.
    pub parameters: Vec<ParameterInfo>,
    /// Attached effects.
    pub effects: Vec<AttachedEffect>,
    /// Dry friction elements, in the order of the effects.
    pub dry: Vec<DryElement>,
    symbols: HashMap<String, Symbol>,
}

impl Names {
    /// Numbers the quantities of a document and of its attached effects.
    ///
    /// # Errors
    /// [`Error::Model`] for a bad or double name, a value out of its bounds, a port that does not exist.
    pub fn new(doc: &Document, library: &Library, source: &str) -> Result<Self> {
        let mut n = Self::default();
        let mut taken = IndexMap::new();
        let fault = |path: String, message: String| Error::Model { path: place(source, &path), message };
        if doc.states.is_empty() {
            return Err(fault("states".into(), "a model needs at least one state".into()));
        }
        if doc.outputs.is_empty() {
            return Err(fault("outputs".into(), "a model needs at least one output: what is measured?".into()));
        }
        for (name, s) in &doc.states {
            check_name(name, "states", &mut taken, source)?;
            n.symbols.insert(name.clone(), Symbol::State(n.states.len()));
            n.states.push(name.clone());
            n.initial.push(s.value);
            if !s.value.is_finite() {
                return Err(fault(format!("states.{name}"), format!("initial value {} is not finite", s.value)));
            }
        }
        for (i, name) in doc.inputs.keys().enumerate() {
            check_name(name, "inputs", &mut taken, source)?;
            n.symbols.insert(name.clone(), Symbol::Input(i));
        }
        for (name, p) in &doc.parameters {
            check_name(name, "parameters", &mut taken, source)?;
            n.symbols.insert(name.clone(), Symbol::Parameter(n.parameters.len()));
            let bounds = (p.min.unwrap_or(f64::NEG_INFINITY), p.max.unwrap_or(f64::INFINITY));
            let path = format!("parameters.{name}");
            if !(p.value.is_finite() && p.value >= bounds.0 && p.value <= bounds.1) {
                return Err(fault(path, format!("value {} is not within {} .. {}", p.value, bounds.0, bounds.1)));
            }
            if let Some(sd) = p.sd.filter(|sd| !(sd.is_finite() && *sd >= 0.0)) {
                return Err(fault(path, format!("sd {sd} must be a positive number; leave it out where exact")));
            }
            n.parameters.push(ParameterInfo {
                name: name.clone(),
                value: p.value,
                sd: p.sd.filter(|sd| *sd > 0.0),
                unit: p.unit.clone(),
                bounds,
                effect: None,
            });
        }
        for name in doc.signals.keys() {
            check_name(name, "signals", &mut taken, source)?;
        }
        for name in doc.outputs.keys().chain(doc.ports.keys()).chain(doc.modes.keys()) {
            if name.is_empty() {
                return Err(fault("outputs, ports, modes".into(), "a name is empty".into()));
            }
        }
        n.attach(doc, library, source)?;
        Ok(n)
    }

    fn attach(&mut self, doc: &Document, library: &Library, source: &str) -> Result<()> {
        for (k, attached) in doc.effects.iter().enumerate() {
            let label = format!("{}@{}", attached.name, attached.at);
            let path = place(source, &format!("effects[{label}]"));
            let effect = library.get(&attached.name)?;
            let port = doc.ports.get_index_of(&attached.at).ok_or_else(|| Error::UnknownName {
                kind: "port".into(),
                name: attached.at.clone(),
                nearest: nearest(&attached.at, doc.ports.keys().map(String::as_str)),
                context: path.clone(),
            })?;
            if doc.effects[..k].iter().any(|o| o.name == attached.name && o.at == attached.at) {
                return Err(Error::Model { path, message: "this effect is attached twice to one port".into() });
            }
            let mut entry = AttachedEffect {
                name: attached.name.clone(),
                port,
                parameters: IndexMap::new(),
                states: IndexMap::new(),
            };
            if let Some(unknown) = attached.parameters.keys().find(|p| !effect.parameters.contains_key(*p)) {
                return Err(Error::UnknownName {
                    kind: "parameter".into(),
                    name: unknown.clone(),
                    nearest: nearest(unknown, effect.parameters.keys().map(String::as_str)),
                    context: path,
                });
            }
            for (name, p) in &effect.parameters {
                let given = attached.parameters.get(name);
                let unit = port_unit(&p.unit, doc, port, &path)?.to_string();
                let (low, high) = (p.min.unwrap_or(f64::NEG_INFINITY), p.max.unwrap_or(f64::INFINITY));
                if let Some(v) = given.map(|g| g.value).filter(|v| !(v.is_finite() && *v >= low && *v <= high)) {
                    let message = format!("`{name}` = {v} is not within {low} .. {high} {unit}");
                    return Err(Error::Model { path, message });
                }
                entry.parameters.insert(name.clone(), self.parameters.len());
                self.parameters.push(ParameterInfo {
                    name: format!("{label}.{name}"),
                    value: given.map_or(0.0, |g| g.value),
                    sd: given.and_then(|g| g.sd),
                    unit: Some(unit),
                    bounds: (p.min.unwrap_or(f64::NEG_INFINITY), p.max.unwrap_or(f64::INFINITY)),
                    effect: Some(k),
                });
            }
            for (name, s) in &effect.states {
                entry.states.insert(name.clone(), self.states.len());
                self.states.push(format!("{label}.{name}"));
                self.initial.push(s.value);
            }
            if effect.dry.is_some() {
                self.dry.push(DryElement { name: label, port });
            }
            self.effects.push(entry);
        }
        Ok(())
    }

    /// Index of a state.
    ///
    /// # Errors
    /// [`Error::UnknownName`].
    pub fn state(&self, name: &str, context: &str) -> Result<usize> {
        match self.symbols.get(name) {
            Some(Symbol::State(i)) => Ok(*i),
            _ => Err(Error::UnknownName {
                kind: "state".into(),
                name: name.to_string(),
                nearest: nearest(name, self.states.iter().map(String::as_str)),
                context: context.to_string(),
            }),
        }
    }
}

/// Unit of an effect's quantity: a product of `force`, `position`, `velocity`, `time` of its port.
pub fn port_unit(words: &str, doc: &Document, port: usize, path: &str) -> Result<Unit> {
    let (_, p) = doc.ports.get_index(port).expect("port numbers come from the document");
    let unit_of = |text: Option<&str>| text.map_or(Ok(Unit::one()), |t| Unit::parse(t, path));
    let declared = |expression: &str| -> Option<&str> { doc.states.get(expression.trim())?.unit.as_deref() };
    let mut result = Unit::one();
    for (name, power) in super::effects::words(words) {
        let second = Unit::parse("s", path)?;
        let unit = match name {
            "force" => unit_of(p.unit.as_deref())?,
            "velocity" => match declared(&p.velocity) {
                Some(u) => Unit::parse(u, path)?,
                None => velocity_from_force(&unit_of(p.unit.as_deref())?),
            },
            "position" => match declared(&p.velocity) {
                Some(u) => Unit::parse(u, path)?.times(&second, 1.0),
                None => velocity_from_force(&unit_of(p.unit.as_deref())?).times(&second, 1.0),
            },
            "time" => second,
            _ => Unit::one(),
        };
        result = result.times(&unit, power);
    }
    Ok(result)
}

/// Speed that goes with a generalised force: their product is a power.
fn velocity_from_force(force: &Unit) -> Unit {
    let newton = Unit::parse("N", "").map(|u| u.dimensions()).unwrap_or_default();
    let text = if super::units::same(&force.dimensions(), &newton) { "m/s" } else { "rad/s" };
    Unit::parse(text, "").unwrap_or_default()
}

/// Longest chain of signals that are defined by signals; a longer one is refused rather than overflow the stack.
const CHAIN: usize = 100;

/// Expressions of one mode: the same signal may mean different things in different modes, because ports may act on it.
pub struct Scope<'a> {
    /// Numbered quantities.
    pub names: &'a Names,
    /// File name, for messages.
    pub source: &'a str,
    doc: &'a Document,
    mode: &'a str,
    done: HashMap<String, Id>,
    open: Vec<String>,
}

impl<'a> Scope<'a> {
    /// The scope of a mode.
    pub fn new(doc: &'a Document, names: &'a Names, source: &'a str, mode: &'a str) -> Self {
        Self { names, source, doc, mode, done: HashMap::new(), open: Vec::new() }
    }

    /// An expression of the document.
    ///
    /// # Errors
    /// [`Error::Expression`] that points into the text.
    pub fn expression(&mut self, g: &mut Graph, text: &str, path: &str) -> Result<Id> {
        let at = place(self.source, path);
        let tree = parse(text, &at)?;
        self.build(g, &tree, &|_, _| None, text, &at)
    }

    /// A law of an effect: its own parameters and states, and `position` and `velocity` of its port.
    ///
    /// # Errors
    /// [`Error::Expression`].
    pub fn law(&mut self, g: &mut Graph, text: &str, e: &AttachedEffect, port: (Id, Id), path: &str) -> Result<Id> {
        let tree = parse(text, path)?;
        let own = |g: &mut Graph, name: &str| match name {
            "position" => Some(port.0),
            "velocity" => Some(port.1),
            _ => e
                .parameters
                .get(name)
                .map(|&i| g.leaf(Symbol::Parameter(i)))
                .or_else(|| e.states.get(name).map(|&i| g.leaf(Symbol::State(i)))),
        };
        self.build(g, &tree, &own, text, path)
    }

    fn build(
        &mut self,
        g: &mut Graph,
        tree: &Ast,
        own: &dyn Fn(&mut Graph, &str) -> Option<Id>,
        text: &str,
        path: &str,
    ) -> Result<Id> {
        Ok(match tree {
            Ast::Number(v) => g.constant(*v),
            Ast::Name(name, at) => match own(g, name) {
                Some(id) => id,
                None => self.name(g, name, *at, text, path)?,
            },
            Ast::One(f, a, _) => {
                let a = self.build(g, a, own, text, path)?;
                g.one(*f, a)
            }
            Ast::Two(f, a, b, _) => {
                let (a, b) = (self.build(g, a, own, text, path)?, self.build(g, b, own, text, path)?);
                g.two(*f, a, b)
            }
            Ast::If(three, _) => {
                let [c, a, b] = &**three;
                let c = self.build(g, c, own, text, path)?;
                let (a, b) = (self.build(g, a, own, text, path)?, self.build(g, b, own, text, path)?);
                g.select(c, a, b)
            }
        })
    }

    fn name(&mut self, g: &mut Graph, name: &str, at: usize, text: &str, path: &str) -> Result<Id> {
        if name == "pi" {
            return Ok(g.constant(std::f64::consts::PI));
        }
        if name == "t" {
            return Ok(g.leaf(Symbol::Time));
        }
        if let Some(&s) = self.names.symbols.get(name) {
            return Ok(g.leaf(s));
        }
        if let Some(&id) = self.done.get(name) {
            return Ok(id);
        }
        let Some(signal) = self.doc.signals.get(name) else {
            let known: Vec<&str> = self
                .names
                .symbols
                .keys()
                .map(String::as_str)
                .chain(self.doc.signals.keys().map(String::as_str))
                .chain(["t", "pi"])
                .collect();
            let near = nearest(name, known);
            return Err(error_at(path, text, at, format!("unknown name `{name}`{}", suggestion(&near))));
        };
        if let Some(first) = self.open.iter().position(|o| o == name) {
            let mut ring = self.open[first..].to_vec();
            ring.push(name.to_string());
            return Err(error_at(path, text, at, format!("signals are defined in a circle: {}", ring.join(" -> "))));
        }
        if self.open.len() >= CHAIN {
            return Err(error_at(
                path,
                text,
                at,
                format!("signals defined by signals, more than {CHAIN} deep; flatten them"),
            ));
        }
        self.open.push(name.to_string());
        let mut id = self.expression(g, signal.expression(), &format!("signals.{name}"))?;
        for (j, (port_name, port)) in self.doc.ports.iter().enumerate() {
            let path = format!("ports.{port_name}.acts");
            for (target, factor) in acts_in(&port.acts, self.mode, self.doc, &place(self.source, &path))? {
                if target == name {
                    let factor = self.expression(g, factor, &format!("{path}.{target}"))?;
                    let leaf = g.leaf(Symbol::Port(j));
                    let term = g.mul(factor, leaf);
                    id = g.add(id, term);
                }
            }
        }
        self.open.pop();
        self.done.insert(name.to_string(), id);
        Ok(id)
    }
}
