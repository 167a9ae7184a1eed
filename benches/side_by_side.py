"""Races ltp against pydiffsol and SciPy on one problem in one run: 100 s of the three-mode hopper, 219 events.

Owns: the comparison that the README quotes. Prints time (best of several), error in y(100 s) against the closed form,
and ratios; then whether the two bars are met: not slower than pydiffsol at equal or smaller error, and at least 50
times faster than `scipy.integrate.solve_ivp` with events and a restart loop. Times depend on the machine and its load,
so nothing is asserted; the bars print PASS or FAIL. A peer that is not installed is left out (`pip install pydiffsol`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

import ltp

T_END = 100.0
Y_END = 1.056924001461816  # m, closed form with event times to machine precision (tests/oracles/closed_forms.rs)
M, G, K, C, L0, L1 = 1.0, 9.81, 400.0, 2.0, 1.0, 1.05


@dataclass(frozen=True)
class Row:
    """One competitor: what it is, its best time (s), its error in y(100 s) (m)."""

    tool: str
    setting: str
    seconds: float
    error: float


def best(run: Callable[[], float], repeats: int) -> tuple[float, float]:
    """The shortest of several runs (s), and what the last one gave for y(100 s)."""
    run()
    seconds, y = np.inf, np.nan
    for _ in range(repeats):
        start = time.perf_counter()
        y = run()
        seconds = min(seconds, time.perf_counter() - start)
    return seconds, y


def race_ltp() -> list[Row]:
    """Our own engine, at several fixed steps, called from Python as a user would."""
    model = ltp.zoo.three_mode_hopper()

    def run(step: float) -> float:
        return float(ltp.simulate(model, t_end=T_END, dt=1.0, step=step).states[-1, 0])

    rows = []
    for step in (1e-2, 5e-3, 2.5e-3, 1e-3, 5e-4):
        seconds, y = best(partial(run, step), 20)
        rows.append(Row("ltp", f"h = {step:g} s", seconds, abs(y - Y_END)))
    return rows


# `N` is the number of the stop that fired last, so the stops stand in the order of the modes they lead to; a gate keeps
# the guards of the other modes away from zero.
DIFFSL = f"""
flight_i {{ 1.0, 0.0, 0.0 }}
compression_i {{ 0.0, 1.0, 0.0 }}
thrust_i {{ 0.0, 0.0, 1.0 }}
u_i {{ y = 1.2, v = 0.0 }}
F_i {{
  v,
  -{G} + compression_i[N] * (-{K}*(y - {L0}) - {C}*v)/{M} + thrust_i[N] * (-{K}*(y - {L1}) - {C}*v)/{M},
}}
stop_i {{
  thrust_i[N] * (y - {L1}) + (1.0 - thrust_i[N]),
  flight_i[N] * (y - {L0}) + (1.0 - flight_i[N]),
  compression_i[N] * v + (1.0 - compression_i[N]),
}}
reset_i {{ y, v }}
out_i {{ y }}
"""


def race_pydiffsol() -> list[Row]:
    """pydiffsol's hybrid DSL with its explicit Runge-Kutta method, compiled beforehand; 101 samples, as for ltp."""
    try:
        import pydiffsol
    except ImportError:
        print("pydiffsol is not installed and left out: pip install pydiffsol")
        return []
    ode = pydiffsol.Ode(DIFFSL, matrix_type=pydiffsol.nalgebra_dense, ode_solver=pydiffsol.tsit45)
    samples = np.linspace(0.0, T_END, 101)

    def run() -> float:
        return float(ode.solve_dense(np.array([]), samples).ys[0, -1])

    rows = []
    for tolerance in (1e-6, 1e-9, 1e-11):
        ode.rtol = ode.atol = tolerance
        seconds, y = best(run, 20)
        rows.append(Row("pydiffsol", f"tsit45 {tolerance:g}", seconds, abs(y - Y_END)))
    return rows


def race_scipy() -> list[Row]:
    """`solve_ivp` with one terminal event per mode, restarted after each."""

    def flow(rest: float | None) -> Callable[[float, np.ndarray], list[float]]:
        if rest is None:
            return lambda t, x: [x[1], -G]
        return lambda t, x: [x[1], (-K * (x[0] - rest) - C * x[1]) / M - G]

    def event(guard: Callable[[np.ndarray], float], direction: int) -> Callable[[float, np.ndarray], float]:
        def crossing(t: float, x: np.ndarray) -> float:
            return guard(x)

        crossing.terminal = True  # type: ignore[attr-defined]
        crossing.direction = direction  # type: ignore[attr-defined]
        return crossing

    modes = [
        (flow(None), event(lambda x: x[0] - L0, -1)),
        (flow(L0), event(lambda x: x[1], 1)),
        (flow(L1), event(lambda x: x[0] - L1, 1)),
    ]

    def run(method: str, tolerance: float) -> float:
        t, x, mode = 0.0, np.array([1.2, 0.0]), 0
        while t < T_END:
            rates, crossing = modes[mode]
            part = solve_ivp(rates, (t, T_END), x, method=method, rtol=tolerance, atol=tolerance, events=crossing)
            t, x, mode = float(part.t[-1]), part.y[:, -1], (mode + 1) % 3
        return float(x[0])

    rows = []
    for method, tolerance in (("RK45", 1e-9), ("DOP853", 1e-10)):
        seconds, y = best(partial(run, method, tolerance), 3)
        rows.append(Row("scipy", f"{method} {tolerance:g}", seconds, abs(y - Y_END)))
    return rows


def fastest_within(rows: list[Row], error: float) -> Row | None:
    """The fastest of `rows` whose error is at most `error`."""
    return min((row for row in rows if row.error <= error), key=lambda row: row.seconds, default=None)


def compare(ours: list[Row], theirs: list[Row], factor: float) -> None:
    """Prints, for each row of a peer, our fastest row of equal or smaller error, and whether `factor` is reached."""
    for row in theirs:
        match = fastest_within(ours, row.error)
        name = f"{row.tool} {row.setting}"
        if match is None:
            print(f"  {name:22} no setting of ours is as accurate: FAIL")
            continue
        ratio = row.seconds / match.seconds
        verdict = "PASS" if ratio >= factor else "FAIL"
        print(f"  {name:22} against ltp {match.setting:14} {ratio:7.2f} x  (bar {factor:g} x)  {verdict}")


def main() -> None:
    """Runs the race and prints the table and the bars."""
    ours, diffsol, scipy = race_ltp(), race_pydiffsol(), race_scipy()
    print(f"three-mode hopper, {T_END:g} s, 219 events, from Python; best of several runs")
    print(f"  {'tool':10} {'setting':14} {'time':>10}   error in y({T_END:g} s)")
    for row in [*ours, *diffsol, *scipy]:
        print(f"  {row.tool:10} {row.setting:14} {1e3 * row.seconds:7.2f} ms   {row.error:.1e} m")
    print("not slower than pydiffsol at equal or smaller error:")
    compare(ours, diffsol, 1.0)
    print("at least 50 times faster than scipy.solve_ivp with events, at equal or smaller error:")
    compare(ours, scipy, 50.0)


if __name__ == "__main__":
    main()
