from benchmarks.common.commands import run

run(__package__, "render", "table", "clips", "speed", "pixels")
