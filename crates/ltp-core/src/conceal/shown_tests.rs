//! What nominal parameters and simpler laws take up of a change, where it is known what they must.

use super::Planted;
use super::machine::Machine;
use super::setups::{Setup, Take};
use super::shown::{IMITATED, Shown, TRAIN, simpler};
use super::truth_tests::planted;
use crate::model::zoo;
use crate::numeric::rng::SplitMix64;

/// Share of the change (rms) that the nominal parameters leave; and the sums of squares, in units of the change, that they leave
/// alone and together with the simpler law.
fn left(system: &str, effect: Planted) -> (f64, f64, Option<f64>) {
    let nominal = zoo(system).unwrap();
    let setup = Setup::new(system, false, &mut SplitMix64::new(5)).unwrap();
    let bare = Machine::new(&nominal, &[]).unwrap();
    let plain: Vec<Take> = (0..TRAIN).map(|r| setup.take(&nominal, &bare, r).unwrap()).collect();
    let shown = Shown::new(&setup, &nominal, std::slice::from_ref(&effect), &plain, TRAIN).unwrap();
    let ny = nominal.outputs().len();
    let size: Vec<f64> = (0..ny).map(|j| shown.change(j, ny, &plain).0).collect();
    let unlike = |rival| shown.unlike(&setup, &nominal, rival, &size, 6).unwrap();
    let (share, _, alone) = unlike(None);
    (share, alone, simpler(&effect, &setup, &nominal).map(|rival| unlike(Some(rival)).2))
}

#[test]
fn a_mass_beside_a_free_one_and_a_spring_beside_a_free_one_are_imitated_however_large() {
    // More than the cart weighs, where a step of all parameters at once leads far astray; a fifth of the shaft's stiffness,
    // which moves its resonance by its own width.
    for (system, name, at, parameter, value) in [
        ("cart_pendulum", "added_mass", "cart", "mass", 0.65),
        ("two_mass", "linear_stiffness", "shaft", "stiffness", 7.9),
    ] {
        let share = left(system, planted(name, at, &[(parameter, value)])).0;
        assert!(share < IMITATED, "{name} at {at}: {share}");
    }
    let share = left("cart_pendulum", planted("quadratic_drag", "cart", &[("drag", 2.0)])).0;
    assert!(share > 10.0 * IMITATED, "a drag is no parameter of the cart: {share}");
}

#[test]
fn a_short_lag_is_a_delay_but_for_what_was_before_the_record() {
    // A thousandth of the hopper's period: a lag and a delay differ by a thousandth of what either does, and by all of it at
    // the first sample, which shows a height from before the record.
    let (_, alone, beside) = left("hopper", planted("output_lag", "h", &[("time_constant", 2e-4)]));
    assert!(beside.unwrap() < 1e-3 * alone, "{alone} {beside:?}");
}
