//! Level 2: linear time-periodic systems and their harmonic transfer functions.
//!
//! The noun both doors lead to is [`Htf`]: `linearize` makes it exactly from a model, `identify` estimates it from
//! recordings. [`LtpSystem`] is the state space it comes from, jumps included. Two routes lead from the one to the other: the
//! periodic steady state ([`LtpSystem::htf`]), exact also through jumps, and the harmonic state space
//! ([`LtpSystem::lifted_htf`]) of smooth systems, truncated.

#[cfg(test)]
mod cart_pendulum_tests;
mod closed;
mod exact;
mod exponents;
mod floquet;
mod harmonic;
pub mod htf;
mod modes;
mod predict;
mod propagate;
mod pumping;
mod select;
mod simulate;
mod smooth;
pub mod system;
mod transverse;
#[cfg(test)]
mod transverse_tests;

pub use floquet::Floquet;
pub use htf::Htf;
pub use modes::{CONVERGED, LiftedMode};
pub use predict::Prediction;
pub use system::{Entry, Jump, LtpSystem, Segment, Size};
pub use transverse::Transverse;
