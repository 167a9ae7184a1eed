"""Owns `python -m ltp`, which is the command `ltp`."""

from __future__ import annotations

import sys

from ltp.cli import main

if __name__ == "__main__":
    sys.exit(main())
