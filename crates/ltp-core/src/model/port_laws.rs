//! Forces at ports: every port's placeholder becomes the sum of the laws attached there.
//!
//! Some laws need what the rest of the model does at their port. With the port's velocity `v(x, t)`, the rates `f` and the
//! force `w` of the law, the acceleration is `a = grad v . f + dv/dt = a_0 + mobility*w`, and
//!
//! * `free_acceleration` is `a_0`, all other effects at all ports included, and `mobility` is `da/dw`: a law such as
//!   `-mass*free_acceleration/(1 + mass*mobility)` is the exact solution of `w = -mass*a`. Several such laws are put in one
//!   after the other, each seeing the reaction of those before it, which is Gaussian elimination of their joint equations;
//! * `port_stiffness` is `-(da/ds)/mobility` with `s` along the gradient of the port's position: the stiffness that the
//!   model, with the simpler laws attached to it, has along the port. It is a spring's only where everything that a
//!   displacement along the port accelerates is moved by the port's force too: the angle of a motor before a shaft is no place
//!   for the play of that shaft.

use super::assemble::{Assembly, place};
use super::attach::{AttachedEffect, Place};
use super::document::Document;
use super::friction::along;
use super::graph::{Graph, Id, Symbol};
use super::scope::Scope;
use crate::error::{Error, Result};

/// Words of a law that need the rates of the model.
const STIFFNESS: &str = "port_stiffness";
const ACCELERATION: &str = "free_acceleration";
const MOBILITY: &str = "mobility";

/// Replaces every port's force by the sum of the laws attached to it.
pub(super) fn attach_laws(a: &mut Assembly, scopes: &mut [Scope<'_>], doc: &Document) -> Result<()> {
    let names = scopes[0].names;
    let source = scopes[0].source;
    let mut useful = vec![false; names.effects.len()];
    for (m, scope) in scopes.iter_mut().enumerate() {
        let g = &mut a.graph;
        let mut port = Port { flow: &a.modes[m].flow, ports: &a.modes[m].ports, total: Vec::new() };
        port.total = (0..doc.ports.len()).map(|j| g.leaf(Symbol::Port(j))).collect();
        let mut dry_level = Vec::new();
        for (k, e) in names.effects.iter().enumerate() {
            let Some(j) = acts_on(doc, e, &a.modes[m].name) else { continue };
            let words = motion(scope, g, doc, e, port.ports)?;
            if let Some(text) = e.effect.law.as_ref().filter(|_| kind(e) == Kind::Plain) {
                let law = scope.law(g, text, e, &words, "law")?;
                port.add(g, j, law);
            }
            if let Some(text) = &e.effect.dry {
                dry_level.push(scope.law(g, text, e, &words, "dry")?);
                let leaf = g.leaf(Symbol::Dry(dry_level.len() - 1));
                port.add(g, j, leaf);
            }
            useful[k] |= kind(e) == Kind::Plain;
        }
        let mut springs = Vec::new();
        for (k, e) in names.effects.iter().enumerate().filter(|(_, e)| kind(e) == Kind::Spring) {
            let Place::Port(j) = e.place else { continue };
            let local = port.local(g, j, &fault(source, doc, e, j))?;
            let Some(stiffness) = port.stiffness(g, j, local) else { continue };
            if port.shares(g, j) {
                let message = "the spring along this port pulls at something that this port's force does not move: attach \
                               this at the port between the two";
                return Err(fault(source, doc, e, j)(message));
            }
            let mut words = motion(scope, g, doc, e, port.ports)?;
            words.push((STIFFNESS, stiffness));
            springs.push((j, scope.law(g, e.effect.law.as_deref().unwrap_or("0"), e, &words, "law")?));
            useful[k] = true;
        }
        for (j, law) in springs {
            port.add(g, j, law);
        }
        for (k, e) in names.effects.iter().enumerate().filter(|(_, e)| kind(e) == Kind::Implicit) {
            let Place::Port(j) = e.place else { continue };
            let Some((free, mobility)) = port.local(g, j, &fault(source, doc, e, j))? else { continue };
            let mut words = motion(scope, g, doc, e, port.ports)?;
            words.extend([(ACCELERATION, free), (MOBILITY, mobility)]);
            if e.effect.uses(STIFFNESS) {
                let zero = g.constant(0.0);
                words.push((STIFFNESS, port.stiffness(g, j, Some((free, mobility))).unwrap_or(zero)));
            }
            let law = scope.law(g, e.effect.law.as_deref().unwrap_or("0"), e, &words, "law")?;
            port.react(g, j, law);
            useful[k] = true;
        }
        let zero = g.constant(0.0);
        let total = std::mem::take(&mut port.total);
        let force = g.substitute(&total, |s| matches!(s, Symbol::Port(_)).then_some(zero));
        let put = |g: &mut Graph, ids: &mut Vec<Id>| {
            *ids = g.substitute(ids, |s| if let Symbol::Port(j) = s { Some(force[j]) } else { None });
        };
        put(g, &mut a.modes[m].flow);
        put(g, &mut a.modes[m].outputs);
        a.modes[m].dry_level = dry_level;
        for event in a.events.iter_mut().filter(|e| e.from == m) {
            put(g, &mut event.reset);
            let mut guard = vec![event.guard];
            guard.extend(event.when);
            put(g, &mut guard);
            (event.guard, event.when) = (guard[0], guard.get(1).copied());
        }
        for tick in &mut a.ticks {
            put(g, &mut tick.update[m]);
        }
    }
    for (e, useful) in names.effects.iter().zip(useful) {
        let Place::Port(j) = e.place else { continue };
        if !useful {
            let what = if kind(e) == Kind::Spring {
                "the model has no stiffness along this port, so that there is no spring to act on"
            } else {
                "this port's force accelerates nothing"
            };
            return Err(fault(source, doc, e, j)(what));
        }
    }
    Ok(())
}

/// What a law needs.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// The motion of its port.
    Plain,
    /// The stiffness of the model.
    Spring,
    /// The acceleration of its port.
    Implicit,
}

