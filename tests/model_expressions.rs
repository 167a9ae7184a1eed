//! Owns: equations as data. Native code against the plain evaluator bit for bit, derivatives against central differences,
//! the document's round trip, the mass matrix against a hand inversion, a user's own system, and every way in which a
//! document can be wrong.

use ltp_core::Error;
use ltp_core::model::{Backend, Direction, Document, Guard, Model, Point, System, ZOO, zoo, zoo_text};
use ltp_core::simulate::{Inputs, Plan, simulate};
use proptest::prelude::*;

/// A model of one state whose rate is `expression` of x, u, p, q and t.
fn model(expression: &str) -> Result<Model, Error> {
    let text = format!(
        "name = 'test'\n[states]\nx = {{ value = 0.7 }}\n[inputs]\nu = {{}}\n[parameters]\np = {{ value = 1.3, sd = 0.1 }}\n\
         q = {{ value = -0.4, sd = 0.1 }}\n[flow]\nx = '''{expression}'''\n[outputs]\nx = 'x'\n"
    );
    Model::from_toml(&text, "test.toml")
}

/// Random expressions over all functions, kept where they are defined.
fn expression() -> impl Strategy<Value = String> {
    let leaf = prop_oneof![
        Just("x".to_string()),
        Just("u".to_string()),
        Just("p".to_string()),
        Just("q".to_string()),
        Just("(t*p)".to_string()),
        Just("pi".to_string()),
        (-3.0..3.0f64).prop_map(|v| format!("({v:.3})")),
    ];
    leaf.prop_recursive(5, 40, 3, |inner| {
        let one = prop::sample::select(vec!["sin", "cos", "tanh", "atan", "abs", "sign", "-"]);
        let guarded = prop::sample::select(vec![
            "exp(tanh(E))",
            "sinh(tanh(E))",
            "cosh(tanh(E))",
            "tan(tanh(E))",
            "asin(0.9*tanh(E))",
            "acos(0.9*tanh(E))",
            "log(1 + (E)^2)",
            "sqrt(1 + (E)^2)",
            "(E)^2",
            "(E)^3",
            "(1 + (E)^2)^-2",
            "(1 + (E)^2)^0.7",
        ]);
        let two = prop::sample::select(vec![
            "(A + B)",
            "(A - B)",
            "A*B",
            "(A)/(1 + (B)^2)",
            "min(A, B)",
            "max(A, B)",
            "atan2(A, 1.5 + tanh(B))",
            "if(A < B, A, B)",
            "if(A >= B, sin(A), B)",
            "(A == B)",
            "(A != B)",
            "(2 + sin(A))^tanh(B)",
        ]);
        prop_oneof![
            (one, inner.clone()).prop_map(|(f, e)| format!("{f}({e})")),
            (guarded, inner.clone()).prop_map(|(f, e)| f.replace('E', &e)),
            (two, inner.clone(), inner)
                .prop_map(|(f, a, b)| f.replace('A', "\u{1}").replace('B', &b).replace('\u{1}', &a)),
        ]
    })
}

