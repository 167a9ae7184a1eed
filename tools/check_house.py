"""Owns: the check that the sources still stand as docs/house.md says.

Reads the layer table of docs/house.md and the sources of the crates and of python/ltp, and prints `file:line: what is
wrong and what to do` for each finding. Exit code 0: the house stands; 1: findings; 2: the table cannot be read.

Usage: python tools/check_house.py [ROOT]. Needs Python 3.10 and nothing else. How Rust paths are found in a source file
is told in rust_paths.py beside this file.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rust_paths import Mention, exported_names, mentions, used_crates

CEILING = 500
CORE = Path("crates/ltp-core/src")
BINDING = Path("crates/ltp-py/src")
PACKAGE = Path("python/ltp")
PAGE = Path("docs/house.md")
# `target` is cargo's, `.venv` pip's; the rest are caches
NOT_OURS = {"target", "__pycache__", "node_modules"}
IDENTIFY_NEVER = {"model", "simulate", "cycle", "linearize"}
BINDING_MAY = {"std", "core", "alloc", "crate", "self", "super", "ltp_core", "pyo3", "numpy", "serde_json"}


@dataclass(frozen=True, order=True)
class Finding:
    """One thing that is wrong: file (relative to the root), line from 1, and a sentence that ends with what to do."""

    file: str
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.text}"


@dataclass(frozen=True)
class Row:
    """One row of the layer table: level, modules it may use, and its line on the page."""

    level: int
    may_use: frozenset[str]
    line: int


class TableError(Exception):
    """The page or its table cannot be read."""


def read_table(root: Path) -> dict[str, Row]:
    """Rows of the layer table by module, between `<!-- layers` and `<!-- end of layers -->` in docs/house.md."""
    page = root / PAGE
    if not page.is_file():
        raise TableError(f"{PAGE}: no such file; it holds the layer table that this check reads")
    rows: dict[str, Row] = {}
    inside = False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
        if line.startswith("<!-- layers"):
            inside = True
        elif line.startswith("<!-- end of layers"):
            break
        elif inside and line.startswith("|"):
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            if cells[0] == "level" or set(cells[0]) <= {"-", ":", " "}:
                continue
            module = re.fullmatch(r"`(\w+)`", cells[1]) if len(cells) >= 3 else None
            if module is None or not cells[0].isdigit():
                raise TableError(
                    f"{PAGE}:{number}: expected '| level | `module` | `used` ... | owns |', found {line!r}"
                )
            if module[1] in rows:
                raise TableError(f"{PAGE}:{number}: `{module[1]}` has two rows; keep one")
            rows[module[1]] = Row(int(cells[0]), frozenset(re.findall(r"`(\w+)`", cells[2])), number)
    if not rows:
        raise TableError(f"{PAGE}: no layer table between '<!-- layers' and '<!-- end of layers -->'; put it back")
    return rows


def check_table(rows: dict[str, Row], modules: dict[str, list[Path]], root: Path) -> Iterator[Finding]:
    """The table against itself and against the modules that exist."""
    page = PAGE.as_posix()
    for name, row in rows.items():
        if name not in modules:
            yield Finding(page, row.line, f"row `{name}` has no module in {CORE.as_posix()}; take the row out")
        for used in sorted(row.may_use):
            if used not in rows:
                yield Finding(
                    page, row.line, f"`{name}` may use `{used}`, which has no row; add the row or take it out"
                )
            elif rows[used].level >= row.level:
                levels = f"`{name}` (level {row.level}) may use `{used}` (level {rows[used].level})"
                yield Finding(page, row.line, f"{levels}; only lower levels may be used")
        if name == "identify" and row.may_use & IDENTIFY_NEVER:
            seen = ", ".join(f"`{m}`" for m in sorted(row.may_use & IDENTIFY_NEVER))
            yield Finding(page, row.line, f"`identify` may never see the model, its row names {seen}; take it out")
    for name in sorted(modules.keys() - rows.keys() - {""}):
        shown = modules[name][0].relative_to(root).as_posix()
        yield Finding(shown, 1, f"module `{name}` has no row in {page}; give it a level and what it may use")


def core_modules(root: Path) -> dict[str, list[Path]]:
    """Source files of the core by top-level module; the crate root itself is under the empty name."""
    files: dict[str, list[Path]] = {}
    for path in sorted((root / CORE).rglob("*.rs")):
        first = path.relative_to(root / CORE).parts[0]
        name = "" if first == "lib.rs" else first.removesuffix(".rs")
        files.setdefault(name, []).append(path)
    return files


def module_path(root: Path, file: Path) -> list[str]:
    """Module path of a source file: `model/parse.rs` is `["model", "parse"]`, `model/mod.rs` is `["model"]`."""
    parts = list(file.relative_to(root / CORE).with_suffix("").parts)
    return parts[:-1] if parts[-1] in ("mod", "lib") else parts


def check_arrows(root: Path, rows: dict[str, Row]) -> Iterator[Finding]:
    """Imports between the modules of the core against the table, and cycles between modules."""
    files = core_modules(root)
    modules = files.keys() - {""}
    exported: dict[str, str] = {}
    for file in files.get("", []):
        exported = exported_names(file.read_text(encoding="utf-8"))
    first: dict[tuple[str, str], Finding] = {}
    for module in sorted(modules):
        for file in files[module]:
            shown = file.relative_to(root).as_posix()
            for mention in mentions(file.read_text(encoding="utf-8"), module_path(root, file)):
                target = mention.name if mention.name in modules else exported.get(mention.name)
                if target is None:
                    yield unknown(shown, mention)
                elif target != module:
                    arrow = Finding(shown, mention.line, f"`{module}` uses `{target}`")
                    first.setdefault((module, target), arrow)
                    yield from check_arrow(arrow, module, target, rows)
    yield from check_cycles(first)


def unknown(file: str, mention: Mention) -> Finding:
    """The finding for a path from the crate root whose first name is neither a module nor exported by the root."""
    return Finding(file, mention.line, f"`{mention.text}` starts at no module of the core; name the module it lives in")


def check_arrow(arrow: Finding, module: str, target: str, rows: dict[str, Row]) -> Iterator[Finding]:
    """One arrow against the table."""
    if module == "identify" and target in IDENTIFY_NEVER:
        yield Finding(
            arrow.file, arrow.line, f"{arrow.text}: an identification may never see the model; work on data alone"
        )
    elif module in rows and target not in rows[module].may_use:
        allowed = ", ".join(f"`{m}`" for m in sorted(rows[module].may_use)) or "nothing"
        law = f"its row in {PAGE.as_posix()} allows {allowed}"
        yield Finding(arrow.file, arrow.line, f"{arrow.text}, and {law}; move the shared noun down, or change the row")


def check_cycles(arrows: dict[tuple[str, str], Finding]) -> Iterator[Finding]:
    """Cycles between modules, each told once, at the arrow that leaves its alphabetically first module."""
    uses: dict[str, set[str]] = {}
    for module, target in arrows:
        uses.setdefault(module, set()).add(target)
    told: set[frozenset[str]] = set()

    def walk(path: list[str]) -> Iterator[Finding]:
        for target in sorted(uses.get(path[-1], ())):
            if target == path[0] and frozenset(path) not in told:
                told.add(frozenset(path))
                arrow = arrows[path[0], path[1] if len(path) > 1 else target]
                ring = " -> ".join(f"`{m}`" for m in [*path, path[0]])
                yield Finding(arrow.file, arrow.line, f"modules use each other in a cycle: {ring}; cut one arrow")
            elif target > path[0] and target not in path:
                yield from walk([*path, target])

    for module in sorted(uses):
        yield from walk([module])


def check_binding(root: Path) -> Iterator[Finding]:
    """Imports of the binding crate: it translates, so it needs the core, Python and numpy only."""
    for file in sorted((root / BINDING).rglob("*.rs")):
        for line, crate in used_crates(file.read_text(encoding="utf-8")):
            if crate not in BINDING_MAY:
                text = f"the binding uses the crate `{crate}`; it only translates: move the work into ltp-core"
                yield Finding(file.relative_to(root).as_posix(), line, text)


def check_files(root: Path) -> Iterator[Finding]:
    """Length and head of every source file."""
    for path in sorted([*root.rglob("*.rs"), *root.rglob("*.py")]):
        relative = path.relative_to(root)
        if any(part in NOT_OURS or part.startswith(".") for part in relative.parts):
            continue
        shown = relative.as_posix()
        text = path.read_text(encoding="utf-8")
        length = len(text.splitlines())
        if length > CEILING:
            yield Finding(
                shown, CEILING + 1, f"{length} lines, the ceiling is {CEILING}; split it, one method one file"
            )
        if path.suffix == ".rs" and not text.startswith("//!"):
            yield Finding(shown, 1, "no '//!' head; say in the first lines what the file owns")
        if path.suffix == ".py" and relative.is_relative_to(PACKAGE) and not has_docstring(text):
            yield Finding(shown, 1, "no module docstring; say in the first lines what the file owns")


def has_docstring(text: str) -> bool:
    """Whether a Python source begins with a docstring; one that does not parse is left to the interpreter."""
    try:
        return ast.get_docstring(ast.parse(text)) is not None
    except SyntaxError:
        return True


def check(root: Path) -> list[Finding]:
    """All findings for the checkout at `root`, by file and line; TableError when the page is unreadable."""
    rows = read_table(root)
    found = [
        *check_table(rows, core_modules(root), root),
        *check_arrows(root, rows),
        *check_binding(root),
        *check_files(root),
    ]
    return sorted(set(found))


def main(arguments: list[str]) -> int:
    """Print the findings for the checkout named by the first argument, or the one this file lies in."""
    root = Path(arguments[0]) if arguments else Path(__file__).resolve().parent.parent
    try:
        findings = check(root)
    except TableError as error:
        print(error, file=sys.stderr)
        return 2
    for finding in findings:
        print(finding)
    count = len(findings)
    print(f"house: {count} finding{'s' * (count != 1)}" if findings else "house: it stands as docs/house.md says")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
