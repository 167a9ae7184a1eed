"""Owns the tests of `ltp.cycle` from Python: events, multipliers, other orbits, what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ltp

#: Newton's method on the closed-form flows of the hopper: phases of liftoff and touchdown, leading multiplier.
HOPPER = (0.024890445, 0.825119006, 0.160353154 + 0.832614057j)


@pytest.fixture(scope="module")
def hopper() -> ltp.LimitCycle:
    return ltp.cycle(ltp.zoo.hopper(), probes=12)


class TestHopper:
    def test_events_and_multipliers(self, hopper: ltp.LimitCycle) -> None:
        phases = {event.name: event.phase for event in hopper.events}
        assert phases["liftoff"] == pytest.approx(HOPPER[0], abs=1e-9)
        assert phases["touchdown"] == pytest.approx(HOPPER[1], abs=1e-9)
        assert hopper.multipliers[0] == pytest.approx(HOPPER[2], abs=1e-9)
        np.testing.assert_allclose(np.abs(hopper.multipliers[2:]), 0.0, atol=1e-9)
        assert hopper.stable
        assert not hopper.autonomous

    def test_modes_are_names(self, hopper: ltp.LimitCycle) -> None:
        liftoff, touchdown = hopper.events
        assert (liftoff.mode_before, liftoff.mode_after) == ("stance", "flight")
        assert (touchdown.mode_before, touchdown.mode_after) == ("flight", "stance")
        assert liftoff.time == pytest.approx(liftoff.phase * hopper.period)

    def test_trajectory_closes(self, hopper: ltp.LimitCycle) -> None:
        run = hopper.trajectory
        assert run.t[-1] - run.t[0] == pytest.approx(hopper.period)
        np.testing.assert_allclose(run.states[0], run.states[-1], atol=1e-9)
        assert hopper.start == pytest.approx(dict(zip(run.state_names, run.states[0], strict=True)))
        assert run.states[:, 0].max() == pytest.approx(0.29216, abs=5e-6)

    def test_multipliers_are_those_of_the_monodromy(self, hopper: ltp.LimitCycle) -> None:
        found = np.sort_complex(np.linalg.eigvals(hopper.monodromy))
        np.testing.assert_allclose(found, np.sort_complex(hopper.multipliers), atol=1e-7)

    def test_the_motion_that_stays_on_the_ground_is_reported(self, hopper: ltp.LimitCycle) -> None:
        assert hopper.domain is not None
        assert hopper.domain.probes == 12
        assert 0 < hopper.domain.returned < 12
        grounded = [other for other in hopper.others if not other.cycle.events]
        assert len(grounded) == 1
        heights = grounded[0].cycle.trajectory.states[:, 0]
        assert heights.min() == pytest.approx(0.1824, abs=5e-5)
        assert heights.max() == pytest.approx(0.2095, abs=5e-5)

    def test_a_constant_input_moves_it_by_u_over_k(self, hopper: ltp.LimitCycle) -> None:
        pushed = ltp.cycle(ltp.zoo.hopper(), inputs={"u_c": 2.0})
        assert pushed.start["h"] - hopper.start["h"] == pytest.approx(2.0 / 6500.0, rel=1e-7)

    def test_picture(self, hopper: ltp.LimitCycle) -> None:
        figure = hopper.plot("h", "hd", others=["ht"])
        assert [axes.get_xlabel() for axes in figure.axes] == ["h (m)", "phase of the cycle"]
        with pytest.raises(ltp.InputError, match="has no state 'x'"):
            hopper.plot("x", "hd")


class TestOthers:
    def test_a_period_without_a_clock_is_found(self) -> None:
        found = ltp.cycle(ltp.zoo.van_der_pol())
        assert found.autonomous
        assert found.period == pytest.approx(6.6632868593, abs=1e-8)  # mu = 1
        assert found.multipliers[0] == pytest.approx(1.0, abs=1e-7)

    def test_nothing_to_be_found(self) -> None:
        with pytest.raises((ltp.ConvergenceError, ltp.InputError)):
            ltp.cycle(ltp.zoo.bouncing_ball(), settle=3)


class TestRefuses:
    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"start": {"x": 1.0}}, "'x'|`x`"),
            ({"start": {"h": math.nan}}, "finite number"),
            ({"start": {"h": "high"}}, "expected a number"),
            ({"mode": "air"}, "air"),
            ({"period": -1.0}, "period"),
            ({"inputs": {"u": 1.0}}, "`u`"),
            ({"inputs": {"u_c": math.inf}}, "finite number"),
            ({"steps": 3}, "at least 10"),
            ({"probes": -1}, "probes is -1"),
        ],
    )
    def test_one_thing_that_cannot_be(self, options: dict[str, object], message: str) -> None:
        with pytest.raises(ltp.InputError, match=message):
            ltp.cycle(ltp.zoo.hopper(), **options)  # type: ignore[arg-type]
