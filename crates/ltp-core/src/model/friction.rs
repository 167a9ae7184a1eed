//! Set-valued dry friction as slip and stick modes.
//!
//! Each dry element multiplies every mode of the document by three: slip with positive velocity (`phi = -L`), slip with
//! negative velocity (`phi = +L`) and stick, where `phi` is the force that keeps the port's velocity constant:
//! with rates `f = f0 + sum_j (df/dphi_j) phi_j` and port velocities `v_i(x, t)`,
//! `sum_j (grad v_i . df/dphi_j) phi_j = -(grad v_i . f0 + dv_i/dt)` over the sticking elements. Stick ends where
//! `|phi| = L`. Between events the equations are smooth, so no regularisation (a steep tanh) is ever needed and the
//! engine's error stays that of the smooth integrator. (Filippov 1988; Acary & Brogliato 2008, chapter 1.)

use super::assemble::{Assembly, place};
use super::graph::{Graph, Id, Symbol};
use super::mass_matrix::solve;
use super::program::Program;
use crate::error::{Error, Result};

/// What one dry element does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contact {
    /// Slips with positive velocity.
    Forward,
    /// Slips with negative velocity.
    Backward,
    /// Holds.
    Stick,
}

/// Modes of the document times slip or stick of each dry element, as one number.
#[derive(Clone, Debug)]
pub struct Product {
    /// Number of dry elements.
    pub elements: usize,
    /// `active[base][element]`: whether the element acts in that mode of the document.
    pub active: Vec<Vec<bool>>,
}

impl Product {
    /// The product of an assembly.
    ///
    /// # Errors
    /// [`Error::Model`] when a rate depends on friction other than in proportion, or friction cannot hold its port.
    pub fn new(a: &Assembly, source: &str) -> Result<Self> {
        let elements = a.dry_ports.len();
        let mut g = a.graph.clone();
        let fault = |i: usize, message: &str| Error::Model {
            path: place(source, &format!("effects[{}]", a.dry_names[i])),
            message: message.into(),
        };
        if elements > 6 {
            return Err(fault(6, "more than six dry friction elements: 3^n modes would be too many; merge some"));
        }
        let mut active = Vec::new();
        for mode in &a.modes {
            let mut row = Vec::new();
            for i in 0..elements {
                let slope = g.derivative(&mode.flow, Symbol::Dry(i));
                if g.leaves(&slope).iter().any(|s| matches!(s, Symbol::Dry(_))) {
                    return Err(fault(i, "the rates depend on dry friction other than in proportion"));
                }
                let acts = slope.iter().any(|&s| !g.is_zero(s));
                let velocity = mode.ports[a.dry_ports[i]].1;
                let authority = along(&mut g, velocity, &slope);
                if acts && g.is_zero(authority) {
                    return Err(fault(
                        i,
                        "this port's force does not accelerate this port's velocity: friction cannot hold it",
                    ));
                }
                row.push(acts);
            }
            active.push(row);
        }
        Ok(Self { elements, active })
    }

    /// Number of combined modes.
    pub fn count(&self) -> usize {
        self.active.len() * 3usize.pow(self.elements as u32)
    }

    /// Mode of the document and contact of each element.
    pub fn split(&self, mode: usize) -> (usize, Vec<Contact>) {
        let mut rest = mode;
        let contacts = (0..self.elements)
            .map(|_| {
                let c = [Contact::Forward, Contact::Backward, Contact::Stick][rest % 3];
                rest /= 3;
                c
            })
            .collect();
        (rest, contacts)
    }

    /// The combined mode.
    pub fn join(&self, base: usize, contacts: &[Contact]) -> usize {
        contacts.iter().rev().fold(base, |m, c| 3 * m + *c as usize)
    }
}

/// Friction forces of one combined mode, as expressions free of placeholders.
pub struct Forces {
    /// `phi` of each element.
    pub phi: Vec<Id>,
    /// Level of each element.
    pub level: Vec<Id>,
    /// Velocity of each element's port.
    pub velocity: Vec<Id>,
}

