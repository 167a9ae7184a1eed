//! Diagnosis on recordings whose physics is concealed: made by an integrator that shares nothing with the one under test.

use std::sync::atomic::AtomicBool;

use ltp_core::conceal::{Case, Recipe, conceal, motion};
use ltp_core::diagnose::{Control, Diagnosis, Options, Verdict, diagnose};
use ltp_core::model::document::Parameter;
use ltp_core::model::{Library, Model, System, zoo};
use ltp_core::numeric::regression::residual;
use ltp_core::numeric::rng::SplitMix64;
use ltp_core::signal::Recording;
use ltp_core::simulate::{Hold, Inputs, Plan, simulate};
use ltp_core::{Error, Result};

fn recipe(effect: &str, seed: u64) -> Recipe {
    Recipe {
        model: "drive".into(),
        effect: Some((effect.into(), "drive".into())),
        size: 0.1,
        amplitude: 30.0,
        ..Recipe::demo(seed)
    }
}

fn run(case: &Case, options: &Options) -> Result<Diagnosis> {
    let cancelled = AtomicBool::new(false);
    let control = Control { cancelled: &cancelled, progress: &|_, _| {} };
    diagnose(&case.model, &case.train, &case.test, options, &control)
}

/// The held-out error over its noise, and the one without the effect.
fn held_out(d: &Diagnosis) -> (f64, f64) {
    let row = &d.fit.test[0];
    (row.after.unwrap() / row.floor, row.before.unwrap() / row.floor)
}

#[test]
fn every_force_law_is_named_and_sized() {
    for effect in ["coulomb_friction", "stribeck_friction", "quadratic_drag", "linear_stiffness", "cubic_stiffness"] {
        let case = conceal(&recipe(effect, 3)).unwrap();
        let d = run(&case, &Options::default()).unwrap();
        assert_eq!(d.verdict, Verdict::Effect, "{effect}: {}", d.sentence);
        let found = &d.effects[0];
        assert_eq!((found.name.as_str(), found.at.as_str()), (effect, "drive"));
        for (name, truth) in &case.label.parameters {
            let e = &found.parameters[name];
            let sd = e.sd.unwrap();
            assert!((e.value - truth).abs() < 4.0 * sd, "{effect}.{name}: {} +- {sd}, concealed {truth}", e.value);
            assert!(sd < 0.2 * truth.abs(), "{effect}.{name}: sd {sd} tells nothing about {truth}");
        }
        let (after, before) = held_out(&d);
        assert!(after < 1.2 && before > 2.0, "{effect}: held-out error {before} -> {after} noise floors");
        let reloaded = Model::from_toml(&d.model, "augmented").unwrap();
        assert_eq!(reloaded.document().effects[0].name, effect, "the augmented model is a model");
    }
}

#[test]
fn where_nothing_is_concealed_nothing_is_claimed() {
    for seed in 0..6 {
        let d = run(&conceal(&recipe("nothing", seed)).unwrap(), &Options::default()).unwrap();
        assert!(matches!(d.verdict, Verdict::Consistent | Verdict::Parameter), "seed {seed}: {}", d.sentence);
        assert!(d.effects.is_empty() && d.location.is_empty() && d.law.is_none());
    }
}

#[test]
fn a_parameter_that_is_far_off_is_a_parameter_not_physics() {
    let mut case = conceal(&recipe("nothing", 1)).unwrap();
    let mass = case.model.parameters().iter().find(|p| p.name == "M").unwrap().clone();
    case.model = case.model.with_parameters(&[("M", mass.value + 8.0 * mass.sd.unwrap(), None)]).unwrap();
    let d = run(&case, &Options::default()).unwrap();
    assert_eq!(d.verdict, Verdict::Parameter, "{}", d.sentence);
    assert!(d.sentence.contains("`M`"), "{}", d.sentence);
    let (m, truth) = (&d.parameters["M"], zoo("drive").unwrap().parameters()[0].value);
    assert!((m.after - truth).abs() < 4.0 * m.sd && m.sd < 1.0, "{m:?}");
}

#[test]
fn more_damping_than_stated_is_a_parameter_too() {
    // A viscous force at the drive cannot be told from the damping the model already has.
    let d =
        run(&conceal(&Recipe { size: 0.5, ..recipe("viscous_friction", 2) }).unwrap(), &Options::default()).unwrap();
    assert_eq!(d.verdict, Verdict::Parameter, "{}", d.sentence);
    let row = d.candidates.iter().find(|c| c.name == "viscous_friction").unwrap();
    assert!(row.score.is_none() && row.note.as_ref().unwrap().contains("cannot be told"), "{row:?}");
}

