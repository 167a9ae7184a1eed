"""Owns: finding in a Rust source which paths start at the crate root, without a Rust parser.

Comments and literals are blanked first, so that a name in a sentence is no import. Then `crate::name`, `super::name`
and groups like `crate::{a::X, b::Y}` are read token by token; `super` is counted against the module path of the file
and the inline modules around it. Macros that build paths are out of reach.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

# strings (raw, byte, plain), characters (not lifetimes), comments; block comments do not nest here
BLANKED = re.compile(
    r"""//[^\n]*|/\*.*?\*/|b?r(?P<hashes>\#*)".*?"(?P=hashes)|b?"(?:\\.|[^"\\])*"|b?'(?:\\(?:u\{[^}]*\}|x..|.)|[^'\\])'""",
    re.DOTALL,
)
TOKEN = re.compile(r"[A-Za-z_]\w*|::|\$|[{}();,*]|\n|[^\sA-Za-z_]")


@dataclass(frozen=True)
class Mention:
    """A path that starts at the crate root: its first name, its line from 1, and how it is written."""

    name: str
    line: int
    text: str


@dataclass(frozen=True)
class Token:
    """A word or sign of the source with its line from 1."""

    text: str
    line: int


def tokens(source: str) -> list[Token]:
    """Words and signs of a source, without comments, literals and line ends."""
    blank = BLANKED.sub(lambda match: '""' + "\n" * match[0].count("\n"), source)
    found, line = [], 1
    for match in TOKEN.finditer(blank):
        if match[0] == "\n":
            line += 1
        else:
            found.append(Token(match[0], line))
    return found


def heads(words: list[Token], start: int) -> list[Token]:
    """First names of the path or group of paths whose first token is `words[start]`: `{a::X, b}` gives a and b."""
    if start >= len(words):
        return []
    if words[start].text != "{":
        return [words[start]]
    found, depth, expecting = [], 0, True
    for word in words[start:]:
        if word.text == "{":
            depth += 1
            expecting = expecting and depth == 1
        elif word.text == "}":
            depth -= 1
            if depth == 0:
                break
        elif word.text == ",":
            expecting = depth == 1
        elif expecting:
            found.append(word)
            expecting = False
    return found


def mentions(source: str, path: list[str]) -> Iterator[Mention]:
    """Paths from the crate root in a file whose module path is `path`, in the order of the source.

    A group or glob on the root itself counts each of its names; a glob of everything is the name `*`.
    """
    words = tokens(source)
    inline: list[str | None] = []  # one entry per open brace: the name of the inline module, or None
    i = 0
    while i < len(words):
        text = words[i].text
        if text == "{":
            is_module = i >= 2 and words[i - 2].text == "mod"
            inline.append(words[i - 1].text if is_module else None)
        elif text == "}":
            if inline:
                inline.pop()
        elif text in ("crate", "super", "self") and i + 1 < len(words) and words[i + 1].text == "::":
            here = [*path, *(name for name in inline if name is not None)]
            written = text
            ups = 1 if text == "super" else 0
            while i + 2 < len(words) and words[i + 1].text == "::" and words[i + 2].text == "super":
                ups, i = ups + 1, i + 2
                written += "::super"
            at_root = text == "crate" or (ups > 0 and ups >= len(here))
            if at_root and not is_visibility(words, i):
                for head in heads(words, i + 2):
                    if head.text != "self":
                        yield Mention(head.text, head.line, f"{written}::{head.text}")
        i += 1


def is_visibility(words: list[Token], i: int) -> bool:
    """Whether token `i` is the path of a `pub(in path)`, which restricts and does not import."""
    return i >= 1 and words[i - 1].text == "in" and i >= 2 and words[i - 2].text == "("


def exported_names(root_source: str) -> dict[str, str]:
    """Names that the crate root re-exports (`pub use module::Name`), with the module each comes from.

    Also `as` names, and macros that the root takes from a module.
    """
    words = tokens(root_source)
    found: dict[str, str] = {}
    for i, word in enumerate(words):
        if word.text != "use":
            continue
        statement = []
        for later in words[i + 1 :]:
            if later.text == ";":
                break
            statement.append(later.text)
        while len(statement) > 2 and statement[0] in ("crate", "self") and statement[1] == "::":
            statement = statement[2:]
        if statement and statement[0] != "{":
            for name in statement[1:]:
                if re.fullmatch(r"[A-Za-z_]\w*", name) and name not in ("as", "self"):
                    found[name] = statement[0]
    return found


def used_crates(source: str) -> Iterator[tuple[int, str]]:
    """Line and first name of every `use` and of `extern crate` in a source; groups give each of their names."""
    words = tokens(source)
    local = {words[i + 1].text for i, word in enumerate(words[:-1]) if word.text == "mod"}
    for i, word in enumerate(words):
        if word.text == "use":
            start = i + 2 if words[i + 1].text == "::" else i + 1
        elif word.text == "crate" and i >= 1 and words[i - 1].text == "extern":
            start = i + 1
        else:
            continue
        for head in heads(words, start):
            if head.text not in local and head.text.islower():
                yield head.line, head.text
