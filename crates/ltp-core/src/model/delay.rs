//! Inputs that are seen late, and what is done to outputs after they were computed.
//!
//! A delay is exact: the delayed input is the input's own course, looked at earlier. In the graph it is one more input with
//! its rate beside it (channels `nu + 2k` and `nu + 2k + 1`), and its derivative by a parameter of the delay is minus that
//! rate times the derivative of the delay. No filter stands in for it, so that nothing becomes stiff as the delay vanishes.

use super::document::Before;
use super::graph::{Graph, Id, Symbol};

/// What an input did before the record, as expressions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PastEquation {
    /// It was zero.
    Zero,
    /// It had its first value.
    Hold,
    /// It repeated, with this period.
    Periodic(Id),
}

/// An input that is seen late.
#[derive(Clone, Copy, Debug)]
pub struct DelayEquation {
    /// Input.
    pub input: usize,
    /// Delay, s, of parameters only.
    pub delay: Id,
    /// What it did before the record.
    pub past: PastEquation,
}

/// What an operator does to an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OperatorKind {
    /// The output of earlier.
    Delay,
    /// Follows the output only where it leaves a gap around what was shown last.
    Play,
}

/// An operator on an output, in the order of attachment.
#[derive(Clone, Copy, Debug)]
pub struct OperatorEquation {
    /// Output.
    pub output: usize,
    /// What it does.
    pub kind: OperatorKind,
    /// Delay, s, or gap in the unit of the output; of parameters only.
    pub value: Id,
}

/// An expression as it was `delay` seconds ago: of time, inputs and parameters, since a state's past is not at hand.
pub(super) fn late(g: &mut Graph, value: Id, delay: Id) -> Result<Id, String> {
    let mut new = Vec::new();
    for symbol in g.leaves(&[value]) {
        let id = match symbol {
            Symbol::Time => {
                let now = g.leaf(Symbol::Time);
                g.sub(now, delay)
            }
            Symbol::Input(channel) => g.late_input(channel, delay),
            Symbol::Parameter(_) => continue,
            Symbol::State(_) | Symbol::Port(_) | Symbol::Dry(_) => {
                return Err(
                    "what stands there depends on the motion, and only what is known beforehand can be delayed: \
                            attach the delay to the input itself, and before any lag"
                        .into(),
                );
            }
        };
        new.push((symbol, id));
    }
    Ok(g.substitute(&[value], |s| new.iter().find(|(old, _)| *old == s).map(|(_, id)| *id))[0])
}

impl PastEquation {
    /// What the document says; `period` reads an expression of parameters.
    pub(super) fn of<E>(before: Option<&Before>, period: impl FnOnce(&str) -> Result<Id, E>) -> Result<Self, E> {
        Ok(match before {
            None | Some(Before::Plain(super::document::Rest::Zero)) => Self::Zero,
            Some(Before::Plain(super::document::Rest::Hold)) => Self::Hold,
            Some(Before::Periodic { periodic }) => Self::Periodic(period(periodic)?),
        })
    }
}
