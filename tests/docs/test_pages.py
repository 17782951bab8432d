"""Every block of Python in README and docs runs, and every command there is one that works."""

import dataclasses
import importlib
import importlib.util
import re
import runpy
import shlex
import sys
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from locomotion.cli.composing import compose_jobs, normalised
from locomotion.evaluation.shipped import POLICIES

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")])
#: Of packages that are shown in parts, whole in tests/extension; or with a window.
NOT_ALONE = ("@", "readings.register", "viewer.launch")
#: Train for as long as a gait takes.
LONG = "+experiment="


def blocks(language):
    """The fenced blocks of all pages in a language, with the page's name and the line."""
    for page in PAGES:
        for token in MarkdownIt().parse(page.read_text("utf-8")):
            if token.type == "fence" and token.info == language:
                yield pytest.param(token.content, id=f"{page.name}:{token.map[0] + 1}")


def commands():
    for block in blocks("sh"):
        lines = block.values[0].replace("\\\n", " ").splitlines()
        for number, line in enumerate(lines):
            for part in line.split("&&"):
                words = shlex.split(part, comments=True)
                if words[:2] == ["python", "-m"] and words[2].startswith("locomotion."):
                    yield pytest.param(words[2], words[3:], id=f"{block.id}+{number}")


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with the files that pages name, as the pages write them."""
    for block in blocks("yaml"):
        content = block.values[0]
        named = re.match(r"# (\S+\.yaml)\n", content)
        if named:
            path = tmp_path / named[1]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize(
    "block",
    [b for b in blocks("python") if not any(word in b.values[0] for word in (*NOT_ALONE, LONG))],
)
def test_python_prints_what_it_says(block, place, capsys):
    script = place / "block.py"
    script.write_text(block, "utf-8")
    runpy.run_path(str(script))
    printed = capsys.readouterr().out
    for shape in re.findall(r"#\s(\(.*\))$", block, re.MULTILINE):
        assert f"torch.Size([{shape.strip('()')}])" in printed
    assert printed


@pytest.mark.parametrize(
    ("module", "arguments"),
    [c for c in commands() if c.values[0] == "locomotion.train" and "--help" not in c.values[1]],
)
def test_training_would_start(module, arguments, place):
    flags = [word for word in arguments if word.startswith("--")]
    folders = [Path(flag.partition("=")[2]) for flag in flags if flag.startswith("--config-dir")]
    # One seed of a sweep is checked as all of them are.
    words = [re.sub(r"^seed=.*", "seed=0", word) for word in arguments]
    overrides = [word for word in words if word not in flags]
    if any(word.startswith("resume=") for word in overrides):
        assert len(overrides) == 1
        return
    if any(word.startswith("+plugins") for word in overrides):
        return  # tests/extension runs it
    assert compose_jobs(normalised(overrides), "--multirun" in flags, *folders)


@pytest.mark.parametrize(
    ("module", "arguments"),
    [c for c in commands() if c.values[0].rpartition(".")[2] in ("evaluate", "watch", "export")],
)
def test_a_policy_would_be_taken(module, arguments, place, monkeypatch):
    command = importlib.import_module(module).COMMAND
    given = [f"run={POLICIES / 'gecko'}" if word.startswith("run=") else word for word in arguments]
    monkeypatch.setattr(sys, "argv", [module, *given])
    done = []
    dataclasses.replace(command, job=lambda *asked: done.append(asked), check=None).main()
    assert len(done) == 1


@pytest.mark.parametrize(("module", "arguments"), list(commands()))
def test_what_a_command_names_is_there(module, arguments):
    assert importlib.util.find_spec(module)


def test_pages_have_blocks_and_commands():
    assert len(list(blocks("python"))) > 8
    assert len(list(commands())) > 30


def test_readme_begins_with_a_gait_and_the_tests():
    first, second, *_ = (block.values[0] for block in blocks("sh") if "README" in block.id)
    assert "locomotion.train" in first and "run=runs/gecko web=true" in first
    ci = (ROOT / ".ci" / "run").read_text("utf-8")
    assert second.strip() in ci
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= 150


@pytest.mark.slow
def test_the_site_builds_without_warnings(tmp_path):
    pytest.importorskip("mkdocs", reason="needs packages: pip install -e '.[docs]'")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    config = load_config(str(ROOT / "mkdocs.yml"), strict=True, site_dir=str(tmp_path))
    build(config)
    assert (tmp_path / "api" / "index.html").stat().st_size > 50_000
