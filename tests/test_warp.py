"""MuJoCo Warp beside MuJoCo: on Warp's own CPU device, and on a GPU where there is one."""

import pytest
import torch
from omegaconf import OmegaConf
from test_collector import STEPS, collecting
from test_divergence import BAD, spoil
from torchrl.envs import ExplorationType, check_env_specs, set_exploration_type

from benchmarks import gpu as benchmark
from benchmarks.kill_and_resume import outcome
from locomotion import train as training
from locomotion.agents import PPO, make_critic
from locomotion.assembly import make_env, policy_keys
from locomotion.command_line.composing import amend, compose, parse
from locomotion.command_line.policies import POLICIES
from locomotion.config import Config, ConfigError, load, typed
from locomotion.envs import LocomotionEnv
from locomotion.gaits import load_policy
from locomotion.runs import differences, read_config, record

try:
    import warp
except ImportError:
    warp = None

installed = pytest.mark.skipif(
    warp is None,
    reason="needs packages: pip install -e '.[warp]'",
)
gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU here")
#: Devices to test on, as arguments of a test.
DEVICES = [pytest.param("cpu", marks=installed), pytest.param("cuda:0", marks=[installed, gpu])]


def make(num_envs, device="cpu", robot="gecko", **keywords):
    physics = {"backend": "warp", "device": device, **keywords.pop("physics", {})}
    return LocomotionEnv(robot, num_envs, seed=0, physics=physics, **keywords)


@pytest.fixture(scope="module", params=DEVICES)
def warped(request):
    """A small flock for tests that leave nothing behind but its state."""
    return make(4, request.param)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    ("robot", "self_collision"), [("gecko", False), ("ant", False), ("ant", True)]
)
def test_a_control_step_is_mujocos(robot, self_collision, device):
    """From states all over the gait of random actions, which also hit the joints' limits."""
    physics = {"self_collision": self_collision}
    env = make(64, device, robot, physics=physics)
    mujoco = LocomotionEnv(robot, 64, seed=0, physics={"threads": 1, **physics})
    torch.manual_seed(0)
    mujoco.reset()
    for _ in range(4):
        action = 3 * torch.rand(64, env.model.nu) - 1.5  # beyond the limits: both must clip
        env.set_state(mujoco.physics.qpos, mujoco.physics.qvel)
        assert mujoco.physics.step(action, 25) is None
        assert env.physics.step(action.to(device), 25) is None
        reached, expected = env.physics, mujoco.physics
        torch.testing.assert_close(reached.qpos.cpu(), expected.qpos, atol=3e-5, rtol=0)
        torch.testing.assert_close(reached.qvel.cpu(), expected.qvel, atol=1e-3, rtol=0)


GECKO = POLICIES / "gecko"


def task_of_gecko(*overrides):
    """Where the gecko that comes along was trained, but for what is asked for."""
    saved = OmegaConf.create(read_config(GECKO))
    saved.ppo.update(steps=1, minibatch_size=1)
    amend(saved, parse(overrides, "here"))
    return typed(Config, saved)


def trained(*overrides):
    """An environment, and the policy that comes along for the gecko where it is."""
    config = task_of_gecko(*overrides)
    env = make_env(config)
    return env, load_policy(GECKO, config, env)


def walk(env, actor, steps, **keywords):
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        return env.rollout(steps, actor, **keywords)["next"].cpu()


@pytest.mark.parametrize("device", DEVICES)
def test_a_trained_gait_is_as_fast(device):
    warped, mujoco = (
        walk(*trained("env.num_envs=64", *overrides), 60)["reward"][:, 10:].mean().item()
        for overrides in (("physics=warp", f"physics.device={device}"), ("physics.threads=1",))
    )
    assert mujoco > 0.15  # a standard error of either is 0.5%
    assert warped == pytest.approx(mujoco, rel=0.03)


@pytest.mark.parametrize("device", DEVICES)
def test_five_kilometres_away_robots_walk_as_at_the_start(device):
    env, actor = trained("physics=warp", f"physics.device={device}", "env.num_envs=4")
    td, robots = env.reset(), env.base_env
    qpos, qvel = robots.physics.qpos.clone(), robots.physics.qvel.clone()
    walks = []
    for away in (0.0, 5000.0):
        start = qpos.clone()
        start[:, :2] += away
        robots.set_state(start, qvel)
        walks.append(walk(env, actor, 30, auto_reset=False, tensordict=td.clone()))
        assert ((robots.physics.qpos[:, :2] - away).abs() < 20).all()
    here, there = walks
    assert here["reward"].mean() > 0.1
    if device == "cpu":  # where the order of additions is always the same
        assert torch.equal(here["hinge_position"], there["hinge_position"])
    torch.testing.assert_close(
        here["reward"].mean(), there["reward"].mean(), rtol=1e-6 if device == "cpu" else 0.1, atol=0
    )


