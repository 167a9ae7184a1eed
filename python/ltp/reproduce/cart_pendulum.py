"""Owns `ltp.reproduce.cart_pendulum`: all of Duyul 2018, table by table, its open questions, and what lies beyond it.

A. D. Duyul, "Control of an underactuated system around a periodic orbit", M.Sc. thesis, Middle East Technical
University, 2018.
"""

from __future__ import annotations

import os
from collections.abc import Callable

from ltp.reproduce.duyul import beyond, designs, effort, example, hanging, inverted, lift, references
from ltp.reproduce.duyul.rig import Rig
from ltp.reproduce.page import Front
from ltp.reproduce.result import Chapter, Reproduction
from ltp.reproduce.work import Progress, Work

WORK = Work[Rig](
    Front(
        page="cart_pendulum.html",
        title="The cart-pendulum, reproduced",
        lead="Duyul (2018) designed feedback around periodic orbits of a cart with a pendulum by harmonic balance, and "
        "left open why some designs fail. This page prints the thesis' figures beside those of ltp, shows which are "
        "wrong and why, and goes on to feedback that is robust on the true orbits.",
        facts="Gains are those of u = V0(t) - K (z - z_ref) with z = [x, theta, xd, thetad], angles from the downward "
        "vertical.",
    ),
    (
        ("an example", example.chapter),
        ("references", references.chapter),
        ("the lift", lift.chapter),
        ("the hanging pendulum", hanging.chapter),
        ("the inverted pendulum", inverted.chapter),
        ("designs", designs.chapter),
        ("beyond the thesis", beyond.chapter),
        ("effort", effort.chapter),
    ),
)


def cart_pendulum(
    out: str | os.PathLike[str] | None = None,
    quick: bool = False,
    *,
    progress: Progress | None = None,
    say: Callable[[Chapter], None] | None = None,
) -> Reproduction:
    """Reproduce the thesis, and answer what it leaves open: references, eigenvalues, loops, designs, robustness, cost.

    out: a folder for the page `cart_pendulum.html` and its figures; made if it is not there. None writes nothing.
    quick: fewer starts, truncations and runs, in a third of the time.
    progress: called with a message and the finished fraction; say: called with each chapter when it is done.

    Nothing random is left: searches have their seeds. Raises `InputError` when `out` cannot be written to.
    """
    return WORK.perform(Rig(quick, progress), out, progress, say)
