from benchmarks.common.commands import run

run(__package__, "run", "sizes", "plumes", "hover", "picture")
