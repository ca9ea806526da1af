import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from scipy.optimize import least_squares

from detect.synthesis import FAMILIES, Recipe, Sample, Sources, dataset, flows, sample_at
from detect.synthesis.buoyancy import BuoyantFlow
from detect.synthesis.camera import MARGIN_PX, WHITE, CameraOptics, expose_background
from detect.synthesis.dataset import Shard, render_dataset, shards_in
from detect.synthesis.flows import (
    normalise_potential,
    potential_gradient,
    random_turbulence,
    read_run,
    runs_in,
    write_run,
)
from detect.synthesis.placement import PlumePlacement
from detect.synthesis.raster import find_photos
from detect.synthesis.split import split_of_photo, split_of_run
from detect.warp import pixel_grid
from geometry.arrays import FloatArray, FloatMap
from geometry.errors import BadInputError

PAINTED = {family: 1.0 for family in FAMILIES if family != "photo"}
SMALL = Recipe(families=PAINTED, size_px=48)
INSIDE = slice(MARGIN_PX, -MARGIN_PX)


def samples(recipe: Recipe, count: int) -> list[Sample]:
    sources = Sources.from_recipe(recipe)
    return [sample_at(index, recipe, sources) for index in range(count)]


def same(one: Sample, other: Sample) -> bool:
    return (
        np.array_equal(one.image, other.image)
        and np.array_equal(one.displacement, other.displacement)
        and np.array_equal(one.mask, other.mask)
        and one.family == other.family
    )


def photo_folder(folder: Path, count: int) -> Path:
    rng = np.random.default_rng(0)
    folder.mkdir()
    for i in range(count):
        noise = rng.integers(0, 256, (100, 80), dtype=np.uint8)
        cv2.imwrite(str(folder / f"photo {i}.png"), noise)
    return folder


def test_a_sample_depends_on_seed_split_and_index_alone() -> None:
    sources = Sources.from_recipe(SMALL)
    later, first = sample_at(5, SMALL, sources), sample_at(0, SMALL, sources)
    assert same(first, sample_at(0, SMALL, sources))
    assert same(later, sample_at(5, SMALL, sources))
    assert not same(first, later)
    for change in ({"seed": 1}, {"split": "test"}):
        other = SMALL.model_copy(update=change)
        assert not same(first, sample_at(0, other, sources))


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_has_contrast_and_a_plume(family: str, tmp_path: Path) -> None:
    photos = photo_folder(tmp_path / "photos", 20)
    recipe = Recipe(families={family: 1}, size_px=48, photos=photos, negatives=0)
    for sample in samples(recipe, 4):
        assert sample.family == family
        assert sample.image.dtype == np.uint8
        assert sample.image.shape == sample.mask.shape == (48, 48)
        assert sample.displacement.shape == (48, 48, 2)
        assert sample.displacement.dtype == np.float32
        assert sample.image.std() > 3
        assert 2 < sample.image.mean() < 253
        assert sample.mask.any()


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_share_of_negatives(share: float) -> None:
    recipe = SMALL.model_copy(update={"negatives": share, "families": {"sinusoid": 1.0}})
    empty = np.mean([not sample.mask.any() for sample in samples(recipe, 60)])
    assert empty == pytest.approx(share, abs=0.12 if 0 < share < 1 else 0)


def test_negatives_of_one_family() -> None:
    recipe = SMALL.model_copy(update={"negatives": 0.0, "negatives_of": {"squares": 1.0}})
    for sample in samples(recipe, 20):
        assert sample.mask.any() == (sample.family != "squares")


def test_displacement_has_no_curl_and_the_mask_follows_it() -> None:
    for sample in samples(SMALL.model_copy(update={"negatives": 0.0}), 10):
        w = sample.displacement
        curl = np.gradient(w[..., 1], axis=1) - np.gradient(w[..., 0], axis=0)
        divergence = np.gradient(w[..., 0], axis=1) + np.gradient(w[..., 1], axis=0)
        inside = (slice(1, -1), slice(1, -1))
        assert np.abs(curl[inside]).max() < 1e-4 * np.abs(divergence[inside]).max() + 1e-6
        np.testing.assert_array_equal(sample.mask, np.linalg.norm(w, axis=-1) > 0.05)


