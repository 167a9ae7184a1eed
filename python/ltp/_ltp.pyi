# Owns the types of the compiled extension `ltp._ltp`: the whole surface between Python and Rust, nothing else.
# Checked against the built extension by `mypy.stubtest`. Shapes: n samples, nx states, nu inputs, ny outputs.
# Units: SI and radians, except an output whose document declares another unit (deg, mm, Hz), which stays in that unit.

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypedDict, final, type_check_only

import numpy as np
import numpy.typing as npt

__all__ = [
    "ConvergenceError",
    "Diagnosis",
    "ExperimentPlan",
    "Feedback",
    "Floquet",
    "HeldOut",
    "Htf",
    "InputError",
    "LimitCycle",
    "LtpSystem",
    "Model",
    "Multisine",
    "NormalBand",
    "Objective",
    "PeriodicArx",
    "Phase",
    "Recording",
    "Reference",
    "SimulationCost",
    "Trajectory",
    "Transverse",
    "add_noise",
    "case_choices",
    "certify",
    "chirp",
    "close",
    "closed_loop_eigenvalues",
    "conceal",
    "cycle",
    "cycle_average",
    "diagnose",
    "draw_case",
    "e_rms",
    "effect_names",
    "effect_text",
    "feedforward",
    "harmonic_balance",
    "harmonic_map",
    "identify",
    "identify_arx",
    "identify_map",
    "isolability",
    "linearize",
    "linearize_along",
    "multisine_lines",
    "noise",
    "periodic_lqr",
    "phase_from_events",
    "phase_shifted_chirps",
    "relative_rms",
    "rests",
    "rms_error",
    "settling_periods",
    "simulate",
    "sine",
    "smooth",
    "step",
    "switch_events",
    "track",
    "unit_factor",
    "zoo_names",
    "zoo_text",
]

class InputError(ValueError): ...
class ConvergenceError(RuntimeError): ...

@type_check_only
class _Parameter(TypedDict):
    name: str
    value: float
    sd: float | None
    unit: str
    min: float | None
    max: float | None

@type_check_only
class _Estimate(TypedDict):
    value: float
    sd: float | None
    unit: str

@type_check_only
class _Effect(TypedDict):
    name: str
    at: str
    parameters: dict[str, _Estimate]

@type_check_only
class _Stop(TypedDict):
    reason: str
    time: float
    mode: str
    message: str

@type_check_only
class _Case(TypedDict):
    model: Model
    train: list[Recording]
    test: list[Recording]
    label: str

@type_check_only
class _Design(TypedDict):
    multisine: Multisine
    noise_sd: float | None
    sd: npt.NDArray[np.float64]
    band: npt.NDArray[np.float64]
    advice: list[str]

class _CycleAverage(TypedDict):
    phase: npt.NDArray[np.float64]
    mean: npt.NDArray[np.float64]
    spread: npt.NDArray[np.float64]
    within: npt.NDArray[np.float64]
    standard_error: npt.NDArray[np.float64]
    cycles: int
    groups: int

@type_check_only
class _StepResponse(TypedDict):
    t: npt.NDArray[np.float64]
    values: npt.NDArray[np.float64]
    sd: npt.NDArray[np.float64]

@type_check_only
class _SectionMap(TypedDict):
    claims: bool
    states: npt.NDArray[np.float64]
    matrix: npt.NDArray[np.float64]
    matrix_sd: npt.NDArray[np.float64]
    multipliers: npt.NDArray[np.complex128]
    magnitude: list[tuple[float, float]]
    pairs: int
    groups: int
    against_mean: tuple[float, float, float]
    against_previous: tuple[float, float, float]
    warnings: list[str]

