"""The report's figures and claims: ``python -m reproduction.ablation``, and experiments about them."""

from pathlib import Path

#: Where the commands leave what they found.
RESULTS = Path(__file__).with_name("results")
