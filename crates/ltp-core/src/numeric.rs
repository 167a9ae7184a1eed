//! Level 1: numerical kernels that know no physics.
//!
//! Least squares is the centre: [`rows`] reduces tall problems to a triangle, [`lsq`] minimises nonlinear ones with
//! bounds. Around it stand what noisy records need ([`spectrum`], [`whiten`], [`stats`], [`regression`]),
//! interpolation ([`spline`]), bracketed roots ([`root`]), a Runge-Kutta method as data ([`tableau`]) and a reproducible
//! random sequence ([`rng`]). [`fft`] decides how Fourier transforms are scaled, [`chirp_z`] takes their lines at any other
//! spacing; [`smoother`] fits unknowns that bend little along an axis, [`penalised`] does the same through one [`banded`]
//! system; [`fourier_series`] is a periodic signal, [`gauss`] carries collocation, [`eigen`] finds eigenvalues,
//! [`moving_eigen`] those that an optimiser moves; [`matrix_function`] is the logarithm and
//! the exponential of a matrix; [`minimise`] is for functions with kinks and several valleys; [`divisor`] is
//! what whole numbers share.

pub mod banded;
pub mod chirp_z;
pub mod divisor;
pub mod eigen;
pub mod fft;
pub mod folded;
pub mod fourier_series;
pub mod gauss;
pub mod lsq;
pub mod matrix_function;
pub mod minimise;
pub mod moving_eigen;
pub mod penalised;
pub mod quartic;
pub mod regression;
pub mod rng;
pub mod root;
pub mod rows;
pub mod smoother;
pub mod spectrum;
pub mod spline;
pub mod stats;
pub mod tableau;
pub mod whiten;

/// Complex numbers, as the Fourier transforms and the linear algebra of this crate use them.
pub type Complex = rustfft::num_complex::Complex<f64>;
