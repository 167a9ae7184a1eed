"""Owns `conceal`, `draw` and the noun `Case` in Python: recordings with physics that their model lacks, and labels."""

from __future__ import annotations

import hashlib
import json
import secrets
from dataclasses import dataclass

from ltp import _ltp
from ltp.model import Model
from ltp.recording import Recording


@dataclass(frozen=True)
class Label:
    """What was concealed: an effect (`nothing` for none), its port, and its parameters in their own units.

    `text` is the label as JSON with sorted keys: the same label is always the same text.
    """

    effect: str
    at: str
    parameters: dict[str, float]
    seed: int
    text: str

    @classmethod
    def read(cls, text: str) -> Label:
        """The label that a JSON text holds."""
        tree = json.loads(text)
        return cls(tree["effect"], tree["at"], dict(tree["parameters"]), tree["seed"], text)


@dataclass(frozen=True)
class Case:
    """A concealed case: what a diagnosis may see (`model`, `train`, `test`), and what it must not (`label`).

    The parameters of the model are off by about half their stated uncertainty, as an engineer would state them.
    """

    model: Model
    train: list[Recording]
    test: list[Recording]
    label: Label


@dataclass(frozen=True)
class Planted:
    """One concealed piece of physics: an effect, the place where it acts, its parameters in their own units."""

    name: str
    at: str
    parameters: dict[str, float]


@dataclass(frozen=True)
class Concealed:
    """What was concealed in a drawn case, and how well.

    effects: none in a clean case, two in a pair. change: rms change of the most moved output over the spread of its
    motion; decibels: that change over the noise, None in a clean case. visible: energy over noise variance of what the
    nominal parameters cannot imitate in the train records; alike: the same effect at other places, as `effect@place`,
    where these records cannot tell it from the truth. noise: "white" or "ar1"; sigma: its rms, by output.
    `text` is the label as JSON.
    """

    system: str
    difficulty: str
    seed: int
    effects: list[Planted]
    change: float
    decibels: float | None
    visible: float
    alike: list[str]
    noise: str
    sigma: list[float]
    text: str

    @classmethod
    def read(cls, text: str) -> Concealed:
        """The label that a JSON text holds."""
        tree = json.loads(text)
        return cls(
            system=tree["system"],
            difficulty=tree["difficulty"],
            seed=tree["seed"],
            effects=[Planted(e["name"], e["at"], dict(e["parameters"])) for e in tree["effects"]],
            change=tree["change"],
            decibels=tree["decibels"],
            visible=tree["visible"],
            alike=list(tree["alike"]),
            noise=tree["noise"],
            sigma=list(tree["sigma"]),
            text=text,
        )


@dataclass(frozen=True)
class Drawn:
    """A drawn case: what a diagnosis may see (`model`, `train`, `test`), and what it must not (`label`)."""

    model: Model
    train: list[Recording]
    test: list[Recording]
    label: Concealed


@dataclass(frozen=True)
class Seal:
    """A commitment to a label: its SHA-256 together with a salt that nobody can guess before it is told."""

    sha256: str
    salt: str

    @classmethod
    def of(cls, label: Label) -> Seal:
        """Seal a label with a fresh salt: the only thing in ltp that is not drawn from a seed, so that no one can."""
        salt = secrets.token_hex(16)
        return cls(digest(label.text, salt), salt)

    def holds(self, label: Label) -> bool:
        """Whether this is the label that was sealed."""
        return digest(label.text, self.salt) == self.sha256


def digest(text: str, salt: str) -> str:
    """SHA-256 of the text of a label followed by the salt, as 64 hexadecimal digits."""
    return hashlib.sha256((text + salt).encode()).hexdigest()


def conceal(
    model: str = "cart_pendulum",
    effect: str | None = None,
    port: str | None = None,
    *,
    size: float = 0.15,
    snr: float = 100.0,
    duration: float = 10.0,
    dt: float = 0.01,
    amplitude: float = 4.0,
    seed: int = 0,
) -> Case:
    """Record a model of the zoo with a piece of physics that its document lacks.

    model: a model of the zoo with inputs and one mode.
    effect, port: what is concealed and where; both are drawn from the seed when left out, and the effect "nothing"
        conceals nothing.
    size: force of the effect over the forces at its port; snr: rms change of the outputs by the effect over rms noise.
    duration, dt: of each recording and of a sample, s; amplitude: of the input, in its unit.

    The recordings are made by an integrator that shares nothing with the one that diagnoses. Raises `InputError` for a
    name that does not exist.
    """
    case = _ltp.conceal(model, effect, port, size, snr, duration, dt, amplitude, seed)
    return Case(
        model=Model.wrap(case["model"]),
        train=[Recording.wrap(record) for record in case["train"]],
        test=[Recording.wrap(record) for record in case["test"]],
        label=Label.read(case["label"]),
    )


def draw(
    system: str = "cart_pendulum",
    difficulty: str = "open",
    seed: int = 0,
    *,
    effect: str | None = None,
    at: str | None = None,
) -> Drawn:
    """Draw a case from system, difficulty and seed, as `ltp prove` does.

    system: "cart_pendulum", "pendulum", "duffing", "two_mass", "drive" or "hopper". difficulty: "open" (the effect
    changes the output by 40 dB over the noise), "noisy" (20 dB), "masked" (20 dB, stated parameters refitted so that
    the model looks good), "buried" (0 to 10 dB below the noise), "pair" (two effects), "clean" (none), "outside" (a law
    that the library does not hold). effect, at: what is concealed, where it is not to be drawn; give both or neither.

    Two train records and one held-out one. Raises `InputError` for a name that does not exist and `ConvergenceError`
    when the effect leaves no trace in this machine however it is drawn.
    """
    case = _ltp.draw_case(system, difficulty, seed, effect, at)
    return Drawn(
        model=Model.wrap(case["model"]),
        train=[Recording.wrap(record) for record in case["train"]],
        test=[Recording.wrap(record) for record in case["test"]],
        label=Concealed.read(case["label"]),
    )


def choices() -> tuple[list[str], list[str]]:
    """Names of the systems and of the difficulties of `draw`."""
    return _ltp.case_choices()
