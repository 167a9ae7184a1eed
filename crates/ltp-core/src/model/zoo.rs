//! The zoo: reference problems that tests, benches, examples and docs share, each with its closed form or reference in
//! the header of its document.

use super::Model;
use crate::error::{Error, Result, nearest};

macro_rules! zoo {
    ($($name:literal),* $(,)?) => {
        /// Name and document of every model in the zoo.
        pub const ZOO: &[(&str, &str)] = &[$(($name, include_str!(concat!("../../zoo/", $name, ".toml")))),*];
    };
}

zoo! {
    "bouncing_ball", "cart_pendulum", "drive", "duffing", "hopper", "mathieu", "pendulum", "three_mode_hopper",
    "two_mass", "van_der_pol",
}

/// Document of a zoo model.
///
/// # Errors
/// [`Error::UnknownName`] with the nearest names.
pub fn zoo_text(name: &str) -> Result<&'static str> {
    ZOO.iter().find(|(n, _)| *n == name).map(|(_, text)| *text).ok_or_else(|| Error::UnknownName {
        kind: "model".into(),
        name: name.into(),
        nearest: nearest(name, ZOO.iter().map(|(n, _)| *n)),
        context: "in the zoo".into(),
    })
}

/// A zoo model.
///
/// # Errors
/// [`Error::UnknownName`] with the nearest names.
pub fn zoo(name: &str) -> Result<Model> {
    Model::from_toml(zoo_text(name)?, &format!("zoo:{name}"))
}
