//! How failures arrive in Python: the two exceptions, and what becomes of a panic.

use std::any::Any;

use pyo3::PyErr;
use pyo3::create_exception;
use pyo3::exceptions::{PyRuntimeError, PyValueError};

create_exception!(
    ltp,
    InputError,
    PyValueError,
    "An input that cannot be right: the message names its place, prints what was found and expected, and says what to do."
);
create_exception!(
    ltp,
    ConvergenceError,
    PyRuntimeError,
    "A method could not reach its goal, and nothing partial is meaningful; the message says what to try."
);

/// An error of the core on its way to Python.
pub struct Failure(ltp_core::Error);

impl From<ltp_core::Error> for Failure {
    fn from(error: ltp_core::Error) -> Self {
        Self(error)
    }
}

impl From<Failure> for PyErr {
    fn from(Failure(error): Failure) -> Self {
        let text = error.to_string();
        if error.is_input() { InputError::new_err(text) } else { ConvergenceError::new_err(text) }
    }
}

/// Our own mistake, as an exception that `except Exception` catches: pyo3's own `PanicException` would pass through it.
pub fn from_panic(payload: &(dyn Any + Send)) -> PyErr {
    let what = payload.downcast_ref::<String>().map(String::as_str).or_else(|| payload.downcast_ref::<&str>().copied());
    PyRuntimeError::new_err(format!(
        "ltp made a mistake of its own ({}); please report it at {}/issues with the model, the call and the lines that \
         were printed above this one",
        what.unwrap_or("without a message"),
        env!("CARGO_PKG_REPOSITORY")
    ))
}
