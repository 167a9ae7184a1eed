//! Level 2: what is put in, what was measured, and how it is compared.
//!
//! The noun is [`Recording`]; [`sampling`] decides what its time column means (uniform, with samples missing,
//! jittered), [`metrics`] says how far a prediction is from it, [`excitation`] holds the inputs that experiments give.

pub mod excitation;
pub mod metrics;
pub mod recording;
pub mod sampling;

pub use recording::Recording;
