"""A diagnosis as the report reads it: its public JSON and its traces, with every absent or odd entry made harmless.

The sections ask this view and nothing else, so that no section has to know what may be missing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ltp.harmonic import HarmonicMap, from_tree
from ltp.plots import Candidate, Curves, ErrorRow, Force, Law, Units
from ltp.plots.decimate import Array
from ltp.plots.numbers import as_number, shorten

Json = Mapping[str, Any]

#: The five verdicts and how the page names them.
VERDICTS = {
    "consistent": "Model and recordings agree",
    "parameter": "The structure is right, a parameter is off",
    "effect": "Missing physics found and named",
    "ambiguous": "Something is missing, and several explanations fit",
    "unknown": "Something is missing that no known effect explains",
}


def entries(value: object) -> list[Json]:
    """The mappings in a list; an empty list for anything else."""
    if isinstance(value, Mapping):
        return [value]
    return [item for item in value if isinstance(item, Mapping)] if isinstance(value, (list, tuple)) else []


def texts(value: object) -> list[str]:
    """The items of a list as text; an empty list for anything else."""
    return [str(item) for item in value] if isinstance(value, (list, tuple)) else []


def array(value: object, length: int | None = None) -> Array:
    """A one-dimensional array of floats, NaN for null; all NaN when the length is not the one asked for."""
    if value is None:
        return np.full(length or 0, np.nan)
    out = np.asarray(value, dtype=np.float64).ravel()
    return out if length is None or len(out) == length else np.full(length, np.nan)


@dataclass(frozen=True)
class Trace:
    """The curves of one record: its name, whether it was held out, and one :class:`Curves` for each output."""

    record: str
    held_out: bool
    curves: list[Curves]


class View:
    """Read access to one diagnosis; ``data`` is its public JSON, ``traces`` its dict of arrays or ``None``."""

    def __init__(self, data: Json, traces: Json | None = None) -> None:
        self.data = data
        self._traces = traces or {}
        self.verdict = str(data.get("verdict", "unknown"))
        self.title = VERDICTS.get(self.verdict, self.verdict)
        self.model_name = str(data.get("model_name") or data.get("nominal_name") or "model")
        self.effects = entries(data.get("effects"))
        self.locations = entries(data.get("location"))
        self.warnings = texts(data.get("warnings"))
        self.model_text = str(data.get("model") or "")
        self.seconds = as_number(data.get("seconds"))
        self.parameters: dict[str, Json] = {
            str(name): row for name, row in dict(data.get("parameters") or {}).items() if isinstance(row, Mapping)
        }

    @property
    def absorbed(self) -> list[Json]:
        """Parameters that had soaked up what was missing, the most first."""
        return entries(self.data.get("absorbed"))

    @property
    def separate(self) -> list[Json]:
        """Experiments that would tell the rivals apart, the best first."""
        return entries(self.data.get("separate"))

    @cached_property
    def harmonic(self) -> HarmonicMap | None:
        """The harmonic map; `None` where there is none, or one that cannot be read."""
        tree = self.data.get("harmonic")
        try:
            found = from_tree(tree) if isinstance(tree, Mapping) else None
        except (KeyError, TypeError, ValueError):
            return None
        return found if found is not None and found.z.ndim == 4 and found.z.size else None

    @property
    def rivals(self) -> list[str]:
        """What the recordings cannot tell from the best, as `name at place`."""
        return [text.replace("@", " at ") for text in texts(self.data.get("ambiguous_with"))]

    @property
    def sentence(self) -> str:
        """The verdict in one sentence, as the diagnosis wrote it."""
        return str(self.data.get("sentence") or f"{self.title}.")

    @cached_property
    def effect_label(self) -> str:
        """What was added to the nominal model, in a few words."""
        if self.effects:
            return " + ".join(f"{e.get('name')} at {e.get('at')}" for e in self.effects)
        return "the estimated law"

    @cached_property
    def short_effect(self) -> str:
        """The names of the effects without their places, for legends."""
        return " + ".join(str(e.get("name")) for e in self.effects) if self.effects else "the estimated law"

    @cached_property
    def added(self) -> bool:
        """Whether ``after`` differs from ``before``: something was added to the nominal structure."""
        if self.effects or self.verdict == "consistent":
            return bool(self.effects)
        rows = entries(self._fit("train")) + entries(self._fit("test"))
        pairs = [(as_number(r.get("before")), as_number(r.get("after"))) for r in rows]
        return any(math.isfinite(b) and math.isfinite(a) and not math.isclose(a, b, rel_tol=1e-6) for b, a in pairs)

    def _fit(self, role: str) -> object:
        fit = self.data.get("fit")
        return fit.get(role) if isinstance(fit, Mapping) else None

    def fit_entries(self, held_out: bool) -> list[Json]:
        """The rows of ``fit.test`` or ``fit.train``."""
        return entries(self._fit("test" if held_out else "train"))

    @cached_property
    def error_rows(self) -> list[ErrorRow]:
        """Errors of every output of every record, held-out records first."""
        rows = []
        for held_out in (True, False):
            found = self.fit_entries(held_out)
            one_output = len({str(e.get("output")) for e in found}) == 1
            for e in found:
                record, output = str(e.get("record", "")), str(e.get("output", ""))
                role = "held-out" if held_out else "train"
                rows.append(
                    ErrorRow(
                        f"{shorten(record)} ({role})"
                        if one_output
                        else f"{shorten(record, 18)} · {shorten(output, 16)} ({role})",
                        held_out,
                        as_number(e.get("nominal")),
                        as_number(e.get("before")),
                        as_number(e.get("after")) if self.added else math.nan,
                        as_number(e.get("floor")),
                    )
                )
        return rows

    def fit_of(self, record: str, output: str, held_out: bool) -> Json:
        """The fit row of one output of one record, empty when there is none."""
        rows = self.fit_entries(held_out)
        return next((e for e in rows if e.get("record") == record and e.get("output") == output), {})

    @cached_property
    def candidates(self) -> list[Candidate]:
        """All candidates, best first, each with its standing."""
        named = {(str(e.get("name")), str(e.get("at"))) for e in self.effects}
        rivals = set(texts(self.data.get("ambiguous_with")))
        out = []
        for c in entries(self.data.get("candidates")):
            name, at = str(c.get("name")), str(c.get("at") or "")
            standing = "other"
            if name == "nothing":
                standing = "nothing"
            elif f"{name}@{at}" in rivals or (self.verdict == "ambiguous" and (name, at) in named):
                standing = "rival"
            elif (name, at) in named:
                standing = "named"
            label = "nothing added" if name == "nothing" else f"{name} at {at}" if at else name
            if beside := texts(c.get("with")):
                label += f" (with {', '.join(one.partition('@')[0] for one in beside)})"
            score, held_out = as_number(c.get("score")), as_number(c.get("held_out"))
            note = str(c.get("note") or "")
            out.append(Candidate(label, score, held_out, bool(c.get("converged", True)), standing, note))
        return sorted(out, key=lambda c: c.score if math.isfinite(c.score) else math.inf)

    @cached_property
    def traces(self) -> list[Trace]:
        """The curves of every record, held-out records first."""
        out = []
        for record in entries(self._traces.get("records")):
            t = array(record.get("t"))
            names = texts(record.get("output_names"))
            name, held_out = str(record.get("name", "")), record.get("role") == "test"
            if len(t) < 2 or not names:
                continue
            columns = {
                key: _columns(record.get(key), len(t), len(names)) for key in ("measured", "nominal", "before", "after")
            }
            curves = [
                Curves(
                    output,
                    str(self.fit_of(name, output, held_out).get("unit") or ""),
                    t,
                    columns["measured"][:, i],
                    columns["nominal"][:, i],
                    columns["before"][:, i],
                    columns["after"][:, i] if self.added else None,
                )
                for i, output in enumerate(names)
            ]
            out.append(Trace(name, held_out, curves))
        return sorted(out, key=lambda trace: not trace.held_out)

    @cached_property
    def forces(self) -> dict[str, list[Force]]:
        """The estimated missing force by port (or what a sensor or an input is off by), one entry for each record."""
        out: dict[str, list[Force]] = {}
        for f in entries(self._traces.get("force")):
            t = array(f.get("t"))
            n = len(t)
            position, velocity, strength, sd = (array(f.get(k), n) for k in ("position", "velocity", "force", "sd"))
            if len(t) > 1 and np.isfinite(strength).any():
                phase, mode = f.get("phase"), f.get("mode")
                force = Force(
                    str(f.get("record", "")),
                    t,
                    position,
                    velocity,
                    strength,
                    sd,
                    phase=array(phase) if phase is not None and len(phase) == len(t) else None,
                    mode=array(mode) if mode is not None and len(mode) == len(t) else None,
                    modes=tuple(texts(f.get("modes"))),
                    kind=str(f.get("kind") or "port"),
                )
                out.setdefault(str(f.get("at", "")), []).append(force)
        return out

    def law(self, at: str) -> Law | None:
        """The law of the missing force at a port, from the traces or else from the JSON."""
        law = self._law_at(at)
        if law is None:
            return None
        grid = array(law.get("grid"))
        if len(grid) < 2:
            return None
        columns = array(law.get("force"), len(grid)), array(law.get("sd"), len(grid))
        return Law(str(law.get("variable") or "velocity"), grid, *columns)

    def _law_at(self, at: str) -> Json | None:
        found = entries(self._traces.get("law")) + entries(self.data.get("law"))
        return next((law for law in found if str(law.get("at", at)) == at), None)

    def units(self, at: str) -> Units:
        """Units at a port: from its law, or from ``unit``, ``position_unit``, ``velocity_unit`` of the force trace."""
        law = self._law_at(at) or {}
        force = next((f for f in entries(self._traces.get("force")) if str(f.get("at", "")) == at), {})
        variable = str(law.get("variable") or "")
        of_law = str(law.get("variable_unit") or "")
        return Units(
            str(force.get("unit") or law.get("unit") or ""),
            str(force.get("position_unit") or (of_law if "position" in variable else "")),
            str(force.get("velocity_unit") or (of_law if "velocity" in variable else "")),
        )

    def variable(self, at: str) -> str:
        """What the missing force at a port depends on, as located; ``"velocity"`` when nothing is said."""
        found: Iterable[Json] = [*[loc for loc in self.locations if loc.get("at") == at], self._law_at(at) or {}]
        return next((str(entry["variable"]) for entry in found if entry.get("variable")), "velocity")


def dependence(variable: object) -> str:
    """A variable in a sentence: ``the sign of velocity``, ``position``."""
    text = str(variable)
    return f"the {text}" if text.startswith(("sign", "phase", "mode", "rate", "time since")) else text


def _columns(value: object, n: int, outputs: int) -> Array:
    """An (n, outputs) array; a single output may come as (n,); NaN where the shape is another."""
    if value is None:
        return np.full((n, outputs), np.nan)
    out = np.asarray(value, dtype=np.float64)
    out = out.reshape(-1, 1) if out.ndim == 1 else out
    return out if out.shape == (n, outputs) else np.full((n, outputs), np.nan)