def test_vectors_turn_with_the_plume() -> None:
    y, x = np.mgrid[-30:31, -20:21].astype(np.float32)
    potential = np.exp(-(x**2) / (2 * 3**2) - y**2 / (2 * 8**2))
    turn = np.radians(35)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    matrix = 1.5 * rotation @ np.diag([-1.0, 1.0])
    center = np.array([40.0, 28.0])
    place = PlumePlacement(frame_from_cells=matrix, center_px=center)
    found = place.displacement(potential, size_px=64, margin_px=0, drift_px=np.zeros(2))
    cells = (pixel_grid((64, 64)) - center) @ np.linalg.inv(matrix).T
    value = np.exp(-(cells[..., 0] ** 2) / 18 - cells[..., 1] ** 2 / 128)
    in_cells = -cells * [1 / 9, 1 / 64] * value[..., None]
    expected = in_cells @ np.linalg.inv(matrix) * 1.5
    np.testing.assert_allclose(found, expected, atol=0.03 * np.abs(expected).max())


def gaussian_warp(side: int, peak_px: float) -> FloatMap:
    across = pixel_grid((side, side)) - np.float32(side / 2)
    bump = np.exp(-(across**2).sum(axis=-1) / (2 * 14.0**2))
    warp = across * bump[..., None]
    return np.asarray(warp * (peak_px / np.linalg.norm(warp, axis=-1).max()), dtype=np.float32)


def test_pixel_p_shows_the_background_at_p_plus_w() -> None:
    kx, ky, sigma, size = 0.5, 0.2, 0.45, 64
    shift = np.array([0.2, -0.4])
    warp = gaussian_warp(size + 2 * MARGIN_PX, 1.0)
    image = expose_background(
        lambda x, y: 0.5 + 0.3 * np.sin(kx * x + ky * y),
        [warp],
        shift,
        CameraOptics(psf_sigma_px=sigma),
        np.random.default_rng(0),
    )
    kept = np.exp(-(kx**2 + ky**2) * sigma**2 / 2)
    kept *= np.sinc(kx / (2 * np.pi)) * np.sinc(ky / (2 * np.pi))

    def formula(sign: float) -> FloatArray:
        place = pixel_grid((size, size)) + shift + sign * warp[INSIDE, INSIDE]
        return np.asarray(WHITE * (0.5 + 0.3 * kept * np.sin(place @ [kx, ky])))

    assert np.abs(image - formula(1)).max() < 1.5
    assert np.abs(image - formula(-1)).max() > 20


def test_a_sample_explains_its_background() -> None:
    """Fits one wave to the still part; with + w it must hold in the plume to within the noise."""
    recipe = Recipe(
        families={"sinusoid": 1}, carriers=1, tilt=0, light_fall=0, gamma=(1, 1), jpeg_share=0,
        noise=(1, 1), peak_px=(1, 1), period_px=(8, 12), negatives=0, size_px=96, exposures=1,
    )  # fmt: skip
    sample = next(s for s in samples(recipe, 20) if 0.15 < s.mask.mean() < 0.4)
    grey = sample.image.astype(float)
    spectrum = np.abs(np.fft.fft2(grey - grey.mean()))
    row, column = np.unravel_index(spectrum[:, :48].argmax(), (96, 48))
    start = 2 * np.pi * np.array([np.fft.fftfreq(96)[column], np.fft.fftfreq(96)[row]])

    def residual(k: FloatArray, sign: float) -> FloatArray:
        phase = (pixel_grid(grey.shape) + sign * sample.displacement) @ k
        waves = np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=-1)
        still = ~sample.mask
        parameters = np.linalg.lstsq(waves[still], grey[still])[0]
        return np.asarray(grey - waves @ parameters)

    k = least_squares(lambda k: residual(k, 1)[~sample.mask], start).x
    in_plume = {sign: residual(k, sign)[sample.mask].std() for sign in (-1, 0, 1)}
    assert in_plume[1] < 1.25
    assert in_plume[0] > 1.5 * in_plume[1]
    assert in_plume[-1] > in_plume[0]


def test_exposure_averages_the_moments() -> None:
    def ramp(x: FloatMap, y: FloatMap) -> FloatMap:
        return np.asarray(x / 64 + 0 * y)

    warps = [gaussian_warp(40, peak) for peak in (0.5, 2.5)]
    rng = np.random.default_rng(0)
    together, alone = (
        expose_background(ramp, moments, np.zeros(2), CameraOptics(), rng).astype(int)
        for moments in (warps, [np.asarray((warps[0] + warps[1]) / 2)])
    )
    assert np.abs(together - alone).max() <= 1
    first = expose_background(ramp, warps[:1], np.zeros(2), CameraOptics(), rng)
    assert np.abs(together - first).max() >= 3


