//! Tests of `Recording`: one good record, each test spoils one thing; and what survives untouched.

use super::*;
use proptest::prelude::*;

/// Columns of one good record.
#[derive(Clone)]
struct Columns {
    t: Vec<f64>,
    inputs: Vec<Vec<f64>>,
    outputs: Vec<Vec<f64>>,
    input_names: Vec<String>,
    output_names: Vec<String>,
}

impl Columns {
    fn build(self) -> Result<Recording> {
        Recording::new("run1", self.t, self.inputs, self.outputs, self.input_names, self.output_names)
    }

    fn without(mut self, gone: &[usize]) -> Self {
        let keep = |column: &[f64]| -> Vec<f64> {
            column.iter().enumerate().filter(|(i, _)| !gone.contains(i)).map(|(_, v)| *v).collect()
        };
        self.t = keep(&self.t);
        self.inputs = self.inputs.iter().map(|c| keep(c)).collect();
        self.outputs = self.outputs.iter().map(|c| keep(c)).collect();
        self
    }
}

fn good() -> Columns {
    let t: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.01).collect();
    let wave = |w: f64| -> Vec<f64> { t.iter().map(|t| (w * t).sin()).collect() };
    Columns {
        inputs: vec![wave(9.0)],
        outputs: vec![wave(3.0), wave(5.0)],
        t,
        input_names: vec!["tau".into()],
        output_names: vec!["q".into(), "v".into()],
    }
}

fn spoiled(change: impl FnOnce(&mut Columns)) -> Error {
    let mut columns = good();
    change(&mut columns);
    columns.build().expect_err("the spoiled record was accepted")
}

#[test]
fn good_record_is_kept_as_it_is() {
    let columns = good();
    let recording = columns.clone().build().expect("good");
    assert_eq!(recording.t(), columns.t);
    assert_eq!(recording.input(0).collect::<Vec<_>>(), columns.inputs[0]);
    assert_eq!(recording.output(1).collect::<Vec<_>>(), columns.outputs[1]);
    assert_eq!(recording.outputs()[2 * 7 + 1], columns.outputs[1][7]);
    assert!((recording.dt() - 0.01).abs() < 1e-15);
    assert!(recording.warnings().is_empty(), "{:?}", recording.warnings());
    assert_eq!((recording.len(), recording.valid(0)), (100, 100));
}

#[test]
fn unequal_lengths() {
    let error = spoiled(|c| {
        c.outputs[1].pop();
    });
    assert!(matches!(error, Error::Shape { expected: 100, found: 99, .. }), "{error}");
    assert!(error.to_string().contains("`v`"));
}

#[test]
fn missing_and_repeated_names() {
    assert!(matches!(spoiled(|c| c.output_names.truncate(1)), Error::Shape { expected: 2, found: 1, .. }));
    let error = spoiled(|c| c.output_names[1] = "q".into());
    assert!(matches!(&error, Error::DuplicateName { name, .. } if name == "q"), "{error}");
}

#[test]
fn values_that_are_not_finite() {
    let place = |error: Error| match error {
        Error::NotFinite { row, column, .. } => (row, column),
        other => panic!("{other}"),
    };
    assert_eq!(place(spoiled(|c| c.t[4] = f64::NAN)), (4, "t".to_owned()));
    assert_eq!(place(spoiled(|c| c.inputs[0][9] = f64::NAN)), (9, "tau".to_owned()));
    assert_eq!(place(spoiled(|c| c.outputs[1][11] = f64::NEG_INFINITY)), (11, "v".to_owned()));
}

#[test]
fn time_that_stands_or_runs_back() {
    let error = spoiled(|c| c.t[5] = c.t[4]);
    assert!(matches!(error, Error::TimeNotIncreasing { row: 5, previous, found, .. } if previous == found), "{error}");
    let error = spoiled(|c| c.t[50] = 0.1);
    assert!(matches!(error, Error::TimeNotIncreasing { row: 50, previous: 0.49, found: 0.1, .. }), "{error}");
}

#[test]
fn too_few_samples() {
    let error = spoiled(|c| *c = c.clone().without(&(7..100).collect::<Vec<_>>()));
    assert!(matches!(error, Error::TooShort { needed: 8, found: 7, .. }), "{error}");
}

#[test]
fn nan_outputs_are_gaps() {
    let mut columns = good();
    columns.outputs[0][20..30].fill(f64::NAN);
    let recording = columns.build().expect("gaps are allowed");
    assert_eq!((recording.valid(0), recording.valid(1)), (90, 100));
    assert_eq!(recording.segments(0), [0..20, 30..100]);
    assert!(recording.output_std(0).is_finite());
    assert!(recording.warnings().is_empty());
}

#[test]
fn constant_columns_are_doubted() {
    let mut columns = good();
    columns.inputs[0].fill(0.0);
    columns.outputs[0].fill(1.5);
    let recording = columns.build().expect("computable");
    assert_eq!(recording.warnings().len(), 2);
    assert!(recording.warnings()[0].contains("`tau` is 0"), "{:?}", recording.warnings());
    assert!(recording.warnings()[1].contains("`q` is 1.5"));
}

