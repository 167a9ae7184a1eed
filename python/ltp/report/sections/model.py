"""The model with what was found, as a document that can be saved and simulated."""

from __future__ import annotations

from ..markup import Section, details, escape
from ..view import View


def section(view: View) -> Section | None:
    """The TOML text of the model, folded."""
    if not view.model_text:
        return None
    what = f"with {view.effect_label} added" if view.effects else "with its refitted parameters"
    sentence = f"The model {view.model_name} {what}. Saved as a .toml file, it can be simulated and diagnosed again."
    lines = len(view.model_text.splitlines())
    body = details(f"TOML, {lines} lines", f"<pre><code>{escape(view.model_text)}</code></pre>")
    return Section("model", "The model", sentence, body)