/// Central difference that tells how far it can be trusted: two steps, and their disagreement.
fn difference(f: &dyn Fn(f64) -> f64, x: f64) -> (f64, f64) {
    let at = |h: f64| (8.0 * (f(x + h) - f(x - h)) - (f(x + 2.0 * h) - f(x - 2.0 * h))) / (12.0 * h);
    (at(1e-4), (at(1e-4) - at(2.3e-4)).abs())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..Default::default() })]

    #[test]
    fn native_code_equals_the_plain_evaluator(e in expression(), x in -2.0..2.0f64, u in -2.0..2.0f64, t in 0.0..5.0f64) {
        let m = model(&e).unwrap();
        let [native, plain] = [Backend::Native, Backend::Plain].map(|b| {
            let s = m.compile_for(vec![0, 1], b);
            let mut out = [0.0; 4];
            s.flow_jacobian(0, Point { t, x: &[x], u: &[u], p: s.parameters() }, &mut out);
            let mut rate = [0.0];
            s.flow(0, Point { t, x: &[x], u: &[u], p: s.parameters() }, &mut rate);
            assert!(rate[0].to_bits() == out[0].to_bits() || rate[0].is_nan());
            out.map(f64::to_bits)
        });
        prop_assert_eq!(native, plain, "{}", e);
    }

    #[test]
    fn derivatives_are_exact(e in expression(), x in -2.0..2.0f64, u in -2.0..2.0f64, t in 0.1..5.0f64) {
        let s = model(&e).unwrap().compile_for(vec![0, 1], Backend::Plain);
        let value = |x: f64, p: f64, q: f64| {
            let mut out = [0.0];
            s.flow(0, Point { t, x: &[x], u: &[u], p: &[p, q] }, &mut out);
            out[0]
        };
        let mut out = [0.0; 4];
        s.flow_jacobian(0, Point { t, x: &[x], u: &[u], p: &[1.3, -0.4] }, &mut out);
        let truth = [
            difference(&|d| value(d, 1.3, -0.4), x),
            difference(&|d| value(x, d, -0.4), 1.3),
            difference(&|d| value(x, 1.3, d), -0.4),
        ];
        for (k, (expected, doubt)) in truth.into_iter().enumerate() {
            // a kink within the stencil, or a slope out of scale, cannot be judged by differences
            if doubt <= 1e-6 * expected.abs().max(1.0) && out[0].abs() < 1e4 {
                let tolerance = 1e-6 * expected.abs().max(1.0) + 10.0 * doubt;
                prop_assert!((out[1 + k] - expected).abs() <= tolerance, "{}: {} {}", e, out[1 + k], expected);
            }
        }
    }
}

#[test]
fn every_function_has_its_derivative() {
    let expressions = [
        "sin(x)",
        "cos(x)",
        "tan(x)",
        "asin(x)",
        "acos(x)",
        "atan(x)",
        "sinh(x)",
        "cosh(x)",
        "tanh(x)",
        "exp(x)",
        "log(x)",
        "sqrt(x)",
        "abs(x)",
        "atan2(x, p)",
        "atan2(p, x)",
        "min(x, p)",
        "max(x, p)",
        "x^p",
        "p^x",
        "x^3",
        "x^-2",
        "x^0.5",
        "x/p",
        "p/x",
        "if(x < p, x^2, x^3)",
        "sign(x)",
        "x*q - x/(p + x)",
    ];
    for e in expressions {
        let s = model(e).unwrap().compile_for(vec![0, 1], Backend::Native);
        let value = |x: f64, p: f64| {
            let mut out = [0.0];
            s.flow(0, Point { t: 0.0, x: &[x], u: &[0.0], p: &[p, -0.4] }, &mut out);
            out[0]
        };
        let mut out = [0.0; 4];
        s.flow_jacobian(0, Point { t: 0.0, x: &[0.7], u: &[0.0], p: &[1.3, -0.4] }, &mut out);
        for (found, (expected, _)) in
            [(out[1], difference(&|d| value(d, 1.3), 0.7)), (out[2], difference(&|d| value(0.7, d), 1.3))]
        {
            assert!((found - expected).abs() <= 1e-9 * expected.abs().max(1.0), "{e}: {found} {expected}");
        }
    }
}

#[test]
fn errors_point_into_the_expression_and_name_the_nearest() {
    let cases = [
        ("x + velocty", "unknown name `velocty`", 1, 5),
        ("sin(x) + cso(u)", "no function `cso`", 1, 10),
        ("x +\n  * u", "found `*`", 2, 3),
        ("x + (u - 1", "not closed", 1, 5),
        ("atan2(x)", "takes 2 arguments", 1, 1),
        ("x = u", "==", 1, 3),
        ("2 x", "expected an operator", 1, 3),
        ("1e999", "not a finite number", 1, 1),
        ("x**2", "`^`", 1, 2),
    ];
    for (text, message, line, column) in cases {
        let error = model(text).err().unwrap();
        let Error::Expression { line: l, column: c, .. } = error else { panic!("{text}: {error}") };
        let shown = error.to_string();
        assert!(shown.contains(message) && shown.contains("test.toml: flow.x"), "{shown}");
        assert_eq!((l, c), (line, column), "{shown}");
        let caret = shown.lines().last().unwrap();
        assert_eq!(caret.find('^'), Some(4 + column - 1), "{shown}");
    }
    let error = Model::from_toml(&zoo_text("hopper").unwrap().replace("f/M - g", "f/M - omega"), "hopper.toml");
    assert!(error.err().unwrap().to_string().contains("`omega_p`"));
}