@final
class Model:
    @staticmethod
    def from_toml(text: str, source: str, effects: Sequence[tuple[str, str]] = ...) -> Model: ...
    @staticmethod
    def from_json(text: str, source: str, effects: Sequence[tuple[str, str]] = ...) -> Model: ...
    def with_effects(self, effects: Sequence[tuple[str, str]]) -> Model: ...
    @property
    def library(self) -> list[str]: ...
    def places(self, effect: str) -> list[str]: ...
    def to_toml(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def description(self) -> str: ...
    @property
    def states(self) -> list[str]: ...
    @property
    def inputs(self) -> list[str]: ...
    @property
    def outputs(self) -> list[str]: ...
    @property
    def ports(self) -> list[str]: ...
    @property
    def modes(self) -> list[str]: ...
    @property
    def parameters(self) -> list[_Parameter]: ...
    @property
    def effects(self) -> list[_Effect]: ...
    def unit(self, name: str) -> str: ...
    def column(self, name: str) -> str: ...
    def input_default(self, name: str) -> float | None: ...
    def with_parameters(self, values: Mapping[str, float]) -> Model: ...
    def attach(self, effect: str, at: str, parameters: Mapping[str, float]) -> Model: ...

@final
class Recording:
    def __new__(
        cls,
        name: str,
        t: npt.NDArray[np.float64],
        inputs: npt.NDArray[np.float64],
        outputs: npt.NDArray[np.float64],
        input_names: Sequence[str],
        output_names: Sequence[str],
    ) -> Recording: ...
    @property
    def name(self) -> str: ...
    @property
    def t(self) -> npt.NDArray[np.float64]: ...
    @property
    def inputs(self) -> npt.NDArray[np.float64]: ...
    @property
    def outputs(self) -> npt.NDArray[np.float64]: ...
    @property
    def dt(self) -> float: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def input_names(self) -> list[str]: ...
    @property
    def output_names(self) -> list[str]: ...
    def restored(self, dt: float, warnings: Sequence[str]) -> Recording: ...
    def slice(self, start: float, end: float) -> Recording: ...

@final
class Trajectory:
    @property
    def t(self) -> npt.NDArray[np.float64]: ...
    @property
    def states(self) -> npt.NDArray[np.float64]: ...
    @property
    def inputs(self) -> npt.NDArray[np.float64]: ...
    @property
    def outputs(self) -> npt.NDArray[np.float64]: ...
    @property
    def mode(self) -> list[str]: ...
    @property
    def events(self) -> list[tuple[str, float, str, str]]: ...
    @property
    def stop(self) -> _Stop: ...
    @property
    def stats(self) -> dict[str, Any]: ...

@final
class Diagnosis:
    def json(self) -> str: ...
    def traces(self) -> dict[str, Any]: ...

@final
class Multisine:
    def __new__(
        cls,
        period: float,
        lines: Sequence[int],
        amplitudes: npt.NDArray[np.float64],
        phases: npt.NDArray[np.float64],
    ) -> Multisine: ...
    @staticmethod
    def random(
        period: float,
        lines: Sequence[int],
        weights: npt.NDArray[np.float64] | None,
        rms: float,
        crest_turns: int,
        seed: int,
    ) -> Multisine: ...
    @property
    def period(self) -> float: ...
    @property
    def lines(self) -> list[int]: ...
    @property
    def omega(self) -> npt.NDArray[np.float64]: ...
    @property
    def amplitudes(self) -> npt.NDArray[np.float64]: ...
    @property
    def phases(self) -> npt.NDArray[np.float64]: ...
    @property
    def rms(self) -> float: ...
    @property
    def crest(self) -> float: ...
    def samples(self, t_end: float, dt: float) -> npt.NDArray[np.float64]: ...

@final
class ExperimentPlan:
    def __new__(
        cls,
        period: float,
        band: tuple[float, float],
        duration: float,
        dt: float,
        repeats: int,
        settle: int | None,
        lines: str,
        half_pumping: str,
        count: int | None,
        spread: str,
    ) -> ExperimentPlan: ...
    @property
    def settle(self) -> int: ...
    @property
    def cycles(self) -> int: ...
    @property
    def omega(self) -> npt.NDArray[np.float64]: ...
    @property
    def times(self) -> tuple[float, float]: ...
    def design(
        self,
        gain: npt.NDArray[np.float64] | None,
        rms: float,
        power: float,
        noise_sd: float | None,
        snr: float | None,
        crest_turns: int,
        seed: int,
    ) -> _Design: ...

@final
class Htf:
    def __new__(
        cls,
        values: npt.NDArray[np.complex128],
        omega: npt.NDArray[np.float64],
        period: float,
        sd: npt.NDArray[np.float64] | None,
        coherence: npt.NDArray[np.float64] | None,
        method: str,
        figures: Mapping[str, float],
        warnings: Sequence[str],
    ) -> Htf: ...
    @property
    def values(self) -> npt.NDArray[np.complex128]: ...
    @property
    def omega(self) -> npt.NDArray[np.float64]: ...
    @property
    def period(self) -> float: ...
    @property
    def sd(self) -> npt.NDArray[np.float64] | None: ...
    @property
    def coherence(self) -> npt.NDArray[np.float64] | None: ...
    @property
    def method(self) -> str: ...
    @property
    def figures(self) -> dict[str, float]: ...
    @property
    def warnings(self) -> list[str]: ...
    def at(self, k: int, omega: npt.NDArray[np.float64], output: int, input: int) -> npt.NDArray[np.complex128]: ...
    def steady_state(
        self, omega: float, amplitude: float, phase: float, input: int, t: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]: ...
    def predict(
        self, u: npt.NDArray[np.float64], t0: float, dt: float
    ) -> tuple[npt.NDArray[np.float64], list[str]]: ...

@final
class Phase:
    @property
    def cycles(self) -> list[tuple[list[float], int, str | None]]: ...
    @property
    def marks(self) -> list[float]: ...
    @property
    def period(self) -> float: ...
    @property
    def warnings(self) -> list[str]: ...
    def at(self, t: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...

@final
class PeriodicArx:
    @property
    def noise_sd(self) -> list[float]: ...
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def groups(self) -> int: ...
    @property
    def warnings(self) -> list[str]: ...
    def predict(self, recording: Recording, phase: Phase) -> npt.NDArray[np.float64]: ...
    def step_response(self, input: str, phase: float, duration: float) -> _StepResponse: ...
    def held_out(self, recording: Recording, phase: Phase) -> HeldOut: ...

@final
class HeldOut:
    @property
    def group(self) -> list[int]: ...
    @property
    def prediction(self) -> npt.NDArray[np.float64]: ...
    @property
    def rms(self) -> list[list[float]]: ...
    @property
    def rms_by_group(self) -> list[list[list[float]]]: ...
    def ratio(self, rival: str | HeldOut, *, draws: int = 2000, seed: int = 0) -> list[tuple[float, float, float]]: ...

@final
class LimitCycle:
    @property
    def period(self) -> float: ...
    @property
    def autonomous(self) -> bool: ...
    @property
    def start(self) -> npt.NDArray[np.float64]: ...
    @property
    def found_from(self) -> npt.NDArray[np.float64]: ...
    def trajectory(self) -> Trajectory: ...
    @property
    def events(self) -> list[tuple[str, float, float, str, str]]: ...
    @property
    def monodromy(self) -> npt.NDArray[np.float64]: ...
    @property
    def multipliers(self) -> npt.NDArray[np.complex128]: ...
    @property
    def held(self) -> list[int]: ...
    @property
    def stable(self) -> bool: ...
    @property
    def stats(self) -> dict[str, float]: ...
    @property
    def domain(self) -> tuple[int, int, float] | None: ...
    @property
    def others(self) -> list[tuple[LimitCycle, int]]: ...
    @property
    def lost(self) -> list[tuple[list[float], str]]: ...
    @property
    def warnings(self) -> list[str]: ...

@final
class LtpSystem:
    @staticmethod
    def from_functions(
        period: float, size: tuple[int, int, int], matrix: Callable[[str, float], npt.NDArray[np.float64]]
    ) -> LtpSystem: ...
    @staticmethod
    def from_samples(
        period: float, size: tuple[int, int, int], matrices: Sequence[npt.NDArray[np.float64]]
    ) -> LtpSystem: ...
    def closed(self, period: float, gain: npt.NDArray[np.complex128]) -> LtpSystem: ...
    def exponents(self) -> npt.NDArray[np.complex128]: ...
    def floquet(self) -> Floquet: ...
    def lifted_modes(self, truncation: int) -> list[tuple[float, float, int, int, float, float, bool]]: ...
    def pumping_divisor(self) -> int: ...
    def shortened(self) -> LtpSystem: ...
    def bandwidth(self, share: float) -> int: ...
    def check_truncation(self, truncation: int) -> None: ...
    def transverse(self, tangent: npt.NDArray[np.complex128] | None) -> Transverse: ...
    @property
    def period(self) -> float: ...
    @property
    def size(self) -> tuple[int, int, int]: ...
    def matrix(self, name: str, t: float) -> npt.NDArray[np.float64]: ...
    @property
    def jumps(self) -> list[tuple[str, float, npt.NDArray[np.float64], npt.NDArray[np.float64]]]: ...
    @property
    def monodromy(self) -> npt.NDArray[np.float64]: ...
    @property
    def multipliers(self) -> npt.NDArray[np.complex128]: ...
    def simulate(self, u: npt.NDArray[np.float64], t0: float, dt: float) -> npt.NDArray[np.float64]: ...
    def select(self, inputs: Sequence[int], outputs: Sequence[int]) -> LtpSystem: ...
    def lift(self, truncation: int) -> npt.NDArray[np.complex128]: ...
    def lifted_htf(self, omega: npt.NDArray[np.float64], harmonics: int, truncation: int) -> Htf: ...
    def htf(self, omega: npt.NDArray[np.float64], harmonics: int) -> Htf: ...

@final
class Reference:
    @staticmethod
    def of_sinusoids(
        model: Model,
        omega: float,
        states: Sequence[tuple[str, float, float, float]],
        input: str,
        inputs: Mapping[str, float],
    ) -> Reference: ...
    @staticmethod
    def of_coefficients(
        model: Model, period: float, states: npt.NDArray[np.complex128], inputs: npt.NDArray[np.complex128]
    ) -> Reference: ...
    @property
    def period(self) -> float: ...
    @property
    def defect(self) -> list[float]: ...
    @property
    def amplitudes(self) -> npt.NDArray[np.float64]: ...
    @property
    def state_coefficients(self) -> npt.NDArray[np.complex128]: ...
    @property
    def input_coefficients(self) -> npt.NDArray[np.complex128]: ...
    def states(self, t: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def inputs(self, t: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def ahead(self, time: float) -> Reference: ...
    def shifted(self, state: int, amount: float) -> Reference: ...

def feedforward(
    model: Model,
    state: str,
    sinusoid: tuple[float, float, float],
    omega: float,
    *,
    harmonics: int,
    input: str,
    inputs: Mapping[str, float],
    start: Mapping[str, float] | None = None,
    start_from: Reference | None = None,
) -> Reference: ...

@final
class SimulationCost:
    def __new__(
        cls,
        model: Model,
        reference: Reference,
        deviation: Sequence[float],
        weights: Sequence[float],
        steady_weights: Sequence[float],
        steady_from: float,
        t_end: float,
        dt: float,
        harmonics: Sequence[int],
    ) -> SimulationCost: ...
    def __len__(self) -> int: ...
    def evaluate(self, gains: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def design(
        self, *, limit: float, particles: int, rounds: int, descent: int, budget: int, seed: int
    ) -> tuple[npt.NDArray[np.complex128], list[tuple[str, float]]]: ...

def close(model: Model, reference: Reference, gain: npt.NDArray[np.complex128]) -> Model: ...
def certify(
    model: Model,
    reference: Reference,
    gain: npt.NDArray[np.complex128],
    *,
    truncation: int,
    deviations: npt.NDArray[np.float64],
    spread: Mapping[str, float],
    horizon: float | None,
    tolerated: bool,
) -> dict[str, Any]: ...
def track(
    model: Model,
    stages: Sequence[tuple[Reference, npt.NDArray[np.complex128], float]],
    deviation: npt.NDArray[np.float64],
) -> dict[str, Any]: ...
def linearize_along(model: Model, reference: Reference) -> LtpSystem: ...

@final
class Floquet:
    @property
    def exponents(self) -> npt.NDArray[np.complex128]: ...
    @property
    def a_bar(self) -> npt.NDArray[np.complex128]: ...
    def p(self, t: float) -> npt.NDArray[np.complex128]: ...
    @property
    def residual(self) -> float: ...
    @property
    def is_real(self) -> bool: ...
    @property
    def warnings(self) -> list[str]: ...

@final
class Transverse:
    @property
    def system(self) -> LtpSystem: ...
    @property
    def frame(self) -> npt.NDArray[np.complex128]: ...
    @property
    def tangent(self) -> npt.NDArray[np.complex128]: ...
    @property
    def defect(self) -> float: ...
    @property
    def warnings(self) -> list[str]: ...
    def gain(self, period: float, gain: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]: ...

@final
class Feedback:
    @staticmethod
    def of_harmonics(period: float, harmonics: npt.NDArray[np.complex128]) -> Feedback: ...
    @property
    def period(self) -> float: ...
    @property
    def harmonics(self) -> npt.NDArray[np.complex128]: ...
    def at(self, t: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    @property
    def method(self) -> str: ...
    @property
    def figures(self) -> list[tuple[str, float]]: ...
    @property
    def warnings(self) -> list[str]: ...

@final
class Objective:
    def __new__(
        cls, lin: LtpSystem, objective: str, modes: str, truncation: int, harmonics: Sequence[int]
    ) -> Objective: ...
    @property
    def unknowns(self) -> int: ...
    def at(self, x: npt.NDArray[np.float64]) -> tuple[float, npt.NDArray[np.float64]]: ...

def harmonic_balance(
    lin: LtpSystem,
    variants: Sequence[LtpSystem],
    *,
    objective: str,
    modes: str,
    truncation: int,
    harmonics: Sequence[int],
    limit: float | None,
    fastest: float | None,
    slowest: float | None,
    quadratic: Sequence[tuple[npt.NDArray[np.float64], float | None, float | None]],
    damping: float | None,
    imaginary: float | None,
    start: Feedback | None,
    search: str,
    seed: int,
    budget: int | None,
) -> Feedback: ...
def periodic_lqr(
    lin: LtpSystem,
    states: npt.NDArray[np.float64],
    inputs: npt.NDArray[np.float64],
    shift: float,
    harmonics: Sequence[int] | None,
) -> Feedback: ...
def closed_loop_eigenvalues(lin: LtpSystem, gain: Feedback, truncation: int) -> npt.NDArray[np.complex128]: ...
def cycle(
    model: Model,
    *,
    start: Mapping[str, float] | None = None,
    mode: str | None = None,
    period: float | None = None,
    inputs: Mapping[str, float] | None = None,
    settle: int | None = None,
    steps: int | None = None,
    probes: int = 0,
    seed: int = 0,
) -> LimitCycle: ...
def identify(
    recordings: Sequence[Recording],
    *,
    period: float,
    harmonics: int,
    method: str = "floquet",
    band: float | None = None,
    orbit: str = "deviation",
    order: int | None = None,
    reach: float | None = None,
    transients: bool | None = None,
    smoothness: float | None = None,
    solver: str | None = None,
) -> Htf: ...
def rests(recordings: Sequence[Recording], period: float) -> list[tuple[str, str, float, float, float, float, int]]: ...
def linearize(model: Model, cycle: LimitCycle) -> LtpSystem: ...
def simulate(
    model: Model,
    inputs: Mapping[str, npt.NDArray[np.float64]] | Mapping[str, str] | Mapping[str, npt.NDArray[np.float64] | str],
    t: npt.NDArray[np.float64],
    *,
    hold: str = "first-order",
    step: float | None = None,
    initial_state: Mapping[str, float] | None = None,
    initial_mode: str | None = None,
) -> Trajectory: ...
def diagnose(
    model: Model,
    train: Sequence[Recording],
    test: Sequence[Recording],
    *,
    candidates: Sequence[str] | None = None,
    hold: str = "first-order",
    seed: int = 0,
    threads: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Diagnosis: ...
def harmonic_map(
    model: Model,
    recordings: Sequence[Recording],
    *,
    harmonics: int = 3,
    band: float | None = None,
    hold: str = "first-order",
    progress: Callable[[str, float], None] | None = None,
) -> str: ...
def isolability(
    model: Model,
    records: Sequence[Mapping[str, str | npt.NDArray[np.float64]]],
    *,
    t_end: float,
    dt: float,
    sensors: Sequence[tuple[str, float]] | None = None,
    noise: float = 0.01,
    size: float = 0.05,
    effects: Sequence[str] | None = None,
    initial_state: Mapping[str, float] | None = None,
    hold: str = "first-order",
    threads: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> str: ...
def conceal(
    model: str = "cart_pendulum",
    effect: str | None = None,
    port: str | None = None,
    size: float = 0.15,
    snr: float = 100.0,
    duration: float = 10.0,
    dt: float = 0.01,
    amplitude: float = 4.0,
    seed: int = 0,
) -> _Case: ...
def draw_case(system: str, difficulty: str, seed: int, effect: str | None = None, at: str | None = None) -> _Case: ...
def case_choices() -> tuple[list[str], list[str]]: ...
def switch_events(
    recording: Recording, channel: str, level: float | None = None
) -> tuple[npt.NDArray[np.float64], list[int]]: ...
def phase_from_events(
    recording: Recording,
    times: npt.NDArray[np.float64],
    kinds: Sequence[int],
    *,
    start: int = 0,
    joins: Sequence[float] = ...,
    tolerance: float = 0.25,
) -> Phase: ...
def cycle_average(recording: Recording, phase: Phase, channels: Sequence[str], points: int = 100) -> _CycleAverage: ...
def identify_arx(
    recording: Recording,
    phase: Phase,
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    lags: tuple[int, int] = ...,
    spacing: int = 1,
    harmonics: int = 2,
    offset: int = 8,
    draws: int = 200,
    seed: int = 0,
) -> PeriodicArx: ...
def identify_map(
    recording: Recording,
    phase: Phase,
    at: float,
    coordinates: Sequence[tuple[str, bool]],
    *,
    window: int = 5,
    per_run: bool = False,
    draws: int = 1000,
    seed: int = 0,
) -> _SectionMap: ...
def zoo_names() -> list[str]: ...
def zoo_text(name: str) -> str: ...
def effect_names() -> list[str]: ...
def effect_text(name: str) -> str: ...
def unit_factor(found: str, wanted: str) -> float: ...
def chirp(
    amplitude: float, band: tuple[float, float], duration: float, t_end: float | None, dt: float
) -> npt.NDArray[np.float64]: ...
def phase_shifted_chirps(
    amplitude: float,
    band: tuple[float, float],
    duration: float,
    period: float,
    repetitions: int,
    timing: str,
    t_end: float | None,
    dt: float,
) -> npt.NDArray[np.float64]: ...
def sine(amplitude: float, omega: float, phase: float, t_end: float, dt: float) -> npt.NDArray[np.float64]: ...
def step(amplitude: float, start: float, end: float, t_end: float, dt: float) -> npt.NDArray[np.float64]: ...
def noise(n: int, sd: float, seed: int) -> npt.NDArray[np.float64]: ...
def add_noise(x: npt.NDArray[np.float64], snr: float, seed: int) -> tuple[npt.NDArray[np.float64], float]: ...
def multisine_lines(
    period: float,
    cycles: int,
    band: tuple[float, float],
    lines: str,
    half_pumping: str,
    count: int | None,
    spread: str,
) -> list[int]: ...
def settling_periods(multiplier: float) -> int: ...
def e_rms(measured: npt.NDArray[np.float64], predicted: npt.NDArray[np.float64]) -> float: ...
def rms_error(measured: npt.NDArray[np.float64], predicted: npt.NDArray[np.float64]) -> float: ...
def relative_rms(measured: npt.NDArray[np.float64], predicted: npt.NDArray[np.float64]) -> float: ...

@final
class NormalBand:
    def __new__(cls, rows: npt.NDArray[np.complex128], smoothness: float) -> NormalBand: ...
    @property
    def bytes(self) -> int: ...
    def factor(self) -> None: ...
    def solve(self, b: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]: ...

def smooth(
    rows: npt.NDArray[np.complex128], y: npt.NDArray[np.complex128], smoothness: float, mirrored: bool
) -> npt.NDArray[np.complex128]: ...
