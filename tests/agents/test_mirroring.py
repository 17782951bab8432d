"""Mirror images of what robots sense and do: against robots that are each other's mirror images."""

import pytest
import torch
from torchrl.envs import CatTensors

from locomotion import compose
from locomotion.agents.mirroring import mirror_images
from locomotion.options import ConfigError
from locomotion.robots import load_robot, mirrors, parse_body
from locomotion.training.build import make_env, make_learner

pytestmark = pytest.mark.slow

READINGS = (
    *("hinge_velocity", "hinge_torque", "hinge_target", "core_angular_velocity"),
    *("core_linear_velocity", "core_height", "course", "ground_contact", "disturbances"),
    "phase_clock",
)
TERMS = [
    *(f"+obs.{name}.steps=2" for name in READINGS),
    *(f"+obs.{form}.reading=core_orientation" for form in ("rotation_6d", "gravity")),
    *(f"+obs.{form}.representation={form}" for form in ("rotation_6d", "gravity")),
    *("+obs.slow.reading=hinge_velocity", "+obs.slow.scale=0.1", "+obs.slow.steps=3"),
    *("+obs=history3", "env.compass=false"),
]
YAW = ["+obs.yaw.reading=core_orientation", "+obs.yaw.representation=yaw"]


def put_images(env, found):
    """Puts a robot into the state of the first one, for each mirror of its body its image."""
    qpos, qvel = env.base_env.physics.qpos[:1].clone(), env.base_env.physics.qvel[:1].clone()
    rows = [(qpos[0], qvel[0])]
    for mirror in found:
        parts = (mirror.reflection, mirror.quaternion_matrix, mirror.hinge_matrix)
        place, turned, angles = (torch.tensor(part) for part in parts)
        qpos_image = [place @ qpos[0, :3], turned @ qpos[0, 3:7], angles @ qpos[0, 7:]]
        spin = torch.tensor(mirror.axial_matrix)
        qvel_image = [place @ qvel[0, :3], spin @ qvel[0, 3:6], angles @ qvel[0, 6:]]
        rows.append((torch.cat(qpos_image), torch.cat(qvel_image)))
    env.base_env.set_state(*(torch.stack(part) for part in zip(*rows)))


@pytest.mark.parametrize(
    ("robot", "overrides"), [("gecko", YAW), ("snake", YAW), ("spider", ["env.compass=true"])]
)
def test_an_image_senses_does_and_earns_what_the_matrices_say(robot, overrides):
    config = compose(f"robot={robot}", *TERMS, *overrides)
    found = mirrors(parse_body(load_robot(robot).body))
    config.env.num_envs = 1 + len(found)
    env = make_env(config)
    learner = make_learner(config, env)
    images = mirror_images(env, learner.policy.in_keys)
    assert len(images) == len(found)
    torch.manual_seed(0)
    tensordict = env.reset()
    put_images(env, found)
    for step in range(6):
        action = torch.rand(len(env.base_env.hinge_names)) * 2 - 1
        actions = [action, *(image["action"] @ action for image in images)]
        tensordict = env.step(tensordict.set("action", torch.stack(actions)))["next"]
        if step < 2:  # histories still hold what was sensed before
            continue
        for row, image in enumerate(images, start=1):
            assert {*image} == {"action", *learner.policy.in_keys}
            for key in learner.policy.in_keys:
                seen = tensordict[key]
                torch.testing.assert_close(
                    seen[row], image[key] @ seen[0], rtol=0, atol=2e-5, msg=str(key)
                )
        rewards = tensordict["reward"]
        torch.testing.assert_close(rewards, rewards[:1].expand_as(rewards), rtol=0, atol=1e-6)
    assert (tensordict["hinge_position_history"][0].abs() > 0.01).any()
    env.close()


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["robot=park"], "a body with a mirror; robot=park has none"),
        (["task=walk_along"], "Velocity is not known to be one"),
        (["robot=spider", *YAW], "'yaw_yaw' has none"),
        (["network=gru"], "a network without a memory"),
    ],
)
def test_what_has_no_mirror_image_is_refused(overrides, message):
    with pytest.raises(ConfigError, match=f"ppo.symmetry=True needs .*{message}"):
        config = compose("ppo.symmetry=true", "env.num_envs=2", "ppo.minibatch_size=2", *overrides)
        make_learner(config, make_env(config))


def test_a_transform_of_ones_own_is_refused_until_it_tells_its_matrix():
    class Joined(CatTensors):
        pass

    config = compose("+obs=hinges", "ppo.symmetry=true", "env.num_envs=2", "ppo.minibatch_size=2")
    env = make_env(config, transforms=[Joined(["hinge_position"], "joined", del_keys=False)])
    with pytest.raises(ConfigError, match="'joined' has none"):
        make_learner(config, env, in_keys=["joined"])
    Joined.mirror_matrix = lambda self, matrix: matrix
    assert make_learner(config, env, in_keys=["joined"]).policy.in_keys == ["joined"]


def test_another_environment_has_no_body_to_be_mirrored(target_env):
    with pytest.raises(ConfigError, match="needs robots of a LocomotionEnv"):
        mirror_images(target_env(2), ["target"])