#[test]
fn the_right_port_of_two() {
    for port in ["cart", "pendulum"] {
        let r = Recipe { effect: Some(("coulomb_friction".into(), port.into())), ..Recipe::demo(5) };
        let d = run(&conceal(&r).unwrap(), &Options::default()).unwrap();
        assert_eq!(d.effects[0].at, port, "{}", d.sentence);
        let location = &d.location[0];
        assert_eq!((location.at.as_str(), location.variable.as_str()), (port, "sign of velocity"));
        assert!(location.p_value <= 0.01);
        // The force drawn, which knows no law of friction, is the friction that was concealed.
        let (mut top, mut own, mut law) = (0.0, 0.0, 0.0);
        for f in &d.traces.force {
            for (w, v) in f.force.iter().zip(&f.velocity).filter(|(_, v)| v.abs() > 0.05) {
                (top, own, law) = (top - w * v.signum(), own + w * w, law + 1.0);
            }
        }
        assert!(top / (own * law).sqrt() > 0.95, "{port}: correlation {}", top / (own * law).sqrt());
    }
}

/// Recordings of the drive with an additional force in its equation, which no effect of the library describes.
fn foreign(force: &str, seed: u64) -> Case {
    let mut case = conceal(&recipe("nothing", seed)).unwrap();
    let mut document = zoo("drive").unwrap().document().clone();
    for (name, value) in [("ripple", 6.0), ("rate", 5.0)] {
        let p = Parameter { value, ..Parameter::default() };
        document.parameters.insert(name.into(), p);
    }
    let v = document.flow.get_mut("v").unwrap();
    *v = format!("{v} + ({force})/M");
    let truth = Model::new(document, Library::shipped().unwrap(), "foreign").unwrap();
    let mut random = SplitMix64::new(seed);
    let mut record = |r: &Recording| {
        let names = |n: &[String]| n.to_vec();
        let input: Vec<f64> = r.input(0).collect();
        let inputs = Inputs::samples(0.0, r.dt(), std::slice::from_ref(&input), Hold::FirstOrder).unwrap();
        let q = motion(&truth, &inputs, &[0.0, 0.0], r.len(), r.dt()).unwrap();
        let y = q.iter().map(|q| q + 1e-6 * random.normal()).collect();
        let (u, o) = (names(r.input_names()), names(r.output_names()));
        Recording::new(r.name(), r.t().to_vec(), vec![input], vec![y], u, o).unwrap()
    };
    case.train = case.train.iter().map(&mut record).collect();
    case.test = case.test.iter().map(&mut record).collect();
    case
}

#[test]
fn physics_outside_the_library_is_unknown_and_drawn() {
    // A drag in one direction only.
    let case = foreign("-ripple*(max(v, 0)*rate)^2", 2);
    let d = run(&case, &Options::default()).unwrap();
    assert_eq!(d.verdict, Verdict::Unknown, "{}", d.sentence);
    assert!(d.effects.is_empty());
    let (after, before) = held_out(&d);
    assert!(after < 0.01 * before, "held-out error {before} -> {after} noise floors");
    let law = d.law.unwrap();
    assert_eq!((law.at.as_str(), law.variable.as_str()), ("drive", "velocity"));
    // What a damping and a constant can say of it is theirs; the rest is the law's.
    let truth: Vec<f64> = law.grid.iter().map(|v| -6.0 * (5.0 * v.max(0.0)).powi(2)).collect();
    let bend = |f: &[f64]| residual(f, std::slice::from_ref(&law.grid));
    let (found, truth) = (bend(&law.force), bend(&truth));
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let alike = dot(&found, &truth) / (dot(&found, &found) * dot(&truth, &truth)).sqrt();
    assert!(alike > 0.95, "the law drawn is the one concealed: {alike}");
}

#[test]
fn what_no_law_and_no_parameter_explains_is_never_called_consistent() {
    // A force in time only, faster and faster: nothing in this library, and no variable of the port, follows it.
    let d = run(&foreign("-ripple*sin(t^2*rate/3)", 3), &Options::default()).unwrap();
    assert_eq!(d.verdict, Verdict::Unknown, "{}", d.sentence);
    assert!(d.effects.is_empty() && !d.location.is_empty());
}

