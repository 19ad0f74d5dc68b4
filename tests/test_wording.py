"""One thing is never told in the plural, nor given a spread."""

from __future__ import annotations

import ast
import re

import pytest

from b23d.schemas.wording import averaged, counted
from tests.test_architecture import FILES, ROOT

THINGS = "shapes shots draws tasks targets keypoints classes artifacts systems warnings problems runs scores rows faces"
PLURAL = re.compile(rf"^ (?:more |other |annotated )?(?:{'|'.join(THINGS.split())}|vertices)\b")


def test_one_is_singular() -> None:
    assert [counted(n, "draw") for n in (0, 1, 2)] == ["0 draws", "1 draw", "2 draws"]
    assert counted(2, "class") == "2 classes" and counted(1, "vertex", "vertices") == "1 vertex"
    assert counted(3, "vertex", "vertices") == "3 vertices"


def test_one_draw_has_no_spread() -> None:
    assert averaged(2) == "mean ± sd over 2 draws of shots"
    assert "±" not in averaged(1) and "1 draw of" in averaged(1)


@pytest.mark.parametrize("path", FILES)
def test_what_is_counted_may_be_one(path: str) -> None:
    """No text puts a number before a fixed plural: `counted` knows the singular."""
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        values = [ast.Constant(""), *getattr(node, "values", []), ast.Constant("")]
        for before, number, after in zip(values, values[1:], values[2:], strict=False):
            if not isinstance(node, ast.JoinedStr) or not isinstance(number, ast.FormattedValue):
                continue
            share = isinstance(before, ast.Constant) and before.value.endswith("/")  # "reading 1/1 shapes"
            fixed = isinstance(number.value, ast.Name) and number.value.id.isupper()
            told = isinstance(after, ast.Constant) and PLURAL.match(after.value)
            assert not told or share or fixed or number.format_spec, f"{path}:{node.lineno}: {ast.unparse(node)}"
