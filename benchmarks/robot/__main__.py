from benchmarks.common.commands import run

run(__package__, "bag", "live", "offline", "update", "next-view")
