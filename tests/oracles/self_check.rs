//! Checks of the oracles themselves: published digits, conserved quantities, and the residual of each equation of motion.
//!
//! Owns: nothing but tests. Whoever changes `closed_forms.rs` is told here, before a simulator is blamed.

#[path = "closed_forms.rs"]
mod closed_forms;

use closed_forms::*;

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "found {found:.16}, expected {expected:.16} within {tolerance:e}");
}

/// Derivative of `f` at `t` by central differences of fourth order.
fn slope(f: impl Fn(f64) -> f64, t: f64, h: f64) -> f64 {
    (8.0 * (f(t + h) - f(t - h)) - (f(t + 2.0 * h) - f(t - 2.0 * h))) / (12.0 * h)
}

#[test]
fn three_mode_hopper_has_the_published_digits() {
    let hop = ThreeModeHopper::default().at(100.0);
    close(hop.y, 1.056924001461816, 2e-12);
    close(hop.v, -6.144277532719692, 1e-11);
    assert_eq!((hop.events.len(), hop.mode), (219, "flight"));
    close(hop.events[218].1, 98.7462181395207, 1e-12);
}

#[test]
fn three_mode_hopper_sensitivity_has_the_published_digits() {
    let found = ThreeModeHopper::default().sensitivity(10.0);
    let expected = [[-10.854916, -0.0230683], [42.037483, 0.1096558]];
    for row in 0..2 {
        for column in 0..2 {
            close(found[row][column] / expected[row][column], 1.0, 2e-6);
        }
    }
}

#[test]
fn three_mode_hopper_obeys_each_mode() {
    let model = ThreeModeHopper::default();
    let mut seen = [false; 3];
    for i in 0..400 {
        let t = 0.05 + 0.0123 * f64::from(i);
        let (before, hop, after) = (model.at(t - 2e-4), model.at(t), model.at(t + 2e-4));
        if before.events.len() != after.events.len() {
            continue;
        }
        let (leg, number) = match hop.mode {
            "flight" => (0.0, 0),
            "compression" => (-model.k * (hop.y - model.l0) - model.c * hop.v, 1),
            _ => (-model.k * (hop.y - model.l1) - model.c * hop.v, 2),
        };
        seen[number] = true;
        close(slope(|s| model.at(s).v, t, 1e-4), leg / model.m - model.g, 1e-7);
        close(slope(|s| model.at(s).y, t, 1e-4), hop.v, 1e-8);
    }
    assert_eq!(seen, [true; 3]);
}

#[test]
fn bouncing_ball_meets_the_floor_at_its_impacts() {
    let ball = BouncingBall { g: 9.81, e: 0.8, y0: 1.0 };
    close(ball.impact(1), 0.4515236409857309, 1e-15);
    close(ball.impact(2), 1.1739614665629006, 1e-14);
    close(ball.zeno(), 4.063712768871578, 1e-14);
    for n in 1..20 {
        let t = ball.impact(n);
        close(ball.at(t - 1e-12).0, 0.0, 1e-10);
        close(ball.at(t + 1e-12).1 / ball.at(t - 1e-12).1, -ball.e, 1e-9);
        assert!(t < ball.zeno());
    }
    assert_eq!(ball.at(5.0), (0.0, 0.0));
}

#[test]
fn jacobi_functions_have_their_limits_and_tabulated_values() {
    for u in [-3.0, 0.1, 1.0, 7.0] {
        let (sn, cn, dn) = jacobi(u, 0.0);
        close(sn, f64::sin(u), 1e-15);
        close(cn, f64::cos(u), 1e-15);
        close(dn, 1.0, 0.0);
    }
    // Abramowitz and Stegun, table 17.1: K at parameter kappa^2 = 0.5
    close(elliptic_k(0.5_f64.sqrt()), 1.854074677301372, 1e-14);
    let (sn, cn, dn) = jacobi(elliptic_k(0.7), 0.7);
    close(sn, 1.0, 1e-15);
    close(cn, 0.0, 1e-14);
    close(dn, (1.0 - 0.49_f64).sqrt(), 1e-14);
}

#[test]
fn pendulum_keeps_its_energy_and_its_period() {
    let (g, l, theta_0) = (9.81, 0.3, 2.0);
    let period = pendulum_period(g, l, theta_0);
    close(period, 1.460157650788254, 1e-13);
    for i in 0..50 {
        let t = 0.1 * f64::from(i);
        let (theta, omega) = pendulum(g, l, theta_0, t);
        close(0.5 * l * omega * omega - g * theta.cos(), -g * theta_0.cos(), 1e-12);
        close(slope(|s| pendulum(g, l, theta_0, s).0, t, 1e-3), omega, 1e-8);
        close(pendulum(g, l, theta_0, t + period).0, theta, 1e-12);
    }
    close(pendulum(g, l, -0.4, 0.0).0, -0.4, 1e-14);
}