#[test]
fn deep_nesting_is_refused() {
    for text in ["(".repeat(5000), "-".repeat(5000) + "x", "sin(".repeat(5000), "x^".repeat(5000) + "2"] {
        assert!(model(&text).err().unwrap().to_string().contains("nested deeper"));
    }
    let shown = model(&vec!["x"; 100_000].join(" + ")).err().unwrap().to_string();
    assert!(shown.contains("more than 2000 operators"), "{shown}");
    let long = vec!["x"; 1000].join(" + ");
    let s = model(&long).unwrap().compile();
    let mut rate = [0.0];
    s.flow(0, Point { t: 0.0, x: &[2.0], u: &[0.0], p: s.parameters() }, &mut rate);
    assert_eq!(rate, [2000.0]);
}

#[test]
fn long_chains_of_signals_are_refused() {
    let chain = |n: usize| {
        let links: String = (1..n).map(|k| format!("s{k} = 's{} + 1'\n", k + 1)).collect();
        let text = format!(
            "name = 'c'\n[states]\nx = {{}}\n[signals]\n{links}s{n} = 'x'\n[flow]\nx = 's1'\n[outputs]\nx = 'x'"
        );
        Model::from_toml(&text, "chain.toml")
    };
    assert!(chain(100).is_ok());
    assert!(chain(20_000).err().unwrap().to_string().contains("more than 100 deep"));
}

#[test]
fn a_document_spoiled_in_one_place_says_where() {
    let good = zoo_text("hopper").unwrap();
    let spoil = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        Model::from_toml(&good.replacen(from, to, 1), "h.toml")
            .err()
            .unwrap_or_else(|| panic!("{to}: accepted"))
            .to_string()
    };
    let cases = [
        ("value = \"a*cos(omega_p*t) + u_c\"", "value = \"f\"", "f -> u -> f"),
        ("unit = \"kg\"", "unit = \"kilo\"", "kilo"),
        (
            "u = { value = \"a*cos(omega_p*t) + u_c\", unit = \"N\"",
            "u = { value = \"a*cos(omega_p*t) + u_c\", unit = \"m\"",
            "unit",
        ),
        ("\nu = {", "\nM = {", "defined twice"),
        ("h = \"hd\"", "hq = \"hd\"", "`hq`"),
        ("h = \"hd\"", "", "no flow for the state `h`"),
        ("from = \"stance\"", "from = \"stanze\"", "`stance`"),
        ("direction = \"falling\"", "direction = \"down\"", "down"),
        ("period = \"2*pi/omega_p\"", "period = \"2*pi/h\"", "parameters only"),
        ("value = 2.7,", "value = -2.7,", "not within"),
        ("initial_mode = \"stance\"", "initial_mode = \"air\"", "air"),
        ("name = \"hopper\"", "name = \"hopper\"\ncolour = \"red\"", "colour"),
        ("g = { value = 9.81", "sin = { value = 9.81", "fixed meaning"),
    ];
    for (from, to, message) in cases {
        let shown = spoil(from, to);
        assert!(shown.contains(message) && shown.contains("h.toml"), "{to}: {shown}");
    }
}

#[test]
fn documents_survive_the_round_trip() {
    for (name, text) in ZOO {
        let first = Document::from_toml(text, name).unwrap();
        let written = first.to_toml().unwrap();
        let second = Document::from_toml(&written, name).unwrap();
        assert_eq!(first, second, "{name}");
        assert_eq!(written, second.to_toml().unwrap());
        let json = serde_json::to_string(&first).unwrap();
        assert_eq!(first, Document::from_json(&json, name).unwrap(), "{name}");
        Model::from_toml(&written, name).unwrap();
    }
    let attached = zoo("drive").unwrap().attach("coulomb_friction", "drive", &[("force", 20.4)]).unwrap();
    let again = Model::from_toml(&attached.to_toml().unwrap(), "drive.toml").unwrap();
    assert_eq!(attached.document(), again.document());
}

#[test]
fn every_zoo_model_loads_natively_and_runs() {
    for (name, _) in ZOO {
        let model = zoo(name).unwrap();
        let system = model.compile();
        system.warm();
        assert!(system.is_native(), "{name}");
        let inputs = Inputs::constant(&vec![0.1; system.inputs()]);
        let found = simulate(&system, system.parameters(), &inputs, &Plan::new(2.0, 0.01).unwrap()).unwrap();
        assert!(found.stop.is_finished(), "{name}: {}", found.stop.sentence());
        assert!(
            model.ports().iter().all(|port| model.attach("viscous_friction", port, &[("damping", 0.1)]).is_ok()),
            "{name}"
        );
    }
}

