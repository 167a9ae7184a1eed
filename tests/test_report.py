"""The report: whole, self-contained, honest about every verdict, and unmoved by odd names and missing entries."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("ltp._ltp", reason="the extension is not built; run `make test`")

from ltp import plots
from ltp.plots.decimate import binned_mean, envelope
from ltp.plots.numbers import parse_sentence, percent, prefixed, pretty_unit, quantity, significant
from ltp.plots.phase import since_event
from ltp.report import render, write_report

NBSP = "\u00a0"
VOID = {"meta", "br", "hr"}


def traces(n: int = 1000, outputs: tuple[str, ...] = ("q",), tests: int = 1) -> dict[str, Any]:
    """Curves of a slowly moving mass that a friction of 20 N was left out of, made up from sines."""
    t = np.arange(n) * 1e-3
    velocity = 0.4 * np.cos(7 * t)
    motion = np.tile(np.sin(7 * t)[:, None] * 0.06, (1, len(outputs)))
    noise = np.random.default_rng(3).normal(size=motion.shape) * 2e-4
    records = [
        {
            "name": f"run{k}", "role": "test" if k else "train", "t": t, "output_names": list(outputs),
            "measured": motion + noise, "nominal": motion * 1.2, "before": motion * 1.05, "after": motion,
        }
        for k in range(tests + 1)
    ]  # fmt: skip
    force = {
        "record": "run0", "at": "drive", "t": t, "position": motion[:, 0], "velocity": velocity,
        "force": -20.0 * np.sign(velocity), "sd": np.ones(n),
    }  # fmt: skip
    grid = np.linspace(-0.4, 0.4, 101)
    law = {
        "at": "drive", "variable": "velocity", "unit": "N", "variable_unit": "m/s", "grid": grid,
        "force": -20.3 * np.sign(grid), "sd": np.full(101, 0.3),
    }  # fmt: skip
    return {"records": records, "force": [force], "law": law}


def diagnosis(verdict: str = "effect", outputs: tuple[str, ...] = ("q",), tests: int = 1) -> dict[str, Any]:
    """The public JSON that goes with :func:`traces`."""
    added = verdict in ("effect", "ambiguous")

    def row(k: int, output: str) -> dict[str, Any]:
        return {
            "record": f"run{k}", "output": output, "unit": "m", "nominal": 0.2, "before": 0.0512,
            "after": 0.0046 if verdict in ("effect", "ambiguous", "unknown") else None, "floor": 0.0045,
            "rms_before": 2.1e-3, "rms_after": 3.9e-6,
        }  # fmt: skip

    def candidate(name: str, score: float | None) -> dict[str, Any]:
        at = "" if name == "nothing" else "drive"
        return {"name": name, "at": at, "score": score, "held_out": -512.5, "converged": score is not None}

    scores = {"coulomb_friction": 0.0, "stribeck_friction": 2.5, "viscous_friction": 800.0, "backlash": None}
    friction = {"force": {"value": 20.31, "sd": 0.29, "unit": "N"}}
    effect = {"name": "coulomb_friction", "at": "drive", "parameters": friction, "share": 0.93}
    return {
        "model_name": "drive",
        "verdict": verdict,
        "sentence": "Coulomb friction of 20.3 +- 0.3 N is missing at drive.",
        "location": {"kind": "port", "at": "drive", "variable": "sign of velocity", "phases": [], "p_value": 1e-4},
        "effects": [effect] if added else [],
        "ambiguous_with": ["stribeck_friction@drive"] if verdict == "ambiguous" else [],
        "candidates": [candidate(*pair) for pair in scores.items()] + [candidate("nothing", 900.0)],
        "parameters": {
            "M": {"nominal": 95.0, "nominal_sd": 2.0, "before": 97.1, "after": 95.1, "sd": 0.02, "unit": "kg"},
            "b": {"nominal": 180.0, "nominal_sd": 20.0, "before": 260.0, "after": 203.0, "sd": 2.0, "unit": "N s/m"},
            "g": {"nominal": 9.81, "nominal_sd": None, "before": 9.81, "after": 9.81, "sd": None, "unit": "m/s^2"},
        },
        "fit": {
            "train": [row(0, o) for o in outputs],
            "test": [row(k, o) for k in range(1, tests + 1) for o in outputs],
        },
        "model": 'name = "drive"\n',
        "law": None,
        "warnings": [],
        "seconds": 1.2,
    }


class Page(HTMLParser):
    """Checks that tags close in order and collects tags, identifiers and what is fetched."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.stack: list[str] = []
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.fetched: list[str] = []
        self.text = ""
        self.feed(text)
        self.close()
        assert self.stack == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in VOID:
            self.stack.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(str(value))
            if name in ("src", "href", "xlink:href") and not str(value).startswith("#"):
                self.fetched.append(str(value))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.stack.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.stack.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize("verdict", ["consistent", "parameter", "effect", "ambiguous", "unknown"])
