//! Dimensional analysis of a document: sums of different things, rates and outputs in the wrong unit are errors.
//!
//! Only declared units take part: a name without a unit fits everywhere. Literal numbers fit every sum and are
//! dimensionless in products, so `0.5*M*v^2` and `h - 0.2` both read as meant.

use std::collections::HashMap;

use super::assemble::place;
use super::document::{Acts, Before, Document};
use super::graph::{Fun1, Fun2};
use super::parse::{Ast, error_at, parse};
use super::units::{DIMENSIONLESS, Dimensions, Unit, same};
use crate::error::{Error, Result};

/// What is known about the dimension of an expression.
#[derive(Clone, Copy, Debug)]
enum Dim {
    /// A literal: fits any sum.
    Number,
    /// Depends on something without a declared unit.
    Unknown,
    /// Known.
    Known(Dimensions),
}

struct Checker<'a> {
    doc: &'a Document,
    source: &'a str,
    known: HashMap<&'a str, Dimensions>,
    signals: HashMap<String, Dim>,
}

/// Checks every expression of a document.
///
/// # Errors
/// [`Error::Unit`] for an unknown or non-SI unit of a quantity, [`Error::Expression`] pointing at a clash.
pub fn check(doc: &Document, source: &str) -> Result<()> {
    let mut known = HashMap::new();
    let inside = [
        ("states", doc.states.iter().map(|(n, s)| (n, s.unit.as_deref())).collect::<Vec<_>>()),
        ("inputs", doc.inputs.iter().map(|(n, s)| (n, s.unit.as_deref())).collect()),
        ("parameters", doc.parameters.iter().map(|(n, s)| (n, s.unit.as_deref())).collect()),
        ("signals", doc.signals.iter().map(|(n, s)| (n, s.unit())).collect()),
        ("ports", doc.ports.iter().map(|(n, s)| (n, s.unit.as_deref())).collect()),
    ];
    for (table, entries) in &inside {
        for (name, text) in entries.iter().filter_map(|(n, u)| u.map(|u| (n, u))) {
            let path = place(source, &format!("{table}.{name}"));
            let unit = Unit::parse(text, &path)?;
            if (unit.factor() - 1.0).abs() > 1e-12 {
                let message = format!(
                    "`{text}` is not a coherent SI unit: give the value in `{}` (it is {} of them)",
                    if same(&unit.dimensions(), &DIMENSIONLESS) {
                        "rad".into()
                    } else {
                        Unit::of_dimensions(&unit.dimensions()).to_string()
                    },
                    unit.factor()
                );
                return Err(Error::Unit { path, message });
            }
            if *table != "ports" {
                known.insert(name.as_str(), unit.dimensions());
            }
        }
    }
    let mut c = Checker { doc, source, known, signals: HashMap::new() };
    c.document()
}

