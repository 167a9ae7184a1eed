//! Names and what they mean: the table of a document's quantities and the resolution of expressions in one mode.

use std::collections::HashMap;

use indexmap::IndexMap;

use super::assemble::{ParameterInfo, acts_in, check_name, place};
use super::attach::{AttachedEffect, Place};
use super::document::Document;
use super::effects::Library;
use super::graph::{Graph, Id, Symbol};
use super::parse::{Ast, error_at, parse, suggestion};
use crate::error::{Error, Result, nearest};

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
    pub(super) symbols: HashMap<String, Symbol>,
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
    /// What stands before each effect on an input, signal or parameter: its word `value`.
    stood: HashMap<usize, Id>,
}

impl<'a> Scope<'a> {
    /// The scope of a mode.
    pub fn new(doc: &'a Document, names: &'a Names, source: &'a str, mode: &'a str) -> Self {
        Self { names, source, doc, mode, done: HashMap::new(), open: Vec::new(), stood: HashMap::new() }
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

    /// An expression of an effect: its own parameters and states, the words of its place, then the document's names.
    ///
    /// # Errors
    /// [`Error::Expression`].
    pub fn law(
        &mut self,
        g: &mut Graph,
        text: &str,
        e: &AttachedEffect,
        words: &[(&str, Id)],
        key: &str,
    ) -> Result<Id> {
        let path = format!("effect `{}`, {key}", e.name);
        let tree = parse(text, &path)?;
        let own = |g: &mut Graph, name: &str| {
            let word = words.iter().find(|(word, _)| *word == name).map(|(_, id)| *id);
            word.or_else(|| e.parameters.get(name).map(|&i| g.leaf(Symbol::Parameter(i))))
                .or_else(|| e.states.get(name).map(|&i| g.leaf(Symbol::State(i))))
        };
        self.build(g, &tree, &own, text, &path)
    }

    /// An input, signal, parameter or output as its effects leave it, in the order of their attachment.
    pub(super) fn changed(&mut self, g: &mut Graph, at: Place, mut value: Id) -> Result<Id> {
        let names = self.names;
        for (k, e) in names.effects.iter().enumerate().filter(|(_, e)| e.place == at) {
            self.stood.insert(k, value);
            if let Some(text) = &e.effect.law {
                value = self.law(g, text, e, &[("value", value)], "law")?;
            }
        }
        Ok(value)
    }

    /// What stands before an effect on an input, signal, parameter or output.
    pub(super) fn before(&mut self, g: &mut Graph, effect: usize) -> Result<Id> {
        let name = match self.names.effects[effect].place {
            Place::Input(i) => self.doc.inputs.get_index(i).map(|(name, _)| name),
            Place::Signal(i) => self.doc.signals.get_index(i).map(|(name, _)| name),
            Place::Parameter(i) => self.doc.parameters.get_index(i).map(|(name, _)| name),
            _ => None,
        };
        if let Some(name) = name {
            self.expression(g, name, "effects")?; // nothing else may have asked for it yet
        }
        Ok(self.stood[&effect])
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

    /// Opens a definition that may name others.
    fn enter(&mut self, name: &str) -> std::result::Result<(), String> {
        if let Some(first) = self.open.iter().position(|o| o == name) {
            let mut ring = self.open[first..].to_vec();
            ring.push(name.to_string());
            return Err(format!("signals are defined in a circle: {}", ring.join(" -> ")));
        }
        if self.open.len() >= CHAIN {
            return Err(format!("signals defined by signals, more than {CHAIN} deep; flatten them"));
        }
        self.open.push(name.to_string());
        Ok(())
    }

    fn name(&mut self, g: &mut Graph, name: &str, at: usize, text: &str, path: &str) -> Result<Id> {
        if name == "pi" {
            return Ok(g.constant(std::f64::consts::PI));
        }
        if name == "t" {
            return Ok(g.leaf(Symbol::Time));
        }
        if let Some(&id) = self.done.get(name) {
            return Ok(id);
        }
        if let Some(&s) = self.names.symbols.get(name) {
            let leaf = g.leaf(s);
            let place = match s {
                Symbol::Input(i) => Place::Input(i),
                Symbol::Parameter(i) => Place::Parameter(i),
                _ => return Ok(leaf),
            };
            if self.names.effects.iter().all(|e| e.place != place) {
                return Ok(leaf);
            }
            self.enter(name).map_err(|message| error_at(path, text, at, message))?;
            let id = self.changed(g, place, leaf)?;
            self.open.pop();
            self.done.insert(name.to_string(), id);
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
        let number = self.doc.signals.get_index_of(name).unwrap_or(0);
        self.enter(name).map_err(|message| error_at(path, text, at, message))?;
        let id = self.expression(g, signal.expression(), &format!("signals.{name}"))?;
        // An effect acts on what the document says; what ports add comes on top of that.
        let mut id = self.changed(g, Place::Signal(number), id)?;
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
