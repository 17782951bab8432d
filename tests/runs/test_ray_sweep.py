"""A sweep on a Ray cluster of two nodes, one of which dies."""

import os
import signal
import subprocess
import sys
import time

import pytest

from locomotion import train

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="gives each node a loopback address"),
]
SEEDS = (0, 1, 2, 3)
LONG = ("ppo.iterations=60", "checkpoint_interval=1")


@pytest.fixture(scope="module")
def cluster():
    """A cluster of a head without cores and of two nodes with one each, on the loopback interface."""
    ray = pytest.importorskip("ray", reason="needs packages: pip install -e '.[ray]'")
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as variables:
        variables.setenv("RAY_USAGE_STATS_ENABLED", "0")
        # Ray is polite: next to other tests its workers would hardly get a turn.
        variables.setenv("RAY_worker_niceness", "0")
        common = {"include_dashboard": False, "object_store_memory": 10**8}
        nodes = Cluster(
            initialize_head=True,
            head_node_args={**common, "num_cpus": 0, "node_ip_address": "127.0.0.2"},
        )
        nodes.workers = [
            nodes.add_node(num_cpus=1, node_ip_address=f"127.0.0.{3 + index}", **common)
            for index in range(2)
        ]
        yield nodes
        nodes.shutdown()
        assert not ray.is_initialized()


@pytest.fixture
def sweep(cluster, small, tmp_path):
    """Starts a sweep on the cluster."""
    started = []

    def start(*overrides):
        line = [sys.executable, "-m", "locomotion.train", "--multirun", "hydra/launcher=ray"]
        line += ["hydra.launcher.memory=0.1", "hydra.sweep.dir=sweep", *small, *LONG, *overrides]
        started.append(
            subprocess.Popen(
                line,
                cwd=tmp_path,
                env={**os.environ, "RAY_ADDRESS": cluster.address},
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
        )
        return started[-1]

    yield start
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)


def rows_of(folder):
    path = folder / "metrics.csv"
    return path.read_text().count("\n") - 1 if path.is_file() else 0


def wait_for(condition, process):
    deadline = time.monotonic() + 200
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.2)


def test_a_node_that_dies_and_ctrl_c_leave_no_trace_in_the_results(
    cluster, sweep, configured, outcome, tmp_path
):
    seeds = ",".join(map(str, SEEDS))
    process = sweep(f"seed={seeds}")
    folders = [tmp_path / "sweep" / str(number) for number in SEEDS]
    wait_for(lambda: all(rows_of(folder) > 3 for folder in folders[:2]), process)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=200)
    assert process.returncode == 130, err
    assert "Traceback" not in err

    process = sweep(f"seed={seeds}")
    reached = [rows_of(folder) for folder in folders[:2]]
    wait_for(lambda: all(rows_of(f) > r for f, r in zip(folders, reached)), process)
    cluster.remove_node(cluster.workers.pop(), allow_graceful=False)
    out, err = process.communicate(timeout=400)
    assert process.returncode == 0, out + err
    assert out.count("m per action in the last ten iterations") == len(SEEDS)
    for seed, folder in zip(SEEDS, folders):
        alone = train(configured(*LONG, f"seed={seed}"), tmp_path / f"alone{seed}")
        assert outcome(folder) == outcome(alone.folder)


def test_a_job_for_which_no_node_has_room_is_refused(sweep):
    _, err = (process := sweep("seed=0,1", "hydra.launcher.cpus=64")).communicate(timeout=100)
    assert process.returncode == 1
    assert err.startswith("error: no node of the cluster has room for a job (CPU: 64,")
    assert err.count("\n") == 1