#[test]
fn a_recipe_that_cannot_be_carried_out_is_refused() {
    let good = recipe("coulomb_friction", 1);
    let bad = [
        ("snr", Recipe { snr: f64::NAN, ..good.clone() }),
        ("amplitude", Recipe { amplitude: 1e9, ..good.clone() }),
        ("dt", Recipe { duration: (10.0, 0.0), ..good.clone() }),
        ("duration/dt", Recipe { duration: (0.1, 0.01), ..good.clone() }),
    ];
    for (name, recipe) in bad {
        match conceal(&recipe) {
            Err(Error::OutOfRange { what, .. }) => assert_eq!(what, name),
            other => panic!("{name}: {:?}", other.map(|c| c.label)),
        }
    }
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let case = conceal(&recipe("quadratic_drag", 4)).unwrap();
    let [one, two] = [1, 2].map(|threads| {
        let mut d = run(&case, &Options { threads, ..Options::default() }).unwrap();
        d.seconds = 0.0;
        serde_json::to_string(&d).unwrap()
    });
    assert_eq!(one, two);
}

#[test]
fn gaps_take_part_in_nothing() {
    let case = conceal(&recipe("coulomb_friction", 3)).unwrap();
    let spoil = |r: &Recording| {
        let mut y: Vec<f64> = r.output(0).collect();
        y[200..260].fill(f64::NAN);
        y[700] = f64::NAN;
        let names = |n: &[String]| n.to_vec();
        let inputs = vec![r.input(0).collect()];
        Recording::new(r.name(), r.t().to_vec(), inputs, vec![y], names(r.input_names()), names(r.output_names()))
            .unwrap()
    };
    let gappy = Case { train: case.train.iter().map(spoil).collect(), ..case.clone() };
    let d = run(&gappy, &Options::default()).unwrap();
    let whole = run(&case, &Options::default()).unwrap();
    let force = |d: &Diagnosis| d.effects[0].parameters["force"].clone();
    assert_eq!(d.effects[0].name, "coulomb_friction");
    assert!((force(&d).value - force(&whole).value).abs() < 3.0 * force(&d).sd.unwrap());
}

#[test]
fn a_recording_without_the_input_is_refused_by_name() {
    let mut case = conceal(&recipe("nothing", 1)).unwrap();
    let r = &case.train[0];
    let output = vec![r.output(0).collect()];
    case.train[0] =
        Recording::new("no input", r.t().to_vec(), vec![], output, vec![], r.output_names().to_vec()).unwrap();
    match run(&case, &Options::default()) {
        Err(Error::UnknownName { kind, name, .. }) => assert_eq!((kind.as_str(), name.as_str()), ("input", "tau")),
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_effect_that_does_not_exist_is_refused_with_the_nearest() {
    let case = conceal(&recipe("nothing", 1)).unwrap();
    let options = Options { candidates: Some(vec!["columb_friction".into()]), ..Options::default() };
    let message = run(&case, &options).unwrap_err().to_string();
    assert!(message.contains("coulomb_friction"), "{message}");
}

#[test]
fn a_cancelled_diagnosis_says_so() {
    let case = conceal(&recipe("nothing", 1)).unwrap();
    let cancelled = AtomicBool::new(true);
    let control = Control { cancelled: &cancelled, progress: &|_, _| {} };
    let result = diagnose(&case.model, &case.train, &case.test, &Options::default(), &control);
    assert_eq!(result.unwrap_err(), Error::Interrupted);
}

#[test]
fn the_concealing_integrator_agrees_with_the_engine() {
    // Two routes to one motion: tiny split steps with impulses on the plain evaluator, exact slip and stick on machine code.
    let model = zoo("cart_pendulum").unwrap().attach("coulomb_friction", "cart", &[("force", 0.6)]).unwrap();
    let volts: Vec<f64> = (0..401).map(|k| 3.0 * (0.05 * f64::from(k)).sin()).collect();
    let inputs = Inputs::samples(0.0, 0.01, &[volts], Hold::FirstOrder).unwrap();
    let compiled = model.compile();
    let plan = Plan::new(4.0, 0.01).unwrap().with_step(1e-3);
    let exact = simulate(&compiled, compiled.parameters(), &inputs, &plan).unwrap();
    assert!(exact.events.len() > 3, "it must stick and slip for the comparison to mean something");
    let other = motion(&model, &inputs, &compiled.initial_state(), 401, 0.01).unwrap();
    let far = exact.outputs.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(far < 2e-5, "largest difference {far}");
}

#[test]
fn a_foot_that_stands_at_first_is_held_there() {
    let held = |name: &str| zoo(name).unwrap().held_at_start();
    // Height and speed of the body move in either mode, those of the toe in flight only.
    assert_eq!(held("hopper"), [false, true, false, true]);
    assert_eq!(held("drive"), [false, false]);
}
