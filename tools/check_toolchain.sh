#!/usr/bin/env bash
# Owns: one clear sentence for each tool that a bare checkout needs and does not find, or finds too old.
# Usage: tools/check_toolchain.sh [PYTHON], from the root of the checkout; silent when all is well.
set -euo pipefail

python=${1:-python3}
manifest=${0%/*}/../Cargo.toml
wanted_rust=$(sed -n 's/^rust-version *= *"\([0-9.]*\)".*/\1/p' "$manifest")
wanted_python=3.10
failed=0

say() {
    echo "ltp: $1" >&2
    failed=1
}

older() { # is version $1 older than version $2
    [ "$1" != "$2" ] && [ "$(printf '%s\n%s\n' "$1" "$2" | sort -V | head -n 1)" = "$1" ]
}

if ! command -v cargo >/dev/null || ! command -v rustc >/dev/null; then
    say "Rust is missing (no cargo or rustc on the PATH): install Rust $wanted_rust or newer, for example with rustup from https://rustup.rs, and open a new shell."
else
    found=$(rustc --version 2>/dev/null | sed -n 's/^rustc \([0-9]*\.[0-9]*\).*/\1/p')
    if [ -z "$found" ]; then
        say "rustc is on the PATH but does not run: 'rustc --version' shows why; with rustup, 'rustup default stable' chooses a toolchain."
    elif older "$found" "$wanted_rust"; then
        say "Rust $found is too old, ltp needs $wanted_rust or newer: run 'rustup update stable'."
    fi
fi

if ! command -v "$python" >/dev/null; then
    say "Python is missing (no '$python' on the PATH): install Python $wanted_python or newer, or name yours with 'make PYTHON=/path/to/python3'."
else
    found=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null || true)
    if [ -z "$found" ]; then
        say "'$python' is on the PATH but does not run as Python: name another with 'make PYTHON=/path/to/python3'."
    elif older "$found" "$wanted_python"; then
        say "Python $found is too old, ltp needs $wanted_python or newer: install one and name it with 'make PYTHON=/path/to/python3'."
    elif ! "$python" -c 'import venv, ensurepip' 2>/dev/null; then
        say "Python $found has no venv module: install it (on Debian and Ubuntu: 'apt-get install python3-venv')."
    fi
fi

if ! command -v cc >/dev/null; then
    say "there is no C compiler to link with (no 'cc' on the PATH): install one (on Debian and Ubuntu: 'apt-get install build-essential'; on macOS: 'xcode-select --install')."
fi

exit "$failed"
