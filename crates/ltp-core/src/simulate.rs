//! From a system to a [`Trajectory`]: fixed-step Dormand-Prince 5(4) through events, with exact sensitivities.
//!
//! Read in order: [`crate::numeric::tableau`] (the method as data), [`inputs`] and `late` (inputs now and earlier), `step` (one step and its derivative), `locate` (when a
//! guard crosses), `saltation` (what an event does to derivatives), [`engine`] (the loop), [`sensor`] (late and loose
//! sensors), [`stop`] (how it ends).

pub mod engine;
pub mod inputs;
mod late;
mod locate;
mod saltation;
pub mod sensor;
mod step;
pub mod stop;
pub mod trajectory;

pub use inputs::{Hold, Inputs};
pub use stop::{Event, Stats, Stop};
pub use trajectory::{Plan, STEPS_PER_TIME, Trajectory, simulate};
