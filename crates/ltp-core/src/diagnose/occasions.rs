//! When a missing force acts: in which mode, and at which phases of the cycle.

use super::result::Force;

/// Bins of the cycle.
const BINS: usize = 48;
/// A bin counts where the mean force over all cycles is this many of its own standard deviations from zero.
const CLEAR: f64 = 4.0;
/// And at least this share of the largest bin.
const LARGE: f64 = 0.35;
/// Share of the force's energy in one mode from which only that mode matters.
const ONLY: f64 = 0.9;
/// Share of the samples in one mode above which saying it says nothing.
const ALWAYS: f64 = 0.85;

/// The one mode in which a force acts, where there is one.
pub fn mode(forces: &[Force]) -> Option<String> {
    let mut energy: Vec<(String, f64, f64)> = Vec::new();
    for f in forces {
        for (w, m) in f.force.iter().zip(&f.mode) {
            let name = &f.modes[*m];
            let i = energy.iter().position(|(n, ..)| n == name).unwrap_or_else(|| {
                energy.push((name.clone(), 0.0, 0.0));
                energy.len() - 1
            });
            energy[i].1 += w * w;
            energy[i].2 += 1.0;
        }
    }
    let (all, samples) = energy.iter().fold((0.0, 0.0), |a, e| (a.0 + e.1, a.1 + e.2));
    let (name, own, count) = energy.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    (own >= ONLY * all && count <= ALWAYS * samples).then_some(name)
}

/// Phases in [0, 1) around which a force acts in every cycle, strongest first; empty where it acts throughout or by no clock.
pub fn phases(forces: &[Force]) -> Vec<f64> {
    let mut sum = [0.0; BINS];
    let mut square = [0.0; BINS];
    let mut count = [0.0; BINS];
    for f in forces {
        for (w, phase) in f.force.iter().zip(&f.phase) {
            let b = ((phase * BINS as f64) as usize).min(BINS - 1);
            sum[b] += w;
            square[b] += w * w;
            count[b] += 1.0;
        }
    }
    if count.iter().any(|c| *c < 4.0) {
        return Vec::new();
    }
    let mean: Vec<f64> = sum.iter().zip(count).map(|(s, n)| s / n).collect();
    let sd = |b: usize| ((square[b] / count[b] - mean[b] * mean[b]).max(0.0) / count[b]).sqrt();
    let top = mean.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let acts: Vec<bool> = (0..BINS).map(|b| mean[b].abs() >= LARGE * top && mean[b].abs() > CLEAR * sd(b)).collect();
    let Some(gap) = acts.iter().position(|a| !a) else { return Vec::new() };
    if !acts.contains(&true) {
        return Vec::new();
    }
    // Neighbouring bins are one occasion; the walk begins in a gap, so that none is cut at the end of the cycle.
    let mut out: Vec<(f64, f64)> = Vec::new();
    let (mut weight, mut moment) = (0.0, 0.0);
    for i in 0..=BINS {
        let b = (gap + i) % BINS;
        if acts[b] && i < BINS {
            weight += mean[b].abs();
            moment += mean[b].abs() * ((gap + i) as f64 + 0.5) / BINS as f64;
        } else if weight > 0.0 {
            out.push((weight, (moment / weight).rem_euclid(1.0)));
            (weight, moment) = (0.0, 0.0);
        }
    }
    out.sort_by(|a, b| b.0.total_cmp(&a.0));
    out.into_iter().map(|(_, phase)| (1e3 * phase).round() / 1e3).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::rng::SplitMix64;

    fn force(of: impl Fn(f64) -> f64, noise: f64) -> Force {
        let mut random = SplitMix64::new(1);
        let mut f = Force { modes: vec!["flight".into(), "stance".into()], ..Force::default() };
        for k in 0..4000 {
            let phase = (f64::from(k) * 0.0123).fract();
            f.phase.push(phase);
            f.mode.push(usize::from(phase < 0.3));
            f.force.push(of(phase) + noise * random.normal());
        }
        f
    }

    #[test]
    fn two_bumps_are_two_occasions_also_across_the_end_of_the_cycle() {
        let bump = |p: f64, at: f64, size: f64| {
            let d = ((p - at + 0.5).rem_euclid(1.0) - 0.5) / 0.03;
            size * (-d * d).exp()
        };
        let found = phases(&[force(|p| bump(p, 0.22, 1.0) - bump(p, 0.995, 2.0), 0.1)]);
        assert_eq!(found.len(), 2);
        assert!((found[0] - 0.995).abs() < 0.01 && (found[1] - 0.22).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn what_acts_throughout_or_not_at_all_has_no_occasion() {
        assert!(phases(&[force(|_| 1.0, 0.1)]).is_empty());
        assert!(phases(&[force(|_| 0.0, 0.1)]).is_empty());
    }

    #[test]
    fn a_force_of_one_mode_is_of_that_mode() {
        assert_eq!(mode(&[force(|p| if p < 0.3 { 1.0 } else { 0.0 }, 0.01)]).as_deref(), Some("stance"));
        assert_eq!(mode(&[force(|_| 1.0, 0.01)]), None);
    }
}