/// Friction forces in a combined mode.
pub fn forces(g: &mut Graph, a: &Assembly, base: usize, contacts: &[Contact], active: &[bool]) -> Forces {
    let mode = &a.modes[base];
    let zero = g.constant(0.0);
    let mut phi = vec![zero; contacts.len()];
    let velocity: Vec<Id> = a.dry_ports.iter().map(|&p| mode.ports[p].1).collect();
    for (i, c) in contacts.iter().enumerate().filter(|(i, _)| active[*i]) {
        phi[i] = match c {
            Contact::Forward => g.neg(mode.dry_level[i]),
            Contact::Backward => mode.dry_level[i],
            Contact::Stick => zero,
        };
    }
    let stuck: Vec<usize> = (0..contacts.len()).filter(|&i| active[i] && contacts[i] == Contact::Stick).collect();
    if !stuck.is_empty() {
        let known = phi.clone();
        let free = g.substitute(&mode.flow, |s| if let Symbol::Dry(i) = s { Some(known[i]) } else { None });
        let slopes: Vec<Vec<Id>> = stuck.iter().map(|&j| g.derivative(&mode.flow, Symbol::Dry(j))).collect();
        let mut matrix = Vec::new();
        let mut right = Vec::new();
        for &i in &stuck {
            matrix.push(slopes.iter().map(|slope| along(g, velocity[i], slope)).collect::<Vec<_>>());
            let drift = along(g, velocity[i], &free);
            let vt = g.derivative(&[velocity[i]], Symbol::Time)[0];
            let total = g.add(drift, vt);
            right.push(g.neg(total));
        }
        for (&i, force) in stuck.iter().zip(solve(g, matrix, right)) {
            phi[i] = force;
        }
    }
    Forces { phi, level: mode.dry_level.clone(), velocity }
}

/// `grad v . rates`.
pub(super) fn along(g: &mut Graph, v: Id, rates: &[Id]) -> Id {
    let mut sum = g.constant(0.0);
    for (k, &rate) in rates.iter().enumerate() {
        let slope = g.derivative(&[v], Symbol::State(k))[0];
        let term = g.mul(slope, rate);
        sum = g.add(sum, term);
    }
    sum
}

/// The parts of a mode with dry friction, separated: for integrators that treat friction in their own way.
pub struct Parts {
    /// Rates without dry friction (nx).
    pub flow: Program,
    /// Change of the rates per unit of each friction force (elements, nx).
    pub action: Program,
    /// Velocity of each element, its level, and the change of its velocity's rate per unit of its own force.
    pub element: Program,
    /// Rate of each element's velocity without friction, then its change per unit of each friction force
    /// (elements, 1 + elements).
    pub hold: Program,
    /// Measured quantities.
    pub output: Program,
    /// Number of dry elements.
    pub elements: usize,
}

/// An event for integrators that treat friction in their own way: its guard depends on friction in proportion.
pub struct EventParts {
    /// Mode watched.
    pub from: usize,
    /// Mode entered.
    pub to: usize,
    /// Which crossing of zero fires.
    pub direction: super::document::Direction,
    /// Crossing function without friction, then its change per unit of each friction force (1 + elements).
    pub guard: Program,
    /// Additional condition, in the same form.
    pub when: Option<Program>,
    /// State after, from the state before (nx).
    pub reset: Program,
}

/// Separates friction from the smooth rest in a mode of the document, for the plain evaluator.
pub fn parts(a: &Assembly, base: usize) -> Parts {
    let mut g = a.graph.clone();
    let mode = &a.modes[base];
    let flow = without(&mut g, &mode.flow);
    let output = without(&mut g, &mode.outputs);
    let elements = a.dry_ports.len();
    let slopes: Vec<Vec<Id>> = (0..elements).map(|i| g.derivative(&mode.flow, Symbol::Dry(i))).collect();
    let (mut element, mut hold) = (Vec::new(), Vec::new());
    for (i, &port) in a.dry_ports.iter().enumerate() {
        let velocity = mode.ports[port].1;
        let drift = along(&mut g, velocity, &flow);
        let vt = g.derivative(&[velocity], Symbol::Time)[0];
        hold.push(g.add(drift, vt));
        let coupling: Vec<Id> = slopes.iter().map(|slope| along(&mut g, velocity, slope)).collect();
        element.extend([velocity, mode.dry_level[i], coupling[i]]);
        hold.extend(coupling);
    }
    Parts {
        flow: Program::plain(&g, &flow),
        action: Program::plain(&g, &slopes.concat()),
        element: Program::plain(&g, &element),
        hold: Program::plain(&g, &hold),
        output: Program::plain(&g, &output),
        elements,
    }
}

/// The events of a model with friction set apart, for the plain evaluator, in the order of the document.
pub fn event_parts(a: &Assembly) -> Vec<EventParts> {
    let mut g = a.graph.clone();
    let affine = |g: &mut Graph, id: Id| {
        let mut all = without(g, &[id]);
        all.extend((0..a.dry_ports.len()).map(|i| g.derivative(&[id], Symbol::Dry(i))[0]));
        Program::plain(g, &all)
    };
    let mut out = Vec::new();
    for e in &a.events {
        let guard = affine(&mut g, e.guard);
        let when = e.when.map(|w| affine(&mut g, w));
        let reset = without(&mut g, &e.reset);
        let reset = Program::plain(&g, &reset);
        out.push(EventParts { from: e.from, to: e.to, direction: e.direction, guard, when, reset });
    }
    out
}

/// Expressions with every dry friction force zero.
fn without(g: &mut Graph, ids: &[Id]) -> Vec<Id> {
    let zero = g.constant(0.0);
    g.substitute(ids, |s| matches!(s, Symbol::Dry(_)).then_some(zero))
}
