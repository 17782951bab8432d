"""Copies of environments: deep ones, pickled ones, and those in other processes."""

import copy
import pickle
import subprocess
import sys

import pytest
import torch
from dm_control import composer
from torchrl.envs import Compose, TransformedEnv

from locomotion.arenas.ground import Ground
from locomotion.envs import LocomotionEnv, ResumableEnv, make_task
from locomotion.options import readings
from locomotion.robots import ModularRobot, load_robot
from locomotion.tasks import WalkAway
from locomotion.tasks.rewards import Distance, Work
from locomotion.transforms import HingeHistory, SensorNoise

pytestmark = pytest.mark.slow

WAYS = {
    "deep": copy.deepcopy,
    "pickled": lambda env: pickle.loads(pickle.dumps(env)),
}


@pytest.fixture
def alike(stepping):
    """Compares bit for bit; on a GPU, where the order of additions varies, to some digits."""

    def alike(one, other):
        off = 0.0 if stepping.get("device", "cpu") == "cpu" else 0.1
        one, other = one.flatten_keys(), other.flatten_keys()
        assert set(one.keys()) == set(other.keys())
        for key, value in one.items():
            torch.testing.assert_close(value, other[key], atol=off, rtol=0)

    return alike


def walked(env, steps=7, auto_reset=True, seen=None):
    torch.manual_seed(0)
    return env.rollout(
        steps, break_when_any_done=False, auto_reset=auto_reset, tensordict=seen
    ).clone()


@pytest.fixture
def copied():
    return WAYS["pickled"]


@pytest.mark.parametrize("copied", WAYS.values(), ids=WAYS)
def test_a_copy_has_the_originals_state_and_future_and_is_on_its_own(copied, make, alike):
    """With parameters and latencies of their own, targets under way, and fields of the last step."""
    env = make(3, readings=readings.names(), time_limit=1.0, disturbances={"latency": 0.3})
    env.physics.set_latency(torch.tensor([0.0, 0.07, 0.3]))
    env.physics.expand("body_mass")[1] *= 1.5
    env.physics.set_const()
    env.physics.expand("actuator_gainprm")[2] *= 0.5
    seen = env.rollout(2)[:, -1]["next"].exclude("reward")
    twin = copied(env)
    assert type(twin) is LocomotionEnv and twin.hinge_names == env.hinge_names
    for name, value in env.observe().items():
        assert torch.equal(twin.observe()[name], value), name
    kept = env.physics.motion.clone()
    ahead = walked(twin, auto_reset=False, seen=seen.clone())
    assert torch.equal(env.physics.motion, kept)
    alike(walked(env, auto_reset=False, seen=seen.clone()), ahead)
    alike(walked(env), walked(twin))  # and draws the same starts


def test_a_copy_has_the_task_with_its_rewards_and_dm_controls_environment(copied):
    env = LocomotionEnv("gecko", 1, seed=0, readings=["hinge_position", "phase_clock"])
    env.task.rewards = (Distance(), Work())
    twin = copied(env)
    assert twin.task is not env.task and twin.task.rewards == env.task.rewards
    assert repr(twin) == repr(env)
    seen = composer.Environment(twin.task, random_state=0).reset().observation
    assert set(seen) == {"hinge_position", "phase_clock"}


@pytest.mark.parametrize("wrapper", [TransformedEnv, ResumableEnv])
def test_transforms_around_it_are_copied_with_it(wrapper, copied, make, alike):
    transforms = Compose(HingeHistory(3), SensorNoise(0.1, ["hinge_velocity"]))
    env = wrapper(make(2, time_limit=1.0), transforms)
    seen = env.rollout(2)[:, -1]["next"].exclude("reward")
    twin = copied(env)
    alike(
        walked(env, auto_reset=False, seen=seen.clone()),
        walked(twin, auto_reset=False, seen=seen.clone()),
    )


def test_whoever_looks_at_physics_steps_does_not_look_at_those_of_a_copy(make):
    env, looks = make(1), []
    env.reset()
    with env.after_substep(looks.append):
        twin = copy.deepcopy(env)
    twin.rollout(1)
    assert not looks


class Sand(Ground):
    """An arena of somebody's own."""


def sandy():
    task = WalkAway(ModularRobot(load_robot("gecko").body, "gecko"), Sand())
    task.made_by = sandy
    return task


def test_a_task_of_ones_own_says_how_it_is_made_anew(copied):
    task = sandy()
    env = LocomotionEnv(task, 1, seed=0)
    assert isinstance(copied(env).task.root_entity, Sand)
    task.made_by = None
    with pytest.raises(pickle.PicklingError, match=r"a task that make_task\(\) did not make"):
        copied(env)


