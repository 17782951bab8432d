"""Modular robots learn to walk: dm-control bodies, batched MuJoCo, TorchRL."""

import warnings

# dm-control tries to open a window at import; a machine without a screen is no reason to warn.
warnings.filterwarnings("ignore", message=".*The DISPLAY environment variable is missing")
