"""TorchRL transforms of what a policy may sense, which any environment can use.

Nothing here imports the rest of this package.
"""

from locomotion.transforms.hinge_history import HingeHistory
from locomotion.transforms.orientation import IncludeOrientation
from locomotion.transforms.random_mirror import RandomMirror
from locomotion.transforms.sensor_noise import SensorNoise

__all__ = ["HingeHistory", "IncludeOrientation", "RandomMirror", "SensorNoise"]
