//! From document to meaning: names resolved, equations and events as expressions in one shared graph.
//!
//! Ports become sums of the laws attached to them (`port_laws`); set-valued friction stays a placeholder
//! ([`Symbol::Dry`]) that [`super::friction`] resolves for each combination of slip and stick.

use indexmap::IndexMap;

use super::attach::Place;
use super::delay::{DelayEquation, OperatorEquation, OperatorKind, PastEquation};
use super::document::{Acts, Direction, Document, Named};
use super::effects::Library;
use super::graph::{Graph, Id, Symbol};
use super::parse::{is_name, is_reserved};
use super::scope::{Names, Scope};
use super::{contact, port_laws};
use crate::error::{Error, Result, nearest};

/// A fitted or fixed number of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterInfo {
    /// `M`, or `coulomb_friction@drive.force` for one of an effect.
    pub name: String,
    /// Value.
    pub value: f64,
    /// One-sigma uncertainty; `None` when exact.
    pub sd: Option<f64>,
    /// Unit.
    pub unit: Option<String>,
    /// Bounds, infinite where there are none.
    pub bounds: (f64, f64),
    /// Index of the attached effect it belongs to.
    pub effect: Option<usize>,
}

/// One mode of the document: rates of all states, and which dry elements act there.
#[derive(Clone, Debug)]
pub struct ModeEquations {
    /// Name.
    pub name: String,
    /// Rates, with [`Symbol::Dry`] placeholders.
    pub flow: Vec<Id>,
    /// Measured quantities.
    pub outputs: Vec<Id>,
    /// Position, velocity of each port.
    pub ports: Vec<(Id, Id)>,
    /// Magnitude of each dry element.
    pub dry_level: Vec<Id>,
}

/// An event of the document.
#[derive(Clone, Debug)]
pub struct EventEquations {
    /// Name.
    pub name: String,
    /// Mode watched.
    pub from: usize,
    /// Mode entered.
    pub to: usize,
    /// Crossing function.
    pub guard: Id,
    /// Direction of the crossing.
    pub direction: Direction,
    /// Additional condition.
    pub when: Option<Id>,
    /// State after, from the state before.
    pub reset: Vec<Id>,
}

/// A sampled update.
#[derive(Clone, Debug)]
pub struct TickEquations {
    /// Name.
    pub name: String,
    /// Period, of parameters only.
    pub every: Id,
    /// First instant, of parameters only.
    pub offset: Id,
    /// State after, by mode, from the state before.
    pub update: Vec<Vec<Id>>,
}

/// Everything the document says, as expressions.
#[derive(Clone, Debug)]
pub struct Assembly {
    /// The shared graph.
    pub graph: Graph,
    /// State names, the document's first, then those of effects.
    pub states: Vec<String>,
    /// Initial values.
    pub initial: Vec<f64>,
    /// States of effects whose initial value follows from the model's state, with the expression.
    pub starts: Vec<(usize, Id)>,
    /// Parameters, the document's first, then those of effects.
    pub parameters: Vec<ParameterInfo>,
    /// Modes.
    pub modes: Vec<ModeEquations>,
    /// Index of the starting mode.
    pub initial_mode: usize,
    /// Events.
    pub events: Vec<EventEquations>,
    /// Sampled updates.
    pub ticks: Vec<TickEquations>,
    /// Port of each dry element.
    pub dry_ports: Vec<usize>,
    /// `effect@port` of each dry element.
    pub dry_names: Vec<String>,
    /// Period of the clock.
    pub period: Option<Id>,
    /// Inputs that are seen late, in the order of their channels.
    pub delays: Vec<DelayEquation>,
    /// What is done to outputs after they were computed.
    pub operators: Vec<OperatorEquation>,
    /// Parameters that are time constants of states which effects bring along.
    pub relaxations: Vec<usize>,
}

/// Name of the mode of a model that has only one.
pub const ONLY_MODE: &str = "motion";