/// Rates of the cart-pendulum, inverted by hand.
fn cart_pendulum(p: &[f64], x: &[f64], volt: f64) -> [f64; 4] {
    let [mc, mp, l, beq, bp, ks, g, kg, kt, km, rm, r] = p[..] else { panic!("twelve parameters") };
    let force = kg * kt / (rm * r) * volt - kg * kg * kt * km / (rm * r * r) * x[2];
    let (sin, cos) = x[1].sin_cos();
    let (a, b, d) = (mc + mp, mp * l * cos, mp * l * l * 4.0 / 3.0);
    let f1 = force - beq * x[2] + mp * l * sin * x[3] * x[3];
    let f2 = -bp * x[3] - ks * (x[1] - std::f64::consts::PI) - mp * g * l * sin;
    let determinant = a * d - b * b;
    [x[2], x[3], (d * f1 - b * f2) / determinant, (a * f2 - b * f1) / determinant]
}

#[test]
fn mass_matrix_equals_the_hand_inversion() {
    let system = zoo("cart_pendulum").unwrap().compile();
    for k in 0..50 {
        let x = [0.1, 0.3 * f64::from(k), 1.0 - 0.1 * f64::from(k), 0.2 * f64::from(k) - 3.0];
        let mut found = [0.0; 4];
        system.flow(0, Point { t: 0.0, x: &x, u: &[2.5], p: system.parameters() }, &mut found);
        for (f, e) in found.iter().zip(cart_pendulum(system.parameters(), &x, 2.5)) {
            assert!((f - e).abs() <= 1e-12 * e.abs().max(1.0), "{x:?}: {found:?}");
        }
    }
}

/// A ball on a floor in plain Rust, its derivatives left to central differences.
struct Ball {
    p: [f64; 2],
    guards: [Guard; 1],
}

impl System for Ball {
    fn states(&self) -> usize {
        2
    }
    fn inputs(&self) -> usize {
        0
    }
    fn outputs(&self) -> usize {
        1
    }
    fn parameters(&self) -> &[f64] {
        &self.p
    }
    fn free(&self) -> &[usize] {
        &[0, 1]
    }
    fn initial_state(&self) -> Vec<f64> {
        vec![1.0, 0.0]
    }
    fn flow(&self, _: usize, at: Point<'_>, rates: &mut [f64]) {
        rates.copy_from_slice(&[at.x[1], -at.p[0]]);
    }
    fn output(&self, _: usize, at: Point<'_>, y: &mut [f64]) {
        y[0] = at.x[0];
    }
    fn guards(&self, _: usize) -> &[Guard] {
        &self.guards
    }
    fn guard_values(&self, _: usize, at: Point<'_>, out: &mut [f64]) {
        out[0] = at.x[0];
    }
    fn reset(&self, _: usize, _: usize, at: Point<'_>, after: &mut [f64]) {
        after.copy_from_slice(&[at.x[0], -at.p[1] * at.x[1]]);
    }
}

#[test]
fn a_system_of_the_users_own_behaves_as_the_document() {
    let guard = Guard { name: "impact".into(), direction: Direction::Falling, friction: false };
    let own = Ball { p: [9.81, 0.8], guards: [guard] };
    let compiled = zoo("bouncing_ball").unwrap().compile_for(vec![1, 2], Backend::Native);
    let plan = Plan::new(3.0, 0.1).unwrap().with_step(1e-3).with_derivatives();
    let ours = simulate(&own, own.parameters(), &Inputs::constant(&[]), &plan).unwrap();
    let theirs = simulate(&compiled, compiled.parameters(), &Inputs::constant(&[]), &plan).unwrap();
    assert!(ours.stop.is_finished() && ours.events.len() == 6, "{:?} {}", ours.stop, ours.events.len());
    for (a, b) in ours.states.iter().zip(&theirs.states) {
        assert!((a - b).abs() < 1e-12);
    }
    for (a, b) in ours.sensitivities.iter().zip(&theirs.sensitivities) {
        assert!((a - b).abs() < 1e-6 * b.abs().max(1.0), "{a} {b}");
    }
}
