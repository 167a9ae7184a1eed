//! Where a mismatch acts: a sensor, an input or a port, on recordings by an integrator that shares nothing with the one
//! under test.

use std::sync::atomic::AtomicBool;

use ltp_core::conceal::{Case, Recipe, conceal, motion};
use ltp_core::diagnose::{Control, Diagnosis, Options, Verdict, diagnose};
use ltp_core::model::Model;
use ltp_core::numeric::rng::SplitMix64;
use ltp_core::signal::Recording;
use ltp_core::simulate::{Hold, Inputs};

/// With next to nothing to name, what is said of the place is the smoother's own.
fn run(model: &Model, train: &[Recording], test: &[Recording]) -> Diagnosis {
    let cancelled = AtomicBool::new(false);
    let control = Control { cancelled: &cancelled, progress: &|_, _| {} };
    let options = Options { candidates: Some(vec!["cubic_stiffness".into()]), ..Options::default() };
    diagnose(model, train, test, &options, &control).unwrap()
}

/// Slow wandering: sines of irregular periods, of the order of one.
fn wander(t: f64, seed: u64) -> f64 {
    let mut random = SplitMix64::new(seed);
    (0..4).map(|_| ((0.4 + 1.2 * random.uniform()) * t + 6.3 * random.uniform()).sin()).sum()
}

/// A clean case of the drive whose sensor shows `off(t, q)` more than there is.
fn sensor(off: impl Fn(f64, f64) -> f64) -> Case {
    let r = Recipe { model: "drive".into(), effect: None, amplitude: 30.0, ..Recipe::demo(4) };
    let mut case = conceal(&r).unwrap();
    let shown = |r: &Recording| {
        let y = r.output(0).zip(r.t()).map(|(q, t)| q + off(*t, q)).collect();
        let inputs = vec![r.input(0).collect()];
        let (u, o) = (r.input_names().to_vec(), r.output_names().to_vec());
        Recording::new(r.name(), r.t().to_vec(), inputs, vec![y], u, o).unwrap()
    };
    case.train = case.train.iter().map(shown).collect();
    case.test = case.test.iter().map(shown).collect();
    case
}

fn spread(case: &Case) -> f64 {
    let y: Vec<f64> = case.train[0].output(0).collect();
    let (low, high) = y.iter().fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
    high - low
}

#[test]
fn a_sensor_that_wanders_is_located_at_the_sensor() {
    // A walk, sample by sample: a force that moved the machine so would have to be a thousand times too quick for it.
    let size = 2e-3 * spread(&sensor(|_, _| 0.0));
    let mut random = SplitMix64::new(7);
    let mut level = 0.0;
    let walk: Vec<f64> = (0..100_000)
        .map(|_| {
            level += size * random.normal();
            level
        })
        .collect();
    let case = sensor(|t, _| walk[(1000.0 * t).round() as usize]);
    let d = run(&case.model, &case.train, &case.test);
    assert_eq!(d.verdict, Verdict::Unknown, "{}", d.sentence);
    let place = &d.location[0];
    let output = case.model.outputs()[0];
    assert_eq!((place.kind.as_str(), place.at.as_str()), ("output", output));
    assert!(place.sentence.starts_with(&format!("at the sensor `{output}`")), "{}", place.sentence);
    // The course is what was added, up to what an initial state could make of it.
    let f = &d.traces.force[0];
    assert_eq!(
        (f.kind.as_str(), f.unit.as_str()),
        ("output", case.model.unit(output).unwrap()),
        "{} {:?}",
        d.sentence,
        d.law
    );
    let truth: Vec<f64> = f.t.iter().map(|t| walk[(1000.0 * t).round() as usize]).collect();
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let (a, b) = (mean(&truth), mean(&f.force));
    let left: f64 = truth.iter().zip(&f.force).map(|(x, y)| (x - a - y + b).powi(2)).sum();
    let own: f64 = truth.iter().map(|x| (x - a).powi(2)).sum();
    assert!(left < 0.2 * own, "{left} of {own} are missed");
}

