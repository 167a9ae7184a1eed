"""Races the closed-loop objectives of ltp.control against numpy's eigenvalues and scipy's optimisers, in one run.

Owns: the comparison that the page on feedback quotes. The system is the cart-pendulum of Duyul's thesis on a closed
orbit, its cart held by a weak spring; one evaluation is largest real part and gradient of the lifted closed loop (ltp,
called from Python) against `numpy.linalg.eigvals` of the same matrix, ready assembled and without gradient. Designs
minimise the same objective under the same limit on the gain. One thread each; the best of the rounds counts. Prints
times, ratios and differences, then PASS or FAIL for each bar; times depend on the machine and its load, so nothing is
asserted.

`python benches/control_side_by_side.py [ROUNDS]`
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import scipy.optimize

import ltp

LIMIT = 200.0
GAIN = np.array([69.69, -2.01, 19.62, 6.54])


def plant() -> ltp.LtpSystem:
    """The hanging cart-pendulum under a sine of voltage, with a spring that keeps the cart from drifting."""
    text = ltp.zoo.text("cart_pendulum")
    for old, new in (
        ('"K_g*K_t/(R_m*r_mp)*V -', '"K_g*K_t/(R_m*r_mp)*(V + V_0*sin(2*pi*t/T)) -'),
        ('"F - B_eq*v +', '"F - B_eq*v - k_c*x +'),
        (
            "[parameters]",
            '[clock]\nperiod = "T"\n\n[parameters]\nV_0 = { value = 2.5, unit = "V" }\n'
            'T = { value = 1.0, unit = "s" }\nk_c = { value = 5.0, unit = "N/m" }',
        ),
    ):
        assert old in text, old
        text = text.replace(old, new)
    model = ltp.Model.from_toml(text)
    return ltp.linearize(model, ltp.cycle(model))


def lifted(lin: ltp.LtpSystem, n: int) -> npt.NDArray[np.complex128]:
    """The matrix A - N - B K of the closed loop, blocks -n to n."""
    samples = np.array([lin.B(t) for t in np.arange(256) * lin.period / 256])
    coefficients = np.fft.fft(samples, axis=0) / 256
    blocks = range(2 * n + 1)
    b = np.block([[coefficients[i - j] for j in blocks] for i in blocks])
    return lin.lift(n) - b @ np.kron(np.eye(2 * n + 1), GAIN[None, :])


def best_of(rounds: int, calls: int, work: Callable[[], object]) -> float:
    """Seconds for one call: the best round."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        for _ in range(calls):
            work()
        times.append((time.perf_counter() - start) / calls)
    return min(times)


def evaluations(lin: ltp.LtpSystem, rounds: int) -> None:
    print("one evaluation           numpy eigvals    ltp, with gradient    ratio   difference")
    for n in (2, 5, 10, 20):
        matrix, closed = lifted(lin, n), ltp.Objective(lin, truncation=n)
        ours = theirs = np.inf
        for _ in range(rounds):
            theirs = min(theirs, best_of(1, max(4, 200 // n), lambda m=matrix: np.linalg.eigvals(m)))
            ours = min(ours, best_of(1, max(4, 200 // n), lambda c=closed: c(GAIN)))
        difference = abs(np.linalg.eigvals(matrix).real.max() - closed(GAIN)[0])
        times = f"{1e6 * theirs:10.1f} us  {1e6 * ours:14.1f} us  {theirs / ours:10.1f}"
        print(f"lifted, N = {n:<2} {len(matrix):4d}  {times}   {difference:.1e}")
        if n == 2:
            verdict = "PASS" if theirs / ours >= 3.0 and ours <= 1e-4 else "FAIL"
            print(f"{verdict}: bars are a ratio of 3 and 0.1 ms")
    exact = ltp.Objective(lin, objective="floquet")
    ours = best_of(rounds, 200, lambda: exact(GAIN))
    print(
        f"exact exponents, with gradient {1e6 * ours:.1f} us\n{'PASS' if ours <= 5e-5 else 'FAIL'}: the bar is 0.05 ms"
    )


def designs(lin: ltp.LtpSystem) -> None:
    closed = ltp.Objective(lin)
    calls = 0

    def value(x: npt.NDArray[np.float64]) -> float:
        nonlocal calls
        calls += 1
        return closed(x)[0]

    print(f"\none design, lifted N = 2, norm of the gain <= {LIMIT:g}")
    for seed in range(3):
        start = time.perf_counter()
        found = ltp.control(lin, limit=LIMIT, seed=seed)
        seconds = time.perf_counter() - start
        print(
            f"ltp, seed {seed}:               {found.figures['objective, 1/s']:9.4f} 1/s  {seconds:7.2f} s  "
            f"{found.figures['evaluations']:7.0f} evaluations"
        )
    inside = {"type": "ineq", "fun": lambda x: 1.0 - x @ x / LIMIT**2, "jac": lambda x: -2.0 * x / LIMIT**2}
    for seed in range(3):
        random, start, calls = np.random.default_rng(seed), time.perf_counter(), 0
        runs = [
            scipy.optimize.minimize(
                value,
                LIMIT / 4 * random.standard_normal(4),
                jac=lambda x: closed(x)[1],
                method="SLSQP",
                constraints=[inside],
            )
            for _ in range(10)
        ]
        kept = [run.fun for run in runs if run.x @ run.x <= LIMIT**2 * (1 + 1e-6)]
        spent = f"{time.perf_counter() - start:7.2f} s  {calls:7d} evaluations"
        print(f"SLSQP, 10 starts, seed {seed}:  {min(kept):9.4f} 1/s  {spent}; worst start {max(kept):.2f}")
    for seed in range(3):
        start, calls = time.perf_counter(), 0
        sphere = scipy.optimize.NonlinearConstraint(lambda x: x @ x, 0.0, LIMIT**2)
        run = scipy.optimize.differential_evolution(
            value, [(-LIMIT, LIMIT)] * 4, constraints=[sphere], rng=seed, polish=False, maxiter=600, tol=0.0
        )
        spent = f"{time.perf_counter() - start:7.2f} s  {calls:7d} evaluations"
        print(f"scipy's evolution, seed {seed}: {run.fun:9.4f} 1/s  {spent}")


if __name__ == "__main__":
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"), "1")
    if any(os.environ.get(name) != "1" for name in one):
        sys.exit(subprocess.run([sys.executable, *sys.argv], env=os.environ | one, check=False).returncode)
    system = plant()
    evaluations(system, int(sys.argv[1]) if len(sys.argv) > 1 else 15)
    designs(system)
