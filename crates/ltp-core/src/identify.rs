//! Level 3: harmonic transfer functions from recordings, without any model.

pub mod arx;
pub mod held_out;
pub mod orbit;
pub mod phase;
pub mod section;
