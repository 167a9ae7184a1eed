"""Owns the tests of the command `ltp`: its examples run, its endings have their exit codes, its streams keep apart."""

from __future__ import annotations

import io
import itertools
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ltp
from conftest import HEADER, rows_of, write_rows
from ltp.cli import main, text
from ltp.progress import Progress

COMMANDS = ("simulate", "cycle", "linearize", "identify", "harmonic-map", "diagnose", "zoo", "demo")


@pytest.fixture(autouse=True)
def in_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def run_file(tmp_path: Path, good: dict[str, np.ndarray]) -> Path:
    return write_rows(tmp_path / "run.csv", rows_of(good))


def help_of(command: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as left:
        main([command, "--help"])
    assert left.value.code == 0
    return capsys.readouterr().out


class TestHelp:
    @pytest.mark.parametrize("command", COMMANDS)
    def test_examples_run(self, command: str, capsys: pytest.CaptureFixture[str]) -> None:
        lines = help_of(command, capsys).splitlines()
        examples = [line.strip() for line in lines if line.startswith("  ltp ")]
        assert examples
        for example in examples:
            program, *words = shlex.split(example)
            assert program == "ltp"
            assert main(words) == 0, example
            for word, following in itertools.pairwise(words):
                if word in ("--out", "--report"):
                    assert Path(following).stat().st_size > 0

    @pytest.mark.parametrize("command", COMMANDS)
    def test_exit_codes_are_documented(self, command: str, capsys: pytest.CaptureFixture[str]) -> None:
        page = help_of(command, capsys)
        for code in ("0  ", "1  ", "2  ", "130"):
            assert f"\n  {code}" in page

    def test_no_command(self, capsys: pytest.CaptureFixture[str]) -> None:
        with pytest.raises(SystemExit) as left:
            main([])
        assert left.value.code == 2

    def test_version(self, capsys: pytest.CaptureFixture[str]) -> None:
        with pytest.raises(SystemExit) as left:
            main(["--version"])
        assert left.value.code == 0
        assert capsys.readouterr().out == f"ltp {ltp.__version__}\n"


class TestSimulate:
    GOOD = ("simulate", "zoo:drive", "--t-end", "1", "--dt", "0.1", "--input", "tau=40*sin(3*t)")

    def test_table(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main([*self.GOOD, "--out", "run.csv"]) == 0
        lines = Path("run.csv").read_text(encoding="utf-8").splitlines()
        assert lines[0] == "t,tau,q,v,mode"
        assert len(lines) == 12
        assert "written to run.csv" in capsys.readouterr().out

    def test_json(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main([*self.GOOD, "--json"]) == 0
        tree = json.loads(capsys.readouterr().out)
        assert len(tree["t"]) == len(tree["outputs"]["q"]) == len(tree["mode"]) == 11
        assert tree["stop"]["time"] == pytest.approx(1.0)

    def test_model_file_parameters_and_start(self, rig_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
        words = ["--t-end", "1", "--input", "tau=0", "--set", "M=5", "--start", "q=2", "--json"]
        assert main(["simulate", str(rig_file), *words]) == 0
        assert json.loads(capsys.readouterr().out)["states"]["q"][0] == 2.0

    def test_early_end(self, capsys: pytest.CaptureFixture[str]) -> None:
        words = ["simulate", "zoo:bouncing_ball", "--t-end", "6", "--dt", "0.01", "--json"]
        assert main(words) == 0
        captured = capsys.readouterr()
        assert json.loads(captured.out)["stop"]["reason"] == "zeno"
        assert captured.err.startswith("ltp: warning: ")
        assert main([*words, "--strict"]) == 1
        assert capsys.readouterr().out == ""

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (["--input", "tau"], "--input tau: expected NAME=VALUE"),
            (["--input", "taw=1"], "did you mean tau"),
            (["--input", "tau=1", "--input", "tau=2"], "'tau' is given twice"),
            (["--input", "tau="], "nothing stands after the equals sign"),
            (["--set", "M=heavy"], "'heavy' is not a finite number"),
            (["--set", "mass=3"], "mass"),
            (["--start", "q=inf"], "'inf' is not a finite number"),
            (["--out", "nowhere/run.csv"], "'nowhere' does not exist"),
            (["--dt", "-1"], "dt is -1.0"),
        ],
    )
    def test_wrong_input(self, words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["simulate", "zoo:drive", "--t-end", "1", *words]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.startswith("ltp: ")
        assert message in captured.err
        assert "Traceback" not in captured.err

    @pytest.mark.parametrize(
        ("model", "message"),
        [("zoo:driwe", "did you mean drive"), ("rig.toml", "no such file"), ("run.csv", "ends in .toml")],
    )
    def test_wrong_model(self, model: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["simulate", model, "--t-end", "1"]) == 2
        assert message in capsys.readouterr().err


class TestDiagnose:
    @pytest.fixture
    def runs(self, rig_file: Path) -> list[str]:
        """The words of a diagnosis of a rig that is heavier than its model, with columns of other names."""
        for name, tau in (("a", "8*sin(2*t)"), ("b", "6*sin(3*t)")):
            words = ["--t-end", "4", "--dt", "0.02", "--input", f"tau={tau}", "--set", "M=11", "--out", f"{name}.csv"]
            assert main(["simulate", str(rig_file), *words]) == 0
            file = Path(f"{name}.csv")
            run = file.read_text(encoding="utf-8")
            file.write_text(run.replace("t,tau,load,qm,v", "t,u,load,x,v"), encoding="utf-8")
        words = ["diagnose", str(rig_file), "a.csv", "--test", "b.csv", "--columns", "q=x,tau=u"]
        return [*words, "--candidates", "coulomb_friction"]

    def test_text(self, runs: list[str], capsys: pytest.CaptureFixture[str]) -> None:
        capsys.readouterr()
        assert main([*runs, "--report", "out.html", "--save-model", "out.toml"]) == 0
        captured = capsys.readouterr()
        for word in ("held out", "noise floor", "explanation", "nominal parameters", "report written to out.html"):
            assert word in captured.out
        assert "<html" in Path("out.html").read_text(encoding="utf-8")
        assert ltp.Model.load("out.toml").states == ["q", "v"]

    def test_json(self, runs: list[str], capsys: pytest.CaptureFixture[str]) -> None:
        capsys.readouterr()
        assert main([*runs, "--json", "--report", "out.html"]) == 0
        tree = json.loads(capsys.readouterr().out)
        assert tree["verdict"] in ("consistent", "parameter", "effect", "ambiguous", "unknown")
        assert [row["record"] for row in tree["fit"]["test"]] == ["b", "b"]

    def test_window(self, runs: list[str], capsys: pytest.CaptureFixture[str]) -> None:
        capsys.readouterr()
        assert main([word.replace("a.csv", "a.csv@0.5:3.5") for word in runs] + ["--json"]) == 0
        json.loads(capsys.readouterr().out)

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("a.csv", "missing.csv", "missing.csv: no such file"),
            ("a.csv", "a.csv@7:9", "a"),
            ("a.csv", "a.csv@x:9", "'x' in the window is not a number"),
            ("q=x,tau=u", "q=x", "no column 'tau'"),
            ("q=x,tau=u", "q=x,torque=u", "no input or output 'torque'"),
            ("q=x,tau=u", "q=x,u", "--columns u: expected NAME=VALUE"),
            ("coulomb_friction", "colomb_friction", "colomb_friction"),
        ],
    )
    def test_wrong_input(
        self, runs: list[str], old: str, new: str, message: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        capsys.readouterr()
        assert main([new if word == old else word for word in runs]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert message in captured.err

    def test_places_are_checked_before_the_work(self, runs: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
        def never(*_: object, **__: object) -> None:
            raise AssertionError("the work had begun")

        monkeypatch.setattr("ltp.cli.diagnose.diagnose", never)
        assert main([*runs, "--report", "nowhere/out.html"]) == 2

    def test_wrong_cell_has_its_place(
        self, rig_file: Path, good: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]
    ) -> None:
        rows = rows_of(good)
        rows[6][HEADER.index("qm")] = "far"
        write_rows(Path("run.csv"), rows)
        assert main(["diagnose", str(rig_file), "run.csv"]) == 2
        assert "run.csv: row 7, column 'qm': found the text 'far'" in capsys.readouterr().err

    def test_interrupt(
        self, runs: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        def interrupt(*_: object, **__: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr("ltp.cli.diagnose.diagnose", interrupt)
        capsys.readouterr()
        assert main([*runs, "--report", "out.html"]) == 130
        assert "interrupted" in capsys.readouterr().err
        assert not Path("out.html").exists()


class TestOrbits:
    def test_cycle(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["cycle", "zoo:hopper", "--out", "period.csv", "--plot", "cycle.svg"]) == 0
        out = capsys.readouterr().out
        for word in ("stable periodic orbit", "0.024890445", "touchdown", "+0.832614057"):
            assert word in out
        assert Path("period.csv").read_text(encoding="utf-8").startswith("t,u_c,h,")
        assert Path("cycle.svg").read_text(encoding="utf-8").startswith("<?xml")

    def test_cycle_json(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["cycle", "zoo:hopper", "--probes", "6", "--json"]) == 0
        tree = json.loads(capsys.readouterr().out)
        assert [event["name"] for event in tree["events"]] == ["liftoff", "touchdown"]
        assert tree["domain"]["probes"] == 6
        assert len(tree["multipliers"]) == 4

    def test_linearize(self, capsys: pytest.CaptureFixture[str]) -> None:
        words = ["linearize", "zoo:hopper", "--frequencies", "0,1,2.5", "--harmonics", "2", "--out", "htf.npz"]
        assert main(words) == 0
        assert "2 jumps" in capsys.readouterr().out
        htf = ltp.Htf.load("htf.npz")
        np.testing.assert_allclose(htf.omega, 2 * np.pi * np.array([0.0, 1.0, 2.5]))
        assert htf.harmonic(0)[0].real == pytest.approx(1 / 6500)

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (["cycle", "zoo:hopper", "--mode", "air"], "air"),
            (["cycle", "zoo:hopper", "--start", "x=1"], "x"),
            (["cycle", "zoo:hopper", "--plot", "nowhere/a.svg"], "'nowhere' does not exist"),
            (["linearize", "zoo:hopper", "--frequencies", "5:0:1"], "FIRST:LAST:STEP"),
            (["linearize", "zoo:hopper", "--frequencies", "0:5"], "FIRST:LAST:STEP"),
            (["linearize", "zoo:hopper", "--outputs", "y"], "no output 'y'"),
        ],
    )
    def test_wrong_input(self, words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(words) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert message in captured.err


class TestIdentify:
    WORDS = ("--period", "0.33", "--harmonics", "2", "--band", "2.5", "--input", "u_c", "--output", "h")

    @pytest.fixture
    def runs(self) -> None:
        """A hop of 60 s under a wandering sine, and one without."""
        for name, force in (("orbit", "0"), ("run", "0.1*sin(2*pi*t + 2*sin(3*t))")):
            words = ["--t-end", "60.06", "--input", f"u_c={force}", "--out", f"{name}.csv"]
            assert main(["simulate", "zoo:hopper", *words]) == 0

    @pytest.mark.usefixtures("runs")
    def test_text_and_file(self, capsys: pytest.CaptureFixture[str]) -> None:
        capsys.readouterr()
        assert main(["identify", "run.csv", "--minus", "orbit.csv", *self.WORDS, "--out", "htf.npz"]) == 0
        out = capsys.readouterr().out
        for word in ("Floquet", "from u_c to h", "noise_sd", "htf.npz"):
            assert word in out
        model = ltp.zoo.hopper()
        htf = ltp.Htf.load("htf.npz")
        exact = ltp.linearize(model, ltp.cycle(model)).htf(htf.omega, 2)
        error = np.linalg.norm(htf.values - exact.values) / np.linalg.norm(exact.values)
        assert error < 0.1

    @pytest.mark.usefixtures("runs")
    def test_json(self, capsys: pytest.CaptureFixture[str]) -> None:
        capsys.readouterr()
        assert main(["identify", "run.csv", "--minus", "orbit.csv", *self.WORDS, "--json"]) == 0
        tree = json.loads(capsys.readouterr().out)
        assert tree["harmonics"] == [-2, -1, 0, 1, 2]
        assert np.array(tree["values"]).shape == (5, len(tree["omega"]), 1, 1, 2)

    @pytest.mark.usefixtures("runs")
    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("u_c", "tau", "'tau'"),
            ("h", "height", "'height'"),
            ("0.33", "nan", "period"),
            ("2.5", "600", "no power from"),
            ("run.csv", "walk.csv", "no such file"),
        ],
    )
    def test_wrong_input(self, old: str, new: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
        capsys.readouterr()
        words = ["identify", "run.csv", "--minus", "orbit.csv", *self.WORDS]
        assert main([new if word == old else word for word in words]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert message in captured.err

    @pytest.mark.usefixtures("runs")
    def test_an_orbit_that_is_too_short(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["simulate", "zoo:hopper", "--t-end", "3.3", "--out", "short.csv"]) == 0
        capsys.readouterr()
        assert main(["identify", "run.csv", "--minus", "short.csv", *self.WORDS]) == 2
        assert "record the orbit at the same times" in capsys.readouterr().err


class TestControl:
    WORDS = ("control", "zoo:cart_pendulum", "--follow", "x=0.05", "--hz", "1")

    def test_a_design_with_its_certificate(self, capsys: pytest.CaptureFixture[str]) -> None:
        words = ("--limit", "200", "--fastest", "50", "--deviation", "x=0.02", "--deviation", "theta=0.2")
        assert main([*self.WORDS, *words]) == 0
        out = capsys.readouterr().out
        assert "stable: largest real part -9.2" in out
        assert "peak of the feedback: V 10" in out
        assert main([*self.WORDS, *words, "--json"]) == 0
        tree = json.loads(capsys.readouterr().out)
        assert tree["verdict"] == "stable"
        assert max(real for real, _ in tree["orbit"]["exponents"]) == pytest.approx(-9.22, abs=0.02)

    def test_a_regulator_and_other_parameters(self, capsys: pytest.CaptureFixture[str]) -> None:
        weights = ("--method", "periodic-lqr", "--state-weights", "25,1,0,0", "--input-weights", "1e-3")
        assert main([*self.WORDS, *weights, "--harmonics", "0,2", "--spread", "l_p=0.01"]) == 0
        out = capsys.readouterr().out
        assert "V, harmonic 2 imaginary" in out
        assert "worst of the other parameters" in out

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("--follow", "x"), "--follow"),
            (("--follow", "y=1"), "y"),
            (("--method", "periodic-lqr"), "state_weights"),
            (("--method", "periodic-lqr", "--state-weights", "1,a"), "--state-weights 1,a"),
            (("--spread", "l=0.01", "--limit", "100"), "l"),
        ],
    )
    def test_bad_words(self, words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]) -> None:
        assert main([*self.WORDS, *words]) == 2
        assert message in capsys.readouterr().err