@pytest.mark.parametrize("tests", [0, 1])
def test_every_verdict_makes_a_whole_page_that_fetches_nothing(verdict: str, tests: int) -> None:
    html = render(diagnosis(verdict, tests=tests), traces(tests=tests))
    page = Page(html)
    assert page.fetched == []
    assert "script" not in page.tags
    assert len(page.ids) == len(set(page.ids))
    assert f"20.3{NBSP}±{NBSP}0.3{NBSP}N is missing at drive" in page.text
    assert len(html.encode()) < 1_500_000
    assert ("has been checked on data that the fit did not see" in page.text) == (tests == 0)
    for svg in re.findall(r"<svg.*?</svg>", html, re.DOTALL):
        assert ElementTree.fromstring(svg).attrib["aria-label"]


def clocked() -> dict[str, Any]:
    """The curves of :func:`traces` on a clock, the second half of each cycle in another mode."""
    out = traces()
    force = out["force"][0]
    phase = (force["t"] / 0.2) % 1.0
    force |= {"phase": phase, "mode": (phase > 0.5).astype(np.uint32), "modes": ["stance", "flight"]}
    return out


def test_a_force_on_a_clock_is_drawn_over_phase_by_mode() -> None:
    place = {"kind": "port", "at": "drive", "variable": "sign of velocity", "phases": [0.22, [0.7, 0.75]]}
    place["sentence"] = "at `drive`, where the velocity changes sign, at phases 0.22 and 0.72"
    html = render(diagnosis() | {"location": place}, clocked())
    page = Page(html)
    assert "Where: at drive, where the velocity changes sign, at phases 0.22 and 0.72." in page.text
    assert "over the phase of the clock" in page.text
    assert "median, stance" in html
    assert "median, flight" in html
    assert "over the phase of the clock" not in Page(render(diagnosis(), traces())).text


def test_without_a_clock_it_is_drawn_over_the_time_since_the_mode_was_entered() -> None:
    curves = clocked()
    force = curves["force"][0]
    force["phase"] = np.array([])
    text = Page(render(diagnosis(), curves)).text
    assert "over the time since the mode was entered" in text
    sample = plots.Force("", force["t"], *[force["t"]] * 4, None, force["mode"].astype(float), ("stance", "flight"))
    since = since_event(sample)
    assert np.isnan(since[:101]).all()
    assert since[101:].max() == pytest.approx(0.1, abs=2e-3)
    force["mode"] = np.zeros_like(force["mode"])
    force["modes"] = ["stance"]
    assert "mode was entered" not in Page(render(diagnosis(), curves)).text


def test_a_sensor_that_is_off_is_drawn_in_its_own_words() -> None:
    curves = traces() | {"law": None}
    curves["force"][0] |= {"kind": "output", "at": "q", "unit": "m", "position_unit": "m", "velocity_unit": "m/s"}
    place = {"kind": "output", "at": "q", "variable": "rate of the measured value", "phases": [], "p_value": 0.01}
    html = render(diagnosis("unknown") | {"location": place, "law": None}, curves)
    text = Page(html).text
    assert "What the sensor is off by" in text
    assert "Sensor q." in text
    assert "It depends on the rate of the measured value" in text
    assert "sensor error" in html
    assert "missing force" not in text.lower()


def test_the_alarm_says_what_hid_and_what_physics_forbids() -> None:
    soaked = {"parameter": "b", "before": -260.0, "after": 203.0, "sigmas": 28.5, "unit": "N s/m"}
    forbidden = "a damping of -260 N s/m feeds energy in"
    text = Page(render(diagnosis() | {"absorbed": [soaked | {"forbidden": forbidden}]}, traces())).text
    assert "Before it had a name, what was missing hid in b" in text
    assert forbidden in text
    text = Page(render(diagnosis() | {"absorbed": [soaked | {"forbidden": None}]}, traces())).text
    assert "28 of its standard deviations" in text


