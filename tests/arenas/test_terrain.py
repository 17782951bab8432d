"""Ground that is not flat: its shape, and robots that start and walk on it anywhere."""

import mujoco
import numpy as np
import pytest
import torch
from dm_control import composer

from locomotion import compose
from locomotion.arenas.periodic import period_of, put_under
from locomotion.options import ConfigError, arenas, chosen
from locomotion.training.build import make_env

pytestmark = pytest.mark.slow

TERRAINS = ("rough", "slopes", "steps", "stones", "mix")


def options(name, **keys):
    return chosen(arenas, {"name": name, **keys}, "arena")


def make(*overrides, num_envs=4):
    small = (f"env.num_envs={num_envs}", "ppo.minibatch_size=1", "physics.threads=2")
    return make_env(compose(*small, *overrides)).base_env


def ground_below(env, xy):
    """Heights (m) where rays from above meet the ground of an environment's model."""
    model, data = env.model, mujoco.MjData(env.model)
    heights = []
    for place in xy:
        data.qpos[:3] = [*place, 50.0]
        put_under(model, data)
        mujoco.mj_kinematics(model, data)
        start, down, hit = (
            np.array([*place, 5.0]),
            np.array([0.0, 0.0, -1.0]),
            np.zeros(1, np.int32),
        )
        heights.append(5.0 - mujoco.mj_ray(model, data, start, down, None, 1, -1, hit))
    return np.array(heights)


@pytest.mark.parametrize("growing", [False, True])
@pytest.mark.parametrize("name", TERRAINS)
def test_heights_go_on_as_they_began_and_are_as_high_as_was_asked_for(name, growing):
    made = options(name, height=0.05, growing=growing)
    heights = made.heights()
    assert heights.shape == (made.cells, made.cells) and heights.max() <= 0
    within = np.abs(np.diff(heights, axis=0)).max()
    for axis in (0, 1):
        seam = heights - np.roll(heights, 1, axis)
        assert np.abs(seam).max() <= within + 1e-9
    height = {"steps": 0.05 * 5}.get(name, 0.05)
    assert -heights.min() == pytest.approx(height, rel=0.05)


@pytest.mark.parametrize("name", TERRAINS)
def test_the_ground_is_that_of_the_heights_everywhere(name):
    """At corners of cells, near the start and kilometres away."""
    env = make(f"arena={name}")
    made = options(name)
    heights, period = made.heights(), period_of(env.model)
    assert period == pytest.approx(made.period)
    corners = np.random.default_rng(0).integers(0, made.cells, (20, 2))
    for far in ([0.0, 0.0], [-1252 * period, 1251 * period]):
        # Just beside a corner, as a ray through it may pass between two triangles.
        xy = corners * made.CELL + 1e-7 + np.array(far)
        expected = heights[corners[:, 1], corners[:, 0]]
        np.testing.assert_allclose(ground_below(env, xy), expected, atol=1e-5)


@pytest.mark.parametrize("start", ["upright", "any"])
@pytest.mark.parametrize("name", TERRAINS)
def test_robots_start_all_over_it_and_on_top_of_it(name, start):
    env = make(f"arena={name}", f"env.start={start}", "env.settle_time=0", num_envs=64)
    env.reset()
    places, period = env.physics.qpos[:, :3].numpy(), period_of(env.model)
    assert np.abs(places[:, :2]).max() <= period / 2
    assert (places[:, :2].std(0) > 0.2 * period).all()
    clearance = places[:, 2] - ground_below(env, places[:, :2])
    assert clearance.min() > 0.02
    assert (clearance < 0.12 + np.ptp(env.model.hfield_data) * env.model.hfield_size[0, 2]).all()
    data = mujoco.MjData(env.model)
    for qpos in env.physics.qpos.numpy():
        data.qpos[:] = qpos
        put_under(env.model, data)
        mujoco.mj_forward(env.model, data)
        assert all(contact.dist > -2e-3 for contact in data.contact)


