//! Recordings made ready: split, followed by observers, with the fit of the nominal model and the noise it reveals.

use super::experiment::{Control, Experiment};
use super::fit::Ground;
use super::judge::Halves;
use super::prepare::{self, Follower, Scene, Ties};
use super::trial::{self, Bench, Trial};
use crate::error::Result;
use crate::model::{Model, System};

/// Bandwidths of the observers, relative to the speed of the motion. The weak tie of each is four times slower.
const BANDWIDTHS: [f64; 3] = [2.0, 1.0, 0.5];

/// Integration error, in units of noise, above which a reader must be told.
const COARSE: f64 = 0.3;

/// What every fit starts from.
pub struct Prepared {
    /// Train records.
    pub train: Vec<Experiment>,
    /// Held-out records.
    pub test: Vec<Experiment>,
    /// Sizes, speeds and starting states.
    pub scene: Scene,
    /// Steps per sample.
    pub substeps: u64,
    /// Freedom of each state at the start of a record.
    start_scale: Vec<f64>,
    /// Error of the engine at these steps, per output.
    engine_error: Vec<f64>,
    /// Parameters as stated.
    stated: Vec<f64>,
    /// Period of the clock.
    period: Option<f64>,
    train_ties: Vec<Ties>,
    test_ties: Ties,
}

impl Prepared {
    /// Follows the recordings with the model as stated.
    ///
    /// # Errors
    /// [`crate::Error::NoConvergence`] when it cannot be simulated along them, [`crate::Error::Interrupted`].
    pub fn new(
        model: &Model,
        train: Vec<Experiment>,
        test: Vec<Experiment>,
        control: &Control<'_>,
        warnings: &mut Vec<String>,
    ) -> Result<Self> {
        let system = model.compile();
        let stated = system.parameters().to_vec();
        let scene = Follower::new(model, &stated, 1, control)?.scene(&train, &test);
        let ground =
            Ground { experiments: &train, sigma: &scene.sigma, substeps: 1, state_scale: &scene.state_scale, control };
        let (substeps, engine_error) = prepare::substeps(&system, &stated, ground, &scene.start[..train.len()])?;
        if engine_error.iter().zip(&scene.sigma).any(|(e, s)| *e > COARSE * s) {
            warnings.push(format!(
                "even {substeps} steps per sample leave an integration error comparable to the noise: the model is stiff or \
                 jumps often; small effects cannot be trusted"
            ));
        }
        let (train_ties, test_ties, period) = (Vec::new(), Vec::new(), system.period(&stated));
        let freedom = |(s, held): (&f64, bool)| if held { 0.0 } else { *s };
        let start_scale = scene.state_scale.iter().zip(model.held_at_start()).map(freedom).collect();
        let mut p =
            Self { train, test, scene, substeps, start_scale, engine_error, stated, period, train_ties, test_ties };
        for bandwidth in BANDWIDTHS {
            control.check()?;
            let ties = p.ties(model, &p.train, p.train_start(), bandwidth, control)?;
            p.train_ties.push(ties);
        }
        p.test_ties = p.ties(model, &p.test, p.test_start(), 1.0, control)?;
        Ok(p)
    }

    fn train_start(&self) -> &[Vec<f64>] {
        &self.scene.start[..self.train.len()]
    }

    fn test_start(&self) -> &[Vec<f64>] {
        &self.scene.start[self.train.len()..]
    }

    /// Observers of a bandwidth relative to the speed of the motion, and four times weaker.
    fn ties(
        &self,
        model: &Model,
        e: &[Experiment],
        start: &[Vec<f64>],
        bandwidth: f64,
        control: &Control<'_>,
    ) -> Result<Ties> {
        let follower = Follower::new(model, &self.stated, self.substeps, control)?;
        let tie = |f: f64| follower.ties(e, &self.scene, start, f * self.scene.speed);
        Ok([bandwidth, 0.25 * bandwidth].into_iter().filter_map(tie).collect())
    }

    /// What the fits of all candidates share, at given noise levels.
    pub fn bench<'a>(&'a self, model: &'a Model, sigma: &'a [f64], control: &'a Control<'a>) -> Bench<'a> {
        let train = Ground {
            experiments: &self.train,
            sigma,
            substeps: self.substeps,
            state_scale: &self.start_scale,
            control,
        };
        Bench {
            model,
            train,
            test: Ground { experiments: &self.test, ..train },
            train_start: self.train_start(),
            test_start: self.test_start(),
            train_ties: &self.train_ties,
            test_ties: &self.test_ties,
        }
    }

    /// Noise of each output and the nominal model refitted under it. The white part of what the refitted model leaves is a
    /// second, sharper view of the noise than the white part of the measurement; the engine's own error adds to it.
    ///
    /// # Errors
    /// As [`trial::nominal`].
    pub fn nominal(&self, model: &Model, control: &Control<'_>) -> Result<(Vec<f64>, Trial)> {
        let sigma = self.scene.sigma.clone();
        let nominal = trial::nominal(&self.bench(model, &sigma, control))?;
        let scaled = |r: &Vec<f64>| r.iter().enumerate().map(|(i, v)| v * sigma[i % sigma.len()]).collect();
        let residual: Vec<Vec<f64>> = nominal.residuals.train.iter().map(scaled).collect();
        let sharper: Vec<f64> = prepare::floors(&self.train, Some(&residual))
            .iter()
            .zip(&sigma)
            .zip(&self.engine_error)
            .map(|((a, b), e)| a.min(*b).hypot(*e))
            .collect();
        if sharper.iter().zip(&sigma).all(|(a, b)| *a > 0.8 * b && *a < 1.25 * b) {
            return Ok((sigma, nominal));
        }
        let nominal = trial::nominal(&self.bench(model, &sharper, control))?;
        Ok((sharper, nominal))
    }

    /// Halves of the train records for two-fold prediction.
    ///
    /// # Errors
    /// None that a prepared model could cause.
    pub fn halves(&self, model: &Model, control: &Control<'_>) -> Result<Halves> {
        let cut = |e: &Experiment| prepare::cut(e, 0.5, self.period);
        let first: Vec<Experiment> = self.train.iter().map(|e| e.part(0, cut(e))).collect();
        let second: Vec<Experiment> = self.train.iter().map(|e| e.part(cut(e), e.len())).collect();
        let (start, middle) = (self.train_start().to_vec(), self.scene.middle.clone());
        let ties = [self.ties(model, &first, &start, 1.0, control)?, self.ties(model, &second, &middle, 1.0, control)?];
        Ok(Halves { parts: [first, second], start: [start, middle], ties })
    }
}
