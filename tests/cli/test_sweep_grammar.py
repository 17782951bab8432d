"""Lists of values: what they stand for, and how fast the jobs are checked."""

import os
import pty
import subprocess
import sys
import termios
import time

import hydra
import pytest
from hydra.core.hydra_config import HydraConfig
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from locomotion.cli.composing import compose_jobs, normalised
from locomotion.composition import application
from locomotion.config import as_dict, typed_config

pytestmark = pytest.mark.slow

LISTS = {
    "seed=range(3)": [0, 1, 2],
    "seed=range(start=1,stop=6,step=2)": [1, 3, 5],
    "seed=range(3,0,-1)": [3, 2, 1],
    "seed=choice(4,2)": [4, 2],
    "seed=sort(3,1,2)": [1, 2, 3],
    "seed=sort(range(3),reverse=true)": [2, 1, 0],
    "seed=tag(mine,choice(1,2))": [1, 2],
    "seed=7": [7],
}
WRONG = {
    "seed=range(0)": "seed=range(0) holds no value",
    "seed=range(3,0)": "seed=range(3,0) holds no value",
    "seed=range(0,3,0)": "seed=range(0,3,0): range() arg 3 must not be zero",
    "ppo.gamma=range(0,1,0.0)": "ppo.gamma=range(0,1,0.0): Invalid range values",
    "seed=range()": "seed=range(): missing a required argument: 'start'",
    "seed=range(a)": "seed=range(a): mismatch type argument start: str",
    "seed=choice()": "seed=choice(): empty choice is not legal",
    "robot=glob()": "robot=glob(): missing a required argument: 'include'",
    "robot=glob(zzz*)": "robot=glob(zzz*) holds no value",
    "seed=glob(*)": "seed=glob(*) holds no value",
    "ppo.gamma=interval(0,1)": "ppo.gamma=interval(0,1) is not a list, which hydra/sweeper=grid needs",
    "seed=range(0,1e9)": "seed=range(0,1e9): a sweep has at most 10000 jobs",
    "seed=range(0,1000000000)": "seed=range(0,1000000000): a sweep has at most 10000 jobs",
}


@pytest.mark.parametrize("line", LISTS)
def test_lists_hold_these_values(line):
    assert [config.seed for config, _ in compose_jobs([line], multirun=True)] == LISTS[line]


@pytest.mark.parametrize("line", WRONG)
def test_a_list_without_a_meaning_is_refused_in_a_line(line, refusal, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert refusal("--multirun", line).startswith(WRONG[line])


def test_lists_that_multiply_too_far_are_refused(refusal):
    lines = ["seed=range(1000)", "ppo.epochs=range(1,12)"]
    assert refusal("--multirun", *lines) == "a sweep has at most 10000 jobs"


@pytest.mark.parametrize("line", ["seed=range(3)", "seed=choice()", "seed=7", "obs.x={scale: 2}"])
def test_without_assertions_it_is_the_same_or_refused(line):
    code = (
        "import sys; from locomotion.options import ConfigError\n"
        "from locomotion.cli.composing import compose_jobs, normalised\n"
        "try: print([c.seed for c, _ in compose_jobs(normalised(sys.argv[1:]), True)])\n"
        "except ConfigError as error: print('refused:', error)"
    )
    run = [sys.executable, "-O", "-c", code, line]
    told = subprocess.run(run, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    refused = "refused: functions and mappings in overrides need assertions: start Python without"
    assert told.stdout.startswith((refused, str(LISTS.get(line))))


values = {
    "seed": st.integers(0, 9),
    "ppo.gamma": st.sampled_from([0.9, 0.99, 1]),
    "network.width": st.integers(1, 9),
    "network.hidden": st.sampled_from(["[8]", "[8,4]"]),
    "env.time_limit": st.sampled_from(["null", "3", "2.5"]),
    "physics.self_collision": st.booleans().map(str),
    "robot": st.sampled_from(["gecko", "ant"]),
    "obs": st.sampled_from(["hinges", "history3"]),
    "network": st.sampled_from(["mlp", "gru"]),
    "physics": st.sampled_from(["threaded"]),
    "+obs.core_height.scale": st.sampled_from(["1", "2"]),
    "ppo": st.sampled_from(["{gamma:0.8}", "{epochs:2}"]),
    "task.rewards.work": st.sampled_from(["{weight:-1.0}", "{}"]),
    "logger": st.just("csv"),
}


@st.composite
def sweeps(draw):
    """Overrides of which some are lists, in any order."""
    keys = draw(st.lists(st.sampled_from(sorted(values)), unique=True, min_size=1, max_size=4))
    lines = []
    for key in keys:
        some = draw(st.lists(values[key], min_size=1, max_size=2, unique_by=str))
        lines.append(f"{key}={','.join(map(str, some))}")
    return draw(st.permutations(lines))


@settings(max_examples=8, deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(sweeps())
def test_jobs_are_those_that_hydra_composes_one_by_one(lines):
    lines = normalised(lines)
    if any("network=" in line for line in lines):  # a key of the other network
        lines = [line for line in lines if not line.startswith("network.")]
    lines += ["hydra.sweep.dir=x", "hydra.sweep.subdir=${hydra:job.override_dirname}-${seed}"]
    jobs = compose_jobs(lines, multirun=True)
    with application(None):
        for (config, folder), (number, job) in zip(jobs, numbered(lines), strict=True):
            alone = hydra.compose("config", job, return_hydra_config=True)
            HydraConfig.instance().set_config(alone)
            assert str(folder) == f"x/{alone.hydra.sweep.subdir}"
            values = {key: alone[key] for key in alone if key != "hydra"}
            assert as_dict(config) == as_dict(typed_config(values)), (number, job)


def numbered(lines):
    """The jobs by the plainest way: every combination, the last list varying fastest."""
    jobs = [[]]
    for line in lines:
        key, _, text = line.partition("=")
        several = not text.startswith(("[", "{", "$")) and "," in text
        some = text.split(",") if several else [text]
        if key in ("network.hidden", "ppo", "task.rewards.work"):
            closing = "]" if text.startswith("[") else "}"
            some = [f"{part}{closing}" for part in text.split(f"{closing},")]
            some = [*some[:-1], some[-1].removesuffix(closing)]
        jobs = [[*job, f"{key}={one}"] for job in jobs for one in some]
    return enumerate(jobs)


def test_checking_a_job_more_takes_a_fraction_of_composing_one():
    lines = normalised(["robot=gecko,ant", "+obs=hinges,history3"])

    def seconds(*overrides):
        best = float("inf")
        for _ in range(2):
            began = time.process_time()
            compose_jobs([*lines, *overrides], multirun=True)
            best = min(best, time.process_time() - began)
        return best

    few, many = seconds("seed=range(1)"), seconds("seed=range(11)")
    assert (many - few) / 40 < few / 4 / 2


def test_a_long_check_says_what_it_does(tmp_path):
    screen, terminal = pty.openpty()
    termios.tcsetwinsize(terminal, (24, 80))
    line = [sys.executable, "-m", "locomotion.train", "--multirun", "hydra.sweep.dir=x"]
    line += ["seed=range(200)", "physics.threads=1,2,3", "ppo.epochs=range(1,9)"]
    with subprocess.Popen(line, cwd=tmp_path, stderr=terminal, stdout=terminal) as process:
        os.close(terminal)
        shown = b""
        while b"checking 4800 jobs" not in shown:
            shown += os.read(screen, 1000)
        process.terminate()
    os.close(screen)
