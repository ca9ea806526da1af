import subprocess
import sys

from tests.no_network import forbid_network

LOADS = """
import sys
from geometry.open3d_loader import WEB_DRAWING, load_open3d
assert load_open3d().geometry.PointCloud
assert not {"dash", "flask", "requests", WEB_DRAWING} & sys.modules.keys()
"""


def test_open3d_is_loaded_without_a_web_server_and_its_socket() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOADS],
        check=False,
        capture_output=True,
        text=True,
        preexec_fn=forbid_network,
    )
    assert done.returncode == 0, done.stderr
