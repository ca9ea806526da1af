from benchmarks.common.commands import run

run(__package__, "orbit", "special", "still", "limit", "physical")