def test_specs_hold_and_all_is_on_the_device(warped):
    check_env_specs(warped)
    rollout = warped.rollout(2)
    places = {value.device for value in rollout.flatten_keys().values()}
    assert places == {warped.physics.device}


def test_partial_resets_leave_others_alone(warped):
    td = warped.rollout(2)[:, -1]["next"]
    before = warped.physics.qpos.clone()
    where = torch.tensor([[False], [True], [False], [True]], device=before.device)
    fresh = warped.reset(td.clone().set("_reset", where))
    kept = ~where.squeeze(-1)
    assert torch.equal(warped.physics.qpos[kept], before[kept])
    assert torch.equal(fresh["hinge_position"][kept], td["hinge_position"][kept])
    assert (fresh["hinge_position"][~kept] != td["hinge_position"][~kept]).all()
    assert (fresh["core_position"][~kept, :2].abs() < 0.3).all()


def test_starts_are_those_of_mujoco(warped):
    """The same seed draws the same targets, wherever the robots are."""
    warped.set_seed(0)
    start = warped.reset()["hinge_position"].cpu()
    torch.testing.assert_close(
        start, LocomotionEnv("gecko", 4, seed=0).reset()["hinge_position"], atol=0.05, rtol=0
    )


@pytest.mark.parametrize("bad", BAD)
def test_a_bad_state_ends_the_episode_of_its_robot_alone(bad, warped):
    td = warped.reset()
    state = warped.physics.qpos.clone(), warped.physics.qvel.clone()
    action = torch.rand(4, 6, device=state[0].device)
    expected = warped.step(td.clone().set("action", action))["next"]
    warped.set_state(*state)
    spoil(warped, 2, bad)
    td = warped.step(td.set("action", action))["next"]
    others = [0, 1, 3]
    torch.testing.assert_close(td[others].to_dict(), expected[others].to_dict())
    assert td["terminated"].squeeze(-1).tolist() == [False, False, True, False]
    assert torch.equal(td["done"], td["terminated"]) and not td["truncated"].any()
    assert td["reward"][2] == 0
    assert all(value.isfinite().all() for value in td.values())
    (divergence,) = warped.take_divergences()
    assert divergence.robot == 2 and divergence.qpos.device.type == "cpu"
    torch.testing.assert_close(divergence.action, action[2].cpu())

    fresh = warped.reset(td.set("_reset", td["done"]))
    assert fresh["core_position"][2, :2].norm() < 0.3
    assert not warped.step(fresh.set("action", action))["next", "done"].any()


def test_what_a_wrong_robot_leaves_in_warps_memory_does_not_come_back(warped):
    warped.reset()
    physics, action = warped.physics, torch.zeros(4, 6)
    for left_over in (physics._data.efc.J, physics._data.efc.D):
        warp.to_torch(left_over)[2] = float("nan")
    assert physics.step(action, 25).tolist() == [False, False, True, False]
    assert physics.step(action, 25) is None


def test_physics_steps_one_by_one_and_many_at_a_time_come_to_the_same(warped):
    warped.reset()
    physics, action = warped.physics, torch.rand(4, 6)
    state = physics.qpos.clone(), physics.qvel.clone()
    ends = []
    for parts in ([125], [25] * 5, [1] * 125):  # 125 steps are more than one graph has
        warped.set_state(*state)
        assert all(physics.step(action, steps) is None for steps in parts)
        ends.append(physics.qpos.clone())
    # Places are rounded at other times, and a gait in contact feels the last digit.
    torch.testing.assert_close(ends[0], ends[1], atol=1e-3, rtol=0)
    torch.testing.assert_close(ends[0], ends[2], atol=1e-3, rtol=0)


def test_a_long_control_step_is_watched_in_all_its_parts(warped):
    warped.reset()
    spoil(warped, 1, "finite, but blows up")
    diverged = warped.physics.step(torch.zeros(4, 6), 500)
    assert diverged.tolist() == [False, True, False, False]


