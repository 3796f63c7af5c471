"""The documents' pictures are there and shown; the artists' page knows each refusal by its words."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from blenders import ADDON, ROOT

PAGES = (ROOT / "README.md", ADDON / "README.md")
PICTURES = ADDON / "pictures"
LARGE_BYTES = 150_000


def shown(page: Path) -> set[Path]:
    """The pictures that a page shows."""
    return {(page.parent / name).resolve()
            for name in re.findall(r'(?:\]\(|src=")([^)"]+\.png)', page.read_text())}


def text(node: ast.expr) -> str:
    """A string's words, with … for what is filled in; "" for anything that is no string."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(part.value if isinstance(part, ast.Constant) else "…"
                       for part in node.values)
    return ""


def refusals(file: str) -> list[str]:
    """What a module's sentences say is wrong: up to their colon or full stop."""
    found = []
    for node in ast.walk(ast.parse((ADDON / "blender" / file).read_text())):
        if isinstance(node, ast.Yield):
            found.append(text(node.value))
        elif isinstance(node, ast.Return) and node.value is not None:
            found += [text(each) for each in getattr(node.value, "elts", [node.value])]
    return [re.split(r"[:.](?: |$)", sentence)[0] for sentence in found
            if re.search(r"\w \w", sentence)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.parent.name)
def test_what_a_page_shows_is_there(page: Path) -> None:
    assert shown(page)
    for picture in shown(page):
        assert picture.read_bytes().startswith(b"\x89PNG"), picture
        assert picture.stat().st_size < LARGE_BYTES, picture


def test_every_picture_is_shown() -> None:
    everywhere = set().union(*map(shown, PAGES))
    assert {picture.resolve() for picture in PICTURES.glob("*.png")} == everywhere


@pytest.mark.parametrize("file", ["checks.py", "strokes.py", "mesh.py"])
def test_the_page_knows_each_refusal(file: str) -> None:
    page = " ".join((ADDON / "README.md").read_text().split())
    said = refusals(file)
    assert said
    assert [sentence for sentence in said if sentence not in page] == []
