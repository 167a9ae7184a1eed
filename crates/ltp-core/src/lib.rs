//! **ltp** explains periodic and hybrid mechanical systems from their recordings.
//!
//! Modules in flow order: equations as data become a [`model::Model`]; [`simulate`] turns it into a trajectory with exact
//! sensitivities through its events; [`signal::Recording`] is what was measured; [`diagnose`] is the only room with doors
//! to both sides. [`mod@cycle`] and [`mod@linearize`] lead from a model to a linear periodic system, [`identify`] from a recording to
//! its transfer functions; [`feedforward`], [`control`] and [`closed_loop`] follow a motion and say how well.

pub mod closed_loop;
pub mod conceal;
pub mod control;
pub mod cycle;
pub mod diagnose;
pub mod error;
pub mod feedforward;
pub mod identify;
pub mod linearize;
pub mod model;
pub mod numeric;
pub mod periodic;
pub mod signal;
pub mod simulate;

pub use error::{Error, Result};