/// Gives a document its meaning.
///
/// # Errors
/// [`Error::Expression`], [`Error::Model`], [`Error::UnknownName`], [`Error::Unit`]: every message names the place in the document.
pub fn assemble(doc: &Document, library: &Library, source: &str) -> Result<Assembly> {
    let mut graph = Graph::over_inputs(doc.inputs.len());
    let mode_names: Vec<String> =
        if doc.modes.is_empty() { vec![ONLY_MODE.to_string()] } else { doc.modes.keys().cloned().collect() };
    let names = Names::new(doc, library, source)?;
    let fault = |path: &str, message: String| Error::Model { path: place(source, path), message };

    let mut modes = Vec::new();
    let mut scopes = Vec::new();
    for mode in &mode_names {
        let as_mode = contact::flows_as(doc, &names, mode);
        let mut scope = Scope::new(doc, &names, source, as_mode);
        let equations = mode_equations(&mut graph, &mut scope, doc, as_mode, source)?;
        modes.push(ModeEquations { name: mode.clone(), ..equations });
        scopes.push(scope);
    }

    let find_mode = |name: Option<&String>, path: &str| -> Result<usize> {
        let Some(name) = name else {
            return if mode_names.len() == 1 {
                Ok(0)
            } else {
                Err(fault(path, "name a mode: the model has several".into()))
            };
        };
        mode_names.iter().position(|m| m == name).ok_or_else(|| Error::UnknownName {
            kind: "mode".into(),
            name: name.clone(),
            nearest: nearest(name, mode_names.iter().map(String::as_str)),
            context: place(source, path),
        })
    };
    let initial_mode = match &doc.initial_mode {
        Some(_) => find_mode(doc.initial_mode.as_ref(), "initial_mode")?,
        None => 0,
    };

    let mut events = Vec::new();
    for (k, tr) in doc.transitions.iter().enumerate() {
        let path = format!("transitions[{}]", tr.name);
        if doc.transitions[..k].iter().any(|o| o.name == tr.name && o.from == tr.from) {
            return Err(fault(&path, "two transitions of one mode share this name; rename one".into()));
        }
        let from = find_mode(tr.from.as_ref(), &format!("{path}.from"))?;
        let to = match &tr.to {
            Some(_) => find_mode(tr.to.as_ref(), &format!("{path}.to"))?,
            None => from,
        };
        let scope = &mut scopes[from];
        let guard = scope.expression(&mut graph, &tr.guard, &format!("{path}.guard"))?;
        let when = match &tr.when {
            Some(text) => Some(scope.expression(&mut graph, text, &format!("{path}.when"))?),
            None => None,
        };
        let reset = updated(&mut graph, scope, &names, &tr.reset, &format!("{path}.reset"))?;
        events.push(EventEquations { name: tr.name.clone(), from, to, guard, direction: tr.direction, when, reset });
    }

    let mut ticks = Vec::new();
    for tick in &doc.ticks {
        let path = format!("ticks[{}]", tick.name);
        let every = constant(&mut graph, &mut scopes[0], &tick.every, &format!("{path}.every"), source)?;
        let offset = match &tick.offset {
            Some(text) => constant(&mut graph, &mut scopes[0], text, &format!("{path}.offset"), source)?,
            None => graph.constant(0.0),
        };
        let update = scopes
            .iter_mut()
            .map(|scope| updated(&mut graph, scope, &names, &tick.update, &format!("{path}.update")))
            .collect::<Result<_>>()?;
        ticks.push(TickEquations { name: tick.name.clone(), every, offset, update });
    }
    let period = match &doc.clock {
        Some(c) => Some(constant(&mut graph, &mut scopes[0], &c.period, "clock.period", source)?),
        None => None,
    };
    for (name, contact) in &doc.contacts {
        for mode in [&contact.free_mode, &contact.held_mode] {
            find_mode(Some(mode), &format!("contacts.{name}"))?;
        }
        for (what, text) in [("gap", &contact.gap), ("rate", &contact.rate)] {
            scopes[0].expression(&mut graph, text, &format!("contacts.{name}.{what}"))?;
        }
        if let Some(port) = contact.port.as_ref().filter(|p| !doc.ports.contains_key(*p)) {
            return Err(fault(&format!("contacts.{name}.port"), format!("there is no port `{port}`")));
        }
    }
    contact::change_events(&mut graph, &mut scopes, doc, &mut events)?;
    for mode in 0..modes.len() {
        corners(&mut graph, &mut scopes[mode], mode, &modes[mode].ports, &mut events)?;
    }
    let mut assembly = Assembly {
        graph,
        initial: names.initial.clone(),
        starts: Vec::new(),
        parameters: names.parameters.clone(),
        states: names.states.clone(),
        modes,
        initial_mode,
        events,
        ticks,
        dry_ports: names.dry.iter().map(|d| d.port).collect(),
        dry_names: names.dry.iter().map(|d| d.name.clone()).collect(),
        period,
        delays: Vec::new(),
        operators: Vec::new(),
        relaxations: names.effects.iter().flat_map(super::attach::AttachedEffect::relaxations).collect(),
    };
    initial_effect_states(&mut assembly, &mut scopes[initial_mode], doc)?;
    port_laws::attach_laws(&mut assembly, &mut scopes, doc)?;
    for e in &names.effects {
        let Place::Output(output) = e.place else { continue };
        for (kind, key, text) in
            [(OperatorKind::Delay, "delay", &e.effect.delay), (OperatorKind::Play, "play", &e.effect.play)]
        {
            let Some(text) = text else { continue };
            let value = scopes[0].constant_of(&mut assembly.graph, text, e, key)?;
            assembly.operators.push(OperatorEquation { output, kind, value });
        }
    }
    for (input, delay) in assembly.graph.late().to_vec() {
        let (name, document) = doc.inputs.get_index(input).expect("late inputs are inputs");
        let past = PastEquation::of(document.before.as_ref(), |text| {
            constant(&mut assembly.graph, &mut scopes[0], text, &format!("inputs.{name}.before"), source)
        })?;
        assembly.delays.push(DelayEquation { input, delay, past });
    }
    Ok(assembly)
}

