"""Speed alone: ``python -m benchmarks.throughput``, and ``python -m benchmarks.gpu`` on a GPU."""
