import numpy as np
import pytest


@pytest.fixture(scope="session")
def pincers():
    """A body with two long limbs that swing to the sides, one in front and one to the left."""
    limb = {"module": "brick"}
    for _ in range(2):
        limb = {"module": "brick", "children": {"front": limb}}
    hinge = {"module": "hinge", "rotation": 90, "children": {"attachment": limb}}
    return {"module": "core", "children": {"front": hinge, "left": hinge}}


@pytest.fixture(scope="session")
def closed():
    """Hinge targets (rad) at which the limbs of ``pincers`` want to be where the other one is."""
    return np.array([1.0, -1.0])