fn kind(e: &AttachedEffect) -> Kind {
    if e.effect.uses(ACCELERATION) || e.effect.uses(MOBILITY) {
        Kind::Implicit
    } else if e.effect.uses(STIFFNESS) {
        Kind::Spring
    } else {
        Kind::Plain
    }
}

/// The port on which an effect's force acts in a mode: its own, or its contact's while that holds.
fn acts_on(doc: &Document, e: &AttachedEffect, mode: &str) -> Option<usize> {
    match e.place {
        Place::Port(j) => Some(j),
        Place::Contact(c) => {
            let contact = &doc.contacts[c];
            let acts = e.effect.law.is_some() && contact.held_mode == mode;
            acts.then(|| doc.ports.get_index_of(contact.port.as_ref()?)).flatten()
        }
        _ => None,
    }
}

/// Words for the motion where an effect acts.
pub(super) fn motion(
    scope: &mut Scope<'_>,
    g: &mut Graph,
    doc: &Document,
    e: &AttachedEffect,
    ports: &[(Id, Id)],
) -> Result<Vec<(&'static str, Id)>> {
    Ok(match e.place {
        Place::Port(j) => vec![("position", ports[j].0), ("velocity", ports[j].1)],
        Place::Contact(c) => {
            let (gap, rate) = super::contact::motion(scope, g, doc, c)?;
            vec![("gap", gap), ("rate", rate)]
        }
        _ => Vec::new(),
    })
}

fn fault<'a>(source: &'a str, doc: &'a Document, e: &'a AttachedEffect, j: usize) -> impl Fn(&str) -> Error + 'a {
    move |message: &str| {
        let at = doc.ports.get_index(j).map_or("", |(name, _)| name.as_str());
        let path = place(source, &format!("effects[{}@{at}]", e.name));
        Error::Model { path, message: message.into() }
    }
}

