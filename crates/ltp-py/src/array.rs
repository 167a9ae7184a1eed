//! The only file that knows strides: numpy arrays in as owned copies, flat row-major results out as numpy arrays.
//!
//! Inputs are copied before the interpreter is released, because another Python thread may write to an array while the
//! core reads it. Any layout is accepted (C or Fortran order, slices, reversed, unaligned); dtype and number of
//! dimensions are not guessed at: the Python ring converts. Whether values are finite is the core's question.

use std::fmt::Display;

use ltp_core::error::Error;
use ltp_core::numeric::Complex;
use numpy::ndarray::{Array, ArrayView2, Axis, Dimension, Ix1, Ix2, Ix4, concatenate};
use numpy::{Element, IntoPyArray, PyArray, PyArray2, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyMapping;

use crate::error::{Failure, InputError, from_panic};

/// A flat row-major matrix and its number of columns.
pub type Flat<'a> = (&'a [f64], usize);

/// A 1-D float64 array; `argument` is what errors call it.
pub fn vector(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    Ok(owned::<f64, Ix1>(argument, "1-D", value)?.to_vec())
}

/// The columns of a 2-D float64 array.
pub fn columns(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<Vec<f64>>> {
    Ok(owned::<f64, Ix2>(argument, "2-D", value)?.columns().into_iter().map(|column| column.to_vec()).collect())
}

/// A 2-D float64 array as a flat row-major matrix, with its shape.
pub fn rows(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<(Vec<f64>, [usize; 2])> {
    let array = owned::<f64, Ix2>(argument, "2-D", value)?;
    Ok((array.iter().copied().collect(), array.dim().into()))
}

/// A 4-D float64 array, flat and row-major, with its shape.
pub fn block(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<(Vec<f64>, [usize; 4])> {
    let array = owned::<f64, Ix4>(argument, "4-D", value)?;
    Ok((array.iter().copied().collect(), array.dim().into()))
}

/// A 4-D complex128 array, flat and row-major, with its shape.
pub fn complex_block(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<(Vec<Complex>, [usize; 4])> {
    let array = owned::<Complex, Ix4>(argument, "4-D", value)?;
    Ok((array.iter().copied().collect(), array.dim().into()))
}

/// Numbers by name, in the order of the mapping.
pub fn numbers(argument: &str, values: &Bound<'_, PyMapping>) -> PyResult<Vec<(String, f64)>> {
    let number = |(name, value): (String, Bound<'_, PyAny>)| match value.extract() {
        Ok(number) => Ok((name, number)),
        Err(_) => Err(InputError::new_err(format!("{argument}: `{name}` is {value}, expected a number; correct it"))),
    };
    values.items()?.extract::<Vec<_>>()?.into_iter().map(number).collect()
}

/// A flat row-major matrix as a C-ordered array `(rows, width)`, without a copy.
pub fn matrix(py: Python<'_>, values: Vec<f64>, rows: usize, width: usize) -> PyResult<Bound<'_, PyArray2<f64>>> {
    values.into_pyarray(py).reshape([rows, width])
}

/// Chosen columns of two matrices side by side, those of `right` counted on from those of `left`.
pub fn pick<'py>(
    py: Python<'py>,
    rows: usize,
    left: Flat<'_>,
    right: Flat<'_>,
    chosen: &[usize],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let view = |(values, width)| ArrayView2::from_shape((rows, width), values).map_err(mistake);
    let both = concatenate(Axis(1), &[view(left)?, view(right)?]).map_err(mistake)?;
    Ok(both.select(Axis(1), chosen).into_pyarray(py))
}

/// Makes an array unwritable: it shows what a Rust value holds, and a change would not reach that value.
pub fn freeze<T: Element, D: Dimension>(array: Bound<'_, PyArray<T, D>>) -> Py<PyArray<T, D>> {
    array.readwrite().make_nonwriteable();
    array.unbind()
}

/// What Python calls the elements of an array.
trait Named: Element + Clone {
    const NAME: &'static str;
    /// What `dtype=` is set to for a conversion.
    const KIND: &'static str;
}

impl Named for f64 {
    const NAME: &'static str = "float64";
    const KIND: &'static str = "float";
}

impl Named for Complex {
    const NAME: &'static str = "complex128";
    const KIND: &'static str = "complex";
}

fn owned<T: Named, D: Dimension>(argument: &str, dimensions: &str, value: &Bound<'_, PyAny>) -> PyResult<Array<T, D>> {
    let Ok(array) = value.cast::<PyArray<T, D>>() else {
        let found = match value.cast::<PyUntypedArray>() {
            Ok(array) => format!("an array of {} with shape {}", array.dtype(), array.getattr("shape")?),
            Err(_) => format!("a {}", value.get_type().name()?),
        };
        return Err(InputError::new_err(format!(
            "{argument}: found {found}, expected a {dimensions} array of {}; convert it with \
             np.asarray(..., dtype={}) and check its shape",
            T::NAME,
            T::KIND,
        )));
    };
    // Fields of packed records lie between the addresses that Rust may read a number from; numpy copies them out.
    let aligned = if array.is_aligned() { array.clone() } else { array.call_method0("copy")?.cast_into()? };
    Ok(aligned.readonly().as_array().to_owned())
}

/// Refuses two lengths that must be the same and are not.
pub fn same(what: &str, expected: usize, found: usize) -> PyResult<()> {
    if expected == found {
        return Ok(());
    }
    Err(Failure::from(Error::Shape { what: what.into(), expected, found }).into())
}

fn mistake(error: impl Display) -> PyErr {
    from_panic(&error.to_string())
}
