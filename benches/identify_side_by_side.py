"""Races ltp's two routes through Siddiqi's least squares against LAPACK's banded Cholesky on one system in one run.

Owns: the comparison that the page on identification quotes. The system is the paper's (Uyanik et al. 2015): 21
harmonics, 21 chirps from 0 to 5 Hz in 20 s, a record of 1400 periods of 0.33 s, 33 545 output frequencies, 704 445
complex unknowns, half-bandwidth 42. Every competitor runs in a process of its own, so that threads and memory are its
own; rounds alternate, and the best of each counts. Prints times, ratios, peak memory and differences, then PASS or FAIL
for each bar; times depend on the machine and its load, so nothing is asserted.

`python benches/identify_side_by_side.py [ROUNDS]`
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

PERIOD, PERIODS, DT, K, SMOOTHNESS = 0.33, 1400, 1e-3, 10, 10.0
N = 2 * K + 1
Complex = npt.NDArray[np.complex128]
# solves the system, which holds so many bytes already
Solver = tuple[Callable[[], Complex], int]


def system() -> tuple[Complex, Complex]:
    """Rows and data at all output frequencies, from the top down to its mirror image."""
    n = round(PERIODS * PERIOD / DT)
    t = np.arange(n) * DT
    u = np.where(t < 420.0, np.sin(0.25 * np.pi * np.mod(t, 20.0) ** 2), 0.0)
    lines = np.fft.rfft(u)
    df = 1.0 / (PERIODS * PERIOD)
    top = int((5.0 + K / PERIOD + 1.0) / df + 1e-9)
    lines /= np.sqrt(np.mean(np.abs(lines[: int(5.0 / df) + 1]) ** 2))
    bins = np.arange(top, -top - 1, -1)[:, None] - PERIODS * np.arange(-K, K + 1)[None, :]
    rows = np.where(bins < 0, lines[np.abs(bins)].conj(), lines[np.abs(bins)])
    k = np.arange(-K, K + 1)
    response = 1.0 / (1.0 + k**2 + 2j * np.pi * df * bins * 0.1)
    noise = np.random.default_rng(1).standard_normal((top + 1, 2)) @ np.array([1.0, 1j]) * 1e-3
    noise[-1] = noise[-1].real
    return rows, (rows * response).sum(axis=1) + np.concatenate([noise, noise[-2::-1].conj()])


def band(rows: Complex) -> Complex:
    """The lower band of the normal equations, as LAPACK has it."""
    steps = len(rows)
    ab = np.zeros((2 * N + 1, steps * N), dtype=complex, order="F")
    for below in range(N):
        ab[below].reshape(steps, N)[:, : N - below] = rows[:, below:].conj() * rows[:, : N - below]
    weight = np.zeros(steps + 4)
    weight[3 : steps + 1] = SMOOTHNESS  # of the second difference around step s, at s + 2
    before, here, after = weight[1 : steps + 1], weight[2 : steps + 2], weight[3 : steps + 3]
    ab[0] += np.repeat(before + 4.0 * here + after, N)
    ab[N] += np.repeat(-2.0 * (here + after), N)
    ab[2 * N] += np.repeat(after, N)
    ab[N, -N:] = 0.0
    return ab


def memory_from_here() -> int:
    """Forgets the largest resident memory of this process so far (Linux), and returns the present one, bytes."""
    Path("/proc/self/clear_refs").write_text("5")
    return status("VmRSS")


def status(field: str) -> int:
    """A figure of this process, bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(field))


def lapack(rows: Complex, y: Complex) -> Solver:
    from scipy.linalg import solveh_banded

    ab, b = band(rows), (rows.conj() * y[:, None]).ravel()
    return lambda: solveh_banded(ab, b, lower=True, overwrite_ab=True, overwrite_b=True, check_finite=False), ab.nbytes


def banded(rows: Complex, y: Complex) -> Solver:
    from ltp import _ltp

    b, before = (rows.conj() * y[:, None]).ravel(), status("VmRSS")
    normal = _ltp.NormalBand(rows, SMOOTHNESS)

    def solve() -> Complex:
        normal.factor()
        return normal.solve(b)

    return solve, max(normal.bytes, status("VmRSS") - before)


