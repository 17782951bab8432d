"""Room for contacts, which only MuJoCo Warp has."""

import pytest
import torch

from locomotion.envs import LocomotionEnv
from locomotion.options import ConfigError, load_file
from locomotion.options.files import conf_dir
from locomotion.physics.options import PhysicsConfig

pytestmark = pytest.mark.slow

pytest.importorskip("warp", reason="needs packages: pip install -e '.[warp]'")


@pytest.fixture(params=["cpu", "cuda:0"])
def warped(request):
    """Makes an environment on a device of Warp's."""
    if request.param != "cpu" and not torch.cuda.is_available():
        pytest.skip("there is no GPU here")

    def warped(num_envs, robot="gecko", physics=None, **keywords):
        physics = {"backend": "warp", "device": request.param, **(physics or {})}
        return LocomotionEnv(robot, num_envs, physics=physics, seed=0, **keywords)

    return warped


@pytest.mark.parametrize("control_frequency", [4.0, 1.0])
def test_too_little_room_for_contacts_is_said(control_frequency, warped):
    """Also if there was too little only in the first part of a long control step."""
    env = warped(4, physics={"contacts": 2}, settle_time=0.0, control_frequency=control_frequency)
    td = env.reset()
    with pytest.raises(
        ConfigError, match=r"than the 2 each .* physics\.contacts=4 gives them more"
    ):
        for _ in range(8):
            td = env.step(env.rand_action(td))["next"]


def test_a_lack_of_room_early_in_a_control_step_is_said(warped):
    """A robot that stands, and jumps."""
    env = warped(2, physics={"contacts": 2}, settle_time=0.0, control_frequency=0.5)
    td = env.reset()
    env.physics.qvel[:, 2] = 12.0  # it is still in the air at the end
    env.physics.qpos[:, 2] -= 1e-3
    with pytest.raises(ConfigError, match=r"physics\.contacts=4"):
        env.step(td.set("action", torch.zeros(2, 6, device=env.physics.device)))


def test_the_suggested_room_is_enough_for_limbs_that_collide(warped):
    env = warped(8, "ant", physics={"self_collision": True})
    rollout = env.rollout(20, break_when_any_done=False)
    assert not rollout["next", "terminated"].any()


def test_both_choices_describe_the_same_bodies():
    threaded, warp = (
        load_file(conf_dir() / "physics" / f"{name}.yaml", PhysicsConfig)
        for name in ("threaded", "warp")
    )
    for key in vars(threaded).keys() - {"backend", "device", "threads", "contacts"}:
        assert getattr(threaded, key) == getattr(warp, key)
