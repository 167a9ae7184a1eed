//! What an event does to sensitivities: the saltation matrix, with the flow of the mode before on one side and the flow
//! of the mode after on the other.
//!
//! At `g(t, x, u, p) = 0` with reset `x+ = R(t, x-, u, p)` the event time moves by
//! `dt = -(g_x S + g_p) / (g_x f- + g_t + g_u du/dt)` and
//! `S+ = R_x (S + f- dt) + R_p + (R_t + R_u du/dt - f+) dt`
//! (Aizerman & Gantmacher 1958; Kong et al., Proc. IEEE 2024). The event time's own sensitivity is `dt`.

/// Lengths of a hybrid system.
#[derive(Clone, Copy)]
pub(super) struct Sizes {
    pub nx: usize,
    pub nf: usize,
    pub nu: usize,
}

/// Rate of the guard along the flow before the event; the crossing is transversal when it is far from zero.
pub(super) fn guard_rate(sizes: Sizes, guard: &[f64], f_before: &[f64], u_rate: &[f64]) -> f64 {
    let Sizes { nx, nf, .. } = sizes;
    let gx = &guard[1..1 + nx];
    let gt = guard[1 + nx + nf];
    let gu = &guard[2 + nx + nf..];
    dot(gx, f_before) + gt + dot(gu, u_rate)
}

/// Sensitivities after the event, in place. `guard` is `None` where the event time is fixed (a jump of the input, a tick).
pub(super) fn apply(
    sizes: Sizes,
    guard: Option<&[f64]>,
    reset: &[f64],
    f_before: &[f64],
    f_after: &[f64],
    u_rate: &[f64],
    s: &mut [f64],
) {
    let Sizes { nx, nf, nu } = sizes;
    let ns = nx + nf;
    let rx = &reset[nx..nx + nx * nx];
    let rp = &reset[nx + nx * nx..nx + nx * nx + nx * nf];
    let rt = &reset[nx + nx * nx + nx * nf..2 * nx + nx * nx + nx * nf];
    let ru = &reset[2 * nx + nx * nx + nx * nf..];
    let mut dt = vec![0.0; ns];
    if let Some(g) = guard {
        let rate = guard_rate(sizes, g, f_before, u_rate);
        for (c, dt) in dt.iter_mut().enumerate() {
            let mut moved: f64 = (0..nx).map(|r| g[1 + r] * s[r * ns + c]).sum();
            if c >= nx {
                moved += g[1 + nx + c - nx];
            }
            *dt = -moved / rate;
        }
    }
    let mut after = vec![0.0; nx * ns];
    for r in 0..nx {
        let jump = rt[r] + dot(&ru[r * nu..(r + 1) * nu], u_rate) - f_after[r];
        for c in 0..ns {
            let mut v = jump * dt[c];
            for k in 0..nx {
                v += rx[r * nx + k] * (s[k * ns + c] + f_before[k] * dt[c]);
            }
            if c >= nx {
                v += rp[r * nf + c - nx];
            }
            after[r * ns + c] = v;
        }
    }
    s.copy_from_slice(&after);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
