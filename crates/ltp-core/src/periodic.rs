//! Level 2: linear time-periodic systems and their harmonic transfer functions.
//!
//! The noun both doors lead to is [`Htf`]: `linearize` makes it exactly from a model, `identify` estimates it from
//! recordings.

pub mod htf;

pub use htf::Htf;