@pytest.mark.parametrize(("gamma", "quality"), [(0.5, None), (1.0, 70), (1.7, 95)])
def test_tone_and_jpeg_stay_eight_bit(gamma: float, quality: int | None) -> None:
    def grey(x: FloatMap, y: FloatMap) -> FloatMap:
        return np.asarray(0.25 + 0 * x * y)

    optics = CameraOptics(gamma=gamma, jpeg_quality=quality, noise=2)
    still = [np.zeros((46, 46, 2), np.float32)]
    image = expose_background(grey, still, np.zeros(2), optics, np.random.default_rng(0))
    assert image.dtype == np.uint8
    assert image.shape == (40, 40)
    assert image.mean() == pytest.approx(255 * 0.25**gamma, rel=0.03)


def test_plumes_stand_everywhere_alike() -> None:
    rng = np.random.default_rng(3)
    size, total, count = 32, np.zeros((32, 32)), 1500
    for _ in range(count):
        potential = random_turbulence(rng)
        place = PlumePlacement.draw_uniform(
            rng, potential, size_px=size, relative_length=1.5, visible=0.2
        )  # fmt: skip
        w = place.displacement(potential, size_px=size, margin_px=0, drift_px=np.zeros(2))
        total += np.linalg.norm(w, axis=-1) > 0.2
    blocks = total.reshape(4, 8, 4, 8).mean(axis=(1, 3)) / count
    assert blocks.mean() > 0.05
    assert np.abs(blocks / blocks.mean() - 1).max() < 0.25
    assert blocks[1:3, 1:3].mean() / blocks.mean() == pytest.approx(1, abs=0.1)


def test_photos_and_runs_are_split_apart(tmp_path: Path) -> None:
    folder = photo_folder(tmp_path / "photos", 60)
    parts = {split: set(find_photos(folder, split)) for split in ("train", "validation", "test")}
    assert sum(len(part) for part in parts.values()) == len(set().union(*parts.values())) == 60
    assert len(parts["train"]) > 35
    assert split_of_photo(Path("a/b.png")) == split_of_photo(Path("c/b.webp"))
    runs = [split_of_run(number) for number in range(40)]
    assert [runs.count(split) for split in ("train", "validation", "test")] == [32, 4, 4]


def test_runs_are_made_once_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flows, "CELLS", (24, 24, 36))
    for number in (2, 4):
        path = write_run(tmp_path, number, moments=1)
        potentials = read_run(path)
        np.testing.assert_array_equal(potentials, flows.simulate_run(number, moments=1))
        written = path.stat().st_mtime_ns
        assert write_run(tmp_path, number).stat().st_mtime_ns == written
        assert len(potentials) == 2
        for potential in potentials:
            steepness = np.linalg.norm(potential_gradient(potential), axis=-1)
            assert 0.9 < steepness.max() < 2
            border = np.concatenate([steepness[[0, -1]].ravel(), steepness[:, [0, -1]].ravel()])
            assert border.max() < 0.02
    assert len(runs_in(tmp_path, "train")) == 2
    with pytest.raises(BadInputError, match="test split"):
        runs_in(tmp_path, "test")
    recipe = Recipe(families=PAINTED, size_px=48, flows=tmp_path, turbulence_share=0, negatives=0)
    assert all(sample.mask.any() for sample in samples(recipe, 4))


def test_wind_bends_the_flow_and_a_plate_stops_it() -> None:
    def tracer(**options: Any) -> FloatMap:
        flow = BuoyantFlow(
            (32, 32, 36), cell_m=0.04, radius_m=0.1, deficit=0.3, exit_mps=0.4,
            rng=np.random.default_rng(0), **options,
        )  # fmt: skip
        flow.advance(2.0)
        return flow.tracer

    free = tracer()
    assert _lean(tracer(wind_mps=0.4)) > _lean(free) + 2
    plate = np.zeros((32, 32, 36), bool)
    plate[10:22, 10:22, 14:17] = True
    above = (slice(12, 20), slice(12, 20), slice(17, 24))
    assert free[above].sum() > 20 * abs(tracer(solid=plate)[above].sum())


def _lean(field: FloatMap) -> float:
    """How far the middle of the tracer lies downwind of the middle of the box, cells."""
    x = np.arange(len(field)) - (len(field) - 1) / 2
    return float((field.sum(axis=(1, 2)) @ x) / field.sum())


def test_normalised_peak_is_one() -> None:
    potential = normalise_potential(7 * random_turbulence(np.random.default_rng(0)))
    steepness = np.linalg.norm(potential_gradient(potential), axis=-1)
    assert np.percentile(steepness[steepness > 0.01], 99.9) == pytest.approx(1, abs=0.01)