#[test]
fn duffing_keeps_its_energy_and_its_period() {
    let (m, k, k_3, x_0) = (1.0, 1.0, 0.5, 1.0);
    let period = duffing_period(m, k, k_3, x_0);
    close(period, 5.366659355191768, 1e-13);
    let energy = |x: f64, v: f64| 0.5 * m * v * v + 0.5 * k * x * x + 0.25 * k_3 * x.powi(4);
    for i in 0..50 {
        let t = 0.3 * f64::from(i);
        let (x, v) = duffing(m, k, k_3, x_0, t);
        close(energy(x, v), energy(x_0, 0.0), 1e-13);
        close(slope(|s| duffing(m, k, k_3, x_0, s).0, t, 1e-3), v, 1e-10);
        close(duffing(m, k, k_3, x_0, t + period).0, x, 1e-12);
    }
}

#[test]
fn drive_step_has_its_textbook_form_and_its_frictionless_limit() {
    let (m, b, force) = (95.1, 203.5, 100.0);
    let (q, v) = drive_step(m, b, force, 0.0, 0.0, 1.0);
    let decay = f64::exp(-b / m);
    close(v, force / b * (1.0 - decay), 1e-15);
    close(q, force / b * (1.0 - m / b * (1.0 - decay)), 1e-15);
    let (q, v) = drive_step(2.0, 0.0, 3.0, 0.1, 0.2, 1.5);
    close(q, 0.1 + 0.2 * 1.5 + 0.5 * 1.5 * 1.5 * 1.5, 1e-15);
    close(v, 0.2 + 1.5 * 1.5, 1e-15);
    // the two branches of phi_2 meet at b t/m = 0.5
    let near = |x: f64| drive_step(1.0, x, 1.0, 0.0, 0.0, 1.0).0;
    close(near(0.5 - 1e-12), near(0.5 + 1e-12), 1e-12);
}

#[test]
fn two_mass_obeys_both_equations() {
    let (j_m, j_l, k, c, tau) = (0.016, 0.004, 40.0, 0.008, 1.0);
    let at = |t: f64| two_mass_step(j_m, j_l, k, c, tau, t);
    for i in 1..40 {
        let t = 0.005 * f64::from(i);
        let s = at(t);
        let shaft = k * (s[0] - s[1]) + c * (s[2] - s[3]);
        close(j_m * slope(|t| at(t)[2], t, 1e-5), tau - shaft, 1e-8);
        close(j_l * slope(|t| at(t)[3], t, 1e-5), shaft, 1e-8);
        close(slope(|t| at(t)[0], t, 1e-5), s[2], 1e-8);
        close(slope(|t| at(t)[1], t, 1e-5), s[3], 1e-8);
    }
    close(at(0.1)[0], 0.25084818, 1e-8);
    close(at(0.1)[1], 0.24660729, 1e-8);
}

#[test]
fn stick_slip_obeys_the_set_valued_law() {
    let rigs = [
        StickSlip { m: 1.0, b: 0.0, coulomb: 0.8, amplitude: 1.0, omega: 2.0 },
        StickSlip { m: 95.1, b: 203.5, coulomb: 20.4, amplitude: 40.0, omega: 3.0 },
        StickSlip { m: 1.0, b: 0.1, coulomb: 0.2, amplitude: 1.0, omega: 5.0 },
    ];
    for rig in rigs {
        let end = rig.at(20.0);
        assert!(end.switches.len() > 6, "{:?}", end.switches);
        let (mut stuck, mut slipped) = (0, 0);
        for i in 1..500 {
            let t = 0.04 * f64::from(i);
            let h = 2e-4;
            let (before, block, after) = (rig.at(t - 2.0 * h), rig.at(t), rig.at(t + 2.0 * h));
            if before.switches.len() != after.switches.len() {
                continue;
            }
            let force = rig.amplitude * (rig.omega * t).sin();
            if block.direction == 0 {
                stuck += 1;
                assert!(force.abs() <= rig.coulomb && block.v == 0.0);
            } else {
                slipped += 1;
                let sign = f64::from(block.direction);
                assert!(sign * block.v > 0.0, "{rig:?} at {t}: {block:?}");
                let residual = rig.m * slope(|s| rig.at(s).v, t, h) + rig.b * block.v + sign * rig.coulomb - force;
                close(residual / rig.amplitude, 0.0, 1e-8);
                close(slope(|s| rig.at(s).q, t, h), block.v, 1e-9);
            }
        }
        assert!(slipped > 50);
        // the third rig reverses without sticking once it is under way
        assert!(stuck > 50 || rig.coulomb == 0.2);
    }
    let held = StickSlip { m: 1.0, b: 0.0, coulomb: 2.0, amplitude: 1.0, omega: 1.0 }.at(50.0);
    assert_eq!((held.q, held.v, held.switches.len()), (0.0, 0.0, 0));
}
