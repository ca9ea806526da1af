#!/bin/sh
# tests/wheel_check.sh PYTHON: builds the wheel, installs it alone, without what no command
# imports, and runs it away from the sources.
set -eu
python=$(realpath -s "$1")
root=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

PIP_CONSTRAINT=$root/constraints.txt "$python" -m build --outdir "$work" "$root" >"$work/build.log" 2>&1 || { cat "$work/build.log"; exit 1; }
"$root/.ci/venv" "$work/venv"
"$work/venv/bin/python" -m pip install --quiet --disable-pip-version-check -c "$root/constraints.txt" "$work"/*.whl
"$root/.ci/slim" "$work/venv"

cd "$work"
PATH=$work/venv/bin:$PATH
locate --help >/dev/null
python -m locate --help >/dev/null
python - <<'PYTHON'
from importlib.resources import files
from importlib.util import find_spec

assert find_spec("torch") is None, "the runtime must not need torch"
for name in ("page/page.html", "page/style.css", "report/body.html", "report/scene.js"):
    assert (files("locate") / "data" / name).is_file(), f"the wheel lacks {name}"
PYTHON
sample=$(python -c 'from locate.recording.sample import SAMPLE_VIDEO; print(SAMPLE_VIDEO)')
locate run "$sample" -o run --max-frames 16
test -s run/map.json
test -s run/report.html
echo "The wheel stands alone."
