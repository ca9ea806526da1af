"""Whether the benchmarks compute what they say: `python -m benchmarks.checks [PYTEST OPTIONS]`."""