/// Two masses on springs of their own: one voltage drives both, so that its error is no force at one port.
const TWINS: &str = r#"
name = "twins"
[states]
a = { value = 0.0, unit = "m" }
va = { value = 0.0, unit = "m/s" }
b = { value = 0.0, unit = "m" }
vb = { value = 0.0, unit = "m/s" }
[inputs]
u = { unit = "N" }
[parameters]
c = { value = 0.4, sd = 0.04, unit = "N s/m" }
k = { value = 20.0, unit = "N/m" }
m = { value = 1.0, unit = "kg" }
[flow]
a = "va"
va = "(u - c*va - k*a)/m"
b = "vb"
vb = "(u - c*vb - 2*k*b)/m"
[outputs]
a = { value = "a", unit = "m" }
b = { value = "b", unit = "m" }
[ports]
left = { position = "a", velocity = "va", acts = { va = "1/m" }, unit = "N" }
right = { position = "b", velocity = "vb", acts = { vb = "1/m" }, unit = "N" }
"#;

/// Recordings of the twins: `beside(t)` enters with the input that is recorded, `right(t)` at one port only.
fn twins(beside: fn(f64) -> f64, right: fn(f64) -> f64) -> (Model, Vec<Recording>) {
    let model = Model::from_toml(TWINS, "twins").unwrap();
    let apart =
        TWINS.replace("[parameters]", "r = { unit = \"N\" }\n[parameters]").replace("vb = \"(u", "vb = \"(r + u");
    let truth = Model::from_toml(&apart, "twins").unwrap();
    let mut random = SplitMix64::new(11);
    let mut record = |name: &str, seed: u64| {
        let t: Vec<f64> = (0..3000).map(|k| 0.01 * f64::from(k)).collect();
        let u: Vec<f64> = t.iter().map(|t| wander(3.0 * t, seed)).collect();
        let real: Vec<f64> = u.iter().zip(&t).map(|(u, t)| u + beside(*t)).collect();
        let r: Vec<f64> = real.iter().zip(&t).map(|(_, t)| right(*t)).collect();
        let inputs = Inputs::samples(0.0, 0.01, &[real, r], Hold::FirstOrder).unwrap();
        let y = motion(&truth, &inputs, &[0.0; 4], t.len(), 0.01).unwrap();
        let of = |j: usize, random: &mut SplitMix64| -> Vec<f64> {
            y.iter().skip(j).step_by(2).map(|y| y + 1e-4 * random.normal()).collect()
        };
        let outputs = vec![of(0, &mut random), of(1, &mut random)];
        Recording::new(name, t, vec![u], outputs, vec!["u".into()], vec!["a".into(), "b".into()]).unwrap()
    };
    let records = vec![record("first", 1), record("second", 2)];
    (model, records)
}

#[test]
fn what_enters_with_an_input_is_told_from_a_force_at_one_of_the_ports_it_drives() {
    let (model, records) = twins(|t| 0.3 * wander(t, 5), |_| 0.0);
    let d = run(&model, &records[..1], &records[1..]);
    let place = &d.location[0];
    assert_eq!((place.kind.as_str(), place.at.as_str()), ("input", "u"), "{}", d.sentence);
    assert!(place.sentence.contains("a force at `left` or `right` would explain less"), "{}", place.sentence);

    let (model, records) = twins(|_| 0.0, |t| 0.3 * wander(t, 5));
    let d = run(&model, &records[..1], &records[1..]);
    let place = &d.location[0];
    assert_eq!((place.kind.as_str(), place.at.as_str()), ("port", "right"), "{}", d.sentence);
}

#[test]
fn an_input_that_drives_one_port_leaves_the_port_its_name() {
    // A stick-slip friction of the drive: its motor's voltage could be wrong by as much, and nobody could tell.
    let effect = Some(("coulomb_friction".into(), "drive".into()));
    let r = Recipe { model: "drive".into(), effect, size: 0.1, amplitude: 30.0, ..Recipe::demo(3) };
    let case = conceal(&r).unwrap();
    let d = run(&case.model, &case.train, &case.test);
    let f = &d.traces.force[0];
    assert_eq!((f.kind.as_str(), f.at.as_str()), ("port", "drive"), "{}", d.sentence);
}