def test_an_ambiguous_verdict_says_what_would_tell_rivals_apart() -> None:
    rivals = ["coulomb_friction@drive", "stribeck_friction@drive"]
    louder = {"sentence": "2.5 times the input", "kind": "amplitude", "separates": rivals, "gain": 85.3}
    text = Page(render(diagnosis("ambiguous") | {"separate": [louder]}, traces())).text
    assert "2.5 times the input" in text
    assert "coulomb_friction at drive, stribeck_friction at drive" in text
    assert "No change of the experiment was found" in Page(render(diagnosis("ambiguous"), traces())).text
    assert "What would tell them apart" not in Page(render(diagnosis(), traces())).text


def test_two_effects_and_candidates_that_stand_beside_one() -> None:
    tree = diagnosis()
    drag = {"drag": {"value": 3.1, "sd": 0.2, "unit": "N s^2/m^2"}}
    tree["effects"].append({"name": "quadratic_drag", "at": "drive", "parameters": drag, "share": 0.04})
    late = {"name": "backlash", "at": "drive", "with": ["coulomb_friction@drive"], "score": None, "held_out": None}
    tree["candidates"].append(late | {"converged": False, "parameters": {}, "note": "set aside unfinished"})
    text = Page(render(tree, traces())).text
    assert "quadratic_drag" in text
    assert "backlash at drive (with coulomb_friction)" in text
    assert "set aside unfinished" in text
    assert "2 have no score; the table says why." in text


def test_every_figure_refers_only_to_parts_of_itself() -> None:
    for svg in re.findall(r"<svg.*?</svg>", render(diagnosis(), traces()), re.DOTALL):
        known = set(re.findall(r'\bid="([^"]+)"', svg))
        assert set(re.findall(r'(?:href="|url\()#([^")]+)', svg)) <= known


def test_the_same_diagnosis_gives_the_same_bytes() -> None:
    assert render(diagnosis(), traces()) == render(diagnosis(), traces())


def test_numbers_of_the_headline_and_of_the_effect() -> None:
    text = Page(render(diagnosis(), traces())).text
    for expected in ("5.12 %", "0.460 %", "0.450 %", "force = 20.3 ± 0.3 N", "2.10 mm before, 3.90 µm after"):
        assert expected in text.replace(NBSP, " ")
    assert "b had to move by 4.0 stated standard deviations to make up for it; with the effect, by 1.1" in text
    assert "9.81 m/s² (exact)" in text.replace(NBSP, " ")


def test_the_ambiguity_set_is_named() -> None:
    text = Page(render(diagnosis("ambiguous"), traces())).text
    told = "These recordings cannot tell these apart: coulomb_friction at drive, stribeck_friction at drive."
    assert told in text


def test_without_traces_there_are_no_curves_but_everything_else() -> None:
    text = Page(render(diagnosis())).text
    assert "Measured and simulated" not in text
    assert "What else was tried" in text


def test_hostile_and_foreign_names_stay_text() -> None:
    evil = '</svg><script>alert("x")</script> & $\\frac{1}$ größe 角度 _\x00' + "long_" * 40
    data = diagnosis(outputs=(evil,))
    data.update(model_name=evil, sentence=evil, warnings=[evil], model=evil)
    data["effects"][0].update(name=evil, at=evil)
    data["candidates"][1].update(name=evil, at=evil)
    data["parameters"][evil] = data["parameters"]["b"]
    data["location"].update(at=evil, variable=evil, mode=evil)
    curves = traces(outputs=(evil,))
    curves["force"][0]["at"] = evil
    page = Page(render(data, curves))
    assert "script" not in page.tags
    assert "größe 角度" in page.text


def test_long_records_with_many_outputs_stay_small() -> None:
    outputs = tuple(f"y{i}" for i in range(12))
    curves = traces(n=60_000, outputs=outputs, tests=2)
    for record in curves["records"]:
        record["before"] = record["before"] + np.random.default_rng(0).normal(size=record["before"].shape) * 0.01
    assert len(render(diagnosis(outputs=outputs, tests=2), curves).encode()) < 1_500_000


def test_the_harmonic_map_is_a_section_of_machines_with_a_clock() -> None:
    rows = [[0.4 * k + w for w in range(5)] for k in range(3)]
    tree: dict[str, Any] = {
        "model_name": "drive", "period": 0.5, "harmonics": [-1, 0, 1], "omega": [1.0, 2.0, 3.0, 4.0, 5.0],
        "outputs": ["q"], "inputs": ["tau"], "z": [[rows]], "mean_square": 9.0, "blur": 0.01, "differs": True,
        "events": [], "method": "lines", "sentence": "The transfer functions differ.", "warnings": [],
    }  # fmt: skip
    page = render(diagnosis() | {"harmonic": tree, "harmonic_after": 1.21}, traces())
    assert "1.1 standard deviations on average are left" in Page(page).text
    assert "harmonic k" in page
    for odd in (tree | {"z": "?"}, tree | {"z": []}, {"omega": [1.0]}, [3]):
        assert "harmonic k" not in render(diagnosis() | {"harmonic": odd}, traces())