#[test]
fn jitter_is_resampled_with_its_size() {
    let mut columns = good();
    for (i, t) in columns.t.iter_mut().enumerate() {
        *t += 5e-4 * (i as f64 * 2.3).sin();
    }
    columns.outputs[0] = columns.t.iter().map(|t| (3.0 * t).sin()).collect();
    columns.outputs[1][40] = f64::NAN;
    let recording = columns.build().expect("jitter is resampled");
    let (t, y): (Vec<f64>, Vec<f64>) = (recording.t().to_vec(), recording.output(0).collect());
    assert!(t.windows(2).all(|w| (w[1] - w[0] - recording.dt()).abs() < 1e-12));
    for (t, y) in t.iter().zip(y) {
        assert!((y - (3.0 * t).sin()).abs() < 2e-4, "at {t}: {y}");
    }
    let gaps = recording.len() - recording.valid(1);
    assert!((1..=2).contains(&gaps), "{gaps} gaps beside one missing sample");
    let text = &recording.warnings()[0];
    assert!(text.contains("jitters") && text.contains("s rms, 6.4"), "{text}");
}

#[test]
fn slices_keep_times_and_refuse_to_be_short() {
    let recording = good().build().expect("good");
    let part = recording.slice(0.2, 0.5).expect("31 samples");
    assert_eq!(part.len(), 31);
    assert_eq!(part.t()[0], 0.2);
    assert_eq!(part.output(1).next(), recording.output(1).nth(20));
    let error = recording.slice(0.2, 0.25).expect_err("6 samples");
    assert!(matches!(error, Error::TooShort { found: 6, .. }), "{error}");
    assert!(matches!(recording.slice(5.0, 1.0), Err(Error::TooShort { found: 0, .. })));
    assert!(matches!(recording.slice(f64::NAN, 1.0), Err(Error::OutOfRange { .. })));
}

#[test]
fn a_copy_is_restored_to_the_bit() {
    let jittered =
        Columns { t: (0..100).map(|i| 0.01 * f64::from(i) + 0.001 * f64::from(i).sin()).collect(), ..good() };
    for recording in [jittered.build().expect("resampled"), good().build().expect("uniform")] {
        let part = recording.slice(0.2, 0.7).expect("long enough");
        let columns = |all: &[f64], width: usize| -> Vec<Vec<f64>> {
            (0..width).map(|j| all.iter().skip(j).step_by(width).copied().collect()).collect()
        };
        let (inputs, outputs) = (part.input_names().to_vec(), part.output_names().to_vec());
        let copy = Recording::new(
            part.name(),
            part.t().to_vec(),
            columns(part.inputs(), inputs.len()),
            columns(part.outputs(), outputs.len()),
            inputs,
            outputs,
        )
        .and_then(|copy| copy.restored(part.dt(), part.warnings().to_vec()))
        .expect("what it gave");
        assert_eq!(copy, part);
        let error = copy.restored(1.1 * part.dt(), Vec::new()).expect_err("another step");
        assert!(matches!(error, Error::OutOfRange { .. }), "{error}");
    }
}

proptest! {
    #[test]
    fn uniform_records_survive_unchanged(
        start in -1e3..1e3_f64, dt in 1e-5..10.0_f64, y in proptest::collection::vec(-1e6..1e6_f64, 8..300),
    ) {
        let t: Vec<f64> = (0..y.len()).map(|i| start + i as f64 * dt).collect();
        let u: Vec<f64> = y.iter().rev().copied().collect();
        let names = |name: &str| vec![name.to_owned()];
        let recording = Recording::new("run", t.clone(), vec![u.clone()], vec![y.clone()], names("u"), names("y"))
            .expect("uniform");
        prop_assert_eq!(recording.t(), t);
        prop_assert_eq!(recording.inputs(), u);
        prop_assert_eq!(recording.outputs(), y);
        prop_assert!((recording.dt() / dt - 1.0).abs() < 1e-6);
    }

    #[test]
    fn removed_samples_become_gaps_exactly_there(gone in proptest::collection::btree_set(1_usize..99, 1..20)) {
        let (whole, gone): (_, Vec<usize>) = (good(), gone.into_iter().collect());
        let recording = whole.clone().without(&gone).build().expect("a grid with gaps");
        prop_assert_eq!(recording.len(), 100);
        for (i, y) in recording.output(0).enumerate() {
            prop_assert_eq!(y.is_nan(), gone.contains(&i), "row {}", i);
            if !y.is_nan() {
                prop_assert_eq!(y, whole.outputs[0][i]);
                prop_assert_eq!(recording.t()[i], whole.t[i]);
            }
        }
        prop_assert!(recording.input(0).all(f64::is_finite));
        let expected = format!("{} of 100 samples are missing", gone.len());
        prop_assert!(recording.warnings()[0].contains(&expected), "{}", recording.warnings()[0]);
    }
}
