"""Owns: the tests of tools/check_house.py. Each builds one small house that stands and spoils one thing in it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import check_house
import rust_paths

TOOLS = Path(check_house.__file__).resolve().parent

TABLE = """# House
<!-- layers: read by tools/check_house.py -->

| level | module | may use | owns |
|---|---|---|---|
| 0 | `error` | | `Error` |
| 1 | `numeric` | `error` | kernels |
| 2 | `model` | `error` `numeric` | `Model` |
| 3 | `simulate` | `error` `model` | `Trajectory` |
| 3 | `identify` | `error` `numeric` | `Htf` |

<!-- end of layers -->
"""

SOURCES = {
    "docs/house.md": TABLE,
    "crates/ltp-core/src/lib.rs": "//! Root.\npub mod error;\npub use error::{Error, Result as Outcome};\n",
    "crates/ltp-core/src/error.rs": "//! Errors.\npub struct Error;\n",
    "crates/ltp-core/src/numeric.rs": "//! Kernels.\nuse crate::error::Error;\n",
    "crates/ltp-core/src/model/mod.rs": "//! Models.\nmod parse;\nuse crate::{error::Error, numeric::{lsq, root}};\n",
    "crates/ltp-core/src/model/parse.rs": "//! Parser.\nuse super::Model;\nuse super::super::numeric::root;\n",
    "crates/ltp-core/src/simulate.rs": "//! Simulation.\nuse crate::Error;\nuse crate::model::Model;\n",
    "crates/ltp-core/src/identify.rs": "//! Identification.\nuse crate::numeric::Fft;\n",
    "crates/ltp-py/src/lib.rs": "//! Binding.\nuse ltp_core::model::Model;\nmod array;\nuse array::view;\n",
    "crates/ltp-py/src/array.rs": "//! Arrays.\nuse {numpy::PyArray1, pyo3::prelude::*};\n",
    "python/ltp/__init__.py": '"""Package."""\n',
}


@pytest.fixture
def house(tmp_path: Path) -> Path:
    for name, text in SOURCES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return tmp_path


def add(house: Path, name: str, text: str) -> None:
    path = house / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text((path.read_text(encoding="utf-8") if path.exists() else "") + text, encoding="utf-8")


def replace(house: Path, old: str, new: str) -> None:
    page = house / "docs/house.md"
    text = page.read_text(encoding="utf-8")
    assert text.count(old) == 1
    page.write_text(text.replace(old, new), encoding="utf-8")


def only_finding(house: Path) -> str:
    findings = check_house.check(house)
    assert len(findings) == 1, [str(f) for f in findings]
    return str(findings[0])


def test_the_unspoiled_house_stands(house: Path) -> None:
    assert check_house.check(house) == []
    assert check_house.main([str(house)]) == 0


CORE = "crates/ltp-core/src"


@pytest.mark.parametrize(
    ("file", "spoil", "expected"),
    [
        ("numeric.rs", "use crate::model::Model;\n", "numeric.rs:3: `numeric` uses `model`"),
        ("numeric.rs", "fn f() -> crate::model::Model {}\n", "numeric.rs:3: `numeric` uses `model`"),
        ("numeric.rs", "use super::model::Model;\n", "numeric.rs:3: `numeric` uses `model`"),
        (
            "numeric.rs",
            "use crate::{\n    error::Error,\n    model::{A, B},\n};\n",
            "numeric.rs:5: `numeric` uses `model`",
        ),
        (
            "numeric.rs",
            "mod tests {\n    use super::super::simulate::run;\n}\n",
            "numeric.rs:4: `numeric` uses `simulate`",
        ),
        ("simulate.rs", "use crate::numeric::root;\n", "simulate.rs:4: `simulate` uses `numeric`"),
        ("model/parse.rs", "use super::super::simulate::run;\n", "parse.rs:4: `model` uses `simulate`"),
        ("error.rs", "pub use crate::Outcome;\nuse crate::numeric as n;\n", "error.rs:4: `error` uses `numeric`"),
        ("identify.rs", "use crate::model::Model;\n", "identify.rs:3: `identify` uses `model`: an identification"),
        ("model/mod.rs", "use crate::Nowhere;\n", "mod.rs:4: `crate::Nowhere` starts at no module"),
        ("model/mod.rs", "use crate::*;\n", "mod.rs:4: `crate::*` starts at no module"),
    ],
)
def test_an_arrow_that_the_table_lacks(house: Path, file: str, spoil: str, expected: str) -> None:
    add(house, f"{CORE}/{file}", spoil)
    assert any(expected in str(f) for f in check_house.check(house))
    assert check_house.main([str(house)]) == 1


@pytest.mark.parametrize(
    "harmless",
    [
        "// use crate::model::Model;\n",
        "/* crate::model */\n",
        '/// See [`crate::model`].\nconst A: &str = "crate::model::Model";\n',
        'const B: &str = r#"a "crate::model" b"#;\n',
        "pub(in crate::numeric) fn f<'a>(x: &'a str) -> char { '\"' }\n",
        "mod tests {\n    use super::*;\n    use super::root;\n}\n",
        "mod tests {\n    mod deeper {\n        use super::super::root;\n    }\n}\n",
        "use self::root::find;\n",
    ],
)
def test_what_is_no_arrow(house: Path, harmless: str) -> None:
    add(house, f"{CORE}/numeric.rs", harmless)
    assert check_house.check(house) == []


def test_a_cycle_between_modules(house: Path) -> None:
    add(house, f"{CORE}/error.rs", "use crate::model::Model;\n")
    text = "\n".join(map(str, check_house.check(house)))
    assert "`error` -> `model` -> `error`" in text
    assert "error.rs:3: `error` uses `model`" in text


def test_a_long_cycle_is_told_once(house: Path) -> None:
    add(house, f"{CORE}/error.rs", "use crate::simulate::Run;\n")
    rings = [str(f) for f in check_house.check(house) if "`error` -> `simulate` -> `model` -> `error`" in str(f)]
    assert len(rings) == 1


def test_a_module_without_a_row(house: Path) -> None:
    add(house, f"{CORE}/gadget.rs", "//! Gadget.\n")
    assert "gadget.rs:1: module `gadget` has no row" in only_finding(house)


def test_a_row_without_a_module(house: Path) -> None:
    (house / CORE / "identify.rs").unlink()
    assert "house.md:10: row `identify` has no module" in only_finding(house)


def test_a_row_that_names_a_higher_level(house: Path) -> None:
    replace(house, "| `numeric` | `error` |", "| `numeric` | `error` `model` |")
    assert "`numeric` (level 1) may use `model` (level 2)" in only_finding(house)


def test_a_row_that_names_an_unknown_module(house: Path) -> None:
    replace(house, "| `numeric` | `error` |", "| `numeric` | `error` `eror` |")
    assert "`numeric` may use `eror`, which has no row" in only_finding(house)


def test_a_table_that_opens_the_model_to_identify(house: Path) -> None:
    replace(house, "`identify` | `error` `numeric`", "`identify` | `error` `model` `numeric`")
    assert "`identify` may never see the model" in only_finding(house)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<!-- layers: read by tools/check_house.py -->", ""),
        ("| 2 | `model` |", "| two | `model` |"),
        ("| 2 | `model` |", "| 2 | model |"),
        ("| 3 | `simulate` |", "| 3 | `model` |"),
    ],
)
def test_a_table_that_cannot_be_read(house: Path, old: str, new: str, capsys: pytest.CaptureFixture[str]) -> None:
    replace(house, old, new)
    assert check_house.main([str(house)]) == 2
    assert "house.md" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("file", "language"),
    [(f"{CORE}/model/parse.rs", "//\n"), ("python/ltp/__init__.py", "#\n"), ("tests/long.py", "#\n")],
)
def test_a_file_past_the_ceiling(house: Path, file: str, language: str) -> None:
    add(house, file, language * 501)
    assert f"{file}:501: 50" in only_finding(house)


def test_a_file_at_the_ceiling(house: Path) -> None:
    add(house, f"{CORE}/model/parse.rs", "//\n" * 497)
    assert check_house.check(house) == []


def test_a_rust_file_without_a_head(house: Path) -> None:
    add(house, "crates/ltp-core/tests/late.rs", "use std::mem;\n//! Too late.\n")
    assert "late.rs:1: no '//!' head" in only_finding(house)


def test_a_module_of_the_package_without_a_docstring(house: Path) -> None:
    add(house, "python/ltp/report.py", "# a comment is no docstring\n")
    assert "report.py:1: no module docstring" in only_finding(house)


def test_files_that_are_not_ours(house: Path) -> None:
    add(house, "target/debug/build/out.rs", "fn main() {}\n" * 600)
    add(house, ".venv/lib/x.py", "x = 1\n" * 600)
    assert check_house.check(house) == []


@pytest.mark.parametrize(
    "spoil", ["use faer::Mat;\n", "use {std::mem, rayon::prelude::*};\n", "extern crate nalgebra;\n"]
)
def test_a_binding_that_does_more_than_translate(house: Path, spoil: str) -> None:
    add(house, "crates/ltp-py/src/array.rs", spoil)
    assert "array.rs:3: the binding uses the crate" in only_finding(house)


def test_names_exported_by_the_root() -> None:
    source = "pub use error::{Error, Result as Outcome};\npub use self::model::Model;\nuse std::fmt;\n"
    found = rust_paths.exported_names(source)
    assert {name: found[name] for name in ("Error", "Outcome", "Model")} == {
        "Error": "error",
        "Outcome": "error",
        "Model": "model",
    }


def test_the_command_line_says_what_it_found(house: Path) -> None:
    command = [sys.executable, str(TOOLS / "check_house.py"), str(house)]
    good = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (good.returncode, good.stdout.strip()) == (0, "house: it stands as docs/house.md says")
    add(house, f"{CORE}/identify.rs", "use crate::model::Model;\n")
    bad = subprocess.run(command, capture_output=True, text=True, check=False)
    assert bad.returncode == 1
    assert bad.stdout.splitlines()[0].startswith(f"{CORE}/identify.rs:3: ")


def test_this_project_stands() -> None:
    assert [str(f) for f in check_house.check(TOOLS.parent)] == []
