//! Periodic orbits, their linearization and exact harmonic transfer functions: closed forms, two routes, refusals.

use ltp_core::cycle::{Options, cycle, survey};
use ltp_core::linearize::linearize;
use ltp_core::model::{Backend, Model, System, zoo};

fn compiled(model: &Model) -> ltp_core::model::Compiled {
    model.compile_for(Vec::new(), Backend::Native)
}

/// Uyanik et al. 2015 by closed-form flows and Newton's method (the printed liftoff guard).
#[test]
fn the_hopper_has_the_published_orbit() {
    let system = compiled(&zoo("hopper").unwrap());
    let orbit = cycle(&system, system.parameters(), &Options::default()).unwrap();
    println!("{:?} {:?} {} {}", orbit.events, orbit.multipliers, orbit.residual, orbit.integration_error);
    let lin = linearize(&system, system.parameters(), &orbit).unwrap();
    println!("{:?} {}", lin.multipliers(), lin.segments().len());
    let t = std::time::Instant::now();
    let omega: Vec<f64> = (0..200).map(|i| i as f64 * 0.1).collect();
    let htf = lin.htf(&omega, 20).unwrap();
    println!("{:?}", t.elapsed());
    for k in -3..=3 {
        println!("{k} {:e} {:e}", htf.value(k, 0, 0, 0) * 6500.0, htf.value(k, 42, 0, 0));
    }
    let t = std::time::Instant::now();
    let s = survey(&system, system.parameters(), &orbit, 24, 1).unwrap();
    println!(
        "{:?} returned {} radius {} others {:?} lost {:?}",
        t.elapsed(),
        s.returned,
        s.radius,
        s.others.iter().map(|(o, n)| (n, o.multipliers.clone(), o.events.len())).collect::<Vec<_>>(),
        s.lost
    );
}
#[test]
fn van_der_pol() {
    let system = compiled(&zoo("van_der_pol").unwrap());
    let orbit = cycle(&system, system.parameters(), &Options::default()).unwrap();
    println!(
        "{} {:?} {} {} {:?}",
        orbit.period, orbit.multipliers, orbit.residual, orbit.integration_error, orbit.warnings
    );
    let lin = linearize(&system, system.parameters(), &orbit).unwrap();
    println!("{:?} {}", lin.multipliers(), lin.segments().len());
    for n in ["mathieu", "duffing", "three_mode_hopper", "bouncing_ball"] {
        let system = compiled(&zoo(n).unwrap());
        match cycle(&system, system.parameters(), &Options::default()) {
            Ok(orbit) => {
                println!(
                    "{n} {} {:?} {} {} {:?}",
                    orbit.period, orbit.multipliers, orbit.residual, orbit.integration_error, orbit.warnings
                );
                let lin = linearize(&system, system.parameters(), &orbit).unwrap();
                println!("{:?} {}", lin.multipliers(), lin.segments().len());
            }
            Err(e) => println!("{n} {e}"),
        }
    }
}
