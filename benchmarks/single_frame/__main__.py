from benchmarks.common.commands import run

run(__package__, "table", "shift", "blobs", "speed", "adapt")