/// Events at the corners of the laws of effects on inputs and ports: nothing changes there but the slope of a law, and a step
/// that ended there keeps its order.
fn corners(
    g: &mut Graph,
    scope: &mut Scope<'_>,
    mode: usize,
    ports: &[(Id, Id)],
    events: &mut Vec<EventEquations>,
) -> Result<()> {
    let names = scope.names;
    for (k, e) in names.effects.iter().enumerate().filter(|(_, e)| !e.effect.corners.is_empty()) {
        let words = match e.place {
            Place::Port(j) => vec![("position", ports[j].0), ("velocity", ports[j].1)],
            _ => vec![("value", scope.before(g, k)?)],
        };
        for (n, text) in e.effect.corners.iter().enumerate() {
            let guard = scope.law(g, text, e, &words, "corners")?;
            let reset = (0..names.states.len()).map(|i| g.leaf(Symbol::State(i))).collect();
            let name = format!("{}, corner {}", e.name, n + 1);
            let (from, to, direction) = (mode, mode, Direction::Either);
            events.push(EventEquations { name, from, to, guard, direction, when: None, reset });
        }
    }
    Ok(())
}

/// `file: place in the document`.
pub fn place(source: &str, path: &str) -> String {
    if source.is_empty() { path.to_string() } else { format!("{source}: {path}") }
}

fn constant(graph: &mut Graph, scope: &mut Scope<'_>, text: &str, path: &str, source: &str) -> Result<Id> {
    let id = scope.expression(graph, text, path)?;
    if graph.leaves(&[id]).iter().all(|s| matches!(s, Symbol::Parameter(_))) {
        return Ok(id);
    }
    Err(Error::Model { path: place(source, path), message: format!("`{text}` may depend on parameters only") })
}

/// State vector with some entries replaced by expressions.
fn updated(g: &mut Graph, scope: &mut Scope<'_>, names: &Names, to: &Named<String>, path: &str) -> Result<Vec<Id>> {
    let mut state: Vec<Id> = (0..names.states.len()).map(|i| g.leaf(Symbol::State(i))).collect();
    for (name, text) in to {
        let i = names.state(name, &place(scope.source, path))?;
        state[i] = scope.expression(g, text, &format!("{path}.{name}"))?;
    }
    Ok(state)
}

