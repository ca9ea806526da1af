from benchmarks.common.commands import run

run(__package__, "displacement", "real-pair", "network", "location", "poses", "compare")
