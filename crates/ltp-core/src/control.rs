//! Level 3: state feedback for linear time-periodic systems, `u = -K(t) x`.
//!
//! The noun is [`Feedback`]. Two ways lead to it: [`harmonic_balance`] moves the eigenvalues of the lifted closed loop, or its
//! exact Floquet exponents, by a constant gain or by one with a few harmonics ([`law`]), under constraints; [`periodic_lqr`]
//! solves the periodic Riccati equation. What is moved is a [`Spectrum`] of modes, which [`Lifted`] and [`Exact`] find with
//! derivatives. Transverse designs need nothing of their own: a transverse system is an
//! [`LtpSystem`](crate::periodic::LtpSystem).

mod constraint;
mod design;
#[cfg(test)]
mod design_tests;
mod eigenvalues;
mod exact;
mod feedback;
pub mod law;
mod lifted;
#[cfg(test)]
mod lifted_tests;
mod redheffer;
mod riccati;
mod spectrum;
#[cfg(test)]
mod testing;

pub use constraint::{Damping, Quadratic};
pub use design::{Measure, Options, Search, harmonic_balance};
pub use eigenvalues::lifted_eigenvalues;
pub use exact::{Exact, STEPS};
pub use feedback::Feedback;
pub use law::Law;
pub use lifted::Lifted;
pub use riccati::{Weights, periodic_lqr};
pub use spectrum::{Mode, Objective, Spectrum};
