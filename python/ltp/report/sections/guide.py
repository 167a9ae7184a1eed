"""How to read this page: the words that it uses."""

from __future__ import annotations

from ..markup import Section, escape
from ..view import View

_WORDS = (
    ("measured", "ink", "What the recording holds. Missing samples stay missing and count nowhere."),
    ("nominal", "nominal", "The model with its parameters as stated."),
    ("refitted", "before",
     "The nominal equations with their parameters fitted to the training records, inside their stated uncertainty. "
     "What such a fit can absorb is a parameter error, not missing physics."),
    ("with the effect", "after", "The same, with what was found missing added to the equations and fitted with them."),
    ("simulation error", "",
     "Root mean square of measured minus simulated, over the standard deviation of the measured output. The "
     "simulation runs freely from an estimated initial state and is never corrected by the measurement on its way."),
    ("noise floor", "floor", "The error that measurement noise alone would leave. No honest model does better."),
    ("held-out", "", "Records that took no part in fitting the parameters; only their initial state is estimated."),
    ("score", "",
     "Difference to the best candidate. It rewards a smaller misfit on training and held-out records and charges for "
     "each parameter. Candidates that differ by a few units only explain the data equally well."),
    ("cannot be told apart", "rival",
     "The candidates that these recordings do not distinguish. An experiment in which they act differently does."),
    ("±", "", "One standard deviation. The bands around a law are two."),
)  # fmt: skip


def section(view: View) -> Section | None:
    """A list of the words of the page."""
    del view  # the words are the same for every diagnosis
    items = []
    for word, role, meaning in _WORDS:
        swatch = f'<span class="swatch" style="background: var(--{role})"></span>' if role else ""
        items.append(f"<dt>{swatch}{escape(word)}</dt><dd>{escape(meaning)}</dd>")
    sentence = "The words used above, and the colours that go with them."
    return Section("guide", "How to read this page", sentence, f'<dl class="guide">{"".join(items)}</dl>')