def test_they_stand_on_it_also_five_kilometres_away():
    env = make("arena=slopes", num_envs=8)
    env.reset()
    qpos = env.physics.qpos.clone()
    for far in (0.0, 1250 * period_of(env.model)):
        moved = qpos.clone()
        moved[:, :2] += far
        env.set_state(moved, torch.zeros(8, env.model.nv))
        for _ in range(8):
            env.step(env.fake_tensordict().set("action", env.action_spec.zero()))
        places = env.physics.qpos[:, :3].numpy()
        above = places[:, 2] - ground_below(env, places[:, :2])
        assert (above > 0.02).all() and (above < 0.08).all()
        assert not env.take_divergences()


def test_steps_come_out_the_same_one_by_one_and_across_the_edge_of_a_period():
    walked = []
    for watched in (False, True):
        env = make("arena=rough")
        env.reset(seed=0)
        qpos = env.physics.qpos.clone()
        qpos[:, 0] = period_of(env.model) / 2 - 0.02  # beyond which the ground is moved
        qvel = torch.zeros(4, env.model.nv)
        qvel[:, 0] = 1.0
        env.set_state(qpos, qvel)
        torch.manual_seed(0)
        for _ in range(6):
            td = env.fake_tensordict().set("action", env.action_spec.rand())
            if watched:
                with env.after_substep(lambda physics: None):
                    env.step(td)
            else:
                env.step(td)
        walked.append(env.physics.motion.clone())
    assert torch.equal(*walked)
    assert (walked[0][:, 1] > 2.0).any()


def test_a_state_has_the_ground_in_it(tmp_path):
    env, other = make("arena=mix"), make("arena=mix")
    env.reset(seed=0)
    torch.manual_seed(0)
    seen = env.rollout(5)[:, -1]["next"].exclude("reward")
    other.load_state_dict(env.state_dict())
    walks = []
    for one in (env, other):
        torch.manual_seed(1)
        walks.append(one.rollout(5, auto_reset=False, tensordict=seen.clone()))
    assert (walks[0] == walks[1]).all()


def test_dm_controls_environment_walks_on_it_too():
    env = make("arena=steps", "env.settle_time=0")
    reference = composer.Environment(env.task, random_state=0)
    reference.reset()
    data, rng = reference.physics.data, np.random.default_rng(0)
    assert np.abs(data.qpos[:2]).max() > 0.1
    env.set_state(torch.tensor(data.qpos), torch.tensor(data.qvel))
    for _ in range(4):
        action = rng.uniform(-1, 1, env.model.nu)
        reference.step(action)
        env.step(env.fake_tensordict().set("action", torch.as_tensor(action).expand(4, -1)))
        np.testing.assert_allclose(env.physics.qpos[1], data.qpos, atol=1e-5)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            {"name": "rough", "height": 0.9},
            "arena.height=0.9 must be at most 0.255 with arena.wave",
        ),
        ({"name": "steps", "height": 0.9}, "arena.height=0.9 must be at most 0.4 with arena.tread"),
        ({"name": "slopes", "height": 3}, "arena.height=3.0 must be at most 2 with arena.period=4"),
        ({"name": "mix", "height": 0.7}, "arena.height=0.7 must be at most 0.5 with arena.period"),
        ({"name": "rough", "height": -1}, "arena.height=-1.0 must be at least 0"),
        ({"name": "rough", "wavelength": 0.1}, "arena.wavelength=0.1 must be at least 0.2"),
        ({"name": "stones", "size": 0.1}, "arena.size=0.1 must be at least 0.4"),
        ({"name": "rough", "period": 100}, "arena.period=100.0 must be at least 2 and at most 20"),
        ({"name": "rough", "hight": 0.1}, "arena.hight is not a key; did you mean arena.height?"),
    ],
)
def test_ground_that_cannot_be_is_refused(keys, message):
    with pytest.raises(ConfigError) as caught:
        chosen(arenas, keys, "arena")
    assert message in str(caught.value) and "\n" not in str(caught.value)