impl Checker<'_> {
    fn document(&mut self) -> Result<()> {
        let doc = self.doc;
        for name in doc.signals.keys() {
            self.signal(name, 0)?;
        }
        let flows = std::iter::once(("flow".to_string(), &doc.flow))
            .chain(doc.modes.iter().map(|(m, mode)| (format!("modes.{m}.flow"), &mode.flow)));
        for (path, table) in flows {
            for (state, text) in table {
                self.wants(text, self.rate(state), &format!("{path}.{state}"), "the rate of the state")?;
            }
        }
        for (name, d) in &doc.outputs {
            let path = format!("outputs.{name}");
            let unit = match d.unit() {
                Some(u) => Some(Unit::parse(u, &place(self.source, &path))?.dimensions()),
                None => None,
            };
            self.wants(d.expression(), unit, &path, "the output's unit")?;
        }
        for t in &doc.transitions {
            let path = format!("transitions[{}]", t.name);
            self.wants(&t.guard, None, &format!("{path}.guard"), "")?;
            for (state, text) in &t.reset {
                let unit = self.known.get(state.as_str()).copied();
                self.wants(text, unit, &format!("{path}.reset.{state}"), "the state")?;
            }
        }
        let second = Some([0.0, 0.0, 1.0, 0.0, 0.0]);
        for t in &doc.ticks {
            let path = format!("ticks[{}]", t.name);
            self.wants(&t.every, second, &format!("{path}.every"), "a time")?;
            for (state, text) in &t.update {
                let unit = self.known.get(state.as_str()).copied();
                self.wants(text, unit, &format!("{path}.update.{state}"), "the state")?;
            }
        }
        if let Some(clock) = &doc.clock {
            self.wants(&clock.period, second, "clock.period", "a time")?;
        }
        for (name, input) in &doc.inputs {
            if let Some(Before::Periodic { periodic }) = &input.before {
                self.wants(periodic, second, &format!("inputs.{name}.before"), "a time")?;
            }
        }
        self.mass_matrix()?;
        for (name, port) in &doc.ports {
            self.wants(&port.position, None, &format!("ports.{name}.position"), "")?;
            self.wants(&port.velocity, None, &format!("ports.{name}.velocity"), "")?;
            let Some(force) = &port.unit else { continue };
            let force = Unit::parse(force, self.source)?;
            let tables = match &port.acts {
                Acts::Everywhere(t) => vec![t],
                Acts::ByMode(m) => m.values().collect(),
            };
            for (target, text) in tables.into_iter().flatten() {
                let row = doc.mass_matrix.as_ref().and_then(|m| m.velocities.iter().position(|v| v == target));
                let wanted = match row {
                    Some(i) => {
                        self.dim_of(&doc.mass_matrix.as_ref().map(|m| m.forces[i].clone()).unwrap_or_default(), "")?
                    }
                    None if doc.signals.contains_key(target) => self.signal(target, 0)?,
                    None => self.rate(target).map_or(Dim::Unknown, Dim::Known),
                };
                if let Dim::Known(w) = wanted {
                    let per_force = Unit::of_dimensions(&w).times(&force, -1.0).dimensions();
                    let path = format!("ports.{name}.acts.{target}");
                    self.wants(text, Some(per_force), &path, "the factor from this port's force")?;
                }
            }
        }
        Ok(())
    }

    fn mass_matrix(&mut self) -> Result<()> {
        let Some(m) = &self.doc.mass_matrix else { return Ok(()) };
        for (i, (row, force)) in m.matrix.iter().zip(&m.forces).enumerate() {
            let Dim::Known(f) = self.dim_of(force, &format!("mass_matrix.forces[{i}]"))? else { continue };
            for (j, (entry, v)) in row.iter().zip(&m.velocities).enumerate() {
                let wanted =
                    self.rate(v).map(|r| Unit::of_dimensions(&f).times(&Unit::of_dimensions(&r), -1.0).dimensions());
                self.wants(entry, wanted, &format!("mass_matrix.matrix[{i}][{j}]"), "force over acceleration")?;
            }
        }
        Ok(())
    }

    /// Dimension of the rate of a state.
    fn rate(&self, state: &str) -> Option<Dimensions> {
        let mut d = *self.known.get(state)?;
        d[2] -= 1.0;
        Some(d)
    }

    fn dim_of(&mut self, text: &str, path: &str) -> Result<Dim> {
        let at = place(self.source, path);
        let tree = parse(text, &at)?;
        self.dim(&tree, text, &at, 0)
    }

    fn wants(&mut self, text: &str, wanted: Option<Dimensions>, path: &str, what: &str) -> Result<()> {
        let found = self.dim_of(text, path)?;
        match (found, wanted) {
            (Dim::Known(f), Some(w)) if !same(&f, &w) => Err(Error::Unit {
                path: place(self.source, path),
                message: format!(
                    "`{text}` is in `{}`, but {what} is in `{}`",
                    Unit::of_dimensions(&f),
                    Unit::of_dimensions(&w)
                ),
            }),
            _ => Ok(()),
        }
    }

    fn signal(&mut self, name: &str, depth: usize) -> Result<Dim> {
        if let Some(d) = self.signals.get(name) {
            return Ok(*d);
        }
        let Some(definition) = self.doc.signals.get(name).filter(|_| depth < 100) else { return Ok(Dim::Unknown) };
        let path = place(self.source, &format!("signals.{name}"));
        let tree = parse(definition.expression(), &path)?;
        let found = self.dim(&tree, definition.expression(), &path, depth + 1)?;
        let d = match self.known.get(name).copied() {
            Some(w) => {
                self.wants(definition.expression(), Some(w), &format!("signals.{name}"), "the signal's unit")?;
                Dim::Known(w)
            }
            None => found,
        };
        self.signals.insert(name.to_string(), d);
        Ok(d)
    }

    fn dim(&mut self, tree: &Ast, text: &str, path: &str, depth: usize) -> Result<Dim> {
        let clash = |at: usize, a: &Dimensions, b: &Dimensions, what: &str| {
            let (a, b) = (Unit::of_dimensions(a), Unit::of_dimensions(b));
            Err(error_at(path, text, at, format!("units clash: `{a}` {what} `{b}`")))
        };
        Ok(match tree {
            Ast::Number(_) => Dim::Number,
            Ast::Name(n, _) if n == "pi" => Dim::Known(DIMENSIONLESS),
            Ast::Name(n, _) if n == "t" => Dim::Known([0.0, 0.0, 1.0, 0.0, 0.0]),
            Ast::Name(n, _) => match self.known.get(n.as_str()) {
                Some(d) => Dim::Known(*d),
                None => self.signal(n, depth)?,
            },
            Ast::One(f, a, at) => {
                let d = self.dim(a, text, path, depth)?;
                match (f, d) {
                    (Fun1::Neg | Fun1::Abs, d) => d,
                    (Fun1::Sign, _) => Dim::Known(DIMENSIONLESS),
                    (Fun1::Sqrt, Dim::Known(d)) => Dim::Known(d.map(|e| e / 2.0)),
                    (Fun1::Sqrt, d) => d,
                    (_, Dim::Known(d)) if !same(&d, &DIMENSIONLESS) => {
                        let unit = Unit::of_dimensions(&d);
                        let message = format!("the argument must be dimensionless or an angle, but is in `{unit}`");
                        return Err(error_at(path, text, *at, message));
                    }
                    _ => Dim::Known(DIMENSIONLESS),
                }
            }
            Ast::Two(f, a, b, at) => {
                let (l, r) = (self.dim(a, text, path, depth)?, self.dim(b, text, path, depth)?);
                match f {
                    Fun2::Mul | Fun2::Div => {
                        let sign = if *f == Fun2::Mul { 1.0 } else { -1.0 };
                        match (l, r) {
                            (Dim::Unknown, _) | (_, Dim::Unknown) => Dim::Unknown,
                            (Dim::Number, Dim::Number) => Dim::Number,
                            (Dim::Known(l), Dim::Number) => Dim::Known(l),
                            (Dim::Number, Dim::Known(r)) => Dim::Known(r.map(|e| sign * e)),
                            (Dim::Known(l), Dim::Known(r)) => Dim::Known(std::array::from_fn(|i| l[i] + sign * r[i])),
                        }
                    }
                    Fun2::Pow => match (l, exponent(b)) {
                        (Dim::Known(l), Some(n)) => Dim::Known(l.map(|e| e * n)),
                        (Dim::Known(l), None) if !same(&l, &DIMENSIONLESS) => Dim::Unknown,
                        (l, _) => l,
                    },
                    Fun2::Atan2 => Dim::Known(DIMENSIONLESS),
                    _ => {
                        let sum = match (l, r) {
                            (Dim::Known(a), Dim::Known(b)) if !same(&a, &b) => {
                                return clash(
                                    *at,
                                    &a,
                                    &b,
                                    if matches!(f, Fun2::Add | Fun2::Sub) { "and" } else { "against" },
                                );
                            }
                            (Dim::Known(d), _) | (_, Dim::Known(d)) => Dim::Known(d),
                            (Dim::Number, Dim::Number) => Dim::Number,
                            _ => Dim::Unknown,
                        };
                        match f {
                            Fun2::Add | Fun2::Sub | Fun2::Min | Fun2::Max => sum,
                            _ => Dim::Known(DIMENSIONLESS),
                        }
                    }
                }
            }
            Ast::If(three, at) => {
                self.dim(&three[0], text, path, depth)?;
                let (l, r) = (self.dim(&three[1], text, path, depth)?, self.dim(&three[2], text, path, depth)?);
                match (l, r) {
                    (Dim::Known(a), Dim::Known(b)) if !same(&a, &b) => return clash(*at, &a, &b, "or"),
                    (Dim::Known(d), _) | (_, Dim::Known(d)) => Dim::Known(d),
                    (l, _) => l,
                }
            }
        })
    }
}

/// The number an exponent is, if it is one.
fn exponent(tree: &Ast) -> Option<f64> {
    match tree {
        Ast::Number(v) => Some(*v),
        Ast::One(Fun1::Neg, a, _) => exponent(a).map(|v| -v),
        _ => None,
    }
}
