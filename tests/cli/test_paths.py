"""Paths on a command line: any name that the file system takes, by one rule for all keys."""

import os
import re
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from locomotion import compose
from locomotion.cli.composing import compose_jobs, normalised, parse
from locomotion.options import ConfigError
from locomotion.options.paths import quoted, read_path

pytestmark = pytest.mark.slow


@st.composite
def names(draw):
    """Names of files as bytes that are no "/" and no 0, many of them with what a grammar has a meaning for."""
    special = st.sampled_from("=,%#$~'\"\\[](){}:;&|!?*<>@+-. \t\n\x1béü日🦎\udcff")
    pieces = st.one_of(special, st.characters(exclude_characters="/\0", codec="utf-8"))
    words = st.sampled_from(
        ["${", "\\${", "???", "null", "true", "1e3", "${now:%Y}", "${oc.env:HOME}", "~"]
    )
    name = "".join(draw(st.lists(st.one_of(pieces, words), min_size=1, max_size=12)))
    assume(name not in (".", "..") and len(os.fsencode(name)) < 200)
    return name


def literal(name):
    """A name as a user gives it: with ./ in front of what would be a home or a quoted string."""
    home = name.startswith("~")
    whole = len(name) > 1 and name[0] == name[-1] and name[0] in "'\""
    return f"./{name}" if home or whole else name


AWKWARD = ("a=b", "a,b", "100%", "#1", "a b ", " a", "é", "🦎", "'", '"', "'a'b'", "[a]", "{a}", "a(b)c", "$a",
           "a\\", "\\", "\\'", "a\\\\", "???", "${", "${a}", "\\${a}", "\udcff", "a\nb", "null", "3", "a:b", "~")  # fmt: skip


def with_examples(test):
    for name in AWKWARD:
        test = example(name=name)(test)
    return settings(max_examples=100, deadline=None)(given(name=names())(test))


@with_examples
def test_a_path_is_what_stands_there_whatever_its_name(name):
    for text in (literal(name), quoted(name), f"folder/{name}"):
        there = Path("folder", name) if text.startswith("folder/") else Path(name)
        assert Path(read_path(text)) == there
        (override,) = parse([f"run={text}"], "here")
        assert Path(override.value()) == there
        # Hydra reads it anew.
        (line,) = normalised([f"hydra.run.dir={text}"])
        assert normalised([line]) == [line]
        assert Path(OverridesParser.create().parse_override(line).value()) == there


#: One of each kind, for what takes longer.
SOME = (
    "a=b",
    "a,b",
    "100% #1",
    " é🦎 ",
    "'a'b'",
    "[a]{b}(c)",
    "${a}",
    "\\${a}\\",
    "\udcff",
    "a\nb",
    "null",
    "~",
)


@pytest.mark.parametrize("name", SOME)
def test_a_run_may_have_a_folder_of_any_name(name):
    # Which would refer to the configuration, and backslashes before it.
    text = re.sub(r"(\\*)\$\{", r"\1\1\\${", literal(name))
    ((_, folder),) = compose_jobs(normalised([f"hydra.run.dir={text}"]))
    assert folder == Path(name)
    ((_, folder),) = compose_jobs(normalised([f"hydra.sweep.dir={text}"]), multirun=True)
    assert folder == Path(name, "0")


@pytest.mark.parametrize("name", SOME)
def test_a_robot_may_be_a_file_of_any_name(name, write, stick, tmp_path):
    path = write(f"{name}.yaml", stick)
    for text in (path, quoted(path)):
        assert compose(f"robot={text}").robot.name == "stick"
    if "," not in name:  # which separates several
        with pytest.raises(ConfigError) as caught:
            compose(f"robot={tmp_path}/no {name}.yaml")
        assert f"{tmp_path}/no {name}.yaml" in str(caught.value)


@pytest.mark.parametrize(
    "key", ["run", "resume", "output", "hydra.run.dir", "hydra.sweep.dir", "robot"]
)
def test_a_home_is_a_home_but_in_quotes(key, write, stick, monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path / "é"))
    write("é/mine.yaml", stick)
    assert read_path("~/mine.yaml") == f"{tmp_path}/é/mine.yaml"
    assert read_path("'~/mine.yaml'") == "~/mine.yaml"
    (line,) = normalised([f"{key}=~/mine.yaml"])
    assert "~" not in line
    monkeypatch.delenv("HOME")
    assert read_path("~no-such-user/a") == "~no-such-user/a"


@pytest.mark.parametrize("key", ["resume", "hydra.run.dir", "--config-dir"])
def test_a_path_that_is_empty_is_refused(key, refusal):
    assert refusal(f"{key}=") == "an empty path names nothing; . is the current folder"
