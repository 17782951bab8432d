"""The task's numbers, which all rivals share."""

CONTROL_TIMESTEP = 0.25  # s
SETTLE_TIME = 0.5  # s
