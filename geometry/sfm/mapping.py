"""Camera poses from verified matches: global mapping, incremental mapping, final adjustment."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pycolmap

from geometry.sfm.covariance import residual_sigma_px
from geometry.sfm.features import SEED, THREADS

MIN_MODEL_IMAGES = 3
"""Fewest images of a model that COLMAP keeps."""
TRACKS_PER_VIEW = 100
"""Tracks that global mapping uses of each image, for speed."""
GLOBAL_TOLERANCE = 1e-3  # of the cost; `adjust_bundle` follows
ROUGH_TOLERANCE, FINE_TOLERANCE = 1e-2, 1e-4
"""Relative change of the cost at which the two adjustments end."""


def map_globally(
    database: Path, image_dir: Path, output: Path, *, refine_camera: bool
) -> list[pycolmap.Reconstruction]:
    """All poses at once (GLOMAP: Pan et al., ECCV 2024); the largest model first."""
    options = pycolmap.GlobalPipelineOptions()
    options.num_threads = THREADS
    options.random_seed = SEED
    options.mapper.ba_num_iterations = 1
    options.mapper.track_required_tracks_per_view = TRACKS_PER_VIEW
    options.mapper.global_positioning.use_gpu = False
    adjustment = options.mapper.bundle_adjustment
    adjustment.ceres.use_gpu = False
    adjustment.ceres.solver_options.function_tolerance = GLOBAL_TOLERANCE
    adjustment.refine_focal_length = refine_camera
    adjustment.refine_extra_params = refine_camera
    output.mkdir(parents=True, exist_ok=True)
    options.mapper.skip_retriangulation = True
    models = pycolmap.global_mapping(database, image_dir, output, options)
    for model in models.values():
        _triangulate_points(database, model)
    return _by_size(models)


def _triangulate_points(database: Path, model: pycolmap.Reconstruction) -> None:
    """All points that the matches support, in place; poses stay."""
    with pycolmap.Database.open(database) as db:
        cache = pycolmap.DatabaseCache.create(db, pycolmap.DatabaseCacheOptions())
    mapper = pycolmap.IncrementalMapper(cache)
    mapper.begin_reconstruction(model)
    options = pycolmap.IncrementalTriangulatorOptions()
    options.random_seed = SEED
    for image_id in model.reg_image_ids():
        mapper.triangulate_image(options, image_id)
    mapper.complete_and_merge_tracks(options)
    mapper.filter_points(pycolmap.IncrementalMapperOptions())
    mapper.end_reconstruction(False)


def map_incrementally(
    database: Path,
    image_dir: Path,
    output: Path,
    *,
    refine_camera: bool,
    names: Sequence[str] = (),
    on_image: Callable[[], None] | None = None,
) -> list[pycolmap.Reconstruction]:
    """One image after the other (Schönberger and Frahm, CVPR 2016); the largest model first.

    Args:
        database: Features and matches.
        image_dir: Folder of the images.
        output: Where COLMAP writes the models.
        refine_camera: Estimate the intrinsics too.
        names: Use these images only; all where empty.
        on_image: Called after each image that was added.
    """
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = THREADS
    options.random_seed = SEED
    options.extract_colors = False
    options.min_model_size = MIN_MODEL_IMAGES
    options.image_names = list(names)
    options.ba_refine_focal_length = refine_camera
    options.ba_refine_extra_params = refine_camera
    options.mapper.abs_pose_refine_focal_length = refine_camera
    options.mapper.abs_pose_refine_extra_params = refine_camera
    output.mkdir(parents=True, exist_ok=True)
    models = pycolmap.incremental_mapping(
        database, image_dir, output, options, next_image_callback=on_image or _ignore_image
    )
    return _by_size(models)


def adjust_bundle(model: pycolmap.Reconstruction, *, refine_camera: bool) -> None:
    """The last bundle adjustments, in place: a rough one, and one that outliers do not bend.

    The robust loss has the scale of the residuals themselves: most features are good to a fifth of
    a pixel, and those a moving plume carries off are not. The rough one gives that scale.
    """
    for tolerance in (ROUGH_TOLERANCE, FINE_TOLERANCE):
        adjust_once(
            model, refine_focal=refine_camera, refine_lens=refine_camera, tolerance=tolerance
        )
    model.update_point_3d_errors()


def adjust_once(
    model: pycolmap.Reconstruction, *, refine_focal: bool, refine_lens: bool, tolerance: float
) -> None:
    """One bundle adjustment, in place; the robust loss has the scale of the present residuals."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = refine_focal
    options.refine_extra_params = refine_lens
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = residual_sigma_px(model)
    options.ceres.solver_options.num_threads = THREADS
    options.ceres.solver_options.max_num_iterations = 50
    options.ceres.solver_options.function_tolerance = tolerance
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_ceres_bundle_adjuster(options, config, model).solve()


def _ignore_image() -> None:
    """The callback of those who ask for none."""


def _by_size(models: dict[int, pycolmap.Reconstruction]) -> list[pycolmap.Reconstruction]:
    """Without those whose points were all dropped: poses that nothing holds."""
    held = (model for model in models.values() if model.num_points3D())
    return sorted(held, key=lambda model: -model.num_reg_images())
