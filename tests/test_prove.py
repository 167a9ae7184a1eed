"""Owns the tests of `ltp prove`: what is planned, what a folder keeps, how cases are marked, and a small run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ltp
from ltp.cli import main
from ltp.conceal import Concealed, Planted, choices, draw
from ltp.plots.confusion import confusion as draw_matrix
from ltp.prove import classes, mark, plan, score
from ltp.prove.folder import Folder, commitment, read_case
from ltp.prove.mark import near_floor
from ltp.prove.plan import FULL, QUICK, RANGES
from ltp.prove.score import confusion


def label(
    *effects: Planted, system: str = "cart_pendulum", difficulty: str = "open", alike: Sequence[str] = ()
) -> Concealed:
    return Concealed(system, difficulty, 1, list(effects), 0.1, 40.0, 1e4, list(alike), "white", [1e-4, 1e-4], "{}")


def said(verdict: str, *named: tuple[str, str], **more: Any) -> dict[str, Any]:
    effects = [{"name": n, "at": at, "parameters": {"force": {"value": 1.0, "sd": 0.1}}} for n, at in named]
    ranking = more.pop("ranking", [*named, ("nothing", "")])
    return {
        "verdict": verdict,
        "effects": effects,
        "ambiguous_with": more.pop("ambiguous_with", []),
        "candidates": [{"name": n, "at": at, "score": 10.0 * k} for k, (n, at) in enumerate(ranking)],
        "parameters": more.pop("parameters", {}),
        "location": more.pop("location", None),
        "fit": {"train": [], "test": [{"floor": 0.01, "before": 0.5, "after": 0.0102}]},
        "seconds": 1.5,
        **more,
    }


COULOMB = Planted("coulomb_friction", "cart", {"force": 1.15})


class TestPlan:
    def test_ranges_share_no_seed(self) -> None:
        tuning = {t.seed for t in plan("tuning", 10**7 - 1, full=True)}
        scored = {t.seed for t in plan("score", 0, full=True)}
        assert max(tuning) < RANGES["score"] <= min(scored)
        assert not {t.seed for t in plan("score", 1)} & scored

    def test_every_case_has_its_own_seed(self) -> None:
        tasks = plan(full=True)
        assert len({t.seed for t in tasks}) == len(tasks) == sum(FULL.values())

    def test_counts_follow_the_proportions(self) -> None:
        tasks = plan(cases=9)
        assert len(tasks) == 9 and {t.difficulty for t in tasks} >= {"open", "noisy", "clean"}
        assert len(plan()) == sum(QUICK.values())

    def test_systems_take_turns_and_clean_cases_have_both_colours(self) -> None:
        tasks = plan(difficulties=["clean"], systems=["drive", "hopper"])
        assert {(t.system, t.seed % 2) for t in tasks} == {(s, c) for s in ("drive", "hopper") for c in (0, 1)}

    @pytest.mark.parametrize(
        ("given", "words"),
        [
            ({"systems": ["card"]}, "card.*cart_pendulum"),
            ({"difficulties": ["hard"]}, "hard.*masked"),
            ({"seeds": "lucky"}, "lucky.*tuning"),
            ({"cases": 0}, "at least one"),
            ({"base": -1}, "whole number"),
        ],
    )
    def test_what_does_not_exist_is_said(self, given: dict[str, Any], words: str) -> None:
        with pytest.raises(ltp.InputError, match=words):
            plan(**given)


class TestMark:
    def test_right_name_is_right(self) -> None:
        m = mark(label(COULOMB), said("effect", ("coulomb_friction", "cart"), location={"at": "cart"}))
        assert (m.top1, m.top2, m.accepted, m.port, m.inside) == (True, True, "right", True, (1, 1))
        assert m.held_out == pytest.approx((50.0, 1.02)) and near_floor(m)

    def test_wrong_name_is_wrong(self) -> None:
        result = said("effect", ("stribeck_friction", "cart"), location={"at": "pendulum"})
        m = mark(label(COULOMB), result)
        assert (m.top1, m.top2, m.accepted, m.port, m.inside) == (False, False, "wrong", False, (0, 0))

    def test_ambiguous_is_neither_accepted_right_nor_wrong(self) -> None:
        result = said("ambiguous", ("stribeck_friction", "cart"), ambiguous_with=["coulomb_friction@cart"])
        m = mark(label(COULOMB), result)
        assert (m.top1, m.top2, m.accepted) == (False, True, "")

    def test_an_unnamed_best_candidate_counts_for_the_ranking_only(self) -> None:
        m = mark(label(COULOMB), said("consistent", ranking=[("coulomb_friction", "cart"), ("nothing", "")]))
        assert (m.top1, m.accepted) == (True, "")
        m = mark(label(COULOMB), said("consistent", ranking=[("nothing", ""), ("coulomb_friction", "cart")]))
        assert (m.top1, m.top2) == (False, True)

    def test_classes_count_as_one_answer(self) -> None:
        bias = Planted("input_bias", "V", {"bias": 0.3})
        assert mark(label(bias), said("effect", ("constant_force", "cart"))).accepted == "right"
        assert mark(label(bias), said("effect", ("constant_force", "pendulum"))).accepted == "wrong"
        delay = Planted("input_delay", "V", {"delay": 0.01})
        lag = said("effect", ("input_lag", "V"))
        assert mark(label(delay), lag).accepted == "wrong"
        assert mark(label(delay, difficulty="buried"), lag).accepted == "right"

    def test_an_ambiguous_set_of_one_class_is_one_answer(self) -> None:
        bias = label(Planted("input_bias", "V", {"bias": 0.3}))
        inside = said("ambiguous", ("constant_force", "cart"), ambiguous_with=["input_bias@V"])
        beyond = said("ambiguous", ("constant_force", "cart"), ambiguous_with=["input_bias@V", "output_bias@x"])
        assert (mark(bias, inside).accepted, mark(bias, beyond).accepted) == ("right", "")

    def test_pairs_want_both(self) -> None:
        drag = Planted("quadratic_drag", "pendulum", {"drag": 0.1})
        both = said("effect", ("quadratic_drag", "pendulum"), ("coulomb_friction", "cart"))
        one = said("effect", ("coulomb_friction", "cart"))
        of = label(COULOMB, drag, difficulty="pair")
        assert (mark(of, both).top1, mark(of, both).accepted) == (True, "right")
        assert (mark(of, one).top1, mark(of, one).top2) == (False, True)

    def test_clean_cases_and_laws_outside(self) -> None:
        clean = label(difficulty="clean")
        for verdict, alarm in [("consistent", False), ("parameter", False), ("unknown", True), ("ambiguous", True)]:
            assert mark(clean, said(verdict)).false_alarm is alarm
        outside = label(Planted("outside_cubic_drag", "cart", {"drag": 1.0}), difficulty="outside")
        assert mark(outside, said("unknown")).unknown is True
        wrong = mark(outside, said("effect", ("quadratic_drag", "cart")))
        assert (wrong.unknown, wrong.accepted, wrong.top1) == (False, "wrong", None)

    def test_a_parameter_that_is_off_is_named_by_the_verdict(self) -> None:
        off = Planted("parameter_error", "M_c", {"offset": 0.1})
        moved = {"nominal": 0.57, "nominal_sd": 0.01, "before": 0.67, "after": 0.67, "sd": 0.001, "away": 10.0}
        still = {"nominal": 0.21, "nominal_sd": 0.004, "before": 0.21, "after": 0.212, "sd": 0.001, "away": 0.5}
        m = mark(label(off), said("parameter", parameters={"M_c": moved, "M_p": still}))
        assert m.top1 is True and m.answer == "parameter M_c"

    def test_an_error_is_a_mark_too(self) -> None:
        m = mark(label(COULOMB), {"error": "no convergence", "seconds": 2.0})
        assert (m.verdict, m.top1, m.note) == ("error", False, "no convergence")


class TestScore:
    def test_rates_and_bars(self) -> None:
        right = mark(label(COULOMB), said("effect", ("coulomb_friction", "cart"), location={"at": "cart"}))
        wrong = mark(label(COULOMB, difficulty="noisy"), said("effect", ("constant_force", "cart")))
        opened = score([right, wrong])
        bars = {bar.what: bar for bar in opened.bars}
        assert bars["top-1, 40 dB"].met is True and bars["top-1, 20 dB"].met is False
        assert bars["accepted wrong, 20 dB and above"].met is False
        assert bars["top-1, buried"].met is None
        assert opened.groups["all"]["accepted_wrong"] == 1
        json.dumps(opened.tree(), allow_nan=False)

    def test_the_matrix_has_the_right_answers_on_its_diagonal(self) -> None:
        marks = [
            mark(label(COULOMB), said("effect", ("coulomb_friction", "cart"))),
            mark(label(COULOMB), said("effect", ("stribeck_friction", "cart"))),
            mark(label(difficulty="clean"), said("consistent")),
        ]
        table = confusion(marks)
        assert table == {
            "coulomb_friction": {"coulomb_friction": 1, "stribeck_friction": 1},
            "nothing": {"consistent": 1},
        }
        shown = [t.get_text() for t in draw_matrix(table).axes[0].texts]
        assert shown.count("1") == 4  # three cells, and the number of clean cases

    def test_classes_name_what_exists(self) -> None:
        systems, difficulties = choices()
        for c in classes.CLASSES:
            assert c.system in systems and c.difficulties <= set(difficulties)
            model = ltp.zoo.load(c.system)
            document = model.to_toml()
            for answer in c.answers:
                at = answer.partition("@")[2]
                assert f"{at}" in document


class TestDraw:
    def test_what_is_seen_does_not_tell(self) -> None:
        case = draw("drive", "noisy", 3)
        assert case.model.effects == []
        assert all(e.name not in case.model.to_toml() for e in case.label.effects)
        assert len(case.train) == 2 and len(case.test) == 1

    def test_the_change_over_the_noise_is_as_asked(self) -> None:
        case = draw("cart_pendulum", "noisy", 2, effect="coulomb_friction", at="cart")
        assert case.label.decibels == 20.0 and 0.005 < case.label.change < 0.5
        bare = ltp.simulate(
            ltp.zoo.load("cart_pendulum"),
            {"V": case.train[0].inputs[:, 0]},
            t_end=10.0,
            dt=0.01,
        )
        for j, sigma in enumerate(case.label.sigma):
            change = np.sqrt(np.mean((case.train[0].outputs[:, j] - bare.outputs[:, j]) ** 2))
            # The noise follows both train records; the second one is smaller, and dry friction weighs more there.
            assert 3.0 * sigma < change < 30.0 * sigma

    def test_clean_noise_has_its_colour(self) -> None:
        for seed, colour, expected in [(2, "white", 0.0), (3, "ar1", 0.8)]:
            case = draw("drive", "clean", seed)
            assert case.label.noise == colour and case.label.effects == []
            y = case.train[0].outputs[:, 0]
            noise = y - np.convolve(np.pad(y, 25, mode="edge"), np.ones(51) / 51, mode="valid")
            noise = noise[:60]  # the carriage rests at first
            assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1] - expected) < 0.35

    def test_unknown_words_are_refused(self) -> None:
        for given in [("card", "open"), ("drive", "hard")]:
            with pytest.raises(ltp.InputError):
                draw(*given)
        with pytest.raises(ltp.InputError):
            draw("drive", "open", effect="coulomb_friction")


class TestRun:
    ARGUMENTS = ("prove", "--cases", "2", "--difficulty", "clean", "--difficulty", "open", "--system", "drive")

    def test_a_run_seals_scores_and_goes_on(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        out = tmp_path / "proof"
        arguments = [*self.ARGUMENTS, "--seeds", "tuning", "--out", str(out)]
        assert main(arguments) == 0
        first = capsys.readouterr().out
        seal = json.loads((out / "seal.json").read_text())
        assert seal["sha256"] in first and first.index(seal["sha256"]) < first.index("top-1")
        labels = [f.read_text() for f in sorted((out / "labels").iterdir())]
        assert commitment(labels, seal["salt"]) == seal["sha256"]
        assert hashlib.sha256(("\n".join(labels) + seal["salt"]).encode()).hexdigest() == seal["sha256"]
        assert (out / "confusion.svg").exists() and (out / "confusion.png").exists()
        # Killed in the second case: the first one stays.
        kept = (out / "results" / "0000.json").stat().st_mtime_ns
        (out / "results" / "0001.json").unlink()
        assert main([*arguments, "--json"]) == 0
        tree = json.loads(capsys.readouterr().out)
        assert len(tree["cases"]) == 2 and (out / "results" / "0000.json").stat().st_mtime_ns == kept

    def test_another_plan_or_a_changed_label_is_refused(self, tmp_path: Path) -> None:
        tasks = plan("tuning", cases=1, systems=["drive"], difficulties=["clean"])
        folder = Folder(tmp_path / "proof", tasks)
        case = draw("drive", "clean", 5)
        folder.write_case(0, case)
        folder.seal()
        model, train, test = read_case(folder.case(0))
        assert model.to_toml() == case.model.to_toml()
        for a, b in zip(train + test, case.train + case.test, strict=True):
            np.testing.assert_array_equal(a.outputs, b.outputs)
            np.testing.assert_array_equal(a.inputs, b.inputs)
        with pytest.raises(ltp.InputError, match="another proof"):
            Folder(tmp_path / "proof", plan("tuning", cases=2))
        folder.label_file(0).write_text(folder.label_file(0).read_text() + " ")
        with pytest.raises(ltp.InputError, match="not those that were sealed"):
            folder.seal()
