"""What the framework costs and what it saves, as ratios: ``python -m benchmarks.throughput``."""
