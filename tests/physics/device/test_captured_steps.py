"""Gradient steps that are captured, on a GPU."""

import pytest
import torch

from locomotion import compose
from locomotion.training.build import make_collector, make_env, make_learner

pytest.importorskip("warp", reason="needs packages: pip install -e '.[warp]'")
pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU here"),
]


def test_a_captured_gradient_step_is_the_one_that_it_captured():
    batch, learned = None, []
    for cudagraphs in (False, True):
        config = compose(
            *("+obs=history3", "physics=warp", "physics.device=cuda:0", "env.num_envs=5"),
            *("ppo.steps=12", "ppo.minibatch_size=15", f"ppo.cudagraphs={cudagraphs}"),
        )
        torch.manual_seed(config.seed)
        env = make_env(config)
        learner = make_learner(config, env)
        if batch is None:
            batch = next(iter(make_collector(env, learner, config.learner.steps)))
        torch.manual_seed(0)  # the order of the minibatches
        learned.append([learner.update(batch.clone()) for _ in range(3)])
    for eager, captured in zip(*learned):
        assert captured["loss_critic"] == pytest.approx(eager["loss_critic"], rel=1e-3)
        assert captured["kl_approx"] == pytest.approx(eager["kl_approx"], rel=1e-2, abs=1e-5)
