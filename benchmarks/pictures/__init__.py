"""The pictures of the docs that show how to film and how a run works.

python -m benchmarks.pictures filming -o docs/images/filming.jpg
python -m benchmarks.pictures arcs -o docs/images/arcs.svg
python -m benchmarks.pictures chain out/demo -o docs/images/chain.jpg
python -m benchmarks.pictures report OUT -o docs/images/report_none.jpg
python -m benchmarks.pictures turns RUN RUN --titles clean leak -o docs/images/turns.png
"""
