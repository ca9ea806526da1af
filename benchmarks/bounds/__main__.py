from benchmarks.common.commands import run

run(__package__, "source", "displacement", "weak-plume", "known-plume")