fn mode_equations(
    g: &mut Graph,
    scope: &mut Scope<'_>,
    doc: &Document,
    mode: &str,
    source: &str,
) -> Result<ModeEquations> {
    let fault = |path: &str, message: String| Error::Model { path: place(source, path), message };
    let n = doc.states.len();
    let mut flow: Vec<Option<Id>> = vec![None; n];
    let own = doc.modes.get(mode).map(|m| &m.flow);
    let prefix = if own.is_some() { format!("modes.{mode}.flow") } else { "flow".into() };
    for (table, path) in [(Some(&doc.flow), "flow"), (own, prefix.as_str())] {
        for (name, text) in table.into_iter().flatten() {
            let i = scope.names.state(name, &place(source, path))?;
            flow[i] = Some(scope.expression(g, text, &format!("{path}.{name}"))?);
        }
    }
    let mut rows = super::mass_matrix::Rows::read(g, scope, doc)?;
    if let Some(rows) = &rows
        && let Some(&i) = rows.velocities.iter().find(|&&i| flow[i].is_some())
    {
        let name = &scope.names.states[i];
        return Err(fault(&prefix, format!("`{name}` has a row in the mass matrix; remove its flow")));
    }
    // What the force of each port does here: add to a rate, to a row of the mass matrix, or (in `scope`) to a signal.
    for (j, (name, port)) in doc.ports.iter().enumerate() {
        let path = format!("ports.{name}.acts");
        for (target, text) in acts_in(&port.acts, mode, doc, &place(source, &path))? {
            let Ok(i) = scope.names.state(target, "") else {
                if doc.signals.contains_key(target) {
                    continue;
                }
                let known = doc.states.keys().chain(doc.signals.keys()).map(String::as_str);
                return Err(Error::UnknownName {
                    kind: "state or signal".into(),
                    name: target.clone(),
                    nearest: nearest(target, known),
                    context: place(source, &path),
                });
            };
            let factor = scope.expression(g, text, &format!("{path}.{target}"))?;
            let force = g.leaf(Symbol::Port(j));
            let term = g.mul(factor, force);
            let row = rows.as_mut().and_then(|r| r.force_of(i));
            match (row, flow[i]) {
                (Some(f), _) => *f = g.add(*f, term),
                (None, Some(f)) => flow[i] = Some(g.add(f, term)),
                (None, None) => {}
            }
        }
    }
    if let Some(rows) = rows {
        for (i, rate) in rows.solve(g) {
            flow[i] = Some(rate);
        }
    }
    let mut complete = Vec::new();
    for (i, f) in flow.into_iter().enumerate() {
        let name = &scope.names.states[i];
        complete.push(f.ok_or_else(|| fault(&prefix, format!("there is no flow for the state `{name}`; add one")))?);
    }
    let mut ports = Vec::new();
    for (name, port) in &doc.ports {
        let position = scope.expression(g, &port.position, &format!("ports.{name}.position"))?;
        let velocity = scope.expression(g, &port.velocity, &format!("ports.{name}.velocity"))?;
        let depends = g.leaves(&[position, velocity]);
        if depends.iter().any(|s| matches!(s, Symbol::Port(_))) {
            return Err(fault(&format!("ports.{name}"), "its position or velocity depends on a port's force".into()));
        }
        if g.leaves(&[velocity]).iter().any(|s| matches!(s, Symbol::Input(_))) {
            return Err(fault(&format!("ports.{name}.velocity"), "a velocity may not depend on an input".into()));
        }
        ports.push((position, velocity));
    }
    let mut outputs = Vec::new();
    for (i, (name, d)) in doc.outputs.iter().enumerate() {
        let stated = scope.expression(g, d.expression(), &format!("outputs.{name}"))?;
        outputs.push(scope.changed(g, Place::Output(i), stated)?);
    }
    let names = scope.names;
    for (k, e) in names.effects.iter().enumerate().filter(|(_, e)| !e.states.is_empty()) {
        let words = words(g, scope, doc, &ports, k)?;
        for (state, s) in &e.effect.states {
            complete.push(scope.law(g, &s.flow, e, &words, &format!("states.{state}"))?);
        }
    }
    Ok(ModeEquations { name: mode.to_string(), flow: complete, outputs, ports, dry_level: Vec::new() })
}

