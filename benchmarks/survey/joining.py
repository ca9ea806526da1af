"""What joining the flights of a survey costs: CPU s and memory against the number of flights.

``python -m benchmarks.scaling_fusion [FLIGHTS...]``: each flight sees 4 of 20 hotspots.
"""

import resource
import sys
import time

import numpy as np

from locate.survey.associate import associate
from tests.locate.test_survey_fusion import WANDER_M, flown, offset

AREA_M = 400.0


def main() -> None:
    print("flights | sightings | CPU s | hotspots of 20 | peak MiB of the process")
    for flights in map(int, sys.argv[1:] or ("25", "50", "100", "200")):
        rng = np.random.default_rng(flights)
        sites = np.c_[rng.uniform(0, AREA_M, (20, 2)), np.zeros(20)]
        leans = rng.normal(0, 0.1, (flights, 2))
        seen, _ = flown(sites, leans, 4.0, rng)
        kept = [i for f in range(flights) for i in 20 * f + rng.permutation(20)[:4]]
        start = time.process_time()
        fused = associate(
            [seen[i] for i in kept],
            [offset(f) for f in range(flights)],
            leans,
            wander_m=WANDER_M,
            area_m2=AREA_M**2,
        )
        spent = time.process_time() - start
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        found = len(np.unique(fused.hotspot_of))
        print(f"{flights} | {len(kept)} | {spent:.1f} | {found} | {peak:.0f}", flush=True)


if __name__ == "__main__":
    main()
