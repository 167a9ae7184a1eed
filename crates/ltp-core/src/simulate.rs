//! From a system to a [`Trajectory`]: fixed-step Dormand-Prince 5(4) through events, with exact sensitivities.
//!
//! Read in order: [`crate::numeric::tableau`] (the method as data), [`inputs`], `step` (one step and its derivative), `locate` (when a
//! guard crosses), `saltation` (what an event does to derivatives), [`engine`] (the loop), [`stop`] (how it ends).

pub mod engine;
pub mod inputs;
mod locate;
mod saltation;
mod step;
pub mod stop;
pub mod trajectory;

pub use inputs::{Hold, Inputs};
pub use stop::{Event, Stats, Stop};
pub use trajectory::{Plan, Trajectory, simulate};
