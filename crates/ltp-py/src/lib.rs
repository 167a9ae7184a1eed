//! The extension `ltp._ltp`: the core as Python sees it. Translation only; `python/ltp/_ltp.pyi` says what is in it.
//!
//! Read in order: [`error`] (how failures arrive), [`door`] (how work is done without holding the interpreter),
//! [`array`] (how numbers cross), [`interrupt`] (how a simulation is stopped), then the nouns [`model`], [`recording`] and
//! [`trajectory`], the verbs [`simulate`], [`diagnose`], [`isolability`], [`harmonic`] and [`conceal`], what is read from unclocked recordings ([`unclocked`],
//! [`arx`] and [`section`]), what experiments put in ([`signals`]), and
//! [`kernels`] for benchmarks.

mod array;
mod arx;
mod closed_loop;
mod conceal;
mod control;
mod cycle;
mod diagnose;
mod door;
mod error;
mod feedforward;
mod harmonic;
mod htf;
mod identify;
mod interrupt;
mod isolability;
mod kernels;
mod linearize;
mod model;
mod periodic;
mod recording;
mod section;
mod signals;
mod simulate;
mod trajectory;
mod unclocked;

/// The compiled half of the package `ltp`; use the names of `ltp` instead.
#[pyo3::pymodule(gil_used = false)]
mod _ltp {
    #[pymodule_export]
    use crate::arx::{HeldOut, PeriodicArx, identify_arx};
    #[pymodule_export]
    use crate::closed_loop::{SimulationCost, certify, close, track};
    #[pymodule_export]
    use crate::conceal::{case_choices, conceal, draw_case};
    #[pymodule_export]
    use crate::control::{Feedback, Objective, closed_loop_eigenvalues, harmonic_balance, periodic_lqr};
    #[pymodule_export]
    use crate::cycle::{LimitCycle, cycle};
    #[pymodule_export]
    use crate::diagnose::{Diagnosis, diagnose};
    #[pymodule_export]
    use crate::error::{ConvergenceError, InputError};
    #[pymodule_export]
    use crate::feedforward::{Reference, feedforward};
    #[pymodule_export]
    use crate::harmonic::harmonic_map;
    #[pymodule_export]
    use crate::htf::Htf;
    #[pymodule_export]
    use crate::identify::{identify, rests};
    #[pymodule_export]
    use crate::isolability::isolability;
    #[pymodule_export]
    use crate::kernels::{NormalBand, smooth};
    #[pymodule_export]
    use crate::linearize::{LtpSystem, linearize, linearize_along};
    #[pymodule_export]
    use crate::model::{Model, effect_names, effect_text, unit_factor, zoo_names, zoo_text};
    #[pymodule_export]
    use crate::periodic::{Floquet, Transverse};
    #[pymodule_export]
    use crate::recording::Recording;
    #[pymodule_export]
    use crate::section::identify_map;
    #[pymodule_export]
    use crate::signals::{
        ExperimentPlan, Multisine, add_noise, chirp, e_rms, multisine_lines, noise, phase_shifted_chirps, relative_rms,
        rms_error, settling_periods, sine, step,
    };
    #[pymodule_export]
    use crate::simulate::simulate;
    #[pymodule_export]
    use crate::trajectory::Trajectory;
    #[pymodule_export]
    use crate::unclocked::{Phase, cycle_average, phase_from_events, switch_events};
}
