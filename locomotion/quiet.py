"""Libraries that say nothing that nobody needs to read, and leave the cores to MuJoCo."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Silences libraries and gives torch one thread within the block.

    For networks as small as a gait's, a second thread takes more than it gives.
    """
    from dm_control import composer  # noqa: F401  turns warnings on for everyone, so before they go

    with warnings.catch_warnings():
        # These are TorchRL's, about parts of its own.
        warnings.filterwarnings("ignore", "Creating .*WeightUpdaterBase is deprecated")
        # CudaGraphModule takes tensordicts out of torch's pytrees, which nothing here uses.
        warnings.filterwarnings("ignore", "Tensordict is registered in PyTree")
        # A policy that a GPU trained walks without one.
        warnings.filterwarnings("ignore", "This module is instantiated on a machine without CUDA")
        import torch
        from absl import logging as absl_logging
        from tensordict.utils import logger as tensordict_logger
        from torchrl import torchrl_logger

        before = [(logger, logger.level) for logger in (torchrl_logger, tensordict_logger)]
        threads, verbosity = torch.get_num_threads(), absl_logging.get_verbosity()
        for logger, _ in before:
            logger.setLevel("WARNING")
        absl_logging.set_verbosity(
            "error"
        )  # MuJoCo's warnings; what diverges is reported by itself
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)
            absl_logging.set_verbosity(verbosity)
            for logger, level in before:
                logger.setLevel(level)
