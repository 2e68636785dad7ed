"""Poses of photographs from the photographs alone, by COLMAP: the command ``satgs-poses``, and :func:`find_poses`.

Needs ``pycolmap`` (``pip install './python[poses]'``), which runs on the CPU: SIFT features, matching of all pairs or of
neighbours in time, incremental mapping. The result is a COLMAP project that ``satgs run`` reads.
"""

from __future__ import annotations

import argparse
import importlib
import shutil
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PHOTOGRAPHS = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp"})
"""Ends of the names of photographs."""

EXHAUSTIVE_UP_TO = 200
"""Number of photographs up to which every pair is matched by default; beyond it neighbours by name, as of a video."""

FEWEST_POSITIONS = 3
"""Photographs with a GPS position that a georeference needs."""


class PosesError(Exception):
    """Why there are no poses, with a line of what to do about it."""


@dataclass(frozen=True)
class Poses:
    """What was found.

    Attributes:
        scene: The COLMAP project: ``images`` and ``sparse/0``.
        images: Number of photographs.
        placed: Number of photographs with a pose.
        left_out: Names of those without one.
        points: Number of points.
        reprojection_px: Mean reprojection error of the points, pixels.
        positions: Number of photographs with a GPS position in their EXIF.
    """

    scene: Path
    images: int
    placed: int
    left_out: tuple[str, ...]
    points: int
    reprojection_px: float
    positions: int

    @property
    def can_be_georeferenced(self) -> bool:
        """Whether ``satgs run --georef exif`` may find the place on Earth."""
        return self.positions >= FEWEST_POSITIONS


def find_poses(
    images: Path | str,
    scene: Path | str,
    *,
    one_camera: bool = False,
    matcher: str | None = None,
    max_size: int | None = None,
    overwrite: bool = False,
) -> Poses:
    """Finds the poses of the photographs in a folder and writes a COLMAP project.

    Args:
        images: Folder of photographs; folders in it are searched too.
        scene: Folder for the project. The photographs are copied to ``scene/images``, with their EXIF.
        one_camera: Whether one camera took all photographs at one focal length.
        matcher: ``exhaustive`` or ``sequential`` (neighbours by name); by default the first up to 200 photographs.
        max_size: Longest side in pixels at which features are searched; by default that of COLMAP, 3200.
        overwrite: Whether a project in ``scene`` is replaced.

    Raises:
        PosesError: If ``pycolmap`` is missing, there are fewer than two photographs, the scene exists, or no two
            photographs fit together.
    """
    pycolmap = _pycolmap()
    images, scene = Path(images), Path(scene)
    names = _photographs(images)
    model = scene / "sparse" / "0"
    if model.exists() and not overwrite:
        raise PosesError(f"`{model}` exists\nhint: --overwrite replaces it")
    folder = _with_images(images, scene, names)
    with tempfile.TemporaryDirectory(prefix="satgs-poses-") as place:
        database = Path(place) / "database.db"
        # The same photographs give the same poses.
        pycolmap.set_random_seed(0)
        extraction = pycolmap.FeatureExtractionOptions()
        if max_size is not None:
            extraction.max_image_size = max_size
        mode = pycolmap.CameraMode.SINGLE if one_camera else pycolmap.CameraMode.AUTO
        pycolmap.extract_features(
            database,
            folder,
            image_names=names,
            camera_mode=mode,
            extraction_options=extraction,
            device=pycolmap.Device.cpu,
        )
        if (matcher or ("exhaustive" if len(names) <= EXHAUSTIVE_UP_TO else "sequential")) == "exhaustive":
            pycolmap.match_exhaustive(database, device=pycolmap.Device.cpu)
        else:
            pycolmap.match_sequential(database, device=pycolmap.Device.cpu)
        models = Path(place) / "models"
        models.mkdir()
        found = pycolmap.incremental_mapping(database, folder, models)
        if not found:
            raise PosesError(
                f"no two of the {len(names)} photographs in `{images}` fit together\n"
                "hint: neighbouring photographs must show the same things, sharply, from places apart"
            )
        best = max(found.values(), key=lambda each: each.num_reg_images())
        _write(best, model)
        placed = {image.name for image in best.images.values() if image.has_pose}
    return Poses(
        scene=scene,
        images=len(names),
        placed=len(placed),
        left_out=tuple(name for name in names if name not in placed),
        points=best.num_points3D(),
        reprojection_px=float(best.compute_mean_reprojection_error()),
        positions=sum(_has_position(pycolmap, folder / name) for name in names),
    )


