//! How a simulation ended, and what happened on the way: endings are results, not errors.

use serde::Serialize;

/// Why a simulation ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "reason")]
pub enum Stop {
    /// It reached the end.
    Finished,
    /// Events accumulate at a finite time.
    Zeno {
        /// Time of the last event, s.
        time: f64,
        /// Extrapolated accumulation time, s.
        accumulation: f64,
        /// Mode.
        mode: String,
        /// Name of the event.
        event: String,
    },
    /// Events follow each other without time passing.
    Chattering {
        /// Time, s.
        time: f64,
        /// Mode.
        mode: String,
        /// Name of the event.
        event: String,
    },
    /// A guard is touched without being crossed: what follows depends on rounding.
    Grazing {
        /// Time, s.
        time: f64,
        /// Mode.
        mode: String,
        /// Name of the event.
        event: String,
    },
    /// A state became infinite or not a number.
    Escape {
        /// Time of the last finite state, s.
        time: f64,
        /// Mode.
        mode: String,
        /// Name of the state.
        state: String,
    },
    /// More steps than allowed.
    StepLimit {
        /// Time reached, s.
        time: f64,
        /// Mode.
        mode: String,
        /// The limit.
        limit: u64,
    },
}

impl Stop {
    /// What happened and what to do, in a sentence.
    pub fn sentence(&self) -> String {
        match self {
            Self::Finished => "reached the end".into(),
            Self::Zeno { time, accumulation, mode, event } => format!(
                "`{event}` fires ever faster in mode `{mode}` at t = {time:.9} s and accumulates at {accumulation:.9} s \
                 (Zeno); add a mode for what comes after, such as resting contact"
            ),
            Self::Chattering { time, mode, event } => format!(
                "`{event}` fires again and again at t = {time:.9} s in mode `{mode}` without time passing; check that its \
                 reset leaves the guard, or merge the two modes it switches between"
            ),
            Self::Grazing { time, mode, event } => format!(
                "`{event}` is touched but not crossed at t = {time:.9} s in mode `{mode}` (grazing); what follows depends \
                 on rounding: move the initial state or the input a little"
            ),
            Self::Escape { time, mode, state } => format!(
                "state `{state}` left the finite numbers after t = {time:.9} s in mode `{mode}`; check signs of the \
                 equations or take a smaller step"
            ),
            Self::StepLimit { time, mode, limit } => format!(
                "stopped after {limit} steps at t = {time:.9} s in mode `{mode}`; take a larger step or raise the limit"
            ),
        }
    }

    /// Whether the simulation reached its end.
    pub fn is_finished(&self) -> bool {
        *self == Self::Finished
    }
}

/// An event that fired.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Event {
    /// Name of the transition.
    pub name: String,
    /// Time, s.
    pub time: f64,
    /// Mode before.
    pub mode_before: usize,
    /// Mode after.
    pub mode_after: usize,
}

/// What a simulation cost and how accurate its steps were.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Stats {
    /// Accepted steps.
    pub steps: u64,
    /// Evaluations of the flow.
    pub evaluations: u64,
    /// Events that fired.
    pub events: u64,
    /// Sampled updates.
    pub ticks: u64,
    /// Bisections on the dense output.
    pub bisections: u64,
    /// Steps repeated to polish an event time.
    pub polishes: u64,
    /// Largest embedded error estimate of a step, relative to the largest size of its state.
    pub error_estimate: f64,
}
