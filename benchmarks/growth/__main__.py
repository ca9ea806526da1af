from benchmarks.common.commands import run

run(__package__, "run", "plumes", "hover")