class TestReproduce:
    def test_a_missed_bound_is_exit_code_1(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        from ltp import reproduce

        def chapter(ours: float) -> reproduce.Chapter:
            return reproduce.Chapter("Cost", "Once.", [reproduce.Row("1 Hz", ours, "%", "3.3 %", low=2.5, high=4.0)])

        def done(ours: float) -> Any:
            def hopper(*_: object, say: Any, **__: object) -> reproduce.Reproduction:
                say(chapter(ours))
                return reproduce.Reproduction([chapter(ours)], 1.0)

            return hopper

        for ours, code, word in ((3.33, 0, "1 of 1"), (4.1, 1, "0 of 1")):
            monkeypatch.setattr("ltp.reproduce.hopper", done(ours))
            assert main(["reproduce", "hopper"]) == code
            assert word in capsys.readouterr().out
            assert main(["reproduce", "hopper", "--json"]) == code
            assert json.loads(capsys.readouterr().out)["passed"] is (code == 0)

    def test_exit_codes_are_documented(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert "\n  130" in help_of("reproduce", capsys)


class TestZoo:
    def test_list(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["zoo"]) == 0
        out = capsys.readouterr().out
        for name in ltp.zoo.names():
            assert f"\n  {name} " in out

    def test_document_is_a_model(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["zoo", "drive"]) == 0
        assert ltp.Model.from_toml(capsys.readouterr().out).name == "drive"

    def test_json(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["zoo", "--json"]) == 0
        assert [model["name"] for model in json.loads(capsys.readouterr().out)["models"]] == ltp.zoo.names()
        assert main(["zoo", "drive", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["document"] == ltp.zoo.text("drive")

    def test_unknown(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["zoo", "hoper"]) == 2
        assert "did you mean hopper" in capsys.readouterr().err


class TestText:
    @pytest.mark.parametrize(
        ("value", "sd", "shown"),
        [
            (20.4123, 0.31, "20.41 +/- 0.31"),
            (95.1, 2.0, "95.1 +/- 2.0"),
            (1234.5, 123.0, "1234 +/- 123"),
            (5.452e-3, 1.2e-5, "0.005452 +/- 0.000012"),
            (2.3e-6, 1e-7, "(2.30 +/- 0.10)e-06"),
            (3.0, 1e-12, "3 +/- 1e-12"),
            (3.0, None, "3"),
            (3.0, float("nan"), "3"),
            (float("nan"), 1.0, "-"),
        ],
    )
    def test_estimate(self, value: float, sd: float | None, shown: str) -> None:
        assert text.estimate(value, sd) == shown

    def test_table(self) -> None:
        lines = text.table(["name", "value"], [["a", "1"], ["long name", "1000"]]).splitlines()
        assert lines == ["  name        value", "  a               1", "  long name    1000"]


class TestProcess:
    """The program as a process of its own."""

    def start(self, *words: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "ltp", *words]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8")

    def test_module_and_exit_code(self) -> None:
        process = self.start("zoo", "hoper")
        out, err = process.communicate(timeout=60)
        assert (process.returncode, out) == (2, "")
        assert len(err.splitlines()) == 1

    def test_reader_that_leaves_early(self) -> None:
        process = self.start("zoo", "drive")
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait(timeout=60) == 0

    @pytest.mark.skipif(os.name != "posix", reason="Ctrl-C is sent as a POSIX signal")
    def test_ctrl_c(self) -> None:
        words = ("--t-end", "20000", "--dt", "0.01", "--step", "1e-6", "--input", "tau=sin(t)", "--out", "run.csv")
        process = self.start("simulate", "zoo:drive", *words)
        time.sleep(3)  # well into the simulation, which would take hours
        process.send_signal(signal.SIGINT)
        try:
            _, err = process.communicate(timeout=30)
        finally:
            process.kill()
        assert process.returncode == 130
        assert err.strip() == "ltp: interrupted; no file was left half written"
        assert list(Path().iterdir()) == []


class TestProgress:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    def test_terminal(self) -> None:
        terminal = self.Terminal()
        with Progress(terminal) as progress:
            progress("fitting", 0.5)
            progress("fitting", 0.5001)  # too soon to draw again
            progress("done", 1.0)
        drawn = terminal.getvalue()
        assert "[############............]  50% fitting" in drawn
        assert drawn.count("fitting") == 1
        assert drawn.endswith("\r\x1b[K")

    def test_pipe(self) -> None:
        pipe = io.StringIO()
        with Progress(pipe) as progress:
            progress("fitting", 0.5)
        assert pipe.getvalue() == ""
