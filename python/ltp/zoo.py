"""Owns the zoo in Python: the reference models that ship with the library, each as a function of its name.

`ltp.zoo.hopper()` gives the model, `ltp.zoo.text("hopper")` its document with the closed form or reference in its
header, `ltp.zoo.names()` the list.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable

from ltp import _ltp
from ltp.model import Model


def names() -> list[str]:
    """Names of the reference models."""
    return list(_ltp.zoo_names())


def text(name: str) -> str:
    """The document of one reference model, as TOML. Raises `InputError` with the nearest names for an unknown one."""
    known = names()
    if name not in known:
        near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        raise _ltp.InputError(f"zoo: no model named {name!r}; {hint}the zoo holds {', '.join(known)}")
    return _ltp.zoo_text(name)


def load(name: str) -> Model:
    """One reference model by its name. Raises `InputError` for an unknown one."""
    return Model.from_toml(text(name), f"zoo:{name}")


def __getattr__(name: str) -> Callable[[], Model]:
    if name.startswith("_") or name not in names():
        raise AttributeError(f"module 'ltp.zoo' has no model {name!r}; it has {', '.join(names())}")

    def reference_model() -> Model:
        return load(name)

    reference_model.__name__ = reference_model.__qualname__ = name
    reference_model.__doc__ = f"The reference model {name!r} of the zoo."
    return reference_model


def __dir__() -> list[str]:
    return [*globals(), *names()]
