"""Owns `prove`: cases with concealed physics are drawn, sealed, diagnosed from files alone, opened and scored.

Read in order: `plan` (which cases), `folder` (what stands on disk), `classes` (effects that no data can tell apart),
`mark` (one case), `score` (all of them, and the bars), `run` (the whole walk).
"""

from __future__ import annotations

from ltp.prove.mark import Mark, mark
from ltp.prove.plan import Task, plan
from ltp.prove.run import prove
from ltp.prove.score import Bar, Score, score

__all__ = ["Bar", "Mark", "Score", "Task", "mark", "plan", "prove", "score"]
