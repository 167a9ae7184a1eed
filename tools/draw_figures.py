"""Draws the figures of README.md and docs/recordings from what those pages describe.

`python tools/draw_figures.py [DATA]` writes docs/demo.png, and docs/recordings/*.png when the folder of the public
recordings is there (DATA, by default `shared/data` beside the checkout; docs/recordings says where they come from).
"""

from __future__ import annotations

import json
import os
import re
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

import ltp
from ltp.cli.common import load_recording
from ltp.cli.demo import SEED
from ltp.conceal import conceal
from ltp.plots import comparison, missing_force
from ltp.report.view import View
from ltp.reproduce import hopper
from walking_figure import RECORD, walking

DOCS = Path(__file__).parents[1] / "docs"
DPI = 110
LEG = "sydney_compass_gait/realVSmodel_fwAnd5vstepsx3AndChirp_innerSW.mat"

#: Model, train, test, columns.
RECORDINGS = {
    "emps": ("emps.toml", "emps/DATA_EMPS.mat", "emps/DATA_EMPS_PULSES.mat", {}),
    "sydney": ("sydney_inner_leg.toml", f"{LEG}@0:37.9", f"{LEG}@37.9:", {"t": "datatimeall"}),
    "bicycle_wheel": ("bicycle_wheel_radial.toml", "bicycle_wheel_pendulum/radial.csv", "", {}),
}


def force(view: View) -> Figure:
    """The missing force at the first port, with the law that was named."""
    at = next(iter(view.forces))
    name = str(view.effects[0]["name"])
    return missing_force(view.forces[at], view.variable(at), law=view.law(at), units=view.units(at), name=name)


def fit(view: View) -> Figure:
    """Measured and simulated, for the output of the first held-out record with the largest error."""
    trace = view.traces[0]
    rows = {curves.output: view.fit_of(trace.record, curves.output, True) for curves in trace.curves}
    curves = max(trace.curves, key=lambda c: float(rows[c.output]["before"]))
    return comparison(curves, floor=float(rows[curves.output]["floor"]), effect=view.short_effect)


def write(path: Path, *figures: Figure) -> None:
    """Figures below each other as one PNG on white."""
    images = []
    for figure in figures:
        figure.set_dpi(DPI)
        figure.set_facecolor("white")
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        images.append(np.asarray(canvas.buffer_rgba())[..., :3])
    # A palette takes a third of the bytes, and the figures have few colours.
    Image.fromarray(np.ascontiguousarray(np.vstack(images))).quantize(96).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size // 1000} kB")


def view(diagnosis: ltp.Diagnosis) -> View:
    """A diagnosis as the report reads it."""
    print(diagnosis.sentence)
    return View(json.loads(diagnosis.to_json()), diagnosis.traces)


def pages(page: Path) -> dict[str, Any]:
    """The names that the blocks of Python on a page leave behind, run in a folder of their own."""
    names: dict[str, Any] = {}
    text, here = page.read_text(encoding="utf-8"), Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for body in re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
                exec(compile(body, str(page), "exec"), names)
        finally:
            os.chdir(here)
    return names


def transfer_functions() -> None:
    """The pages on cycles and identification, and the reproduction of the hopper."""
    write(DOCS / "cycle.png", pages(DOCS / "cycle.md")["cycle"].plot("h", "hd", others=["ht"]))
    names = pages(DOCS / "identify.md")
    write(DOCS / "identify.png", names["htf"].plot(exact=names["exact"], unit="m/N"))
    pictures = {p.name: p.draw for chapter in hopper().chapters for p in chapter.pictures}
    write(DOCS / "reproduce_hopper.png", pictures["fig8_errors"](), pictures["fig9_predictions"]())
    write(DOCS / "reproduce_better.png", pictures["errors_better"]())


def main(data: Path) -> None:
    """Draw everything that can be drawn here."""
    transfer_functions()
    case = conceal(seed=SEED)
    seen = view(ltp.diagnose(case.model, case.train, case.test, seed=SEED))
    write(DOCS / "demo.png", force(seen), fit(seen))
    for name, (document, train, test, columns) in RECORDINGS.items():
        if not (data / train.split("@")[0]).exists():
            print(f"{name}: no recording in {data}, its figure stays as it is")
            continue
        model = ltp.Model.load(DOCS / "recordings" / document)
        records = [load_recording(str(data / word), model, columns, None) for word in (train, test) if word]
        seen = view(ltp.diagnose(model, records[:1], records[1:]))
        write(DOCS / "recordings" / f"{name}.png", *([force(seen)] if seen.effects else []), fit(seen))
    walk = data / "sydney_compass_gait" / RECORD
    if walk.exists():
        write(DOCS / "recordings" / "sydney_walking.png", *walking(walk))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[2] / "shared" / "data")