/// The words of an effect's place.
fn words(
    g: &mut Graph,
    scope: &mut Scope<'_>,
    doc: &Document,
    ports: &[(Id, Id)],
    effect: usize,
) -> Result<Vec<(&'static str, Id)>> {
    let e = &scope.names.effects[effect];
    match e.place {
        Place::Port(_) | Place::Contact(_) => port_laws::motion(scope, g, doc, e, ports),
        _ => Ok(vec![("value", scope.before(g, effect)?)]),
    }
}

/// Initial values that effects give as expressions, at the model's initial state, t = 0 and the default inputs.
fn initial_effect_states(a: &mut Assembly, scope: &mut Scope<'_>, doc: &Document) -> Result<()> {
    let names = scope.names;
    for (k, e) in names.effects.iter().enumerate() {
        for (state, s) in &e.effect.states {
            let Some(text) = &s.start else { continue };
            let words = words(&mut a.graph, scope, doc, &a.modes[a.initial_mode].ports, k)?;
            let id = scope.law(&mut a.graph, text, e, &words, &format!("states.{state}"))?;
            a.starts.push((e.states[state], id));
            let leaves = a.graph.leaves(&[id]);
            let values: Vec<(Symbol, Id)> = leaves
                .into_iter()
                .map(|leaf| {
                    let value = match leaf {
                        Symbol::State(i) => a.initial[i],
                        Symbol::Parameter(i) => a.parameters[i].value,
                        // Channels behind the document's own are delayed ones: at rest before the record.
                        Symbol::Input(i) => doc.inputs.get_index(i).and_then(|(_, u)| u.value).unwrap_or(0.0),
                        _ => 0.0,
                    };
                    (leaf, a.graph.constant(value))
                })
                .collect();
            let at = |s: Symbol| values.iter().find(|(leaf, _)| *leaf == s).map(|(_, id)| *id);
            let start = a.graph.substitute(&[id], at)[0];
            if let Some(value) = a.graph.value(start).filter(|v| v.is_finite()) {
                a.initial[e.states[state]] = value;
            }
        }
    }
    Ok(())
}

/// The table of a port's actions in one mode.
pub fn acts_in<'d>(acts: &'d Acts, mode: &str, doc: &Document, path: &str) -> Result<Vec<(&'d String, &'d String)>> {
    match acts {
        Acts::Everywhere(table) => Ok(table.iter().collect()),
        Acts::ByMode(by_mode) => {
            if let Some(unknown) = by_mode.keys().find(|m| !doc.modes.contains_key(*m)) {
                return Err(Error::UnknownName {
                    kind: "mode".into(),
                    name: unknown.clone(),
                    nearest: nearest(unknown, doc.modes.keys().map(String::as_str)),
                    context: path.to_string(),
                });
            }
            Ok(by_mode.get(mode).into_iter().flatten().collect())
        }
    }
}

/// Checks a name a document gives to something of its own.
pub fn check_name(name: &str, kind: &str, taken: &mut IndexMap<String, String>, source: &str) -> Result<()> {
    let fault = |message: String| Error::Model { path: place(source, &format!("{kind}.{name}")), message };
    if !is_name(name) {
        return Err(fault(format!("`{name}` is not a name: use letters, digits and `_`, and begin with a letter")));
    }
    if is_reserved(name) {
        return Err(fault(format!("`{name}` has a fixed meaning in expressions; choose another name")));
    }
    match taken.insert(name.to_string(), kind.to_string()) {
        Some(other) => Err(fault(format!("`{name}` is defined twice: in [{other}] and in [{kind}]; rename one"))),
        None => Ok(()),
    }
}
