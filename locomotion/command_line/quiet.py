"""What libraries say at every start, and nobody needs to read."""

from __future__ import annotations

import warnings


def quiet() -> None:
    """Silences libraries, and gives torch one thread; call it before they are imported."""
    # dm-control turns such warnings on for everyone; these are TorchRL's, about parts of its own.
    warnings.filterwarnings("ignore", "Creating .*WeightUpdaterBase is deprecated")
    # CudaGraphModule takes tensordicts out of torch's pytrees, which nothing here uses.
    warnings.filterwarnings("ignore", "Tensordict is registered in PyTree")
    import torch
    from absl import logging as absl_logging
    from tensordict.utils import logger as tensordict_logger
    from torchrl import torchrl_logger

    for logger in (torchrl_logger, tensordict_logger):
        logger.setLevel("WARNING")
    absl_logging.set_verbosity("error")  # MuJoCo's warnings; what diverges is reported by itself
    torch.set_num_threads(1)  # for networks this small a second one takes more than it gives