def _pycolmap() -> Any:
    try:
        return importlib.import_module("pycolmap")
    except ImportError as error:
        raise PosesError(f"pycolmap cannot be used: {error}\nhint: pip install './python[poses]'") from error


def _photographs(folder: Path) -> list[str]:
    """Names of the photographs in a folder, with the folders in it, in order."""
    if not folder.is_dir():
        raise PosesError(f"`{folder}` is no folder\nhint: give the folder of the photographs")
    files = (path for path in folder.rglob("*") if path.suffix.lower() in PHOTOGRAPHS and path.is_file())
    names = sorted(path.relative_to(folder).as_posix() for path in files)
    if len(names) < 2:
        raise PosesError(f"`{folder}` holds {len(names)} photographs\nhint: poses need two or more of one place")
    return names


def _with_images(images: Path, scene: Path, names: list[str]) -> Path:
    """The folder of the photographs in the scene, to which they are copied unless they are there."""
    folder = scene / "images"
    if folder.resolve() == images.resolve():
        return folder
    for name in names:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.exists() or not target.samefile(images / name):
            shutil.copy2(images / name, target)
    return folder


def _write(reconstruction: Any, model: Path) -> None:
    """Writes a model beside its place, and moves it there when it is complete."""
    model.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".model-", dir=model.parent) as place:
        whole = Path(place) / "0"
        whole.mkdir()
        reconstruction.write(whole)
        if model.exists():
            shutil.rmtree(model)
        whole.rename(model)


def _has_position(pycolmap: Any, path: Path) -> bool:
    bitmap = pycolmap.Bitmap.read(path, as_rgb=False)
    return bitmap is not None and bitmap.exif_latitude() is not None


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit code: 0 done, 2 wrong usage or input, 3 some photographs have no pose."""
    args = _parser().parse_args(arguments)
    try:
        poses = find_poses(
            args.images,
            args.output,
            one_camera=args.one_camera,
            matcher=args.matcher,
            max_size=args.max_size,
            overwrite=args.overwrite,
        )
    except PosesError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    print(
        f"{poses.placed} of {poses.images} photographs have poses; {poses.points} points, "
        f"mean reprojection error {poses.reprojection_px:.2f} px"
    )
    if poses.left_out:
        print(f"without a pose: {', '.join(poses.left_out)}")
    georef = " --georef exif" if poses.can_be_georeferenced else ""
    print(f"next: satgs run {poses.scene} -o RUN{georef}")
    return 3 if poses.left_out else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="satgs-poses",
        description="Finds the poses of photographs from the photographs alone (COLMAP, on the CPU), and writes a scene "
        "that `satgs run` reads. Photographs are copied with their EXIF, so that `--georef exif` finds their GPS positions.",
        epilog="Exit codes: 0 done, 2 wrong usage or input, 3 some photographs have no pose, 130 interrupted.",
    )
    parser.add_argument("images", metavar="IMAGES", type=Path, help="folder of the photographs")
    parser.add_argument("-o", "--output", metavar="SCENE", type=Path, required=True, help="folder for the scene")
    parser.add_argument(
        "--one-camera",
        action="store_true",
        help="one camera took all photographs, at one focal length [default: one camera for each size of images and "
        "focal length in EXIF]",
    )
    parser.add_argument(
        "--matcher",
        choices=["exhaustive", "sequential"],
        help=f"match all pairs, or neighbours by name, as of a video [default: all pairs of up to {EXHAUSTIVE_UP_TO}]",
    )
    parser.add_argument(
        "--max-size", metavar="PX", type=int, help="longest side at which features are searched [default: 3200]"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace the poses in SCENE")
    return parser


if __name__ == "__main__":
    sys.exit(main())
