"""What a policy may sense: TorchRL transforms that any environment can use.

Nothing here imports the rest of this package.
"""

from locomotion.transforms.hinge_history import HingeHistory
from locomotion.transforms.orientation import IncludeOrientation

__all__ = ["HingeHistory", "IncludeOrientation"]
