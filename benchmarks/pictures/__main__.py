from benchmarks.common.commands import run

run(__package__, "filming", "arcs", "chain", "report", "turns")
