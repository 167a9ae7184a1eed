//! Between samples: where a run pauses, and what sensors that are late or have play make of a motion.

use super::machine::Machine;

/// Points of the grid between samples on which the play of a sensor is walked.
const PLAY: usize = 32;

/// An instant between samples at which the run pauses.
pub struct Stop {
    /// Seconds after the sample.
    pub after: f64,
    /// Whether the motion is looked at.
    pub look: bool,
    /// The sensor that is late and looks here.
    pub late: Option<usize>,
}

/// Where straight lines of delayed inputs meet, where late sensors look, the grid of play, and the next sample.
pub fn stops(machine: &Machine, dt: f64) -> Vec<Stop> {
    let mut out = Vec::new();
    let inside = |d: f64| (1e-9 * dt..(1.0 - 1e-9) * dt).contains(&d);
    for d in machine.delays().map(|d| d % dt).filter(|d| inside(*d)) {
        out.push(Stop { after: d, look: false, late: None });
    }
    for (j, s) in machine.sensors.iter().enumerate() {
        let after = dt - s.delay % dt;
        if s.delay > 0.0 {
            out.push(Stop { after: if inside(after) { after } else { 0.5 * dt }, look: true, late: Some(j) });
        }
        if s.gap > 0.0 {
            out.extend((1..PLAY).map(|i| Stop { after: dt * i as f64 / PLAY as f64, look: true, late: None }));
        }
    }
    out.sort_by(|a, b| a.after.total_cmp(&b.after));
    out.push(Stop { after: dt, look: false, late: None });
    out
}

/// The value of a sensor that is late: `seen` holds alternately samples and what was seen before the next sample.
pub fn delayed(seen: &[f64], delay: f64, dt: f64) -> f64 {
    let now = seen.len() as i64 - 1;
    let whole = (delay / dt + 1e-9).floor();
    let on_grid = (delay - whole * dt).abs() < 1e-8 * dt;
    let back = 2 * whole as i64 + i64::from(!on_grid);
    seen[(now - back).max(0) as usize]
}

/// Play: the sensor follows only when the motion has crossed the gap.
pub fn slack(held: &mut Option<f64>, y: f64, gap: f64) {
    if gap > 0.0 {
        let half = 0.5 * gap;
        *held = Some(held.unwrap_or(y).clamp(y - half, y + half));
    }
}
