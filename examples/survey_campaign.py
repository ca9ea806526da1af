"""A survey campaign: flights over a farm on two days, joined to one map of its thermals.

    python examples/survey_campaign.py              # eight flights: half an hour on two cores
    python examples/survey_campaign.py --flights 3

The steps below are what `locate simulate`, `locate survey` and `locate evaluate` do.
"""

import argparse
from pathlib import Path

from rich.console import Console

from locate.journal.progress import progress_bars
from locate.simulation.campaign import Campaign, simulate_campaign
from locate.survey.build import build_survey
from locate.survey.engine import LOCAL
from locate.survey.model import SurveySettings
from locate.survey.scoring import SurveyScore, score_survey, score_table
from locate.survey.table import survey_table

SCENE = Path(__file__).parent / "scenes" / "campaign.yaml"


def main(output: Path, flights: int, scheduler: str | None = LOCAL) -> SurveyScore:
    console = Console()

    # 1. Fly it: columns of warm air stand over some roofs and fields, with a probability that
    #    changes over the day, and lean with the wind; a receiver that errs writes DJI's subtitles.
    campaign = Campaign.load(SCENE)
    campaign = campaign.model_copy(update={"flights": campaign.flights[:flights]})
    recordings = output / "campaign"
    with progress_bars(console) as report:
        simulate_campaign(
            campaign, recordings, progress=lambda done, total: report("film", done / total)
        )

        # 2. Join it. Each flight is run on its own and placed by its subtitles; then sightings of
        #    several flights are held against each other. Over flat ground from parallel views the
        #    focal length cannot be seen, so the camera is given. Run this again with more flights:
        #    those that are done are not done again.
        videos = [next((recordings / "videos").glob(f"{f.name}.mkv")) for f in campaign.flights]
        settings = SurveySettings(camera=recordings / "camera.json", cell_m=4.0)
        answer = build_survey(
            videos, output / "survey", settings=settings, scheduler=scheduler, report=report
        )

    # 3. Read the answer: where, how often seen, and how often looked for.
    console.print(survey_table(answer))

    # 4. Hold it against the truth of the campaign.
    score = score_survey(answer, recordings)
    console.print(score_table(score))
    console.print(f"Look at {output / 'survey' / 'map.html'}", soft_wrap=True)
    return score


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/survey_campaign"))
    parser.add_argument("--flights", type=int, default=8)
    arguments = parser.parse_args()
    main(arguments.output, arguments.flights)
