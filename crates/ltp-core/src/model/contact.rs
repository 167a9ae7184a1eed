//! Effects on contacts: ground that is elsewhere, throws back or yields.
//!
//! A contact names the mode in which its gap is free and the mode in which it is held; touchdown is the transition from
//! the first to the second whose guard is the gap. An effect changes those transitions, and, where the ground yields, the
//! held mode itself: it becomes the free mode with a force of the ground on the contact's port.

use super::assemble::{EventEquations, place};
use super::attach::Place;
use super::document::{Contact, Direction, Document};
use super::graph::{Fun2, Graph, Id, Symbol};
use super::scope::{Names, Scope};
use crate::error::{Error, Result};

/// Speed of a rebound, in the unit of the contact's rate, at or below which the contact is held: infinitely many ever
/// smaller bounces end here.
pub const REBOUND: f64 = 1e-3;

/// The mode whose equations a mode has: the free one for the held mode of a contact whose ground yields.
pub(super) fn flows_as<'d>(doc: &'d Document, names: &Names, mode: &'d str) -> &'d str {
    let yielding = names.effects.iter().filter(|e| e.effect.law.is_some()).find_map(|e| match e.place {
        Place::Contact(c) => Some(&doc.contacts[c]).filter(|contact| contact.held_mode == mode),
        _ => None,
    });
    yielding.map_or(mode, |contact| &contact.free_mode)
}

/// Gap and rate of a contact as its effects leave them.
pub(super) fn motion(scope: &mut Scope<'_>, g: &mut Graph, doc: &Document, contact: usize) -> Result<(Id, Id)> {
    let Some((name, c)) = doc.contacts.get_index(contact) else { unreachable!("numbers come from the document") };
    let mut gap = scope.expression(g, &c.gap, &format!("contacts.{name}.gap"))?;
    let rate = scope.expression(g, &c.rate, &format!("contacts.{name}.rate"))?;
    let names = scope.names;
    for e in names.effects.iter().filter(|e| e.place == Place::Contact(contact)) {
        if let Some(text) = &e.effect.gap {
            gap = scope.law(g, text, e, &[("gap", gap), ("rate", rate)], "gap")?;
        }
    }
    Ok((gap, rate))
}

/// Changes the events of the contacts that effects are attached to.
pub(super) fn change_events(
    g: &mut Graph,
    scopes: &mut [Scope<'_>],
    doc: &Document,
    events: &mut Vec<EventEquations>,
) -> Result<()> {
    let names = scopes[0].names;
    let mode = |name: &str| doc.modes.get_index_of(name).unwrap_or(0);
    for (number, (name, contact)) in doc.contacts.iter().enumerate() {
        let own: Vec<_> = names.effects.iter().filter(|e| e.place == Place::Contact(number)).collect();
        if own.is_empty() {
            continue;
        }
        let source = scopes[0].source;
        let fault = |message: String| Error::Model { path: place(source, &format!("contacts.{name}")), message };
        let (free, held) = (mode(&contact.free_mode), mode(&contact.held_mode));
        let scope = &mut scopes[free];
        let stated = scope.expression(g, &contact.gap, &format!("contacts.{name}.gap"))?;
        let (gap, rate) = motion(scope, g, doc, number)?;
        let touchdown = events.iter().position(|e| e.from == free && e.to == held && e.guard == stated);
        let touchdown = touchdown.ok_or_else(|| {
            fault(format!(
                "effects on a contact need a transition from `{}` to `{}` with the guard `{}`; add one",
                contact.free_mode, contact.held_mode, contact.gap
            ))
        })?;
        events[touchdown].guard = gap;
        let yielding: Vec<_> = own.iter().filter(|e| e.effect.law.is_some()).collect();
        let bouncing: Vec<_> = own.iter().filter(|e| e.effect.rebound.is_some()).collect();
        if yielding.len() + bouncing.len() > 1 {
            return Err(fault("one effect at a time may say what touchdown does: yield or throw back".into()));
        }
        if let Some(e) = bouncing.first() {
            let Ok(state) = names.state(contact.rate.trim(), "") else {
                let rate = &contact.rate;
                return Err(fault(format!("`{rate}`: a rebound sets the rate, which must be a state by itself")));
            };
            let text = e.effect.rebound.as_deref().unwrap_or("rate");
            let rebound = scope.law(g, text, e, &[("gap", gap), ("rate", rate)], "rebound")?;
            bounce(g, events, touchdown, state, rebound, free);
        }
        if !yielding.is_empty() {
            if contact.port.is_none() {
                return Err(fault("ground that yields needs the contact's `port` to act on; name one".into()));
            }
            let e = yielding[0];
            let text = e.effect.law.as_deref().unwrap_or("0");
            let force = scope.law(g, text, e, &[("gap", gap), ("rate", rate)], "law")?;
            let zero = g.constant(0.0);
            let at_rest = scope.law(g, text, e, &[("gap", gap), ("rate", zero)], "law")?;
            yields(g, events, contact, (touchdown, free, held), (force, at_rest));
        }
    }
    Ok(())
}

/// At touchdown the free mode goes on with the rebound, as long as that is fast.
fn bounce(g: &mut Graph, events: &mut Vec<EventEquations>, touchdown: usize, state: usize, rebound: Id, free: usize) {
    let threshold = g.constant(REBOUND);
    let fast = g.two(Fun2::Gt, rebound, threshold);
    let slow = g.two(Fun2::Le, rebound, threshold);
    let event = &mut events[touchdown];
    let mut thrown = event.clone();
    event.when = Some(event.when.map_or(slow, |w| g.mul(w, slow)));
    thrown.when = Some(thrown.when.map_or(fast, |w| g.mul(w, fast)));
    thrown.name = format!("{} (rebound)", thrown.name);
    thrown.to = free;
    thrown.reset = (0..thrown.reset.len()).map(|i| g.leaf(Symbol::State(i))).collect();
    thrown.reset[state] = rebound;
    events.insert(touchdown, thrown);
}

/// Contact begins where the gap closes and ends where the force of the ground has fallen to zero; nothing jumps.
///
/// One guard serves both ways: the force at rest, turned round, and the force itself where that is smaller. Approaching,
/// damping pushes, so that contact begins with the gap; leaving, it pulls, so that contact ends before the gap opens, and
/// may begin again from there.
fn yields(
    g: &mut Graph,
    events: &mut Vec<EventEquations>,
    contact: &Contact,
    (touchdown, free, held): (usize, usize, usize),
    (force, at_rest): (Id, Id),
) {
    let (a, b) = (g.neg(force), g.neg(at_rest));
    let guard = g.two(Fun2::Max, a, b);
    let reset: Vec<Id> = (0..events[touchdown].reset.len()).map(|i| g.leaf(Symbol::State(i))).collect();
    events[touchdown].guard = guard;
    events[touchdown].direction = Direction::Falling;
    events[touchdown].reset.clone_from(&reset);
    let name = events.iter().find(|e| e.from == held && e.to == free).map(|e| e.name.clone());
    events.retain(|e| !(e.from == held && e.to == free));
    let name = name.unwrap_or_else(|| format!("{} lifts off", contact.gap));
    events.push(EventEquations { name, from: held, to: free, guard, direction: Direction::Rising, when: None, reset });
}
