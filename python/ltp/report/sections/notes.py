"""The warnings of the diagnosis, as they were given."""

from __future__ import annotations

from ..markup import Section, prose
from ..view import View


def section(view: View) -> Section | None:
    """A list of the warnings; absent when there are none."""
    if not view.warnings:
        return None
    items = "\n".join(f"<li>{prose(text)}</li>" for text in view.warnings)
    count = "One thing" if len(view.warnings) == 1 else f"{len(view.warnings)} things"
    sentence = f"{count} to keep in mind before relying on this page."
    return Section("warnings", "Warnings", sentence, f'<ul class="warnings">\n{items}\n</ul>')