def test_rendering_resumes_to_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dataset, "SHARD_SAMPLES", 3)
    folder = tmp_path / "samples"
    paths = render_dataset(SMALL, 7, folder)
    assert [path.name for path in paths] == [f"shard_{k:05d}.npz" for k in range(3)]
    before = [path.read_bytes() for path in paths]
    paths[1].unlink()
    assert render_dataset(SMALL, 7, folder) == paths
    assert [path.read_bytes() for path in paths] == before
    render_dataset(SMALL, 11, folder, processes=2)
    shards = list(shards_in(folder))
    assert [len(shard) for shard in shards] == [3, 3, 3, 2]
    assert not list(folder.glob("*.partial*"))
    kept = [shard.sample_at(i) for shard in shards for i in range(len(shard))]
    for sample, expected in zip(kept, samples(SMALL, 11), strict=True):
        np.testing.assert_array_equal(sample.image, expected.image)
        np.testing.assert_array_equal(sample.mask, expected.mask)
        np.testing.assert_allclose(sample.displacement, expected.displacement, atol=1e-3)
        assert sample.family == expected.family


def test_a_folder_belongs_to_one_recipe(tmp_path: Path) -> None:
    render_dataset(SMALL, 1, tmp_path)
    with pytest.raises(BadInputError, match="another recipe"):
        render_dataset(SMALL.model_copy(update={"seed": 1}), 1, tmp_path)
    (tmp_path / "shard_00000.npz").write_bytes(b"broken")
    with pytest.raises(BadInputError, match="delete it"):
        render_dataset(SMALL, 1, tmp_path)
    with pytest.raises(BadInputError, match="delete it"):
        Shard.load(tmp_path / "shard_00000.npz")
    (tmp_path / "dataset.json").write_text(json.dumps({"schema": "other/1"}))
    with pytest.raises(BadInputError, match="schema"):
        list(shards_in(tmp_path))


def test_recipes_come_from_yaml_with_folders_beside_them(tmp_path: Path) -> None:
    photo_folder(tmp_path / "photos", 30)
    path = tmp_path / "recipe.yaml"
    path.write_text(yaml.safe_dump({"families": {"photo": 1, "lines": 2}, "photos": "photos"}))
    recipe = Recipe.load(path)
    assert recipe.photos == tmp_path / "photos"
    assert Recipe.from_plain(recipe.to_plain()) == recipe
    assert all(a < b for a, b in pairwise(Sources.from_recipe(recipe).photos))


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ({}, "families"),
        ({"families": {}}, "families"),
        ({"families": {"stars": 1}}, "stars"),
        ({"families": {"lines": -1}}, "families"),
        ({"families": {"photo": 1}}, "photos"),
        ({"families": {"lines": 1}, "sizes": 3}, "sizes"),
        ({"families": {"lines": 1}, "peak_px": [2, 1]}, "peak_px"),
        ({"families": {"lines": 1}, "peak_px": [0.01, 1]}, "peak_px"),
        ({"families": {"lines": 1}, "peak_px": [1, float("inf")]}, "peak_px"),
        ({"families": {"lines": 1}, "noise": [0, 1]}, "noise"),
        ({"families": {"lines": 1}, "period_px": [1, 9]}, "period_px"),
        ({"families": {"lines": 1}, "negatives_of": {"lines": 2}}, "negatives_of"),
        ({"families": {"lines": 1}, "split": "all"}, "split"),
        ({"families": {"lines": 1}, "peak_px": [1, 1e308]}, "peak_px"),
        ({"families": {"lines": 1}, "plume_length": [1, 1e9]}, "plume_length"),
        ({"families": {"lines": 1}, "size_px": True}, "size_px: yes and no"),
        ({"families": {"lines": True}}, "families: yes and no"),
        ([], "recipe"),
    ],
)
def test_bad_recipes_say_what_is_wrong(content: object, word: str) -> None:
    with pytest.raises(BadInputError, match=word):
        Recipe.from_plain(content)


def test_missing_files_say_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"none\.yaml: cannot be read \(No such file"):
        Recipe.load(tmp_path / "none.yaml")
    with pytest.raises(BadInputError, match="no photos"):
        Sources.from_recipe(Recipe(families={"photo": 1}, photos=tmp_path))
    with pytest.raises(BadInputError, match="not a simulated run"):
        read_run(tmp_path / "run_00000.npz")
    (tmp_path / "a.png").write_bytes(b"no picture")
    recipe = Recipe(families={"photo": 1}, photos=tmp_path, split=split_of_photo(tmp_path / "a"))
    with pytest.raises(BadInputError, match=r"a\.png: not a readable image"):
        sample_at(0, recipe, Sources.from_recipe(recipe))
