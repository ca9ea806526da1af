from pathlib import Path

import pytest

from geometry.errors import BadInputError
from locate.survey.storage import FETCHED, fetch_flights, mirror_folder, pull_folder

fsspec = pytest.importorskip("fsspec")


@pytest.fixture
def memory():
    files = fsspec.filesystem("memory")
    files.store.clear()
    files.pseudo_dirs[:] = [""]
    files.pipe({"/far/DJI_1.MP4": b"video", "/far/DJI_1.SRT": b"where", "/far/DJI_2.MP4": b"x"})
    files.pipe({"/far/run/map.json": b"{}", "/far/run/frames/000000.png": b"png"})
    yield files
    files.store.clear()


@pytest.fixture
def bucket(monkeypatch):
    """A bucket of an S3 server of this test's own."""
    s3fs = pytest.importorskip("s3fs", reason="pip install s3fs 'moto[server]'")
    moto = pytest.importorskip("moto.server", reason="pip install s3fs 'moto[server]'")
    server = moto.ThreadedMotoServer(port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "none")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    s3fs.S3FileSystem.clear_instance_cache()
    files = s3fs.S3FileSystem()
    files.mkdir("bucket")
    yield files
    s3fs.S3FileSystem.clear_instance_cache()
    server.stop()


@pytest.mark.filterwarnings("default")  # boto's own
def test_s3_holds_flights_and_surveys(bucket, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    bucket.pipe({"bucket/june/DJI_1.MP4": b"video", "bucket/june/DJI_1.SRT": b"where"})
    (video,) = fetch_flights(["s3://bucket/june/DJI_1.MP4"], tmp_path)
    assert video.read_bytes() == b"video"
    assert video.with_suffix(".SRT").read_bytes() == b"where"
    with mirror_folder("s3://bucket/farm") as folder:
        (folder / "flights").mkdir()
        (folder / "flights" / "map.json").write_bytes(b"{}")
    bucket.invalidate_cache()
    assert bucket.cat("bucket/farm/flights/map.json") == b"{}"
    with pytest.raises(BadInputError, match="s3://elsewhere/none"):
        fetch_flights(["s3://elsewhere/none.mp4"], tmp_path)


def test_flights_come_here_with_their_telemetry(memory, tmp_path):
    near = tmp_path / "near.mp4"
    given = ["memory://far/DJI_1.MP4", str(near), "memory://far/run", f"file://{near}"]
    video, same, run, again = fetch_flights(given, tmp_path)
    assert (same, again) == (near, near)
    assert video.read_bytes() == b"video"
    assert sorted(path.name for path in video.parent.iterdir()) == ["DJI_1.MP4", "DJI_1.SRT"]
    assert video.parent.parent == tmp_path / FETCHED
    assert (run / "frames" / "000000.png").read_bytes() == b"png"
    before = video.stat().st_mtime_ns
    assert fetch_flights(given, tmp_path)[0].stat().st_mtime_ns == before


def test_what_is_not_there_is_reported(memory, tmp_path):
    with pytest.raises(BadInputError, match=r"memory://far/none\.mp4"):
        fetch_flights(["memory://far/none.mp4"], tmp_path)
    with pytest.raises(BadInputError, match="cannot be opened"):
        fetch_flights(["nosuch://far/none.mp4"], tmp_path)


def test_whatever_a_store_raises_is_reported_in_one_line(memory, tmp_path, monkeypatch):
    class NoCredentialsError(Exception):
        """As boto's, which is no OSError."""

    def refused(*_args, **_how):
        raise NoCredentialsError("Unable to locate credentials")

    monkeypatch.setattr(type(memory), "get_file", refused)
    with pytest.raises(BadInputError, match=r"DJI_1\.MP4: cannot be .* locate credentials"):
        fetch_flights(["memory://far/DJI_1.MP4"], tmp_path)
    monkeypatch.setattr(type(memory), "exists", refused)
    with (
        pytest.raises(BadInputError, match="memory://survey: cannot be"),
        mirror_folder("memory://survey"),
    ):
        pass


def test_a_survey_elsewhere_is_sent_back(memory, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    memory.pipe({"/survey/survey.json": b"old", "/survey/survey.gpkg": b"old"})
    memory.pipe({"/survey/gone.txt": b"gone"})
    with mirror_folder("memory://survey") as folder:
        assert (folder / "survey.json").read_bytes() == b"old"
        (folder / "survey.json").write_bytes(b"new")
        (folder / "survey.gpkg").write_bytes(b"new")
        (folder / "gone.txt").unlink()
        (folder / "flights" / "a").mkdir(parents=True)
        (folder / "flights" / "a" / "map.json").write_bytes(b"{}")
    assert memory.cat("/survey/survey.json") == b"new"
    assert memory.cat("/survey/survey.gpkg") == b"new"
    assert memory.cat("/survey/flights/a/map.json") == b"{}"
    assert not memory.exists("/survey/gone.txt")
    with pytest.raises(KeyError):
        fail_halfway("memory://survey", folder)
    assert memory.cat("/survey/more.txt") == b"more"


def fail_halfway(address, folder):
    with mirror_folder(address) as again:
        assert again == folder
        (again / "more.txt").write_bytes(b"more")
        raise KeyError


def test_a_folder_here_is_used_as_it_is(tmp_path):
    with mirror_folder(str(tmp_path)) as folder:
        assert folder == tmp_path
    with mirror_folder(f"file://{tmp_path}") as folder:
        assert folder == Path(tmp_path)


def test_workers_elsewhere_need_a_folder_they_share(memory):
    with (
        pytest.raises(BadInputError, match="that they share"),
        mirror_folder("memory://survey", "tcp://10.0.0.1:8786"),
    ):
        pass


class Listing:
    """A store that lists a file outside the folder that was asked for."""

    def exists(self, _root):
        return True

    def find(self, root, detail):
        return {f"{root}/../../victim": {"size": 3}} if detail else [f"{root}/../../victim"]

    def get_file(self, _path, target):
        Path(target).write_bytes(b"bad")


def test_a_listing_cannot_lead_outside(tmp_path):
    (tmp_path / "survey" / "copy").mkdir(parents=True)
    with pytest.raises(BadInputError, match="leads outside"):
        pull_folder(Listing(), "far/run", tmp_path / "survey" / "copy")
    assert not (tmp_path / "victim").exists()
