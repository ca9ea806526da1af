"""What the docs state figures of, each by a command: `python -m benchmarks.NAME [SUB-COMMAND]`.

Run from the root of the repository; `--help` says what is measured and how. Nothing here is part of
the wheel; no test imports a benchmark and no benchmark a test.
"""
