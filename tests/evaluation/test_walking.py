"""Walking with a policy, against MuJoCo's own stepping and against closed forms."""

import math

import mujoco
import numpy as np
import pytest
import torch

from locomotion import compose
from locomotion.evaluation import PolicyRunner, make_runner, measure, summarise, walk
from locomotion.evaluation.shipped import shipped
from locomotion.runs.checkpoints import Checkpoints
from locomotion.training.build import make_env, make_learner

pytestmark = pytest.mark.slow


def test_work_is_that_of_servos_in_mujocos_own_steps(scripted):
    weak = "physics.stiffness=5"  # so that torques reach their limit
    walked = walk(scripted(weak)[0], 2.0, effort=True)
    runner, policy = scripted(weak)
    runner.start()
    model, data = runner.base_env.model, mujoco.MjData(runner.base_env.model)
    data.qpos[:] = runner.base_env.physics.qpos[1].numpy()
    data.qvel[:] = runner.base_env.physics.qvel[1].numpy()
    limited = 0
    for step in range(8):
        runner.step(sampled=False)
        data.ctrl[:] = target = policy.actions[-1][1].numpy()
        work = 0.0
        for _ in range(25):
            angle, before = data.qpos[7:].copy(), data.qvel[6:].copy()
            mujoco.mj_step(model, data)
            after = data.qvel[6:]
            # MuJoCo takes the damping of a servo that is not at its limit at the end of the step.
            at_limit = np.abs(5 * (target - angle) - 0.05 * before) > 0.948
            torque = np.where(at_limit, data.actuator_force, 5 * (target - angle) - 0.05 * after)
            work += 0.01 * np.abs(torque * (before + after) / 2).sum()
            limited += at_limit.sum()
        assert walked.work[step, 1].item() == pytest.approx(work, rel=1e-6)
        np.testing.assert_allclose(walked.position[step + 1, 1], data.qpos[:3], atol=1e-9)
    assert 0 < limited < 8 * 25 * 6


def test_work_hardly_depends_on_the_timestep(scripted):
    work = [
        walk(scripted(f"physics.timestep={timestep}")[0], 5.0, effort=True)
        .work.sum(0)
        .mean()
        .item()
        for timestep in (0.01, 0.001)
    ]
    assert work[0] == pytest.approx(work[1], rel=0.05)  # 15% with the speed at the end of each step


class Thrown(PolicyRunner):
    """Robots in free flight: at rest, turning once a second, and rocked by less than a quarter turn."""

    def start(self):
        super().start()
        physics = self.base_env.physics
        qpos, qvel = torch.as_tensor(self.base_env.model.qpos0).repeat(3, 1), 0.0 * physics.qvel
        qpos[:, 2] = 8.0
        qvel[1, 3] = 2 * math.pi
        qpos[2, 3:7] = torch.tensor([math.cos(0.45), math.sin(0.45), 0.0, 0.0])
        self.base_env.set_state(qpos, qvel)


def test_a_core_that_spins_turns_over_twice_in_a_turn_and_one_that_rocks_does_not(scripted):
    runner, _ = scripted(amplitude=0.0, runner=Thrown)
    overturns = walk(runner, 1.0, effort=True).overturns.sum(0)
    assert overturns.tolist() == [0, 2, 0]


def test_looking_at_the_effort_changes_nothing(scripted):
    plain = walk(scripted()[0], 2.0)
    watched = walk(scripted()[0], 2.0, effort=True)
    assert torch.equal(plain.position, watched.position)
    assert torch.equal(plain.orientation, watched.orientation)
    assert plain.work is None


def test_a_latency_of_a_control_step_is_each_target_a_step_later(scripted):
    late = walk(scripted("disturbances.latency=0.25", "env.settle_time=0")[0], 2.0)
    runner, policy = scripted("env.settle_time=0")

    def one_later(tensordict):
        policy(tensordict)
        before = [0.0 * policy.actions[0], *policy.actions][-2]
        return tensordict.set("action", before)

    shifted = walk(PolicyRunner(runner.env, one_later), 2.0)
    torch.testing.assert_close(late.position, shifted.position, atol=1e-9, rtol=0)
    assert not torch.equal(late.position, walk(runner, 2.0).position)


def test_noise_is_in_what_a_policy_senses_and_nowhere_else(shipped_run):
    walks, seen = [], []
    for noise in (0.0, 0.05):
        runner = make_runner(*shipped_run("gecko", 200, {"hinge_noise": noise}))
        env = runner.env
        seen.append([])

        def still(tensordict, seen=seen[-1], env=env):
            seen.append(tensordict["hinge_position"].clone())
            return tensordict.set("action", torch.zeros(env.action_spec.shape))

        walks.append(walk(PolicyRunner(env, still), 1.0))
    difference = torch.stack(seen[1]) - torch.stack(seen[0])
    assert difference.std().item() == pytest.approx(0.05, rel=0.05)
    assert torch.equal(walks[0].position, walks[1].position)


def test_noisy_hinges_do_not_matter_to_a_policy_that_senses_none(tmp_path):
    (tmp_path / "obs").mkdir()
    (tmp_path / "obs" / "blind.yaml").write_text("phase_clock: {}\n")
    few = ("obs=blind", "env.num_envs=2", "ppo.minibatch_size=1")
    plain, noisy = (
        compose(*few, f"disturbances.hinge_noise={noise}", config_dir=tmp_path) for noise in (0, 1)
    )
    Checkpoints(tmp_path, policy=make_learner(plain, make_env(plain)).policy).save(1)
    walks = [walk(make_runner(tmp_path, config), 1.0) for config in (plain, noisy)]
    assert torch.equal(walks[0].position, walks[1].position)


@pytest.mark.parametrize("robot", shipped())
def test_every_policy_that_ships_sets_off(robot, shipped_run):
    found = measure(walk(make_runner(*shipped_run(robot, 4)), 8.0))
    assert found["speed"].mean() > 0.2
    assert not found["diverged"].any()


@pytest.mark.parametrize("robot", ["gecko", "ant"])
def test_the_policies_that_ship_walk(robot, shipped_run):
    found = summarise(measure(walk(make_runner(*shipped_run(robot, 16)), 20.0)))
    # The report's gaits cover 0.09 m in a quarter of a second, noise and all.
    assert found["speed"].low > 0.35
    assert found["straightness"].mean > 0.8
    assert found["diverged"].mean == 0
