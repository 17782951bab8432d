"""How sweeps run: plugins of Hydra, which finds them in the namespace ``hydra_plugins``.

They import nothing of ``locomotion``, as Hydra imports them in every application of an environment.
"""
