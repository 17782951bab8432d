"""A gait in MuJoCo's viewer, as it happens."""

from __future__ import annotations

import threading
import time

import mujoco
import mujoco.viewer

from locomotion.arenas.periodic import put_under
from locomotion.evaluation import PolicyRunner
from locomotion.options import ConfigError
from locomotion.physics import Physics


def show_live(runner: PolicyRunner, seconds: float, sampled: bool = False) -> None:
    """Lets the first robot of a runner walk in a window, at the pace of the clock.

    Ends when the time is over or the window is closed.

    Args:
        runner: robots and their policy.
        seconds: for how long.
        sampled: whether actions are drawn, as in training, or are the policy's mean.

    Raises:
        ConfigError: if MuJoCo cannot open its viewer.
    """
    env = runner.base_env
    data = mujoco.MjData(env.model)
    timestep = env.model.opt.timestep
    threads = {*threading.enumerate()}
    try:
        window = mujoco.viewer.launch_passive(
            env.model, data, show_left_ui=False, show_right_ui=False
        )
    except RuntimeError as error:  # on a Mac it wants to be started by mjpython
        raise ConfigError(f"live=true: {' '.join(str(error).split())}") from error
    with window as viewer:
        viewer.cam.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        viewer.cam.trackbodyid = env.model.jnt_bodyid[0]
        viewer.cam.distance, viewer.cam.azimuth, viewer.cam.elevation = 1.7, 120.0, -25.0
        due = time.perf_counter()

        def show(physics: Physics) -> None:
            nonlocal due
            data.qpos[:] = physics.qpos[0].numpy(force=True)
            put_under(env.model, data)
            data.time += timestep
            mujoco.mj_forward(env.model, data)
            viewer.sync()
            due = max(due + timestep, time.perf_counter() - timestep)
            time.sleep(max(0.0, due - time.perf_counter()))

        runner.start()
        with env.after_substep(show):
            while viewer.is_running() and data.time < seconds:
                runner.step(sampled)
    # The viewer is told to close and does so in a thread of its own; a process that ends meanwhile crashes.
    for thread in {*threading.enumerate()} - threads:
        thread.join(timeout=10)
