"""Owns how files are written: whole or not at all.

A file is written under a temporary name in the same folder and then renamed, so that a crash, a full disk or Ctrl-C
leaves either the old file or the new one, never half of one.
"""

from __future__ import annotations

import contextlib
import glob
import os
import secrets
from pathlib import Path

from ltp._ltp import InputError


def check_writable(path: str | os.PathLike[str]) -> Path:
    """Say now, before a long computation, that `path` could not be written.

    Returns the path. Raises `InputError` if the folder is missing, may not be written to, or `path` is a folder.
    """
    target = Path(path)
    folder = target.parent
    if not folder.is_dir():
        raise InputError(f"{target}: cannot write, the folder {str(folder)!r} does not exist; create it first")
    if target.is_dir():
        raise InputError(f"{target}: cannot write, this is a folder; give the name of a file")
    if not os.access(folder, os.W_OK):
        raise InputError(f"{target}: cannot write, no permission in the folder {str(folder)!r}; choose another folder")
    return target


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write `text` as UTF-8 to `path`, replacing an existing file in one step; returns the path.

    Raises `InputError` when the place cannot be written to.
    """
    return write_bytes(path, text.encode())


def write_bytes(path: str | os.PathLike[str], data: bytes) -> Path:
    """Write `data` to `path`, replacing an existing file in one step; returns the path.

    Raises `InputError` when the place cannot be written to.
    """
    target = check_writable(path)
    # The name is known before the file is there: Ctrl-C at any moment finds what to remove.
    temporary = target.parent / f".{target.name}.{secrets.token_hex(4)}.part"
    try:
        try:
            with open(temporary, "xb") as stream:
                stream.write(data)
            os.replace(temporary, target)
        except BaseException:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary)
            raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{target}: cannot write, {reason}; choose another place or free some space") from error
    return target


def sweep(path: str | os.PathLike[str]) -> None:
    """Remove what a kill in the middle of writing `path` left beside it."""
    target = Path(path)
    for left in target.parent.glob(f".{glob.escape(target.name)}.*.part"):
        left.unlink(missing_ok=True)


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """The bytes of a file. Raises `InputError` when it is missing, a folder, or may not be read."""
    source = Path(path)
    try:
        return source.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{source}: no such file (looked in {source.absolute().parent}); check the path") from None
    except IsADirectoryError:
        raise InputError(f"{source}: this is a folder; give the name of a file in it") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{source}: cannot read, {reason}; check the file and its permissions") from error