@pytest.mark.parametrize("key", list(diagnosis()))
def test_an_absent_or_empty_entry_spoils_nothing(key: str) -> None:
    for value in (None, {}):
        Page(render(diagnosis() | {key: value}, traces()))


@pytest.mark.parametrize("key", ["measured", "nominal", "before", "after"])
def test_a_simulation_that_ended_early_spoils_nothing(key: str) -> None:
    curves = traces()
    for record in curves["records"]:
        record[key][100:] = np.nan
    Page(render(diagnosis(), curves))
    for record in curves["records"]:
        record[key] = np.full_like(record[key], np.nan)
    Page(render(diagnosis(), curves))


def test_write_report_replaces_the_file_in_one_step(tmp_path: Any) -> None:
    class Answer:
        traces = traces()

        def to_json(self) -> dict[str, Any]:
            return diagnosis()

    target = tmp_path / "report.html"
    target.write_text("old")
    assert write_report(Answer(), target) == target
    assert target.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert list(tmp_path.iterdir()) == [target]


def test_envelope_keeps_extremes_gaps_and_ends() -> None:
    t = np.arange(100_000.0)
    y = np.sin(t / 3000)
    y[41_234], y[77_777] = 9.0, -9.0
    assert envelope(t, y, 200_000)[1] is y
    short_t, short = envelope(t, y, 500)
    assert len(short) <= 500
    assert (short.max(), short.min()) == (9.0, -9.0)
    assert (short_t[0], short_t[-1]) == (0.0, 99_999.0)
    assert np.all(np.diff(short_t) > 0)
    y[50_000:50_010] = np.nan
    assert np.isnan(envelope(t, y, 500)[1]).any()
    assert len(envelope(t, y, 500)[1]) <= 500


def test_bins_never_straddle_zero() -> None:
    x = np.linspace(-0.37, 1.0, 5001)
    centre, mean = binned_mean(x, np.sign(x))
    assert np.allclose(np.abs(mean[np.abs(centre) > 0.01]), 1.0)


def test_the_window_finds_the_place_that_tells() -> None:
    t = np.arange(20_000) * 1e-3
    measured = np.sin(20 * t)
    bump = np.where((t > 12) & (t < 13), 0.2, 0.0)
    curves = plots.Curves("q", "m", t, measured, measured, measured + bump, measured)
    start, end = curves.window()
    assert start < 12.5 < end
    assert end - start < 4


@pytest.mark.parametrize(
    ("value", "unit", "sd", "expected"),
    [
        (20.4, "N", 0.3, "20.4 ± 0.3 N"),
        (95.113, "kg", 0.1492, "95.11 ± 0.15 kg"),
        (5.45e-3, "N m", 1.2e-4, "5.45 ± 0.12 mN·m"),
        (3.9e-6, "m", None, "3.90 µm"),
        (-0.5, "deg", 0.02, "(−0.50 ± 0.02)°"),
        (1.7, "deg", None, "1.70°"),
        (1234.0, "N s/m", 40.0, "1230 ± 40 N·s/m"),
        (2e-7, "kg m^2", 3e-8, "(2.0 ± 0.3) × 10⁻⁷ kg·m²"),
        (0.0, "N", 0.5, "0.0 ± 0.5 N"),
        (1.0, "1", 0.0, "1.00"),
        (None, "N", None, "–"),
    ],
)
def test_quantities(value: object, unit: str, sd: object, expected: str) -> None:
    assert quantity(value, unit, sd).replace(NBSP, " ") == expected


def test_small_print() -> None:
    assert significant(-12345.678, 4) == "−12350"
    assert significant(9.996) == "10.0"
    assert percent(0.00462).replace(NBSP, " ") == "0.462 %"
    assert pretty_unit("N m/(rad s^2)") == "N·m/(rad·s²)"
    assert prefixed("m", 1e-3) == (1e3, "mm")
    assert prefixed("kg", 1e-3) == (1.0, "kg")
    assert parse_sentence("1 +- 2 N, a+-b").replace(NBSP, " ") == "1 ± 2 N, a+-b"