def smoother(rows: Complex, y: Complex) -> Solver:
    from ltp import _ltp

    half = len(rows) // 2 + 1
    return lambda: _ltp.smooth(rows[:half], y[:half], SMOOTHNESS, True), 0


def two_sided(rows: Complex, y: Complex) -> Solver:
    from ltp import _ltp

    return lambda: _ltp.smooth(rows, y, SMOOTHNESS, False), 0


FIELD = {"lapack": lapack, "banded": banded, "smoother": smoother, "two-sided smoother": two_sided}


def compete(who: str, folder: str) -> None:
    """One competitor, in a process of its own: prints seconds and bytes, leaves the solution of the upper half.

    A first solution warms the process up; the matrix is made anew for the second, which counts.
    """
    rows, y = np.load(f"{folder}/rows.npy"), np.load(f"{folder}/y.npy")
    FIELD[who](rows, y)[0]()
    solve, given = FIELD[who](rows, y)
    before = memory_from_here() - given
    start = time.perf_counter()
    x = solve()
    seconds = time.perf_counter() - start
    used = status("VmHWM") - before
    np.save(f"{folder}/{who}.npy", x.reshape(-1, N)[: len(rows) // 2 + 1])
    print(json.dumps({"seconds": seconds, "bytes": used}))


def run(who: str, threads: int, folder: str) -> dict[str, float]:
    """Time and memory of one competitor on so many threads."""
    names = ("RAYON_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    limits = dict.fromkeys(names, str(threads))
    command = [sys.executable, __file__, "--compete", who, folder]
    done = subprocess.run(command, env=os.environ | limits, check=True, capture_output=True, text=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def verdict(bar: str, value: float, least: float) -> None:
    print(f"{'PASS' if value >= least else 'FAIL'}  {bar}: {value:.2f} (bar {least})")


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    with tempfile.TemporaryDirectory() as folder:
        rows, y = system()
        np.save(f"{folder}/rows.npy", rows)
        np.save(f"{folder}/y.npy", y)
        frequencies = len(rows)
        print(f"{frequencies} frequencies, {frequencies * N} complex unknowns, half-bandwidth {2 * N}")
        field = [(who, threads) for who in FIELD for threads in (1, 2) if threads == 1 or who in ("lapack", "banded")]
        seconds: dict[tuple[str, int], float] = {}
        memory: dict[tuple[str, int], float] = {}
        for _ in range(rounds):
            for entry in field:
                found = run(*entry, folder)
                seconds[entry] = min(seconds.get(entry, np.inf), found["seconds"])
                memory[entry] = max(memory.get(entry, 0.0), found["bytes"])
        for who, threads in field:
            mib = memory[who, threads] / 2**20
            words = f"{who:20} {threads} thread{'s' * (threads > 1):1}"
            print(f"{words}  {seconds[who, threads] * 1e3:8.1f} ms  {mib:7.1f} MiB")
        answers = {who: np.load(Path(folder) / f"{who}.npy") for who in {who for who, _ in field}}
        largest = np.abs(answers["smoother"]).max()
        for who in ("lapack", "banded", "two-sided smoother"):
            apart = np.abs(answers[who] - answers["smoother"]).max() / largest
            print(f"largest difference of {who} from smoother, relative: {apart:.1e}")
        one, two = seconds["lapack", 1], seconds["lapack", 2]
        size = 16 * (2 * N + 1) * frequencies * N
        verdict("banded against LAPACK, one thread each, times faster", one / seconds["banded", 1], 1.0)
        verdict("banded on two threads against LAPACK's better", min(one, two) / seconds["banded", 2], 1.6)
        verdict("banded: two threads against one", seconds["banded", 1] / seconds["banded", 2], 1.0)
        verdict("banded: 1.2 bands over its memory", 1.2 * size / memory["banded", 1], 1.0)
        verdict("smoother against LAPACK, one thread each, times faster", one / seconds["smoother", 1], 15.0)
        verdict("smoother: LAPACK's memory over its own", memory["lapack", 1] / memory["smoother", 1], 8.0)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--compete"]:
        compete(sys.argv[2], sys.argv[3])
    else:
        main()
