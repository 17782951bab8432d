"""The recipes run as they stand."""

import re
import runpy
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

RECIPES = Path(__file__).parents[2] / "docs" / "recipes.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```$", RECIPES.read_text("utf-8"), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_it_prints_what_it_says(block, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    script = tmp_path / "recipe.py"
    script.write_text(block, "utf-8")
    runpy.run_path(str(script))
    printed = capsys.readouterr().out
    for shape in re.findall(r"#\s(\(.*\))$", block, re.MULTILINE):
        assert f"torch.Size([{shape.strip('()')}])" in printed
    assert printed


def test_there_are_some():
    assert len(BLOCKS) > 3
