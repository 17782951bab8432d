"""The output of a command cannot end its work: any encoding, closed streams, readers that leave."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import locomotion
from locomotion.runs.checkpoints import saved

pytestmark = pytest.mark.slow

ENCODINGS = [
    {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    {"PYTHONIOENCODING": "cp932"},
    {"PYTHONIOENCODING": "latin-1"},
    {"PYTHONIOENCODING": "ascii"},
]
NAME = "é→日本"


def run(arguments, cwd, redirected="", **environment):
    """Runs a command of the project by a shell."""
    line = ["sh", "-c", f'"$@" {redirected}', "sh", sys.executable, "-m", *map(str, arguments)]
    return subprocess.run(
        line, cwd=cwd, env={**os.environ, **environment}, capture_output=True, timeout=300
    )


@pytest.fixture(scope="module")
def trained(small, tmp_path_factory):
    """The folder of a run whose name has letters of several alphabets."""
    place = tmp_path_factory.mktemp("place")
    result = run(["locomotion.train", *small, f"hydra.run.dir={NAME}"], place)
    assert result.returncode == 0, result.stderr
    assert result.stdout.decode().startswith(f"{place / NAME}: ")
    return place / NAME


@pytest.mark.parametrize("environment", ENCODINGS)
def test_what_cannot_be_encoded_is_escaped_and_names_of_files_are_not(environment, tmp_path):
    code = (
        "import sys; from locomotion.surroundings import lasting_streams\n"
        "with lasting_streams():\n"
        r"    for out in (sys.stdout, sys.stderr): print('a\xb0\u65e5\U0001f98e\udcff', file=out)"
    )
    line = [sys.executable, "-c", code]
    result = subprocess.run(line, capture_output=True, env={**os.environ, **environment})
    assert result.returncode == 0, result.stderr
    for written in (result.stdout, result.stderr):
        assert written.startswith(b"a")
        assert written.endswith(rb"\U0001f98e" + b"\xff\n")


@pytest.mark.parametrize(
    ("arguments", "words", "environment"),
    [
        (["evaluate", "seconds=0.5", "env.num_envs=2"], b"heading drift", ENCODINGS[0]),
        (["watch", "web=true", "seconds=0.5", f"output={NAME}.html"], b".html", ENCODINGS[1]),
        (["export", f"output={NAME}.xml"], b".xml", ENCODINGS[0]),
        (["plot"], b"learning_curves.png", ENCODINGS[1]),
    ],
    ids=["evaluate-C", "watch-cp932", "export-C", "plot-cp932"],
)
def test_commands_finish_in_any_encoding(environment, arguments, words, trained):
    command, *others = arguments
    given = [NAME if command == "plot" else f"run={NAME}", *others]
    result = run([f"locomotion.{command}", *given], trained.parent, **environment)
    assert (result.returncode, result.stderr) == (0, b"")
    assert words in result.stdout


def test_training_finishes_in_the_c_locale(small, write, stick, tmp_path):
    path = write("Möbel.yaml", stick.replace("stick", "Möbel→日本"))
    given = [f"robot={path}", f"hydra.run.dir={NAME}"]
    result = run(["locomotion.train", *small, *given], tmp_path, **ENCODINGS[0])
    assert (result.returncode, result.stderr) == (0, b"")
    assert b" m per action" in result.stdout
    assert (tmp_path / NAME / "learning_curve.png").is_file()
    record = (tmp_path / NAME / ".hydra" / "config.yaml").read_text(encoding="utf-8")
    assert "Möbel→日本" in record


@pytest.mark.parametrize("command", ["train", "export", "plot"])
def test_files_are_text_in_utf_8_whatever_the_machine_prefers(command, trained, small, tmp_path):
    """Python then warns of each file that is opened in what the machine prefers."""
    given = {
        "train": [*small, f"hydra.run.dir={tmp_path}"],
        "export": [f"run={NAME}", "output=gecko.xml"],
        "plot": [NAME],
    }
    line = [f"locomotion.{command}", *given[command]]
    result = run(line, trained.parent, PYTHONWARNDEFAULTENCODING="1")
    assert result.returncode == 0, result.stderr
    package = str(Path(locomotion.__file__).parent)
    assert [line for line in result.stderr.decode().splitlines() if package in line] == []


@pytest.mark.parametrize(
    ("redirected", "status"),
    [
        (">&- 2>&- <&-", 0),
        (">/dev/full", 1),
        ("2>&1 | true", 0),
    ],
)
def test_training_outlives_its_streams(redirected, status, small, tmp_path):
    sweep = ["--multirun", "seed=0,1", "hydra.sweep.dir=sweep"]
    result = run(["locomotion.train", *small, *sweep], tmp_path, f"{redirected}; echo $? >status")
    if "|" not in redirected:
        assert (tmp_path / "status").read_text() == f"{status}\n"
    expected = b"error: standard output: No space left on device\n" if status else b""
    assert result.stderr == expected
    for seed in range(2):
        assert (tmp_path / "sweep" / str(seed) / "learning_curve.png").is_file()
        files = (tmp_path / "sweep" / str(seed)).rglob("*")
        assert not any(b"per action" in path.read_bytes() for path in files if path.is_file())


def test_ctrl_c_saves_when_it_ends_what_reads_the_output_too(small, tmp_path):
    """As Ctrl-C does with ``| tee log``."""
    folder = tmp_path / "run"
    given = [*small, f"hydra.run.dir={folder}", "ppo.iterations=100000", "checkpoint_interval=1"]
    process = subprocess.Popen(
        [sys.executable, "-m", "locomotion.train", *given],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    while process.poll() is None and not saved(folder):
        time.sleep(0.01)
    process.stdout.close()
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=60) == 130
    rows = (folder / "metrics.csv").read_bytes().count(b"\n") - 1
    assert saved(folder)[-1].name == f"{rows:06d}.ckpt"


def test_a_result_that_cannot_be_written_is_an_error(trained):
    given = ["seconds=0.5", "env.num_envs=2"]
    result = run(["locomotion.evaluate", *given], trained.parent, ">/dev/full")
    assert result.returncode == 1
    assert result.stderr == b"error: standard output: No space left on device\n"
    assert run(["locomotion.evaluate", *given], trained.parent, "| true").stderr == b""


@pytest.mark.parametrize("home", ["no/where", None])
def test_any_home_will_do(home, trained, tmp_path):
    (tmp_path / "no").symlink_to("/proc/1/nothing")
    elsewhere = ["-u", "XDG_CONFIG_HOME", "-u", "XDG_CACHE_HOME", "-u", "MPLCONFIGDIR"]
    # Without HOME the home is that of the user's account.
    given = ["-u", "HOME"] if home is None else [f"HOME={tmp_path / home}"]
    line = ["env", *elsewhere, *given, sys.executable, "-m", "locomotion.plot", NAME]
    result = subprocess.run(line, cwd=trained.parent, capture_output=True)
    assert (result.returncode, result.stderr) == (0, b"")


@pytest.mark.parametrize("command", ["train", "evaluate", "plot"])
def test_a_current_folder_that_is_gone_is_named(command, tmp_path):
    code = (
        f"import os, sys, runpy; os.rmdir(os.getcwd()); sys.argv = ['x', {str(tmp_path)!r}];"
        f"runpy.run_module('locomotion.{command}', run_name='__main__', alter_sys=True)"
    )
    (tmp_path / "gone").mkdir()
    line = [sys.executable, "-c", code]
    result = subprocess.run(line, cwd=tmp_path / "gone", capture_output=True, text=True)
    assert result.returncode == 2
    assert result.stderr == "error: the current folder is gone; cd into one that is there\n"


def test_a_refusal_is_one_line_whatever_is_in_a_name(refusal):
    assert refusal("resume=a\nb\x1b[2J") == (
        r"a\nb\x1b[2J holds no .hydra/config.yaml, so it is not a run's folder"
    )