@pytest.mark.parametrize("device", DEVICES)
def test_too_little_room_for_contacts_is_said(device):
    env = make(4, device, physics={"contacts": 2}, settle_time=0.0)
    td = env.reset()
    with pytest.raises(
        ConfigError, match=r"than the 2 each .* physics\.contacts=4 gives them more"
    ):
        for _ in range(8):
            td = env.step(env.rand_action(td))["next"]


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("time_limit", ["null", "1"])
def test_batches_are_what_the_environment_says(time_limit, device):
    config, actor, collector = collecting(
        *("+obs=history3", f"env.time_limit={time_limit}", "physics=warp"),
        f"physics.device={device}",
    )
    env = make_env(config)
    td = env.reset()
    batches = list(collector)
    assert len(batches) == 3
    # On a GPU the last digits differ, and grow from step to step.
    for batch in batches if device == "cpu" else ():
        for step in range(STEPS):
            td["action"] = batch["action"][:, step]
            stepped, td = env.step_and_maybe_reset(td)
            for key in [*policy_keys(config), "reward", "done", "terminated", "truncated"]:
                assert torch.equal(stepped["next", key], batch["next", key][:, step]), key
    devices = {value.device for value in batches[0].flatten_keys().values()}
    assert devices == {torch.device(device)}
    critic = make_critic(env.observation_spec, policy_keys(config)).to(device)
    PPO(actor, critic, 6, 60, config.ppo).update(batches[0])
    torch.testing.assert_close(
        batches[0]["value_target"], batches[0]["advantage"] + batches[0]["state_value"]
    )


SMALL = [
    *("env.num_envs=4", "env.time_limit=2", "ppo.steps=8", "ppo.minibatch_size=16"),
    *("ppo.iterations=4", "checkpoint_interval=2", "physics=warp"),
]


def train_whole_and_resumed(config, folder):
    """Leaves a run in ``whole``, and in ``resumed`` one that went on from the middle of it."""
    for name in ("whole", "resumed"):
        (folder / name).mkdir()
        record(folder / name, config=OmegaConf.structured(config))
    training.train(config, folder / "whole")
    for part in ("checkpoints/000002.ckpt", "metrics.csv"):
        (folder / "resumed" / part).parent.mkdir(exist_ok=True)
        (folder / "resumed" / part).write_bytes((folder / "whole" / part).read_bytes())
    training.train(config, folder / "resumed")


@pytest.mark.parametrize("device", DEVICES)
def test_a_resumed_run_goes_on(device, tmp_path):
    """On the CPU bit for bit; on a GPU from the same weights and states."""
    train_whole_and_resumed(compose(*SMALL, f"physics.device={device}"), tmp_path)
    if device == "cpu":
        assert outcome(tmp_path / "resumed") == outcome(tmp_path / "whole")
    else:
        assert len((tmp_path / "resumed" / "metrics.csv").read_text().splitlines()) == 5


@installed
@gpu
def test_a_captured_gradient_step_is_the_one_that_it_captured():
    options = ("+obs=history3", "physics=warp", "ppo.minibatch_size=15")
    batch, learned = None, []
    for cudagraphs in (False, True):
        config, actor, collector = collecting(*options, f"ppo.cudagraphs={cudagraphs}")
        critic = make_critic(make_env(config).observation_spec, policy_keys(config)).to("cuda:0")
        batch = next(iter(collector)) if batch is None else batch
        ppo = PPO(actor, critic, 6, 60, config.ppo)
        torch.manual_seed(0)  # the order of the minibatches
        learned.append(torch.stack([ppo.update(batch.clone()) for _ in range(3)]))
    eager, captured = learned
    torch.testing.assert_close(captured["loss_critic"], eager["loss_critic"], rtol=1e-3, atol=0)
    torch.testing.assert_close(captured["kl_approx"], eager["kl_approx"], rtol=1e-2, atol=1e-5)


@installed
def test_a_benchmark_without_its_gpu_says_so(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["gpu", "--device", "cuda:999"])
    benchmark.main()
    assert capsys.readouterr().out.startswith(
        "nothing was measured: physics.device=cuda:999 is not"
    )


def test_both_choices_describe_the_same_bodies():
    stepped = {"backend", "device", "contacts", "threads"}
    threaded, warped = (vars(load(f"physics/{name}")) for name in ("threaded", "warp"))
    assert all(threaded[key] == warped[key] for key in threaded.keys() - stepped)


def test_runs_from_before_the_choice_are_runs_of_mujoco(tmp_path):
    config = compose()
    old = OmegaConf.to_container(OmegaConf.structured(config), enum_to_str=True)
    for key in ("backend", "device", "contacts"):
        del old["physics"][key]
    record(tmp_path, config=OmegaConf.create(old))
    assert differences(tmp_path, config) == {}
    there, asked = differences(tmp_path, compose("physics=warp"))["physics.backend"]
    assert (there, asked) == ("physics.backend=threaded", "physics.backend=warp")