/// The ports of one mode while laws are being put in.
struct Port<'a> {
    flow: &'a [Id],
    ports: &'a [(Id, Id)],
    /// Force of each port so far; [`Symbol::Port`] stands for whatever is still to come there.
    total: Vec<Id>,
}

impl Port<'_> {
    /// Adds a force that does not react to what comes later.
    fn add(&mut self, g: &mut Graph, j: usize, law: Id) {
        self.total[j] = g.add(self.total[j], law);
    }

    /// Adds a force that depends on what comes later.
    fn react(&mut self, g: &mut Graph, j: usize, law: Id) {
        let later = g.leaf(Symbol::Port(j));
        let both = g.add(later, law);
        self.total = g.substitute(&self.total, |s| (s == Symbol::Port(j)).then_some(both));
    }

    /// Acceleration of a port as it depends on what comes later, and its mobility; `None` where its force does nothing.
    fn local(&self, g: &mut Graph, j: usize, fault: &dyn Fn(&str) -> Error) -> Result<Option<(Id, Id)>> {
        let total = &self.total;
        let flow = g.substitute(self.flow, |s| if let Symbol::Port(i) = s { Some(total[i]) } else { None });
        let velocity = self.ports[j].1;
        let (drift, time) = (along(g, velocity, &flow), g.derivative(&[velocity], Symbol::Time)[0]);
        let acceleration = g.add(drift, time);
        let mobility = g.derivative(&[acceleration], Symbol::Port(j))[0];
        if g.is_zero(mobility) {
            let acts = g.derivative(&flow, Symbol::Port(j)).iter().any(|&d| !g.is_zero(d));
            return if acts {
                Err(fault("this port's force does not accelerate this port's velocity"))
            } else {
                Ok(None)
            };
        }
        if g.leaves(&[mobility]).iter().any(|s| matches!(s, Symbol::Port(_) | Symbol::Dry(_))) {
            return Err(fault("this port's force enters its acceleration other than in proportion"));
        }
        Ok(Some((acceleration, mobility)))
    }

    /// Whether a displacement along a port accelerates what a port's force can move, but this one's does not: then the spring
    /// is between this port and another one.
    fn shares(&self, g: &mut Graph, j: usize) -> bool {
        let reached = |g: &mut Graph, n: usize, port: usize| {
            let by = g.derivative(&[self.flow[n]], Symbol::Port(port))[0];
            !g.is_zero(by)
        };
        (0..self.flow.len()).any(|n| {
            let moved = (0..self.flow.len()).any(|k| {
                let slope = g.derivative(&[self.ports[j].0], Symbol::State(k))[0];
                !g.is_zero(slope) && {
                    let by = g.derivative(&[self.flow[n]], Symbol::State(k))[0];
                    !g.is_zero(by)
                }
            });
            moved && !reached(g, n, j) && (0..self.ports.len()).any(|i| reached(g, n, i))
        })
    }

    /// Stiffness along a port; `None` where there is none.
    fn stiffness(&self, g: &mut Graph, j: usize, local: Option<(Id, Id)>) -> Option<Id> {
        let (acceleration, mobility) = local?;
        let zero = g.constant(0.0);
        let still = g.substitute(&[acceleration], |s| matches!(s, Symbol::Port(_)).then_some(zero))[0];
        let (mut change, mut square) = (zero, zero);
        for n in 0..self.flow.len() {
            let slope = g.derivative(&[self.ports[j].0], Symbol::State(n))[0];
            if g.is_zero(slope) {
                continue;
            }
            let by = g.derivative(&[still], Symbol::State(n))[0];
            let (term, own) = (g.mul(by, slope), g.mul(slope, slope));
            change = g.add(change, term);
            square = g.add(square, own);
        }
        if g.is_zero(change) {
            return None;
        }
        let per_length = g.div(change, square);
        let per_force = g.div(per_length, mobility);
        Some(g.neg(per_force))
    }
}
