from benchmarks.common.commands import run

run(__package__, "displacement", "network", "location", "poses", "compare")
