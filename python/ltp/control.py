"""Owns `ltp.control` in Python: designs of state feedback for linear time-periodic systems."""

from __future__ import annotations

import warnings as python_warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.feedback import Array, Complex, Feedback, numbers
from ltp.linearize import LtpSystem

if TYPE_CHECKING:
    from ltp.closed_loop import SimulationCost

#: Bounds on K Q K^T of the constant part: Q (nx, nx), least, most; `None` leaves a bound out.
Form = tuple[npt.ArrayLike, float | None, float | None]


class Objective:
    """What a design by harmonic balance minimises, for other optimisers: the largest real part of the closed loop.

    Unknowns are the numbers of K_0, then of Re K_h and of Im K_h for each other harmonic, row-major.
    """

    def __init__(
        self,
        lin: LtpSystem,
        *,
        objective: str = "lifted",
        modes: str = "all",
        truncation: int = 2,
        harmonics: Sequence[int] = (0,),
    ) -> None:
        self._core = _ltp.Objective(lin._core, objective, modes, truncation, list(harmonics))

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self._core.unknowns

    def __call__(self, x: npt.ArrayLike) -> tuple[float, Array]:
        """Largest real part (1/s) at the unknowns `x` (n,), and its gradient (n,): a subgradient at a kink."""
        return self._core.at(np.atleast_1d(numbers("x", x)))


def control(
    lin: LtpSystem,
    method: str = "harmonic-balance",
    *,
    truncation: int = 2,
    modes: str = "all",
    objective: str = "lifted",
    limit: float | None = None,
    fastest: float | None = None,
    slowest: float | None = None,
    quadratic: Sequence[Form] = (),
    damping: float | None = None,
    imaginary: float | None = None,
    harmonics: Sequence[int] | None = None,
    variants: Sequence[LtpSystem] = (),
    start: Feedback | npt.ArrayLike | None = None,
    search: str = "global",
    seed: int = 0,
    budget: int | None = None,
    state_weights: npt.ArrayLike | None = None,
    input_weights: npt.ArrayLike | None = None,
    shift: float = 0.0,
    cost: SimulationCost | None = None,
) -> Feedback:
    """State feedback `u = -K(t) x` for a smooth linear time-periodic system.

    method="harmonic-balance" minimises the largest real part of the closed loop: of the lift truncated at `truncation`
    harmonics (`objective="lifted"`, over `modes` "all" or "central"), or of the exact Floquet exponents ("floquet");
    with `variants` (systems of the same period and size) the worst of all. `harmonics` are those of the gain, (0,) a
    constant one, (0, 2) `K_0 + Re(K_2 e^{2jwt})`. Constraints: `limit` on the norm of all numbers of the gain (without
    one the gain often runs off), `fastest` (all real parts above -fastest, 1/s), `slowest` (some real part below
    -slowest), `quadratic` bounds (Q, least, most) on K_0 Q K_0^T, `damping` (least damping ratio of the central modes)
    or `imaginary` (largest imaginary part, rad/s). `search` is "global", "swarm" (the published Algorithm 1) or "local"
    (from `start`); one `seed` gives one result, within about `budget` evaluations.

    method="periodic-lqr" minimises the integral of x'Qx + u'Ru with `state_weights` Q, (nx, nx) or its diagonal, and
    `input_weights` R, (nu, nu), its diagonal or a number; exponents are below `-shift` (1/s). With `harmonics`, only
    those of its gain are kept.

    method="simulation" minimises `cost`, an `ltp.simulation_cost`, by the published swarm, under `limit` on the norm.

    Raises `InputError` for a pair that cannot be stabilised, constraints that cannot be kept (which, by how much), a
    truncation too low (which suffices), wrong shapes and unknown names; `ConvergenceError` where no regulator exists.
    Doubts are in the result, and warned of.

    References: Duyul, M.Sc. thesis, METU 2018, (3.11) to (3.18); Bittanti, Colaneri, Periodic Systems, 2009.
    """
    if method == "harmonic-balance":
        core = _ltp.harmonic_balance(
            lin._core,
            [variant._core for variant in variants],
            objective=objective,
            modes=modes,
            truncation=truncation,
            harmonics=[0] if harmonics is None else list(harmonics),
            limit=limit,
            fastest=fastest,
            slowest=slowest,
            quadratic=[(_square("quadratic: Q", q), low, high) for q, low, high in quadratic],
            damping=damping,
            imaginary=imaginary,
            start=None if start is None else _feedback(start, lin)._core,
            search=search,
            seed=seed,
            budget=budget,
        )
    elif method == "periodic-lqr":
        if state_weights is None or input_weights is None:
            raise InputError("control: method 'periodic-lqr' needs state_weights= and input_weights=; give both")
        core = _ltp.periodic_lqr(
            lin._core,
            _square("state_weights", state_weights),
            _square("input_weights", input_weights),
            float(shift),
            None if harmonics is None else list(harmonics),
        )
    elif method == "simulation":
        if cost is None or limit is None:
            raise InputError("control: method 'simulation' needs cost=ltp.simulation_cost(...) and limit=; give both")
        return cost.design(limit=limit, seed=seed, **({} if budget is None else {"budget": budget}))
    else:
        known = "'harmonic-balance', 'periodic-lqr' or 'simulation'"
        raise InputError(f"control: there is no method {method!r}; choose {known}")
    feedback = Feedback.wrap(core)
    for warning in feedback.warnings:
        python_warnings.warn(f"control: {warning}", stacklevel=2)
    return feedback


def closed_loop_eigenvalues(lin: LtpSystem, gain: Feedback | npt.ArrayLike, truncation: int) -> Complex:
    """All eigenvalues of the lifted closed loop A - N - B K, ((2N+1) nx,), largest real part first.

    Edge blocks are cut: `lin.closed(gain).exponents` are what they approximate. Raises `InputError` as `control`.
    """
    return _ltp.closed_loop_eigenvalues(lin._core, _feedback(gain, lin)._core, truncation)


def _feedback(gain: Feedback | npt.ArrayLike, lin: LtpSystem) -> Feedback:
    return gain if isinstance(gain, Feedback) else Feedback.constant(gain, lin.period)


def _square(name: str, values: npt.ArrayLike) -> Array:
    """A square matrix from itself, its diagonal or a number."""
    array = numbers(name, values)
    return np.diag(np.atleast_1d(array)) if array.ndim < 2 else np.ascontiguousarray(array)
