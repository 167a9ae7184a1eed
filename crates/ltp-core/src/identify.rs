//! Level 3: harmonic transfer functions from recordings, without any model.
//!
//! Machines without a clock have only their events to tell the time: [`phase`] makes a phase of them, [`orbit`] averages
//! over cycles, [`arx`] estimates a discrete linear time-periodic model and [`held_out`] says what it is worth, and
//! [`section`] estimates the map from one cycle to the next.

pub mod arx;
pub mod held_out;
pub mod orbit;
pub mod phase;
pub mod section;

#[cfg(test)]
mod planted;