def test_a_task_that_was_changed_after_it_was_made_is_not_copied_as_another_one(copied):
    task = make_task(load_robot("gecko"))
    task.root_entity.mjcf_model.worldbody.add("geom", type="box", size=[1, 1, 1], pos=[5, 0, 0])
    with pytest.raises(pickle.PicklingError, match="changed after it was made"):
        copied(LocomotionEnv(task, 1, seed=0))


def test_a_closed_environment_stays_one_in_copies_and_a_state_opens_it(copied, make, alike):
    env = make(2)
    env.rollout(2)
    state, place = env.state_dict(), env.physics.qpos.clone()
    expected = walked(copied(env))
    env.close()
    twin = copied(env)
    assert torch.equal(twin.physics.qpos, place)
    for closed in (env, twin):
        with pytest.raises(RuntimeError, match="was closed"):
            closed.reset()
        closed.load_state_dict(state)
        alike(walked(closed), expected)


def run(script, *arguments):
    """Runs a script, which must not hang."""
    command = [sys.executable, "-W", "error::ResourceWarning", "-c", script, *map(str, arguments)]
    found = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert "ResourceWarning" not in found.stderr
    return found


def succeed(script, *arguments):
    found = run(script, *arguments)
    assert not found.returncode, found.stderr


FORK = """
import gc, os, sys, torch
from locomotion.envs import LocomotionEnv

torch.set_num_threads(1)

def make(threads):
    return LocomotionEnv("gecko", 3, seed=0, physics={"threads": threads}, disturbances={"latency": 0.1})

env, idle, memory = make(int(sys.argv[2])), make(2), make(2).physics.qpos
env.physics.expand("actuator_gainprm")[1] *= 0.5
env.physics.expand("body_mass")[2] *= 1.5
env.physics.set_const()
force = env.physics.field("actuator_force")
seen = env.rollout(2)[:, -1]["next"]
child = os.fork()
env.physics.qvel[0] += 0.1
torch.manual_seed(0)
walk = env.rollout(3, auto_reset=False, tensordict=seen)
again = env.rollout(2)
who = "parent" if child else "child"
torch.save([walk, again, env.physics.field("actuator_force")], f"{sys.argv[1]}/{who}.pt")
if child:
    assert os.waitpid(child, 0)[1] == 0
else:
    del env, memory
    gc.collect()
"""


@pytest.mark.parametrize("threads", [1, 2])
def test_a_forked_process_goes_on_with_it_and_ends(threads, tmp_path):
    """Also with what it does not use, and what it has only MuJoCo's memory of."""
    succeed(FORK, tmp_path, threads)
    ours, theirs = (
        torch.load(tmp_path / f"{who}.pt", weights_only=False) for who in ("parent", "child")
    )
    for one, other in zip(ours, theirs, strict=True):
        assert (one == other).all()


PARALLEL = """
import sys, torch
from torchrl.envs import ParallelEnv, TransformedEnv
from locomotion.envs import LocomotionEnv, ResumableEnv
from locomotion.transforms import HingeHistory

torch.set_num_threads(1)
how, what, folder = sys.argv[1:]
env = LocomotionEnv("gecko", 3, seed=0, physics={"threads": 2})
if what != "LocomotionEnv":
    env = globals()[what](env, HingeHistory(2))
env.rollout(2)
both = ParallelEnv(2, lambda env=env: env, mp_start_method=how)
walk = both.rollout(3, lambda td: td.set("action", 0.1 * td["hinge_position"]))
torch.save(walk, f"{folder}/walk.pt")
both.close()
"""


@pytest.mark.parametrize(("how", "what"), [("fork", "LocomotionEnv"), ("spawn", "ResumableEnv")])
def test_torchrls_parallel_environment_takes_one_that_is_there(how, what, tmp_path):
    """It closes the environment, and gives each process the state that this had before."""
    succeed(PARALLEL, how, what, tmp_path)
    walk = torch.load(tmp_path / "walk.pt", weights_only=False)
    assert walk.shape == (2, 3, 3)
    for key in (("next", "hinge_position"), ("next", "reward")):
        assert torch.equal(walk[key][0], walk[key][1])
        assert walk[key].std() > 0


def test_one_without_its_state_says_that_it_was_closed(tmp_path):
    """TorchRL's transformed environment hands on no state of the one inside."""
    found = run(PARALLEL, "fork", "TransformedEnv", tmp_path)
    assert found.returncode and "the environment was closed" in found.stderr


EXIT = """
import sys, torch
from locomotion.envs import LocomotionEnv

env = LocomotionEnv("gecko", 3, seed=0, physics={"threads": 2})
env.rollout(2)
env.itself = [env]  # collected when the interpreter ends, if at all
if sys.argv[1] == "closed":
    env.close()
    env.close()
"""


@pytest.mark.parametrize("closed", ["closed", "open"])
def test_an_interpreter_ends_with_environments_in_it(closed):
    succeed(EXIT, closed)
